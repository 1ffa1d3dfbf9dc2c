"""Processes that compile modules of the cache folder in parallel.

They stay alive between kernels: much of the compile time of a small unit is spent on the formulas
it calls, once in every process.
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

from sepmc.code_cache import compile_command
from sepmc.engine.host_process import at_fork

Progress = Callable[[int, int], None]  # done, total
IDLE_S = 60.0  # idle time after which the processes end
_SERVE = "from sepmc.engine.kernel_cache import serve; serve()"
_compilers: list["Compiler"] = []
_compiling = threading.Lock()
_end: threading.Timer | None = None


class Compiler:
    """Process that compiles modules of the cache folder, one after the other."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            **compile_command(_SERVE),
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def compile_from(self, names: deque[str], on_done: Callable[[], None]) -> bool:
        """Compile modules, named in a queue that several threads share, until it is empty; call
        ``on_done`` after each. Returns True if the process survived."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        while True:
            try:
                print(names.popleft(), file=self.process.stdin, flush=True)
            except IndexError:
                return True
            except OSError:  # the process has ended
                return False
            if not self.process.stdout.readline():
                return False
            on_done()

    def detach(self) -> None:
        """Close this process's copies of the pipes without writing what they buffer, and forget the
        compiling process: it belongs to the parent that this process was forked from."""
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, pipe.fileno())
            os.close(nowhere)
            pipe.close()
        self.process.returncode = 0  # not a child of this process

    def end(self) -> None:
        """Kill the process and close its pipes."""
        self.process.kill()
        with contextlib.suppress(OSError):
            self.process.communicate()  # closes its pipes


def _forget_parent() -> None:
    """After a fork, drop the compilers of the parent process, the timer that ends them, and a lock
    that a thread of the parent may have taken."""
    global _compiling, _end
    _compiling, _end = threading.Lock(), None
    while _compilers:
        _compilers.pop().detach()


at_fork(_forget_parent)


def compile_all(names: Sequence[str], progress: Progress = lambda done, total: None) -> bool:
    """Compile modules in one process for each core.

    Parameters
    ----------
    names : sequence of str
        Names of the modules.
    progress : callable (int, int)
        Called after each module with the number of compiled modules and their total.

    Returns
    -------
    bool
        True if all were compiled.
    """
    global _end  # noqa: PLW0603
    if not names:
        return True
    counter = itertools.count(1)
    with _compiling:
        if _end is not None:
            _end.cancel()
        try:
            survived = _compile_queue(deque(names), lambda: progress(next(counter), len(names)))
        finally:
            _end = threading.Timer(IDLE_S, _end_idle)
            _end.daemon = True
            _end.start()
        if not survived:
            end_all()
    return survived


def _compile_queue(queue: deque[str], on_done: Callable[[], None]) -> bool:
    """Compile the modules of a queue in one process for each core, and call ``on_done`` after each
    module. Returns True if all processes survived."""
    compilers = _ready(min(os.cpu_count() or 1, len(queue)))
    with ThreadPoolExecutor(len(compilers)) as threads:
        try:
            return all(
                list(threads.map(lambda compiler: compiler.compile_from(queue, on_done), compilers))
            )
        except BaseException:  # interrupted: the threads end when the processes do
            queue.clear()
            for compiler in compilers:
                compiler.process.kill()
            raise


def running() -> list[Compiler]:
    """Return the compiling processes that this process has started and not ended."""
    return list(_compilers)


@atexit.register
def end_all() -> None:
    """End all compiling processes of this process."""
    while _compilers:
        _compilers.pop().end()


def _ready(count: int) -> list[Compiler]:
    """Return ``count`` compiling processes that are alive: those that are running, then new
    ones."""
    for compiler in running():
        if compiler.process.poll() is not None:
            compiler.end()
            _compilers.remove(compiler)
    while len(_compilers) < count:
        _compilers.append(Compiler())
    return _compilers[:count]


def _end_idle() -> None:
    """End all compiling processes, after waiting for a compilation in progress."""
    with _compiling:
        end_all()
