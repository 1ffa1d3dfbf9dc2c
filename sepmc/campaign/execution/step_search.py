"""Search for the fewest steps of each kernel segment, and its cheapest method, at which cases meet
a tolerance."""

from collections.abc import Callable

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import errors
from sepmc.campaign.execution.integration import typical_durations
from sepmc.engine.dispatch import integrate_cases
from sepmc.engine.written_kernel import Kernel
from sepmc.schema import Status

_MAX_STEPS = 2048  # of a segment
_REFERENCE_FACTOR = 4  # maximum steps over the first ones, if that is more
_GIVEN_STEP_FACTOR = 8  # refinement of the reference of a given step
_MAX_REJECTED = 0.1  # fraction of cases that may be refined by themselves
# Work of a search: segment steps over all calibration cases. Shipped campaigns take 4e3 to 2e5.
# Beyond this it ends with the steps it has; beyond a quarter (a minute) no finer reference is made.
_MAX_WORK = 20_000_000
_MAX_REFERENCE_WORK = _MAX_WORK // 4
# of an outcome: difference from a finer step that no step avoids
_ROUND_OFF = 2e-12
VALID, IN_DOUBT, NO_OUTCOMES = 1, 0, -1

# (steps, methods, inputs (n, d), SI) to outcomes (n, o), SI, and verdicts (n,): VALID, IN_DOUBT,
# NO_OUTCOMES
IntegrateSteps = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
# work of a step besides its evaluations, in evaluations: projection, attitudes
_STEP_OVERHEAD = 2


def most_are_valid(verdict: np.ndarray) -> bool:
    """Return True if, without the cases whose ``verdict`` (n,) is NO_OUTCOMES, more than half are
    VALID; False if all are NO_OUTCOMES."""
    return bool(np.count_nonzero(verdict == VALID) > 0.5 * np.count_nonzero(verdict != NO_OUTCOMES))


def find_durations(campaign: Definition, kernel: Kernel, draws: np.ndarray) -> np.ndarray | None:
    """Measure the typical duration of each kernel segment, with ever more steps until some case
    reaches its end.

    Parameters
    ----------
    campaign : Definition
    kernel : Kernel
    draws : ndarray, shape (n, d)
        Inputs of n cases, SI.

    Returns
    -------
    ndarray, shape (segments,), or None
        Durations from the median end times of the cases, s; None if no case reaches its end.
    """
    durations, steps = np.full(kernel.n_segments, np.inf), np.full(kernel.n_segments, 2)
    while steps.max() <= _MAX_STEPS:
        block, ends = integrate_cases(
            kernel, campaign.layout, steps, durations, campaign.slots, draws
        )
        is_ok = block.status == Status.OK
        is_ok = is_ok if is_ok.any() else block.has_outcomes
        if is_ok.any():
            return typical_durations(ends, is_ok)
        steps *= 2
    return None


