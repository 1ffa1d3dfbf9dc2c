"""First-order and total variance indices, by estimators valid for the sampler and the input.

The first-order index S of an input X for an outcome Y is Var(E[Y | X]) / Var(Y). For independent
cases it follows from the residual variance: cases are sorted by the input (ties in random order),
half the mean square difference of outcomes k positions apart is extrapolated to k = 0 (Tong and
Wang, Biometrika 92, 2005), and the interval follows from the influence function
2 f Y - f^2 - S Y^2 with f = E[Y | X] (Da Veiga and Gamboa, J. Nonparametric Statistics 25, 2013).

A Saltelli design consists of groups of d + 2 cases for d inputs: the first and the last case are
independent, and each case between them has the inputs of the first, except one from the last.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sepmc.analysis.statistics import student_half_width
from sepmc.scene.model import REPLICATES, SALTELLI

PLAN, LHS, SOBOL = "plan", "lhs", "sobol"
BY_ROWS, BY_GROUPS, NONE = "rows", "groups", ""


class ValidEstimator(NamedTuple):
    """Estimator of indices that is valid for the cases of a sampler.

    ``first`` is `BY_ROWS` (first-order indices from independent cases), `BY_GROUPS` (first-order
    and total indices from a Saltelli design) or `NONE`; ``note`` is a sentence for the user on the
    limitations, empty if there are none.
    """

    first: str
    note: str = ""


PATTERNED = (
    "first-order indices are not given: {what} is patterned, and an input without effect can "
    "appear to have that of two others together; use run.sampler random, lhs or saltelli"
)
# Coverage of 95 % intervals: python tests/measure/sensitivity.py
ESTIMATORS: Mapping[str, ValidEstimator] = {
    "random": ValidEstimator(BY_ROWS),
    LHS: ValidEstimator(
        BY_ROWS, "sampler lhs: intervals of indices are those of random cases, at least 95 %"
    ),
    PLAN: ValidEstimator(
        BY_ROWS, "run.samples: intervals of indices hold if its rows are independent cases"
    ),
    SOBOL: ValidEstimator(NONE, PATTERNED.format(what="a Sobol sequence")),
    SALTELLI: ValidEstimator(BY_GROUPS),
}
# Largest fourth cumulant of an outcome (less the means of its groups) over its squared variance and
# over n with which intervals are given: the coverage of 95 % intervals is 92 % and more, above it
# 70 to 91 % (tests/measure/sensitivity.py)
MAX_TAIL = 0.01
# samplers of dependent cases, for which tests of counts are invalid
PATTERNS = (SOBOL, SALTELLI)
MAX_LEFT_OUT = 0.05  # largest fraction of incomplete groups of a Saltelli design
_LAG_LIMITS, _LAGS_PER_ROOT = (4, 64), 0.5  # limits of the largest lag; lag over sqrt(n)


def ordered_index(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the first-order index of an input of many values, and the half-width of its 95 %
    interval.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Input and outcome of independent cases, in any order; both finite, and the outcome varies.

    Returns
    -------
    index, half_width : float
        The interval is ``index`` plus and minus ``half_width``.
    """
    n = len(y)
    y = _standard(y[_order(x, y)])
    max_lag = int(np.clip(round(_LAGS_PER_ROOT * np.sqrt(n)), *_LAG_LIMITS))
    squares = np.concatenate(([0.0], np.cumsum(y * y)))
    differences = np.array(
        [
            (squares[n] - squares[k] + squares[n - k] - 2.0 * (y[k:] @ y[:-k])) / (2.0 * (n - k))
            for k in range(1, max_lag + 1)
        ]
    )
    line, parabola = _lag_weights(max_lag)
    index = 1.0 - float(line @ differences)
    mean = _neighbour_mean(y, max_lag)
    residual = (y - mean) ** 2
    # squared residual variance, valid where it varies
    fourth = float(np.mean(residual[1:] * residual[:-1]))
    curvature, weights = float((parabola - line) @ differences), parabola - line
    bias = max(curvature**2 - 4.0 * fourth * float(weights @ weights) / n, 0.0)
    influence = 2.0 * mean * y - mean**2 - index * y * y
    chance_variance = fourth * float(line @ line) / n + bias
    # minus the variance that chance in the mean of neighbours adds to the influence
    return index, _half_width(influence, 2.0 * fourth / max_lag, chance_variance)


