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

from sepmc.campaign.store import untrusted
from sepmc.paths import is_local
from sepmc.scene.limits import CASES, LEDGER_BYTES, LEDGER_LINES, PART_BYTES

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
    def is_possible(self) -> bool:
        """Whether there can be such a file, of so many cases, in a run folder."""
        return (
            untrusted.is_file_name(self.file)
            and 0 <= self.bytes <= PART_BYTES
            and 0 <= self.first <= self.first + self.cases <= CASES
            and self.cases <= self.bytes  # of each case many numbers, 4 to a byte at most
        )

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


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old or the new content, never a part; of several
    processes that write it at once, one's. Whatever had its name is left alone elsewhere."""
    if not is_local(path):  # object storage does so by itself
        path.write_bytes(content)
        return
    temporary = path.with_name(f"{path.name}.{uuid4().hex[:8]}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(content)
        os.replace(temporary, path)
    except FileExistsError:  # somebody else's
        raise
    except OSError:  # a full disk
        temporary.unlink(missing_ok=True)
        raise


def make_entry(file: str, content: bytes, first: int = 0, cases: int = 0) -> Entry:
    """The entry of a file with this content."""
    return Entry(file, len(content), checksum(content), first, cases)


def add(folder: Path, *entries: Entry) -> None:
    """Add files to the ledger of a folder."""
    lines = "".join(one.line for one in entries).encode()
    if not is_local(folder):  # nothing can be added to an object
        write_atomically(folder / LEDGER, _content(folder) + lines)
        return
    with open(folder / LEDGER, "ab") as ledger:
        ledger.write(lines)


def rewrite(folder: Path, entries: Iterable[Entry]) -> None:
    """Put these files into the ledger of a folder, and no others."""
    write_atomically(folder / LEDGER, "".join(one.line for one in entries).encode())


def read(folder: Path) -> Mapping[str, Entry]:
    """The files in the ledger of a folder, by their path there. Raises StoreError if there is
    anything in the folder but files and folders."""
    if not is_local(folder):  # whose clock tells seconds only
        lines = _lines(folder / LEDGER) if (folder / LEDGER).is_file() else []
        return _entries(lines)
    untrusted.check_entries(folder)
    try:
        state = (folder / LEDGER).stat()
    except OSError:
        return {}
    return _read(folder / LEDGER, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> Mapping[str, Entry]:
    return _entries(_lines(path))


def _entries(lines: Iterable[bytes]) -> Mapping[str, Entry]:
    return {one.file: one for one in map(_entry, lines) if one}


def _content(folder: Path) -> bytes:
    try:
        return (folder / LEDGER).read_bytes()
    except OSError:
        return b""


def _lines(path: Path) -> list[bytes]:
    """Lines of a ledger. Raises StoreError if there are more than a run has files."""
    written = untrusted.read_bounded(path, LEDGER_BYTES)
    if (count := written.count(b"\n") + written.count(b"\r")) > LEDGER_LINES:
        said = f"has {count:,} lines: must have at most {LEDGER_LINES:,}"
        raise untrusted.StoreError(f"{path}: {said}")
    return written.splitlines()


def _entry(line: bytes) -> Entry | None:
    """What a line tells of; None if it is not as it was written, or tells of nothing that can
    be."""
    said, _, end = line.rpartition(b" ")
    if checksum(said)[:_OF_A_LINE].encode() != end:
        return None
    try:
        found = msgspec.json.decode(said, type=Entry)
    except (msgspec.MsgspecError, ValueError):
        return None
    return found if found.is_possible else None


def count_damaged_lines(folder: Path) -> int:
    """How many lines of the ledger of a folder say nothing, as they are not as they were
    written."""
    try:
        lines = _lines(folder / LEDGER)
    except untrusted.StoreError:
        return 0
    return sum(_entry(line) is None for line in lines)


def digest(entries: Iterable[Entry]) -> str:
    """A checksum of files, in whatever order."""
    return checksum("".join(sorted(one.line for one in entries)).encode())


def read_verified(folder: Path, one: Entry) -> bytes:
    """The content of a file, as it was written. Raises ValueError, with what is wrong, if it is
    not."""
    path = folder / one.file
    try:
        size = path.stat().st_size
        content = path.read_bytes() if path.is_file() and size == one.bytes else b""
    except FileNotFoundError:
        raise ValueError("is gone") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from None
    if size != one.bytes:
        raise ValueError(f"was changed: it has {size} bytes, and had {one.bytes}")
    if checksum(content) != one.sha256:
        raise ValueError("was changed: its checksum is another")
    return content
