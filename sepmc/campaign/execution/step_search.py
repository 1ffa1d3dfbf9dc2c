"""Search for the fewest steps of a kernel: in every stage, such that some cases come within a goal
of a reference."""

from collections.abc import Callable

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import errors
from sepmc.campaign.execution.integration import typical_durations
from sepmc.engine.dispatch import integrate_cases
from sepmc.engine.written_kernel import Kernel
from sepmc.schema import Status

_MOST_STEPS = 2048  # of a stage
_REFINED = 4  # times as many as there are at first, if that is more
_FINER = 8  # times as fine as a step that is given is what it is held against
_MAY_BE_LOST = 0.1  # of the cases may find steps of their own
# steps of a stage, over all trial cases, that the search of a reference may take: a minute
_MOST_WORK = 5_000_000
# that the whole search may take: then it makes do with what it has. Shipped ones take 4e3 to 2e5
_MOST_SEARCH = 4 * _MOST_WORK
# of an outcome, what cases of a given step differ by from finer ones however short it is
_ROUND_OFF = 2e-12
VOUCHED, IN_DOUBT, NO_OUTCOMES = 1, 0, -1

# Steps, methods and draws to outcomes (n, o), and of which cases a kernel vouches for them (n,): 1
# if it does, 0 if not; -1 if there are none.
IntegrateSteps = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
# What a step takes besides its evaluations, in evaluations: corrections, attitudes followed
_OF_A_STEP = 2


def mostly(verdict: np.ndarray) -> bool:
    """Whether a kernel vouches for most of the cases (n,) that have outcomes, if any has."""
    return bool(
        np.count_nonzero(verdict == VOUCHED) > 0.5 * np.count_nonzero(verdict != NO_OUTCOMES)
    )


def find_durations(campaign: Definition, kernel: Kernel, draws: np.ndarray) -> np.ndarray | None:
    """How long stages usually last, s, shape (stages,): the median of some cases (n, d), SI. None
    if the kernel can fly none."""
    durations, steps = np.full(kernel.n_segments, np.inf), np.full(kernel.n_segments, 2)
    while steps.max() <= _MOST_STEPS:
        block, ends = integrate_cases(
            kernel, campaign.plan, steps, durations, campaign.slots, draws
        )
        sound = block.status == Status.OK
        sound = sound if sound.any() else block.has_outcomes
        if sound.any():
            return typical_durations(ends, sound)
        steps *= 2
    return None


