"""What a person should know of a campaign that is flown: an accuracy that is not met, a nominal
case that goes together, not apart; loads that do nothing."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy, scene_scales
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.missing_events import missing_of_one
from sepmc.campaign.execution.table_overshoot import overshooting
from sepmc.routines.layout import ROD, ROTATION
from sepmc.scene import parameters
from sepmc.scene.kinds import rows_of
from sepmc.scene.lint import lint_scene
from sepmc.scene.model import GROUND, SALTELLI, Clearance, Scene

_NAMED = 3  # outcomes that a sentence names
_LEAST, _LEAST_AT = "_clearance_mm", "_clearance_time_s"  # how near bodies came, and when
_SAME = 1.0 - 1e-9  # of an end: a time that is no earlier is the end
_X, _ALL = 0, 3  # code of the row that holds a joint's bodies together along x; rotations
# of the vehicle's size: bodies that end further into each other than that did not separate
_TOGETHER = 1e-3
_TOWARD = 0.5  # cosine: a motor that pushes its body toward another


def file_notes(campaign: Definition) -> list[str]:
    """Sentences on what a campaign's file holds."""
    dispersed = {d.parameter.path for d in campaign.file.dispersions}
    return [
        *campaign.file.no_effect,
        *lint_scene(campaign.scene, campaign.file.dispersions),
        *idle(campaign.scene, dispersed),
        *overshooting(campaign.scene),
    ]


def scene_notes(campaign: Definition, flight: Integration) -> list[str]:
    """Sentences on the scene of a campaign, from its file and the flight of its nominal case."""
    found = file_notes(campaign)
    if flight.nominal is None:
        return found
    outcomes = {
        c.name: float(x * c.scale)
        for c, x in zip(campaign.outcome_columns, flight.nominal, strict=True)
    }
    return found + together(campaign.scene, outcomes, "the nominal case")


def failed(count: int, flown: int, most: int | None) -> list[str]:
    """Whether a run was stopped because more cases failed than may."""
    if most is None or count <= most:
        return []
    allowed = f"no more than {most} may" if most else "none may"
    return [f"stopped after {flown} cases, as {count} did not come to their end and {allowed}"]


def mixed(kinds: Mapping[str, int]) -> list[str]:
    """Whether workers of several kinds flew, whose rows may differ in their last bits."""
    if len(kinds) < 2:
        return []
    said = "; ".join(f"{count} cases by {kind}" for kind, count in kinds.items())
    return [
        "workers of several kinds of processor or code flew: rows of each kind are the same to the "
        f"last bit, those of different kinds to the accuracy asked ({said})"
    ]


def sampled(campaign: Definition, numbers: CaseSelection) -> Iterator[str]:
    """Sentences on cases that are not drawn independently of each other, or that a person chose."""
    sampler, cases = campaign.scene.run.sampler, numbers.count
    if campaign.file.input_table is not None:
        yield (
            "run.samples: intervals and verdicts hold only if the rows of the table are "
            "independent random cases"
        )
    if not numbers.are_first and numbers != campaign.numbers:
        yield (
            f"only cases {numbers} are flown: intervals and verdicts hold unless they were chosen "
            "by what they do"
        )
    if sampler == "random":
        return
    if sampler == "lhs" and campaign.file.copulas:
        yield (
            "run.sampler = 'lhs': parameters of a [[correlation]] keep their laws, but do not have "
            "one case in each of equal parts"
        )
    if sampler == SALTELLI:
        yield (
            "run.sampler = 'saltelli': cases repeat each other but for one parameter, so intervals "
            "are too narrow and requirements get no verdict; sepmc sensitivity tells its indices"
        )
        return
    yield (
        f"run.sampler = {sampler!r}: intervals are those of as many random cases, mostly too wide; "
        "requirements get no verdict"
    )
    if sampler == "sobol" and cases & (cases - 1):
        below = 1 << (cases.bit_length() - 1)
        yield (
            f"a Sobol sequence is balanced after a power of two: fly {below} or {2 * below} cases, "
            f"not {cases}"
        )


