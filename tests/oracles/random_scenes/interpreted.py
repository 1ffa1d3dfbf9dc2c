"""The pilot of plain Python: steps for the text that is flown as it stands, from the run's own
first cases.

The campaign's pilot would take most of the time there. What steps it finds is not what the gate is
about: whatever they are, the run reports the error it was flown with, and rows are held to that.
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
from sepmc.campaign.execution.integration import Integration, typical_durations
from sepmc.campaign.execution.step_refinement import longest_step
from sepmc.engine.dispatch import integrate_cases, interpreted, load_kernel
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.structure import brief_transient
from sepmc.schema import Status

_MOST_STEPS = 64  # of a phase
_HOPELESS = 16  # steps with which no case is sound: then each is flown again by itself
_HIGH = 8  # order of a method whose halved steps tell its error
_CASES = 3  # as many as the gate compares


@contextmanager
def flown_plainly(wanted: bool = True, cases: int = _CASES) -> Iterator[None]:
    """Let campaigns be flown so meanwhile: kernels as plain Python, in steps found here by so many
    cases, which need be no more than are compared."""
    usual = campaigns.select_steps
    campaigns.select_steps = partial(_plan, trials=min(cases, _CASES)) if wanted else usual
    try:
        with interpreted(wanted):
            yield
    finally:
        campaigns.select_steps = usual


def _plan(
    campaign: Definition,
    history: bool = False,
    announce: Callable[[str], None] | None = None,
    trials: int = _CASES,
) -> Integration:
    scene = campaign.scene
    first, end = campaign.numbers.ranges[0] if campaign.file.input_table else (0, trials)
    draws = campaign.in_si(campaign.sample(first, min(trials, end - first)))
    kernel = load_kernel(step_selection.kernel_text(campaign, history=history))
    units = [c.unit for c in campaign.outcome_columns]
    own = scene_scales(scene, units)
    usual = np.full(kernel.n_segments, np.inf)
    longest = longest_step(scene, campaign.file.dispersions, brief_transient(scene))
    fewest, before = min(_MOST_STEPS, max(2, math.ceil(scene.run.end_time / longest))), None
    steps = np.full(kernel.n_segments, fewest, dtype=np.int64)
    errors, low_order = np.full(len(units), np.inf), method(scene.solver.method).order < _HIGH
    while True:
        block, ends = integrate_cases(kernel, campaign.plan, steps, usual, campaign.slots, draws)
        sound = np.isin(block.status, (Status.OK, Status.NEVER_RELEASED))
        # now it is known how long stages last: the same steps once more
        if np.isinf(usual).all() and sound.any():
            usual[:] = typical_durations(ends, sound)
            continue
        now = block.outcomes[:, : len(units)], sound
        if before is not None and (both := sound & before[1]).any():
            errors = relative_error(before[0][both], now[0][both], units, own)
        snapped = errors.max() <= step_selection.SAFE * scene.solver.accuracy
        if (
            snapped
            or 2 * steps.max() > _MOST_STEPS
            or (steps.max() >= _HOPELESS and not sound.any())
        ):
            flown = before if snapped and before is not None else now
            if low_order:  # a step and its half can be off by the same
                block, _ = integrate_cases(
                    kernel, campaign.plan, 2 * steps, usual, campaign.slots, draws
                )
                both = flown[1] & np.isin(block.status, (Status.OK, Status.NEVER_RELEASED))
                finer = relative_error(
                    flown[0][both], block.outcomes[both, : len(units)], units, own
                )
                errors = np.maximum(errors, finer) if both.any() else errors
            # the rows are the trial cases: those that no step suits tell their error when they are
            # flown again
            told = achieved(campaign, errors if sound.any() else np.zeros(len(units)), len(draws))
            scale = scales(now[0][sound], units, own)
            chosen = steps // 2 if snapped else steps
            left = step_selection.fallbacks(campaign, history)
            return Integration(
                kernel=kernel,
                steps=chosen,
                durations=usual,
                scale=scale,
                error=float(errors.max()),
                achieved=told,
                fallbacks=left,
            )
        before, steps = now, 2 * steps
