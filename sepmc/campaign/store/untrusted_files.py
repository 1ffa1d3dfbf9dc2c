"""What a run folder may hold: files and folders of its own, of a size that can be read. What comes
from a stranger can be a link, which would be followed, or a pipe, which would be waited for."""

import os
import re
from pathlib import Path

from sepmc.paths import is_local
from sepmc.scene import limits

# folders that a run has in its own
KINDS = ("cases", "histories", "kept", "counted")
# what a file of a run may be called, in the list of its files
_NAME = re.compile(rf"(({'|'.join(KINDS)})/)?[A-Za-z0-9][A-Za-z0-9_.+-]{{0,250}}")


class StoreError(Exception):
    """A run folder that cannot be used as asked; its argument is the sentence to show."""


def check(folder: Path) -> None:
    """Raise StoreError if there is anything in a run folder, or in a folder of it, but files and
    folders."""
    if not is_local(folder):  # objects are no links
        return
    for place in (folder, *(folder / kind for kind in KINDS)):
        try:
            with os.scandir(place) as entries:
                for one in entries:
                    _check_one(one, place == folder)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, ValueError) as error:
            said = getattr(error, "strerror", None) or error
            raise StoreError(f"{place}: cannot be read: {said}") from None


def _check_one(one: "os.DirEntry[str]", is_written: bool) -> None:
    """``is_written``: it may be written as it stands, as figures are; parts are new files."""
    if one.is_symlink():
        raise StoreError(
            f"{one.path}: is a link; a run folder holds its own files only: put the file there"
        )
    if not one.is_file(follow_symlinks=False) and not one.is_dir(follow_symlinks=False):
        raise StoreError(f"{one.path}: is neither a file nor a folder; take it out of the run")
    if is_written and one.is_file() and one.stat().st_nlink > 1:
        said = "has another name elsewhere (a hard link), where it would be written too: copy it"
        raise StoreError(f"{one.path}: {said}")


def is_name(file: str) -> bool:
    """Whether a file of a run may be called so: it lies in the folder, or in one of its own."""
    return _NAME.fullmatch(file) is not None


def content(path: Path, most: int) -> bytes:
    """What a file of a run holds. Raises StoreError if it cannot be read or is larger."""
    try:
        return limits.content(path, most)
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise StoreError(f"{path}: {error}") from None
