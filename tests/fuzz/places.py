"""Where files are tried."""

import contextlib
import tempfile
from pathlib import Path


@contextlib.contextmanager
def scratch():
    """A folder of its own, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        yield Path(folder)
