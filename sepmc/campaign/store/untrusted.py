"""Checks of run folders and their Parquet files (shards) from untrusted sources, before they are
read.

A folder may contain regular files and folders only: a link would be followed, a pipe would block.
The size of a file is checked before it is read. A checksum does not help: the author of a harmful
shard can write its checksum too.
"""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sepmc.paths import is_local
from sepmc.scene import limits
from sepmc.schema import STATUS_LABELS

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

# data folders of a run folder
SELECTED = "selected"
KINDS = ("cases", "histories", SELECTED, "accumulators")
_FILE_NAME = re.compile(rf"(({'|'.join(KINDS)})/)?[A-Za-z0-9][A-Za-z0-9_.+-]{{0,250}}")
_COLUMN_NAME = re.compile(r"[A-Za-z0-9_]{1,250}")
_TEXT_COLUMNS = ("status", "phase", "kept_as")


class StoreError(Exception):
    """A run folder, or a file of it, cannot be used as requested; the argument is the message for
    the user. It is neither an InputError nor a ValueError."""


def check_entries(folder: Path) -> None:
    """Check that a run folder and its data folders contain regular files and folders only. A folder
    that is missing, or in object storage, is not checked.

    Raises
    ------
    StoreError
        If an entry is a link, a pipe or another special file, if a file of the run folder itself
        has a second name (hard link), or if a folder cannot be read.
    """
    if not is_local(folder):  # object storage has no links
        return
    for path in (folder, *(folder / kind for kind in KINDS)):
        try:
            with os.scandir(path) as entries:
                for entry in entries:
                    _check_entry(entry, path == folder)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise StoreError(f"{path}: cannot be read: {reason}") from None


def _check_entry(entry: "os.DirEntry[str]", is_rewritten: bool) -> None:
    """Raise StoreError if an entry of a folder is a link, or neither a regular file nor a folder.

    With ``is_rewritten`` (True) files in that folder may be written in place, so a file with
    another name elsewhere (hard link) is refused, too.
    """
    if entry.is_symlink():
        raise StoreError(
            f"{entry.path}: is a link, but a run folder contains its own files only: replace it by "
            "a copy of what it links to"
        )
    if not entry.is_file(follow_symlinks=False) and not entry.is_dir(follow_symlinks=False):
        raise StoreError(
            f"{entry.path}: is neither a file nor a folder; remove it from the run folder"
        )
    if is_rewritten and entry.is_file() and entry.stat().st_nlink > 1:
        reason = (
            "has another name elsewhere (a hard link), where it would be written too: replace it "
            "by a copy"
        )
        raise StoreError(f"{entry.path}: {reason}")


def is_file_name(file: str) -> bool:
    """Return True if ``file`` is a path that a file of a run can have, relative to the run folder:
    a plain name, also in one of the data folders."""
    return _FILE_NAME.fullmatch(file) is not None


def read_bounded(path: Path, max_bytes: int) -> bytes:
    """Content of a file of at most ``max_bytes``. Raises StoreError if it is larger or
    unreadable."""
    try:
        return limits.read_limited(path, max_bytes)
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise StoreError(f"{path}: {error}") from None


def file_fault(file: "pq.ParquetFile", size: int, rows: int | None = None) -> str:
    """Check the header of a Parquet file (numbers of rows, names and types of columns) before its
    rows are read.

    Parameters
    ----------
    file : ParquetFile
    size : int
        Size of the file, bytes.
    rows : int, optional
        Expected number of rows; not checked if None.

    Returns
    -------
    str
        Reason why no run can have written the file; empty if one can.
    """
    metadata, schema = file.metadata, file.schema_arrow
    count = sum(metadata.row_group(k).num_rows for k in range(metadata.num_row_groups))
    if count != metadata.num_rows or rows not in (None, count):
        expected = metadata.num_rows if rows is None else rows
        return f"has {count:,} rows, and should have {expected:,}"
    if count * max(1, len(schema) - len(_TEXT_COLUMNS)) > limits.NUMBERS_A_BYTE * size:
        return f"has {count:,} rows of {len(schema):,} columns, more than its bytes can contain"
    names = schema.names
    if bad := next((name for name in names if not _COLUMN_NAME.fullmatch(name)), None):
        return f"has a column with a name that no run writes: {bad[:60]!r}"
    if len(set(names)) < len(names):
        return "has a column twice"
    for field in schema:
        if not (_is_text(field.type) if field.name in _TEXT_COLUMNS else _is_number(field.type)):
            return f"has column {field.name} of another type than runs write: {field.type}"
    return ""


def table_fault(table: "pa.Table", first: int | None = None) -> str:
    """Check the values of columns that were read from a shard.

    Case numbers and texts must not be missing, and statuses must be known. Case numbers must be
    ``first``, ``first`` + 1, ..., unless ``first`` is None.

    Returns
    -------
    str
        Reason why no run can have written these values; empty if one can.
    """
    for name in ("case", *_TEXT_COLUMNS):
        if name in table.column_names and table[name].null_count:
            return f"has rows without {name}"
    if "status" in table.column_names:
        known = {label for chunk in _categories(table["status"]) for label in chunk.to_pylist()}
        if other := sorted(map(str, known.difference(STATUS_LABELS))):
            return f"has an unknown status: {other[0][:60]!r}"
    if first is not None and "case" in table.column_names:
        numbers = table["case"].to_numpy()
        if not np.array_equal(numbers, np.arange(first, first + len(numbers))):
            return f"has other cases than {first} to {first + len(numbers) - 1}"
    return ""


def _categories(column: "pa.ChunkedArray") -> "list[pa.Array]":
    import pyarrow as pa  # noqa: PLC0415  (not needed to look into a folder)

    return [
        chunk.dictionary if pa.types.is_dictionary(chunk.type) else chunk.unique()
        for chunk in column.chunks
    ]


def _is_text(kind: "pa.DataType") -> bool:
    import pyarrow as pa  # noqa: PLC0415

    inner = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(inner) or pa.types.is_large_string(inner))


def _is_number(kind: "pa.DataType") -> bool:
    import pyarrow as pa  # noqa: PLC0415

    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
