"""Processes that compile modules (compile units of kernels) in the cache folder, in parallel.

They stay alive between kernels, since each process has to import LLVM and the formulas that units
call, and to parse the sources of these formulas, only once.
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
    """Child process that compiles modules of the cache folder, one after the other
    (`sepmc.engine.kernel_cache.serve`). Creating the object starts the process."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            **compile_command(_SERVE),
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def compile_from(self, names: deque[str], on_done: Callable[[], None]) -> bool:
        """Compile modules in the process until a queue of their names, which several threads share,
        is empty; call ``on_done`` after each. Returns False if the process ends before, as it does
        on an error; the module it was compiling is then not put back into the queue."""
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
        """Give up, in a forked process, the compiling process, which belongs to the parent: close
        this process's copies of its pipes, without writing what they buffer, and mark it as
        ended."""
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, pipe.fileno())
            os.close(nowhere)
            pipe.close()
        self.process.returncode = 0  # not a child of this process

    def end(self) -> None:
        """Kill the compiling process and close its pipes."""
        self.process.kill()
        with contextlib.suppress(OSError):
            self.process.communicate()  # closes its pipes


def _forget_parent() -> None:
    """Forget, in a process that was just forked, the compiling processes of the parent and the
    timer that ends them, and replace a lock that a thread of the parent may have taken."""
    global _compiling, _end
    _compiling, _end = threading.Lock(), None
    while _compilers:
        _compilers.pop().detach()


at_fork(_forget_parent)


def compile_all(names: Sequence[str], progress: Progress = lambda done, total: None) -> bool:
    """Compile modules of the cache folder in parallel, in one process for each core; the processes
    stay for later calls and end after `IDLE_S` without one.

    Parameters
    ----------
    names : sequence of str
        Names of the modules, without suffix.
    progress : callable (int, int)
        Called after each module with the number of compiled modules and their total.

    Returns
    -------
    bool
        True if all were compiled; False if a process ended before, as on an error.
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
    """Compile the modules named in a queue, in one process for each core, and call ``on_done``
    (from several threads) after each module. Returns False if a process ended before the queue was
    empty."""
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
    """Return a list of the compiling processes that this process has started and not ended."""
    return list(_compilers)


@atexit.register
def end_all() -> None:
    """Kill all compiling processes that this process has started."""
    while _compilers:
        _compilers.pop().end()


def _ready(count: int) -> list[Compiler]:
    """Return ``count`` compiling processes that are alive: existing ones first, then new ones,
    which are started."""
    for compiler in running():
        if compiler.process.poll() is not None:
            compiler.end()
            _compilers.remove(compiler)
    while len(_compilers) < count:
        _compilers.append(Compiler())
    return _compilers[:count]


def _end_idle() -> None:
    """Wait for a compilation in progress, then end all compiling processes."""
    with _compiling:
        end_all()
