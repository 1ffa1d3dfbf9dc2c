"""Folders and files by name: of this machine, or of object storage (``s3://bucket/run``) by fsspec,
through a path that has the methods of `pathlib.Path`."""

from io import BytesIO
from pathlib import Path, PurePath
from typing import Any, cast


class PlaceError(ValueError):
    """A name of a place that this installation cannot reach; its argument is the sentence."""


def place(name: str | Path) -> Path:
    """The path of a name. Raises PlaceError if what reaches such a place is not installed."""
    if not isinstance(name, str):
        return name
    if "://" not in name:
        return Path(name)
    try:
        from upath import UPath  # noqa: PLC0415  (an extra)

        # other processes write there: no list of files is good for long
        return cast(Path, UPath(name, use_listings_cache=False))
    except (ImportError, ValueError) as error:
        raise PlaceError(
            f"{name}: cannot be reached: {error}; object storage comes with the extra cluster: "
            "pip install 'sepmc[cluster]'"
        ) from None


def is_local(path: Path) -> bool:
    """Whether a path is one of this machine."""
    return isinstance(path, PurePath)


def source(path: Path) -> Any:
    """What readers of files take: the path, or the content of a file of object storage."""
    if is_local(path):
        return path
    return BytesIO(path.read_bytes())
