"""Paths of local files and of object storage (``s3://bucket/run``, by fsspec). All of them have the
methods of `pathlib.Path`."""

import os
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any, cast

EXTRA = "pip install '.[{}]' in the folder that sepmc was installed from"


# packages of the clients of object storage
_CLIENTS = ("botocore", "aiobotocore", "aiohttp", "gcsfs", "google", "adlfs", "azure")


class PathError(ValueError):
    """A value is no path, or its storage cannot be reached; the argument is the message to show."""


def as_path(name: str | Path) -> Path:
    """Convert a local path or an address in object storage to a path object.

    The storage of an address is asked for the object, which need not exist.

    Parameters
    ----------
    name : str or path
        A local path or the address of an object.

    Returns
    -------
    Path
        A local path, or a `upath.UPath` of object storage.

    Raises
    ------
    PathError
        If it is no path, or if its storage is not installed or cannot be reached.
    """
    if hasattr(name, "is_dir"):  # a path, of object storage too
        return cast(Path, name)
    if isinstance(name, os.PathLike):
        name = os.fspath(name)
    if not isinstance(name, str):
        raise PathError(f"path = {name!r:.60}: must be text or a path")
    if "://" not in name:
        return Path(name)
    try:
        from upath import UPath  # noqa: PLC0415  (an extra)

        # other processes write there, so lists of files must not be cached
        path = UPath(name, use_listings_cache=False)
        system = path.fs
    except (ImportError, ValueError) as error:
        raise PathError(
            f"{name}: cannot be reached: {error}; object storage needs the extra cluster "
            f"({EXTRA.format('cluster')}), and storage other than s3:// its own client package "
            "besides"
        ) from None
    # `exists` would return False if the network is down
    try:
        system.info(path.path)
    except OSError:  # no such object, or the bucket does not allow listing
        pass
    except Exception as error:
        if not is_storage_error(error):
            raise
        raise PathError(f"{name}: cannot be reached: {error}") from None
    return cast(Path, path)


def is_storage_error(error: Exception) -> bool:
    """Return True if an error, or a base class of it, is defined by a client library of object
    storage (`_CLIENTS`)."""
    modules = (base.__module__.partition(".")[0] for base in type(error).__mro__)
    return any(module in _CLIENTS for module in modules)


def is_local(path: Path) -> bool:
    """Return True for a path in the file system of this machine, False for object storage."""
    return isinstance(path, PurePath)


def readable(path: Path) -> Any:
    """Return a file as readers (pandas, pyarrow) accept it: a local path unchanged, or the content
    of an object in object storage as a `BytesIO`."""
    if is_local(path):
        return path
    return BytesIO(path.read_bytes())
