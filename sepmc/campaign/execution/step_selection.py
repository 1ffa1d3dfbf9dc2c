"""Selection of the kernel and the integration steps of a campaign, by calibration cases.

Calibration cases are corners (each input at an end of its distribution) and a sample. They depend
on the scene and its distributions, not on the seed or the number of cases; so do the steps.
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
from sepmc.campaign.execution.common_steps import SPREAD_STEPS, common_steps, history_error
from sepmc.campaign.execution.diagnostics import scene_notes
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
from sepmc.engine.dispatch import (
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
from sepmc.kernel.spec.variant import Variant
from sepmc.scene.messages import Log
from sepmc.schema import Status

_SAMPLE_DIVISOR = 8  # the sample is this much smaller where each case is refined by itself
_LONG_S = 60.0  # after this time a way to shorten calibration is announced


def kernel_spec(campaign: Definition, variant: int = Variant.STANDARD) -> KernelSpec:
    """Specification of the kernel of a campaign, from which its text is written; ``variant`` is a
    `Variant`."""
    return structure.make_kernel_spec(campaign.layout, campaign.dispersed, variant)


def kernel_text(
    campaign: Definition,
    solver: str | None = None,
    history: int = False,
    variant: int = Variant.STANDARD,
) -> str:
    """Python source text of the kernel of a campaign.

    Parameters
    ----------
    campaign : Definition
    solver : str, optional
        Name of the integration method (``solver.method``); that of the campaign if None. With
        "auto" the kernel has several methods, of which each run selects one for each segment.
    history : int
        Which histories the kernel writes: none (0), separations (1) or full ones (2); see
        `sepmc.engine.kernel_texts.written`.
    variant : int
        A `Variant` of the kernel.

    Returns
    -------
    str
    """
    return written(kernel_spec(campaign, variant), solver or campaign.scene.solver.method, history)


def stage_names(spec: KernelSpec) -> list[str]:
    """Name of each kernel segment: that of its phase in the campaign file, with " (late joints)" if
    delayed releases are pending in the segment."""
    return [
        spec.names.back[segment.phase] + (" (late joints)" if segment.late else "")
        for segment in spec.segments
    ]


def fallbacks(campaign: Definition, spec: KernelSpec, history: int) -> tuple[FallbackKernel, ...]:
    """Fallback kernels, in order, for cases that the kernel of the specification ``spec`` rejects;
    they are not loaded yet. ``history`` is as in `kernel_text`."""
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
    """Select kernel and steps with which a campaign meets its ``solver.accuracy``.

    They are taken from memory or the cache folder (`sepmc.campaign.execution.step_store`) if they
    were selected before; else calibration cases are integrated, and the selection is stored there.
    Where kernels run as plain Python, nothing is taken from there or stored.

    Parameters
    ----------
    campaign : Definition
    history : bool
        True if histories are to be stored.
    announce : Log, optional
        Called with messages about compiling and calibration.
    size : CalibrationSize, optional
        Number of calibration cases; (`CORNERS`, `SAMPLE`) if None.
    timing : dict of str to float, optional
        Changed in place: seconds are added to its values of the keys text, compile and steps,
        which must be there.
    again : bool
        True: select steps anew, even if there are stored ones, and do not store them.

    Returns
    -------
    Integration
        Kernel, steps and notes. If no common steps meet the accuracy, it refines the steps of each
        case.
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
    """Copy, with kernel and fallback kernels, of an integration that has none (from
    `Integration.packed`, of another process or the cache folder). The kernel is compiled if
    necessary.

    ``history`` is True if histories are to be stored; ``announce`` and ``timing`` are as in
    `select_steps`.
    """
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
    """Write the text of the kernel of a specification, with or without ``history``, and load it,
    compiled if necessary (``announce`` is called with a message then); add the seconds spent to the
    values of the keys compile and text of ``timing``, if given."""
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
    """Select kernel variant and steps by calibration cases, as `select_steps` does without memory
    and cache folder; the seconds spent are added to ``timing`` in place.

    ``history`` is True if histories are to be stored, ``size`` is the number of calibration cases;
    ``announce`` is called with messages."""
    variant: int = Variant.STANDARD
    history_size = history_rows(campaign.scene) if history and campaign.scene.joint else 0
    while True:
        spec = kernel_spec(campaign, variant)
        kernel = _load(campaign, spec, history, announce, timing)
        _announce_calibration(announce)
        start = time.perf_counter()
        remaining_kernels, stages = fallbacks(campaign, spec, history), stage_names(spec)
        selected = common_steps(
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
    """Variant of the first of the ``remaining_kernels`` that may accept at least half of the corner
    cases that ``kernel`` rejects; None if there is none, or no corner is rejected. Only ``kernel``
    is run: the statuses with which it rejects cases show which variants may accept them
    (`is_accepted_by`). ``size`` gives the number of corner cases."""
    steps, durations = _initial_steps(kernel)
    block, _ = integrate_cases(
        kernel,
        campaign.layout,
        SPREAD_STEPS * steps,
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
    """Number of steps and duration of each segment of a kernel, two arrays (segments,), for a first
    integration: the same number for all segments, and infinite durations, which means unknown."""
    return np.full(kernel.n_segments, SPREAD_STEPS), np.full(kernel.n_segments, np.inf)


def _refined_case_by_case(
    campaign: Definition,
    kernel: Kernel,
    stages: list[str],
    remaining_kernels: tuple[FallbackKernel, ...],
    size: CalibrationSize,
) -> Integration:
    """Integration in which the steps of every case are refined by themselves (if the file gives the
    step, only to measure its error), for a campaign without common steps that suit most cases. Its
    accuracy is that of the corner cases of ``size`` and an eighth of its random cases; ``stages``
    are the names of the segments, ``remaining_kernels`` the fallback kernels."""
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
    medians = block.outcomes[0, : len(units)] if ok[0] else None
    scale = scales(block.outcomes[ok][:, : len(units)], units, scene_scale)
    return replace(
        flight,
        scale=scale,
        error=float(block.refinement.error[is_decisive].max(initial=0.0)) / SAFETY,
        achieved=accuracy_achieved,
        of_medians=medians,
    )


def _with_history_error(
    campaign: Definition, selected: Integration, history_size: int, size: CalibrationSize
) -> Integration:
    """Copy of the integration ``selected`` whose ``achieved`` accuracy has the error of stored
    histories too.

    The error is estimated with histories of ``history_size`` rows of calibration cases; ``size``
    is the number of these. Returns the integration itself if ``history_size`` is 0 (no histories
    are stored) or it has no ``achieved`` accuracy."""
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
    error = history_error(campaign, at_steps, at_half, selected.scale)
    return replace(selected, achieved=replace(selected.achieved, history=SAFETY * error))


def _announce_calibration(announce: Log | None) -> None:
    if announce:
        announce("running calibration cases to select the steps for the requested accuracy ...")


def _progress_counter(announce: Log | None) -> Callable[[int], None]:
    """Create a function ``count(n_cases)`` that adds to the number of calibration cases run so far,
    and announces that number every ten seconds."""
    report, total = progress_reporter(announce, REPORT_EVERY_S), 0

    def count(n_cases: int) -> None:
        nonlocal total
        total += n_cases
        report(
            lambda seconds: (
                f"{total} calibration cases in {seconds:.0f} s"
                + ("; a step of your own, solver.step_s, needs fewer" if seconds > _LONG_S else "")
                + " ..."
            )
        )

    return count


def units_to_compile(text: str) -> tuple[int, int]:
    """Number of compile units (pieces of machine code) of a kernel ``text`` that are not in the
    cache folder, and number of all its units."""
    from sepmc.engine import kernel_cache as compiled  # noqa: PLC0415  (llvmlite)

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
