"""Locks of files between processes, which a process made by fork does not take over."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

_open: set[int] = set()  # descriptors of files that this process has locked


def _let_go() -> None:
    """A process made by fork shares the locks of the one it is made of: these would last until both
    have ended, and it would wait for itself."""
    for descriptor in _open:
        os.close(descriptor)
    _open.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


@contextlib.contextmanager
def locked(path: Path, flags: int, wait: bool = True) -> Iterator[None]:
    """Hold the lock of a file or folder, opened by ``flags``, where these can be locked.

    Raises
    ------
    BlockingIOError
        If another process holds it and it is not to be waited for.
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
    except OSError:  # some shared folders cannot be
        pass
    _open.add(descriptor)
    try:
        yield
    finally:
        if descriptor in _open:  # else closed, as this process was made by fork meanwhile
            _open.discard(descriptor)
            with contextlib.suppress(OSError):
                fcntl.flock(descriptor, fcntl.LOCK_UN)  # of processes made by fork, too
            os.close(descriptor)
