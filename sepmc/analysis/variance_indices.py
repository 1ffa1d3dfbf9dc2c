"""First-order and total indices of variance, each by an estimator that is valid for how the cases
were drawn and for what the input is like.

The first-order index of an input is Var(E[Y | X]) / Var(Y). Of independent rows it is found from
the residual variance: cases are put in the order of the input (ties in random order), half the mean
square difference of outcomes k places apart is extrapolated to k = 0 (Tong and Wang, Biometrika 92,
2005), and the interval follows from the influence function 2 f Y - f^2 - S Y^2 with f = E[Y | X]
(Da Veiga and Gamboa, J. Nonparametric Statistics 25, 2013).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sepmc.analysis.statistics import student_half_width
from sepmc.scene.model import REPLICATES, SALTELLI

PLAN, LHS, SOBOL = "plan", "lhs", "sobol"
BY_ROWS, BY_GROUPS, NONE = "rows", "groups", ""


class ValidEstimator(NamedTuple):
    """Estimator of first-order indices that is valid for a sampler (by groups: of total ones, too),
    and a sentence on what follows from how the cases were drawn; empty if nothing is to be said."""

    first: str
    said: str = ""


PATTERNED = (
    "first-order indices are not given: {what} is patterned, and an input without effect can "
    "take on the effect of two others together; use run.sampler random, lhs or saltelli"
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
# Fourth cumulant of an outcome less the means of its groups, over its squared variance and over the
# cases, from which on few of them decide its variance: 95 % intervals of indices hold 70 to 91 %,
# below it 92 % and more (tests/measure/sensitivity.py)
MOST_TAILED = 0.01
# samplers whose cases are not independent, so that no test of chance holds for counts of them
PATTERNS = (SOBOL, SALTELLI)
MOST_LEFT_OUT = 0.05  # of the groups of a Saltelli design, before the rest no longer stand for all
_LAGS, _LAGS_OF_ROOT = (4, 64), 0.5  # fewest and most places apart; over the root of the cases


def ordered_index(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """First-order index of an input of many values, and half of its 95 % interval.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Input and outcome of independent cases, in any order.
    """
    n = len(y)
    y = _standard(y[_ordered(x, y)])
    most = int(np.clip(round(_LAGS_OF_ROOT * np.sqrt(n)), *_LAGS))
    lags, squares = np.arange(1.0, most + 1.0), np.concatenate(([0.0], np.cumsum(y * y)))
    apart = np.array(
        [
            (squares[n] - squares[k] + squares[n - k] - 2.0 * (y[k:] @ y[:-k])) / (2.0 * (n - k))
            for k in range(1, most + 1)
        ]
    )
    # weights that give the value at lag 0 of a line, and of a parabola, through the differences
    line, parabola = (np.linalg.pinv(np.vander(lags, k, increasing=True))[0] for k in (2, 3))
    index = 1.0 - float(line @ apart)
    mean = _neighbours(y, most)
    left = (y - mean) ** 2
    fourth = float(np.mean(left[1:] * left[:-1]))  # residual variance squared, where it varies too
    bent, bending = float((parabola - line) @ apart), parabola - line
    bias = max(bent**2 - 4.0 * fourth * float(bending @ bending) / n, 0.0)
    influence = 2.0 * mean * y - mean**2 - index * y * y
    by_chance = fourth * float(line @ line) / n + bias
    # what chance in the mean of neighbours adds to the influence
    return index, _half(influence, 2.0 * fourth / most, by_chance)


def grouped_index(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """First-order index of an input of few values, and half of its 95 % interval: epsilon squared,
    the variance between groups less what chance gives them (Kelley, PNAS 21, 1935)."""
    n, group, y = len(y), np.unique(x, return_inverse=True)[1], _standard(y)
    size = np.bincount(group)
    mean = np.bincount(group, y) / size
    within = np.bincount(group, (y - mean[group]) ** 2)
    pooled = float(within.sum()) / (n - len(size))
    index = 1.0 - pooled
    # a group of few cases varies as all do, at least
    fourth = float(np.sum(np.maximum(within / size, pooled) ** 2))
    of_case = mean[group]
    influence = 2.0 * of_case * y - of_case**2 - index * y * y
    by_chance = 2.0 * fourth * (1.0 - 1.0 / len(size)) / n**2
    return index, _half(influence, 4.0 * fourth / n, by_chance)


def independent_rows(cases: Mapping[str, np.ndarray], inputs: int, sampler: str) -> np.ndarray:
    """Which cases (n,) do not repeat others: all, but of a group of a Saltelli design the first and
    the last, which the rest repeat in all inputs but one, or in one."""
    count = len(cases["status"])
    if sampler != SALTELLI:
        return np.ones(count, dtype=bool)
    numbers = np.asarray(cases["case"]) if "case" in cases else np.arange(count)
    return np.isin(numbers % (inputs + 2), (0, inputs + 1))


class SaltelliGroups(NamedTuple):
    """Whole groups of a Saltelli design: outcomes (groups, inputs + 2), how many groups were left
    out as a case of theirs has no outcome, and of which sequence each is (groups,)."""

    outcomes: np.ndarray
    left_out: int
    replicates: np.ndarray


def saltelli_groups(numbers: np.ndarray, x: np.ndarray, y: np.ndarray) -> SaltelliGroups:
    """Groups of a Saltelli design, by the ``numbers`` (n,) of its cases.

    Parameters
    ----------
    x : ndarray, shape (inputs, n)
    y : ndarray, shape (n,)
        NaN where a case does not have the outcome.

    Raises
    ------
    ValueError
        If inputs are not those of such a design, or too few groups are whole.
    """
    size = len(x) + 2
    order = np.argsort(numbers, kind="stable")
    group = numbers[order] // size
    kept = np.isin(group, np.unique(group)[np.unique(group, return_counts=True)[1] == size])
    if not kept.any():
        raise ValueError("no group of the Saltelli design is whole")
    x, y = x[:, order][:, kept].reshape(len(x), -1, size), y[order][kept].reshape(-1, size)
    first, last = x[:, :, 0], x[:, :, -1]
    for k in range(len(x)):
        changed = np.where(np.arange(len(x))[:, None] == k, last, first)
        if not (x[:, :, k + 1] == changed).all():
            raise ValueError(
                "the inputs are not those of a Saltelli design (run.samples gives some of them)"
            )
    whole = np.isfinite(y).all(axis=1)
    left_out = len(y) - int(whole.sum())
    parts = len(np.unique(group)) - len(y)
    if left_out > MOST_LEFT_OUT * len(y):
        raise ValueError(
            f"{left_out} of {len(y)} groups of the Saltelli design have a case without this "
            "outcome: the others do not stand for all"
        )
    replicates = group[kept].reshape(-1, size)[whole, 0] % REPLICATES
    if len(np.unique(replicates)) < REPLICATES:
        raise ValueError(
            f"no group of some of the {REPLICATES} sequences of the Saltelli design is whole"
        )
    return SaltelliGroups(y[whole], left_out + parts, replicates)


def saltelli_indices(found: SaltelliGroups) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total indices of a Saltelli design (Saltelli et al., Computer Physics
    Communications 181, 2010, equations b and f), each (2, inputs): index, half of its interval by
    Student's law, from the sequences, of which each is scrambled for itself. The groups of one are
    not independent: pairs of its dimensions have patterns, and the interval that independent groups
    would have held an index of 0 in 46 % (256 groups, a product of two inputs)."""
    every = found.outcomes
    both = every[:, [0, -1]]
    mean, variance = both.mean(), both.var()
    a, b = (every[:, k] - mean for k in (0, -1))
    spread = 0.5 * (a * a + b * b)

    def ratio(product: np.ndarray) -> tuple[float, float]:
        index = float(product.mean() / variance)
        influence = (product - index * spread) / variance
        parts = np.bincount(found.replicates, influence) * REPLICATES / len(influence)
        return index, float(
            student_half_width(REPLICATES - 1) * parts.std(ddof=1) / np.sqrt(REPLICATES)
        )

    changed = (every[:, 1:-1] - mean).T
    first, total = zip(
        *((ratio(b * (one - a)), ratio(0.5 * (a - one) ** 2)) for one in changed), strict=True
    )
    return np.array(first).T, np.array(total).T


