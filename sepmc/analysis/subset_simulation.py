"""Subset simulation of probabilities too small to be counted by direct Monte Carlo.

The inputs of a case are independent standard normal variables, its scores. The model gives a margin
for them (the signed distance of an outcome from its bound); the case violates if it is negative.

Levels are thresholds of the margin that fall towards 0, each reached by a tenth of the cases that
reach the one before (Au and Beck, Probabilistic Engineering Mechanics 16 (2001) 263). Within a
level, Markov chains sample cases by conditional moves of adaptive size (Papaioannou, Betz,
Zwirglmaier and Straub, Probabilistic Engineering Mechanics 41 (2015) 89). Trial chains serve only
to find thresholds and step sizes. With these fixed, independent replicas start anew: at every level
a replica resamples the cases that reach the threshold to as many seeds as it has chains, and keeps
all states of the chains (Dau and Chopin, J. R. Stat. Soc. B 84 (2022) 114). So the product of the
fractions is an unbiased estimate of the probability, however well the chains mix, and the
confidence interval follows from the spread of independent estimates alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from sepmc.analysis.proportions import CONFIDENCE, binomial_interval
from sepmc.analysis.statistics import TWO_SIDED

REPLICAS = 10  # coverage 94 to 97 %; with twenty of half the size 92 to 96 %
LENGTH = 10  # states of a chain, 1 / fraction of seeds; with a fifth as seeds 4 % more spread
_ACCEPTED = 0.44  # acceptance rate of trial chains: Papaioannou et al., section 3.3
_FIRST_STEP = 0.6
_MAX_LEVELS = 16  # a probability of 1e-16, the resolution of floats near 1
_TRIAL_CASES = (300, 3000)  # cases of a level of trial chains, at least and at most
_MIN_CASES = 100  # smallest number of cases of a level of a replica
_MAX_UNKNOWN = 0.5  # largest fraction of trial cases beyond the bound without a margin
_MAX_SPREAD = 0.8  # relative spread of replicas: typically 0.35, with 1e5 cases for 1e-6
_MIN_ACCEPTED = 0.15  # smallest acceptance rate without a warning
_MIN_ORIGINS = 5  # ancestors of violating cases per replica; typically 20

# maps scores (n, d) to margins (n,), NaN where a case has none, and records (n, k)
LimitFunction = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
NamedGenerator = Callable[[str], np.random.Generator]  # random generators by name


@dataclass(frozen=True)
class ChainStates:
    """States of n chains (or of several steps of them): each is a case that was run.

    ``scores`` (n, d) are its inputs, ``margin`` (n,) and ``records`` (n, k) the results of the
    limit function, ``number`` (n,) its place, from 0, in the order of all cases run, ``level``
    (n,) the index, from 0, of the level for which it was run, and ``origin`` (n,) the index of its
    ancestor among the cases of the first level.
    """

    scores: np.ndarray
    margin: np.ndarray
    records: np.ndarray
    number: np.ndarray
    level: np.ndarray
    origin: np.ndarray

    def at(self, indices: np.ndarray) -> Self:
        """Return the states at ``indices`` (m,), in that order."""
        return type(self)(*(getattr(self, f.name)[indices] for f in fields(self)))

    def moved(self, to: Self, accepted: np.ndarray) -> Self:
        """Return the states of the chains after a move: those of ``to`` where the mask ``accepted``
        (n,) is True, else the present ones."""
        pairs = ((getattr(self, f.name), getattr(to, f.name)) for f in fields(self))
        choice = (np.where(accepted if a.ndim == 1 else accepted[:, None], b, a) for a, b in pairs)
        return type(self)(*choice)

    @classmethod
    def joined(cls, states: Sequence[Self]) -> Self:
        """Return the states of all elements of ``states``, concatenated."""
        return cls(*(np.concatenate([getattr(one, f.name) for one in states]) for f in fields(cls)))


@dataclass(frozen=True)
class LevelSchedule:
    """Falling ``thresholds`` of the margin, found by trial chains, and for each the step sizes,
    ``steps`` (d,), of the chains within it. None is negative: violation, a margin
    below 0, follows the last one.

    Cases without a margin count as if their margin were ``worst``: -inf to count them as
    violations, inf not to. ``known`` and ``unknown`` are the numbers of trial cases of the last
    level that violate and that have no margin. ``reached`` is True if at least a tenth of the
    cases of that level count as violating, so that no further level is needed.
    """

    thresholds: list[float]
    steps: list[np.ndarray]
    worst: float
    known: int
    unknown: int
    reached: bool


@dataclass(frozen=True)
class Level:
    """Result of all replicas for a threshold of the margin.

    Parameters
    ----------
    threshold : float
        A case reaches the level if its margin is at most this; the last level has the threshold 0,
        and the margin must be negative.
    probability : float
        Estimated probability to reach this level for a case that reaches the level before; NaN if
        none does.
    reached : float
        Estimated probability of a case to reach this level, the mean of ``replicas``.
    replicas : ndarray, shape (r,)
        Estimate of that probability by each replica.
    acceptance : float
        Acceptance rate of the chains whose cases were compared with the threshold; NaN for the
        first level, of independent cases.
    seeds : int
        Number of distinct cases that reach the threshold.
    """

    threshold: float
    probability: float
    reached: float
    replicas: np.ndarray
    acceptance: float
    seeds: int


@dataclass(frozen=True)
class Estimate:
    """Estimate of the probability of a violation, a negative margin, from independent replicas.

    Parameters
    ----------
    known, unknown : ndarray, shape (r,)
        Estimate of each replica for the probability of a negative margin, and of no margin (0 if
        cases without a margin were not counted as violations).
    levels : tuple of Level
        In the order of falling thresholds; the last one has the threshold 0.
    last : ChainStates
        The n cases of all replicas that were run for the last level.
    replica : ndarray, shape (n,), int
        Replica of each case of ``last``.
    weight : ndarray, shape (n,)
        Weight of each case of ``last``; the weights of violating cases add up to the estimate.
    origins : int
        Number of cases of the first level from which all violating cases descend.
    size : int
        Number of cases of a level in each replica.
    reached : bool
        True if the trial chains, which set the thresholds before, reached the bound: at least a
        tenth of the cases of their last level count as violating.
    """

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
        """Estimated probability of a negative margin, the mean over the replicas."""
        return float(self.known.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Ends (low, high) of the 95 % interval of the probability of a negative margin; 0 and an
        upper bound, at most 1, if no case has one."""
        return self._interval(self.known)

    @property
    def interval_with_unknown(self) -> tuple[float, float]:
        """Ends (low, high) of the 95 % interval of the probability that a case has a negative
        margin or no margin; 0 and an upper bound, at most 1, if no case has either."""
        return self._interval(self.known + self.unknown)

    def _interval(self, estimates: np.ndarray) -> tuple[float, float]:
        """Return the ends (low, high) of the 95 % interval of a probability, from its ``estimates``
        (r,) by the replicas.

        With only one level, direct Monte Carlo, it is the binomial interval of all cases, else
        `mean_interval`. If all estimates are 0, ``low`` is 0 and ``high`` is that of the
        probability to reach the last level that any replica reached, or 1 if there is none.
        """
        if len(self.levels) == 1:  # direct Monte Carlo
            cases = self.size * len(estimates)
            return binomial_interval(round(float(estimates.mean()) * cases), cases)
        if not estimates.any():  # bounded by the probability of the last threshold reached
            reached = [level.replicas for level in self.levels if level.reached > 0.0]
            return 0.0, mean_interval(reached[-1])[1] if reached else 1.0
        return mean_interval(estimates)

    @property
    def spread(self) -> float:
        """Standard deviation of the replicas relative to their mean; NaN if that is 0."""
        mean = self.probability
        return float(self.known.std(ddof=1)) / mean if mean else math.nan


