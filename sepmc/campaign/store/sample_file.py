"""Reading of sample tables (``run.samples``): CSV or Parquet files with inputs of the cases of a
campaign."""

import re
import stat
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from sepmc.paths import readable
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.limits import CASES, PLAN_BYTES, PLAN_NUMBERS, TEXT, text_fault
from sepmc.scene.messages import Problems, printable, shorten

_KEY = "run.samples"
_PARQUET = ".parquet"
_ENDINGS = (_PARQUET, ".csv", ".txt", ".tsv")
_COMMENT, _DELIMITERS = "#", (";", "\t")
_HEAD, _FIRST_ROWS = 1 << 16, 20  # bytes and rows of a text file that are looked at first
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")


def read_input_table(path: Path, problems: Problems) -> InputTable | None:
    """Read a sample table from a file.

    Parameters
    ----------
    path : Path
        CSV or Parquet file with a row per case.
    problems : Problems
        Receives a line of text if the table is not valid.

    Returns
    -------
    InputTable or None
        Case numbers and columns, sorted by case number; None if the table is not valid.
    """
    fault, table = _file_fault(path), None
    if not fault:
        kind = "Parquet" if path.suffix.lower() == _PARQUET else "CSV"
        try:
            table = _parquet(path) if kind == "Parquet" else _csv(path)
            names = [name.strip() for name in table.column_names]
        except (_TooLarge, _UnreadableError) as error:
            fault = str(error)
        except MemoryError:
            fault = "needs more memory than this machine has; give fewer rows or columns"
        except (OSError, ValueError, pa.ArrowException) as error:
            reason = printable(str(error).partition("\n")[0])
            fault = f"cannot be read as {kind}: {reason}"
    if table is None or fault:
        problems.add(_KEY, fault, str(path))
        return None
    if fault := _table_fault(table, names):
        problems.add(_KEY, fault, str(path))
        return None
    columns = {n: table.column(k) for k, n in enumerate(names) if n}
    numbers = _case_numbers(columns.pop(CASE, None), table.num_rows, problems)
    if numbers is None:
        return None
    order = np.argsort(numbers)
    non_numeric = {
        name: f"{_first_non_numeric(column, numbers)} is no number"
        for name, column in columns.items()
        if not _is_number(column.type) and column.null_count < len(column)
    }
    numeric = {
        name: _floats(column)[order] for name, column in columns.items() if _is_number(column.type)
    }
    return InputTable(path, numbers[order], numeric, non_numeric, order)


class _UnreadableError(Exception):
    """The table cannot be read; the argument is the reason."""


class _TooLarge(Exception):
    """The table has too many numbers; the argument is the reason."""


def _file_fault(path: Path) -> str:
    """Reason why the file at a path cannot be a sample table: it is missing or unreadable, its name
    has another ending, it is no regular file, or it is too large. Empty if it can."""
    try:
        state = path.stat()
    except FileNotFoundError:
        return "no such file"
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if path.suffix.lower() not in _ENDINGS:
        return f"must end in {', '.join(_ENDINGS)}"
    if not stat.S_ISREG(state.st_mode):
        return "is no regular file"
    if state.st_size > PLAN_BYTES:
        return f"has {state.st_size:,} bytes: must be at most {PLAN_BYTES:,}"
    return ""


def _csv(path: Path) -> pa.Table:
    """Read a text file as an Arrow table.

    Comment lines before the header are skipped. The delimiter is the semicolon if the header has
    one, else the tab if it has one, else the comma.

    Raises
    ------
    _UnreadableError
        If a number in the first rows has a decimal comma, and the delimiter is not the comma.
    """
    skipped, header, rows = 0, "", list[tuple[int, str]]()
    with path.open("rb") as file:
        for number, line in enumerate(file.read(_HEAD).splitlines(), 1):
            text = line.decode("utf-8-sig" if number == 1 else "utf-8", errors="replace").strip()
            if not header and (not text or text.startswith(_COMMENT)):
                skipped = number
            elif not header:
                header = text
            elif text:
                rows.append((number, text))
    delimiter = next((each for each in _DELIMITERS if each in header), ",")
    for number, text in rows[:_FIRST_ROWS] if delimiter != "," else ():
        cell = next(filter(_DECIMAL_COMMA.fullmatch, map(str.strip, text.split(delimiter))), None)
        if cell is not None:
            point = cell.replace(",", ".")
            raise _UnreadableError(
                f"line {number}: {cell} has a decimal comma; write it with a point, {point}"
            )
    return csv.read_csv(
        readable(path),
        csv.ReadOptions(skip_rows=skipped),
        csv.ParseOptions(delimiter=delimiter),
    )


