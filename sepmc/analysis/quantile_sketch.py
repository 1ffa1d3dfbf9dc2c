"""Quantiles and histograms of values that pass by once, in constant memory.

The first `EXACT_VALUES` values are kept, and while there are no more every answer is exact. Then a
grid of `BINS` equal bins is laid out from them, over their central 99.9 % and a quarter of that on
either side, and values are counted in it. By Chebyshev's inequality no 0.05 % and 99.95 % points
are further than sqrt(2000) = 44.7 sigma from a mean, so a bin is never wider than 1.5 x 89.4 /
32768 = 0.41 % of the sigma of those values, and a quantile never further off than a bin: for a
normal law 0.03 % of sigma. What falls beyond the grid is counted in bins that grow with their
distance from it, 64 to each doubling.

The result depends on the order of the values alone, not on how they were grouped.
"""

from collections import Counter
from collections.abc import Sequence
from copy import copy

import numpy as np

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars
from sepmc.analysis.proportions import order_statistics

EXACT_VALUES = 65536  # values kept before they are counted: 0.5 MB for each outcome
BINS = 32768
_OCTAVE = 64  # bins of a tail for each doubling of the distance from the grid
# a value repeated so often in the first ROOM is a point mass, and is answered as it is
_ATOM = EXACT_VALUES // 1000
_NO_GRID = np.empty(0)


