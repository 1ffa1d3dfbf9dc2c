"""Where compiled code is kept: a folder that nobody else can write, since what it holds is run."""

import atexit
import os
import shutil
import stat
import tempfile
from pathlib import Path

from platformdirs import user_cache_dir

SETTING = "SEPMC_CACHE_DIR"  # the environment variable that moves it
_NOT_OURS = stat.S_IWGRP | stat.S_IWOTH


def cache_folder(name: str) -> Path:
    """The folder of that name in the user's cache, ready to be written.

    What may be read there but not written is linked from a folder of the same name in the temporary
    folder. A cache that others can write is neither read nor written.

    Raises
    ------
    OSError
        If neither can be written, with a sentence.
    """
    base = Path(os.environ.get(SETTING) or user_cache_dir("sepmc"))
    folder = base / "kernels" / name
    if _made(folder):
        return folder
    try:
        own = _temporary() / "kernels" / name
        own.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        said = (
            f"cannot be written, nor can a temporary folder ({error.strerror}); compiled kernels "
            f"need one of them, and {SETTING} moves the first"
        )
        raise OSError(error.errno, said, str(base)) from None
    if _is_safe(folder):
        for path in folder.iterdir():
            link = own / path.name
            if path.is_file() and not os.path.lexists(link):
                link.symlink_to(path.resolve())
    return own


def _made(folder: Path) -> bool:
    """Make a folder, unless it is there; whether it can be written, by its user only."""
    try:
        folder.parent.parent.mkdir(parents=True, exist_ok=True)
        for each in (folder.parent, folder):
            each.mkdir(mode=0o700, exist_ok=True)
            if each.stat().st_uid == _user() and each.stat().st_mode & _NOT_OURS:
                each.chmod(0o700)
    except OSError:
        return False
    return os.access(folder, os.W_OK) and _is_safe(folder)


def _is_safe(folder: Path) -> bool:
    """Whether a folder is there that its owner only can write, and nobody else can replace."""
    try:
        modes = [each.stat().st_mode for each in (folder, folder.parent)]
    except OSError:
        return False
    return all(stat.S_ISDIR(mode) and (os.name == "nt" or not mode & _NOT_OURS) for mode in modes)


def _temporary() -> Path:
    """A folder for temporary files that is the user's own: kept for later commands if its name is
    not taken, or else gone with this process."""
    folder = Path(tempfile.gettempdir()) / f"sepmc-kernels-{_user()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()  # its parent is everybody's, but keeps its entries to their owners
        if found.st_uid == _user() and stat.S_IMODE(found.st_mode) == 0o700:
            return folder
    except OSError:
        pass
    made = Path(tempfile.mkdtemp(prefix="sepmc-kernels-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0
