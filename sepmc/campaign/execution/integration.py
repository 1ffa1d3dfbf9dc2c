"""Integration of the cases of a campaign by a kernel, in steps that are chosen before. Cases with
too large an error are integrated again in smaller steps, rejected ones also by other kernels."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import (
    SAFETY,
    SMALL,
    AchievedAccuracy,
    decisive,
    errors,
    scene_scales,
)
from sepmc.campaign.execution.error_estimate import Estimate
from sepmc.campaign.execution.step_refinement import (
    AGREEMENTS,
    DOUBTFUL,
    HALVINGS,
    STEP_TOO_LONG,
    Converged,
    refine_steps,
)
from sepmc.engine.dispatch import Block, RefinementSummary, integrate_cases, status_in
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.variant import Variant
from sepmc.routines.layout import (
    BODY_OUTCOMES,
    FINER_STEPS,
    FLOW_ANGLES,
)
from sepmc.scene.messages import Log
from sepmc.scene.model import Scene
from sepmc.schema import Status

SAFE = 0.5  # fraction of the accuracy asked that errors of calibration cases may reach
_DURATION_REFINEMENT = 64  # of the steps that measure how long the segments of a case last
_MIN_DURATION = 1e-9  # of the end time; shorter segments have no duration
_MAX_REJECTED = 3  # halvings of the step of a rejected case that a fallback kernel may accept
_NO_CALLS = np.zeros(0, dtype=np.int64)
REPORT_EVERY_S = 10.0  # between two progress messages


@dataclass(frozen=True)
class FallbackKernel:
    """Slower but more general kernel, for cases that the first one rejects by a negative status.

    Attributes
    ----------
    variant : int
        A `Variant` other than the standard one.
    make : callable
        ``make(announce)`` loads and returns the kernel; ``announce`` is a Log, called with a
        message if it is compiled, or None.
    phases : ndarray, shape (segments,)
        For each segment of the first kernel: index of the phase that it belongs to, which is its
        segment in this kernel.
    """

    variant: int
    make: Callable[["Log | None"], Kernel]
    phases: np.ndarray


@dataclass(frozen=True)
class Integration:
    """How the cases of a campaign are integrated: kernel, methods and steps, the error estimate of
    each case, and limits beyond which a case is refined.

    A segment is a phase, or a part of a phase in which delayed releases are pending; o is the
    number of outcomes, g that of error indicators.

    Attributes
    ----------
    kernel : Kernel
    steps : ndarray, shape (segments,)
        Number of steps in each segment; if the file gives a step, number of steps that each given
        step is divided into.
    durations : ndarray, shape (segments,)
        Typical durations of the segments, s.
    stages : list of str
        Names of the segments.
    step : float or None
        Length of the steps, s, if the file gives it, else None; in copies by `refined` it is
        divided.
    scale : ndarray, shape (o,)
        Scale of each outcome, SI, by which errors are divided if the outcome is smaller; see
        `sepmc.campaign.execution.accuracy.scales`. None: `SMALL` times the typical size of such an
        outcome in the scene.
    limits : ndarray, shape (g,)
        Largest value of each error indicator (`Block.indicators`) at which the error estimate still
        applies; None: no limits.
    angles : dict of int to float
        Largest absolute sideslip and yaw, rad, by outcome index, at which the error estimate still
        applies: near a right angle alpha, or pitch and roll, change fast.
    estimate : Estimate or None
        Model of the error of a case within these limits; None: errors are not estimated.
    error_limit : float
        Estimated error above which a case is integrated again with smaller steps; infinite if the
        file gives the step.
    error : float
        Largest relative error of the calibration cases, over the decisive outcomes
        (`sepmc.campaign.execution.accuracy.decisive`); NaN if unknown.
    achieved : AchievedAccuracy or None
        Numerical error of the campaign, from the calibration cases; None if unknown.
    of_medians : ndarray, shape (o,), or None
        Outcomes, SI, of the case with every dispersed input at its median; None unless its status
        is ok.
    notes : list of str
        Notes on the file and on the case of median inputs, for the user.
    fallbacks : tuple of FallbackKernel
        Other kernels, tried in order for cases that the kernel rejects.
    methods : ndarray, shape (segments,)
        Index of the integration method of each segment, in ``kernel.methods``; None: the most
        exact one of each (0).
    variant : int
        `Variant` of the kernel.
    """

    kernel: Kernel
    steps: np.ndarray
    durations: np.ndarray
    stages: list[str] = field(default_factory=list)
    step: float | None = None
    scale: np.ndarray | None = None
    limits: np.ndarray | None = None
    angles: dict[int, float] = field(default_factory=dict)
    estimate: Estimate | None = None
    error_limit: float = np.inf
    error: float = np.nan
    achieved: AchievedAccuracy | None = None
    of_medians: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
    fallbacks: tuple[FallbackKernel, ...] = ()
    methods: np.ndarray | None = None
    variant: int = Variant.STANDARD

    def __repr__(self) -> str:
        names = self.stages or [f"segment {k}" for k in range(len(self.steps))]
        step = f", of steps of {self.step:g} s" if self.step else ""
        segments = ", ".join(
            f"{name}: {steps} x {method}"
            for name, steps, method in zip(names, self.steps, self.method_names, strict=True)
        )
        return f"<Integration: {segments}{step}; error {self.error:.1e}>"

    def __getstate__(self) -> dict[str, Any]:
        """Attributes for copies and pickles, without the fallback kernels, which cannot be pickled;
        see `packed`."""
        return {**vars(self), "fallbacks": ()}

    @property
    def packed(self) -> "Integration":
        """Copy for other processes, without fallback kernels and without addresses of machine code;
        `sepmc.campaign.execution.step_selection.unpacked` adds both again."""
        return replace(self, kernel=replace(self.kernel, address=0, table=_NO_CALLS), fallbacks=())

    @property
    def method_names(self) -> list[str]:
        """Name of the integration method of each segment."""
        numbers = np.zeros(self.kernel.n_segments, int) if self.methods is None else self.methods
        return [names[number] for names, number in zip(self.kernel.methods, numbers, strict=True)]

    @property
    def one_method(self) -> str | None:
        """Name of the integration method if all segments have the same one; else None."""
        names = set(self.method_names)
        return names.pop() if len(names) == 1 else None

    @property
    def evaluations(self) -> int:
        """Number of derivative evaluations of a case, summed over the segments, without those that
        only the continuous extension needs; if the file gives the step, that of one given step in
        each segment."""
        return sum(
            int(steps) * method(name).stages
            for steps, name in zip(self.steps, self.method_names, strict=True)
        )

    @property
    def has_any_order_fallback(self) -> bool:
        """True if there is a fallback kernel of variant `Variant.ANY_ORDER`, which integrates each
        case with steps of its own and so resolves unexpectedly late events."""
        return any(fallback.variant == Variant.ANY_ORDER for fallback in self.fallbacks)

    def with_fallback(self, fallback: FallbackKernel, announce: Log | None) -> "Integration":
        """Copy that uses a fallback kernel in place of its own, and has no fallbacks itself. The
        kernel is compiled if necessary (``announce`` gets a message then). Its segments are the
        phases: each has the sum of the steps, and of the durations, of the segments of that phase.
        All segments use the most exact method."""
        kernel = fallback.make(announce)
        steps = np.bincount(fallback.phases, self.steps, kernel.n_segments).astype(np.int64)
        durations = np.bincount(fallback.phases, self.durations, kernel.n_segments)
        return replace(
            self,
            kernel=kernel,
            steps=np.maximum(steps, 1),
            durations=durations,
            fallbacks=(),
            methods=None,
        )

    def refined(self, factor: int = 2) -> "Integration":
        """Copy with ``factor`` times as many steps, each shorter by that factor."""
        return replace(
            self, steps=factor * self.steps, step=None if self.step is None else self.step / factor
        )


def by_name(kernel: Kernel, names: list[str]) -> np.ndarray:
    """Indices (segments,) in ``kernel.methods[segment]`` of the integration method that ``names``
    gives for each segment; 0, the most exact method, where the segment lacks it."""
    pairs = zip(kernel.methods, names, strict=True)
    return np.array(
        [available.index(name) if name in available else 0 for available, name in pairs],
        dtype=np.int64,
    )


def integrate(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    history_size: int = 0,
    announce: Log | None = None,
) -> Block:
    """Integrate cases to the accuracy of a campaign.

    Cases are integrated again with smaller steps, each by itself, if they lie outside the
    calibration, have too large an estimated error, or end with a status that smaller steps may
    change. If the file gives the step, only cases outside the calibration are: to measure their
    errors, while their results stay those at the given step. Cases that the kernel still rejects
    are tried with the fallback kernels. Cases that all kernels reject get a final status and NaN
    outcomes; their audit columns stay.

    Parameters
    ----------
    campaign : Definition
    flight : Integration
        Kernel and steps.
    draws : ndarray, shape (n, d)
        Inputs of the n cases, SI.
    history_size : int
        Number of rows of a stored history; 0 for no history.
    announce : Log, optional
        Called with a message if a fallback kernel is compiled.

    Returns
    -------
    Block
        Results of the n cases, SI, with the summary of their refinement.
    """
    block = integrate_once(campaign, flight, draws, history_size)
    is_calibrated = _is_calibrated(flight, block)
    of_calibrated = _apply_estimate(campaign, flight, block, is_calibrated)
    too_inaccurate = is_calibrated & (block.error > flight.error_limit)
    hard = _is_doubtful(campaign, block) | (block.has_outcomes & ~is_calibrated)
    refinement = of_calibrated.merged(
        _refine_cases(
            campaign, flight, draws, history_size, block, np.flatnonzero(too_inaccurate & ~hard), 1
        )
    ).merged(_refine_cases(campaign, flight, draws, history_size, block, np.flatnonzero(hard)))
    bodies = len(campaign.layout.bodies)
    for fallback in flight.fallbacks:
        finite = motion_is_finite(block.outcomes, bodies)
        rejected = np.flatnonzero(is_accepted_by(block.status, fallback.variant, finite))
        if len(rejected):
            with_fallback = flight.with_fallback(fallback, announce)
            _put_rows(
                block,
                rejected,
                integrate_once(campaign, with_fallback, draws[rejected], history_size),
            )
            hard = (_is_doubtful(campaign, block) | block.has_outcomes)[rejected]
            refinement = refinement.merged(
                _refine_cases(campaign, with_fallback, draws, history_size, block, rejected[hard])
            )
            refinement.n_fallback += len(rejected)
    rejected = np.flatnonzero(block.status < 0)
    finite = motion_is_finite(block.outcomes[rejected], bodies)
    block.status[rejected] = final_status(block.status[rejected], finite)
    # audit columns are kept
    block.outcomes[rejected, : len(campaign.outcome_columns)], block.rows[rejected] = np.nan, 0
    block.refinement = refinement
    return block


def is_accepted_by(status: np.ndarray, variant: int, finite: np.ndarray) -> np.ndarray:
    """Mask (n,) of the rejected cases (negative ``status``) that a fallback kernel may accept, of
    the ``variant`` ANY_ORDER or LEAST_SQUARES.

    ``status`` (n,) is FINER_STEPS or the first variant that may accept the case: then more general
    ones may too, and after FINER_STEPS both may. The mask is False where the status is not
    negative, and for the variant STANDARD. ``finite`` (n,) is True for cases with finite outcomes:
    if such a case needs smaller steps only, the variant LEAST_SQUARES does not help.
    """
    finer = (status == FINER_STEPS) & finite
    return (status < 0) & (status >= variant) & ~(finer & (variant == Variant.LEAST_SQUARES))


def final_status(rejected: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Final status (n,) of cases that every kernel rejects, from ``rejected`` (n,), their negative
    status at the last rejection, and ``finite`` (n,), True for cases with finite outcomes.

    It is SINGULAR_JOINT if the constraint equations failed, NOT_FINITE if smaller steps were needed
    and outcomes are not finite, else UNRESOLVED.
    """
    ended = np.where(
        rejected == Variant.LEAST_SQUARES, int(Status.SINGULAR_JOINT), int(Status.UNRESOLVED)
    )
    return np.where((rejected == FINER_STEPS) & ~finite, int(Status.NOT_FINITE), ended)


