"""Threads of compiled code: their number, and the processes that cannot use them.

A process forked from one in which Numba's threads run has none of them. GNU OpenMP kills it when it
enters a parallel loop, so it runs kernels on one thread, outside that loop. Numba's layer
``workqueue`` ends the process if two Python threads enter such a loop at once, so they take turns;
the layers ``omp`` and ``tbb`` allow several.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numba
from numba import get_num_threads, set_num_threads
from numba.np.ufunc import parallel

from sepmc.engine.host_process import at_fork
from sepmc.scene.messages import InputError

config: Any = numba.config  # its attributes are set at run time
_LAYERS = ("default", "omp", "tbb", "workqueue", "safe", "forksafe", "threadsafe")
_EXCLUSIVE = "workqueue"
_region_lock = threading.Lock()
_forked = _noted = False


def _reset_after_fork() -> None:
    """Reset after a fork: another thread may have had the lock, and Numba's threads do not
    exist."""
    global _region_lock, _forked, _noted  # noqa: PLW0603
    _region_lock, _noted = threading.Lock(), False
    _forked = _forked or parallel._is_initialized


at_fork(_reset_after_fork)


def _threads_are_gone() -> bool:
    """Return True if Numba's threads were started in the process this one was forked from, before
    this module was imported."""
    if not (parallel._is_initialized and sys.platform == "linux"):
        return False
    count = len(os.listdir("/proc/self/task"))
    return count - threading.active_count() < parallel.NUM_THREADS - 1


_forked = _threads_are_gone()


def fork_notes(threads: int | None) -> list[str]:
    """Note for the user that a forked process has one thread only, once in a process.

    Parameters
    ----------
    threads : int, optional
        Requested number of threads; None: all.

    Returns
    -------
    list of str
        The note; empty if this process has all its threads, if one thread is all that is requested,
        or if the note was returned before.
    """
    global _noted  # noqa: PLW0603
    if _noted or not _forked or (threads or max_threads()) == 1:
        return []
    _noted = True
    return [
        "this process was made by fork, without the threads of compiled code, so it uses one "
        "thread; a process that is started by spawn or forkserver has them all"
    ]


def is_forked() -> bool:
    """Return True if this process was forked from one with running threads: it uses one thread."""
    return _forked


def max_threads() -> int:
    """Return the largest number of threads that can be requested."""
    return int(config.NUMBA_NUM_THREADS)


def in_use() -> int:
    """Return the number of threads that compiled code runs on, after starting them.

    Raises
    ------
    InputError
        If the threading layer in Numba's settings is unknown or not installed.
    """
    if _forked:
        return 1
    try:
        return int(get_num_threads())
    except ValueError as error:
        raise _fault(error) from None


def _fault(error: ValueError) -> InputError:
    """InputError that explains an error of Numba's threading layer: which of its settings is wrong,
    and what it may be."""
    layer = str(config.THREADING_LAYER)
    if "PRIORITY" in str(error):
        order = " ".join(config.THREADING_LAYER_PRIORITY)
        return InputError(
            f"NUMBA_THREADING_LAYER_PRIORITY = {order}: must name tbb, omp and workqueue, each once"
        )
    if layer.lower() in _LAYERS:
        return InputError(
            f"NUMBA_THREADING_LAYER = {layer}: is not installed; must be default, workqueue or "
            "another installed layer"
        )
    return InputError(f"NUMBA_THREADING_LAYER = {layer}: must be one of {', '.join(_LAYERS)}")


def use_threads(count: int | None) -> int:
    """Run compiled code on ``count`` threads from now on in this Python thread, on all if None.
    Returns the number in use."""
    if not _forked:
        in_use()
        set_num_threads(count or max_threads())
    return in_use()


@contextlib.contextmanager
def using_threads(count: int | None) -> Iterator[int]:
    """Run compiled code on ``count`` threads (None: all) inside the context, then restore the
    number."""
    before = in_use()
    try:
        yield use_threads(count)
    finally:
        if not _forked:
            set_num_threads(before)


@contextlib.contextmanager
def parallel_region() -> Iterator[None]:
    """Context of a parallel loop: if the threading layer allows only one loop at a time, it waits
    until no other Python thread is in such a context."""
    if parallel._threading_layer == _EXCLUSIVE:
        with _region_lock:
            yield
    else:
        yield
