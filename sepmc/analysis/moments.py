"""Mean, sigma, their standard errors and the extremes of values that pass by once."""

import numpy as np


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
        if not x.size:
            return
        self.n += x.size
        low, high = x.argmin(), x.argmax()
        least, greatest = float(x[low]), float(x[high])
        if least < self.least or self.case_least < 0:
            self.least, self.case_least = least, int(numbers[low])
        if greatest > self.greatest or self.case_greatest < 0:
            self.greatest, self.case_greatest = greatest, int(numbers[high])
        if np.isinf(least) or np.isinf(greatest):
            with np.errstate(invalid="ignore"):
                self._infinite += float(x[np.isinf(x)].sum())
            x = x[np.isfinite(x)]
            if not x.size:
                return
        if self._scale == 0.0:
            self._scale = float(np.ptp(x)) or max(abs(least), 1.0)
        mean = float(x.mean())
        d = (x - mean) / self._scale
        q = d * d
        # einsum, as a dot product of so many wakes the threads of BLAS, which then fight with those
        # that fly: 100 times slower
        self._merge(
            x.size,
            mean / self._scale,
            float(q.sum()),
            float(np.einsum("i,i", q, d)),
            float(np.einsum("i,i", q, q)),
        )

    def _merge(self, n: int, mean: float, m2: float, m3: float, m4: float) -> None:
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