def typical_durations(ends: np.ndarray, is_ok: np.ndarray) -> np.ndarray:
    """Typical durations (segments,) of the segments, s: differences of their median end times.

    Parameters
    ----------
    ends : ndarray, shape (segments, n)
        End times of segments in n cases, s.
    is_ok : ndarray of bool, shape (n,)
        True for the cases of which the medians are taken. A segment whose duration is 0 there
        (below 1e-9 of the last end time) gets the median duration over those of all n cases, also
        the ones that are not ok, in which it is longer; 0 if there are none.
    """
    durations, lengths = (
        np.diff(np.median(ends[:, is_ok], axis=1), prepend=0.0),
        np.diff(ends, axis=0, prepend=0.0),
    )
    for k in np.flatnonzero(durations <= _MIN_DURATION * ends[-1].max()):
        lasting = lengths[k][lengths[k] > _MIN_DURATION * ends[-1].max()]
        durations[k] = np.median(lasting) if len(lasting) else 0.0
    return durations


def history_rows(scene: Scene) -> int:
    """Number of rows of the stored history of a case, from ``run.history_step_s``, which must be
    above 0, and the end time."""
    return int(scene.run.end_time / scene.run.history_step + 1e-9) + 1


def integrate_once(
    campaign: Definition, flight: Integration, draws: np.ndarray, history_size: int = 0
) -> Block:
    """Integrate n cases with inputs ``draws`` (n, d), SI, once with the kernel and steps of
    ``flight``, without refinement; ``history_size`` is the number of rows of a stored history."""
    return integrate_cases(
        flight.kernel,
        campaign.layout,
        flight.steps,
        flight.durations,
        campaign.slots,
        draws,
        history_size,
        flight.methods,
    )[0]


