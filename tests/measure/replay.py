"""Replays of 100 random cases of every shipped campaign, of 2,000: number of bit-identical rows.

``python tests/measure/replay.py [NAME ...]``
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import sepmc
from sepmc.campaign.execution import replay
from sepmc.scene.campaign_files import shipped_campaigns

CASES, REPLAYED = 2000, 100


def main(names: list[str]) -> None:
    """Run, choose, run again, and count."""
    for name in names or shipped_campaigns():
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            result = sepmc.load(name).run(CASES, out=run)
            again = sepmc.load(run)
            chosen = np.random.default_rng(1).choice(CASES, REPLAYED, replace=False)
            flight = replay.earlier_integration(again)
            comparisons = [
                replay.compare_row(again, flight, run, int(n), result.seed, CASES) for n in chosen
            ]
            same = sum(one.was_run and not one.columns for one in comparisons)
            print(f"{name}: {same} of {REPLAYED} rows the same bit by bit", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
