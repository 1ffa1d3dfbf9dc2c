"""Processes that compile modules of the cache folder into the disk cache, side by side.

They live on for a while: much of what a small piece takes is compiling the formulas that it calls,
once in every process.
"""

import atexit
import contextlib
import itertools
import os
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from sepmc.engine.host_process import at_fork
from sepmc.jit import compile_command

Progress = Callable[[int, int], None]  # done, total
IDLE_S = 60.0  # after which they end
_SERVE = "from sepmc.engine.kernel_cache import serve; serve()"
_crew: list["Compiler"] = []
_compiling = threading.Lock()
_end: threading.Timer | None = None


class Compiler:
    """A process that compiles one module after the other."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            **compile_command(_SERVE),
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def compile_from(self, left: deque[str], done: Callable[[], None]) -> bool:
        """Compile what is left until nothing is. Returns whether the process lived to do so."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        while True:
            try:
                print(left.popleft(), file=self.process.stdin, flush=True)
            except IndexError:
                return True
            except OSError:  # it has ended
                return False
            if not self.process.stdout.readline():
                return False
            done()

    def let_go(self) -> None:
        """Close the pipes, and leave the process to that which started it: this one was made of it
        by fork, and may have half a line to write."""
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, pipe.fileno())
            os.close(nowhere)
            pipe.close()
        self.process.returncode = 0  # it is no child of this one

    def end(self) -> None:
        """Kill the process and close its pipes."""
        self.process.kill()
        with contextlib.suppress(OSError):
            self.process.communicate()  # closes its pipes


def _begin_again() -> None:
    """In a process made by fork: compilers, and who waits for them, are those of the other."""
    global _compiling, _end
    _compiling, _end = threading.Lock(), None
    while _crew:
        _crew.pop().let_go()


at_fork(_begin_again)


def compile_all(names: Sequence[str], progress: Progress = lambda done, total: None) -> bool:
    """Compile modules in a process for each core, each the next one as it is through; ``progress``
    is told after each module. Returns whether all were compiled."""
    global _end  # noqa: PLW0603
    if not names:
        return True
    count = itertools.count(1)
    with _compiling:
        if _end is not None:
            _end.cancel()
        try:
            lived = _share_out(deque(names), lambda: progress(next(count), len(names)))
        finally:
            _end = threading.Timer(IDLE_S, _end_idle)
            _end.daemon = True
            _end.start()
        if not lived:
            end_all()
    return lived


def _share_out(left: deque[str], done: Callable[[], None]) -> bool:
    """Let processes compile what is left. Returns whether all of them lived to do so."""
    crew = _ready(min(os.cpu_count() or 1, len(left)))
    with ThreadPoolExecutor(len(crew)) as threads:
        try:
            return all(list(threads.map(lambda one: one.compile_from(left, done), crew)))
        except BaseException:  # interrupted: the threads end with the processes
            left.clear()
            for one in crew:
                one.process.kill()
            raise


def running() -> list[Compiler]:
    """The processes there are."""
    return list(_crew)


@atexit.register
def end_all() -> None:
    """End all processes."""
    while _crew:
        _crew.pop().end()


def _ready(count: int) -> list[Compiler]:
    """So many processes; those that run already, first."""
    for one in running():
        if one.process.poll() is not None:
            one.end()
            _crew.remove(one)
    while len(_crew) < count:
        _crew.append(Compiler())
    return _crew[:count]


def _end_idle() -> None:
    with _compiling:
        end_all()