def motion_is_finite(outcomes: np.ndarray, bodies: int) -> np.ndarray:
    """Mask (n,) of the cases whose rates and attitudes at the end are finite for all ``bodies`` (a
    number), from ``outcomes`` (n, o).

    Flow angles are NaN in still air, so they do not count.
    """
    of_bodies = outcomes[:, : BODY_OUTCOMES * bodies].reshape(-1, bodies, BODY_OUTCOMES)
    return np.asarray(np.isfinite(of_bodies[:, :, FLOW_ANGLES:]).all(axis=(1, 2)))


def _is_calibrated(flight: Integration, block: Block) -> np.ndarray:
    """Mask (n,) of the cases within the limits of the calibration (error indicators and angles), to
    which the error estimate applies.

    ``block`` must have error indicators. All are True if ``flight`` has no limits, else a case
    without indicators is False; an angle that is NaN, not defined, is within its limit.
    """
    assert block.indicators is not None
    if flight.limits is None:
        return np.ones(len(block.status), dtype=bool)
    is_calibrated = block.has_indicators & (block.indicators <= flight.limits).all(axis=1)
    for column, limit in flight.angles.items():
        is_calibrated &= ~(
            np.abs(block.outcomes[:, column]) > limit
        )  # NaN: the angle is not defined
    return np.asarray(is_calibrated)


