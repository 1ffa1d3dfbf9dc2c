"""How often values occurred that a campaign file gives a probability: a sample that holds a rare
value too few times says nothing of what that value does.

Counted are the values of every discrete distribution and, of two that a file correlates, the pairs
that the correlation makes more probable than chance: a pair that is less probable is rarer than
the same pair of independent parameters, which no file gives a probability either.
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

# Times that a value is to be drawn before a mean or a sigma is believed: with fewer, intervals of a
# mean that the value decides hold the true one too seldom (tests/measure/until.py).
TIMES = 10
_COMMON = 0.05  # probability from which on a value that was drawn at all shows in the intervals
_ABOVE = 1.001  # times the probability of independent parameters, of a pair that is counted
_NAMED = 3  # values that a sentence names
_PAIRS = 4096  # of values, at most, that are looked at of two distributions
_NODES = 64  # of the Gauss-Legendre rule
_FARTHEST = 40.0  # score beyond which nothing lies


@dataclass(frozen=True)
class Rare:
    """One value of a discrete distribution, or a pair of values of two that correlate.

    ``places`` are those of its parameters among all that are dispersed, ``values`` in the units of
    their keys. ``enough`` is how often it is to occur: `TIMES`, or as often as a plan holds it.
    """

    name: str
    places: tuple[int, ...]
    values: tuple[float, ...]
    probability: float
    enough: int = TIMES

    @property
    def cases(self) -> int:
        """Cases in which it is expected to occur often enough."""
        return math.ceil(self.enough / self.probability)


class Occurrence(NamedTuple):
    """How often a value occurred among so many cases."""

    of: Rare
    times: int
    cases: int


def rare_values(
    dispersions: Sequence[Dispersion], copulas: Sequence[Copula] = ()
) -> tuple[Rare, ...]:
    """Values and pairs of values that a file gives a probability below 1."""
    laws = [law if law.law == "discrete" else None for law in dispersions]
    found = [
        Rare(f"{law.parameter.key} = {value:g}", (place,), (value,), share, _enough(law, share))
        for place, law in enumerate(laws)
        if law
        for value, share in _shares(law).items()
        if share < 1.0
    ]
    for copula in copulas:
        for k, j in combinations(range(len(copula.places)), 2):
            places = copula.places[k], copula.places[j]
            one, two = (laws[place] for place in places)
            if one and two and len(one.numbers) * len(two.numbers) <= _PAIRS:
                correlation = float(np.dot(copula.factor[k], copula.factor[j]))
                for values, share in _pairs(one, two, correlation):
                    name = (
                        f"{one.parameter.key} = {values[0]:g} with "
                        f"{two.parameter.key} = {values[1]:g}"
                    )
                    found.append(Rare(name, places, values, share))
    return tuple(found)


def _shares(law: Dispersion) -> dict[float, float]:
    """Probability of each value of a discrete distribution that has one, in the order of the
    file."""
    found: dict[float, float] = {}
    for value, weight in zip(law.numbers, law.weights, strict=True):
        if weight > 0.0:
            found[value] = found.get(value, 0.0) + weight / sum(law.weights)
    return found


def _enough(law: Dispersion, share: float) -> int:
    """Times that a value is to occur; no more than a plan holds it."""
    return min(TIMES, round(share * sum(law.weights))) if law.column else TIMES


def _pairs(
    one: Dispersion, two: Dispersion, correlation: float
) -> Iterator[tuple[tuple[float, float], float]]:
    """Pairs of values that are more probable than those of independent parameters, and their
    probability, if the normal scores of two discrete distributions correlate so."""
    from scipy.special import ndtri  # noqa: PLC0415  (0.1 s that most files do not need)

    edges = [np.cumsum(law.weights) / np.sum(law.weights) for law in (one, two)]
    below = np.zeros([len(each) + 1 for each in edges])
    below[1:, -1], below[-1, 1:] = edges
    inner = [np.clip(ndtri(each[:-1]), -_FARTHEST, _FARTHEST) for each in edges]
    below[1:-1, 1:-1] = _both_below(inner[0][:, None], inner[1][None, :], correlation)
    together: dict[tuple[float, float], float] = {}
    for (i, j), part in np.ndenumerate(np.diff(np.diff(below, axis=0), axis=1)):
        values = one.numbers[i], two.numbers[j]
        together[values] = together.get(values, 0.0) + float(part)
    alone = _shares(one), _shares(two)
    for values, share in together.items():
        if share > _ABOVE * alone[0].get(values[0], 1.0) * alone[1].get(values[1], 1.0):
            yield values, share


def _both_below(h: np.ndarray, k: np.ndarray, correlation: float) -> np.ndarray:
    """Probability that two standard normal numbers that correlate so are below h and k (Plackett,
    Biometrika 41, 1954: its derivative by the correlation is their density, integrated here over
    the arc sine of the correlation)."""
    from scipy.special import ndtr  # noqa: PLC0415

    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    reach = math.asin(max(-1.0, min(1.0, correlation)))
    found = ndtr(h) * ndtr(k)
    for node, weight in zip(nodes, weights, strict=True):
        angle = 0.5 * reach * (1.0 + node)
        power = (h * h + k * k - 2.0 * h * k * math.sin(angle)) / (2.0 * math.cos(angle) ** 2)
        found = found + weight * reach / (4.0 * math.pi) * np.exp(-power)
    return np.asarray(found)


def count(values: Sequence[Rare], drawn: np.ndarray) -> tuple[int, ...]:
    """Rows of a case table (n, d): all of them, and those in which each value occurs. Counts of
    tables that follow each other add up."""
    single = {each.places[0] for each in values if len(each.places) == 1}
    counts = {
        place: dict(zip(*np.unique(drawn[:, place], return_counts=True), strict=True))
        for place in single
    }
    return (
        len(drawn),
        *(
            int(counts[each.places[0]].get(each.values[0], 0))
            if len(each.places) == 1
            else int(np.count_nonzero((drawn[:, each.places] == each.values).all(axis=1)))
            for each in values
        ),
    )


def occurrences(values: Sequence[Rare], counts: Sequence[int]) -> list[Occurrence]:
    """How often each value occurred, by what `count` counted."""
    cases, *each = counts or (0, *(0 for _ in values))
    return [Occurrence(of, k, cases) for of, k in zip(values, each, strict=True)]


def seldom(found: Sequence[Occurrence]) -> list[Occurrence]:
    """Of occurrences those that are too few to show what their value does, the most probable
    first."""
    few = [one for one in found if one.times < one.of.enough]
    return sorted(few, key=lambda one: -one.of.probability)


def not_shown(found: Sequence[Occurrence]) -> list[str]:
    """The sentence that names values that statistics say nothing of, as they did not occur, or too
    seldom; none if all occurred."""
    few = [one for one in seldom(found) if not one.times or one.of.probability < _COMMON]
    if not few:
        return []
    first, *others = (
        f"{one.of.name} (probability {one.of.probability:.3g}) occurred in {one.times}"
        for one in few[:_NAMED]
    )
    said = ", ".join([f"{first} of {few[0].cases} cases", *others])
    left = len(few) - _NAMED
    more = f", and {left} more values as seldom" if left > 0 else ""
    return [
        f"{said}{more}: statistics and intervals hardly show what that does; fly more cases, or "
        f"seek a requirement by {option('rare')}"
    ]
