"""Process of several that run at once: for engines whose Python interface allows one thread only,
or that must run separately.

The process reads pickles from its standard input: first the flight's factory and arguments, then
commands. Only cases go in and outcomes come out that way, outside the timed part; a command and its
answer take 0.1 ms.
"""

import importlib
import os
import pickle
import subprocess
import sys
import tempfile
import time
from typing import Any


class Workers:
    """Processes with a flight each, made by ``factory`` ("module:name") from the arguments of its
    share."""

    def __init__(
        self, factory: str, shares: list[tuple[Any, ...]], environment: dict[str, str] | None = None
    ):
        variables = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
            **(environment or {}),
        }
        command = [sys.executable, "-c", "from oracles.engine_race.worker import main; main()"]
        # heyoka keeps compiled code in the user's cache: here none must be found again
        self.folder = tempfile.TemporaryDirectory()
        self.processes = []
        for number in range(len(shares)):
            own = {**variables, "XDG_CACHE_HOME": os.path.join(self.folder.name, str(number))}
            self.processes.append(
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=own)
            )
        try:
            for process, share in zip(self.processes, shares, strict=True):
                _send(process.stdin, (factory, share))
            self.compile_s = max(self._answers())
        except BaseException:
            self.close()
            raise

    def _answers(self) -> list[Any]:
        answers = [_receive(p.stdout) for p in self.processes]
        for answer in answers:
            if isinstance(answer, Exception):
                raise answer
        return answers

    def fly(self) -> float:
        """Run all shares at once; returns the seconds until the last is done."""
        began = time.perf_counter()
        for process in self.processes:
            _send(process.stdin, "fly")
        self._answers()
        return time.perf_counter() - began

    def outcomes(self) -> list[Any]:
        """Outcomes of the last flight, by share."""
        for process in self.processes:
            _send(process.stdin, "outcomes")
        return self._answers()

    def close(self) -> None:
        """Close the pipes, wait until the processes have ended and remove their cache folder."""
        for process in self.processes:
            for pipe in (process.stdin, process.stdout):
                if pipe:
                    pipe.close()
            process.wait()
        self.folder.cleanup()

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _send(pipe: Any, message: Any) -> None:
    pickle.dump(message, pipe)
    pipe.flush()


def _receive(pipe: Any) -> Any:
    try:
        return pickle.load(pipe)
    except EOFError:
        raise RuntimeError("a process of the bench ended early") from None


def main() -> None:
    """Make the flight, then run and answer commands until the input ends."""
    pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever an engine prints must not mix with the answers
    flight: Any = None
    flown: Any = None
    while True:
        try:
            message = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            if isinstance(message, tuple):
                module, name = message[0].split(":")
                flight = getattr(importlib.import_module(module), name)(*message[1])
                answer: Any = flight.compile_s
            elif message == "fly":
                flown, answer = flight.fly(), None
            else:
                answer = flight.outcomes(flown)
        except Exception as problem:
            answer = problem
        _send(pipe, answer)