class QuantileSketch:
    """Counts of the values of one outcome; NaN is the caller's to leave out."""

    def __init__(self) -> None:
        self._waiting = np.empty(EXACT_VALUES)
        self._filled = 0
        self._grid: _Grid | None = None

    def __getstate__(self) -> list[np.ndarray]:
        """What a pickle holds: no more than there are values."""
        return self.state()

    def __setstate__(self, state: list[np.ndarray]) -> None:
        self._waiting, self._filled = np.empty(EXACT_VALUES), 0
        self.restore(iter(state))

    def state(self) -> list[np.ndarray]:
        """What it holds, for `restore`."""
        return [self._waiting[: self._filled], *(self._grid.state() if self._grid else [_NO_GRID])]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held."""
        waiting = next(arrays)
        self._waiting[: len(waiting)], self._filled = waiting, len(waiting)
        known = next(arrays)
        self._grid = _Grid.restored(known, arrays) if len(known) else None

    def add(self, values: np.ndarray) -> None:
        """Take values, shape (n,), in the order of their cases."""
        while values.size:
            count = min(EXACT_VALUES - self._filled, values.size)
            self._waiting[self._filled : self._filled + count] = values[:count]
            self._filled += count
            values = values[count:]
            if self._filled == EXACT_VALUES:
                self._count()

    def new_partial(self) -> "QuantileSketch | ValueList":
        """What counts other values for this one to `merge`."""
        if self._grid is None:
            return ValueList()
        found = QuantileSketch()
        found._grid = self._grid.empty()
        return found

    def merge(self, others: "QuantileSketch | ValueList") -> None:
        """Take values that `apart` counted, whose cases come next."""
        if isinstance(others, ValueList):
            for values in others:
                self.add(values)
            return
        others._count()
        assert self._grid is not None
        assert others._grid is not None
        self._count()
        self._grid.merge(others._grid)

    def percentiles(self, percents: Sequence[float]) -> np.ndarray:
        """Sample percentiles, linear between order statistics as `numpy.percentile` has them; NaN
        if there is no value."""
        if self._grid is None:
            x = self._waiting[: self._filled]
            with np.errstate(invalid="ignore"):  # between two infinities there is no number
                return np.percentile(x, percents) if x.size else np.full(len(percents), np.nan)
        self._count()
        place = np.asarray(percents) / 100.0 * (self._grid.n - 1)
        rank = np.floor(place)
        below, above = (
            self._grid.ranked(rank),
            self._grid.ranked(np.minimum(rank + 1.0, self._grid.n - 1.0)),
        )
        with np.errstate(invalid="ignore"):
            return np.where(below == above, below, below + (place - rank) * (above - below))

    def ranked(self, places: np.ndarray) -> np.ndarray:
        """Values at places (k,) among all, rising, from 0."""
        if self._grid is None:
            return order_statistics(self._waiting[: self._filled], places)
        self._count()
        return self._grid.ranked(places)

    def histogram(self, edges: np.ndarray) -> np.ndarray:
        """Number of values between rising edges (n + 1,), the last one closed; shape (n,)."""
        if self._grid is None:
            return np.histogram(self._waiting[: self._filled], edges)[0].astype(float)
        self._count()
        return np.diff(self._grid.below(edges))

    def _count(self) -> None:
        """Put what waits into the grid."""
        x, self._filled = self._waiting[: self._filled], 0
        if self._grid is None:
            self._grid = _Grid(x)
        self._grid.count(x)


class ValueList(list[np.ndarray]):
    """Values as they come."""

    def add(self, values: np.ndarray) -> None:
        """As `QuantileSketch.add`."""
        if values.size:
            self.append(values.copy())


class _Grid:
    """Equal bins over the bulk of a law, bins that grow with the distance in its tails."""

    def __init__(self, sample: np.ndarray):
        x = np.sort(sample[np.isfinite(sample)])
        x = x if x.size else np.zeros(1)
        low, high = np.percentile(x, [0.05, 99.95])
        if low == high:  # nearly all values are equal: what the others span, if there are others
            low, high = x[0], x[-1]
        reach = 0.25 * (high - low)
        self.start = low - reach
        self.width = max(
            (high - low + 2.0 * reach) / BINS, np.spacing(max(abs(low), abs(high), 1e-290))
        )
        self.end = self.start + BINS * self.width
        values, counts = np.unique(x, return_counts=True)
        self.atoms = values[counts > _ATOM]
        self.counts = np.zeros(BINS, dtype=np.int64)
        # by bin: below and above the grid
        self.tails: tuple[Counter[int], Counter[int]] = (Counter(), Counter())
        self.infinite = [0, 0]  # minus and plus
        # of these the extremes are of finite values
        self.n, self.least, self.greatest = 0, np.inf, -np.inf

    def state(self) -> list[np.ndarray]:
        """What it holds, for `restored`: of the counts those that are not zero."""
        there = np.flatnonzero(self.counts)
        tails = [np.array(list(tail.items()), dtype=float).ravel() for tail in self.tails]
        infinite = np.array(self.infinite, dtype=float)
        counted = [there.astype(float), self.counts[there].astype(float)]
        return [scalars(self), infinite, self.atoms, *counted, *tails]

    @classmethod
    def restored(cls, numbers: np.ndarray, arrays: Arrays) -> "_Grid":
        """One that holds what another one held, whose ``numbers`` are the first of its `state`."""
        found = cls(np.zeros(1))
        set_scalars(found, numbers)
        found.infinite = [int(count) for count in next(arrays).tolist()]
        found.atoms, there = next(arrays), next(arrays).astype(np.int64)
        found.counts[there] = next(arrays).astype(np.int64)
        for tail in found.tails:
            pairs = next(arrays).reshape(-1, 2).astype(np.int64)
            tail.update({int(place): int(count) for place, count in pairs})
        return found

    def count(self, x: np.ndarray) -> None:
        """Count values, shape (n,)."""
        if not x.size:
            return
        self.n += x.size
        if not np.isfinite(x[[x.argmin(), x.argmax()]]).all():
            for side, sign in enumerate((-np.inf, np.inf)):
                self.infinite[side] += int(np.count_nonzero(x == sign))
            x = x[np.isfinite(x)]
            if not x.size:
                return
        least, greatest = float(x.min()), float(x.max())
        self.least, self.greatest = min(self.least, least), max(self.greatest, greatest)
        if least < self.start or greatest >= self.end:
            self._count_tail(0, self.start - x[x < self.start])
            self._count_tail(1, x[x >= self.end] - self.end)
            x = x[(x >= self.start) & (x < self.end)]
        bins = ((x - self.start) * (1.0 / self.width)).astype(np.int64)
        np.minimum(bins, BINS - 1, out=bins)  # the product may round up to the end
        self.counts += np.bincount(bins, minlength=BINS)

    def empty(self) -> "_Grid":
        """The same grid without values."""
        found = copy(self)
        found.counts = np.zeros(BINS, dtype=np.int64)
        found.tails, found.infinite = (Counter(), Counter()), [0, 0]
        found.n, found.least, found.greatest = 0, np.inf, -np.inf
        return found

    def merge(self, other: "_Grid") -> None:
        """Count the values of the same grid."""
        self.n += other.n
        self.counts += other.counts
        for own, others in zip(self.tails, other.tails, strict=True):
            own.update(others)
        self.infinite = [a + b for a, b in zip(self.infinite, other.infinite, strict=True)]
        self.least, self.greatest = (
            min(self.least, other.least),
            max(self.greatest, other.greatest),
        )

    def _count_tail(self, side: int, distance: np.ndarray) -> None:
        """Count distances from the grid: bin k holds 2^(k/64) - 1 to 2^((k+1)/64) - 1 widths of the
        grid's bins."""
        octaves = np.log2(self.width + distance) - np.log2(self.width)  # a quotient could overflow
        keys, counts = np.unique((_OCTAVE * octaves).astype(np.int64), return_counts=True)
        self.tails[side].update(dict(zip(keys.tolist(), counts.tolist(), strict=True)))

    def bins(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Left and right edges of the bins that hold finite values, rising, and their counts. Where
        a bin holds a value that many cases have, both edges are there."""
        there = np.flatnonzero(self.counts)
        parts = [
            (
                self.start + there * self.width,
                self.start + (there + 1) * self.width,
                self.counts[there],
            )
        ]
        for side, sign in ((0, -1.0), (1, 1.0)):
            keys = np.array(sorted(self.tails[side]), dtype=np.int64)
            # the last bin may end beyond the numbers, and is cut below
            with np.errstate(over="ignore"):
                near, far = (
                    sign * self.width * np.expm1((keys + step) * (np.log(2.0) / _OCTAVE))
                    for step in (0, 1)
                )
            counts = np.array([self.tails[side][key] for key in keys.tolist()], dtype=np.int64)
            if side == 0:
                parts.insert(0, ((self.start + far)[::-1], (self.start + near)[::-1], counts[::-1]))
            else:
                parts.append((self.end + near, self.end + far, counts))
        left, right, counts = (np.concatenate(column) for column in zip(*parts, strict=True))
        ends = np.clip([left, right], self.least, self.greatest)
        placed = ends
        for atom in self.atoms:
            placed = np.where((ends[0] <= atom) & (atom <= ends[1]), atom, placed)
        return *placed, counts

    def ranked(self, rank: np.ndarray) -> np.ndarray:
        """Values of rank 0 to n - 1, shape (r,); those of one bin are taken to be spread evenly
        over it."""
        left, right, counts = self.bins()
        minus, plus = self.infinite
        found = np.where(rank < minus, -np.inf, np.inf)
        finite = (rank >= minus) & (rank < self.n - plus)
        inside = rank[finite] - minus
        ends = np.cumsum(counts)
        i = np.searchsorted(ends, inside, side="right")
        value = left[i] + (right[i] - left[i]) * (inside - (ends - counts)[i] + 0.5) / counts[i]
        found[finite] = value
        return found

    def below(self, edges: np.ndarray) -> np.ndarray:
        """Number of finite values below each edge, those of one bin evenly spread over it; all of
        them at the last one."""
        left, right, counts = self.bins()
        right = np.where(left == right, np.nextafter(right, np.inf), right)  # at it is not below it
        ends = np.cumsum(counts)
        found = np.interp(
            edges,
            np.stack([left, right], 1).ravel(),
            np.stack([ends - counts, ends], 1).ravel(),
            left=0.0,
        )
        found[0], found[-1] = (
            (0.0 if edges[0] <= self.least else found[0]),
            (float(ends[-1]) if edges[-1] >= self.greatest else found[-1]),
        )
        return np.rint(found)
