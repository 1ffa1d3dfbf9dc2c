"""Worker processes, one for each core: those that fly plain Python, and those that fly compiled code."""

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

Job = dict[str, Any]
_LIMIT_S = 600.0  # of one scene


class Worker:
    """A process that judges one scene after the other."""

    def __init__(self, interpreted: bool, limit_s: float = _LIMIT_S):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        environment |= {"NUMBA_DISABLE_JIT": "1"} if interpreted else {"NUMBA_DISABLE_JIT": "0"}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.limit_s = limit_s
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sepmc.trust.gate.worker"], env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def judge(self, job: Job) -> dict[str, Any] | None:
        """The verdict on a job; None if the process died over it or took too long."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        timer = threading.Timer(self.limit_s, self.process.kill)
        timer.start()
        try:
            print(json.dumps(job), file=self.process.stdin, flush=True)
            answer = self.process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        finally:
            timer.cancel()
        return json.loads(answer) if answer else None

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


def judge_all(interpreted: list[Job], compiled: list[Job], processes: int = 2) -> Iterator[dict[str, Any]]:
    """Verdicts on all jobs as they come, by so many processes: one begins with what is compiled, and all end with what is not."""
    left: dict[bool, queue.SimpleQueue[Job]] = {True: queue.SimpleQueue(), False: queue.SimpleQueue()}
    for plain, jobs in ((True, interpreted), (False, compiled)):
        for job in jobs:
            left[plain].put(job)
    found: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    for number in range(processes):
        order = (False, True) if number == 0 else (True, False)
        threading.Thread(target=_work, args=(left, order, found), daemon=True).start()
    for _ in range(len(interpreted) + len(compiled)):
        yield found.get()


def _work(left: dict[bool, queue.SimpleQueue[Job]], order: tuple[bool, bool], found: queue.SimpleQueue[dict[str, Any]]) -> None:
    for plain in order:
        worker = None
        while True:
            try:
                job = left[plain].get_nowait()
            except queue.Empty:
                break
            worker = worker or Worker(plain)
            verdict = worker.judge(job)
            if verdict is None:
                worker.close()
                worker = None
                name = job.get("name") or f"seed {job['seed']}"
                verdict = {"name": name, "seed": job.get("seed"), "crash": "the process died or took too long", "rows": {}, "said": []}
            found.put({**verdict, "interpreted": plain})
        if worker:
            worker.close()
