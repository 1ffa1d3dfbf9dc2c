"""Threads that compiled code flies on: how many, and where they cannot be used.

A process made by fork from one in which Numba's threads run has none of them. GNU OpenMP kills it
as soon as it enters a parallel loop, so it flies on one thread, outside that loop. Numba's layer
``workqueue`` ends the process if two Python threads enter such a loop at once, so there they do
so in turn; the layers ``omp`` and ``tbb`` take several.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

from numba import get_num_threads, set_num_threads
from numba.np.ufunc import parallel

from sepmc.engine.host_process import at_fork
from sepmc.jit import config
from sepmc.scene.messages import InputError

_LAYERS = ("default", "omp", "tbb", "workqueue", "safe", "forksafe", "threadsafe")
_ONE_AT_A_TIME = "workqueue"
_turn = threading.Lock()
_forked = _noted = False


def _begin_again() -> None:
    """In a process made by fork: another thread may have held the lock, and Numba's are gone."""
    global _turn, _forked, _noted  # noqa: PLW0603
    _turn, _noted = threading.Lock(), False
    _forked = _forked or parallel._is_initialized


at_fork(_begin_again)


def _threads_are_gone() -> bool:
    """Whether Numba's threads were started before this module was there, and are not threads of
    this process: it was made by fork then."""
    if not (parallel._is_initialized and sys.platform == "linux"):
        return False
    count = len(os.listdir("/proc/self/task"))
    return count - threading.active_count() < parallel.NUM_THREADS - 1


_forked = _threads_are_gone()


def fork_notes(asked: int | None) -> list[str]:
    """A sentence, once in a process: it was made by fork, so it flies on one thread though more
    were ``asked`` for, all if None."""
    global _noted  # noqa: PLW0603
    if _noted or not _forked or (asked or max_threads()) == 1:
        return []
    _noted = True
    return [
        "this process was made by fork, without the threads of compiled code, so it flies on one "
        "thread; a process that is started by spawn or forkserver has them all"
    ]


def is_forked() -> bool:
    """Whether this process was made by fork from one whose threads ran: it has one thread."""
    return _forked


def max_threads() -> int:
    """Largest number of threads that may be asked for."""
    return int(config.NUMBA_NUM_THREADS)


def in_use() -> int:
    """Number of threads that compiled code flies on, which are started if they are not yet.

    Raises
    ------
    InputError
        If Numba knows no such layer of threads as is set, or it is not installed.
    """
    if _forked:
        return 1
    try:
        return int(get_num_threads())
    except ValueError as error:
        raise _fault(error) from None


def _fault(error: ValueError) -> InputError:
    """What is wrong with the settings of Numba's layer of threads."""
    layer = str(config.THREADING_LAYER)
    if "PRIORITY" in str(error):
        order = " ".join(config.THREADING_LAYER_PRIORITY)
        return InputError(
            f"NUMBA_THREADING_LAYER_PRIORITY = {order}: must name tbb, omp and workqueue, each once"
        )
    if layer.lower() in _LAYERS:
        return InputError(
            f"NUMBA_THREADING_LAYER = {layer}: is not installed; must be default, workqueue or "
            "another one that is"
        )
    return InputError(f"NUMBA_THREADING_LAYER = {layer}: must be one of {', '.join(_LAYERS)}")


def use_threads(count: int | None) -> int:
    """Fly on ``count`` threads from now on in this Python thread, on all if None. Returns the
    number in use."""
    if not _forked:
        in_use()
        set_num_threads(count or max_threads())
    return in_use()


@contextlib.contextmanager
def using_threads(count: int | None) -> Iterator[int]:
    """Fly on ``count`` threads meanwhile, on all if None; the host's own number is put back."""
    before = in_use()
    try:
        yield use_threads(count)
    finally:
        if not _forked:
            set_num_threads(before)


@contextlib.contextmanager
def in_turn() -> Iterator[None]:
    """Wait for other Python threads that are in a parallel loop, where only one may be."""
    if parallel._threading_layer == _ONE_AT_A_TIME:
        with _turn:
            yield
    else:
        yield
