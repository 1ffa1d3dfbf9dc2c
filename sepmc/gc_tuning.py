"""Garbage collection settings of processes that end soon."""

import atexit
import gc


def reduce_collections() -> None:
    """Make this process collect garbage rarely, and not at exit. Imports leave 230,000 objects;
    collecting them takes a quarter of the time of a short command."""
    gc.set_threshold(300_000)
    atexit.register(gc.freeze)
