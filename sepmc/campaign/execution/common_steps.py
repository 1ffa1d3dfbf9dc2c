"""Selection of the fewest steps of every kernel segment at which calibration cases meet the
accuracy of a campaign."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import (
    SAFETY,
    achieved,
    decisive,
    errors,
    scales,
    scene_scales,
)
from sepmc.campaign.execution.calibration_cases import (
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
from sepmc.campaign.execution.error_estimate import estimate
from sepmc.campaign.execution.integration import SAFE, Integration
from sepmc.campaign.execution.step_refinement import Integrate, longest_step, refine_steps
from sepmc.campaign.execution.step_search import (
    IN_DOUBT,
    NO_OUTCOMES,
    VALID,
    Search,
    find_durations,
    most_are_valid,
)
from sepmc.engine.dispatch import Block, integrate_cases
from sepmc.engine.written_kernel import Kernel
from sepmc.kernel.spec import structure
from sepmc.kernel.spec.methods import method
from sepmc.schema import Status, separation_columns

# steps of every phase in which a quarter of the sample gives the spread of outcomes
SPREAD_STEPS, _MAX_SPREAD_STEPS = 8, 512
_MAX_ROUNDS = 4  # step searches, each with the worst cases of the sample added
_N_WORST = 24
_MAX_ESTIMATE = 0.6  # of the accuracy: larger estimates were up to 1.6 times too small


def common_steps(
    campaign: Definition,
    kernel: Kernel,
    stages: list[str],
    report: Callable[[int], None],
    size: CalibrationSize,
    history_size: int = 0,
) -> Integration | None:
    """Select steps that all cases of a campaign share, and fit its error estimate, by calibration
    cases.

    The steps are the fewest of every segment at which the calibration cases meet the accuracy; if
    the file gives a step, it is used and its error is measured.

    Parameters
    ----------
    campaign : Definition
    kernel : Kernel
        Kernel of the campaign.
    stages : list of str
        Names of the kernel segments.
    report : callable (n_cases)
        Called after each batch with the number of cases that it integrated.
    size : CalibrationSize
        Number of calibration cases.
    history_size : int
        Number of rows of a stored history; 0 if none is stored.

    Returns
    -------
    Integration or None
        Kernel, steps, methods and error estimate; None if no steps suit most of the cases.
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
        SPREAD_STEPS if step is None else 1,
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
            accuracy_achieved, history=SAFETY * history_error(campaign, trials, halved, scale)
        )
    medians = search.reference[0] if trials.status[0] == Status.OK and search.is_valid[0] else None
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
        medians,
        methods=search.methods,
    )


def history_error(
    campaign: Definition, at_steps: Block, at_half: Block, scale: np.ndarray
) -> float:
    """Largest relative error of stored histories: the difference between histories of the same
    cases integrated with some steps (``at_steps``) and with steps of half the length (``at_half``).

    Cases that are not ok with both are left out; the result is 0 without others. Histories are
    interpolated between the ends of steps, with a lower order than that of the steps. Errors are
    relative to the size of a value or, if larger, to the scale of the outcome with the same name
    as the column, which every column of a history has; ``scale`` (o,) has the scales of all
    outcomes, SI.
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


def _verdict(block: Block, step: float | None) -> np.ndarray:
    """Verdict (n,) on each case of a block: VALID, IN_DOUBT or NO_OUTCOMES.

    A case is VALID if its status is ok or never-released. A case with any other final status has
    NO_OUTCOMES, one that the kernel rejected (negative status) is IN_DOUBT. A case with an unknown
    error indicator is IN_DOUBT too, unless the file gives the ``step``, s (None: it does not).
    """
    is_valid = block.has_outcomes & (step is not None or block.has_indicators)
    return np.where(
        block.status > Status.NEVER_RELEASED,
        NO_OUTCOMES,
        np.where(is_valid, VALID, IN_DOUBT),
    )


def _completed(block: Block, step: float | None) -> np.ndarray:
    """Outcomes and audit columns (m, o), SI, of the m cases of a block that are VALID by `_verdict`
    and have the status ok; of all VALID cases if none of them is ok. ``step`` is as for
    `_verdict`."""
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
    """Largest relative error (o,) of cases that are valid at the chosen steps but not at steps of
    half the length, by comparison with their values at steps at which they converge.

    ``outcomes`` (n, o), SI, are those of n > 0 such cases at the chosen steps. The others are as
    for `refine_steps`: ``integrate`` runs cases at steps of a given fraction of the chosen length,
    which is halved until the decisive outcomes (mask ``is_decisive``) change by at most ``goal``,
    relative. A case that does not converge, or ends with a status other than ok and never-released,
    has infinite errors.
    """
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
    """Indices of the cases whose largest relative error (``errors_of_cases``, (n,)) is above the
    ``goal``, largest error first, at most `_N_WORST` of them. Cases whose error is NaN are left
    out."""
    return np.argsort(-errors_of_cases)[: min(_N_WORST, np.count_nonzero(errors_of_cases > goal))]