def _apply_estimate(
    campaign: Definition, flight: Integration, block: Block, is_calibrated: np.ndarray
) -> RefinementSummary:
    """Write the estimated error of the cases in ``is_calibrated`` (n,) that have outcomes into the
    column ``error`` of ``block``; return the summary of those whose error is within the limit of
    ``flight``. Without an error estimate nothing is written, and the summary is empty."""
    empty = RefinementSummary(np.zeros(len(campaign.outcome_columns)))
    if flight.estimate is None:
        return empty
    assert block.indicators is not None
    is_known = is_calibrated & block.has_outcomes
    indicators = _select(block.indicators, is_known)
    error = flight.estimate.of_cases(indicators)
    block.error[is_known] = error
    accepted = _select(indicators, ~(error > flight.error_limit))
    leading = flight.estimate.of_leading(accepted)
    return RefinementSummary(
        leading, indicators=accepted.max(axis=0, initial=0.0) if len(accepted) else empty.indicators
    )


def _select(indicators: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Rows (m, g) of error indicators (n, g) where the ``mask`` (n,) is True; stored by column, as
    the indicators are. It is a copy, or ``indicators`` itself if the mask is True everywhere."""
    return indicators if mask.all() else indicators.T[:, mask].T


def _is_doubtful(campaign: Definition, block: Block) -> np.ndarray:
    """Mask (n,) of the cases of a block whose status smaller steps may change; all False if the
    file gives the step."""
    return status_in(block.status, (FINER_STEPS, *STEP_TOO_LONG, *DOUBTFUL)) & (
        campaign.scene.solver.step is None
    )


def _refine_cases(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    history_size: int,
    block: Block,
    refined_cases: np.ndarray,
    agreements: int = AGREEMENTS,
) -> RefinementSummary:
    """Integrate k cases again with ever smaller steps until they converge; write their results and
    errors into ``block`` (only the errors if the file gives the step), and return their summary.

    ``refined_cases`` (k,) are the indices of these cases in ``block`` and in ``draws`` (n, d), the
    inputs, SI. ``flight`` has the kernel and the first steps; ``history_size`` is the number of
    rows of a stored history. A case has converged after ``agreements`` consecutive halvings with
    small changes.
    """
    has_given_step = campaign.scene.solver.step is not None
    columns = campaign.outcome_columns
    if not len(refined_cases):
        return RefinementSummary(np.zeros(len(columns)))
    initial = _rows_of(block, refined_cases)
    result = _refine(
        campaign,
        flight,
        block,
        refined_cases,
        lambda finer, subset: integrate_once(campaign, finer, draws[subset], history_size),
        agreements,
        initial,
    )
    is_decisive = decisive(columns)
    if has_given_step:
        assert flight.scale is not None
        n = len(flight.scale)
        change = np.maximum(
            result.change,
            errors(initial.outcomes[:, :n], block.outcomes[refined_cases, :n], flight.scale),
        )
        _put_rows(block, refined_cases, initial)
        has_outcomes = block.has_outcomes[refined_cases]
        block.error[refined_cases[has_outcomes]] = _reported_errors(
            flight, change[has_outcomes], is_decisive
        )
        return RefinementSummary(SAFETY * _largest_changes(change), n_refined=len(refined_cases))
    finite = motion_is_finite(block.outcomes[refined_cases], len(campaign.layout.bodies))
    late = np.flatnonzero((block.status[refined_cases] == FINER_STEPS) & finite)
    for number in late:
        alone = _refine_with_own_durations(
            campaign, flight, draws, history_size, block, refined_cases[number]
        )
        result.change[number], result.converged[number] = alone.change[0], alone.converged[0]
    has_outcomes = block.has_outcomes[refined_cases]
    block.error[refined_cases[has_outcomes]] = _reported_errors(
        flight, result.change[has_outcomes], is_decisive
    )
    return RefinementSummary(
        SAFETY * _largest_changes(result.change[has_outcomes]),
        n_refined=len(refined_cases),
        n_unconverged=int(np.count_nonzero(has_outcomes & ~result.converged)),
    )


def _reported_errors(
    flight: Integration, change: np.ndarray, is_decisive: np.ndarray
) -> np.ndarray:
    """Relative error (n,) to report for n cases: the largest over the decisive outcomes (mask
    ``is_decisive``, (o,)) of max(`SAFETY` times ``change``, floor of the error estimate);
    ``change`` (n, o) is the relative change by the last halvings."""
    floor = flight.estimate.floor if flight.estimate else np.zeros(change.shape[1])
    return np.asarray(np.maximum(SAFETY * change, floor)[:, is_decisive].max(axis=1, initial=0.0))


def _refine_with_own_durations(
    campaign: Definition,
    flight: Integration,
    draws: np.ndarray,
    history_size: int,
    block: Block,
    number: int,
) -> Converged:
    """Refine the case with index ``number`` in ``block`` and in the inputs ``draws`` (n, d), SI,
    whose phases last much longer than typical: measure its own durations, then halve its steps
    until it converges. Writes its results, with a history of ``history_size`` rows, into ``block``;
    returns steps and changes of this one case. ``flight`` has the kernel and the typical
    durations."""
    inputs, fine = draws[number : number + 1], flight.refined(_DURATION_REFINEMENT)
    _, ends = integrate_cases(
        flight.kernel,
        campaign.layout,
        fine.steps,
        flight.durations,
        campaign.slots,
        inputs,
        methods=flight.methods,
    )
    own_flight = replace(flight, durations=typical_durations(ends, np.ones(1, dtype=bool)))
    return _refine(
        campaign,
        own_flight,
        block,
        np.array([number]),
        lambda finer, _: integrate_once(campaign, finer, inputs, history_size),
    )


def _refine(
    campaign: Definition,
    flight: Integration,
    block: Block,
    numbers: np.ndarray,
    integrate_rows: Callable[[Integration, np.ndarray], Block],
    agreements: int = AGREEMENTS,
    initial: Block | None = None,
) -> Converged:
    """Halve the steps of some cases of a block until they converge; write their results into it.

    Parameters
    ----------
    campaign : Definition
    flight : Integration
        Kernel and first steps.
    block : Block
        Changed in place: receives the results of the k cases.
    numbers : ndarray, shape (k,)
        Indices of the cases in the block.
    integrate_rows : callable
        ``integrate_rows(integration, indices)`` integrates the cases with some of these indices at
        the steps of the integration; returns a Block.
    agreements : int
        See `sepmc.campaign.execution.step_refinement.refine_steps`.
    initial : Block, optional
        Results of the k cases at the steps of ``flight``, if known.

    Returns
    -------
    Converged
    """
    columns = campaign.outcome_columns

    def integrate_subset(step_ratio: float, subset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if step_ratio == 1.0 and initial is not None:
            rows = _rows_of(initial, subset)
        else:
            rows = integrate_rows(flight.refined(round(1.0 / step_ratio)), numbers[subset])
        _put_rows(block, numbers[subset], rows)
        return rows.outcomes[:, : len(columns)].copy(), np.where(
            (rows.status < 0) | rows.turns_unclear, Status.UNRESOLVED, rows.status
        )

    scale = (
        SMALL * scene_scales(campaign.scene, [c.unit for c in columns])
        if flight.scale is None
        else flight.scale
    )
    return refine_steps(
        integrate_subset,
        len(numbers),
        1.0,
        SAFE * campaign.scene.solver.accuracy,
        scale,
        decisive(columns),
        _MAX_REJECTED if flight.has_any_order_fallback else HALVINGS,
        agreements,
    )


def _rows_of(block: Block, numbers: np.ndarray) -> Block:
    """Block with copies of the results of the cases with indices ``numbers`` (k,) in ``block``,
    errors and indicators included; it has no ``refinement``."""
    indicators = None if block.indicators is None else block.indicators[numbers]
    return Block(
        block.outcomes[numbers],
        block.status[numbers],
        block.times[numbers],
        block.history[numbers],
        block.rows[numbers],
        indicators,
    )


def _put_rows(block: Block, numbers: np.ndarray, rows: Block) -> None:
    """Write outcomes, status, history and error indicators of k cases, ``rows``, into ``block`` in
    place, at the indices ``numbers`` (k,); indicators only if both have equally many."""
    block.outcomes[numbers], block.status[numbers] = rows.outcomes, rows.status
    block.history[numbers], block.rows[numbers] = rows.history, rows.rows
    if (
        block.indicators is not None
        and rows.indicators is not None
        and block.indicators.shape[1] == rows.indicators.shape[1]
    ):
        block.indicators[numbers] = rows.indicators


def _largest_changes(change: np.ndarray) -> np.ndarray:
    """Largest change (o,) of each outcome over n cases, from ``change`` (n, o), none below 0; 0
    without cases, NaN if one of the changes is NaN."""
    return np.asarray(change.max(axis=0, initial=0.0))
