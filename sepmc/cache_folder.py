"""Choice of the cache folder of compiled code. Since its files are executed, only the owner of the
folder may be able to write it: the user, or whoever owns the folder that SEPMC_CACHE_DIR names."""

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
    """Return the folder ``kernels/NAME`` in the user's cache, which is created if missing. The
    environment variable ``SEPMC_CACHE_DIR``, if set, is the path of that cache.

    If that folder cannot be written, a folder of the same name in a private temporary folder is
    returned instead, with symbolic links to the files of the first one. A cache that users other
    than its owner can write is neither read nor written.

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
        If neither folder can be written; it has the path of the user's cache.
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
            f"need one of them. The environment variable {SETTING} moves the first"
        )
        raise OSError(error.errno, reason, str(base)) from None
    if _is_safe(folder):
        for path in folder.iterdir():
            link = fallback / path.name
            if path.is_file() and not os.path.lexists(link):
                link.symlink_to(path.resolve())
    return fallback


def _create(folder: Path) -> bool:
    """Create a folder and its parents if missing. If this user owns the folder and others may write
    it, its mode becomes 0700, so that they can no longer read it either; the same for its parent.
    Returns True if this process can write the folder and other users cannot; False, without an
    exception, if the folder cannot be created."""
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
    """Return True if a folder exists and no user but the owner can write it or replace it, which
    takes write permission on its parent; a sticky bit of the parent does not help. (On Windows only
    the existence of the folder is checked.)"""
    try:
        modes = [part.stat().st_mode for part in (folder, folder.parent)]
    except OSError:
        return False
    return all(stat.S_ISDIR(mode) and (os.name == "nt" or not mode & _WRITABLE) for mode in modes)


def _temporary() -> Path:
    """Return a temporary folder that only this user can open.

    It has a fixed name and stays for later commands. If another user owns or can open the folder of
    that name, a new one is created, which is deleted at exit.
    """
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
    """Return the user id of this process; 0 on systems without user ids."""
    return os.getuid() if hasattr(os, "getuid") else 0
