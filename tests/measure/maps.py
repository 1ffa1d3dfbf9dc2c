"""How often cells of a map are shown or refuted wrongly, on a problem of known risk:
``PYTHONPATH=tests python tests/measure/maps.py [REPEATS] [CASES] [MAX_CASES]``.

The first and the second design are just beyond and just within the requirement: the first must not
be shown, the second not refuted, each in more than 10 % of the maps. The others are farther off.
"""

import sys
from collections import Counter

import numpy as np
from scipy.optimize import brentq
from support.sizing_problem import FORCE, SPEED, campaign, risk

from sepmc.analysis.requirements import FAIL, PASS
from sepmc.campaign.design_map import MapAxis, map_designs

ALLOWED = 1.0 - SPEED["probability"]


def force_of(probability: float) -> float:
    """Force with a risk."""
    return float(brentq(lambda force: risk(force) - probability, FORCE.low, FORCE.high))


def main(repeats: int, cases: int, max_cases: int) -> None:
    """Print the counts."""
    low, high = force_of(ALLOWED * 1.0001), force_of(ALLOWED * 0.9999)
    problem = campaign(SPEED | {"confidence": 0.9})
    narrow = MapAxis(FORCE.key, low, high, 2)
    wide = MapAxis(FORCE.key, force_of(0.2), force_of(0.005), 9)
    for axis in (narrow, wide):
        risks = np.array([risk(force) for force in axis.values])
        wrong, open_cells, outside = np.zeros(len(risks), int), 0, np.zeros(len(risks), int)
        sizes: Counter[int] = Counter()
        for seed in range(repeats):
            table = map_designs(problem, [axis], cases, seed, max_cases=max_cases).table
            shown, refuted = (table["fast"].to_numpy() == word for word in (PASS, FAIL))
            wrong += np.where(risks > ALLOWED, shown, refuted)
            open_cells += int((~shown & ~refuted).sum())
            low_ends, high_ends = (table[f"fast_{end}"].to_numpy() for end in ("low", "high"))
            outside += (risks < low_ends) | (risks > high_ends)
            sizes.update(table["cases"])
        print(f"{repeats} maps of {len(risks)} designs, {cases} cases, at most {max_cases}")
        print(f"  risks {np.round(risks, 4)}, allowed {ALLOWED:.4g}")
        print(f"  wrong {wrong} (stated: at most {0.1 * repeats:.0f} each)")
        print(f"  risk outside the 95 % interval {outside}; open {open_cells}")
        print(f"  designs by cases: {dict(sorted(sizes.items()))}", flush=True)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given + [1000, 200, 3200][len(given) :]))
