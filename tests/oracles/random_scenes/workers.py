"""Worker processes that judge scenes, one for each core. A process that dies is reported as a
verdict."""

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
LIMIT_S = 60.0  # per interpreted scene
COMPILED_LIMIT_S = 600.0  # per compiled scene
# Faults of an interpreted scene whose steps few calibration cases chose: repeated with the step
# selection of users, and kept if that takes too long.
_REPEATED = {"silent", "entry"}
_GRACE_S = 30.0  # additional time for a process to end its fork


def environment() -> dict[str, str]:
    """Environment of a process that imports from the same folders as this one."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


class Worker:
    """Process that judges scenes one after the other."""

    def __init__(self, limit_s: float = LIMIT_S):
        one_thread = {
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "NUMBA_NUM_THREADS": "1",
        }
        self.limit_s, self.stopped = limit_s, False
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "oracles.random_scenes.worker"],
            env=environment() | one_thread,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # ends together with the processes that it started
        )

    def judge(self, job: Job, limit_s: float | None = None) -> dict[str, Any] | None:
        """Verdict on a job; None if the process died or took longer than ``limit_s`` (by default
        the worker's own). Its fork may have, too: see `oracles.random_scenes.worker`."""
        limit_s = limit_s or self.limit_s
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        forked = not job.get("compiled")
        timer = threading.Timer(limit_s + (_GRACE_S if forked else 0.0), self._stop)
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
        """End the process because of its time limit."""
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
    """Verdicts on all jobs as they finish.

    Parameters
    ----------
    jobs : list of dict
        See `oracles.random_scenes.worker.work`.
    processes : int
    limit_s : float
        Time for an interpreted scene; one that takes longer is judged compiled, and ``late`` is
        true in its verdict. A compiled one has at least `COMPILED_LIMIT_S`; one that takes longer
        gets no verdict.
    """
    open_jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    verdicts: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    running: list[Worker] = []
    for job in jobs:
        open_jobs.put(job)
    for _ in range(processes):
        threading.Thread(
            target=_work, args=(open_jobs, verdicts, limit_s, running), daemon=True
        ).start()
    try:
        for _ in jobs:
            yield verdicts.get()
    finally:  # after an interrupt no worker remains
        with contextlib.suppress(queue.Empty):
            while True:
                open_jobs.get_nowait()
        for worker in running:
            worker.kill()


def _work(
    open_jobs: queue.SimpleQueue[Job],
    verdicts: queue.SimpleQueue[dict[str, Any]],
    limit_s: float,
    running: list[Worker],
) -> None:
    """Let one worker process judge jobs until none is left."""
    worker = None
    while True:
        try:
            job = open_jobs.get_nowait()
        except queue.Empty:
            break
        if worker is None:
            worker = Worker(limit_s)
            running.append(worker)
        longer = max(limit_s, COMPILED_LIMIT_S)
        limit = longer if job.get("compiled") else limit_s
        verdict = worker.judge(job, limit)
        dead = verdict is None
        if verdict and verdict.get("late"):
            limit = longer
            verdict = worker.judge({**job, "compiled": True}, limit)
            dead = verdict is None
            verdict = verdict and {**verdict, "late": True}
        if verdict and not job.get("compiled") and _REPEATED & set(verdict.get("rows", ())):
            repeated = worker.judge({**job, "compiled": True}, longer)
            verdict, dead = repeated or verdict, repeated is None
        if verdict is None or "died" in verdict:
            stopped = verdict is None and worker.stopped
            reason = f"no verdict within {limit:g} s" if stopped else ""
            name = job.get("name") or f"seed {job['seed']}"
            verdict = {
                "name": name,
                "seed": job.get("seed"),
                "crash": "" if reason else "the process died",
                "not_flown": reason,
                "rows": {},
                "said": [],
                "compiled": job.get("compiled", False),
            }
        if dead:
            worker.close()
            worker = None
        verdicts.put(verdict)
    if worker:
        worker.close()