def idle(scene: Scene, dispersed: set[str]) -> Iterator[str]:
    """A sentence for each load that does nothing, and for a tail-off that never begins; the
    parameters at these paths are ``dispersed``."""

    def is_zero(place: str, **numbers: float | tuple[float, ...]) -> bool:
        paths = tuple(f"{place}.{key}" for key in numbers)
        return not np.any(np.hstack(list(numbers.values()))) and not any(
            path.startswith(paths) for path in dispersed
        )

    for motor in scene.motor:
        place = f"motor.{motor.name}"
        if is_zero(place, thrust=motor.thrust):
            yield f"{place} does nothing: thrust_N is 0"
        elif (
            motor.tail_off
            and math.isinf(motor.burn)
            and motor.profile is None
            and f"{place}.burn" not in dispersed
        ):
            yield (
                f"{place}.tail_off_s = {motor.tail_off:g} does nothing: the motor never burns out; "
                "give burn_s or a profile"
            )
    for load in scene.load:
        if is_zero(f"load.{load.name}", force=load.force, moment=load.moment):
            yield f"load.{load.name} does nothing: give force_N or moment_N_m"
    for spring in scene.spring:
        forces = {key: getattr(spring, key) for key in ("force", "stiffness", "damping")}
        if is_zero(f"spring.{spring.name}", **forces):
            yield (
                f"spring.{spring.name} does nothing: give force_N, stiffness_N_per_m or "
                "damping_N_s_per_m"
            )


def of_nominal(
    campaign: Definition, outcomes: Mapping[str, float], springs: Mapping[str, float] | None
) -> Iterator[str]:
    """Sentences on outcomes of the nominal case, in their units: beyond what is required, missing
    as what they wait for does not come, or least where it may become less; ``springs``: when their
    strokes end, s; None if the case did not come to its end."""
    units = {c.name: c.unit for c in campaign.outcome_columns}
    for item in campaign.file.requirements:
        value = outcomes.get(item.metric)
        if value is None:  # a status, or a violation of others
            continue
        if math.isnan(value):
            yield f"requirement.{item.name}: the nominal case has no {item.metric}"
        unit = "" if units[item.metric] == "1" else units[item.metric]
        for key, bound, within in (("at_least", item.at_least, 1), ("at_most", item.at_most, -1)):
            if bound is not None and within * (value - bound) < 0.0:
                yield (
                    f"requirement.{item.name}.{key} = {bound:g}: the nominal case violates it, "
                    f"{item.metric} is {value:.5g} {unit}".rstrip()
                )
    if springs is not None:
        yield from missing_of_one(campaign, outcomes, springs, "the nominal case")
    for name in min_at_end(campaign, outcomes):
        yield _may_become_less(name, "the nominal flight ends")


def min_at_end(
    campaign: Definition,
    outcomes: Mapping[str, float] | Mapping[str, np.ndarray],
    drawn: np.ndarray | None = None,
) -> Counter[str]:
    """The cases in which a clearance is least as the flight ends, and may become less, by
    clearance: not those as far through the wall of a shell as is told (`outlines.THROUGH`).

    Parameters
    ----------
    outcomes : by column, in their units, of the nominal case or of many (n,)
    drawn : ndarray, shape (n, d)
        Draws of many, in the units of the file.
    """
    found: Counter[str] = Counter()
    for clearance in campaign.scene.clearance:
        least, when = (
            np.atleast_1d(outcomes[f"{clearance.name}{name}"]) for name in (_LEAST, _LEAST_AT)
        )
        at_end = np.flatnonzero(when >= _SAME * campaign.scene.run.end_time)
        through = [
            least[row] <= -_SAME * 1e3 * _deepest(clearance, campaign, drawn, row)
            for row in at_end[least[at_end] < 0.0]
        ]
        found[clearance.name] = len(at_end) - int(sum(through))
    return +found


def _deepest(
    clearance: Clearance, campaign: Definition, drawn: np.ndarray | None, row: int
) -> float:
    """How far, m, a rim is told to be through the wall of a shell of a clearance at most, in a row
    of a case table (n, d); infinite if there is no shell."""
    scene = campaign.scene
    if drawn is not None:
        values = {
            law.parameter.path: float(x) * law.parameter.factor
            for law, x in zip(campaign.file.dispersions, drawn[row], strict=True)
            if ".outline." in law.parameter.path
        }
        scene = parameters.replace(scene, values)
    radii = [
        radius
        for body in clearance.bodies
        for part in (scene.body[body].outline if body in scene.body else ())
        if part.hollow and part.radii
        for radius in part.radii
    ]
    from sepmc.physics.outlines import THROUGH  # noqa: PLC0415  numba, for what has flown only

    return THROUGH * max(radii, default=math.inf)


