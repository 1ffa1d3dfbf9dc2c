"""State shared with the host process: a lock for loading kernels, and what a forked process must
reset.

`os.register_at_fork` serves both; systems without fork do not have it.
"""

import os
import threading
from collections.abc import Callable

# Kernels are written and loaded by one Python thread at a time: `sepmc.engine.interpreted` swaps
# modules of formulas, and a module imported by another thread meanwhile would get the wrong ones.
# A fork waits for this lock, so that no child starts in the middle of a swap.
loading = threading.RLock()


def at_fork(in_child: Callable[[], None]) -> None:
    """Register a function that a process forked from this one calls before its own code
    continues, after functions registered before; without effect on systems without fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=in_child)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=loading.acquire, after_in_parent=loading.release, after_in_child=loading.release
    )
