"""Pool of worker processes that end with this process."""

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, resource_tracker

from sepmc import gc_tuning


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Context that blocks SIGINT (Ctrl-C): processes started in it never get it, and this process
    gets it at the end of the context."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # as it starts it lets signals through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """Initialise a worker process: ignore SIGINT (Ctrl-C), collect garbage rarely."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc_tuning.reduce_collections()


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Context of a pool of ``count`` worker processes, all started at once; if ``count`` is 0, of
    one process, started at its first task.

    The workers ignore Ctrl-C. They are killed if an exception, also that of Ctrl-C in this process,
    leaves the context.
    """
    others = set(active_children())
    with ProcessPoolExecutor(
        max(count, 1),
        mp_context=get_context("spawn"),  # not forked: threads of compiled code may run
        initializer=_begin,
    ) as pool:
        try:
            with _uninterrupted():
                for _ in range(count):
                    pool.submit(int)  # each starts one, as none is idle yet
            yield pool
        except BaseException:
            for process in set(active_children()) - others:
                process.kill()
            pool.shutdown(cancel_futures=True)
            raise
