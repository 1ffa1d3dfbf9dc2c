"""The files of a run folder with their checksums, a line each, added as a file is written: whatever
interrupts a run, what it holds whole is known.

A line has a checksum of its own at its end. Of several lines of a file the last counts; a line that
was cut short or changed says nothing, and its file then counts as not there.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from uuid import uuid4

import msgspec

from sepmc.places import is_local

LEDGER = "checksums.jsonl"
_OF_A_LINE = 16  # characters


class Entry(msgspec.Struct, frozen=True):
    """A file of a run folder: its path there, its size, and of a part its first case and how many
    there are."""

    file: str
    bytes: int
    sha256: str
    first: int = 0
    cases: int = 0

    @property
    def line(self) -> str:
        """How it stands in the ledger."""
        said = msgspec.json.encode(self).decode()
        return f"{said} {checksum(said.encode())[:_OF_A_LINE]}\n"

    @property
    def numbers(self) -> str:
        """Which cases it has, in words."""
        return f"cases {self.first} to {self.first + self.cases - 1}"


def checksum(content: bytes) -> str:
    """The checksum of a content."""
    return hashlib.sha256(content).hexdigest()


def put(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old or the new content, never a part; of several
    processes that write it at once, one's."""
    if not is_local(path):  # object storage does so by itself
        path.write_bytes(content)
        return
    temporary = path.with_name(f"{path.name}.{uuid4().hex[:8]}.tmp")
    temporary.write_bytes(content)
    os.replace(temporary, path)


def entry(file: str, content: bytes, first: int = 0, cases: int = 0) -> Entry:
    """The entry of a file with this content."""
    return Entry(file, len(content), checksum(content), first, cases)


def add(folder: Path, *entries: Entry) -> None:
    """Add files to the ledger of a folder."""
    lines = "".join(one.line for one in entries).encode()
    if not is_local(folder):  # nothing can be added to an object
        put(folder / LEDGER, _content(folder) + lines)
        return
    with open(folder / LEDGER, "ab") as ledger:
        ledger.write(lines)


def rewrite(folder: Path, entries: Iterable[Entry]) -> None:
    """Put these files into the ledger of a folder, and no others."""
    put(folder / LEDGER, "".join(one.line for one in entries).encode())


def read(folder: Path) -> Mapping[str, Entry]:
    """The files in the ledger of a folder, by their path there."""
    if not is_local(folder):  # whose clock tells seconds only
        return _entries(_content(folder))
    try:
        state = (folder / LEDGER).stat()
    except OSError:
        return {}
    return _read(folder / LEDGER, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> Mapping[str, Entry]:
    return _entries(path.read_bytes())


def _content(folder: Path) -> bytes:
    try:
        return (folder / LEDGER).read_bytes()
    except OSError:
        return b""


def _entries(content: bytes) -> Mapping[str, Entry]:
    found = {}
    for line in content.splitlines():
        if _is_whole(line):
            one = msgspec.json.decode(line.rpartition(b" ")[0], type=Entry)
            found[one.file] = one
    return found


def _is_whole(line: bytes) -> bool:
    said, _, end = line.rpartition(b" ")
    return checksum(said)[:_OF_A_LINE].encode() == end


def lost_lines(folder: Path) -> int:
    """How many lines of the ledger of a folder say nothing, as they are not as they were
    written."""
    return sum(not _is_whole(line) for line in _content(folder).splitlines())


def digest(entries: Iterable[Entry]) -> str:
    """A checksum of files, in whatever order."""
    return checksum("".join(sorted(one.line for one in entries)).encode())


def whole(folder: Path, one: Entry) -> bytes:
    """The content of a file, as it was written. Raises ValueError, with what is wrong, if it is
    not."""
    try:
        content = (folder / one.file).read_bytes()
    except FileNotFoundError:
        raise ValueError("is gone") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from None
    if len(content) != one.bytes:
        raise ValueError(f"was changed: it has {len(content)} bytes, and had {one.bytes}")
    if checksum(content) != one.sha256:
        raise ValueError("was changed: its checksum is another")
    return content
