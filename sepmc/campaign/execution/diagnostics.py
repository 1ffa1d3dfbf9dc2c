"""Notes for the user on a campaign and its results, as sentences: probable mistakes in the file,
the sample, the nominal case, and cases that failed or did not reach the accuracy."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.cases import SIZE_DEPENDENT
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy, scene_scales
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.missing_events import missing_of_nominal
from sepmc.campaign.execution.table_overshoot import overshooting
from sepmc.physics.outlines import THROUGH
from sepmc.routines.layout import ROD, ROTATION
from sepmc.scene import parameters
from sepmc.scene.kinds import rows_of
from sepmc.scene.lint import lint_scene
from sepmc.scene.model import GROUND, SALTELLI, Clearance, Scene
from sepmc.scene.outline_parts import selected_parts
from sepmc.scene.signals import idle_signals

_MAX_NAMES = 3  # outcomes in a note
_CLEARANCE, _CLEARANCE_TIME = (
    "_clearance_mm",
    "_clearance_time_s",
)  # columns of the minimum and its time
_END_FRACTION = 1.0 - 1e-9  # of the end time: a later time is the end
_ROW_X, _ALL_ROTATIONS = 0, 3  # code of the row along x; number of rotations
# of the vehicle size: bodies that end deeper in each other did not separate
_MIN_SEPARATION = 1e-3
_MIN_COSINE = 0.5  # of the angle between thrust and direction to the other body


def file_notes(campaign: Definition) -> list[str]:
    """Notes on probable mistakes in a campaign file, found without integrating a case: settings
    that change the nominal case only, findings of `lint_scene`, loads without effect
    (`idle_loads`), and tables whose spline overshoots. Requirements are not examined."""
    dispersed = {d.parameter.path for d in campaign.file.dispersions}
    return [
        *campaign.file.no_effect,
        *lint_scene(campaign.scene, campaign.file.dispersions),
        *idle_loads(campaign.scene, dispersed),
        *overshooting(campaign.scene),
    ]


def scene_notes(campaign: Definition, integration: Integration) -> list[str]:
    """Notes on the file (`file_notes`) and on joints whose bodies end on the wrong side of each
    other in the case whose dispersed inputs are at their medians (`reversed_joints`).

    Parameters
    ----------
    campaign : Definition
    integration : Integration
        Its attribute ``of_medians`` has the outcomes of that case; if it is None, the notes are
        those of `file_notes` alone.

    Returns
    -------
    list of str
    """
    notes = file_notes(campaign)
    if integration.of_medians is None:
        return notes
    case = "the case of median inputs" if campaign.file.dispersions else "the nominal case"
    outcomes = {
        c.name: float(x * c.scale)
        for c, x in zip(campaign.outcome_columns, integration.of_medians, strict=True)
    }
    return notes + reversed_joints(campaign.scene, outcomes, case)


def failure_notes(count: int, n_run: int, max_failures: int | None) -> list[str]:
    """List with one note that a run stopped after ``n_run`` cases, as ``count`` of them failed;
    empty if these are no more than ``max_failures``, or if that is None."""
    if max_failures is None or count <= max_failures:
        return []
    allowed = f"no more than {max_failures} may fail" if max_failures else "none may fail"
    return [
        f"stopped after {n_run} cases: {count} of them did not end with status ok, and {allowed}"
    ]


def worker_notes(worker_kinds: Mapping[str, int]) -> list[str]:
    """List with one note if workers of several kinds (processor and code version) ran the cases, so
    that rows can differ in their last bits; empty if not. ``worker_kinds`` has the number of cases
    by kind."""
    if len(worker_kinds) < 2:
        return []
    texts = "; ".join(f"{count} cases by {kind}" for kind, count in worker_kinds.items())
    return [
        "cases were run by several kinds of processor or code: if they are run again by another "
        f"kind, rows agree to the requested accuracy but not to the last bit ({texts})"
    ]


def sampling_notes(
    campaign: Definition, numbers: CaseSelection, total: int | None = None
) -> Iterator[str]:
    """Yield notes on how the cases of a run were sampled or selected: where confidence intervals
    and verdicts are therefore not valid, too wide or too narrow, and where a sample is incomplete,
    not stratified or not balanced.

    ``numbers`` are the cases of the run; ``total`` is the size of the sample that they belong to.
    Without it, no note says that they are only a part of a design.
    """
    sampler, cases = campaign.scene.run.sampler, numbers.count
    if campaign.file.input_table is not None:
        yield (
            "run.samples: confidence intervals and verdicts are valid only if the "
            "rows of the table are independent random cases"
        )
    if not numbers.are_first and numbers != campaign.numbers:
        yield (
            f"only cases {numbers} are run: if these were chosen by their outcomes, confidence "
            "intervals and verdicts are not valid"
        )
    if sampler == "random":
        return
    if sampler in SIZE_DEPENDENT and total is not None and cases < total:
        yield (
            f"run.sampler = {sampler!r}: cases {numbers} are a part of a design of {total} cases; "
            f"for a design of {cases}, give the number of cases, not a range"
        )
    if sampler == "lhs" and campaign.file.copulas:
        yield (
            "run.sampler = 'lhs': parameters of a [[correlation]] keep their distributions, but "
            "are not stratified: intervals of equal probability can have no case, or several"
        )
    if sampler == SALTELLI:
        yield (
            "run.sampler = 'saltelli': many cases differ from another one in one parameter only, "
            "so confidence intervals are too narrow and requirements get no verdict; sepmc "
            "sensitivity computes sensitivity indices from these cases"
        )
        return
    yield (
        f"run.sampler = {sampler!r}: confidence intervals are computed as for random cases, so "
        "they are mostly too wide; requirements get no verdict"
    )
    if sampler == "sobol" and cases & (cases - 1):
        below = 1 << (cases.bit_length() - 1)
        yield (
            f"a Sobol sequence is balanced after a power of two: run {below} or {2 * below} cases, "
            f"not {cases}"
        )


def idle_loads(scene: Scene, dispersed: set[str]) -> Iterator[str]:
    """Yield notes on what has no effect: motors, loads and springs whose forces are all 0, the
    tail-offs of motors that never burn out, and signals that nothing uses. A value has an
    effect if its path is in ``dispersed`` (it varies) or a signal drives it."""

    def is_zero(path: str, **numbers: float | tuple[float, ...]) -> bool:
        paths = tuple(f"{path}.{key}" for key in numbers)
        return not np.any(np.hstack(list(numbers.values()))) and not any(
            one.startswith(paths) for one in (*dispersed, *scene.driven)
        )

    for motor in scene.motor:
        path = f"motor.{motor.name}"
        if is_zero(path, thrust=motor.thrust):
            yield f"{path} does nothing: thrust_N is 0"
        elif (
            motor.tail_off
            and math.isinf(motor.burn)
            and motor.profile is None
            and f"{path}.burn" not in dispersed
        ):
            yield (
                f"{path}.tail_off_s = {motor.tail_off:g} does nothing: the motor never burns out; "
                "give burn_s or a profile"
            )
    for signal in idle_signals(scene):
        reason = "no load, motor, spring, coefficient or other signal names it"
        yield f"signal.{signal} does nothing: {reason}"
    for load in scene.load:
        if is_zero(f"load.{load.name}", force=load.force, moment=load.moment):
            yield f"load.{load.name} does nothing: give force_N or moment_N_m"
    for spring in scene.spring:
        forces = {key: getattr(spring, key) for key in ("force", "stiffness", "damping")}
        if is_zero(f"spring.{spring.name}", **forces) and not (
            spring.table is not None and any(spring.table.force)
        ):
            yield (
                f"spring.{spring.name} does nothing: give force_N, stiffness_N_per_m, "
                "damping_N_s_per_m or a table"
            )


def nominal_notes(
    campaign: Definition, outcomes: Mapping[str, float], has_ended: bool
) -> Iterator[str]:
    """Yield notes on the nominal case: requirements that it violates or whose outcome it does not
    have, events that do not occur in it, and clearances that are smallest at the end time.

    Parameters
    ----------
    campaign : Definition
    outcomes : mapping of str to float
        Outcomes of the nominal case by column, in the units of the columns.
    has_ended : bool
        True if the case reached its end: events that do not occur are noted only then.

    Yields
    ------
    str
    """
    units = {c.name: c.unit for c in campaign.outcome_columns}
    for item in campaign.file.requirements:
        value = outcomes.get(item.metric)
        if value is None:  # a status or a violation
            continue
        if math.isnan(value):
            yield (
                f"requirement.{item.name}: the nominal case has no {item.metric}: the event that "
                "gives it does not occur, or it is not defined"
            )
        unit = "" if units[item.metric] == "1" else units[item.metric]
        for key, bound, sign in (("at_least", item.at_least, 1), ("at_most", item.at_most, -1)):
            if bound is not None and sign * (value - bound) < 0.0:
                yield (
                    f"requirement.{item.name}.{key} = {bound:g}: the nominal case violates it, "
                    f"{item.metric} is {value:.5g} {unit}".rstrip()
                )
    if has_ended:
        yield from missing_of_nominal(campaign, outcomes)
    for name in min_at_end(campaign, outcomes):
        yield _min_at_end_note(name, "the nominal case ends")


def min_at_end(
    campaign: Definition,
    outcomes: Mapping[str, float] | Mapping[str, np.ndarray],
    inputs: np.ndarray | None = None,
) -> Counter[str]:
    """Count, for each clearance, the cases in which the distance is smallest at the end time.

    In such a case it may become smaller after the end. Penetrations at the limit of the reported
    depth (`outlines.THROUGH`) do not count.

    Parameters
    ----------
    campaign : Definition
    outcomes : mapping of str to float or ndarray, shape (n,)
        Outcomes of one case or of n cases by column, in the units of the columns.
    inputs : ndarray, shape (n, d), optional
        Inputs of the cases, in the units of the file, which can change the outlines of bodies; if
        None, the nominal outlines are used.

    Returns
    -------
    Counter of str
        Number of cases by name of the clearance, without zeros.
    """
    notes: Counter[str] = Counter()
    for clearance in campaign.scene.clearance:
        minimum, times = (
            np.atleast_1d(outcomes[f"{clearance.name}{name}"])
            for name in (_CLEARANCE, _CLEARANCE_TIME)
        )
        at_end = np.flatnonzero(times >= _END_FRACTION * campaign.scene.run.end_time)
        n_through = [
            minimum[row]
            <= -_END_FRACTION * 1e3 * _deepest_penetration(clearance, campaign, inputs, row)
            for row in at_end[minimum[at_end] < 0.0]
        ]
        notes[clearance.name] = len(at_end) - int(sum(n_through))
    return +notes


def _deepest_penetration(
    clearance: Clearance, campaign: Definition, inputs: np.ndarray | None, row: int
) -> float:
    """Maximum depth, m, that a clearance reports for a rim that penetrates the wall of a shell;
    infinite if there is no shell.

    The outlines are those of case ``row`` of ``inputs`` (n, d), in the units of the file, or the
    nominal ones if ``inputs`` is None.
    """
    scene = campaign.scene
    if inputs is not None:
        values = {
            dispersion.parameter.path: float(x) * dispersion.parameter.factor
            for dispersion, x in zip(campaign.file.dispersions, inputs[row], strict=True)
            if ".outline." in dispersion.parameter.path
        }
        scene = parameters.replace(scene, values)
    radii = [
        radius
        for side in range(2)
        for part in selected_parts(scene, clearance, side)
        if part.hollow and part.radii
        for radius in part.radii
    ]
    return THROUGH * max(radii, default=math.inf)


def min_at_end_notes(counts: Mapping[str, int]) -> list[str]:
    """A note for each clearance in ``counts``, which `min_at_end` returned."""
    return [
        _min_at_end_note(name, f"the run ends in {count} cases") for name, count in counts.items()
    ]


def _min_at_end_note(clearance: str, times: str) -> str:
    return (
        f"{clearance}_clearance_mm is smallest when {times}: it may become smaller later; give a "
        "longer run.end_time_s to see"
    )


def accuracy_notes(achieved: AchievedAccuracy, fixed: bool) -> list[str]:
    """List with one note if no calibration case reached its end or, unless the file gives the step
    (``fixed`` is True), if the requested accuracy is not met; else empty. The latter note names the
    outcomes that do not meet it, at most `_MAX_NAMES`, the largest error first; those in
    `AchievedAccuracy.positions` do not count."""
    if not achieved.cases:
        return [
            "no calibration case reached its end with the kernel of the campaign, so its numerical "
            "error is unknown"
        ]
    if fixed or achieved.met:
        return []
    unmet = list(achieved.unmet.items())
    shown = ", ".join(f"{name} {error:.1e}" for name, error in unmet[:_MAX_NAMES]) + (
        ", ..." if len(unmet) > _MAX_NAMES else ""
    )
    return [
        f"the requested accuracy {achieved.asked:g} is not met: error up to "
        f"{unmet[0][1]:.1e} of the size of an outcome, or of its sigma if larger ({shown}); "
        "give a larger solver.accuracy, look at what these outcomes have in common, "
        "or give a shorter solver.step_s"
    ]


def unconverged_notes(count: int, n_refined: int) -> list[str]:
    """List with one note if ``count`` of the ``n_refined`` cases that were integrated again did not
    converge; empty if ``count`` is 0."""
    if not count:
        return []
    return [
        f"{count} of the {n_refined} cases that were integrated again with smaller steps did not "
        "converge to the requested accuracy; the reported error includes them"
    ]


def reversed_joints(scene: Scene, outcomes: dict[str, float], case: str) -> list[str]:
    """Notes on joints whose bodies end on the wrong side of each other: at a separation distance
    below minus 0.1 % of the vehicle length. Hinges are left out: joints that in some phase may turn
    but not move along their x axis, and rods (`_is_hinge`).

    Parameters
    ----------
    scene : Scene
    outcomes : dict of str to float
        Outcomes of one case by column, in the units of the columns.
    case : str
        Name of the case in the notes, such as "the nominal case".

    Returns
    -------
    list of str
    """
    minimum = -_MIN_SEPARATION * float(scene_scales(scene, ["m"])[0])
    notes = []
    for name in scene.joint:
        prefix = "" if len(scene.joint) == 1 else f"{name}_"
        distance = 1e-3 * outcomes[f"{prefix}separation_distance_mm"]
        if distance < minimum and not _is_hinge(scene, name):
            first, second = scene.joint[name].bodies
            notes.append(
                f"joint {name}: {case} ends with a separation distance of {distance:.3g} m: "
                f"{second} is on the wrong side of {first}, from which it should separate; is an "
                "axis of the joint or of a spring the other way round, or the sign "
                f"joint.{name}.apart?{_motors_toward(scene, first, second)}"
            )
    return notes


def _motors_toward(scene: Scene, first: str, second: str) -> str:
    """Sentence for a note on the motors that push one of two bodies (names ``first``, ``second``)
    toward the other, with a leading space; empty if there are no such motors, or one is the ground.
    The nominal thrust must lie within 60 deg of the line to the other mass centre."""
    if GROUND in (first, second):
        return ""
    separation = np.subtract(scene.body[second].cg, scene.body[first].cg) * (-1.0, 1.0, 1.0)
    directions, size = {first: separation, second: -separation}, float(np.linalg.norm(separation))
    motors = [
        f"motor.{motor.name} (cant_deg = {math.degrees(motor.cant):g})"
        for motor in scene.motor
        if motor.body in directions
        and float(directions[motor.body] @ motor.direction) > _MIN_COSINE * size
    ]
    if not motors:
        return ""
    pushes = "push their bodies" if len(motors) > 1 else "pushes its body"
    return f" {' and '.join(motors)} {pushes} toward the other body."


def _is_hinge(scene: Scene, name: str) -> bool:
    """Return True if in some phase, or after a release, joint ``name`` allows rotation but no
    motion along its x axis (or is a rod): its separation distance along x then means nothing."""
    kinds = [phase.joints.get(name, "free") for phase in scene.phase]
    kinds += [release.to for release in scene.release if release.joint == name]
    turning = [
        rows
        for rows in (rows_of(scene.joint[name], kind) for kind in kinds)
        if rows and sum(ROTATION <= row < ROD for row in rows) < _ALL_ROTATIONS
    ]
    return any(_ROW_X in rows or ROD in rows for rows in turning)