class Search:
    """Trials of steps on cases ``draws`` (n, d), SI, with errors taken relative to ``scale`` (o,)
    against a reference at many steps.

    Only outcomes that ``decides`` (o,) are held to the goal. ``methods`` (stages,) are those of the
    stages, by number; ``evaluations`` tell how many a step by each takes.
    """

    def __init__(
        self,
        flown: IntegrateSteps,
        draws: np.ndarray,
        scale: np.ndarray,
        goal: float,
        decides: np.ndarray,
        evaluations: list[list[int]],
    ):
        self.draws, self.scale, self.goal, self.decides = draws, scale, goal, decides
        self.evaluations = evaluations
        self.methods = np.zeros(len(evaluations), dtype=np.int64)
        self._fly, self.work = flown, 0
        self.reference, self.verdict = np.empty((0, len(scale))), np.full(len(draws), IN_DOUBT)
        self.settled = np.inf  # what halving the steps of the reference changes
        self.of_reference = np.full(len(scale), np.inf)  # that by outcome

    def flown(self, steps: np.ndarray, draws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outcomes and verdicts of draws with some steps, by the methods chosen so far."""
        self.work += len(draws) * int(steps.sum())
        return self._fly(steps, self.methods, draws)

    @property
    def spent(self) -> bool:
        """Whether the work is spent that a search may take."""
        return self.work > _MOST_SEARCH

    @property
    def fair(self) -> np.ndarray:
        """Which cases (n,) the kernel vouches for at the reference."""
        return np.asarray(self.verdict == VOUCHED)

    def fewest(self, first: np.ndarray) -> np.ndarray | None:
        """Fewest steps (stages,) with which the cases come within the goal; None if the kernel
        cannot vouch for most of them.

        The reference has at least as many as ``first`` (stages,). If it does not settle within
        twice the goal, what it settled to becomes the goal.
        """
        steps = self._refer(first)
        if np.isinf(self.settled) or not mostly(self.verdict):
            return None
        if self.settled > 2.0 * self.goal:
            self.goal = 2.0 * self.settled
        enough = self._enough(first, steps)
        return self._cheapest(self._together(self._alone(enough), enough))

    def of_one_step(self, stages: int) -> np.ndarray | None:
        """The step that is given, once for all ``stages``, held against a reference that is finer;
        None if the kernel cannot vouch for most of the cases."""
        steps = np.ones(stages, dtype=np.int64)
        self.reference, self.verdict = self.flown(_FINER * steps, self.draws)
        self.of_reference = np.full(len(self.scale), _ROUND_OFF)
        return steps if mostly(self.verdict) else None

    def largest(self, steps: np.ndarray) -> np.ndarray:
        """Largest error (o,) of each outcome with some steps; not less than that of the
        reference."""
        found, verdict = self.flown(steps, self.draws)
        both = (verdict == VOUCHED) & self.fair
        return np.maximum(
            errors(found[both], self.reference[both], self.scale).max(axis=0, initial=0.0),
            self.of_reference,
        )

    def _refer(self, first: np.ndarray) -> np.ndarray:
        """Fly the reference; returns its steps."""
        steps, most = first, max(_MOST_STEPS, _REFINED * int(first.max()))
        work = 0
        self.reference, self.verdict = self.flown(steps, self.draws)
        while self.settled > 0.02 * self.goal and 2 * steps.max() <= most:
            coarse, steps = steps, 2 * steps
            self.reference, self.verdict = self.flown(steps, self.draws)
            # steps are far too long: what the few others say is not what it is about
            if not mostly(self.verdict):
                continue
            now = self.error(coarse)
            # round-off, which some cases let grow: no steps come nearer than that
            if self.goal >= self.settled <= now < np.inf:
                self.settled = 2.0 * now
                break
            work += len(self.draws) * int(steps.sum())
            if now <= self.settled:
                self.of_reference = self._errors(coarse)
            self.settled = min(self.settled, now)
            if self.settled < np.inf and work > _MOST_WORK:
                break  # more take too long: what is reached is told
        return steps

    def _enough(self, first: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Twice ``first``, four times, ..., but not more than ``most``: the fewest with half of
        which the cases come within the goal. What one stage needs is then not hidden by the others,
        and flying them is cheaper than at the reference."""
        steps = first
        while (steps < most).any() and self.error(steps) > self.goal:
            steps = np.minimum(2 * steps, most)
        return np.minimum(2 * steps, most)

    def _errors(self, steps: np.ndarray) -> np.ndarray:
        """Largest error of each outcome, (o,); infinite if more cases are lost than may be."""
        found, verdict = self.flown(steps, self.draws)
        both = (verdict == VOUCHED) & self.fair
        if np.count_nonzero(self.fair & ~both) > _MAY_BE_LOST * len(self.draws) or not both.any():
            return np.full(len(self.scale), np.inf)
        return errors(found[both], self.reference[both], self.scale).max(axis=0, initial=0.0)

    def error(self, steps: np.ndarray) -> float:
        """Largest error with some steps, of the outcomes that decide; infinite if too many cases
        are lost."""
        return float(self._errors(steps)[self.decides].max(initial=0.0))

    def _alone(self, steps: np.ndarray) -> np.ndarray:
        """Fewest steps of every stage by itself, the others as fine as they were."""
        chosen = steps.copy()
        for stage in range(len(chosen)):
            low, high = 0, int(steps[stage])
            while high - low > 1 and not self.spent:
                trial = steps.copy()
                trial[stage] = middle = (low + high) // 2
                low, high = (low, middle) if self.error(trial) <= self.goal else (middle, high)
            chosen[stage] = high
        return chosen

    def _cheapest(self, steps: np.ndarray) -> np.ndarray:
        """Steps of each stage by the method with which it takes the least work, one stage after the
        other: that which takes most of it first."""
        work = [self._work(stage, number) for stage, number in enumerate(steps)]
        for stage in sorted(range(len(steps)), key=lambda k: -work[k]):
            for method in range(1, len(self.evaluations[stage])):
                steps = self._by(method, stage, steps)
        return steps

    def _by(self, method: int, stage: int, steps: np.ndarray) -> np.ndarray:
        """Fewest steps of a stage by another method, if they take less work; or else as before."""
        before, trial = int(self.methods[stage]), steps.copy()
        most = self._work(stage, int(steps[stage])) - 1

        def enough(number: int) -> bool:
            trial[stage] = number
            return self.error(trial) <= self.goal

        self.methods[stage] = method
        low, high = 0, most // self._work(stage, 1)
        if high == 0 or self.spent or not enough(high):
            self.methods[stage] = before
            return steps
        while high - low > 1 and not self.spent:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        trial[stage] = high
        return trial

    def _work(self, stage: int, steps: int) -> int:
        """What some steps of a stage take by its method, in evaluations."""
        return steps * (self.evaluations[stage][self.methods[stage]] + _OF_A_STEP)

    def _together(self, chosen: np.ndarray, most: np.ndarray) -> np.ndarray:
        """One more step, or a sixteenth, where it helps most, until all stages together come within
        the goal."""
        error = self.error(chosen)
        while error > self.goal and (chosen < most).any():
            if self.spent:
                return most
            more = np.diag(np.maximum(1, chosen // 16))
            trials = [np.minimum(chosen + unit, most) for unit in more]
            found = [self.error(trial) if (trial > chosen).any() else np.inf for trial in trials]
            if min(found) < np.inf:
                chosen, error = trials[int(np.argmin(found))], min(found)
            else:
                chosen = np.minimum(2 * chosen, most)
                error = self.error(chosen)
        return chosen
