"""Random changes of untrusted files: ``python tests/measure/fuzz.py [--count 1000000] [--seed 1]
[--seconds 3600] [--part NAME]``.

Campaign files, input tables, files of the field and run folders are changed at random and given to
the entry points of a user. A finding is an input that is not refused by a sentence: a traceback,
more than five seconds, more than 4 GB of memory, a file written outside of the run folder, a wrong
number. Exit code 1 if there is one. Changes know the format (`fuzz.mutate`), so neither atheris nor
another guided fuzzer is needed. Simulations may take their time: more than a minute is counted as
slow.
"""

import argparse
import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz import brought_files, campaigns, channels, flights, formulas, run_folders, tables
from fuzz.watch import spread

# parts, and their fractions of --count and of --seconds
PARTS = {
    "trees": (campaigns.trees, 0.5, 0.4),
    "files": (brought_files.files, 0.1, 0.05),
    "channels": (channels.channels, 0.05, 0.05),
    "texts": (campaigns.texts, 0.2, 0.1),
    "sizes": (campaigns.sizes, 0.001, 0.05),
    "tables": (tables.tables, 0.199, 0.15),
    "folders": (run_folders.run_folders, 0.005, 0.2),
    "rows": (flights.rows, 0.01, 0.05),
    "numbers": (flights.numbers, 0.005, 0.1),
    "kernels": (campaigns.kernels, 0.001, 0.05),
    "formulas": (formulas.formulas, 1.0, 0.1),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--shown", type=int, default=300, help="characters of an input")
    arguments = parser.parse_args()
    total = bad = 0
    for name in arguments.part or PARTS:
        part, share, of_time = PARTS[name]
        count = max(1, round(arguments.count * share))
        seconds = arguments.seconds * (1.0 if arguments.part else of_time)
        tried = spread(part, count, seconds, arguments.seed, arguments.processes)
        total += tried.counts["inputs"]
        bad += len(tried.findings)
        print(name, json.dumps(tried.counts), "longest", *tried.longest, flush=True)
        for kind, (times, inputs) in sorted(tried.findings.items(), key=lambda x: -x[1][0]):
            print(f"  {times} x {kind}\n      {inputs[0][: arguments.shown]}", flush=True)
    print(f"{total} inputs, {bad} kinds of findings")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