def mean_interval(estimates: np.ndarray, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the confidence interval of the mean of independent estimates of a probability.

    Its ends are the mean times exp(+-t s), with Student's t for r - 1 degrees of freedom and the
    relative standard error s of the mean, as the scatter of estimates is that of a log-normal
    distribution. Coverage: `tests/measure/rare.py`.

    Parameters
    ----------
    estimates : ndarray, shape (r,)
        Not negative, and not all 0.
    confidence : float

    Returns
    -------
    low, high : float
        ``high`` is at most 1.
    """
    from scipy.special import stdtrit  # noqa: PLC0415  (0.1 s that other commands do not need)

    count, mean = len(estimates), float(estimates.mean())
    error = float(estimates.std(ddof=1)) / math.sqrt(count) / mean
    half_width = float(stdtrit(count - 1, 0.5 + 0.5 * confidence)) * error
    return mean * math.exp(-half_width), min(1.0, mean * math.exp(half_width))


def equivalent_direct_cases(probability: float, interval: tuple[float, float]) -> float:
    """Return how many cases direct Monte Carlo would need for an equally narrow interval.

    Parameters
    ----------
    probability : float
        The estimate.
    interval : tuple of float
        Low and high end of its 95 % interval; the ratio of the ends is the measure of its width.

    Returns
    -------
    float
        NaN if the low end is 0 or not below the high end.
    """
    low, high = interval
    if not 0.0 < low < high:
        return math.nan
    sigma = 0.5 * math.log(high / low) / TWO_SIDED
    return (1.0 - probability) / probability / sigma**2


def estimate(
    limit: LimitFunction, dimensions: int, random: NamedGenerator, max_cases: int
) -> tuple[Estimate, Estimate, int]:
    """Estimate the probability of a negative margin by subset simulation.

    Parameters
    ----------
    limit : LimitFunction
        Runs cases: maps scores (n, d) to margins (n,), NaN where a case has none, and to records
        (n, k), which are only passed on.
    dimensions : int
        Number d of scores, independent standard normal variables.
    random : NamedGenerator
        Returns the random generator of a name, at its start each time.
    max_cases : int
        Largest number of cases to run.

    Returns
    -------
    known, all_of : Estimate
        ``all_of`` counts cases without a margin as violations; ``known`` does not. Both are the
        same object, in which such cases are counted separately, unless they are so many among the
        trial cases that they hide the violating ones; then each is estimated with half the cases.
    n_cases : int
        Number of cases run.
    """
    counter = _CaseCounter(limit)
    trial_cases = LENGTH * round(float(np.clip(max_cases // 100, *_TRIAL_CASES)) / LENGTH)
    depth = _depth(max_cases, trial_cases)
    schedules = [_levels(counter, dimensions, random("levels"), trial_cases, depth, -math.inf)]
    if schedules[0].unknown > _MAX_UNKNOWN * (schedules[0].known + schedules[0].unknown):
        generator = random("levels without unknown")
        depth = _depth((max_cases - counter.count) // 2, trial_cases)
        schedules.insert(0, _levels(counter, dimensions, generator, trial_cases, depth, math.inf))
    per_schedule = (max_cases - counter.count) // len(schedules)
    estimates = [
        _replicas(counter, dimensions, random, _level_size(schedule, per_schedule), schedule)
        for schedule in schedules
    ]
    return estimates[0], estimates[-1], counter.count


def _depth(n_cases: int, trial_cases: int) -> int:
    """Return the number of levels, at most 16, that ``n_cases`` in all allow beyond the first one,
    with ``trial_cases`` in each level of the trial chains and the smallest allowed number of cases
    in each level of a replica."""
    levels = (n_cases / (trial_cases + _MIN_CASES * REPLICAS) - 1.0) / (1.0 - 1.0 / LENGTH)
    return max(0, min(_MAX_LEVELS, int(levels)))


def estimate_warnings(estimate: Estimate) -> list[str]:
    """Return the warnings on an estimate, a sentence each; an empty list if nothing suggests that
    the estimate or its interval is wrong. They are on trial chains that did not reach violating
    cases, replicas that disagree, violating cases that descend from too few, and chains that hardly
    move."""
    warnings, low, high = [], float(estimate.known.min()), float(estimate.known.max())
    if not estimate.reached:
        threshold = estimate.levels[-2].threshold if len(estimate.levels) > 1 else math.inf
        margin = (
            f" went down to a margin of {threshold:.4g} only"
            if math.isfinite(threshold)
            else " found no level below the directly sampled cases"
        )
        warnings.append(
            f"trial chains{margin}, and few cases violate the bound: more cases may improve the "
            "estimate"
            if estimate.known.any()
            else f"trial chains{margin}, and no case violates the bound: it may be out of reach, "
            "lie at a jump of the margin, or need more cases"
        )
    if estimate.known.any() and len(estimate.levels) > 1:
        if low == 0.0 or estimate.spread > _MAX_SPREAD:
            warnings.append(
                f"replicas disagree, with probabilities from {low:.2e} to {high:.2e}: the interval "
                "may be too narrow, as some may have missed a failure mode; allow more cases"
            )
        if estimate.origins < _MIN_ORIGINS * len(estimate.known):
            warnings.append(
                f"all violating cases descend from {estimate.origins} cases of the first level in "
                f"{len(estimate.known)} replicas, which are too few: allow more cases"
            )
    stuck = [
        f"{level.acceptance:.2f} at a margin of {level.threshold:.4g}"
        for level in estimate.levels
        if level.acceptance < _MIN_ACCEPTED
    ]
    if stuck:
        warnings.append(
            f"chains hardly move, so the interval may be too narrow: their acceptance rate is "
            f"{', '.join(stuck)}"
        )
    return warnings


class _CaseCounter:
    """Runs cases by the limit function (`evaluate`) and numbers them from 0 in the order in which
    they are run; ``count`` is how many were run so far."""

    def __init__(self, limit: LimitFunction):
        self.limit, self.count = limit, 0

    def evaluate(self, scores: np.ndarray, level: int, origin: np.ndarray) -> ChainStates:
        """Run the n cases of ``scores`` (n, d) and return them as states with the index ``level``
        and with ``origin`` (n,), the indices of their ancestors in the first level."""
        margin, records = self.limit(scores)
        number = np.arange(self.count, self.count + len(scores))
        self.count += len(scores)
        return ChainStates(scores, margin, records, number, np.full(len(scores), level), origin)


def _ordering(states: ChainStates, worst: float) -> np.ndarray:
    """Return the margins (n,) of states, with ``worst`` in place of NaN, by which cases are
    compared with thresholds."""
    return np.where(np.isnan(states.margin), worst, states.margin)


def _levels(
    counter: _CaseCounter,
    dimensions: int,
    random: np.random.Generator,
    size: int,
    depth: int,
    worst: float,
) -> LevelSchedule:
    """Find thresholds and step sizes with trial chains of ``size`` cases in each level; a case has
    ``dimensions`` scores.

    The first level has independent cases; at most ``depth`` levels follow, none after a level of
    which a tenth of the cases counts as violating, or below which no threshold is found. Cases
    without a margin count as if their margin were ``worst``.
    """
    states = counter.evaluate(random.standard_normal((size, dimensions)), 0, np.arange(size))
    thresholds: list[float] = []
    steps: list[np.ndarray] = []
    scale, chains = _FIRST_STEP, size // LENGTH
    while True:
        ordering = _ordering(states, worst)
        n_unknown, n_known = np.isnan(states.margin).sum(), np.count_nonzero(states.margin < 0.0)
        reached = np.count_nonzero(ordering < 0.0) >= chains
        threshold = None if reached else _next_threshold(ordering, chains, thresholds)
        if threshold is None or len(thresholds) == depth:
            return LevelSchedule(
                thresholds, steps, worst, int(n_known), int(n_unknown), bool(reached)
            )
        thresholds.append(threshold)
        seeds = states.at(_resample(np.flatnonzero(ordering <= threshold), chains, random))
        sigma = seeds.scores.std(axis=0)
        chain = [seeds]
        for k in range(1, LENGTH):
            step = np.minimum(1.0, scale * sigma)
            noise = random.standard_normal(seeds.scores.shape)
            states, accepted = _moved(counter, chain[-1], step, noise, threshold, worst, len(steps))
            chain.append(states)
            scale *= math.exp((accepted - _ACCEPTED) / math.sqrt(k))
        steps.append(np.minimum(1.0, scale * sigma))
        states = ChainStates.joined(chain)


def _next_threshold(ordering: np.ndarray, chains: int, before: list[float]) -> float | None:
    """Return the next threshold: the margin that ``chains`` cases of ``ordering`` (n,) reach, at
    least 0 and below the thresholds ``before`` or, if there are none, below the largest margin. If
    so many margins are equal that there is none, it is the largest margin that is below. None if
    that is negative or does not exist."""
    ascending = np.sort(ordering)
    last = before[-1] if before else ascending[-1]  # a threshold that all cases reach is no level
    if ascending[chains - 1] < last:
        return max(0.0, float(ascending[chains - 1]))
    beyond = ascending[ascending < last]  # many cases are equal
    return max(0.0, float(beyond[-1])) if len(beyond) and beyond[-1] >= 0.0 else None


def _resample(indices: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Return ``count`` of the ``indices``, in which the numbers of copies of an index differ by at
    most one."""
    whole, remainder = divmod(count, len(indices))
    extra = random.permutation(indices)[:remainder]
    return np.concatenate([np.tile(indices, whole), extra])


def _moved(
    counter: _CaseCounter,
    states: ChainStates,
    step: np.ndarray,
    noise: np.ndarray,
    threshold: float,
    worst: float,
    level: int,
) -> tuple[ChainStates, float]:
    """Propose a conditional move of size ``step`` (d,), 0 to 1, for each of n chains, and accept
    those whose margin is at most the threshold; such moves preserve the normal distribution.

    ``noise`` (n, d) is standard normal. The cases run belong to the level after ``level``; those
    without a margin count as if it were ``worst``. Return the states after the move and the
    acceptance rate.
    """
    scores = np.sqrt(1.0 - step**2) * states.scores + step * noise
    proposed = counter.evaluate(scores, level + 1, states.origin)
    accepted = _ordering(proposed, worst) <= threshold
    return states.moved(proposed, accepted), float(accepted.mean())


def _level_size(schedule: LevelSchedule, n_cases: int) -> int:
    """Return the number of cases in each level of a replica, a multiple of `LENGTH`, for which all
    replicas together run about ``n_cases``; the seeds of a level are not run again."""
    cases_per_seed = 1.0 + len(schedule.thresholds) * (1.0 - 1.0 / LENGTH)
    return LENGTH * max(1, int(n_cases / REPLICAS / cases_per_seed / LENGTH))


def _replicas(
    counter: _CaseCounter,
    dimensions: int,
    random: NamedGenerator,
    size: int,
    schedule: LevelSchedule,
) -> Estimate:
    """Run all replicas, their chains side by side, through the levels of a schedule, with ``size``
    cases in each level of a replica; return their estimate."""
    suffix = "" if schedule.worst < 0.0 else " without unknown"
    generators = [random(f"replica {k}{suffix}") for k in range(REPLICAS)]
    chains, reached = size // LENGTH, np.ones(REPLICAS)

    def noise(count: int) -> np.ndarray:
        return np.concatenate([one.standard_normal((count, dimensions)) for one in generators])

    states = counter.evaluate(noise(size), 0, np.arange(size * REPLICAS))
    replica = np.repeat(np.arange(REPLICAS), size)
    levels: list[Level] = []
    acceptance = math.nan
    for number, (threshold, step) in enumerate(
        zip(schedule.thresholds, schedule.steps, strict=True)
    ):
        ordering = _ordering(states, schedule.worst)
        within = ordering <= threshold
        reached = reached * np.bincount(replica, within, REPLICAS) / size
        levels.append(_level(threshold, states, within, reached, levels, acceptance))
        indices = []
        for k, generator in enumerate(generators):
            own = np.flatnonzero(within & (replica == k))
            if not len(own):  # estimate 0: its chains stay
                own = np.flatnonzero(replica == k)
            indices.append(_resample(own, chains, generator))
        chain, acceptances = [states.at(np.concatenate(indices))], []
        for _ in range(1, LENGTH):
            after, accepted = _moved(
                counter, chain[-1], step, noise(chains), threshold, schedule.worst, number
            )
            chain.append(after)
            acceptances.append(accepted)
        states, acceptance = ChainStates.joined(chain), float(np.mean(acceptances))
        replica = np.tile(np.repeat(np.arange(REPLICAS), chains), LENGTH)
    violates = states.margin < 0.0
    known, unknown = (
        reached * np.bincount(replica, mask, REPLICAS) / size
        for mask in (violates, np.isnan(states.margin) & (schedule.worst < 0.0))
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
        schedule.reached,
    )


def _level(
    threshold: float,
    states: ChainStates,
    mask: np.ndarray,
    reached: np.ndarray,
    levels: Sequence[Level],
    acceptance: float,
) -> Level:
    """Build the `Level` of a threshold.

    ``reached`` (r,) are the estimates of the replicas for the probability to reach it, from the
    start; the conditional probability is their mean over that of the last of ``levels``, the levels
    before it, and NaN if no case reached that one. ``states`` are the n cases compared with it,
    ``mask`` (n,) is True for those that reach it: both give only the number of distinct such cases.
    ``acceptance`` becomes a field.
    """
    mean = float(reached.mean())
    previous = levels[-1].reached if levels else 1.0
    return Level(
        threshold,
        mean / previous if previous else math.nan,
        mean,
        reached,
        acceptance,
        len(np.unique(states.number[mask])),
    )
