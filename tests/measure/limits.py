"""Worst combinations of limit cases against all combinations of some inputs:
``python tests/measure/limits.py [SUBSETS] [INPUTS]``.
"""

import itertools
import sys

import numpy as np

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.limit_cases import _LimitSearch
from sepmc.scene.read import parse_campaign

# campaign, and outcomes with the sides of their bounds; the smallest of a rate that is a magnitude
# is no limit case: inputs cancel there
BOTH = ("at_least", "at_most")
CAMPAIGNS = {
    "table2": {"separation_speed_m_s": BOTH, "upper_pitch_deg": BOTH, "lower_omega_z_deg_s": BOTH},
    "lightband": {
        "clear_craft_transverse_rate_deg_s": ("at_most",),
        "separation_speed_m_s": BOTH,
    },
}


def main(subsets: int, inputs: int) -> None:
    """Print how often the search ends at the worst of all combinations."""
    random = np.random.default_rng(1)
    for name, metrics in CAMPAIGNS.items():
        items = [
            {"name": f"r{k}{side}", "metric": metric, side: 0.0}
            for k, (metric, sides) in enumerate(metrics.items())
            for side in sides
        ]
        tree = sepmc.load(name, {"run.history_step_s": 0.0}).file.tree | {"requirement": items}
        tree.pop("scenario", None)
        campaign = Campaign(parse_campaign(tree, name))
        search = _LimitSearch(campaign, campaign.file.requirements, None, None)
        everything = search.combined
        worst = total = 0
        short = 0.0  # largest shortfall, of the range of all combinations
        for _ in range(subsets):
            chosen = random.choice(everything, min(inputs, len(everything)), replace=False)
            search.combined = [k for k in everything if k in chosen]
            choices = [(0, *search.ends(k)) for k in search.combined]
            levels = np.tile(search.nominal, (int(np.prod([len(c) for c in choices])), 1))
            levels[:, search.combined] = list(itertools.product(*choices))
            status, outcomes = search.run(levels)
            for item in campaign.file.requirements:
                _, margin, _ = search.judge(item, status, outcomes)
                levels_found = search.worst(item)[None]
                _, mine, _ = search.judge(item, *search.run(levels_found))
                gap = float((mine[0] - margin.min()) / np.ptp(margin))
                total, worst, short = total + 1, worst + (gap < 1e-9), max(short, gap)
            search.results.clear()
        print(
            f"{name}: worst of all combinations of {inputs} inputs in {worst} of {total} searches; "
            f"else within {100.0 * short:.2g} % of their range",
            flush=True,
        )


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given + [20, 7][len(given) :]))
