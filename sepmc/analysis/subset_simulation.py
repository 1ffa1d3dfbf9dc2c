"""Probabilities too small to count: subset simulation over independent standard normal variables.

A case violates if its margin is below zero. Trial chains go down in levels, each with a tenth of
the cases of the one before (Au and Beck, Probabilistic Engineering Mechanics 16 (2001) 263), by
conditional moves whose size adapts (Papaioannou, Betz, Zwirglmaier and Straub, Probabilistic
Engineering Mechanics 41 (2015) 89). They leave thresholds and sizes of moves only. With these,
fixed, independent replicas start anew: every level takes as many of the cases within it, at random,
as it has chains, and keeps all states of the chains (Dau and Chopin, J. R. Stat. Soc. B 84 (2022)
114). So the product of the shares is an unbiased estimate of the probability, however well the
chains mix, and the interval rests on the spread of independent estimates alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from sepmc.analysis.proportions import CONFIDENCE
from sepmc.analysis.proportions import binomial_interval as of_shares
from sepmc.analysis.statistics import TWO_SIDED

REPLICAS = 10  # twenty, each of half the size: 92 to 96 % of intervals hold, not 94 to 97 %
LENGTH = 10  # states of a chain; a tenth of the cases go on. A fifth of them: 4 % more spread
_ACCEPTED = 0.44  # of the moves of trial chains: Papaioannou et al., section 3.3
_FIRST_STEP = 0.6
_MOST_LEVELS = 16  # 1e-16: beyond, numbers below 1 have no digits for probabilities
_TRIALS = (300, 3000)  # cases of a level of trial chains, at least and at most
_LEAST = 100  # cases of a level of a replica
_SHARED = 0.5  # of the trial cases within the bound have no margin: these hide the others
_APART = 0.8  # relative spread of replicas: 0.35 where all is well, with 1e5 flights for 1e-6
_HARDLY = 0.15  # of the moves accepted
_FEW = 5  # first cases a replica from which all that violate come; some 20 where all is well

# from scores (n, d) to margins (n,), NaN where a case has none, and what is to be told of each case
# (n, k)
LimitFunction = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
NamedGenerator = Callable[[str], np.random.Generator]  # by the name of what it is for


@dataclass(frozen=True)
class ChainStates:
    """Cases that chains stand at: ``scores`` (n, d), ``margin`` (n,), what is ``records`` of them
    (n, k), the ``number`` (n,) of the flight, the ``level`` (n,) it was flown for, and the place
    (n,) of the first case, its ``origin``."""

    scores: np.ndarray
    margin: np.ndarray
    records: np.ndarray
    number: np.ndarray
    level: np.ndarray
    origin: np.ndarray

    def at(self, places: np.ndarray) -> Self:
        """Those at some places, in that order."""
        return type(self)(*(getattr(self, f.name)[places] for f in fields(self)))

    def moved(self, to: Self, accepted: np.ndarray) -> Self:
        """Where chains stand after a move, which some of them (n,) accept."""
        pairs = ((getattr(self, f.name), getattr(to, f.name)) for f in fields(self))
        choice = (np.where(accepted if a.ndim == 1 else accepted[:, None], b, a) for a, b in pairs)
        return type(self)(*choice)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Parts one after the other."""
        return cls(*(np.concatenate([getattr(one, f.name) for one in parts]) for f in fields(cls)))


@dataclass(frozen=True)
class LevelSchedule:
    """The way down: ``thresholds`` of the margin, and the sizes of moves (d,) within each. Cases
    without a margin count as ``worst``. ``known`` and ``unknown``: trial cases that violate at the
    end, and that have no margin there; ``reached``: whether the bound was."""

    thresholds: list[float]
    steps: list[np.ndarray]
    worst: float
    known: int
    unknown: int
    reached: bool


@dataclass(frozen=True)
class Level:
    """A level: its ``threshold`` of the margin, the last one 0; the share of cases of the level
    before that come so far, its ``probability``, and the share of all, ``reached``, by replica too
    (r,); the share of moves accepted in the level before (NaN: it has none), and how many different
    cases within the threshold there were to go on from."""

    threshold: float
    probability: float
    reached: float
    replicas: np.ndarray
    acceptance: float
    seeds: int


