"""Ledger of a run folder: a file with a line for each other file, with its size and checksum.

Lines are appended as files are written; of several lines on one file the last one counts. Each line
ends with a checksum of itself. A damaged line is ignored, so the file that it is on counts as
missing.
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
_CHECKSUM_LENGTH = 16  # characters


class Entry(msgspec.Struct, frozen=True):
    """Entry of the ledger of a run folder: what one file of the folder was when it was written.

    Attributes
    ----------
    file : str
        Path of the file relative to the folder.
    bytes : int
        Size of the file.
    sha256 : str
        SHA-256 checksum of its content, hexadecimal.
    first, cases : int
        Number of the first case and number of cases of a shard, 0 and 0 for other files. Of a shard
        of selected rows, ``cases`` is the number of rows, whose cases need not be consecutive. Of
        accumulated statistics, ``first`` is the number of cases in them, and ``cases`` is 0.
    """

    file: str
    bytes: int
    sha256: str
    first: int = 0
    cases: int = 0

    @property
    def is_valid(self) -> bool:
        """True if a run can have a file with this name, size and range of cases; the file itself is
        not read."""
        return (
            untrusted.is_file_name(self.file)
            and 0 <= self.bytes <= PART_BYTES
            and 0 <= self.first <= self.first + self.cases <= CASES
            and self.cases <= self.bytes  # a case has several numbers, at most 4 to a byte
        )

    @property
    def line(self) -> str:
        """The entry as a line of the ledger: JSON, a space, the first 16 digits of the checksum of
        that JSON, and a line end."""
        text = msgspec.json.encode(self).decode()
        return f"{text} {checksum(text.encode())[:_CHECKSUM_LENGTH]}\n"

    @property
    def cases_text(self) -> str:
        """Cases of a shard in words: "cases 0 to 99", or "3 of the cases from 20 on" if it has
        selected rows, whose case numbers have gaps. Case 20 itself need not be among these."""
        if self.file.startswith(f"{untrusted.SELECTED}/"):
            return f"{self.cases} of the cases from {self.first} on"
        return f"cases {self.first} to {self.first + self.cases - 1}"


def checksum(content: bytes) -> str:
    """SHA-256 checksum of bytes, 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that readers see the old or the new content, never a part of it.

    If several processes write it at once, the content is that of one of them. Raises OSError if it
    cannot be written.
    """
    if not is_local(path):  # object storage writes atomically
        path.write_bytes(content)
        return
    temporary = path.with_name(f"{path.name}.{uuid4().hex[:8]}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(content)
        os.replace(temporary, path)
    except FileExistsError:  # of another process
        raise
    except OSError:  # a full disk
        temporary.unlink(missing_ok=True)
        raise


def make_entry(file: str, content: bytes, first: int = 0, cases: int = 0) -> Entry:
    """Create the entry of a file with path ``file`` in the run folder and this ``content``; it is
    not yet added to a ledger. ``first`` and ``cases`` are the range of a shard."""
    return Entry(file, len(content), checksum(content), first, cases)


def add(folder: Path, *entries: Entry) -> None:
    """Append entries to the ledger of an existing folder; a missing ledger is created. Raises
    OSError if it cannot be written."""
    lines = "".join(entry.line for entry in entries).encode()
    if not is_local(folder):  # objects cannot be appended to
        write_atomically(folder / LEDGER, _content(folder) + lines)
        return
    with open(folder / LEDGER, "ab") as ledger:
        ledger.write(lines)


def rewrite(folder: Path, entries: Iterable[Entry]) -> None:
    """Replace the ledger of a folder, atomically, by one with these entries alone. Raises OSError
    if it cannot be written."""
    write_atomically(folder / LEDGER, "".join(entry.line for entry in entries).encode())


def read(folder: Path) -> Mapping[str, Entry]:
    """Read the ledger of a folder.

    Returns
    -------
    mapping of str to Entry
        Entries by path of the file relative to the folder; empty if there is no ledger. Damaged
        lines are ignored.

    Raises
    ------
    StoreError
        If the folder has links or other special files, or the ledger is too large.
    """
    if not is_local(folder):  # its times have a resolution of seconds
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
    return {entry.file: entry for entry in map(_entry, lines) if entry}


def _content(folder: Path) -> bytes:
    try:
        return (folder / LEDGER).read_bytes()
    except OSError:
        return b""


def _lines(path: Path) -> list[bytes]:
    """Lines of a ledger file, without line ends. Raises StoreError if it is missing, unreadable or
    too large."""
    content = untrusted.read_bounded(path, LEDGER_BYTES)
    if (count := content.count(b"\n") + content.count(b"\r")) > LEDGER_LINES:
        text = f"has {count:,} lines: must have at most {LEDGER_LINES:,}"
        raise untrusted.StoreError(f"{path}: {text}")
    return content.splitlines()


def _entry(line: bytes) -> Entry | None:
    """Entry that a line of a ledger contains; None if the line is damaged or the entry invalid."""
    text, _, end = line.rpartition(b" ")
    if checksum(text)[:_CHECKSUM_LENGTH].encode() != end:
        return None
    try:
        entry = msgspec.json.decode(text, type=Entry)
    except (msgspec.MsgspecError, ValueError):
        return None
    return entry if entry.is_valid else None


def count_damaged_lines(folder: Path) -> int:
    """Number of damaged lines in the ledger of a folder; 0 also if there is no readable ledger."""
    try:
        lines = _lines(folder / LEDGER)
    except untrusted.StoreError:
        return 0
    return sum(_entry(line) is None for line in lines)


def digest(entries: Iterable[Entry]) -> str:
    """Checksum of a set of entries, hexadecimal, which does not depend on their order."""
    return checksum("".join(sorted(entry.line for entry in entries)).encode())


def read_verified(folder: Path, entry: Entry) -> bytes:
    """Read a file of a run folder, and return its content if size and checksum match its entry.

    Raises
    ------
    ValueError
        If the file is missing, cannot be read or differs from the entry. Its text is the reason,
        as the end of a sentence about the file: "is gone", "was changed: ...".
    """
    path = folder / entry.file
    try:
        size = path.stat().st_size
        content = path.read_bytes() if path.is_file() and size == entry.bytes else b""
    except FileNotFoundError:
        raise ValueError("is gone") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from None
    if size != entry.bytes:
        raise ValueError(f"was changed: it has {size} bytes, and had {entry.bytes}")
    if checksum(content) != entry.sha256:
        raise ValueError("was changed: its checksum is not the one in checksums.jsonl")
    return content
