"""Threads of compiled code: their number, and processes that cannot use them.

A process that is forked from one in which Numba's threads run has none of these threads. GNU OpenMP
would kill it when it enters a parallel loop, so it runs kernels on one thread, outside that loop.
Numba's threading layer ``workqueue`` ends the process if two Python threads enter a parallel loop
at once, so they take turns; the layers ``omp`` and ``tbb`` allow several.
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
    """Reset the state of this module in a process that was just forked: a thread of the parent may
    have had the lock, and Numba's threads, if they were started, do not exist here."""
    global _region_lock, _forked, _noted  # noqa: PLW0603
    _region_lock, _noted = threading.Lock(), False
    _forked = _forked or parallel._is_initialized


at_fork(_reset_after_fork)


def _threads_are_gone() -> bool:
    """Return True if this process was forked from one in which Numba's threads were running, before
    this module was imported. It counts the threads that exist; always False if not on Linux."""
    if not (parallel._is_initialized and sys.platform == "linux"):
        return False
    count = len(os.listdir("/proc/self/task"))
    return count - threading.active_count() < parallel.NUM_THREADS - 1


_forked = _threads_are_gone()


def fork_notes(threads: int | None) -> list[str]:
    """Return the note for the user that this forked process uses one thread only; a process gets it
    once.

    Parameters
    ----------
    threads : int, optional
        Requested number of threads; None: all.

    Returns
    -------
    list of str
        The note. Empty if this process has all its threads, if only one thread is requested, or if
        the note was returned before.
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
    """Return True if this process was forked from one in which Numba's threads were running, so
    that it can use one thread only."""
    return _forked


def max_threads() -> int:
    """Return the largest number of threads that can be requested: NUMBA_NUM_THREADS if that is
    set, else the number of cores that this process may use."""
    return int(config.NUMBA_NUM_THREADS)


def in_use() -> int:
    """Return the number of threads that compiled code runs on, after starting them; 1 in a forked
    process, which cannot start them.

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
    """Return an InputError that explains an error of Numba's threading layer: which environment
    variable is wrong, its value, and what it may be."""
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
    """Make compiled code that this Python thread calls run on ``count`` threads from now on; None,
    0, or more than `max_threads`, as a worker of a cluster may be given: on all. Returns the number
    in use, which is 1 in a forked process. Raises InputError, as `in_use`, if Numba's threading
    layer is unknown or not installed; ``count`` is not checked."""
    if not _forked:
        in_use()
        set_num_threads(min(count or max_threads(), max_threads()))
    return in_use()


@contextlib.contextmanager
def using_threads(count: int | None) -> Iterator[int]:
    """Context in which compiled code runs on ``count`` threads; None, or more than `max_threads`:
    on all. It yields the number in use, 1 in a forked process. The former number is restored at
    its end. ``count`` is not checked; InputError is raised if Numba's threading layer is unknown or
    not installed (`in_use`)."""
    before = in_use()
    try:
        yield use_threads(count)
    finally:
        if not _forked:
            set_num_threads(before)


@contextlib.contextmanager
def parallel_region() -> Iterator[None]:
    """Context in which to run a parallel loop. If Numba's threading layer allows one loop at a time
    only, it is entered once no other Python thread is in such a context."""
    if parallel._threading_layer == _EXCLUSIVE:
        with _region_lock:
            yield
    else:
        yield