def _parquet(path: Path) -> pa.Table:
    """Read a Parquet file as an Arrow table. Text stays dictionary-encoded, as a small file can
    repeat a text often. Raises _TooLarge if the table has too many numbers."""
    with pq.ParquetFile(readable(path)) as file:
        metadata = file.metadata
        rows = max(
            metadata.num_rows,
            sum(metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)),
        )
        _check_size(rows, metadata.num_columns)
        texts = [field.name for field in file.schema_arrow if _is_text(field.type)]
    with pq.ParquetFile(readable(path), read_dictionary=texts) as file:
        return file.read()


def _check_size(rows: int, columns: int) -> None:
    if rows * columns > PLAN_NUMBERS:
        reason = (
            f"has {rows:,} rows of {columns:,} columns: must contain at most "
            f"{PLAN_NUMBERS:,} numbers"
        )
        raise _TooLarge(reason)


def _table_fault(table: pa.Table, names: list[str]) -> str:
    """First fault of a table, as text: it is too large, has no rows, or one of its column ``names``
    is no valid text or occurs twice (only the empty name may). Empty text if there is none."""
    try:
        _check_size(table.num_rows, table.num_columns)
    except _TooLarge as error:
        return str(error)
    if not table.num_rows:
        return "has no rows"
    for name, count in Counter(names).items():
        if fault := text_fault(name, TEXT):
            return f"column {shorten(name)}: {fault}"
        if name and count > 1:
            return f"has column {name} twice"
    return ""


def _case_numbers(column: pa.ChunkedArray | None, rows: int, problems: Problems) -> Any:
    """Case numbers (n,) of the rows of a table, from its ``column`` of case numbers.

    Without that column (None) they are 0 to ``rows`` - 1. If a number is invalid or occurs twice, a
    problem is added to ``problems``, and None is returned.
    """
    column_key, reason = (
        f"{_KEY}, column {CASE}",
        f"must contain whole numbers from 0 to {CASES - 1}",
    )
    if column is None:
        return np.arange(rows)
    if not _is_number(column.type):
        problems.add(column_key, reason, _first(column))
        return None
    values = _floats(column)
    in_range = (values >= 0) & (values < CASES)
    is_whole = in_range & (np.where(in_range, values, 0.0) % 1 == 0)
    if not is_whole.all():
        problems.add(column_key, reason, str(column[int(np.argmin(is_whole))].as_py()))
    elif len(np.unique(values)) < len(values):
        problems.add(column_key, "contains a case number twice")
    else:
        return values.astype(np.int64)
    return None


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_binary(kind)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    """Values (n,) of a numeric column as floats; NaN where a cell is empty."""
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=float)


def _first(column: pa.ChunkedArray) -> str:
    """Text of the first value of a column that cannot be read as a number; if there is none, of its
    first value. Blank cells are passed over; empty if all are blank."""
    valid = (_text_of(x) for x in column if x.is_valid)
    text = first_text = next(valid, "")
    while _reads_as_number(text):
        if (next_text := next(valid, None)) is None:
            return first_text
        text = next_text
    return text


def _first_non_numeric(column: pa.ChunkedArray, numbers: np.ndarray) -> str:
    text = _first(column)
    row = next(k for k, x in enumerate(column) if x.is_valid and _text_of(x) == text)
    return f"{shorten(text)} in case {numbers[row]}"


def _text_of(value: pa.Scalar) -> str:
    try:
        return str(value)
    except (ValueError, OverflowError, pa.ArrowException):  # such as a time in an unknown zone
        return f"a {value.type}"


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
