"""Tables of inputs in files: CSV or Parquet to the cases that a campaign flies."""

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

_PLACE = "run.samples"
_PARQUET = ".parquet"
_ENDINGS = (_PARQUET, ".csv", ".txt")


def read_input_table(path: Path, problems: Problems) -> InputTable | None:
    """Read a table of inputs in CSV or Parquet; None, with the problems noted, if that cannot
    be."""
    fault, table = _file_fault(path), None
    if not fault:
        kind = "Parquet" if path.suffix.lower() == _PARQUET else "CSV"
        try:
            table = _parquet(path) if kind == "Parquet" else csv.read_csv(readable(path))
            names = [name.strip() for name in table.column_names]
        except _TooLarge as error:
            fault = str(error)
        except MemoryError:
            fault = "is larger than the memory there is"
        except (OSError, ValueError, pa.ArrowException) as error:
            said = printable(str(error).partition("\n")[0])
            fault = f"cannot be read as {kind}: {said}"
    if table is None or fault:
        problems.add(_PLACE, fault, str(path))
        return None
    if fault := _table_fault(table, names):
        problems.add(_PLACE, fault, str(path))
        return None
    columns = {n: table.column(k) for k, n in enumerate(names) if n}
    numbers = _case_numbers(columns.pop(CASE, None), table.num_rows, problems)
    if numbers is None:
        return None
    order = np.argsort(numbers)
    words = {
        name: f"{_first_word(column, numbers)} is no number"
        for name, column in columns.items()
        if not _is_number(column.type) and column.null_count < len(column)
    }
    kept = {
        name: _floats(column)[order] for name, column in columns.items() if _is_number(column.type)
    }
    return InputTable(path, numbers[order], kept, words)


class _TooLarge(Exception):
    """A table that would take more memory than any is given; its argument is the sentence."""


def _file_fault(path: Path) -> str:
    """Why a path is not that of a table that can be read; empty if it is."""
    try:
        state = path.stat()
    except FileNotFoundError:
        return "no such file"
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if path.suffix.lower() not in _ENDINGS:
        return f"must end in {', '.join(_ENDINGS)}"
    if not stat.S_ISREG(state.st_mode):
        return "is no file"
    if state.st_size > PLAN_BYTES:
        return f"has {state.st_size:,} bytes: must be at most {PLAN_BYTES:,}"
    return ""


def _parquet(path: Path) -> pa.Table:
    """A Parquet table, whose text stays a dictionary: a small file can hold a word many times."""
    with pq.ParquetFile(readable(path)) as file:
        told = file.metadata
        rows = max(
            told.num_rows, sum(told.row_group(k).num_rows for k in range(told.num_row_groups))
        )
        _check_size(rows, told.num_columns)
        texts = [field.name for field in file.schema_arrow if _is_text(field.type)]
    with pq.ParquetFile(readable(path), read_dictionary=texts) as file:
        return file.read()


def _check_size(rows: int, columns: int) -> None:
    if rows * columns > PLAN_NUMBERS:
        said = (
            f"has {rows:,} rows of {columns:,} columns: must hold at most {PLAN_NUMBERS:,} numbers"
        )
        raise _TooLarge(said)


def _table_fault(table: pa.Table, names: list[str]) -> str:
    """What is wrong with the size of a table, or with its names; empty if nothing is."""
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
    """Numbers (n,) of the cases, those of the rows if none are given; None, with the problem noted,
    if they are none."""
    place, said = f"{_PLACE}, column {CASE}", f"must hold whole numbers from 0 to {CASES - 1}"
    if column is None:
        return np.arange(rows)
    if not _is_number(column.type):
        problems.add(place, said, _first(column))
        return None
    given = _floats(column)
    fits = (given >= 0) & (given < CASES)
    whole = fits & (np.where(fits, given, 0.0) % 1 == 0)
    if not whole.all():
        problems.add(place, said, str(column[int(np.argmin(whole))].as_py()))
    elif len(np.unique(given)) < len(given):
        problems.add(place, "holds a number twice")
    else:
        return given.astype(np.int64)
    return None


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_integer(kind) or pa.types.is_floating(kind)


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_binary(kind)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    """Numbers (n,) of a column; NaN where it has none."""
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=float)


def _first(column: pa.ChunkedArray) -> str:
    """The first value of a column that is there and no number, or else the first that is there."""
    there = (_said(x) for x in column if x.is_valid)
    found = first = next(there, "")
    while _reads_as_number(found):
        if (following := next(there, None)) is None:
            return first
        found = following
    return found


def _first_word(column: pa.ChunkedArray, numbers: np.ndarray) -> str:
    word = _first(column)
    at = next(k for k, x in enumerate(column) if x.is_valid and _said(x) == word)
    return f"{shorten(word)} in case {numbers[at]}"


def _said(value: pa.Scalar) -> str:
    try:
        return str(value)
    except (ValueError, OverflowError, pa.ArrowException):  # a time in a zone that nobody knows
        return f"a {value.type}"


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
