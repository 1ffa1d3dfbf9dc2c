"""What this process shares with its host: a lock for what Python threads must not do at once, and
what a process made by fork must not take over.

`os.register_at_fork` tells both; systems without fork have no such function.
"""

import os
import threading
from collections.abc import Callable

# Kernels are written and loaded by one Python thread at a time: modules of formulas are exchanged
# meanwhile (`sepmc.engine.interpreted`), and a module imported by another thread would hold the
# wrong ones. A fork waits for it, so that no child begins with half of an exchange.
loading = threading.RLock()


def at_fork(in_child: Callable[[], None]) -> None:
    """Have ``in_child`` called first in every process that is made of this one by fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=in_child)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=loading.acquire, after_in_parent=loading.release, after_in_child=loading.release
    )
