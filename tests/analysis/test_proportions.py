"""Binomial inference against sums of the binomial distribution, published tables and repeated
sampling."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom

from sepmc.analysis.proportions import (
    allowed_violations,
    binomial_interval,
    design_rank,
    order_statistics,
    percentile_ranks,
    required_cases,
    upper_bound,
)

ALL = 200  # sample sizes up to this are compared with sums
# Cases needed with so many violations: recomputed for the rule of Hanson and Beard
KNOWN = {
    (0.9973, 0.90): {0: 852, 1: 1440, 2: 1970, 3: 2473, 4: 2959, 5: 3433, 10: 5704},
    (0.9973, 0.95): {0: 1109, 1: 1756, 2: 2330, 3: 2870, 4: 3388, 5: 3891, 10: 6279},
    (0.99865, 0.90): {0: 1705, 1: 2880, 2: 3941, 3: 4947, 4: 5920, 5: 6868, 10: 11410},
    (0.999, 0.90): {0: 2302, 1: 3889, 2: 5321, 3: 6679, 4: 7992, 5: 9273, 10: 15404},
    (0.99, 0.90): {0: 230, 1: 388, 2: 531, 3: 667, 4: 798, 5: 926, 10: 1538},
    (0.95, 0.95): {0: 59, 1: 93, 2: 124, 3: 153, 4: 181, 5: 208, 10: 336},
}
REPEATS = 1000


def cumulative(n, p):
    """BinCDF(k; n, p) for k from 0 to n, as sums."""
    return np.array(
        [
            math.fsum(math.comb(n, j) * p**j * (1.0 - p) ** (n - j) for j in range(k + 1))
            for k in range(n + 1)
        ]
    )


@pytest.mark.parametrize(("share", "confidence"), [(0.95, 0.9), (0.9, 0.95), (0.6, 0.5)])
def test_allowed_and_needed_against_sums(share, confidence):
    for n in range(1, ALL + 1):
        k = int(np.count_nonzero(cumulative(n, 1.0 - share) <= 1.0 - confidence)) - 1
        assert allowed_violations(n, share, confidence) == k
        if k >= 0:
            assert (
                required_cases(k, share, confidence) <= n < required_cases(k + 1, share, confidence)
            )


@pytest.mark.parametrize(("share", "confidence"), KNOWN)
def test_needed_as_published(share, confidence):
    for k, n in KNOWN[share, confidence].items():
        assert required_cases(k, share, confidence) == n
        assert (
            allowed_violations(n, share, confidence),
            allowed_violations(n - 1, share, confidence),
        ) == (k, k - 1)


def test_more_cases_than_a_number_of_32_bits():
    """For a billionth, log(0.1) / log(1 - 1e-9)."""
    assert required_cases(0, 1.0 - 1e-9, 0.9) == pytest.approx(
        math.log(0.1) / math.log1p(-1e-9), rel=1e-7
    )
    many = required_cases(300, 1.0 - 1e-7, 0.9)
    assert allowed_violations(many, 1.0 - 1e-7, 0.9) == 300


def test_interval_against_sums():
    """Each end is the probability at which so many, or so few, have 2.5 %."""
    for n in (1, 2, 7, 59, ALL):
        for k in {0, 1, n // 3, n - 1, n}:
            low, high = binomial_interval(k, n)
            if k > 0:
                assert_allclose(1.0 - cumulative(n, low)[k - 1], 0.025, rtol=1e-9)
            if k < n:
                assert_allclose(cumulative(n, high)[k], 0.025, rtol=1e-9)
            assert (low == 0.0, high == 1.0) == (k == 0, k == n)


def test_none_of_so_many():
    """0 of 5,000 is less than 6.0e-4 with 95 %."""
    assert_allclose(upper_bound(0, 5000), 1.0 - 0.05 ** (1.0 / 5000.0), rtol=1e-12)
    assert f"{upper_bound(0, 5000):.1e}" == "6.0e-04"
    assert upper_bound(5, 5) == 1.0


@pytest.mark.parametrize("p", [0.003, 0.1, 0.5])
def test_coverage_of_intervals(p):
    """Of 1,000 intervals at most as many miss as they may, and two standard errors."""
    n, random = 400, np.random.default_rng(3)
    missed = sum(
        not low <= p <= high
        for low, high in (binomial_interval(int(k), n) for k in random.binomial(n, p, REPEATS))
    )
    assert missed / REPEATS <= 0.05 + 2.0 * math.sqrt(0.05 * 0.95 / REPEATS)


@pytest.mark.parametrize(("n", "share"), [(200, 0.5), (500, 0.95), (2000, 0.00135)])
def test_coverage_of_percentiles(n, share):
    """A percentile of a law, between the order statistics that are to hold it."""
    low, high = percentile_ranks(n, share)
    values = np.sort(np.random.default_rng(5).random((REPEATS, n)), axis=1)  # its percentile: share
    under = share < values[:, low] if low >= 0 else np.zeros(REPEATS, dtype=bool)
    over = share > values[:, high] if high < n else np.zeros(REPEATS, dtype=bool)
    for missed in (under, over):
        assert missed.mean() <= 0.025 + 2.0 * math.sqrt(0.025 * 0.975 / REPEATS)
    below = cumulative(n, share) if n <= ALL else None
    if below is not None:
        assert below[low] <= 0.025 < below[low + 1]


@pytest.mark.parametrize("share", [0.00135, 0.05, 0.5, 0.99, 0.99865])
def test_places_of_percentiles_against_the_law(share):
    """Each end misses with at most 2.5 %, and the next place with more: by scipy."""
    for n in (1, 2, 59, 200, 741, 10_000, 3_000_000):
        low, high = percentile_ranks(n, share)
        assert binom.cdf(low, n, share) <= 0.025 < binom.cdf(low + 1, n, share)
        assert binom.sf(high, n, share) <= 0.025 < binom.sf(high - 1, n, share)


def design_value(values, probability, confidence, upper=True):
    rank = design_rank(len(values), probability, confidence, upper)
    return math.nan if rank is None else float(order_statistics(values, np.array([rank]))[0])


def test_design_value():
    """With 10,000 cases the 20th largest bounds 99.73 % with 90 %, with 2,000 the third largest;
    with 800 there is none. Of 1,000 samples at most a tenth, and two standard errors, are below the
    true one."""
    values = np.random.default_rng(1).permutation(10_000).astype(float)
    assert design_value(values, 0.9973, 0.9) == 10_000 - 20
    assert design_value(values, 0.9973, 0.9, upper=False) == 19
    assert design_value(np.arange(2000.0), 0.9973, 0.9) == 1997.0
    assert math.isnan(design_value(np.arange(800.0), 0.9973, 0.9))
    samples = np.random.default_rng(2).random((REPEATS, 500))
    short = np.mean([design_value(sample, 0.99, 0.9) < 0.99 for sample in samples])
    assert short <= 0.1 + 2.0 * math.sqrt(0.09 / REPEATS)
