"""Worker processes that judge scenes, one for each core. A process may die over a scene: that is a
verdict too."""

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

Job = dict[str, Any]
LIMIT_S = 60.0  # of one scene flown as plain Python
COMPILED_LIMIT_S = 600.0  # of one whose kernel is compiled
# Faults of a scene that flew as plain Python, in steps found by few trial cases: the pilot that
# users have decides, and if that takes too long they stand.
_DOUBTED = {"silent", "door"}
_LONGER_S = 30.0  # after which a process that should have ended its copy is ended itself


class Worker:
    """A process that judges one scene after the other."""

    def __init__(self, limit_s: float = LIMIT_S):
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        environment |= {
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "NUMBA_NUM_THREADS": "1",
        }
        self.limit_s, self.stopped = limit_s, False
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "oracles.random_scenes.worker"],
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # it ends with the processes that it started
        )

    def judge(self, job: Job, limit_s: float | None = None) -> dict[str, Any] | None:
        """The verdict on a job; None if the process died over it or took longer than ``limit_s``,
        if that is not the worker's own. Its copy may have: see `oracles.random_scenes.worker`."""
        limit_s = limit_s or self.limit_s
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        copied = not (job.get("compiled") or job.get("shrink"))
        timer = threading.Timer(limit_s + (_LONGER_S if copied else 0.0), self._stop)
        timer.start()
        try:
            print(json.dumps({**job, "limit_s": limit_s}), file=self.process.stdin, flush=True)
            answer = self.process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        finally:
            timer.cancel()
        return json.loads(answer) if answer else None

    def _stop(self) -> None:
        self.stopped = True
        self.kill()

    def kill(self) -> None:
        """End the process and all that it started, compilers among them."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End the process and close its pipes."""
        self.kill()
        self.process.communicate()  # closes its pipes


def judge_all(
    jobs: list[Job], processes: int = 2, limit_s: float = LIMIT_S
) -> Iterator[dict[str, Any]]:
    """Verdicts on all jobs as they come, by so many processes; a scene that takes longer than
    ``limit_s``, or compiled also than `COMPILED_LIMIT_S`, gets none."""
    left: queue.SimpleQueue[Job] = queue.SimpleQueue()
    found: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    running: list[Worker] = []
    for job in jobs:
        left.put(job)
    for _ in range(processes):
        threading.Thread(target=_work, args=(left, found, limit_s, running), daemon=True).start()
    try:
        for _ in jobs:
            yield found.get()
    finally:  # interrupted: no worker outlives who asked
        with contextlib.suppress(queue.Empty):
            while True:
                left.get_nowait()
        for worker in running:
            worker.kill()


def _work(
    left: queue.SimpleQueue[Job],
    found: queue.SimpleQueue[dict[str, Any]],
    limit_s: float,
    running: list[Worker],
) -> None:
    worker = None
    while True:
        try:
            job = left.get_nowait()
        except queue.Empty:
            break
        if worker is None:
            worker = Worker(limit_s)
            running.append(worker)
        longer = max(limit_s, COMPILED_LIMIT_S)
        limit = longer if job.get("compiled") else limit_s
        verdict = worker.judge(job, limit)
        dead = verdict is None
        if verdict and not job.get("compiled") and _DOUBTED & set(verdict.get("rows", ())):
            again = worker.judge({**job, "compiled": True}, longer)
            verdict, dead = again or verdict, again is None
        if verdict is None or "late" in verdict or "died" in verdict:
            stopped = worker.stopped if verdict is None else "late" in verdict
            late = f"no verdict within {limit:g} s" if stopped else ""
            name = job.get("name") or f"seed {job['seed']}"
            verdict = {
                "name": name,
                "seed": job.get("seed"),
                "crash": "" if late else "the process died",
                "not_flown": late,
                "rows": {},
                "said": [],
                "compiled": job.get("compiled", False),
            }
        if dead:
            worker.close()
            worker = None
        found.put(verdict)
    if worker:
        worker.close()
