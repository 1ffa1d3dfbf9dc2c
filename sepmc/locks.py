"""File locks between processes. A forked process does not inherit the locks of its parent."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

_open: set[int] = set()  # descriptors of files that this process has locked


def _close_inherited() -> None:
    """Close, in a process that was just forked, the locked files of its parent. Otherwise a lock
    would last until both processes end, and the child would wait for itself."""
    for descriptor in _open:
        os.close(descriptor)
    _open.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_inherited)


@contextlib.contextmanager
def locked(path: Path, flags: int, wait: bool = True) -> Iterator[None]:
    """Context that takes the exclusive lock of a file or folder and releases it at its end.

    It takes no lock, and does not fail, on systems and network folders without locks.

    Parameters
    ----------
    path : Path
        The file or folder to lock.
    flags : int
        Flags of `os.open` for it, such as ``os.O_WRONLY | os.O_CREAT``.
    wait : bool
        True: wait while another process has the lock. False: raise BlockingIOError then.

    Raises
    ------
    BlockingIOError
        If another process has the lock and ``wait`` is False.
    OSError
        If the file cannot be opened.
    """
    try:
        import fcntl  # noqa: PLC0415  (not on every system)
    except ImportError:
        yield
        return
    descriptor = os.open(path, flags, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:  # some network folders cannot be locked
        pass
    _open.add(descriptor)
    try:
        yield
    finally:
        if descriptor in _open:  # else closed by a fork inside the context
            _open.discard(descriptor)
            with contextlib.suppress(OSError):
                fcntl.flock(descriptor, fcntl.LOCK_UN)  # also for forked processes
            os.close(descriptor)
