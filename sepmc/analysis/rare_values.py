"""Counts of rare values of inputs: too few occurrences in a sample show nothing of their effect.

Counted are the values of discrete distributions, such as a failure that occurs or not, and the
pairs of values of two correlated discrete distributions that the correlation makes more probable
than independence would. Other pairs are not counted, as no file states their probability.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sepmc.scene.correlation import Copula
from sepmc.scene.dispersion import Dispersion
from sepmc.wording import option

# Occurrences required before a mean or a sigma is reported: with fewer, intervals of a mean that
# depends on the value have too low a coverage (tests/measure/until.py).
MIN_OCCURRENCES = 10
_COMMON = 0.05  # a value of at least this probability shows in the intervals once sampled
_MIN_RATIO = 1.001  # of a counted pair's probability to that of independent parameters
_MAX_NAMED = 3  # values named in a message
_MAX_PAIRS = 4096  # pairs of values of two distributions that are considered
_NODES = 64  # of the Gauss-Legendre rule
_MAX_SCORE = 40.0  # normal score beyond all probability


@dataclass(frozen=True)
class RareValue:
    """A value of a discrete distribution, or a pair of values of two correlated ones.

    Parameters
    ----------
    name : str
        Text ``key = value``, or two of these joined by ``with``.
    indices : tuple of int
        Index of the dispersed parameter of each value.
    values : tuple of float
        One value or two, in the units of the keys.
    probability : float
        Probability of the value, or of both together, in a case.
    min_count : int
        Required occurrences in a sample: `MIN_OCCURRENCES`, or the number of rows with the value in
        a table of samples if that is smaller.
    """

    name: str
    indices: tuple[int, ...]
    values: tuple[float, ...]
    probability: float
    min_count: int = MIN_OCCURRENCES

    @property
    def cases(self) -> int:
        """Number of cases in which ``min_count`` occurrences are expected."""
        return math.ceil(self.min_count / self.probability)


class Occurrence(NamedTuple):
    """Number of ``times`` that an input value, or a pair of values, ``of`` occurred in a number of
    ``cases``."""

    of: RareValue
    times: int
    cases: int


def rare_values(
    dispersions: Sequence[Dispersion], copulas: Sequence[Copula] = ()
) -> tuple[RareValue, ...]:
    """List the values of discrete distributions, and pairs of values of two correlated ones, that a
    sample may lack.

    Parameters
    ----------
    dispersions : sequence of Dispersion
        All dispersed parameters.
    copulas : sequence of Copula
        Correlations of the dispersions.

    Returns
    -------
    tuple of RareValue
        Every value of a probability below 1, then the pairs that the correlation makes more
        probable than independence would, except those of two distributions that have more than
        `_MAX_PAIRS` pairs of values.
    """
    discrete = [each if each.distribution == "discrete" else None for each in dispersions]
    result = [
        RareValue(
            f"{dispersion.parameter.key} = {value:g}",
            (index,),
            (value,),
            probability,
            _required_count(dispersion, probability),
        )
        for index, dispersion in enumerate(discrete)
        if dispersion
        for value, probability in _probabilities(dispersion).items()
        if probability < 1.0
    ]
    for copula in copulas:
        for k, j in combinations(range(len(copula.places)), 2):
            indices = copula.places[k], copula.places[j]
            first, second = (discrete[index] for index in indices)
            if first and second and len(first.numbers) * len(second.numbers) <= _MAX_PAIRS:
                correlation = float(np.dot(copula.factor[k], copula.factor[j]))
                for values, probability in _pairs(first, second, correlation):
                    name = (
                        f"{first.parameter.key} = {values[0]:g} with "
                        f"{second.parameter.key} = {values[1]:g}"
                    )
                    result.append(RareValue(name, indices, values, probability))
    return tuple(result)


def _probabilities(dispersion: Dispersion) -> dict[float, float]:
    """Return the probability of each value of a discrete distribution, by value, in the order of
    the file; values of weight 0 are left out."""
    result: dict[float, float] = {}
    for value, weight in zip(dispersion.numbers, dispersion.weights, strict=True):
        if weight > 0.0:
            result[value] = result.get(value, 0.0) + weight / sum(dispersion.weights)
    return result


def _required_count(dispersion: Dispersion, probability: float) -> int:
    """Return how often a value of a distribution, of the given probability, must occur in a sample:
    `MIN_OCCURRENCES` times, or fewer if the distribution is a column of a table in which fewer rows
    have the value."""
    in_table = round(probability * sum(dispersion.weights)) if dispersion.column else np.inf
    return int(min(MIN_OCCURRENCES, in_table))


def _pairs(
    first: Dispersion, second: Dispersion, correlation: float
) -> Iterator[tuple[tuple[float, float], float]]:
    """Yield ((first value, second value), probability) for each pair of values of two discrete
    distributions that is more probable (by 0.1 % at least, beyond round-off) than if they were
    independent; ``correlation`` is that of their normal scores."""
    from scipy.special import ndtri  # noqa: PLC0415  (0.1 s that most files do not need)

    edges = [np.cumsum(each.weights) / np.sum(each.weights) for each in (first, second)]
    cdf = np.zeros([len(edge) + 1 for edge in edges])
    cdf[1:, -1], cdf[-1, 1:] = edges
    scores = [np.clip(ndtri(edge[:-1]), -_MAX_SCORE, _MAX_SCORE) for edge in edges]
    cdf[1:-1, 1:-1] = _bivariate_normal_cdf(scores[0][:, None], scores[1][None, :], correlation)
    joint: dict[tuple[float, float], float] = {}
    for (i, j), cell in np.ndenumerate(np.diff(np.diff(cdf, axis=0), axis=1)):
        values = first.numbers[i], second.numbers[j]
        joint[values] = joint.get(values, 0.0) + float(cell)
    marginals = _probabilities(first), _probabilities(second)
    for values, probability in joint.items():
        independent = marginals[0].get(values[0], 1.0) * marginals[1].get(values[1], 1.0)
        if probability > _MIN_RATIO * independent:
            yield values, probability


def _bivariate_normal_cdf(h: np.ndarray, k: np.ndarray, correlation: float) -> np.ndarray:
    """Return P(X < h, Y < k) of standard normal X and Y with a correlation, in the broadcast shape
    of ``h`` and ``k``, which must be finite.

    Its derivative by the correlation is the joint density (Plackett, Biometrika 41, 1954), which is
    integrated over the arc sine of the correlation.
    """
    from scipy.special import ndtr  # noqa: PLC0415

    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    angle_end = math.asin(max(-1.0, min(1.0, correlation)))
    result = ndtr(h) * ndtr(k)
    for node, weight in zip(nodes, weights, strict=True):
        angle = 0.5 * angle_end * (1.0 + node)
        exponent = (h * h + k * k - 2.0 * h * k * math.sin(angle)) / (2.0 * math.cos(angle) ** 2)
        result = result + weight * angle_end / (4.0 * math.pi) * np.exp(-exponent)
    return np.asarray(result)


def count_values(values: Sequence[RareValue], inputs: np.ndarray) -> tuple[int, ...]:
    """Count the occurrences of rare values.

    Parameters
    ----------
    values : sequence of RareValue
    inputs : ndarray, shape (n, d)
        The d dispersed parameters of n cases, in the units of the keys.

    Returns
    -------
    tuple of int
        n, then for each of ``values`` the number of cases that have it. The tuples of several
        tables of inputs can be added element by element.
    """
    single = {value.indices[0] for value in values if len(value.indices) == 1}
    counts = {
        index: dict(zip(*np.unique(inputs[:, index], return_counts=True), strict=True))
        for index in single
    }
    return (
        len(inputs),
        *(
            int(counts[value.indices[0]].get(value.values[0], 0))
            if len(value.indices) == 1
            else int(np.count_nonzero((inputs[:, value.indices] == value.values).all(axis=1)))
            for value in values
        ),
    )


def occurrences(values: Sequence[RareValue], counts: Sequence[int]) -> list[Occurrence]:
    """Combine rare values with their counts.

    Parameters
    ----------
    values : sequence of RareValue
    counts : sequence of int
        From `count_values` for these values: the number of cases, then a count for each value;
        empty if there are no cases yet.

    Returns
    -------
    list of Occurrence
        One for each value, in their order.
    """
    cases, *times = counts or (0, *(0 for _ in values))
    return [Occurrence(value, k, cases) for value, k in zip(values, times, strict=True)]


def undersampled(counted: Sequence[Occurrence]) -> list[Occurrence]:
    """Return those of the ``counted`` values that occurred less often than their ``min_count``, the
    most probable value first."""
    rare = [one for one in counted if one.times < one.of.min_count]
    return sorted(rare, key=lambda one: -one.of.probability)


def render_undersampled(counted: Sequence[Occurrence]) -> list[str]:
    """Return a list of one warning, which names up to three undersampled values; an empty list if
    there are none. A value that occurred and has a probability of 5 % or more does not count."""
    rare = [one for one in undersampled(counted) if not one.times or one.of.probability < _COMMON]
    if not rare:
        return []
    first, *others = (
        f"{one.of.name} (probability {one.of.probability:.3g}) occurred in {one.times}"
        for one in rare[:_MAX_NAMED]
    )
    text = ", ".join([f"{first} of {rare[0].cases} cases", *others])
    n_more = len(rare) - _MAX_NAMED
    more = f", and {n_more} more values too rarely" if n_more > 0 else ""
    return [
        f"{text}{more}: statistics and intervals hardly show the effect of such a value; "
        f"run more cases, or estimate the probability to violate a requirement by {option('rare')}"
    ]
