"""File locks between processes, not inherited by forked processes."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

_open: set[int] = set()  # descriptors of files that this process has locked


def _close_inherited() -> None:
    """Close inherited descriptors in a forked process: a shared lock would last until both
    processes end, and the child would wait for itself."""
    for descriptor in _open:
        os.close(descriptor)
    _open.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_inherited)


@contextlib.contextmanager
def locked(path: Path, flags: int, wait: bool = True) -> Iterator[None]:
    """Context in which no other process has the lock of a file or folder.

    Without effect on systems and network folders that cannot lock.

    Parameters
    ----------
    path : Path
    flags : int
        Flags of `os.open`, such as ``os.O_WRONLY | os.O_CREAT``.
    wait : bool
        Wait until another process releases the lock.

    Raises
    ------
    BlockingIOError
        If another process has the lock and ``wait`` is False.
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
