"""What a part of a run must be before it is read, and once it is: its rows, its columns, its
numbers. Who can write a part can write its checksum."""

import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sepmc.scene.limits import NUMBERS_A_BYTE
from sepmc.schema import Status

_NAME = re.compile(r"[A-Za-z0-9_]{1,250}")
_TEXTS = ("status", "phase", "kept_as")
_LABELS = frozenset(status.label for status in Status)


def file_fault(file: pq.ParquetFile, size: int, rows: int | None = None) -> str:
    """Why a Parquet file of so many bytes is none that a run writes, of so many rows if that is
    known; empty if it is."""
    told, schema = file.metadata, file.schema_arrow
    groups = [told.row_group(k) for k in range(told.num_row_groups)]
    held = sum(group.num_rows for group in groups)
    if held != told.num_rows or rows not in (None, held):
        return f"has {held:,} rows, and should have {told.num_rows if rows is None else rows:,}"
    if held * max(1, len(schema) - len(_TEXTS)) > NUMBERS_A_BYTE * size:
        return f"has {held:,} rows of {len(schema):,} columns, more than its bytes can hold"
    names = schema.names
    if bad := next((name for name in names if not _NAME.fullmatch(name)), None):
        return f"has a column of another name than runs have: {bad[:60]!r}"
    if len(set(names)) < len(names):
        return "has a column twice"
    for field in schema:
        if not (_is_text(field.type) if field.name in _TEXTS else _is_number(field.type)):
            return f"has a column {field.name} of another type: {field.type}"
    return ""


def table_fault(table: pa.Table, first: int | None = None) -> str:
    """Why the columns that were read of a part are none of a run, whose cases begin at ``first``;
    empty if they are."""
    for name in ("case", *_TEXTS):
        if name in table.column_names and table[name].null_count:
            return f"has rows without {name}"
    if "status" in table.column_names:
        known = {label for chunk in _dictionaries(table["status"]) for label in chunk.to_pylist()}
        if other := sorted(map(str, known - _LABELS)):
            return f"has a status that is none: {other[0][:60]!r}"
    if first is not None and "case" in table.column_names:
        numbers = table["case"].to_numpy()
        if not np.array_equal(numbers, np.arange(first, first + len(numbers))):
            return f"has other cases than {first} to {first + len(numbers) - 1}"
    return ""


def _dictionaries(column: pa.ChunkedArray) -> list[pa.Array]:
    return [
        chunk.dictionary if pa.types.is_dictionary(chunk.type) else chunk.unique()
        for chunk in column.chunks
    ]


def _is_text(kind: pa.DataType) -> bool:
    inner = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(inner) or pa.types.is_large_string(inner))


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
