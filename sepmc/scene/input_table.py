"""Inputs that a table gives, a row for each case: of an upstream campaign, or a plan made
before."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from sepmc.scene.messages import Problems, nearest

CASE = "case"  # the column of a table that numbers its rows
_FEW = 16  # values of a column that make a discrete law, so that trial cases fly each of them
_KNOTS = 257  # of the quantiles of a column of more


class Reader(Protocol):
    """Reads a table of inputs; None, with the problems noted, if that cannot be."""

    def __call__(self, path: Path, problems: Problems) -> "InputTable | None":
        """The table in the file at ``path``."""


@dataclass(frozen=True, eq=False)
class InputTable:
    """A table of inputs: the ``numbers`` (n,) of its cases, rising, and its columns of numbers
    (n,); of columns in which there are ``words``, the first word."""

    path: Path
    numbers: np.ndarray
    columns: dict[str, np.ndarray]
    words: dict[str, str] = field(default_factory=dict)

    def has(self, name: str) -> bool:
        """Whether there is such a column, of numbers or not."""
        return name in self.columns or name in self.words

    def rows(self, first: int, count: int) -> np.ndarray:
        """Places (count,) of the cases ``first`` to ``first + count``. Raises KeyError with the
        first one that the table does not hold."""
        wanted = np.arange(first, first + count)
        places = np.minimum(np.searchsorted(self.numbers, wanted), len(self.numbers) - 1)
        if (there := self.numbers[places] == wanted).all():
            return places
        raise KeyError(int(wanted[~there][0]))

    def digest(self, names: Iterable[str]) -> str:
        """Digest of the numbers of the cases and of some columns."""
        found = hashlib.sha256(np.ascontiguousarray(self.numbers, dtype=np.int64).tobytes())
        for name in names:
            found.update(name.encode() + np.ascontiguousarray(self.columns[name]).tobytes())
        return found.hexdigest()[:16]

    def law(self, name: str) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
        """Law, numbers and weights that a column amounts to: discrete if it has few values, else
        quantiles at equal steps of probability."""
        values, counts = np.unique(self.columns[name], return_counts=True)
        if len(values) <= _FEW:
            return "discrete", tuple(values.tolist()), tuple(counts.astype(float).tolist())
        knots = np.quantile(self.columns[name], np.linspace(0.0, 1.0, _KNOTS))
        return "given", tuple(knots.tolist()), ()


def check_column(given: InputTable, name: str, place: str, problems: Problems) -> bool:
    """Whether a table has a column of finite numbers; notes it, if not."""
    if name not in given.columns:
        if name in given.words:
            problems.add(place, f"column {name} of {given.path.name}: {given.words[name]}")
            return False
        said = nearest(name, given.columns)
        problems.add(place, f"no such column of numbers in {given.path.name}; {said}", name)
        return False
    bad = ~np.isfinite(given.columns[name])
    if bad.any():
        number = given.numbers[int(np.argmax(bad))]
        problems.add(place, f"column {name} of {given.path.name} is no number in case {number}")
    return not bad.any()
