"""Interpreted runs with a short step selection: from the run's own first cases.

The step selection of campaigns would take most of the time in plain Python. The steps are no
subject of the comparison: whatever they are, the run reports its error, and rows are compared
within that.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from sepmc.campaign import campaign as campaigns
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution import step_selection
from sepmc.campaign.execution.accuracy import achieved, relative_error, scales, scene_scales
from sepmc.campaign.execution.calibration_cases import CalibrationSize
from sepmc.campaign.execution.integration import Integration, typical_durations
from sepmc.campaign.execution.step_refinement import longest_step
from sepmc.engine.dispatch import integrate_cases, interpreted, load_kernel
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.structure import brief_transient
from sepmc.schema import Status

_MAX_STEPS = 64  # per phase
_GIVE_UP = 16  # steps at which no case is valid: then each is refined by itself
_HIGH_ORDER = 8  # order of a method whose halved steps show its error
_CASES = 3  # compared of a random scene


@contextmanager
def run_interpreted(enabled: bool = True, cases: int = _CASES) -> Iterator[None]:
    """Context in which campaigns run interpreted, with steps from `_select_steps`.

    Parameters
    ----------
    enabled : bool
        False leaves campaigns as they are.
    cases : int
        Calibration cases; no more than are compared are needed.
    """
    original = campaigns.select_steps
    campaigns.select_steps = (
        partial(_select_steps, n_cases=min(cases, _CASES)) if enabled else original
    )
    try:
        with interpreted(enabled):
            yield
    finally:
        campaigns.select_steps = original


def _select_steps(
    campaign: Definition,
    history: bool = False,
    announce: Callable[[str], None] | None = None,
    size: CalibrationSize | None = None,
    timing: dict[str, float] | None = None,
    n_cases: int = _CASES,
) -> Integration:
    """Kernel, methods and steps for a campaign: doubles the steps until the first cases
    converge."""
    scene = campaign.scene
    first, end = campaign.numbers.ranges[0] if campaign.file.input_table else (0, n_cases)
    draws = campaign.in_si(campaign.sample(first, min(n_cases, end - first)))
    kernel = load_kernel(step_selection.kernel_text(campaign, history=history))
    units = [c.unit for c in campaign.outcome_columns]
    scene_scale = scene_scales(scene, units)
    typical = np.full(kernel.n_segments, np.inf)
    max_step = longest_step(scene, campaign.file.dispersions, brief_transient(scene))
    min_steps, previous = min(_MAX_STEPS, max(2, math.ceil(scene.run.end_time / max_step))), None
    steps = np.full(kernel.n_segments, min_steps, dtype=np.int64)
    errors, low_order = np.full(len(units), np.inf), method(scene.solver.method).order < _HIGH_ORDER
    while True:
        block, ends = integrate_cases(
            kernel, campaign.layout, steps, typical, campaign.slots, draws
        )
        valid = np.isin(block.status, (Status.OK, Status.NEVER_RELEASED))
        # the durations of segments are known now: the same steps once more
        if np.isinf(typical).all() and valid.any():
            typical[:] = typical_durations(ends, valid)
            continue
        present = block.outcomes[:, : len(units)], valid
        if previous is not None and (both := valid & previous[1]).any():
            errors = relative_error(previous[0][both], present[0][both], units, scene_scale)
        converged = errors.max() <= step_selection.SAFE * scene.solver.accuracy
        if (
            converged
            or 2 * steps.max() > _MAX_STEPS
            or (steps.max() >= _GIVE_UP and not valid.any())
        ):
            chosen_block = previous if converged and previous is not None else present
            if low_order:  # the errors of a step and its half can be equal
                block, _ = integrate_cases(
                    kernel, campaign.layout, 2 * steps, typical, campaign.slots, draws
                )
                both = chosen_block[1] & np.isin(block.status, (Status.OK, Status.NEVER_RELEASED))
                finer = relative_error(
                    chosen_block[0][both], block.outcomes[both, : len(units)], units, scene_scale
                )
                errors = np.maximum(errors, finer) if both.any() else errors
            # the rows are the calibration cases: those without a valid step report their error when
            # they are refined
            reported = achieved(
                campaign, errors if valid.any() else np.zeros(len(units)), len(draws)
            )
            scale = scales(present[0][valid], units, scene_scale)
            return Integration(
                kernel=kernel,
                steps=steps // 2 if converged else steps,
                durations=typical,
                scale=scale,
                error=float(errors.max()),
                achieved=reported,
                fallbacks=step_selection.fallbacks(
                    campaign, step_selection.kernel_spec(campaign), history
                ),
            )
        previous, steps = present, 2 * steps
