"""What so many cases show of a probability: exact statements of the binomial law.

A requirement asks that a share of all cases holds, with a confidence; its complement is the
consumer risk. Method: Hanson and Beard, NASA/TP-2010-216447, sections 3 and 4; intervals: Clopper
and Pearson, Biometrika 26 (1934) 404. Differences of two probabilities: from the intervals of both
(Newcombe, Statistics in Medicine 17 (1998) 873 and 2635).
"""

import math
from functools import lru_cache

import numpy as np

CONFIDENCE = 0.95  # of what is printed unless a requirement has its own


def binomial_cdf(k: int, n: int, p: float) -> float:
    """BinCDF(k; n, p): probability that at most k of n cases meet what one does with p."""
    from scipy.special import betainc  # noqa: PLC0415  (0.6 s, which most runs do not need)

    return 1.0 if k >= n else float(betainc(n - k, k + 1.0, 1.0 - p))


def binomial_interval(k: int, n: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Two-sided interval of a probability that was met k times in n cases.

    Parameters
    ----------
    k, n : int
        Cases that met it, and all; 0 <= k <= n, n >= 1.
    confidence : float, 0 < confidence < 1
        Probability with which such intervals hold the true value, at least.

    Returns
    -------
    low, high : float
        The ends: 0 exactly if no case met it, 1 exactly if all did. Clopper-Pearson.
    """
    risk = (1.0 - confidence) / 2.0
    return _lower(k, n, risk), _upper(k, n, risk)


def difference_interval(k_one: int, n_one: int, k_two: int, n_two: int) -> tuple[float, float]:
    """95 % interval of how much larger a second probability is than a first, each met k times in n
    cases of its own. Holds it with 94 % at least from ten cases of each on, 92.5 % from five (all
    tables enumerated)."""
    return _square_and_add((k_two, n_two), (k_one, n_one), 0.0)


def paired_interval(gained: int, lost: int, n: int) -> tuple[float, float]:
    """95 % interval of how much larger the second of two probabilities is, from pairs.

    Parameters
    ----------
    gained, lost, n : int
        Pairs of which the second alone met it, the first alone, and all; gained + lost <= n.

    Returns
    -------
    low, high : float
        Without 0 only if McNemar's exact test, of 5 %, tells the two probabilities apart. Holds the
        difference with 95 % at least from three pairs on (all tables enumerated).
    """
    p, q, apart = gained / n, lost / n, gained + lost
    rest = (1.0 - p) * (1.0 - q)
    low, high = _square_and_add((gained, n), (lost, n), -math.sqrt(p * q / rest) if rest else 0.0)
    if not apart:
        return low, high
    # of the pairs that differ, given how many these are
    least, most = (apart / n * (2.0 * end - 1.0) for end in binomial_interval(gained, apart))
    return min(low, least), max(high, most)


def _square_and_add(
    one: tuple[int, int], two: tuple[int, int], correlation: float
) -> tuple[float, float]:
    """95 % interval of the difference of the first probability less the second, from those of both
    and the correlation of their estimates."""
    (p, low, high), (q, least, most) = ((k / n, *binomial_interval(k, n)) for k, n in (one, two))

    def reach(a: float, b: float) -> float:
        return math.sqrt(a * a + b * b - 2.0 * correlation * a * b)

    return p - q - reach(p - low, most - q), p - q + reach(high - p, q - least)


def upper_bound(k: int, n: int, confidence: float = CONFIDENCE) -> float:
    """What a probability that was met k times in n cases does not exceed, with a confidence:
    one-sided, so that 0 of n reads 1 - (1 - confidence)^(1 / n)."""
    return _upper(k, n, 1.0 - confidence)


def lower_bound(k: int, n: int, confidence: float = CONFIDENCE) -> float:
    """What a probability that was met k times in n cases does not fall below, with a confidence."""
    return _lower(k, n, 1.0 - confidence)


def _lower(k: int, n: int, risk: float) -> float:
    from scipy.special import betaincinv  # noqa: PLC0415

    return 0.0 if k == 0 else float(betaincinv(k, n - k + 1, risk))


def _upper(k: int, n: int, risk: float) -> float:
    from scipy.special import betaincinv  # noqa: PLC0415

    return 1.0 if k == n else float(betaincinv(k + 1, n - k, 1.0 - risk))


def allowed_violations(n: int, share: float, confidence: float) -> int:
    """Violations with which n cases still show a requirement.

    Parameters
    ----------
    n : int
        Cases.
    share : float, 0 < share < 1
        Of all cases that must hold.
    confidence : float, 0 < confidence < 1

    Returns
    -------
    k : int
        The largest k with BinCDF(k; n, 1 - share) <= 1 - confidence; -1 if n cases are too few to
        show it even without a violation.
    """
    risk, low, high = 1.0 - confidence, -1, n
    while high - low > 1:  # BinCDF rises with k
        middle = (low + high) // 2
        low, high = (
            (middle, high) if binomial_cdf(middle, n, 1.0 - share) <= risk else (low, middle)
        )
    return low


def required_cases(k: int, share: float, confidence: float) -> int:
    """Cases that show a requirement in spite of k violations: the smallest n with BinCDF(k; n, 1 -
    share) <= 1 - confidence. For k = 0, log(1 - confidence) / log(share)."""
    risk, low, high = 1.0 - confidence, k, k + 1
    while binomial_cdf(k, high, 1.0 - share) > risk:  # BinCDF falls with n
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (
            (low, middle) if binomial_cdf(k, middle, 1.0 - share) <= risk else (middle, high)
        )
    return high


def design_rank(
    count: int, share: float, confidence: float, upper: bool, missing: int = 0
) -> int | None:
    """Place of the `design_value` among so many rising values, if ``missing`` more cases are worse
    than all of them; None if there is none."""
    worse = allowed_violations(count + missing, share, confidence) - missing
    if not 0 <= worse < count:
        return None
    return count - 1 - worse if upper else worse


def order_statistics(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values at places (k,) among all (n,), rising, from 0."""
    return np.partition(values, places)[places]


@lru_cache(maxsize=256)
def percentile_ranks(n: int, share: float, confidence: float = CONFIDENCE) -> tuple[int, int]:
    """Places of the two order statistics that hold a percentile between them.

    Parameters
    ----------
    n : int
        Values.
    share : float, 0 < share < 1
        The percentile, as a share.
    confidence : float

    Returns
    -------
    low, high : int
        Places among the rising values, from 0: each end is missed with at most half of 1 -
        confidence, whatever the (continuous) law. -1 and n where there is no such value.
    """
    risk = (1.0 - confidence) / 2.0
    return _last_within(n, share, risk), n - 1 - _last_within(n, 1.0 - share, risk)


def _last_within(n: int, share: float, risk: float) -> int:
    """The largest r with BinCDF(r; n, share) <= risk, -1 if there is none: by sums of the law's
    probabilities about its mean, for which numpy does, as every run needs it."""
    spread = 40.0 + 10.0 * math.sqrt(n * share * (1.0 - share))
    first, last = max(0, int(n * share - spread)), min(n, int(n * share + spread))
    odds = math.log(share) - math.log1p(-share)
    k = np.arange(first, last)
    start = math.lgamma(n + 1) - math.lgamma(first + 1) - math.lgamma(n - first + 1)
    start += first * math.log(share) + (n - first) * math.log1p(-share)
    logs = start + np.concatenate([[0.0], np.cumsum(np.log((n - k) / (k + 1.0)) + odds)])
    return first + int(np.count_nonzero(np.cumsum(np.exp(logs)) <= risk)) - 1
