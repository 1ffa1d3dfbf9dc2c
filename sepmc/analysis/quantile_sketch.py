"""Quantiles and histograms of streamed values, in constant memory.

Fewer than `EXACT_VALUES` values are stored, and every result is exact. When that number is reached,
a grid of `BINS` equal bins is laid out over the range of their central 99.9 % and a quarter of that
range on either side, and these and all further values are counted in the bins. By Chebyshev's
inequality the 0.05 % and 99.95 % points are within sqrt(2000) = 44.7 sigma of the mean, so a bin is
never wider than 1.5 x 89.4 / 32768 = 0.41 % of the sigma of the first values (0.03 % for a normal
distribution), and a quantile within the grid is never off by more than a bin. Values beyond the
grid are counted in bins that grow with the distance from it, 64 for each doubling.

Results depend on the values and their order, not on how they were grouped into calls.
"""

from collections import Counter
from collections.abc import Sequence
from copy import copy

import numpy as np

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars
from sepmc.analysis.proportions import order_statistics

EXACT_VALUES = 65536  # values at which all are binned: 0.5 MB per outcome
BINS = 32768
_OCTAVE = 64  # bins of a tail for each doubling of the distance from the grid
# a value more frequent than this in the first EXACT_VALUES is a point mass, reported exactly
_ATOM = EXACT_VALUES // 1000
_NO_GRID = np.empty(0)


class QuantileSketch:
    """Accumulator of the values of one outcome, for quantiles and histograms. Fewer than
    `EXACT_VALUES` values are stored as they are; when that number is reached, these and all later
    values are counted in bins. NaN is not allowed."""

    def __init__(self) -> None:
        self._buffer = np.empty(EXACT_VALUES)
        self._filled = 0
        self._grid: _Grid | None = None

    def __getstate__(self) -> list[np.ndarray]:
        """Return the state for pickling, without the empty part of the buffer."""
        return self.state()

    def __setstate__(self, state: list[np.ndarray]) -> None:
        self._buffer, self._filled = np.empty(EXACT_VALUES), 0
        self.restore(iter(state))

    def state(self) -> list[np.ndarray]:
        """Return what was accumulated so far as float arrays, which `restore` takes."""
        return [self._buffer[: self._filled], *(self._grid.state() if self._grid else [_NO_GRID])]

    def restore(self, arrays: Arrays) -> None:
        """Replace what was accumulated by the arrays of `state`, which are taken from the iterator
        ``arrays`` in that order. Arrays that do not fit raise ValueError, ArithmeticError,
        LookupError or StopIteration."""
        buffered = next(arrays)
        self._buffer[: len(buffered)], self._filled = buffered, len(buffered)
        grid_state = next(arrays)
        self._grid = _Grid.restored(grid_state, arrays) if len(grid_state) else None

    def add(self, values: np.ndarray) -> None:
        """Add ``values`` (n,), which must not contain NaN, in the order of their cases."""
        while values.size:
            count = min(EXACT_VALUES - self._filled, values.size)
            self._buffer[self._filled : self._filled + count] = values[:count]
            self._filled += count
            values = values[count:]
            if self._filled == EXACT_VALUES:
                self._count()

    def new_partial(self) -> "QuantileSketch | ValueList":
        """Return an empty accumulator for values of later cases, to pass to `merge`: a list while
        this sketch has no grid of bins yet, else a sketch with the same bins."""
        if self._grid is None:
            return ValueList()
        empty = QuantileSketch()
        empty._grid = self._grid.empty()
        return empty

    def merge(self, others: "QuantileSketch | ValueList") -> None:
        """Add the values of an accumulator that `new_partial` returned; its cases must follow those
        already added. If ``others`` is a sketch, its values and those stored here are counted in
        bins, which changes ``others`` too."""
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
        """Return the percentiles of the values at ``percents`` (0 to 100), linear between sorted
        values as `numpy.percentile`; NaN without values. Values counted in bins are estimated as
        by `ranked`."""
        if self._grid is None:
            x = self._buffer[: self._filled]
            with np.errstate(invalid="ignore"):  # NaN between two infinities
                return np.percentile(x, percents) if x.size else np.full(len(percents), np.nan)
        self._count()
        position = np.asarray(percents) / 100.0 * (self._grid.n - 1)
        rank = np.floor(position)
        lower, upper = (
            self._grid.ranked(rank),
            self._grid.ranked(np.minimum(rank + 1.0, self._grid.n - 1.0)),
        )
        with np.errstate(invalid="ignore"):
            return np.where(lower == upper, lower, lower + (position - rank) * (upper - lower))

    def ranked(self, ranks: np.ndarray) -> np.ndarray:
        """Return the values (k,) that have the zero-based ``ranks`` (k,) among all added values in
        increasing order; estimated as in `_Grid.ranked` if the values are counted in bins."""
        if self._grid is None:
            return order_statistics(self._buffer[: self._filled], ranks)
        self._count()
        return self._grid.ranked(ranks)

    def histogram(self, edges: np.ndarray) -> np.ndarray:
        """Return the numbers (n,) of values between increasing edges (n + 1,), as floats; a value
        at an edge counts above it, at the last edge below it."""
        if self._grid is None:
            return np.histogram(self._buffer[: self._filled], edges)[0].astype(float)
        self._count()
        return np.diff(self._grid.counts_below(edges))

    def _count(self) -> None:
        """Count the buffered values in the grid, which the first call lays out, and empty the
        buffer."""
        x, self._filled = self._buffer[: self._filled], 0
        if self._grid is None:
            self._grid = _Grid(x)
        self._grid.count(x)


