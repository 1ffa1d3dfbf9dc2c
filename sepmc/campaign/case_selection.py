"""Which cases of a campaign are flown: ``10000`` of them, or those named, ``25:50,73``."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.engine.dispatch import check_int
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError

_ASKED = "must be how many, as 1000 or 1e6, or which, as 25:50,73 (25 to 49, and 73)"


@dataclass(frozen=True)
class CaseSelection:
    """Numbers of cases, as ranges (first, end) that rise and do not touch."""

    ranges: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, numbers: Iterable[int]) -> "CaseSelection":
        """Of the numbers given, in any order."""
        given = numbers if isinstance(numbers, np.ndarray) else np.fromiter(numbers, dtype=np.int64)
        sorted_ = np.unique(given).astype(np.int64)
        ends = np.flatnonzero(np.diff(sorted_) != 1)
        firsts = sorted_[np.concatenate([[0], ends + 1])] if len(sorted_) else sorted_
        lasts = sorted_[np.concatenate([ends, [len(sorted_) - 1]])] if len(sorted_) else sorted_
        return cls(tuple(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True)))

    @classmethod
    def of_ranges(cls, ranges: Iterable[tuple[int, int]]) -> "CaseSelection":
        """Of ranges (first, end) in any order, which may overlap."""
        merged: list[tuple[int, int]] = []
        for first, end in sorted(ranges):
            if merged and first <= merged[-1][1]:
                merged[-1] = merged[-1][0], max(end, merged[-1][1])
            else:
                merged.append((first, end))
        return cls(tuple(merged))

    @classmethod
    def first(cls, count: int) -> "CaseSelection":
        """The first so many."""
        return cls(((0, count),) if count else ())

    @property
    def count(self) -> int:
        """How many there are."""
        return sum(end - first for first, end in self.ranges)

    @property
    def end(self) -> int:
        """One more than the last."""
        return self.ranges[-1][1] if self.ranges else 0

    @property
    def are_first(self) -> bool:
        """Whether none below the last is left out."""
        return self.count == self.end

    def __contains__(self, number: int) -> bool:
        return any(first <= number < end for first, end in self.ranges)

    def __str__(self) -> str:
        return ",".join(str(a) if b == a + 1 else f"{a}:{b}" for a, b in self.ranges)

    def without(self, done: np.ndarray) -> "CaseSelection":
        """Those that are not among the sorted numbers ``done`` (n,)."""
        left: list[tuple[int, int]] = []
        for first, end in self.ranges:
            inside = done[np.searchsorted(done, first) : np.searchsorted(done, end)]
            fences = np.concatenate([[first - 1], inside, [end]])
            gaps = np.flatnonzero(np.diff(fences) > 1)
            left += zip((fences[gaps] + 1).tolist(), fences[gaps + 1].tolist(), strict=True)
        return CaseSelection(tuple(left))

    def after(self, count: int) -> "CaseSelection":
        """Those that come after the first so many of them."""
        left = []
        for first, end in self.ranges:
            skipped = min(count, end - first)
            count -= skipped
            if first + skipped < end:
                left.append((first + skipped, end))
        return CaseSelection(tuple(left))

    def before(self, count: int) -> "CaseSelection":
        """The first so many of them."""
        kept = []
        for first, end in self.ranges:
            taken = min(count, end - first)
            count -= taken
            if taken:
                kept.append((first, first + taken))
        return CaseSelection(tuple(kept))

    def within(self, other: "CaseSelection") -> "CaseSelection":
        """Those that are also among ``other``."""
        pairs = [
            (max(first, its_first), min(end, its_end))
            for first, end in self.ranges
            for its_first, its_end in other.ranges
        ]
        return CaseSelection(tuple(pair for pair in pairs if pair[0] < pair[1]))

    def leave_out(self, done: np.ndarray) -> bool:
        """Whether some of the sorted numbers ``done`` (n,) are not among these."""
        held = sum(
            np.searchsorted(done, end) - np.searchsorted(done, first) for first, end in self.ranges
        )
        return bool(held < len(done))

    def common(self, other: "CaseSelection") -> int:
        """How many of them are also among ``other``."""
        return self.within(other).count

    def growing(self, first: int) -> "Iterator[CaseSelection]":
        """The first so many, of which none is left out, then as many again, and so on."""
        start, end = 0, first
        while start < self.end:
            yield CaseSelection(((start, min(end, self.end)),))
            start, end = end, 2 * end

    def pieces(self, size: int) -> Iterator[tuple[int, int]]:
        """Ranges (first, end) of at most ``size`` numbers."""
        for first, end in self.ranges:
            for start in range(first, end, size):
                yield start, min(start + size, end)


def named(text: str) -> CaseSelection:
    """The cases that a text names, ``25:50,73``, or the first so many."""
    found = read(text)
    return CaseSelection.first(found) if isinstance(found, int) else found


def read(asked: Any, name: str = "cases") -> int | CaseSelection:
    """How many cases are asked for, or which: a whole number, text as the command line takes it, or
    the numbers themselves in any order, of a set too. Raises InputError with what is allowed."""
    if isinstance(asked, CaseSelection):
        return asked
    if isinstance(asked, str):
        return _of_text(asked.strip(), name)
    several = isinstance(asked, Iterable) and not isinstance(asked, bytes | Mapping)
    if several and getattr(asked, "ndim", None) != 0:
        found = CaseSelection.of(check_int(name, number, 0, CASES - 1) for number in asked)
        if not found.count:
            raise InputError(f"{name} = []: {_ASKED}")
        return found
    return check_int(name, asked, 1, CASES)


def _of_text(text: str, name: str) -> int | CaseSelection:
    fault = InputError(f"{name} = {text}: {_ASKED}")
    if "," not in text and ":" not in text:
        try:
            number = float(text)
        except ValueError:
            raise fault from None
        return check_int(name, number if number.is_integer() else text, 1, CASES)
    ranges = []
    for part in text.split(","):
        ends = part.split(":")
        if len(ends) > 2 or not all(end.strip().isdecimal() for end in ends):
            raise fault
        first, end = int(ends[0]), int(ends[-1]) + (len(ends) == 1)
        if not first < end <= CASES:
            raise fault
        ranges.append((first, end))
    return CaseSelection.of_ranges(ranges)