def still_near(counts: Mapping[str, int]) -> list[str]:
    """A sentence for each clearance of `min_at_end`."""
    return [
        _may_become_less(name, f"the flight ends in {count} cases")
        for name, count in counts.items()
    ]


def _may_become_less(clearance: str, when: str) -> str:
    return (
        f"{clearance}_clearance_mm is least as {when}: it may become less after that; a longer "
        "run.end_time_s tells"
    )


def unmet(told: AchievedAccuracy, fixed: bool) -> list[str]:
    """The sentence for an accuracy that is asked for and not met, with size, outcome and remedy;
    none if it is met."""
    if not told.cases:
        return [
            "no trial case came to its end by the kernel that flies the campaign, so no numerical "
            "error can be told"
        ]
    if fixed or told.met:
        return []
    beyond = {
        name: error
        for name, error in told.errors.items()
        if name not in told.positions and error > told.asked
    }
    names = sorted(beyond, key=lambda name: -beyond[name])
    shown = ", ".join(f"{name} {beyond[name]:.1e}" for name in names[:_NAMED]) + (
        ", ..." if len(names) > _NAMED else ""
    )
    return [
        f"the accuracy {told.asked:g} that was asked is not met: error up to {told.worst[1]:.1e} "
        f"of size or sigma ({shown}); "
        "ask for no more (solver.accuracy), look at what these outcomes have in common, or give a "
        "shorter solver.step_s"
    ]


def unsettled(count: int, again: int) -> list[str]:
    """The sentence that counts cases whose outcomes no step settled, of those flown again."""
    if not count:
        return []
    return [
        f"{count} of the {again} cases that were flown again, each at steps of its own, did not "
        "settle to the accuracy asked, "
        "however short the step; the error that is told includes them"
    ]


def together(scene: Scene, outcomes: dict[str, float], case: str) -> list[str]:
    """A sentence for each joint whose separation ends negative in a case with these outcomes, by
    column; but for those that turn."""
    least = -_TOGETHER * float(scene_scales(scene, ["m"])[0])
    found = []
    for name in scene.joint:
        prefix = "" if len(scene.joint) == 1 else f"{name}_"
        distance = 1e-3 * outcomes[f"{prefix}separation_distance_mm"]
        if distance < least and not _turns(scene, name):
            first, second = scene.joint[name].bodies
            found.append(
                f"joint {name}: {case} ends with {second} {-distance:.3g} m on the side of "
                f"{first} from which it should separate "
                f"(separation distance {distance:.3g} m): is an axis of the joint or of a spring "
                f"the other way round, or joint.{name}.apart?{_pushed(scene, first, second)}"
            )
    return found


def _pushed(scene: Scene, first: str, second: str) -> str:
    """Which motors push one body toward another."""
    if GROUND in (first, second):
        return ""
    apart = np.subtract(scene.body[second].cg, scene.body[first].cg) * (-1.0, 1.0, 1.0)
    ways, size = {first: apart, second: -apart}, float(np.linalg.norm(apart))
    found = []
    for motor in scene.motor:
        way = ways.get(motor.body)
        if way is not None and float(way @ motor.direction) > _TOWARD * size:
            found.append(f"motor.{motor.name}, cant_deg = {math.degrees(motor.cant):g}")
    if not found:
        return ""
    pushes = "push their bodies" if len(found) > 1 else "pushes its body"
    return f" {'; '.join(found)}: {pushes} toward the other"


def _turns(scene: Scene, name: str) -> bool:
    """Whether a joint lets its bodies turn in some phase, as a hinge does, but not slide: its x
    axis is not where they separate to."""
    kinds = [rows_of(scene.joint[name], phase.joints.get(name, "free")) for phase in scene.phase]
    turning = [rows for rows in kinds if rows and sum(ROTATION <= row < ROD for row in rows) < _ALL]
    return any(_X in rows or ROD in rows for rows in turning)
