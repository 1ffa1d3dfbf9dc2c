"""Folder of compiled code, writable by its user only, since its files are executed."""

import atexit
import os
import shutil
import stat
import tempfile
from pathlib import Path

from platformdirs import user_cache_dir

SETTING = "SEPMC_CACHE_DIR"  # environment variable with the cache folder
_WRITABLE = stat.S_IWGRP | stat.S_IWOTH


def cache_folder(name: str) -> Path:
    """Folder ``kernels/NAME`` in the user's cache, created if missing.

    If it cannot be written, a folder of this name in a temporary folder replaces it, with links to
    its files. A cache that other users can write is neither read nor written.

    Parameters
    ----------
    name : str
        Name of the folder.

    Returns
    -------
    Path
        A folder that this process can write.

    Raises
    ------
    OSError
        If neither folder can be written.
    """
    base = Path(os.environ.get(SETTING) or user_cache_dir("sepmc"))
    folder = base / "kernels" / name
    if _create(folder):
        return folder
    try:
        fallback = _temporary() / "kernels" / name
        fallback.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        reason = (
            f"cannot be written, nor can a temporary folder ({error.strerror}); compiled kernels "
            f"need one of them, and {SETTING} moves the first"
        )
        raise OSError(error.errno, reason, str(base)) from None
    if _is_safe(folder):
        for path in folder.iterdir():
            link = fallback / path.name
            if path.is_file() and not os.path.lexists(link):
                link.symlink_to(path.resolve())
    return fallback


def _create(folder: Path) -> bool:
    """Create a folder and its parents if missing; take the right to write it and its parent from
    other users. Returns True if it is writable, by its user only."""
    try:
        folder.parent.parent.mkdir(parents=True, exist_ok=True)
        for part in (folder.parent, folder):
            part.mkdir(mode=0o700, exist_ok=True)
            if part.stat().st_uid == _user() and part.stat().st_mode & _WRITABLE:
                part.chmod(0o700)
    except OSError:
        return False
    return os.access(folder, os.W_OK) and _is_safe(folder)


def _is_safe(folder: Path) -> bool:
    """Return True if a folder exists that only its owner can write, and nobody else can replace."""
    try:
        modes = [part.stat().st_mode for part in (folder, folder.parent)]
    except OSError:
        return False
    return all(stat.S_ISDIR(mode) and (os.name == "nt" or not mode & _WRITABLE) for mode in modes)


def _temporary() -> Path:
    """Private temporary folder of the user: one of a fixed name, which stays for later commands,
    or, if another user owns or can open that, a new one that is deleted at exit."""
    folder = Path(tempfile.gettempdir()) / f"sepmc-kernels-{_user()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()  # the parent is shared, but protects entries of other users
        if status.st_uid == _user() and stat.S_IMODE(status.st_mode) == 0o700:
            return folder
    except OSError:
        pass
    created = Path(tempfile.mkdtemp(prefix="sepmc-kernels-"))
    atexit.register(shutil.rmtree, created, ignore_errors=True)
    return created


def _user() -> int:
    """Number of the user (uid); 0 on systems without user numbers."""
    return os.getuid() if hasattr(os, "getuid") else 0
