"""Difference of campaign clearances from exact geometry: ``python tests/measure/clearance.py [CASES
[CAMPAIGN ...]]``.

Every row is compared with a fine simulation of the same case, whose outlines are compared by
`oracles.geometry`. The fine simulations are compiled.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from support.exact_clearances import ROWS_S, exact

import sepmc
from sepmc.campaign.execution import single_case

CAMPAIGNS = (
    "srb.toml",
    "hyper-x.toml",
    "residual-thrust.toml",
    str(Path(__file__).parents[1] / "data" / "nozzle.toml"),
)
# steps of the fine simulation, by a method of order eight; factor on its rows where a difference
# exceeds the reported error
STEP_S, DENSER = 0.01, 4


def measure(name, cases):
    """Print the largest difference of a campaign, m, with its reported error."""
    begun = time.perf_counter()
    result = sepmc.load(name).run(cases=cases)
    fine = sepmc.load(name, {"solver.step_s": STEP_S})
    rows = result.to_pandas()
    flown = [i for i in range(cases) if rows["status"][i] == "ok"]
    exact_clearances = {i: exact(fine, fine.case(i)) for i in flown}
    for clearance in fine.scene.clearance:
        column = f"{clearance.name}_clearance_mm"
        stated = result.accuracy.errors[column] if result.accuracy else np.nan
        scale = max(np.abs(rows[column]).max(), rows[column].std())
        differences, where = [], []
        for i in flown:
            if abs(rows[column][i] - exact_clearances[i][clearance.name][0]) > stated * scale:
                exact_clearances[i] = exact(fine, fine.case(i), every_s=ROWS_S / DENSER)
            least, when = exact_clearances[i][clearance.name]
            differences.append(rows[column][i] - least)
            where.append(
                (i, rows[column][i], least, rows[f"{clearance.name}_clearance_time_s"][i], when)
            )
        worst = int(np.argmax(np.abs(differences)))
        print(
            f"{result.campaign.name:16s} {column:26s} {len(differences)} cases: worst "
            f"{1e-3 * differences[worst]:+.1e} m"
            f" (case {where[worst][0]}: {where[worst][1]:.6f} mm at {where[worst][3]:.6f} s, "
            f"exact {where[worst][2]:.6f} mm at"
            f" {where[worst][4]:.6f} s); stated {1e-3 * stated * scale:.1e} m; "
            f"{time.perf_counter() - begun:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    single_case._MAX_PLAIN_STEPS = 1  # a single run compiles its kernel beyond so many steps
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for each in sys.argv[2:] or CAMPAIGNS:
        measure(each, count)