class ValueList(list[np.ndarray]):
    """List of arrays of values, in the order they were added, for `QuantileSketch.merge`."""

    def add(self, values: np.ndarray) -> None:
        """Append a copy of ``values`` (n,), which must not contain NaN; nothing if it is empty."""
        if values.size:
            self.append(values.copy())


class _Grid:
    """Counts of values in bins laid out for a ``sample``, which is not counted itself: equal bins
    over the bulk of the distribution, growing bins in its tails. A value that the sample contains
    more than 65 times is an atom: all values counted in its bin are reported as the atom's value.
    Infinite values in the sample are ignored."""

    def __init__(self, sample: np.ndarray):
        x = np.sort(sample[np.isfinite(sample)])
        x = x if x.size else np.zeros(1)
        low, high = np.percentile(x, [0.05, 99.95])
        if low == high:  # nearly all values are equal: use the range of the others, if any
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
        # counts by bin, below and above the grid
        self.tails: tuple[Counter[int], Counter[int]] = (Counter(), Counter())
        self.infinite = [0, 0]  # minus and plus
        # the extremes are of finite values
        self.n, self.min_value, self.max_value = 0, np.inf, -np.inf

    def state(self) -> list[np.ndarray]:
        """Return the state as arrays for `restored`: layout of the bins and extremes, atoms, and
        counts that are not zero. The sample is not part of it."""
        occupied = np.flatnonzero(self.counts)
        tails = [np.array(list(tail.items()), dtype=float).ravel() for tail in self.tails]
        infinite = np.array(self.infinite, dtype=float)
        counted = [occupied.astype(float), self.counts[occupied].astype(float)]
        return [scalars(self), infinite, self.atoms, *counted, *tails]

    @classmethod
    def restored(cls, numbers: np.ndarray, arrays: Arrays) -> "_Grid":
        """Return a grid from the arrays of its `state`: ``numbers`` is the first of them, and
        ``arrays`` yields the others."""
        grid = cls(np.zeros(1))
        set_scalars(grid, numbers)
        grid.infinite = [int(count) for count in next(arrays).tolist()]
        grid.atoms, occupied = next(arrays), next(arrays).astype(np.int64)
        grid.counts[occupied] = next(arrays).astype(np.int64)
        for tail in grid.tails:
            pairs = next(arrays).reshape(-1, 2).astype(np.int64)
            tail.update({int(key): int(count) for key, count in pairs})
        return grid

    def count(self, x: np.ndarray) -> None:
        """Count values (n,), without NaN, in their bins (those beyond the bulk in bins of the
        tails); infinite ones are counted by sign."""
        if not x.size:
            return
        self.n += x.size
        if not np.isfinite(x[[x.argmin(), x.argmax()]]).all():
            for side, sign in enumerate((-np.inf, np.inf)):
                self.infinite[side] += int(np.count_nonzero(x == sign))
            x = x[np.isfinite(x)]
            if not x.size:
                return
        min_value, max_value = float(x.min()), float(x.max())
        self.min_value = min(self.min_value, min_value)
        self.max_value = max(self.max_value, max_value)
        if min_value < self.start or max_value >= self.end:
            self._count_tail(0, self.start - x[x < self.start])
            self._count_tail(1, x[x >= self.end] - self.end)
            x = x[(x >= self.start) & (x < self.end)]
        bins = ((x - self.start) * (1.0 / self.width)).astype(np.int64)
        np.minimum(bins, BINS - 1, out=bins)  # the product may round up to the end
        self.counts += np.bincount(bins, minlength=BINS)

    def empty(self) -> "_Grid":
        """Return a grid with the same bins and no values."""
        grid = copy(self)
        grid.counts = np.zeros(BINS, dtype=np.int64)
        grid.tails, grid.infinite = (Counter(), Counter()), [0, 0]
        grid.n, grid.min_value, grid.max_value = 0, np.inf, -np.inf
        return grid

    def merge(self, other: "_Grid") -> None:
        """Add the counts of another grid that has the same bins."""
        self.n += other.n
        self.counts += other.counts
        for own, others in zip(self.tails, other.tails, strict=True):
            own.update(others)
        self.infinite = [a + b for a, b in zip(self.infinite, other.infinite, strict=True)]
        self.min_value = min(self.min_value, other.min_value)
        self.max_value = max(self.max_value, other.max_value)

    def _count_tail(self, side: int, distance: np.ndarray) -> None:
        """Count values beyond the grid, below it (``side`` 0) or above it (1), by their
        ``distance`` (n,) from it: tail bin k is from 2^(k/64) - 1 to 2^((k+1)/64) - 1 bin
        widths."""
        octaves = np.log2(self.width + distance) - np.log2(self.width)  # a quotient could overflow
        keys, counts = np.unique((_OCTAVE * octaves).astype(np.int64), return_counts=True)
        self.tails[side].update(dict(zip(keys.tolist(), counts.tolist(), strict=True)))

    def bins(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return left edges, right edges and counts, each (m,), of the occupied bins in increasing
        order; both edges of a bin that contains an atom are the atom's value."""
        occupied = np.flatnonzero(self.counts)
        parts = [
            (
                self.start + occupied * self.width,
                self.start + (occupied + 1) * self.width,
                self.counts[occupied],
            )
        ]
        for side, sign in ((0, -1.0), (1, 1.0)):
            keys = np.array(sorted(self.tails[side]), dtype=np.int64)
            # the last bin may end at infinity, and is clipped below
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
        clipped = np.clip([left, right], self.min_value, self.max_value)
        edges = clipped
        for atom in self.atoms:
            edges = np.where((clipped[0] <= atom) & (atom <= clipped[1]), atom, edges)
        return *edges, counts

    def ranked(self, rank: np.ndarray) -> np.ndarray:
        """Return the values (r,) at whole ranks (r,), given in any order: 0 for the least of the n
        values counted, n - 1 for the largest; -inf and inf for ranks of infinite values. The values
        counted in a bin are taken as spread evenly over it."""
        left, right, counts = self.bins()
        minus, plus = self.infinite
        result = np.where(rank < minus, -np.inf, np.inf)
        finite = (rank >= minus) & (rank < self.n - plus)
        inside = rank[finite] - minus
        cumulative = np.cumsum(counts)
        i = np.searchsorted(cumulative, inside, side="right")
        value = (
            left[i] + (right[i] - left[i]) * (inside - (cumulative - counts)[i] + 0.5) / counts[i]
        )
        result[finite] = value
        return result

    def counts_below(self, edges: np.ndarray) -> np.ndarray:
        """Return the numbers (m,), rounded, of finite values below increasing edges (m,), as if the
        values counted in a bin were spread evenly over it, or were all at its atom if it has one;
        a last edge at the largest value or above counts all."""
        left, right, counts = self.bins()
        # a value at an edge is not below it
        right = np.where(left == right, np.nextafter(right, np.inf), right)
        cumulative = np.cumsum(counts)
        result = np.interp(
            edges,
            np.stack([left, right], 1).ravel(),
            np.stack([cumulative - counts, cumulative], 1).ravel(),
            left=0.0,
        )
        result[0], result[-1] = (
            (0.0 if edges[0] <= self.min_value else result[0]),
            (float(cumulative[-1]) if edges[-1] >= self.max_value else result[-1]),
        )
        return np.rint(result)
