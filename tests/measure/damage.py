"""Damage a run folder in every way and see that it is told: ``python tests/measure/damage.py
[--count 10000] [--mended 200] [--seed 1]``.

Files are deleted, cut short, flipped in some bits, swapped, edited or added to, one or several at
once; of a run that keeps all rows, and of one that counts them and keeps some, in turn. Of each
damage it is asked: does `sepmc doctor` tell it; do rows and histories that can still be read have
the bits they had; and of some, does ``--repair`` bring all bits back? Exit code 1 if not.
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
from support.damaged_runs import RUNS, contents, damage, files, fly, is_repaired, is_reported, rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--mended", type=int, default=200, help="of how many it is tried")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, help="where folders go that were not mended")
    asked = parser.parse_args()
    rng, seen, missed = np.random.default_rng(asked.seed), Counter(), []
    with tempfile.TemporaryDirectory() as temporary:
        folder, wholes = Path(temporary) / "damaged", []
        for name, words in RUNS.items():
            whole = fly(Path(temporary) / name, *words)
            before = {name: (whole / name).read_bytes() for name in files(whole)}
            wholes.append((whole, before, rows(whole), contents(whole)))
        for number in range(asked.count):
            whole, before, was, kept = wholes[number % len(wholes)]
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(whole, folder)
            done = [damage(folder, rng) for _ in range(int(rng.integers(1, 4)))]
            seen.update(done)
            if not is_reported(folder, before, was):
                missed.append(("not told", done))
            if number < asked.mended and not is_repaired(folder, kept):
                missed.append(("not mended", done))
                if asked.kept:
                    shutil.copytree(folder, asked.kept / str(number))
    by_way = Counter()
    for (way, _), count in seen.items():
        by_way[way] += count
    print(json.dumps({"damages": sum(seen.values()), **by_way}))
    print(f"{asked.count} folders, {asked.mended} of them mended: {len(missed)} missed")
    for one in missed[:20]:
        print(*one)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
