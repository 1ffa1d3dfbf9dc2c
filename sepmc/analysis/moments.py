"""Mean, sigma, their standard errors and the extremes of values that pass by once."""

from typing import NamedTuple

import numpy as np

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars


class Group(NamedTuple):
    """What is known of ``n`` values: the extremes with their cases, the sum of those that are
    infinite, and of the others, how many there are, their mean and sums of the powers 2 to 4 of
    their distance from it, over ``scale``."""

    n: int
    least: float
    case_least: int
    greatest: float
    case_greatest: int
    infinite: float
    finite: int
    scale: float
    mean: float
    powers: tuple[float, float, float]

    @classmethod
    def of(cls, x: np.ndarray, numbers: np.ndarray) -> "Group":
        """Of values without NaN, shape (n,), n > 0, and the numbers of their cases, rising."""
        low, high = x.argmin(), x.argmax()
        least, greatest, n, infinite = float(x[low]), float(x[high]), x.size, 0.0
        ends = least, int(numbers[low]), greatest, int(numbers[high])
        if np.isinf(least) or np.isinf(greatest):
            with np.errstate(invalid="ignore"):
                infinite = float(x[np.isinf(x)].sum())
            x = x[np.isfinite(x)]
            if not x.size:
                return cls(n, *ends, infinite, 0, 0.0, 0.0, (0.0, 0.0, 0.0))
            least, greatest = float(x.min()), float(x.max())
        scale, mean = greatest - least or max(abs(least), 1.0), float(x.mean())
        d = (x - mean) / scale
        q = d * d
        # einsum, as a dot product of so many wakes the threads of BLAS, which then fight with those
        # that fly: 100 times slower
        powers = float(q.sum()), float(np.einsum("i,i", q, d)), float(np.einsum("i,i", q, q))
        return cls(n, *ends, infinite, x.size, scale, mean, powers)


class GroupList(list[Group]):
    """Groups of the values of one outcome, for `Moments` to take one after the other."""

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """As `Moments.add`."""
        if x.size:
            self.append(Group.of(x, numbers))


class Moments:
    """First four moments and the extremes, with their cases, of the values of one outcome.

    Sums of powers are taken about the mean of each group and merged (Pebay, SAND2008-6212), in
    units of the first group's span: no digits are lost where the mean is large beside sigma, and
    the fourth power neither overflows nor underflows. Equal groups give equal bits.
    """

    def __init__(self) -> None:
        self.n = 0
        self.least, self.greatest = np.inf, -np.inf
        self.case_least = self.case_greatest = -1
        # sum of the values that are infinite: they have no moments but must stay visible
        self._infinite = 0.0
        self._count = 0
        self._scale = self._mean = self._m2 = self._m3 = self._m4 = 0.0

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Take a group of values without NaN, shape (n,), and the numbers of their cases,
        rising."""
        if x.size:
            self.merge(Group.of(x, numbers))

    def merge(self, group: Group) -> None:
        """Take a group whose cases come next."""
        self.n += group.n
        if group.least < self.least or self.case_least < 0:
            self.least, self.case_least = group.least, group.case_least
        if group.greatest > self.greatest or self.case_greatest < 0:
            self.greatest, self.case_greatest = group.greatest, group.case_greatest
        with np.errstate(invalid="ignore"):
            self._infinite += group.infinite
        if not group.finite:
            return
        if self._scale == 0.0:
            self._scale = group.scale
        share, (m2, m3, m4) = group.scale / self._scale, group.powers
        self._combine(
            group.finite, group.mean / self._scale, m2 * share**2, m3 * share**3, m4 * share**4
        )

    def _combine(self, n: int, mean: float, m2: float, m3: float, m4: float) -> None:
        """Equations (3.1) of Pebay for two groups."""
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
        """What it holds, for `restore`."""
        return [scalars(self)]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held."""
        set_scalars(self, next(arrays))

    def row(self) -> dict[str, float]:
        """n, mean, sigma, min, max, mean_se, sigma_se, case_min and case_max; see
        `sepmc.analysis.statistics.statistics`."""
        if self.n == 0:
            return {"n": 0}
        row = {
            "n": self.n,
            "min": self.least,
            "max": self.greatest,
            "case_min": self.case_least,
            "case_max": self.case_greatest,
        }
        if self._infinite != 0.0:  # NaN too: infinities of both signs
            return row | {"mean": self._infinite}
        if self.n == 1:
            return row | {"mean": self.least}
        if self.least == self.greatest:
            return row | {"mean": self.least, "sigma": 0.0, "mean_se": 0.0, "sigma_se": 0.0}
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