@dataclass(frozen=True)
class Estimate:
    """What replicas say, (r,) each: ``known``, the probability of a margin below zero, and
    ``unknown``, that of no margin (0 if these are kept out). ``last`` are the cases of the last
    level, of a ``replica`` (n,) and with a ``weight`` (n,) each: the weights of those that violate
    add up to the estimate. ``origins``: first cases from which all that violate come."""

    known: np.ndarray
    unknown: np.ndarray
    levels: tuple[Level, ...]
    last: ChainStates
    replica: np.ndarray
    weight: np.ndarray
    origins: int
    size: int
    reached: bool

    @property
    def probability(self) -> float:
        """Of a margin below zero."""
        return float(self.known.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the probability of a margin below zero."""
        return self._interval(self.known)

    @property
    def interval_with_unknown(self) -> tuple[float, float]:
        """95 % interval of the probability of a margin below zero, or none."""
        return self._interval(self.known + self.unknown)

    def _interval(self, found: np.ndarray) -> tuple[float, float]:
        if len(self.levels) == 1:  # plain cases, which can be counted
            cases = self.size * len(found)
            return of_shares(round(float(found.mean()) * cases), cases)
        if not found.any():  # no more than come to the last threshold that any came to
            reached = [level.replicas for level in self.levels if level.reached > 0.0]
            return 0.0, mean_interval(reached[-1])[1] if reached else 1.0
        return mean_interval(found)

    @property
    def spread(self) -> float:
        """Standard deviation of the replicas, as a share of their mean; NaN if that is 0."""
        mean = self.probability
        return float(self.known.std(ddof=1)) / mean if mean else math.nan


def mean_interval(found: np.ndarray, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval of a mean of independent estimates (r,) of a positive number, some above 0.

    Their mean times exp(+-t s), with Student's t of r - 1 and the standard error s of the mean as a
    share of it: estimates scatter as their logarithms do. Coverage: `tests/measure/rare.py`.
    """
    from scipy.special import stdtrit  # noqa: PLC0415  (0.1 s that other commands do not need)

    count, mean = len(found), float(found.mean())
    error = float(found.std(ddof=1)) / math.sqrt(count) / mean
    reach = float(stdtrit(count - 1, 0.5 + 0.5 * confidence)) * error
    return mean * math.exp(-reach), min(1.0, mean * math.exp(reach))


def equivalent_direct_cases(probability: float, interval: tuple[float, float]) -> float:
    """How many cases that are counted would give an interval as narrow, in the logarithm; NaN if it
    begins or ends at 0."""
    low, high = interval
    if not 0.0 < low < high:
        return math.nan
    half = 0.5 * math.log(high / low) / TWO_SIDED
    return (1.0 - probability) / probability / half**2


def estimate(
    limit: LimitFunction, dimensions: int, random: NamedGenerator, most: int
) -> tuple[Estimate, Estimate, int]:
    """The probability that the margin is below zero.

    Parameters
    ----------
    limit : what gives margins
    dimensions : of the scores, independent standard normal variables
    random : generators by name; a name that was asked for before starts anew
    most : flights allowed

    Returns
    -------
    known, all_of : Estimate
        Of the cases that violate, and of these and those without a margin: the same, unless the
        latter are so many that they hide the others.
    flights : int
    """
    flown = _FlightCounter(limit)
    trials = LENGTH * round(min(max(most // 100, _TRIALS[0]), _TRIALS[1]) / LENGTH)
    depth = _depth(most, trials)
    courses = [_levels(flown, dimensions, random("levels"), trials, depth, -math.inf)]
    if courses[0].unknown > _SHARED * (courses[0].known + courses[0].unknown):
        own, depth = random("levels without unknown"), _depth((most - flown.count) // 2, trials)
        courses.insert(0, _levels(flown, dimensions, own, trials, depth, math.inf))
    for_each = (most - flown.count) // len(courses)
    found = [
        _replicas(flown, dimensions, random, _size(course, for_each), course) for course in courses
    ]
    return found[0], found[-1], flown.count


def _depth(flights: int, trials: int) -> int:
    """How many levels so many flights can go down, if trial chains have so many cases a level."""
    levels = (flights / (trials + _LEAST * REPLICAS) - 1.0) / (1.0 - 1.0 / LENGTH)
    return max(0, min(_MOST_LEVELS, int(levels)))


def estimate_warnings(found: Estimate) -> list[str]:
    """Sentences on what makes an estimate doubtful."""
    said, low, high = [], float(found.known.min()), float(found.known.max())
    if not found.reached:
        threshold = found.levels[-2].threshold if len(found.levels) > 1 else math.inf
        margin = f" a margin of {threshold:.4g}" if math.isfinite(threshold) else " all cases"
        said.append(
            f"few cases violate of those that trial chains came to, within{margin}: more flights "
            "may tell it better"
            if found.known.any()
            else f"trial chains did not come beyond the bound, only to{margin}: it may never be "
            "violated, jump there, or take more flights"
        )
    if found.known.any() and len(found.levels) > 1:
        if low == 0.0 or found.spread > _APART:
            said.append(
                f"replicas disagree, from {low:.2e} to {high:.2e}: the interval may be too narrow, "
                "as some may not have found all ways to violate; allow more flights"
            )
        if found.origins < _FEW * len(found.known):
            said.append(
                f"all cases that violate come from {found.origins} first cases in "
                f"{len(found.known)} replicas: allow more flights"
            )
    stuck = [
        f"{level.acceptance:.2f} at a margin of {level.threshold:.4g}"
        for level in found.levels
        if level.acceptance < _HARDLY
    ]
    if stuck:
        said.append(f"chains hardly move: of their moves they accept {', '.join(stuck)}")
    return said


class _FlightCounter:
    """Flies, and numbers what is flown."""

    def __init__(self, limit: LimitFunction):
        self.limit, self.count = limit, 0

    def fly(self, scores: np.ndarray, level: int, origin: np.ndarray) -> ChainStates:
        margin, records = self.limit(scores)
        number = np.arange(self.count, self.count + len(scores))
        self.count += len(scores)
        return ChainStates(scores, margin, records, number, np.full(len(scores), level), origin)


def _order(states: ChainStates, worst: float) -> np.ndarray:
    """Margins (n,), and ``worst`` of what has none."""
    return np.where(np.isnan(states.margin), worst, states.margin)


def _levels(
    flown: _FlightCounter,
    dimensions: int,
    random: np.random.Generator,
    size: int,
    depth: int,
    worst: float,
) -> LevelSchedule:
    """The way down that trial chains find, with so many cases a level, and so many levels at
    most."""
    states = flown.fly(random.standard_normal((size, dimensions)), 0, np.arange(size))
    thresholds: list[float] = []
    steps: list[np.ndarray] = []
    scale, chains = _FIRST_STEP, size // LENGTH
    while True:
        order = _order(states, worst)
        unknown, known = np.isnan(states.margin).sum(), np.count_nonzero(states.margin < 0.0)
        reached = np.count_nonzero(order < 0.0) >= chains
        threshold = None if reached else _next(order, chains, thresholds)
        if threshold is None or len(thresholds) == depth:
            return LevelSchedule(thresholds, steps, worst, int(known), int(unknown), bool(reached))
        thresholds.append(threshold)
        seeds = states.at(_drawn(np.flatnonzero(order <= threshold), chains, random))
        own = seeds.scores.std(axis=0)
        parts = [seeds]
        for k in range(1, LENGTH):
            step = np.minimum(1.0, scale * own)
            noise = random.standard_normal(seeds.scores.shape)
            states, accepted = _moved(flown, parts[-1], step, noise, threshold, worst, len(steps))
            parts.append(states)
            scale *= math.exp((accepted - _ACCEPTED) / math.sqrt(k))
        steps.append(np.minimum(1.0, scale * own))
        states = ChainStates.joined(parts)


def _next(order: np.ndarray, chains: int, before: list[float]) -> float | None:
    """The threshold that so many cases come to, beyond those ``before``; None if there is none."""
    rising = np.sort(order)
    last = before[-1] if before else rising[-1]  # what all come to is no level
    if rising[chains - 1] < last:
        return max(0.0, float(rising[chains - 1]))
    beyond = rising[rising < last]  # many cases are alike
    return max(0.0, float(beyond[-1])) if len(beyond) and beyond[-1] >= 0.0 else None


def _drawn(places: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """So many of the places, each as often as the others, as far as that goes."""
    whole, rest = divmod(count, len(places))
    some = random.permutation(places)[:rest]
    return np.concatenate([np.tile(places, whole), some])


def _moved(
    flown: _FlightCounter,
    states: ChainStates,
    step: np.ndarray,
    noise: np.ndarray,
    threshold: float,
    worst: float,
    level: int,
) -> tuple[ChainStates, float]:
    """Where chains stand after a conditional move of size ``step`` (d,), and the share accepted:
    all that is within the threshold, as the move leaves the normal law as it is."""
    scores = np.sqrt(1.0 - step**2) * states.scores + step * noise
    to = flown.fly(scores, level + 1, states.origin)
    accepted = _order(to, worst) <= threshold
    return states.moved(to, accepted), float(accepted.mean())


def _size(course: LevelSchedule, flights: int) -> int:
    """Cases of a level of a replica, of so many flights in all: seeds are flown already."""
    of_each = 1.0 + len(course.thresholds) * (1.0 - 1.0 / LENGTH)
    return LENGTH * max(1, int(flights / REPLICAS / of_each / LENGTH))


def _replicas(
    flown: _FlightCounter, dimensions: int, random: NamedGenerator, size: int, course: LevelSchedule
) -> Estimate:
    """Go down a course by independent replicas, of so many cases a level each, side by side."""
    apart = "" if course.worst < 0.0 else " without unknown"
    each = [random(f"replica {k}{apart}") for k in range(REPLICAS)]
    chains, reached = size // LENGTH, np.ones(REPLICAS)

    def noise(count: int) -> np.ndarray:
        return np.concatenate([one.standard_normal((count, dimensions)) for one in each])

    states = flown.fly(noise(size), 0, np.arange(size * REPLICAS))
    replica = np.repeat(np.arange(REPLICAS), size)
    levels: list[Level] = []
    acceptance = math.nan
    for number, (threshold, step) in enumerate(zip(course.thresholds, course.steps, strict=True)):
        order = _order(states, course.worst)
        within = order <= threshold
        reached = reached * np.bincount(replica, within, REPLICAS) / size
        levels.append(_level(threshold, states, within, reached, levels, acceptance))
        places = []
        for k, one in enumerate(each):
            own = np.flatnonzero(within & (replica == k))
            if not len(own):  # it estimates 0; its chains stand still
                own = np.flatnonzero(replica == k)
            places.append(_drawn(own, chains, one))
        parts, moves = [states.at(np.concatenate(places))], []
        for _ in range(1, LENGTH):
            after, accepted = _moved(
                flown, parts[-1], step, noise(chains), threshold, course.worst, number
            )
            parts.append(after)
            moves.append(accepted)
        states, acceptance = ChainStates.joined(parts), float(np.mean(moves))
        replica = np.tile(np.repeat(np.arange(REPLICAS), chains), LENGTH)
    violates = states.margin < 0.0
    known, unknown = (
        reached * np.bincount(replica, what, REPLICAS) / size
        for what in (violates, np.isnan(states.margin) & (course.worst < 0.0))
    )
    levels.append(_level(0.0, states, violates, known, levels, acceptance))
    live = violates & (known[replica] > 0.0)
    return Estimate(
        known,
        unknown,
        tuple(levels),
        states,
        replica,
        (reached / size / REPLICAS)[replica],
        len(np.unique(states.origin[live])),
        size,
        course.reached,
    )


def _level(
    threshold: float,
    states: ChainStates,
    within: np.ndarray,
    reached: np.ndarray,
    before: Sequence[Level],
    acceptance: float,
) -> Level:
    """A level that some cases (n,) of the one before come to."""
    mean = float(reached.mean())
    share = before[-1].reached if before else 1.0
    return Level(
        threshold,
        mean / share if share else math.nan,
        mean,
        reached,
        acceptance,
        len(np.unique(states.number[within])),
    )
