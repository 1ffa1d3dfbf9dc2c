"""Selection of cases of a campaign: the number of cases, ``10000`` (0 to 9999), or case numbers,
``25:50,73`` (25 to 49, and 73)."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.engine.dispatch import check_int
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError

_ALLOWED = (
    "must be a number of cases, as 1000 or 1e6, or case numbers, as 25:50,73 (25 to 49, and 73)"
)


@dataclass(frozen=True)
class CaseSelection:
    """A set of case numbers, stored as sorted, separate ranges (first, end) without ``end``."""

    ranges: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, numbers: Iterable[int]) -> "CaseSelection":
        """Make a selection of case numbers, which may be in any order and repeated."""
        array = numbers if isinstance(numbers, np.ndarray) else np.fromiter(numbers, dtype=np.int64)
        sorted_ = np.unique(array).astype(np.int64)
        ends = np.flatnonzero(np.diff(sorted_) != 1)
        firsts = sorted_[np.concatenate([[0], ends + 1])] if len(sorted_) else sorted_
        lasts = sorted_[np.concatenate([ends, [len(sorted_) - 1]])] if len(sorted_) else sorted_
        return cls(tuple(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True)))

    @classmethod
    def of_ranges(cls, ranges: Iterable[tuple[int, int]]) -> "CaseSelection":
        """Make a selection of ranges (first, end) without ``end``, which may be in any order and
        overlap; none may be empty, as this is not checked. Ranges that touch become one."""
        merged: list[tuple[int, int]] = []
        for first, end in sorted(ranges):
            if merged and first <= merged[-1][1]:
                merged[-1] = merged[-1][0], max(end, merged[-1][1])
            else:
                merged.append((first, end))
        return cls(tuple(merged))

    @classmethod
    def first(cls, count: int) -> "CaseSelection":
        """Make the selection of cases 0 to ``count`` - 1."""
        return cls(((0, count),) if count else ())

    @property
    def count(self) -> int:
        """Number of selected cases."""
        return sum(end - first for first, end in self.ranges)

    @property
    def end(self) -> int:
        """Last case number plus 1; 0 if the selection is empty."""
        return self.ranges[-1][1] if self.ranges else 0

    @property
    def are_first(self) -> bool:
        """True if the cases are 0, 1, 2, ... without a gap, or there are none."""
        return self.count == self.end

    def __contains__(self, number: int) -> bool:
        return any(first <= number < end for first, end in self.ranges)

    def __str__(self) -> str:
        """Case numbers as `read` and `parse` take them, such as ``25:50,73`` (25 to 49, and 73).
        The first 100 cases are ``0:100``. A single case is ``73:74``, as ``73`` alone is a number
        of cases. An empty selection is an empty text, which they reject."""
        is_one_range = len(self.ranges) == 1
        return ",".join(
            str(a) if b == a + 1 and not is_one_range else f"{a}:{b}" for a, b in self.ranges
        )

    def without(self, done: np.ndarray) -> "CaseSelection":
        """Return the selection without the sorted case numbers ``done`` (n,)."""
        left: list[tuple[int, int]] = []
        for first, end in self.ranges:
            inside = done[np.searchsorted(done, first) : np.searchsorted(done, end)]
            fences = np.concatenate([[first - 1], inside, [end]])
            gaps = np.flatnonzero(np.diff(fences) > 1)
            left += zip((fences[gaps] + 1).tolist(), fences[gaps + 1].tolist(), strict=True)
        return CaseSelection(tuple(left))

    def after(self, count: int) -> "CaseSelection":
        """Return the selection without its ``count`` lowest case numbers."""
        left = []
        for first, end in self.ranges:
            count_skipped = min(count, end - first)
            count -= count_skipped
            if first + count_skipped < end:
                left.append((first + count_skipped, end))
        return CaseSelection(tuple(left))

    def before(self, count: int) -> "CaseSelection":
        """Return the selection of the ``count`` lowest case numbers of this one."""
        ranges = []
        for first, end in self.ranges:
            count_taken = min(count, end - first)
            count -= count_taken
            if count_taken:
                ranges.append((first, first + count_taken))
        return CaseSelection(tuple(ranges))

    def within(self, other: "CaseSelection") -> "CaseSelection":
        """Return the selection of the cases that are both in this one and in ``other``."""
        pairs = [
            (max(first, other_first), min(end, other_end))
            for first, end in self.ranges
            for other_first, other_end in other.ranges
        ]
        return CaseSelection(tuple(pair for pair in pairs if pair[0] < pair[1]))

    def omits(self, done: np.ndarray) -> bool:
        """Return True if one of the sorted case numbers ``done`` (n,) is not in the selection."""
        n_inside = sum(
            np.searchsorted(done, end) - np.searchsorted(done, first) for first, end in self.ranges
        )
        return bool(n_inside < len(done))

    def count_common(self, other: "CaseSelection") -> int:
        """Return the number of cases that are both in this selection and in ``other``."""
        return self.within(other).count

    def doubling(self, first: int) -> "Iterator[CaseSelection]":
        """Yield consecutive selections of all cases from 0 to `end` - 1, also unselected ones:
        ``first`` cases, as many again, twice as many, four times as many, ..."""
        start, end = 0, first
        while start < self.end:
            yield CaseSelection(((start, min(end, self.end)),))
            start, end = end, 2 * end

    def split(self, size: int) -> Iterator[tuple[int, int]]:
        """Yield the selection as ranges (first, end), without ``end``, of at most ``size``
        consecutive cases, in order."""
        for first, end in self.ranges:
            for start in range(first, end, size):
                yield start, min(start + size, end)


def parse(text: str) -> CaseSelection:
    """Return the selection of the case numbers in the manifest of a run, ``25:50,73`` (25 to 49,
    and 73). A lone ``73``, which earlier versions wrote, is case 73. Raises InputError if it is no
    such text."""
    return _of_numbers(text, InputError(f"cases = {text}: {_ALLOWED}"))


def read(value: Any, name: str = "cases") -> int | CaseSelection:
    """Convert an argument that is either a number of cases or a selection of case numbers.

    Parameters
    ----------
    value : int, str, iterable of int or CaseSelection
        A number of cases, ``1000``, ``"73"`` or ``"1e6"``; or case numbers, ``"25:50,73"`` (25 to
        49, and 73), ``"73:74"`` (only 73) or ``[3, 17]``.
    name : str
        Name of the argument in error messages.

    Returns
    -------
    int or CaseSelection
        int for a number of cases, CaseSelection for case numbers.

    Raises
    ------
    InputError
        If the value is neither, or a number is out of range.
    """
    if isinstance(value, CaseSelection):
        return value
    if isinstance(value, str):
        return _from_text(value.strip(), name)
    is_iterable = isinstance(value, Iterable) and not isinstance(value, bytes | Mapping)
    if is_iterable and getattr(value, "ndim", None) != 0:
        selection = CaseSelection.of(check_int(name, number, 0, CASES - 1) for number in value)
        if not selection.count:
            raise InputError(f"{name} = []: {_ALLOWED}")
        return selection
    return check_int(name, value, 1, CASES)


def _from_text(text: str, name: str) -> int | CaseSelection:
    """Parse text for `read`, which has the same result and errors."""
    error = InputError(f"{name} = {text}: {_ALLOWED}")
    if "," not in text and ":" not in text:
        try:
            number = float(text)
        except ValueError:
            raise error from None
        return check_int(name, number if number.is_integer() else text, 1, CASES)
    return _of_numbers(text, error)


def _of_numbers(text: str, error: InputError) -> CaseSelection:
    """Return the selection of case numbers, such as ``25:50,73`` (25 to 49, and 73); raises
    ``error`` for any other text, an empty range or a number that is too large."""
    ranges = []
    for part in text.split(","):
        ends = part.split(":")
        if len(ends) > 2 or not all(end.strip().isdecimal() for end in ends):
            raise error
        first, end = int(ends[0]), int(ends[-1]) + (len(ends) == 1)
        if not first < end <= CASES:
            raise error
        ranges.append((first, end))
    return CaseSelection.of_ranges(ranges)
