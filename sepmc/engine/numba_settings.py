"""Settings of Numba in the environment, checked before it is imported."""

import os
import sys

from sepmc.scene.messages import InputError

_THREADS = "NUMBA_NUM_THREADS"


def check() -> None:
    """Raise InputError if Numba cannot be imported as it is set; nothing, if it already is."""
    given = os.environ.get(_THREADS, "")
    if not given or "numba" in sys.modules:
        return
    try:
        threads = int(given)
    except ValueError:
        threads = 0
    if threads < 1:
        raise InputError(f"{_THREADS} = {given}: must be a whole number >= 1")
