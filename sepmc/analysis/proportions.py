"""Exact binomial inference: intervals of probabilities, requirement tests, ranks of percentiles.

A requirement states that at least a given fraction of all possible cases satisfies it; the
confidence with which this must be shown is 1 minus the consumer risk. Method: Hanson and Beard,
NASA/TP-2010-216447, sections 3 and 4; intervals: Clopper and Pearson, Biometrika 26 (1934) 404;
differences of two probabilities: Newcombe, Statistics in Medicine 17 (1998) 873 and 2635.

`scipy.stats.binomtest` finds the same intervals by root search, to 1e-5 and 20 times slower, and
`quantile_test` the same ranks from the values; both import scipy.stats, which takes 1 s.
"""

import math
from functools import lru_cache

import numpy as np

CONFIDENCE = 0.95  # of printed intervals, unless a requirement sets its own


def raised(confidence: float, looks: int) -> float:
    """Return the confidence that each of ``looks`` intervals needs for all of them together to be
    right with the probability ``confidence`` (Bonferroni)."""
    return 1.0 - (1.0 - confidence) / looks


def binomial_cdf(k: int, n: int, p: float) -> float:
    """Return BinCDF(k; n, p), the probability of at most k successes in n trials, each of which
    succeeds with probability p; ``k`` must be at least -1, for which it is 0."""
    from scipy.special import betainc  # noqa: PLC0415  (0.6 s, which most runs do not need)

    return 1.0 if k >= n else float(betainc(n - k, k + 1.0, 1.0 - p))


