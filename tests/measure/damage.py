"""Random damage to run folders, which must be reported: ``python tests/measure/damage.py [--count
10000] [--mended 200] [--seed 1]``.

Files are deleted, truncated, changed in some bits, swapped, edited or extended, one or several at
once; alternately of a run that stores all rows, and of one that counts cases and stores some rows.
Checked are: `sepmc doctor` reports the damage; rows and histories that can still be read have their
former bits; and, for some, ``--repair`` restores all bits. Exit code 1 if not.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from support.damaged_runs import (
    RUNS,
    contents,
    damage,
    files,
    is_repaired,
    is_reported,
    make_run,
    rows,
)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--mended", type=int, default=200, help="of how many it is tried")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, help="where folders go that were not mended")
    arguments = parser.parse_args()
    rng, seen, missed = np.random.default_rng(arguments.seed), Counter(), []
    with tempfile.TemporaryDirectory() as temporary:
        folder, wholes = Path(temporary) / "damaged", []
        for name, words in RUNS.items():
            whole = make_run(Path(temporary) / name, *words)
            before = {name: (whole / name).read_bytes() for name in files(whole)}
            wholes.append((whole, before, rows(whole), contents(whole)))
        for number in range(arguments.count):
            whole, before, was, kept = wholes[number % len(wholes)]
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(whole, folder)
            done = [damage(folder, rng) for _ in range(int(rng.integers(1, 4)))]
            seen.update(done)
            if not is_reported(folder, before, was):
                missed.append(("not told", done))
            if number < arguments.mended and not is_repaired(folder, kept):
                missed.append(("not mended", done))
                if arguments.kept:
                    shutil.copytree(folder, arguments.kept / str(number))
    by_way = Counter()
    for (way, _), count in seen.items():
        by_way[way] += count
    print(json.dumps({"damages": sum(seen.values()), **by_way}))
    print(f"{arguments.count} folders, {arguments.mended} of them mended: {len(missed)} missed")
    for one in missed[:20]:
        print(*one)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
