"""Coverage of the confidence intervals at which ``--until`` stops, on fifteen problems of known
statistics: ``python tests/measure/until.py [REPEATS]``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.stopping_problems import CASES, PROBLEMS, REPEATS, coverage


def main():
    """Measure and print."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    print(f"{repeats} repeats each, of {CASES} cases at most")
    for name, problem in PROBLEMS.items():
        covered, enough, cases = coverage(name, repeats)
        print(
            f"  {name:40s} {problem.until:20s} holds the truth in {100 * covered:5.1f} %; "
            f"known well enough in {100 * enough:5.1f} %, after {cases:7.0f} cases"
        )


if __name__ == "__main__":
    main()