def binomial_interval(k: int, n: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the two-sided Clopper-Pearson interval of a probability.

    Parameters
    ----------
    k, n : int
        Successes and trials; 0 <= k <= n, n >= 1.
    confidence : float, 0 < confidence < 1
        Smallest probability that such intervals contain the true value.

    Returns
    -------
    low, high : float
        Exactly 0 and 1 at k = 0 and k = n.
    """
    risk = (1.0 - confidence) / 2.0
    return _lower(k, n, risk), _upper(k, n, risk)


def difference_interval(k_one: int, n_one: int, k_two: int, n_two: int) -> tuple[float, float]:
    """Return the 95 % interval of the second probability minus the first, from independent samples.

    Parameters
    ----------
    k_one, n_one, k_two, n_two : int
        Successes and trials of the first and of the second sample; at least one trial each.

    Returns
    -------
    low, high : float
        Newcombe's interval, from those of Clopper and Pearson. Its coverage is at least 94 % from
        ten trials each and 92.5 % from five (all 2 x 2 tables enumerated).
    """
    return _newcombe_interval((k_two, n_two), (k_one, n_one), 0.0)


def paired_interval(second_only: int, first_only: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of the second probability minus the first, from paired trials.

    Parameters
    ----------
    second_only, first_only, n : int
        Pairs of trials with a success in the second trial only, in the first only, and all pairs
        (at least one).

    Returns
    -------
    low, high : float
        The interval excludes 0 only if McNemar's exact test rejects equality at 5 %. Its coverage
        is at least 95 % from three pairs on (all 2 x 2 tables enumerated).
    """
    p, q, discordant = second_only / n, first_only / n, second_only + first_only
    rest = (1.0 - p) * (1.0 - q)
    low, high = _newcombe_interval(
        (second_only, n), (first_only, n), -math.sqrt(p * q / rest) if rest else 0.0
    )
    if not discordant:
        return low, high
    # interval of the fraction of discordant pairs that met it the second time only
    min_end, max_end = (
        discordant / n * (2.0 * end - 1.0) for end in binomial_interval(second_only, discordant)
    )
    return min(low, min_end), max(high, max_end)


def _newcombe_interval(
    one: tuple[int, int], two: tuple[int, int], correlation: float
) -> tuple[float, float]:
    """Return the 95 % interval of the first minus the second probability, by Newcombe's
    square-and-add method, but from intervals of Clopper and Pearson, not of Wilson; ``one`` and
    ``two`` are (successes, trials), ``correlation`` is that of the two estimates."""
    (p, low, high), (q, min_end, max_end) = (
        (k / n, *binomial_interval(k, n)) for k, n in (one, two)
    )

    def half_width(a: float, b: float) -> float:
        return math.sqrt(a * a + b * b - 2.0 * correlation * a * b)

    return p - q - half_width(p - low, max_end - q), p - q + half_width(high - p, q - min_end)


def upper_bound(k: int, n: int, confidence: float = CONFIDENCE) -> float:
    """Return the one-sided upper confidence bound (Clopper and Pearson) of a probability with k
    successes in n trials: 1 - (1 - confidence)^(1 / n) at k = 0, 1 at k = n."""
    return _upper(k, n, 1.0 - confidence)


def lower_bound(k: int, n: int, confidence: float = CONFIDENCE) -> float:
    """Return the one-sided lower confidence bound (Clopper and Pearson) of a probability with k
    successes in n trials; 0 at k = 0."""
    return _lower(k, n, 1.0 - confidence)


def _lower(k: int, n: int, risk: float) -> float:
    """Return the lower Clopper-Pearson bound of a probability with k successes in n trials, which
    exceeds the probability with at most the one-sided ``risk``."""
    from scipy.special import betaincinv  # noqa: PLC0415

    return 0.0 if k == 0 else float(betaincinv(k, n - k + 1, risk))


def _upper(k: int, n: int, risk: float) -> float:
    """Return the upper Clopper-Pearson bound of a probability with k successes in n trials, which
    is below the probability with at most the one-sided ``risk``."""
    from scipy.special import betaincinv  # noqa: PLC0415

    return 1.0 if k == n else float(betaincinv(k + 1, n - k, 1.0 - risk))


def allowed_violations(n: int, probability: float, confidence: float) -> int:
    """Return the largest number of violating cases with which n cases pass a requirement.

    Parameters
    ----------
    n : int
        Cases run.
    probability : float, 0 < probability < 1
        Fraction of all possible cases that must satisfy the requirement.
    confidence : float, 0 < confidence < 1
        Confidence with which this must be shown.

    Returns
    -------
    k : int
        Largest k with BinCDF(k; n, 1 - probability) <= 1 - confidence; -1 if n cases are too few
        even without a violation.
    """
    risk, low, high = 1.0 - confidence, -1, n
    while high - low > 1:  # BinCDF rises with k
        mid = (low + high) // 2
        low, high = (mid, high) if binomial_cdf(mid, n, 1.0 - probability) <= risk else (low, mid)
    return low


def required_cases(k: int, probability: float, confidence: float) -> int:
    """Return the smallest number of cases that pass a requirement if k of them violate it.

    Parameters
    ----------
    k : int
        Violating cases.
    probability, confidence : float
        As for `allowed_violations`.

    Returns
    -------
    n : int
        Smallest n with BinCDF(k; n, 1 - probability) <= 1 - confidence; for k = 0,
        log(1 - confidence) / log(probability), rounded up.
    """
    risk, low, high = 1.0 - confidence, k, k + 1
    while binomial_cdf(k, high, 1.0 - probability) > risk:  # BinCDF falls with n
        low, high = high, 2 * high
    while high - low > 1:
        mid = (low + high) // 2
        low, high = (low, mid) if binomial_cdf(k, mid, 1.0 - probability) <= risk else (mid, high)
    return high


def design_rank(
    count: int, probability: float, confidence: float, upper: bool, missing: int = 0
) -> int | None:
    """Return the rank of the design value: the value of a case that, as the bound of a requirement,
    the cases would just pass.

    Parameters
    ----------
    count : int
        Number of cases with a value.
    probability, confidence : float
        As for `allowed_violations`.
    upper : bool
        True if values above the bound violate, False if values below it do.
    missing : int
        Further cases without a value, counted as worse than all values.

    Returns
    -------
    int or None
        Index into the values in increasing order; None if there are too few cases.
    """
    allowed_worse = allowed_violations(count + missing, probability, confidence) - missing
    if not 0 <= allowed_worse < count:
        return None
    return count - 1 - allowed_worse if upper else allowed_worse


def order_statistics(values: np.ndarray, ranks: np.ndarray) -> np.ndarray:
    """Return the values (k,) at zero-based ranks (k,) in the increasing order of values (n,), which
    need not be sorted."""
    return np.partition(values, ranks)[ranks]


@lru_cache(maxsize=256)
def percentile_ranks(n: int, probability: float, confidence: float = CONFIDENCE) -> tuple[int, int]:
    """Return the ranks of the two sample values that bound a percentile of the population.

    Parameters
    ----------
    n : int
        Number of values in the sample.
    probability : float, 0 < probability < 1
        The percentile as a fraction.
    confidence : float
        Probability that the percentile lies between the two values.

    Returns
    -------
    low, high : int
        Zero-based ranks. For any continuous distribution the percentile lies below the lower value,
        or above the upper one, with a probability of at most (1 - confidence) / 2 each. -1 or n
        where no value of the sample is such a bound.
    """
    risk = (1.0 - confidence) / 2.0
    return _last_rank_within(n, probability, risk), n - 1 - _last_rank_within(
        n, 1.0 - probability, risk
    )


def _last_rank_within(n: int, probability: float, risk: float) -> int:
    """Return the largest r with BinCDF(r; n, probability) <= risk, -1 if there is none.

    It sums the terms near the mean with numpy, as every run needs it and scipy takes long to
    import.
    """
    half_window = 40.0 + 10.0 * math.sqrt(n * probability * (1.0 - probability))
    first, last = (
        max(0, int(n * probability - half_window)),
        min(n, int(n * probability + half_window)),
    )
    log_odds = math.log(probability) - math.log1p(-probability)
    k = np.arange(first, last)
    log_first = math.lgamma(n + 1) - math.lgamma(first + 1) - math.lgamma(n - first + 1)
    log_first += first * math.log(probability) + (n - first) * math.log1p(-probability)
    log_terms = log_first + np.concatenate(
        [[0.0], np.cumsum(np.log((n - k) / (k + 1.0)) + log_odds)]
    )
    return first + int(np.count_nonzero(np.cumsum(np.exp(log_terms)) <= risk)) - 1
