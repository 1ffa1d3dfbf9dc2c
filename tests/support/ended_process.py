"""Functions that do in a process what libraries do that crash, stall or use all memory."""

import os
import time

from sepmc.formats.text_table import FormatError


def end(*_: object) -> None:
    """End the process without cleaning up."""
    os._exit(1)


def wait(*_: object) -> None:
    """Do not return."""
    time.sleep(60.0)


def lack(*_: object) -> None:
    """Raise ImportError."""
    raise ImportError("no such module")


def fill(*_: object) -> tuple[dict[str, object], list[str]]:
    """Take 8 GB of memory. Raises FormatError if there is a limit."""
    try:
        return {"bytes": bytearray(8 << 30)}, []
    except MemoryError:
        raise FormatError("no memory") from None
