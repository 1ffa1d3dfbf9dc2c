"""Temporary folders of trials."""

import contextlib
import tempfile
from pathlib import Path


@contextlib.contextmanager
def scratch():
    """Context of a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        yield Path(folder)
