"""Runs in processes and threads of a host program: ``python tests/measure/library.py [--times 100]
[--ways fork,spawn]``. See `support.host_processes`; exit code 1 if any answer is missing or wrong.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.host_processes import LAYERS, MISSING, WAYS, measure


def main() -> int:
    """Measure the requested ways, a line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--ways", default=",".join(WAYS))
    options = parser.parse_args()
    good = True
    for way in options.ways.split(","):
        for layer in LAYERS.get(way, ("default",)):
            counts = measure(way, options.times, layer)
            good &= counts["right"] + counts["sentence"] == options.times or MISSING in counts
            said = ", ".join(f"{count} {what}" for what, count in counts.items())
            print(f"{way} ({layer}), of {options.times}: {said}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
