"""Sampled inputs of a campaign (``run.samples``) in memory: a table with a row for each case, as
another campaign or a design of experiments wrote it."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from sepmc.scene.messages import Problems, nearest

CASE = "case"  # the column of a table that numbers its rows
_FEW = 16  # distinct values up to which a column counts as discrete: calibration cases use each
_KNOTS = 257  # quantiles kept of a column with more values


class Reader(Protocol):
    """Type of a function that reads a table of sampled inputs: it takes the path of the file and a
    `Problems`, and returns the table, or None after adding problems."""

    def __call__(self, path: Path, problems: Problems) -> "InputTable | None":
        """Return the table in the file at ``path``; on failure None, after adding problems."""


@dataclass(frozen=True, eq=False)
class InputTable:
    """A table of sampled inputs.

    Attributes
    ----------
    path : Path
    numbers : ndarray (n,)
        Case number of each row, rising.
    columns : dict of ndarray (n,)
        Numeric columns by name.
    words : dict of str
        For each column that is not numeric, by name, a text for messages on its first value that is
        no number.
    rows_in_file : ndarray (n,), optional
        Index in the file, from 0, of each row. None: not known; messages then give no line.
    """

    path: Path
    numbers: np.ndarray
    columns: dict[str, np.ndarray]
    words: dict[str, str] = field(default_factory=dict)
    rows_in_file: np.ndarray | None = None

    def has(self, name: str) -> bool:
        """True if the table has a column of this name, numeric or not."""
        return name in self.columns or name in self.words

    def rows(self, first: int, count: int) -> np.ndarray:
        """Indices (count,) in this table of the rows of the cases ``first`` to ``first + count -
        1``. Raises KeyError, whose argument is the first case number without a row."""
        cases = np.arange(first, first + count)
        rows = np.minimum(np.searchsorted(self.numbers, cases), len(self.numbers) - 1)
        exists = self.numbers[rows] == cases
        if exists.all():
            return rows
        raise KeyError(int(cases[~exists][0]))

    def digest(self, names: Iterable[str]) -> str:
        """SHA-256 digest, cut to 16 hexadecimal digits, of the case numbers and, one after the
        other in the order of ``names``, of each name and its column (float64 bytes). KeyError for a
        name without a column."""
        digest = hashlib.sha256(np.ascontiguousarray(self.numbers, dtype=np.int64).tobytes())
        for name in names:
            digest.update(name.encode() + np.ascontiguousarray(self.columns[name]).tobytes())
        return digest.hexdigest()[:16]

    def distribution(self, name: str) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
        """Empirical distribution of a column, as ``distribution``, ``numbers`` and ``weights`` of a
        `Dispersion`: "discrete" for up to 16 distinct values, weighted by the number of rows that
        have each; else "given", with 257 quantiles at equal steps of probability, without
        weights."""
        values, counts = np.unique(self.columns[name], return_counts=True)
        if len(values) <= _FEW:
            return "discrete", tuple(values.tolist()), tuple(counts.astype(float).tolist())
        knots = np.quantile(self.columns[name], np.linspace(0.0, 1.0, _KNOTS))
        return "given", tuple(knots.tolist()), ()


def _line_of(table: InputTable, row: int) -> int:
    """Line number, from 1, that a row of the table (by index) has in its text file, which is read
    again. 0 for Parquet files, without ``rows_in_file``, and if the file cannot be read."""
    if table.rows_in_file is None or table.path.suffix.lower() == ".parquet":
        return 0
    left, has_header = int(table.rows_in_file[row]), False
    try:
        with table.path.open("rb") as file:
            for number, line in enumerate(file, 1):
                text = line.strip()
                if not text or (not has_header and text.startswith(b"#")):
                    continue
                if has_header and left == 0:
                    return number
                left -= has_header
                has_header = True
    except OSError:
        pass
    return 0


def check_column(table: InputTable, name: str, key_path: str, problems: Problems) -> bool:
    """True if the column ``name`` of a table exists and has only finite numbers; else False, after
    adding a problem at ``key_path``."""
    if name not in table.columns:
        if name in table.words:
            problems.add(key_path, f"column {name} of {table.path.name}: {table.words[name]}")
            return False
        reason = nearest(name, table.columns)
        problems.add(key_path, f"no such column of numbers in {table.path.name}; {reason}", name)
        return False
    bad = ~np.isfinite(table.columns[name])
    if bad.any():
        row = int(np.argmax(bad))
        line = _line_of(table, row)
        where = f"case {table.numbers[row]}" + (f", line {line}" if line else "")
        problems.add(key_path, f"column {name} of {table.path.name} is no number in {where}")
    return not bad.any()
