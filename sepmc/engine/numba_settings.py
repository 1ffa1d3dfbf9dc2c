"""Check of Numba's environment variables before it is imported."""

import os
import sys

from sepmc.scene.messages import InputError

_THREADS = "NUMBA_NUM_THREADS"


def check() -> None:
    """Raise InputError if the environment variable NUMBA_NUM_THREADS is set, but not to a whole
    number >= 1: importing Numba would fail. Do nothing if Numba is imported already."""
    value = os.environ.get(_THREADS, "")
    if not value or "numba" in sys.modules:
        return
    try:
        threads = int(value)
    except ValueError:
        threads = 0
    if threads < 1:
        raise InputError(f"{_THREADS} = {value}: must be a whole number >= 1")
