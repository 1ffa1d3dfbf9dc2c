"""Process that judges scenes: a JSON job per line on standard input, a JSON verdict per line on
standard output.

Where processes can fork, a fork judges each scene that runs interpreted: one that takes too long
ends without the loss of imports and caches, which take three seconds.

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
from oracles.random_scenes.entry_points import check_entry_points
from oracles.random_scenes.interpreted import run_interpreted
from oracles.random_scenes.scenes import scene


def work(job: dict[str, Any]) -> dict[str, Any]:
    """Verdict on one job.

    Parameters
    ----------
    job : dict
        ``seed`` (with ``kinds``, see `scene`) or ``tree`` with ``name``: the scene; ``cases``: rows
        compared; ``compiled``: whether its kernel is compiled; ``entry_points``: whether these are
        compared too; ``limit_s``: a fork that takes longer is ended.
    """
    begun = time.perf_counter()
    tree = scene(job["seed"], kinds=job.get("kinds", ())) if "seed" in job else job["tree"]
    name, cases = job.get("name") or f"seed {job['seed']}", job.get("cases", 3)
    with run_interpreted(not job.get("compiled"), cases):
        verdict = judge(tree, name, cases)
        if job.get("entry_points") and verdict.rows:
            check_entry_points(tree, name, verdict)
    return {
        **verdict.to_dict(),
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


def _judge_in_fork(job: dict[str, Any]) -> dict[str, Any]:
    """Verdict of a fork of this process; ``late`` if it took too long, ``died`` if it died."""
    reads, writes = os.pipe()
    parent = os.getpid()
    child = os.fork()
    if not child:  # threads are not copied by fork: a new one ends an orphan
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
        with os.fdopen(writes, "w") as output:
            json.dump(work(job), output)
        os._exit(0)
    os.close(writes)
    answer, until = b"", time.monotonic() + job["limit_s"]
    with os.fdopen(reads, "rb", buffering=0) as pipe:
        while select.select([pipe], [], [], max(0.0, until - time.monotonic()))[0]:
            part = pipe.read(65536)
            answer += part
            if not part:
                break
        else:
            os.kill(child, signal.SIGKILL)
            answer = b'{"late": true}'
    os.waitpid(child, 0)
    return json.loads(answer) if answer else {"died": True}


def _end_with(parent: int) -> None:
    """End this process once its parent has ended."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> None:
    """Judge the jobs of standard input and answer on standard output."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # nothing else prints to the pipe of answers
    warmed_up = False
    for line in sys.stdin:
        job = json.loads(line)
        if hasattr(os, "fork") and not job.get("compiled"):
            if not warmed_up:  # forks inherit what this has imported
                work({"tree": _SMALL, "name": "small", "cases": 1})
            warmed_up, verdict = True, _judge_in_fork(job)
        else:
            verdict = work(job)
        print(json.dumps(verdict), file=answers, flush=True)


if __name__ == "__main__":
    main()