def few_cases_warning(grouped: np.ndarray, y: np.ndarray) -> str:
    """The sentence that intervals of indices are not given, as few cases far from the others decide
    the variance of an outcome (n,), or nothing. Inputs of few values, ``grouped`` (d, n), explain
    what lies far by themselves: of each of their values there are cases enough."""
    most, y = MOST_TAILED * len(y), _standard(y)
    for row in grouped:
        group = np.unique(row, return_inverse=True)[1]
        y = y - (np.bincount(group, y) / np.bincount(group))[group]
    tail = float(np.mean(y**4) - 3.0 * np.mean(y**2) ** 2)
    if tail <= most:
        return ""
    return (
        f"indices are given without intervals: few of {len(y)} cases, far from the others, decide "
        f"the variance (excess kurtosis {tail:.3g}; intervals hold up to {most:.3g})"
    )


def _standard(y: np.ndarray) -> np.ndarray:
    """An outcome less its mean, over its sigma."""
    y = y - y.mean()
    return np.asarray(y / np.sqrt(y @ y / (len(y) - 1)))


def _ordered(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Places of cases in the order of an input; ties in a random order that does not depend on how
    the rows stand."""
    rows = np.lexsort((y, x))
    return rows[np.lexsort((np.random.default_rng(1).random(len(x)), x[rows]))]


def _neighbours(y: np.ndarray, most: int) -> np.ndarray:
    """Mean of the cases up to ``most`` places before and after each, without itself."""
    n = len(y)
    low, high = np.maximum(np.arange(n) - most, 0), np.minimum(np.arange(n) + most + 1, n)
    sums = np.concatenate(([0.0], np.cumsum(y)))
    return np.asarray((sums[high] - sums[low] - y) / (high - low - 1))


def _half(influence: np.ndarray, too_much: float, more: float) -> float:
    """Half of a 95 % interval of a mean with such an ``influence`` (n,) of each case, of whose
    variance ``too_much`` is left out, and ``more`` added to that of the mean. Student's law has the
    freedoms that the kurtosis leaves to the variance (Satterthwaite, Biometrics 2, 1946)."""
    n = len(influence)
    influence = influence - influence.mean()
    variance = float(np.mean(influence**2))
    of_mean = max(variance - too_much, 0.0) / n
    if of_mean + more == 0.0:
        return 0.0
    freedoms = np.inf
    if of_mean > 0.0:
        kurtosis = float(np.mean(influence**4)) / variance**2
        freedoms = 2.0 * n / max(kurtosis - 1.0, 1e-9) * (1.0 + more / of_mean) ** 2
    return float(student_half_width(np.clip(freedoms, 2.0, 1e9)) * np.sqrt(of_mean + more))
