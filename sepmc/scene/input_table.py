"""Sampled inputs read from a table, a row for each case: written by an upstream campaign or a
design of experiments."""

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
    """Reads a table of sampled inputs."""

    def __call__(self, path: Path, problems: Problems) -> "InputTable | None":
        """Return the table in the file at ``path``; None, with the problems noted, on failure."""


@dataclass(frozen=True, eq=False)
class InputTable:
    """A table of sampled inputs.

    Attributes
    ----------
    path : Path
    numbers : ndarray (n,)
        Case numbers of the rows, rising.
    columns : dict of ndarray (n,)
        Numeric columns by name.
    words : dict of str
        Columns that are not numeric, by name, each with a text on its first value that is no
        number.
    rows_in_file : ndarray (n,), optional
        Index in the file, from 0, of each row.
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
        """Row indices (count,) of the cases ``first`` to ``first + count - 1``. Raises KeyError
        with the first case that has no row."""
        cases = np.arange(first, first + count)
        rows = np.minimum(np.searchsorted(self.numbers, cases), len(self.numbers) - 1)
        exists = self.numbers[rows] == cases
        if exists.all():
            return rows
        raise KeyError(int(cases[~exists][0]))

    def digest(self, names: Iterable[str]) -> str:
        """Digest of the case numbers and of some columns, 16 hexadecimal digits."""
        digest = hashlib.sha256(np.ascontiguousarray(self.numbers, dtype=np.int64).tobytes())
        for name in names:
            digest.update(name.encode() + np.ascontiguousarray(self.columns[name]).tobytes())
        return digest.hexdigest()[:16]

    def distribution(self, name: str) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
        """Empirical distribution of a column, as name, numbers and weights of a `Dispersion`:
        discrete for few values, else quantiles at equal steps of probability."""
        values, counts = np.unique(self.columns[name], return_counts=True)
        if len(values) <= _FEW:
            return "discrete", tuple(values.tolist()), tuple(counts.astype(float).tolist())
        knots = np.quantile(self.columns[name], np.linspace(0.0, 1.0, _KNOTS))
        return "given", tuple(knots.tolist()), ()


def _line_of(table: InputTable, row: int) -> int:
    """Number, from 1, of the line of a row of a table in its text file, whose first lines may be
    comments; 0 for other files and if it cannot be read again."""
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
    """Return True if a table has a column of finite numbers; else note the problem."""
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
