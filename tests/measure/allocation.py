"""How often `sepmc allocate` is right on a problem of known risk, 100 times:
``PYTHONPATH=tests python tests/measure/allocation.py [REPEATS]``.

Intervals of the changes that contain the true change (95 % are stated), and proposals called shown
whose true probability of a violation is beyond the requirement's (at most 10 % are stated).
"""

import sys

from support.sizing_problem import FORCE, SPEED, campaign, risk

from sepmc.campaign.allocation import allocate

KEY, CASES = "spring.pusher.factor", 1000


def main(repeats: int) -> None:
    """Print the counts."""
    within, shown, wrong = {"half": 0, "double": 0}, 0, 0
    for seed in range(repeats):
        force = 1600.0 + 4.0 * (seed % 100)  # risks from 0.27 to 0.006
        cut = {f"dispersion.{KEY}.truncate_sigma": 4.0}
        result = allocate(campaign().with_settings({FORCE.key: force, **cut}), CASES, 10 * seed)
        row = result.table.iloc[0]
        for name, factor in (("half", 0.5), ("double", 2.0)):
            change = risk(force, factor) - risk(force)
            within[name] += int(row[f"{name}_low"] <= change <= row[f"{name}_high"])
        shown += result.shown
        factor = result.factors.get(KEY, 1.0)
        wrong += int(result.shown and risk(force, factor) > 1.0 - SPEED["probability"])
    print(f"{repeats} allocations: intervals with the true change: {within}")
    print(f"proposals shown: {shown}, of these wrong: {wrong}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