@lru_cache(maxsize=2)  # all inputs of a run have the same lags
def _lag_weights(max_lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (max_lag,) of values at the lags 1 to ``max_lag`` in the values at lag 0
    of a line and of a parabola through them."""
    lags = np.arange(1.0, max_lag + 1.0)
    line, parabola = (np.linalg.pinv(np.vander(lags, k, increasing=True))[0] for k in (2, 3))
    return line, parabola


def grouped_index(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the first-order index of an input ``x`` (n,) of few values for an outcome ``y`` (n,),
    and the half-width of its 95 % interval.

    The index is epsilon squared: the fraction of variance between the groups of cases of equal
    input, corrected for chance (Kelley, PNAS 21, 1935). The cases are independent, the outcome is
    finite and varies, and there are fewer groups than cases.
    """
    n, group, y = len(y), np.unique(x, return_inverse=True)[1], _standard(y)
    size = np.bincount(group)
    mean = np.bincount(group, y) / size
    within = np.bincount(group, (y - mean[group]) ** 2)
    pooled = float(within.sum()) / (n - len(size))
    index = 1.0 - pooled
    # the variance of a small group is at least the pooled one
    fourth = float(np.sum(np.maximum(within / size, pooled) ** 2))
    case_mean = mean[group]
    influence = 2.0 * case_mean * y - case_mean**2 - index * y * y
    chance_variance = 2.0 * fourth * (1.0 - 1.0 / len(size)) / n**2
    return index, _half_width(influence, 4.0 * fourth / n, chance_variance)


def independent_rows(cases: Mapping[str, np.ndarray], inputs: int, sampler: str) -> np.ndarray:
    """Return the mask (n,) of cases that are independent of one another: with the ``sampler``
    "saltelli" the first and the last of each group of the design, with any other all cases.
    ``inputs`` is the number of dispersed inputs; rows are numbered from 0 if ``cases`` has no
    column ``case``."""
    count = len(cases["status"])
    if sampler != SALTELLI:
        return np.ones(count, dtype=bool)
    numbers = np.asarray(cases["case"]) if "case" in cases else np.arange(count)
    return np.isin(numbers % (inputs + 2), (0, inputs + 1))


class SaltelliGroups(NamedTuple):
    """Complete groups of a Saltelli design.

    ``outcomes`` (groups, inputs + 2) of their cases: in a group, the first case, then for each
    input the first case with that input of the last one, then the last case, whose inputs are
    independent of those of the first. ``left_out`` is the number of groups left out for a missing
    case or outcome, and ``replicates`` (groups,) the index of the independently scrambled sequence
    from which each group is.
    """

    outcomes: np.ndarray
    left_out: int
    replicates: np.ndarray


def saltelli_groups(numbers: np.ndarray, x: np.ndarray, y: np.ndarray) -> SaltelliGroups:
    """Return the outcomes of the complete groups of a Saltelli design: those with the rows of all
    their cases, each of which has the outcome.

    Parameters
    ----------
    numbers : ndarray, shape (n,), int
        Case numbers, which determine the group of a case and its place in it.
    x : ndarray, shape (inputs, n)
        All dispersed inputs, only compared within each group.
    y : ndarray, shape (n,)
        An outcome, NaN where a case does not have it.

    Raises
    ------
    ValueError
        If the inputs are not those of such a design, no group has all rows, more than 5 % of those
        that have them lack the outcome in a case, or a sequence has no complete group.
    """
    size = len(x) + 2
    order = np.argsort(numbers, kind="stable")
    group = numbers[order] // size
    whole_groups = np.isin(group, np.unique(group)[np.unique(group, return_counts=True)[1] == size])
    if not whole_groups.any():
        raise ValueError(
            "every group of the Saltelli design lacks the rows of some of its cases; complete the "
            "run, or give all its rows"
        )
    x = x[:, order][:, whole_groups].reshape(len(x), -1, size)
    y = y[order][whole_groups].reshape(-1, size)
    first, last = x[:, :, 0], x[:, :, -1]
    for k in range(len(x)):
        changed = np.where(np.arange(len(x))[:, None] == k, last, first)
        if not (x[:, :, k + 1] == changed).all():
            raise ValueError(
                "the inputs of the cases are not those of a Saltelli design, perhaps because "
                "run.samples gives some of them"
            )
    whole = np.isfinite(y).all(axis=1)
    n_left_out = len(y) - int(whole.sum())
    n_incomplete = len(np.unique(group)) - len(y)
    if n_left_out > MAX_LEFT_OUT * len(y):
        raise ValueError(
            f"{n_left_out} of {len(y)} groups of the Saltelli design have a case without this "
            "outcome, which is more than 5 %: the other groups do not represent all cases"
        )
    replicates = group[whole_groups].reshape(-1, size)[whole, 0] % REPLICATES
    if len(np.unique(replicates)) < REPLICATES:
        raise ValueError(
            f"some of the {REPLICATES} sequences of the Saltelli design have no complete group of "
            "cases with this outcome"
        )
    return SaltelliGroups(y[whole], n_left_out + n_incomplete, replicates)


def saltelli_indices(groups: SaltelliGroups) -> tuple[np.ndarray, np.ndarray]:
    """Return the first-order and the total indices of a Saltelli design, each as an array
    (2, inputs): index, and the half-width of its 95 % interval.

    Equations b and f of Saltelli et al., Computer Physics Communications 181, 2010. The interval is
    Student's, from the independently scrambled sequences. The groups of one sequence are dependent,
    as pairs of its dimensions have patterns: intervals that assume independent groups had a
    coverage of 46 % for an index of 0 (256 groups, a product of two inputs).
    """
    outcomes = groups.outcomes
    independent = outcomes[:, [0, -1]]
    mean, variance = independent.mean(), independent.var()
    a, b = (outcomes[:, k] - mean for k in (0, -1))
    half_square = 0.5 * (a * a + b * b)

    def ratio(product: np.ndarray) -> tuple[float, float]:
        index = float(product.mean() / variance)
        influence = (product - index * half_square) / variance
        parts = np.bincount(groups.replicates, influence) * REPLICATES / len(influence)
        return index, float(
            student_half_width(REPLICATES - 1) * parts.std(ddof=1) / np.sqrt(REPLICATES)
        )

    changed = (outcomes[:, 1:-1] - mean).T
    first, total = zip(
        *((ratio(b * (column - a)), ratio(0.5 * (a - column) ** 2)) for column in changed),
        strict=True,
    )
    return np.array(first).T, np.array(total).T


def few_cases_warning(grouped: np.ndarray, y: np.ndarray) -> str:
    """Return the warning that indices have no intervals, as a few outliers determine the variance
    of an outcome ``y`` (n,), which must not be constant; an empty string if they do not.

    ``grouped`` (d, n) are inputs of few values, each with enough cases. Outliers that they explain
    do not count: the means of the outcome over the cases of each value are subtracted first.
    """
    limit, y = MAX_TAIL * len(y), _standard(y)
    for row in grouped:
        group = np.unique(row, return_inverse=True)[1]
        y = y - (np.bincount(group, y) / np.bincount(group))[group]
    tail = float(np.mean(y**4) - 3.0 * np.mean(y**2) ** 2)
    if tail <= limit:
        return ""
    return (
        f"indices are given without intervals: a few outliers among {len(y)} cases determine the "
        f"variance (excess kurtosis {tail:.3g}; intervals are valid up to {limit:.3g})"
    )


def _standard(y: np.ndarray) -> np.ndarray:
    """Return an outcome (n,), minus its mean and divided by its sigma (of n - 1 degrees of
    freedom). The outcome must not be constant: it would become NaN."""
    y = y - y.mean()
    return np.asarray(y / np.sqrt(y @ y / (len(y) - 1)))


def _order(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the indices (n,) that sort cases by the input ``x``; ties are in a random order that
    does not depend on the order of the rows, for which they are first sorted by ``y``."""
    rows = np.argsort(x)  # a sixth of the time of a stable sort, which differs only for ties
    in_order = x[rows]
    if (in_order[1:] != in_order[:-1]).all():
        return rows
    rows = np.lexsort((y, x))
    return rows[np.lexsort((np.random.default_rng(1).random(len(x)), x[rows]))]


def _neighbour_mean(y: np.ndarray, max_lag: int) -> np.ndarray:
    """Return for each element of ``y`` (n,) the mean of up to ``max_lag`` elements before and up to
    as many after it, without itself."""
    n = len(y)
    low, high = np.maximum(np.arange(n) - max_lag, 0), np.minimum(np.arange(n) + max_lag + 1, n)
    sums = np.concatenate(([0.0], np.cumsum(y)))
    return np.asarray((sums[high] - sums[low] - y) / (high - low - 1))


def _half_width(influence: np.ndarray, excess: float, added: float) -> float:
    """Return the half-width of the 95 % interval of an index from the ``influence`` (n,) of each
    case on it: its variance, divided by n, is the variance of the index. 0 if that is 0.

    ``excess`` is subtracted from the variance of the influence, and ``added`` is added to that of
    the index. Degrees of freedom follow from the kurtosis (Satterthwaite, Biometrics 2, 1946).
    """
    n = len(influence)
    influence = influence - influence.mean()
    squares = influence**2
    variance = float(np.mean(squares))
    mean_variance = max(variance - excess, 0.0) / n
    if mean_variance + added == 0.0:
        return 0.0
    degrees = np.inf
    if mean_variance > 0.0:
        kurtosis = float(np.mean(squares**2)) / variance**2
        degrees = 2.0 * n / max(kurtosis - 1.0, 1e-9) * (1.0 + added / mean_variance) ** 2
    return float(student_half_width(np.clip(degrees, 2.0, 1e9)) * np.sqrt(mean_variance + added))
