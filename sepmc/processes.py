"""Work shared out among processes of their own, which end with this one."""

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Processes that start meanwhile ignore interruptions from their first instant on."""
    if threading.current_thread() is not threading.main_thread():  # which alone may say so
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """So many processes to hand work to. They are killed if this one is interrupted or fails, and
    say nothing of an interruption: this one does."""
    others = set(active_children())
    with ProcessPoolExecutor(
        count,
        mp_context=get_context("spawn"),  # not forked: threads of compiled code may run
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    ) as pool:
        try:
            with _uninterrupted():
                for _ in range(count):
                    pool.submit(int)  # each starts one
            yield pool
        except BaseException:
            for process in set(active_children()) - others:
                process.kill()
            pool.shutdown(cancel_futures=True)
            raise
