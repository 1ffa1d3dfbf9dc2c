"""Step refinement: halving the integration step of each case until its outcomes converge."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sepmc.campaign.cases import extremes, quantile
from sepmc.campaign.execution.accuracy import decisive, errors, scales, scene_scales
from sepmc.engine.dispatch import status_in
from sepmc.kernel.spec.heights import rows_step
from sepmc.kernel.spec.methods import method
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import Scene
from sepmc.schema import Column, Status

_TRANSIENTS = ("build_up", "tail_off")
# time constants after an ignition or burn-out, where 2 % of the change remain
_TIME_CONSTANTS = 4.0
_RARE_PROBABILITY = 0.001  # fraction of cases with shorter time constants than considered
_MAX_FIRST_STEPS = 2**15  # of a flight, however close the rows
HALVINGS = 9  # at most
# consecutive halvings: errors do not fall evenly across a kink, such as the edge of an atmosphere
# layer, and one small change can be chance
AGREEMENTS = 2
# halvings without a change that falls to half: the rest is round-off or a jump
_MAX_STALE = 3
_MIN_RATIO = 2.0**-6  # of the first step: halvings before this ratio may not help

_COMPLETED = (Status.OK, Status.NEVER_RELEASED)
STEP_TOO_LONG = (Status.NOT_FINITE, Status.UNRESOLVED)  # a shorter step may help

# a step that is far too long can end so too
DOUBTFUL = (
    Status.OUTSIDE_ATMOSPHERE,
    Status.OUTSIDE_TABLE,
    Status.JAMMED,
    Status.UNDEFINED_FORMULA,
    Status.TOO_MANY_EVENTS,
)
_CHECK_RATIO = 64.0  # the step that checks such a status is this much shorter

# (step, case numbers) to outcomes (n, o), SI, and status (n,)
Integrate = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]


def longest_step(scene: Scene, dispersions: Sequence[Dispersion] = (), brief: float = 0.0) -> float:
    """Longest first step, s, that resolves thrust transients (build-up, tail-off) and the rows of
    tables over height at the largest speed to expect.

    For the rows it is not below the end time divided by `_MAX_FIRST_STEPS`, however close they are.
    From a longer first step, halving can leave the outcomes unchanged by chance although their
    error is large.

    Parameters
    ----------
    scene : Scene
    dispersions : sequence of Dispersion
        Dispersions of the campaign: they can make time constants shorter, and change the heights
        that a case passes.
    brief : float
        Time constants up to this, s, are ignored.

    Returns
    -------
    float
        Infinite if there are no transients and no table.
    """
    time_constants = [getattr(motor, key) for motor in scene.motor for key in _TRANSIENTS]
    time_constants += [
        float(quantile(d, np.array([_RARE_PROBABILITY]))[0] * d.parameter.factor)
        for d in dispersions
        if d.parameter.path.endswith(_TRANSIENTS)
    ]
    nodes = method(scene.solver.method).c
    transients = (
        _TIME_CONSTANTS
        * min((x for x in time_constants if x > brief), default=math.inf)
        / float(nodes[nodes > 0.0].min())
    )
    return min(
        transients,
        max(rows_step(scene, extremes(scene, dispersions)), scene.run.end_time / _MAX_FIRST_STEPS),
    )


@dataclass
class Converged:
    """Result of step refinement.

    Attributes
    ----------
    step : ndarray, shape (n,)
        Last step of each case, in the unit of the first step (s, or relative).
    status : ndarray, shape (n,)
        Status of each case at that step.
    change : ndarray, shape (n, o)
        Relative change of each outcome: the largest of the last two halvings, or that of the last
        one if ``agreements`` was 1. Of a decisive outcome it is
        infinite if one of these halvings changed the status.
    converged : ndarray of bool, shape (n,)
        True for cases that converged.
    """

    step: np.ndarray
    status: np.ndarray
    change: np.ndarray
    converged: np.ndarray


def changes(
    result: np.ndarray,
    status: np.ndarray,
    refined: np.ndarray,
    refined_status: np.ndarray,
    scale: np.ndarray,
    is_decisive: np.ndarray,
) -> np.ndarray:
    """Relative changes (n, o) of the outcomes of n cases from one step, ``result`` (n, o), to a
    shorter one, ``refined`` (n, o); ``scale`` (o,) is as in `errors`, ``is_decisive`` (o,) the mask
    of the decisive outcomes.

    The statuses at the two steps, ``status`` and ``refined_status`` (n,), overrule these: decisive
    outcomes change by infinity if the status of the case differs, and by 1 if it says at both steps
    that the step is too long. If it is the same other failure at both steps, all changes are 0.
    """
    table = errors(result, refined, scale)
    table[(status == refined_status) & ~status_in(status, _COMPLETED)] = 0.0
    table[np.ix_((status == refined_status) & status_in(status, STEP_TOO_LONG), is_decisive)] = 1.0
    table[np.ix_(status != refined_status, is_decisive)] = np.inf
    return table


def _is_premature(
    integrate: Integrate, step: float, cases: np.ndarray, status: np.ndarray
) -> np.ndarray:
    """Mask (n,) of the cases with a status in `DOUBTFUL`, such as having left the atmosphere or a
    table, that no longer have such a status at a step 64 times shorter.

    ``status`` (n,) is that of the cases with numbers ``cases`` (n,) at ``step``; ``integrate`` is
    as for `refine_steps`.
    """
    result = status_in(status, DOUBTFUL)
    if result.any():
        result[result] = ~status_in(integrate(step / _CHECK_RATIO, cases[result])[1], DOUBTFUL)
    return result


def refine_steps(
    integrate: Integrate,
    count: int,
    step: float,
    tolerance: float,
    scale: np.ndarray,
    is_decisive: np.ndarray,
    max_rejected: int = HALVINGS,
    agreements: int = AGREEMENTS,
) -> Converged:
    """Halve the step of each case until its outcomes converge.

    A case has converged when ``agreements`` consecutive halvings change its decisive outcomes by at
    most the tolerance. It is given up after nine halvings, after three consecutive ones that do not
    reduce its smallest change to half, or when it still has the status ``unresolved`` (rejected)
    after ``max_rejected`` halvings. A status may be due to the step alone: one in `STEP_TOO_LONG`,
    or one in `DOUBTFUL` at the first step that is gone at a step 64 times shorter. A halving to
    such a status does not agree, and the count of the three begins anew.

    Parameters
    ----------
    integrate : callable
        ``integrate(step, numbers)`` integrates the cases with some numbers (k,) at one step, and
        returns outcomes (k, o) and status (k,); it may store them, as its last call for a case is
        at the step that is returned for it.
    count : int
        Number n of cases, whose numbers are 0 to n - 1.
    step : float
        First step, s or relative.
    tolerance : float
        Largest relative change of a decisive outcome.
    scale : ndarray, shape (o,)
        Scale of each outcome; see `sepmc.campaign.execution.accuracy.errors`.
    is_decisive : ndarray of bool, shape (o,)
        True for the outcomes that must converge.
    max_rejected : int
        Halvings after which a case that is still rejected is given up.
    agreements : int
        Consecutive halvings that must agree.

    Returns
    -------
    Converged
    """
    remaining = np.arange(count)
    outcomes, status = integrate(step, remaining)
    premature = _is_premature(integrate, step, remaining, status)
    steps, change = np.full(count, step), np.full((count, len(scale)), np.inf)
    last, smallest = np.full((count, len(scale)), np.inf), np.full(count, np.inf)
    n_agreed, n_stale = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    for halving in range(1, HALVINGS + 1):
        step *= 0.5
        refined, refined_status = integrate(step, remaining)
        change_now = changes(
            outcomes[remaining], status[remaining], refined, refined_status, scale, is_decisive
        )
        waiting = premature[remaining] & status_in(refined_status, DOUBTFUL)
        change_now[np.ix_(waiting & (status[remaining] == refined_status), is_decisive)] = 1.0
        largest = change_now[:, is_decisive].max(axis=1, initial=0.0)
        n_agreed[remaining] = np.where(largest <= tolerance, n_agreed[remaining] + 1, 0)
        decreased = (
            (largest <= 0.5 * smallest[remaining])
            | status_in(refined_status, STEP_TOO_LONG)
            | waiting
        )
        n_stale[remaining] = np.where(decreased, 0, n_stale[remaining] + 1)
        smallest[remaining] = np.where(
            largest > tolerance, np.minimum(largest, smallest[remaining]), smallest[remaining]
        )
        is_first = np.isinf(last[remaining]) | (agreements == 1)
        change[remaining] = np.where(is_first, change_now, np.maximum(last[remaining], change_now))
        outcomes[remaining], status[remaining], steps[remaining], last[remaining] = (
            refined,
            refined_status,
            step,
            change_now,
        )
        rejected = (refined_status == Status.UNRESOLVED) & (halving >= max_rejected)
        remaining = remaining[
            (n_agreed[remaining] < agreements) & (n_stale[remaining] < _MAX_STALE) & ~rejected
        ]
        if not len(remaining):
            break
    return Converged(steps, status, change, n_agreed >= agreements)


def refine_case_steps(
    integrate: Integrate, step: float, scene: Scene, columns: list[Column]
) -> tuple[float, np.ndarray, list[str]]:
    """Halve the step of one case until its outcomes converge, in several rounds of `refine_steps`.

    Parameters
    ----------
    integrate : callable
        As for `refine_steps`; the case has number 0.
    step : float
        First step, s or relative.
    scene : Scene
        Scene of the case; its ``solver.accuracy`` is the tolerance.
    columns : list of Column
        Columns of the outcomes.

    Returns
    -------
    step : float
        Last step tried, at which the case has converged unless there is a note.
    change : ndarray, shape (o,)
        Relative change of each outcome by the last halvings.
    notes : list of str
        One note for the user if the case has not converged, else empty.
    """
    units, is_decisive = [c.unit for c in columns], decisive(columns)
    case, tolerance = np.zeros(1, dtype=np.int64), scene.solver.accuracy
    smallest = step / 2.0**HALVINGS
    scale = scales(integrate(step, case)[0], units, scene_scales(scene, units))
    previous, is_first = math.inf, step
    while True:
        result = refine_steps(integrate, 1, step, tolerance, scale, is_decisive)
        step = float(result.step[0])
        change = np.where(is_decisive, result.change[0], 0.0)
        if result.converged[0] and change.max() <= tolerance:
            return step, result.change[0], []
        step /= 2.0
        # a round has several halvings: if the change does not fall to half in a round with resolved
        # steps, more do not help
        if step < smallest or (step < _MIN_RATIO * is_first and change.max() > 0.5 * previous):
            break
        previous = float(change.max())
    largest = int(change.argmax())
    return (
        2.0 * step,
        result.change[0],
        [
            f"a shorter step changes {columns[largest].name} by {change[largest]:.1e} of its size, "
            f"more than the requested accuracy {tolerance:g}, however short the step: the error of "
            "this case is about as large, and the results can be used if that is small enough"
        ],
    )
