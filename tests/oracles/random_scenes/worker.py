"""A process that judges scenes: a job a line in, a verdict a line out, as JSON.

Where processes can be copied (`os.fork`), a copy judges each scene that flies as plain Python: one
that takes too long ends without what was imported and read before, which takes three seconds.

`python -m oracles.random_scenes.worker`, started by `oracles.random_scenes.workers`.
"""

import json
import os
import select
import signal
import sys
import threading
import time
from typing import Any

from oracles.random_scenes.compare import judge
from oracles.random_scenes.entry_points import through
from oracles.random_scenes.interpreted import flown_plainly
from oracles.random_scenes.scenes import scene
from oracles.random_scenes.shrink import shrink


def work(job: dict[str, Any]) -> dict[str, Any]:
    """The verdict on one job.

    ``seed`` (with ``kinds``: see `scene`) or ``tree`` with ``name`` : the scene
    ``cases`` : rows that are flown
    ``compiled`` : whether its kernel flies compiled, and not as plain Python
    ``doors`` : whether to go through the other doors too
    ``shrink`` : instead of a verdict, the smaller tree found in so many flights
    ``limit_s`` : a copy of the process that takes longer is ended
    """
    begun = time.perf_counter()
    tree = scene(job["seed"], kinds=job.get("kinds", ())) if "seed" in job else job["tree"]
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
    return {
        **found.to_dict(),
        "seconds": time.perf_counter() - begun,
        "seed": job.get("seed"),
        "compiled": bool(job.get("compiled")),
    }


_SMALL = {
    "body": {"body": {"mass_kg": 1.0, "inertia_kg_m2": [1.0, 1.0, 1.0], "cg_m": [0.0, 0.0, 0.0]}},
    "phase": [{"name": "free"}],
    "initial": {"altitude_m": 0.0, "speed_m_s": 0.0},
    "run": {"end_time_s": 0.1, "cases": 1},
}


def _judged_by_a_copy(job: dict[str, Any]) -> dict[str, Any]:
    """The verdict of a copy of this process; ``late`` if it took too long, ``died`` if it did."""
    reads, writes = os.pipe()
    asks = os.getpid()
    copy = os.fork()
    if not copy:  # threads are not copied: without one it would fly on, however long, once alone
        threading.Thread(target=_end_with, args=(asks,), daemon=True).start()
        with os.fdopen(writes, "w") as pipe:
            json.dump(work(job), pipe)
        os._exit(0)
    os.close(writes)
    answer, until = b"", time.monotonic() + job["limit_s"]
    with os.fdopen(reads, "rb", buffering=0) as found:
        while select.select([found], [], [], max(0.0, until - time.monotonic()))[0]:
            part = found.read(65536)
            answer += part
            if not part:
                break
        else:
            os.kill(copy, signal.SIGKILL)
            answer = b'{"late": true}'
    os.waitpid(copy, 0)
    return json.loads(answer) if answer else {"died": True}


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
    copies = False
    for line in sys.stdin:
        job = json.loads(line)
        if hasattr(os, "fork") and not (job.get("compiled") or job.get("shrink")):
            if not copies:  # they have what this has imported
                work({"tree": _SMALL, "name": "small", "cases": 1})
            copies, found = True, _judged_by_a_copy(job)
        else:
            found = work(job)
        print(json.dumps(found), file=answers, flush=True)


if __name__ == "__main__":
    main()