class Search:
    """Search for the fewest steps of each segment, and its cheapest method, at which a set of cases
    meets a tolerance; `fewest_steps` performs it.

    Steps (segments,) are numbers of steps, one for each segment; ``stage`` is the index of a
    segment.

    Parameters
    ----------
    evaluate : callable
        ``evaluate(steps, methods, draws)`` integrates n cases and returns outcomes (n, o), SI,
        and verdicts (n,): VALID; IN_DOUBT, if other steps may make the case valid; NO_OUTCOMES.
    draws : ndarray, shape (n, d)
        Inputs of the cases, SI.
    scale : ndarray, shape (o,)
        Scale of each outcome; see `sepmc.campaign.execution.accuracy.errors`.
    tolerance : float
        Largest allowed relative error of a decisive outcome; the search may raise it.
    is_decisive : ndarray of bool, shape (o,)
        True for the outcomes that must meet the tolerance.
    evaluations : list of list of int
        By segment and method: number of derivative evaluations in a step.

    Attributes
    ----------
    methods : ndarray, shape (segments,)
        Index of the selected method of each segment; 0 is the most exact one.
    reference : ndarray, shape (n, o)
        Outcomes at many steps, against which errors are measured.
    verdict : ndarray, shape (n,)
        Verdicts of the cases in the reference.
    reference_change : float
        Error of the reference: the largest relative change of a decisive outcome by a doubling of
        its steps, of the doubling where that is smallest; twice the change of the last one if
        round-off grows with the steps. Infinite without such a doubling.
    reference_errors : ndarray, shape (o,)
        Relative change of each outcome by the doubling with the smallest change; infinite without
        such a doubling, 2e-12 if the file gives the step.
    work : int
        Number of steps integrated so far, over all cases and segments.
    """

    def __init__(
        self,
        evaluate: IntegrateSteps,
        draws: np.ndarray,
        scale: np.ndarray,
        tolerance: float,
        is_decisive: np.ndarray,
        evaluations: list[list[int]],
    ):
        self.draws, self.scale, self.tolerance, self.is_decisive = (
            draws,
            scale,
            tolerance,
            is_decisive,
        )
        self.evaluations = evaluations
        self.methods = np.zeros(len(evaluations), dtype=np.int64)
        self._integrate, self.work = evaluate, 0
        self.reference, self.verdict = np.empty((0, len(scale))), np.full(len(draws), IN_DOUBT)
        self.reference_change = np.inf  # by a doubling of its steps
        self.reference_errors = np.full(len(scale), np.inf)  # by outcome

    def evaluate(self, steps: np.ndarray, draws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Integrate cases with inputs ``draws`` (n, d), SI, at ``steps`` (segments,) by the
        selected methods; return outcomes (n, o), SI, and verdicts (n,), and add the steps of all
        cases to ``work``."""
        self.work += len(draws) * int(steps.sum())
        return self._integrate(steps, self.methods, draws)

    @property
    def is_exhausted(self) -> bool:
        """True if the search has integrated more steps than it may in all."""
        return self.work > _MAX_WORK

    @property
    def is_valid(self) -> np.ndarray:
        """Mask (n,) of the cases that are VALID in the reference."""
        return np.asarray(self.verdict == VALID)

    def fewest_steps(self, min_steps: np.ndarray) -> np.ndarray | None:
        """Search and return the fewest steps (segments,) at which the cases meet the tolerance;
        None if most cases are not valid, or the reference does not converge at all. Also sets
        `methods` and `reference`.

        The reference has at least ``min_steps`` (segments,). If its error, `reference_change`, is
        more than twice the tolerance, the tolerance is raised to twice that error.
        """
        steps = self._integrate_reference(min_steps)
        if np.isinf(self.reference_change) or not most_are_valid(self.verdict):
            return None
        if self.reference_change > 2.0 * self.tolerance:
            self.tolerance = 2.0 * self.reference_change
        is_sufficient = self._sufficient_steps(min_steps, steps)
        return self._cheapest_methods(
            self._increase_jointly(self._reduce_each(is_sufficient), is_sufficient)
        )

    def given_step(self, stages: int) -> np.ndarray | None:
        """Use the step that the file gives, in place of a search: integrate the reference at an
        eighth of it.

        ``stages`` is the number of segments. Returns ones, shape (stages,), as the given step is
        not divided; None if most cases are not valid.
        """
        steps = np.ones(stages, dtype=np.int64)
        self.reference, self.verdict = self.evaluate(_GIVEN_STEP_FACTOR * steps, self.draws)
        self.reference_errors = np.full(len(self.scale), _ROUND_OFF)
        return steps if most_are_valid(self.verdict) else None

    def largest_errors(self, steps: np.ndarray) -> np.ndarray:
        """Largest relative error (o,) of each outcome against the reference, at least the error of
        the reference itself; over the cases that are valid both in it and at ``steps``
        (segments,), at which they are integrated."""
        outcomes, verdict = self.evaluate(steps, self.draws)
        in_both = (verdict == VALID) & self.is_valid
        return np.maximum(
            errors(outcomes[in_both], self.reference[in_both], self.scale).max(axis=0, initial=0.0),
            self.reference_errors,
        )

    def _integrate_reference(self, min_steps: np.ndarray) -> np.ndarray:
        """Integrate the reference, doubling the steps from ``min_steps`` (segments,) until it has
        converged or takes too long; set `reference`, its verdicts and errors; return its steps."""
        steps, max_steps = min_steps, max(_MAX_STEPS, _REFERENCE_FACTOR * int(min_steps.max()))
        self.reference, self.verdict = self.evaluate(steps, self.draws)
        while self.reference_change > 0.02 * self.tolerance and 2 * steps.max() <= max_steps:
            coarse, steps = (self.reference, self.verdict), 2 * steps
            self.reference, self.verdict = self.evaluate(steps, self.draws)
            # steps are far too long for most cases
            if not most_are_valid(self.verdict):
                continue
            changes = self._compare(*coarse)
            change = float(changes[self.is_decisive].max(initial=0.0))
            # round-off that grows in some cases: smaller steps do not help
            if self.tolerance >= self.reference_change <= change < np.inf:
                self.reference_change = 2.0 * change
                break
            if change <= self.reference_change:
                self.reference_errors = changes
            self.reference_change = min(self.reference_change, change)
            if self.reference_change < np.inf and self.work > _MAX_REFERENCE_WORK:
                break  # more would take too long
        return steps

    def _sufficient_steps(self, min_steps: np.ndarray, max_steps: np.ndarray) -> np.ndarray:
        """Return twice the steps (segments,) at which the cases meet the tolerance, at most
        ``max_steps``, those of the reference.

        The steps start at ``min_steps`` and are doubled in all segments together. The factor of two
        keeps the errors of other segments small while the steps of one are reduced
        (`_reduce_each`), and integration is cheaper than with the steps of the reference.
        """
        steps = min_steps
        while (steps < max_steps).any() and self.error(steps) > self.tolerance:
            steps = np.minimum(2 * steps, max_steps)
        return np.minimum(2 * steps, max_steps)

    def _errors(self, steps: np.ndarray) -> np.ndarray:
        """Largest relative error (o,) of each outcome at ``steps`` (segments,) against the
        reference, over the cases valid in both; infinite if these are too few
        (`_compare`)."""
        return self._compare(*self.evaluate(steps, self.draws))

    def _compare(self, outcomes: np.ndarray, verdict: np.ndarray) -> np.ndarray:
        """Largest relative error (o,) of each outcome over n cases, from ``outcomes`` (n, o) and
        ``verdict`` (n,), against the reference.

        It is infinite if the number of cases that are valid in the reference but not here is more
        than a tenth of n, or no case is valid in both.
        """
        in_both = (verdict == VALID) & self.is_valid
        if (
            np.count_nonzero(self.is_valid & ~in_both) > _MAX_REJECTED * len(self.draws)
            or not in_both.any()
        ):
            return np.full(len(self.scale), np.inf)
        return errors(outcomes[in_both], self.reference[in_both], self.scale).max(
            axis=0, initial=0.0
        )

    def error(self, steps: np.ndarray) -> float:
        """Largest relative error at ``steps`` (segments,) against the reference, over the decisive
        outcomes of the cases valid in both; infinite if these are too few (`_compare`)."""
        return float(self._errors(steps)[self.is_decisive].max(initial=0.0))

    def _reduce_each(self, steps: np.ndarray) -> np.ndarray:
        """Return, for each segment alone, the fewest steps at which the cases meet the tolerance
        while the other segments have their ``steps`` (segments,); shape (segments,).

        At all ``steps`` the cases must meet it. The result may be more than the fewest if the
        search has used up its work (`is_exhausted`)."""
        steps_chosen = steps.copy()
        for stage in range(len(steps_chosen)):
            low, high = 0, int(steps[stage])
            while high - low > 1 and not self.is_exhausted:
                trial = steps.copy()
                trial[stage] = middle = (low + high) // 2
                low, high = (low, middle) if self.error(trial) <= self.tolerance else (middle, high)
            steps_chosen[stage] = high
        return steps_chosen

    def _cheapest_methods(self, steps: np.ndarray) -> np.ndarray:
        """Select for each segment the method with the least work at which the cases meet the
        tolerance, the most expensive segment first; set `methods`, and return the steps (segments,)
        for these methods. ``steps`` are those for the methods so far."""
        work = [self._work_of(stage, number) for stage, number in enumerate(steps)]
        for stage in sorted(range(len(steps)), key=lambda k: -work[k]):
            for method in range(1, len(self.evaluations[stage])):
                steps = self._with_method(method, stage, steps)
        return steps

    def _with_method(self, method: int, stage: int, steps: np.ndarray) -> np.ndarray:
        """Try another method (index ``method``) for the segment with index ``stage``.

        If it meets the tolerance with less work, it is selected, and the steps (segments,) with its
        fewest steps in that segment are returned; else ``steps`` is returned unchanged.
        """
        previous, trial = int(self.methods[stage]), steps.copy()
        max_steps = self._work_of(stage, int(steps[stage])) - 1

        def is_sufficient(number: int) -> bool:
            trial[stage] = number
            return self.error(trial) <= self.tolerance

        self.methods[stage] = method
        low, high = 0, max_steps // self._work_of(stage, 1)
        if high == 0 or self.is_exhausted or not is_sufficient(high):
            self.methods[stage] = previous
            return steps
        while high - low > 1 and not self.is_exhausted:
            middle = (low + high) // 2
            low, high = (low, middle) if is_sufficient(middle) else (middle, high)
        trial[stage] = high
        return trial

    def _work_of(self, stage: int, steps: int) -> int:
        """Work of a number of ``steps`` in the segment with index ``stage`` by its selected method,
        in derivative evaluations; the overhead of a step counts as `_STEP_OVERHEAD` of them."""
        return steps * (self.evaluations[stage][self.methods[stage]] + _STEP_OVERHEAD)

    def _increase_jointly(self, steps_chosen: np.ndarray, max_steps: np.ndarray) -> np.ndarray:
        """Raise the steps ``steps_chosen`` (segments,), up to ``max_steps``, until all cases meet
        the tolerance, and return them: each time in the segment where it reduces the error most, by
        a sixteenth of its steps, at least one. While no such rise gives a finite error, the steps
        of all segments are doubled. Returns ``max_steps`` if the search has used up its work
        (`is_exhausted`)."""
        error = self.error(steps_chosen)
        while error > self.tolerance and (steps_chosen < max_steps).any():
            if self.is_exhausted:
                return max_steps
            increments = np.diag(np.maximum(1, steps_chosen // 16))
            trials = [np.minimum(steps_chosen + unit, max_steps) for unit in increments]
            trial_errors = [
                self.error(trial) if (trial > steps_chosen).any() else np.inf for trial in trials
            ]
            if min(trial_errors) < np.inf:
                steps_chosen, error = trials[int(np.argmin(trial_errors))], min(trial_errors)
            else:
                steps_chosen = np.minimum(2 * steps_chosen, max_steps)
                error = self.error(steps_chosen)
        return steps_chosen
