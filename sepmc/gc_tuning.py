"""Looking for garbage, put off in processes that end soon."""

import atexit
import gc


def reduce_collections() -> None:
    """Look for garbage rarely, and not among what is left at the end: imports leave 160,000 objects
    that stay, and looking among them took a quarter of a short command."""
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
