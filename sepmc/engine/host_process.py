"""Safety in a host process with threads and forks: a lock for loading kernels, and `at_fork`, by
which other modules register functions that reset their state in a forked process.

Both use `os.register_at_fork`, which systems without fork do not have.
"""

import os
import threading
from collections.abc import Callable

# Kernels are written and loaded by one Python thread at a time: `sepmc.engine.interpreted` swaps
# modules of formulas, and a module imported by another thread meanwhile would get the wrong ones.
# A fork waits for this lock, so that no child starts in the middle of a swap.
loading = threading.RLock()


def at_fork(in_child: Callable[[], None]) -> None:
    """Register a function that every process forked from this one calls before anything else, after
    the functions registered before. It has no effect on systems without fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=in_child)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=loading.acquire, after_in_parent=loading.release, after_in_child=loading.release
    )
