"""Check of Numba's environment variables before it is imported."""

import os
import sys

from sepmc.scene.messages import InputError

_THREADS = "NUMBA_NUM_THREADS"


def check() -> None:
    """Raise InputError if Numba cannot be imported with its setting; do nothing if it is
    imported."""
    value = os.environ.get(_THREADS, "")
    if not value or "numba" in sys.modules:
        return
    try:
        threads = int(value)
    except ValueError:
        threads = 0
    if threads < 1:
        raise InputError(f"{_THREADS} = {value}: must be a whole number >= 1")
