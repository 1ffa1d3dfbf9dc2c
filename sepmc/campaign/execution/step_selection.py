"""Selection of the integration steps of a campaign, by calibration cases.

Calibration cases are corners of the dispersions and a sample. They depend on the scene and its
distributions, not on the seed or the number of cases; so do the steps.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution import step_store
from sepmc.campaign.execution.accuracy import (
    SAFETY,
    SMALL,
    achieved,
    decisive,
    errors,
    relative_error,
    scales,
    scene_scales,
)
from sepmc.campaign.execution.calibration_cases import (
    CORNERS,
    SAMPLE,
    CalibrationSize,
    calibration_sample,
    corner_cases,
)
from sepmc.campaign.execution.calibration_limits import (
    angle_limits,
    direct_errors,
    indicator_limits,
    unseen_errors,
)
from sepmc.campaign.execution.diagnostics import scene_notes
from sepmc.campaign.execution.error_estimate import estimate
from sepmc.campaign.execution.integration import (
    REPORT_EVERY_S,
    SAFE,
    FallbackKernel,
    Integration,
    history_rows,
    integrate,
    integrate_once,
    is_accepted_by,
)
from sepmc.campaign.execution.step_refinement import Integrate, longest_step, refine_steps
from sepmc.campaign.execution.step_search import (
    IN_DOUBT,
    NO_OUTCOMES,
    VALID,
    Search,
    find_durations,
    most_are_valid,
)
from sepmc.engine.dispatch import (
    Block,
    compile_wait_s,
    integrate_cases,
    is_interpreting,
    load_kernel,
    progress_reporter,
)
from sepmc.engine.kernel_texts import written
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec import structure
from sepmc.kernel.spec.kernel_spec import KernelSpec
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.variant import Variant
from sepmc.scene.messages import Log
from sepmc.schema import Status, separation_columns

_SAMPLE_DIVISOR = 8  # the sample is this much smaller where each case is refined by itself
# steps of every phase in which a quarter of the sample gives the spread of outcomes
_SPREAD_STEPS, _MAX_SPREAD_STEPS = 8, 512
_LONG_S = 60.0  # after this time the way to skip calibration is announced
_MAX_ROUNDS = 4  # step searches, each with the worst cases of the sample added
_N_WORST = 24
_MAX_ESTIMATE = 0.6  # of the accuracy: larger estimates were up to 1.6 times too small


def kernel_spec(campaign: Definition, variant: int = Variant.STANDARD) -> KernelSpec:
    """Specification of the kernel of a campaign."""
    return structure.make_kernel_spec(campaign.layout, campaign.dispersed, variant)


def kernel_text(
    campaign: Definition,
    solver: str | None = None,
    history: bool = False,
    variant: int = Variant.STANDARD,
) -> str:
    """Text of the kernel of a campaign, a Python module.

    Parameters
    ----------
    campaign : Definition
    solver : str, optional
        Name of other integration methods.
    history : bool
        Write stored histories.
    variant : int
        A `Variant` of the kernel.

    Returns
    -------
    str
    """
    return written(kernel_spec(campaign, variant), solver or campaign.scene.solver.method, history)


def stage_names(spec: KernelSpec) -> list[str]:
    """Names of the kernel segments, in the words of the campaign file."""
    return [
        spec.names.back[segment.phase] + (" (late joints)" if segment.late else "")
        for segment in spec.segments
    ]


def fallbacks(campaign: Definition, spec: KernelSpec, history: bool) -> tuple[FallbackKernel, ...]:
    """Fallback kernels for cases that the kernel of a specification rejects."""
    phases = [phase.name for phase in spec.scene.phase]
    numbers = np.array([phases.index(segment.phase) for segment in spec.segments])

    @cache
    def make(variant: int, announce: Log | None = None) -> Kernel:
        return load_kernel(kernel_text(campaign, history=history, variant=variant), announce)

    return tuple(FallbackKernel(v, partial(make, v), numbers) for v in spec.fallbacks)


def select_steps(
    campaign: Definition,
    history: bool = False,
    announce: Log | None = None,
    size: CalibrationSize | None = None,
    timing: dict[str, float] | None = None,
    again: bool = False,
) -> Integration:
    """Select kernel and steps for the accuracy that a campaign asks for.

    Compiled campaigns keep their steps, in memory and in the cache folder
    (`sepmc.campaign.execution.step_store`).

    Parameters
    ----------
    campaign : Definition
    history : bool
        Store histories.
    announce : Log, optional
    size : CalibrationSize, optional
        Number of calibration cases; (`CORNERS`, `SAMPLE`) if None.
    timing : dict of str to float, optional
        Seconds are added to the keys text, compile and steps.
    again : bool
        Select them although they are kept, and keep none.

    Returns
    -------
    Integration
    """
    timing = {"text": 0.0, "compile": 0.0, "steps": 0.0} if timing is None else timing
    size = size or CalibrationSize(CORNERS, SAMPLE)
    if again or is_interpreting():
        return _select(campaign, history, announce, size, timing)
    key = step_store.key_of(campaign, history, size)
    integration = step_store.in_memory(key)
    if integration is None:
        packed = step_store.stored(key)
        if packed is None:
            integration = _select(campaign, history, announce, size, timing)
            step_store.store(key, integration)
        else:
            integration = unpacked(campaign, packed, history, announce, timing)
            step_store.remember(key, integration)
    # notes are of the file, whose titles and names do not matter to steps
    return replace(integration, notes=scene_notes(campaign, integration))


def unpacked(
    campaign: Definition,
    integration: Integration,
    history: bool,
    announce: Log | None = None,
    timing: dict[str, float] | None = None,
) -> Integration:
    """Integration from another process (`Integration.packed`), with kernels of this one."""
    spec = kernel_spec(campaign, integration.variant)
    kernel = _load(campaign, spec, history, announce, timing)
    return replace(integration, kernel=kernel, fallbacks=fallbacks(campaign, spec, history))


def _load(
    campaign: Definition,
    spec: KernelSpec,
    history: bool,
    announce: Log | None,
    timing: dict[str, float] | None,
) -> Kernel:
    """Write and load the kernel of a specification."""
    start, waited = time.perf_counter(), compile_wait_s()
    kernel = load_kernel(written(spec, campaign.scene.solver.method, history), announce)
    waited = compile_wait_s() - waited
    if timing is not None:
        timing["compile"] += waited
        timing["text"] += time.perf_counter() - start - waited
    return kernel


def _select(
    campaign: Definition,
    history: bool,
    announce: Log | None,
    size: CalibrationSize,
    timing: dict[str, float],
) -> Integration:
    """Select steps by calibration cases."""
    variant: int = Variant.STANDARD
    history_size = history_rows(campaign.scene) if history and campaign.scene.joint else 0
    while True:
        spec = kernel_spec(campaign, variant)
        kernel = _load(campaign, spec, history, announce, timing)
        _announce_calibration(announce)
        start = time.perf_counter()
        remaining_kernels, stages = fallbacks(campaign, spec, history), stage_names(spec)
        selected = _common_steps(
            campaign, kernel, stages, _progress_counter(announce), size, history_size
        )
        next_variant = None
        if selected is not None:
            selected = replace(selected, fallbacks=remaining_kernels)
        else:
            next_variant = _capable_variant(campaign, kernel, remaining_kernels, size)
            if next_variant is None:
                selected = _with_history_error(
                    campaign,
                    _refined_case_by_case(campaign, kernel, stages, remaining_kernels, size),
                    history_size,
                    size,
                )
        timing["steps"] += time.perf_counter() - start
        if selected is not None:
            selected = replace(selected, variant=variant)
            return replace(selected, notes=scene_notes(campaign, selected))
        assert next_variant is not None
        variant = next_variant


def _capable_variant(
    campaign: Definition,
    kernel: Kernel,
    remaining_kernels: tuple[FallbackKernel, ...],
    size: CalibrationSize,
) -> int | None:
    """Variant of a fallback kernel that accepts most of the corners that ``kernel`` rejects; None
    if there is none."""
    steps, durations = _initial_steps(kernel)
    block, _ = integrate_cases(
        kernel,
        campaign.layout,
        _SPREAD_STEPS * steps,
        durations,
        campaign.slots,
        corner_cases(campaign, size.corners),
    )
    for fallback in remaining_kernels:
        flown = np.count_nonzero(is_accepted_by(block.status, fallback.variant, np.array(True)))
        if 2 * flown >= np.count_nonzero(block.status < 0) > 0:
            return fallback.variant
    return None


def _initial_steps(kernel: Kernel) -> tuple[np.ndarray, np.ndarray]:
    """Steps and durations (segments,) before any case was integrated."""
    return np.full(kernel.n_segments, _SPREAD_STEPS), np.full(kernel.n_segments, np.inf)


def _refined_case_by_case(
    campaign: Definition,
    kernel: Kernel,
    stages: list[str],
    remaining_kernels: tuple[FallbackKernel, ...],
    size: CalibrationSize,
) -> Integration:
    """Integration with cases refined one by one, where no common steps suit most cases."""
    draws, given_step = (
        np.vstack(
            [
                corner_cases(campaign, size.corners),
                calibration_sample(campaign, size.sample // _SAMPLE_DIVISOR),
            ]
        ),
        campaign.scene.solver.step,
    )
    steps, durations = _initial_steps(kernel)
    steps = steps if given_step is None else np.ones_like(steps)
    units = [c.unit for c in campaign.outcome_columns]
    scene_scale, nothing = (
        scene_scales(campaign.scene, units),
        np.full(kernel.n_indicators, -np.inf),
    )
    flight = Integration(
        kernel,
        steps,
        durations,
        stages,
        given_step,
        SMALL * scene_scale,
        nothing,
        fallbacks=remaining_kernels,
    )
    block = integrate(campaign, flight, draws)
    assert block.refinement is not None
    ok, is_decisive = block.status == Status.OK, decisive(campaign.outcome_columns)
    accuracy_achieved = achieved(
        campaign, block.refinement.error / SAFETY, int(np.count_nonzero(ok))
    )
    nominal = block.outcomes[0, : len(units)] if ok[0] else None
    scale = scales(block.outcomes[ok][:, : len(units)], units, scene_scale)
    return replace(
        flight,
        scale=scale,
        error=float(block.refinement.error[is_decisive].max(initial=0.0)) / SAFETY,
        achieved=accuracy_achieved,
        nominal=nominal,
    )


def _with_history_error(
    campaign: Definition, selected: Integration, history_size: int, size: CalibrationSize
) -> Integration:
    """Integration with the error of stored histories of ``history_size`` rows."""
    if not history_size or selected.achieved is None:
        return selected
    draws = np.empty((1, 0))
    if campaign.file.dispersions:
        draws = np.vstack(
            [corner_cases(campaign, size.corners), calibration_sample(campaign, size.sample)]
        )
    assert selected.scale is not None
    at_steps, at_half = (
        integrate_once(campaign, way, draws, history_size) for way in (selected, selected.refined())
    )
    error = _history_error(campaign, at_steps, at_half, selected.scale)
    return replace(selected, achieved=replace(selected.achieved, history=SAFETY * error))


def _history_error(
    campaign: Definition, at_steps: Block, at_half: Block, scale: np.ndarray
) -> float:
    """Largest error of histories between the ends of steps, from cases at some steps and at half of
    them.

    The interpolation of a step is of lower order than the step. Relative to size or ``scale`` (o,),
    as outcomes.
    """
    names = [column.name for column in campaign.outcome_columns]
    width = at_half.history.shape[2]
    scene_scale = np.array(
        [scale[names.index(c.name)] for c in separation_columns(list(campaign.layout.joints))]
    )
    both_ok = (at_steps.status == Status.OK) & (at_half.status == Status.OK)
    histories = (
        at_steps.history[both_ok].reshape(-1, width),
        at_half.history[both_ok].reshape(-1, width),
    )
    return float(errors(*histories, scene_scale).max(initial=0.0))


def _announce_calibration(announce: Log | None) -> None:
    if announce:
        announce("running calibration cases to select the steps for the requested accuracy ...")


def _progress_counter(announce: Log | None) -> Callable[[int], None]:
    """Function that adds to a count of cases and announces it from time to time."""
    report, total = progress_reporter(announce, REPORT_EVERY_S), 0

    def count(n_cases: int) -> None:
        nonlocal total
        total += n_cases
        report(
            lambda seconds: (
                f"{total} calibration cases in {seconds:.0f} s"
                + ("; solver.step_s, a step of your own, needs none" if seconds > _LONG_S else "")
                + " ..."
            )
        )

    return count


def _common_steps(
    campaign: Definition,
    kernel: Kernel,
    stages: list[str],
    report: Callable[[int], None],
    size: CalibrationSize,
    history_size: int = 0,
) -> Integration | None:
    """Fewest steps of every segment at which calibration cases meet the accuracy, or the given
    step.

    Parameters
    ----------
    campaign : Definition
    kernel : Kernel
    stages : list of str
        Names of the segments.
    report : callable
        Called with the number of cases of each batch.
    size : CalibrationSize
    history_size : int
        Rows of a stored history; 0: none.

    Returns
    -------
    Integration or None
        None if no steps suit most cases.
    """
    tried, sampled = (
        corner_cases(campaign, size.corners),
        calibration_sample(campaign, size.sample if campaign.file.dispersions else 0),
    )
    n_corners, durations, step = (
        len(tried),
        find_durations(campaign, kernel, tried),
        campaign.scene.solver.step,
    )
    if durations is None:
        return None
    longest = longest_step(
        campaign.scene, campaign.file.dispersions, structure.brief_transient(campaign.scene)
    )
    min_steps = np.maximum(2, np.ceil(durations / longest)).astype(np.int64)
    columns = campaign.outcome_columns
    units, is_decisive = [c.unit for c in columns], decisive(columns)
    goal = SAFE * campaign.scene.solver.accuracy
    evaluations = [[method(name).stages for name in names] for names in kernel.methods]
    beyond_goal = np.zeros(0, dtype=np.int64)  # sampled cases with errors above the goal

    def integrate_block(
        steps: np.ndarray,
        draws: np.ndarray,
        methods: np.ndarray | None = None,
        history_size: int = 0,
    ) -> Block:
        block, _ = integrate_cases(
            kernel, campaign.layout, steps, durations, campaign.slots, draws, history_size, methods
        )
        report(len(draws))
        return block

    def evaluate(
        steps: np.ndarray, methods: np.ndarray, draws: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        block = integrate_block(steps, draws, methods)
        return block.outcomes[:, : len(units)], _verdict(block, step)

    spread_steps, spread_cases = (
        _SPREAD_STEPS if step is None else 1,
        np.vstack([tried[:1], sampled[: (len(sampled) + 3) // 4]]),
    )
    spread_block = integrate_block(np.full(kernel.n_segments, spread_steps), spread_cases)
    # a body can rotate too far in a step in every case
    while not most_are_valid(_verdict(spread_block, step)) and spread_steps < _MAX_SPREAD_STEPS:
        spread_steps *= 2
        spread_block = integrate_block(np.full(kernel.n_segments, spread_steps), spread_cases)
    scale = scales(
        _completed(spread_block, step)[:, : len(units)], units, scene_scales(campaign.scene, units)
    )
    for _ in range(_MAX_ROUNDS):
        tried = np.vstack([tried, sampled[beyond_goal]])
        search = Search(evaluate, tried, scale, goal, is_decisive, evaluations)
        fewest = (
            search.fewest_steps(min_steps) if step is None else search.given_step(kernel.n_segments)
        )
        if fewest is None:
            return None
        steps = fewest
        # corners and sample at these steps and at half of them, for all reported errors
        all_cases = np.vstack([tried[:n_corners], sampled])
        trials, halved = (
            integrate_block(times * steps, all_cases, search.methods, history_size)
            for times in (1, 2)
        )
        (at_steps, verdict), (at_half, verdict_at_half) = (
            (block.outcomes[n_corners:, : len(units)], _verdict(block, step)[n_corners:])
            for block in (trials, halved)
        )
        is_valid, is_valid_at_half = verdict == VALID, verdict_at_half == VALID
        sample_errors = np.where(
            (is_valid & is_valid_at_half)[:, None], errors(at_steps, at_half, scale), 0.0
        )
        beyond_goal = _worst_cases(
            sample_errors[:, is_decisive].max(axis=1, initial=0.0), search.tolerance
        )
        if step is not None or not len(beyond_goal):
            break
    largest = np.maximum(search.largest_errors(steps), sample_errors.max(axis=0, initial=0.0))
    at_steps_corners, corner_is_valid = (
        trials.outcomes[:n_corners, : len(units)],
        _verdict(trials, step)[:n_corners] == VALID,
    )
    is_known = corner_is_valid & search.is_valid[:n_corners]
    known = np.vstack(
        [
            errors(at_steps_corners[is_known], search.reference[:n_corners][is_known], scale),
            sample_errors[is_valid & is_valid_at_half],
        ]
    )
    is_known_case = np.concatenate([is_known, is_valid & is_valid_at_half])
    doubtful_cases = np.vstack(
        [
            tried[:n_corners][corner_is_valid & ~search.is_valid[:n_corners]],
            sampled[is_valid & ~is_valid_at_half],
        ]
    )
    if len(doubtful_cases):
        doubtful_outcomes = np.vstack(
            [
                at_steps_corners[corner_is_valid & ~search.is_valid[:n_corners]],
                at_steps[is_valid & ~is_valid_at_half],
            ]
        )

        def integrate_doubtful(share: float, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            block = integrate_block(
                round(1.0 / share) * steps, doubtful_cases[which], search.methods
            )
            return block.outcomes[:, : len(units)], np.where(
                _verdict(block, step) == IN_DOUBT, Status.UNRESOLVED, block.status
            )

        largest = np.maximum(
            largest,
            _doubtful_errors(integrate_doubtful, doubtful_outcomes, goal, scale, is_decisive),
        )
    limits, angles = indicator_limits(campaign, trials), angle_limits(campaign, trials)
    largest = np.maximum(largest, unseen_errors(campaign, trials, scale))
    assert trials.indicators is not None
    has_indicators = trials.has_indicators[is_known_case]  # at a given step perhaps not all
    error_estimate = estimate(
        trials.indicators[is_known_case][has_indicators],
        known[has_indicators],
        SAFETY * search.reference_errors,
        direct_errors(campaign, trials, scale),
        is_decisive,
    )
    count = int(np.count_nonzero(is_valid) + np.count_nonzero(corner_is_valid))
    accuracy_achieved = achieved(campaign, largest, count)
    if history_size:
        accuracy_achieved = replace(
            accuracy_achieved, history=SAFETY * _history_error(campaign, trials, halved, scale)
        )
    nominal = search.reference[0] if trials.status[0] == Status.OK and search.is_valid[0] else None
    error = float(largest[is_decisive].max(initial=0.0))
    error_limit = np.inf if step is not None else _MAX_ESTIMATE * campaign.scene.solver.accuracy
    if search.tolerance > goal:  # not asked of other cases, as calibration cases do not reach it
        error_limit = 2.0 * SAFETY * error
    return Integration(
        kernel,
        steps,
        durations,
        stages,
        step,
        scale,
        limits,
        angles,
        error_estimate,
        error_limit,
        error,
        accuracy_achieved,
        nominal,
        methods=search.methods,
    )


def _verdict(block: Block, step: float | None) -> np.ndarray:
    """Verdict (n,) on cases: valid, in doubt or without outcomes.

    Cases with an unknown error indicator are in doubt, unless the step is given.
    """
    is_valid = block.has_outcomes & (step is not None or block.has_indicators)
    return np.where(
        block.status > Status.NEVER_RELEASED,
        NO_OUTCOMES,
        np.where(is_valid, VALID, IN_DOUBT),
    )


def _completed(block: Block, step: float | None) -> np.ndarray:
    """Outcomes (n, o) of valid ok cases; of all valid cases if none is ok."""
    is_valid = _verdict(block, step) == VALID
    ended = is_valid & (block.status == Status.OK)
    return np.asarray(block.outcomes[ended if ended.any() else is_valid])


def _doubtful_errors(
    integrate: Integrate,
    outcomes: np.ndarray,
    goal: float,
    scale: np.ndarray,
    is_decisive: np.ndarray,
) -> np.ndarray:
    """Largest error (o,) of cases valid at the chosen steps but not at smaller ones, relative to
    their converged values."""
    converged = np.empty_like(outcomes)

    def integrate_and_store(share: float, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        finer, status = integrate(share, which)
        converged[which] = finer
        return finer, status

    result = refine_steps(integrate_and_store, len(outcomes), 1.0, goal, scale, is_decisive)
    errors_of_cases = errors(outcomes, converged, scale)
    errors_of_cases[~result.converged | (result.status > Status.NEVER_RELEASED)] = np.inf
    return errors_of_cases.max(axis=0)


def _worst_cases(errors_of_cases: np.ndarray, goal: float) -> np.ndarray:
    """Indices of the cases with the largest errors (n,) above the goal."""
    return np.argsort(-errors_of_cases)[: min(_N_WORST, np.count_nonzero(errors_of_cases > goal))]


def units_to_compile(text: str) -> tuple[int, int]:
    """Number of compile units of a kernel that are not in the cache, and number of units."""
    from sepmc.engine import kernel_cache as compiled  # noqa: PLC0415  (numba)

    units = compiled.compile_units_of(text)
    return len(compiled.missing_units(units)), len(units.names)


__all__ = [
    "CORNERS",
    "SAFE",
    "SAMPLE",
    "SMALL",
    "Integration",
    "calibration_sample",
    "corner_cases",
    "integrate",
    "kernel_text",
    "relative_error",
    "select_steps",
]
