"""A process that judges scenes: a job a line in, a verdict a line out, as JSON.

`python -m sepmc.trust.gate.worker`, started by `sepmc.trust.gate.workers`.
"""

import json
import os
import sys
import threading
import time
from typing import Any

from sepmc.trust.gate.compare import judge
from sepmc.trust.gate.doors import through
from sepmc.trust.gate.plain import flown_plainly
from sepmc.trust.gate.scenes import scene
from sepmc.trust.gate.shrink import shrink


def work(job: dict[str, Any]) -> dict[str, Any]:
    """The verdict on one job.

    ``seed`` or ``tree`` with ``name`` : the scene
    ``cases`` : rows that are flown
    ``compiled`` : whether its kernel flies compiled, and not as plain Python
    ``doors`` : whether to go through the other doors too
    ``shrink`` : instead of a verdict, the smaller tree found in so many flights
    """
    begun = time.perf_counter()
    tree = scene(job["seed"]) if "seed" in job else job["tree"]
    name, cases = job.get("name") or f"seed {job['seed']}", job.get("cases", 3)
    with flown_plainly(not job.get("compiled"), cases):
        if job.get("shrink"):
            return {
                "tree": shrink(
                    tree, cases, job["shrink"], say=lambda text: print(text, file=sys.stderr)
                )
            }
        found = judge(tree, name, cases)
        if job.get("doors") and found.rows:
            through(tree, name, found)
    compiled = bool(job.get("compiled"))
    # by few trial cases, in plain Python: the pilot that users have decides
    if not compiled and found.rows.get("silent"):
        compiled, found = True, judge(tree, name, cases)
    return {
        **found.to_dict(),
        "seconds": time.perf_counter() - begun,
        "seed": job.get("seed"),
        "compiled": compiled,
    }


def _end_with(parent: int) -> None:
    """End this process once the one that asks has ended, however it did."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> None:
    """Judge jobs, a line of standard input each, and answer on standard output until there are no
    more."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what anything prints is not an answer
    for line in sys.stdin:
        print(json.dumps(work(json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
