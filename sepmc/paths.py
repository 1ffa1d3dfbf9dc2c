"""Folders and files by name: of this machine, or of object storage (``s3://bucket/run``) by fsspec,
through a path that has the methods of `pathlib.Path`."""

import os
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any, cast

EXTRA = "pip install '.[{}]' in the folder that sepmc was installed from"


# packages whose errors say that object storage cannot be reached
_CLIENTS = ("botocore", "aiobotocore", "aiohttp", "gcsfs", "google", "adlfs", "azure")


class PathError(ValueError):
    """A name of a place that this installation cannot reach; its argument is the sentence."""


def as_path(name: str | Path) -> Path:
    """The path of a name. Raises PathError if it is none, or if what reaches such a place is not
    installed, or does not reach it."""
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

        # other processes write there: no list of files is good for long
        path = UPath(name, use_listings_cache=False)
        system = path.fs
    except (ImportError, ValueError) as error:
        raise PathError(
            f"{name}: cannot be reached: {error}; object storage comes with the extra cluster "
            f"({EXTRA.format('cluster')}), s3:// by itself, others with their clients"
        ) from None
    # what asks whether a file is there takes a network that is down for "no"
    try:
        system.info(path.path)
    except OSError:  # nothing of this name yet, or the bucket may not be listed
        pass
    except Exception as error:
        if not is_storage_error(error):
            raise
        raise PathError(f"{name}: cannot be reached: {error}") from None
    return cast(Path, path)


def is_storage_error(error: Exception) -> bool:
    """Whether an error is one of a client of object storage."""
    modules = (kind.__module__.partition(".")[0] for kind in type(error).__mro__)
    return any(module in _CLIENTS for module in modules)


def is_local(path: Path) -> bool:
    """Whether a path is one of this machine."""
    return isinstance(path, PurePath)


def readable(path: Path) -> Any:
    """What readers of files take: the path, or the content of a file of object storage."""
    if is_local(path):
        return path
    return BytesIO(path.read_bytes())
