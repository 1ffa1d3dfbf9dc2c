"""Compiled code is stored in a folder that only its user can write, and read only from such
folders."""

import os
import stat
import subprocess
import sys
import tempfile

import pytest

from sepmc import cache_folder as folders
from sepmc.engine import cache_files

pytestmark = pytest.mark.skipif(os.name == "nt", reason="modes of folders")


@pytest.fixture(autouse=True)
def separate_folders(tmp_path, monkeypatch):
    """A cache and a temporary folder for each test."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv(folders.SETTING, str(tmp_path / "cache"))


def mode(folder):
    """Permissions of a folder."""
    return stat.S_IMODE(folder.stat().st_mode)


def test_cache_is_private(tmp_path):
    before = os.umask(0)
    try:
        folder = folders.cache_folder("name")
    finally:
        os.umask(before)
    assert folder == tmp_path / "cache" / "kernels" / "name"
    assert mode(folder) == mode(folder.parent) == 0o700
    folder.chmod(0o777)  # as older versions made it
    assert folders.cache_folder("name") == folder
    assert mode(folder) == 0o700


def test_read_only_cache_is_linked(tmp_path, monkeypatch):
    full = folders.cache_folder("name")
    (full / "piece.code").write_bytes(b"code")
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    folder = folders.cache_folder("name")
    assert folder == tmp_path / "temporary" / f"sepmc-kernels-{os.getuid()}" / "kernels" / "name"
    assert (folder / "piece.code").read_bytes() == b"code"
    cache_files.put(folder / "piece.code", b"new")
    assert folders.cache_folder("name") == folder
    assert (folder / "piece.code").read_bytes() == b"new"
    assert (full / "piece.code").read_bytes() == b"code"


def test_cache_others_can_write_is_not_read(monkeypatch):
    full = folders.cache_folder("name")
    (full / "piece.code").write_bytes(b"code")
    monkeypatch.setattr(folders, "_user", lambda: os.getuid() + 1)  # another user
    full.parent.chmod(0o777)
    folder = folders.cache_folder("name")
    assert folder != full
    assert not list(folder.iterdir())


@pytest.mark.parametrize("taken", ["open", "link", "file"])
def test_temporary_folder_of_others_is_not_used(tmp_path, monkeypatch, taken):
    expected = tmp_path / "temporary" / f"sepmc-kernels-{os.getuid()}"
    if taken == "open":
        expected.mkdir()
        expected.chmod(0o777)
    elif taken == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        expected.symlink_to(tmp_path / "elsewhere")
    else:
        expected.write_text("")
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    folder = folders.cache_folder("name")
    assert folder.is_relative_to(tmp_path / "temporary")
    assert not folder.is_relative_to(expected)
    assert mode(folder.parent.parent) == 0o700


def test_temporary_folder_replaces_an_unusable_cache(tmp_path):
    (tmp_path / "taken").write_text("")  # no folder can be made there
    program = "from sepmc.code_cache import CACHE_FOLDER as f; print(f); (f / 'x').write_text('')"
    environment = {folders.SETTING: str(tmp_path / "taken"), "TMPDIR": str(tmp_path / "temporary")}
    result = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.startswith(str(tmp_path / "temporary"))
