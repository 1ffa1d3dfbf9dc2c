"""Single-pass mean and sigma of an outcome, their standard errors, and its extremes."""

from typing import NamedTuple

import numpy as np

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars


class Group(NamedTuple):
    """Moments of a group of ``n`` values of an outcome, at least one and none of them NaN.

    ``case_min`` and ``case_max`` are the first cases with the extremes ``min_value`` and
    ``max_value``, which may be infinite; ``infinite`` is the sum of the infinite values: 0 if there
    are none, NaN if they have both signs. ``finite`` is the number of finite values and ``mean``
    their mean, in the unit of the values. ``powers`` are the sums of the second, third and fourth
    powers of their deviations from the mean, divided by ``scale``: their range or, if that is 0,
    their size, at least 1. Without finite values, ``scale``, ``mean`` and ``powers`` are 0.
    """

    n: int
    min_value: float
    case_min: int
    max_value: float
    case_max: int
    infinite: float
    finite: int
    scale: float
    mean: float
    powers: tuple[float, float, float]

    @classmethod
    def of(cls, x: np.ndarray, numbers: np.ndarray) -> "Group":
        """Build a group from values (n,), n > 0, without NaN, and their case numbers in increasing
        order."""
        low, high = x.argmin(), x.argmax()
        min_value, max_value, n, infinite = float(x[low]), float(x[high]), x.size, 0.0
        ends = min_value, int(numbers[low]), max_value, int(numbers[high])
        if np.isinf(min_value) or np.isinf(max_value):
            with np.errstate(invalid="ignore"):
                infinite = float(x[np.isinf(x)].sum())
            x = x[np.isfinite(x)]
            if not x.size:
                return cls(n, *ends, infinite, 0, 0.0, 0.0, (0.0, 0.0, 0.0))
            min_value, max_value = float(x.min()), float(x.max())
        scale, mean = max_value - min_value or max(abs(min_value), 1.0), float(x.mean())
        d = (x - mean) / scale
        q = d * d
        # einsum: a dot product of this length starts BLAS threads, which compete with those of the
        # kernel: 100 times slower
        powers = float(q.sum()), float(np.einsum("i,i", q, d)), float(np.einsum("i,i", q, q))
        return cls(n, *ends, infinite, x.size, scale, mean, powers)


class GroupList(list[Group]):
    """Groups of values of one outcome, to be merged into a `Moments` in this order."""

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Append the group of values (n,), which must not contain NaN, and their case numbers (n,),
        in increasing order; nothing if there are no values."""
        if x.size:
            self.append(Group.of(x, numbers))


class Moments:
    """Accumulator of the first four moments and of the extremes of one outcome, with their cases.

    Sums of powers are taken about the mean of each group and merged (Pebay, SAND2008-6212), in
    units of the first group's range: no digits are lost where the mean is large compared with
    sigma, and the fourth power neither overflows nor underflows. The same groups in the same order
    give the same bits. ``n`` is the number of values, ``min_value`` and ``max_value`` are the
    extremes (inf and -inf without values), and ``case_min`` and ``case_max`` the first cases that
    have them (-1 without values).
    """

    def __init__(self) -> None:
        self.n = 0
        self.min_value, self.max_value = np.inf, -np.inf
        self.case_min = self.case_max = -1
        # sum of the infinite values, which have no moments but must show in the mean
        self._infinite = 0.0
        self._count = 0
        self._scale = self._mean = self._m2 = self._m3 = self._m4 = 0.0

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Add a group of values (n,), which must not contain NaN, and their case numbers (n,), in
        increasing order and above those already added."""
        if x.size:
            self.merge(Group.of(x, numbers))

    def merge(self, group: Group) -> None:
        """Add a group, whose case numbers must be above those already added."""
        self.n += group.n
        if group.min_value < self.min_value or self.case_min < 0:
            self.min_value, self.case_min = group.min_value, group.case_min
        if group.max_value > self.max_value or self.case_max < 0:
            self.max_value, self.case_max = group.max_value, group.case_max
        with np.errstate(invalid="ignore"):
            self._infinite += group.infinite
        if not group.finite:
            return
        if self._scale == 0.0:
            self._scale = group.scale
        ratio, (m2, m3, m4) = group.scale / self._scale, group.powers
        self._combine(
            group.finite, group.mean / self._scale, m2 * ratio**2, m3 * ratio**3, m4 * ratio**4
        )

    def _combine(self, n: int, mean: float, m2: float, m3: float, m4: float) -> None:
        """Add ``n`` finite values by equations (3.1) of Pebay: ``mean`` is their mean, and ``m2``,
        ``m3`` and ``m4`` are the sums of the powers 2 to 4 of their deviations from it, all in
        units of ``_scale``."""
        a, both = self._count, self._count + n
        if a == 0:
            self._count, self._mean, self._m2, self._m3, self._m4 = n, mean, m2, m3, m4
            return
        delta = (mean - self._mean) / both
        m4 += self._m4 + a * n * both * (a * a - a * n + n * n) * delta**4
        m4 += 6.0 * delta * delta * (a * a * m2 + n * n * self._m2) + 4.0 * delta * (
            a * m3 - n * self._m3
        )
        m3 += self._m3 + a * n * both * (a - n) * delta**3 + 3.0 * delta * (a * m2 - n * self._m2)
        m2 += self._m2 + a * n * both * delta * delta
        self._count, self._mean, self._m2, self._m3, self._m4 = (
            both,
            self._mean + delta * n,
            m2,
            m3,
            m4,
        )

    def state(self) -> list[np.ndarray]:
        """Return what was accumulated so far as float arrays, which `restore` takes."""
        return [scalars(self)]

    def restore(self, arrays: Arrays) -> None:
        """Replace what was accumulated by the array of `state`, the next one of the iterator
        ``arrays``. Raises ValueError if it has another length or no number where a count is
        expected (`set_scalars`), and StopIteration if there is no array left."""
        set_scalars(self, next(arrays))

    def row(self) -> dict[str, float]:
        """Return n, mean, sigma, min, max, mean_se, sigma_se, case_min and case_max by these names,
        as in the table of `sepmc.analysis.statistics.statistics`. Numbers that the values do not
        determine (such as a sigma of one value) are absent. With infinite values, the mean is
        infinite, or NaN if there are both signs, and sigma and standard errors are absent."""
        if self.n == 0:
            return {"n": 0}
        row = {
            "n": self.n,
            "min": self.min_value,
            "max": self.max_value,
            "case_min": self.case_min,
            "case_max": self.case_max,
        }
        if self._infinite != 0.0:  # NaN too: infinities of both signs
            return row | {"mean": self._infinite}
        if self.n == 1:
            return row | {"mean": self.min_value}
        if self.min_value == self.max_value:
            return row | {"mean": self.min_value, "sigma": 0.0, "mean_se": 0.0, "sigma_se": 0.0}
        n, scale = self.n, self._scale
        variance = self._m2 / (n - 1)
        sigma = np.sqrt(variance)
        bracket = (self._m4 / n - (n - 3) / (n - 1) * variance**2) / n
        return row | {
            "mean": self._mean * scale,
            "sigma": sigma * scale,
            "mean_se": sigma * scale / np.sqrt(n),
            "sigma_se": np.sqrt(max(bracket, 0.0)) / (2.0 * sigma) * scale,
        }
