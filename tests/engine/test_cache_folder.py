"""Compiled code is kept where its user only can write, and read where nobody else can."""

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
def apart(tmp_path, monkeypatch):
    """A cache and a temporary folder of this test's own."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv(folders.SETTING, str(tmp_path / "cache"))


def mode(folder):
    return stat.S_IMODE(folder.stat().st_mode)


def test_the_cache_is_its_users_alone(tmp_path):
    before = os.umask(0)
    try:
        found = folders.cache_folder("name")
    finally:
        os.umask(before)
    assert found == tmp_path / "cache" / "kernels" / "name"
    assert mode(found) == mode(found.parent) == 0o700
    found.chmod(0o777)  # an older one
    assert folders.cache_folder("name") == found
    assert mode(found) == 0o700


def test_what_may_be_read_only_is_read(tmp_path, monkeypatch):
    full = folders.cache_folder("name")
    (full / "piece.code").write_bytes(b"code")
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    found = folders.cache_folder("name")
    assert found == tmp_path / "temporary" / f"sepmc-kernels-{os.getuid()}" / "kernels" / "name"
    assert (found / "piece.code").read_bytes() == b"code"
    cache_files.put(found / "piece.code", b"new")
    assert folders.cache_folder("name") == found
    assert (found / "piece.code").read_bytes() == b"new"
    assert (full / "piece.code").read_bytes() == b"code"


def test_what_others_can_write_is_not_read(monkeypatch):
    full = folders.cache_folder("name")
    (full / "piece.code").write_bytes(b"code")
    monkeypatch.setattr(folders, "_user", lambda: os.getuid() + 1)  # another's
    full.parent.chmod(0o777)
    found = folders.cache_folder("name")
    assert found != full
    assert not list(found.iterdir())


@pytest.mark.parametrize("taken", ["open", "link", "file"])
def test_a_temporary_folder_that_others_made_is_left_alone(tmp_path, monkeypatch, taken):
    place = tmp_path / "temporary" / f"sepmc-kernels-{os.getuid()}"
    if taken == "open":
        place.mkdir()
        place.chmod(0o777)
    elif taken == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        place.symlink_to(tmp_path / "elsewhere")
    else:
        place.write_text("")
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    found = folders.cache_folder("name")
    assert found.is_relative_to(tmp_path / "temporary")
    assert not found.is_relative_to(place)
    assert mode(found.parent.parent) == 0o700


def test_who_cannot_make_a_cache_flies_all_the_same(tmp_path):
    (tmp_path / "taken").write_text("")  # no folder can be made there
    program = "from sepmc.jit import CACHE_FOLDER as f; print(f); (f / 'x').write_text('')"
    environment = {folders.SETTING: str(tmp_path / "taken"), "TMPDIR": str(tmp_path / "temporary")}
    told = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.startswith(str(tmp_path / "temporary"))
