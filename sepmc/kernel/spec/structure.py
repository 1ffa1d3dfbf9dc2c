"""The structure of a scene: its stages, what joints may hold in each, which bodies turn as one,
what ends a stage, and which rows are redundant."""

import itertools
import math
from collections.abc import Iterator

from sepmc.kernel.spec.conditions import Leaf, make_conditions
from sepmc.kernel.spec.heights import may_pass_borders
from sepmc.kernel.spec.kernel_spec import Change, Due, Event, Kinds, Release, Shape, Stage
from sepmc.kernel.spec.naming import Names
from sepmc.kernel.spec.parameter_layout import Plan, is_ground_named
from sepmc.routines import layout as at
from sepmc.scene.kinds import rows_of
from sepmc.scene.model import GROUND, Condition, Phase, Scene
from sepmc.scene.redundancy import dependent_rows

_ON_STATE = {
    "stroke": at.AT_STROKE,
    "distance": at.AT_DISTANCE,
    "angle": at.AT_ANGLE,
    "altitude": at.AT_ALTITUDE,
    "vertical_speed": at.AT_VERTICAL_SPEED,
}
_ON_LOAD = {"force": at.AT_FORCE, "moment": at.AT_MOMENT}
# stretches of a phase that a load may end: each as long as the phase usually is, or a share of the
# time left
_UNTOLD = 2**17


def _needs_any_order(shape: Shape) -> bool:
    """Whether a scene asks for more than phases that follow each other, with joints that are late
    between them: where conditions are waited for meanwhile that cannot be noted, joints fail
    nominally or let go in part twice, or rows are redundant while joints let go."""
    scene, stages = shape.scene, shape.stages
    if any(stage.after_late and (stage.waits_for_load or stage.clauses) for stage in stages) or any(
        j.fails for j in scene.joint.values()
    ):
        return True
    if any(
        release.to != "free" or _may_be_late(scene, release.joint, shape.dispersed)
        for release in scene.release
    ):
        return True
    guides = [name for name, joint in scene.joint.items() if joint.guide is not None]
    return any(
        stage.redundant and (stage.masked or any(map(stage.sliding, guides))) for stage in stages
    )


def _is_manifold(scene: Scene, until: Condition) -> bool:
    """Whether a phase ends by several conditions, or as one of several would: by a spring, or by
    the burn-out of a motor whose ignition is not known beforehand."""
    keys = ("time", "burn_out", *_ON_LOAD, *_ON_STATE)
    return (
        bool(until.any or until.all or until.spring)
        or any(motor.name == until.burn_out and motor.trigger for motor in scene.motor)
        or sum(getattr(until, key) is not None for key in keys) != 1
    )


def _may_be_late(scene: Scene, joint: str, dispersed: frozenset[str]) -> bool:
    return scene.joint[joint].delay > 0.0 or f"joint.{joint}.delay" in dispersed


def make_shape(plan: Plan, dispersed: frozenset[str] = frozenset(), care: int = at.USUAL) -> Shape:
    """The shape of a scene.

    A joint that is late lets go between two phases, in a stage of its own; a case in which the next
    phase ends meanwhile is lost. With the ``care`` of ANY_ORDER, and for scenes that need it, it
    may let go whenever it is due, in any phase: stages are the phases, and what such joints hold is
    masked. With that of LEAST_SQUARES, besides, rows may follow from others, or cease to, in any
    case.
    """
    if care == at.USUAL:
        shape = _shape(plan, dispersed, at.USUAL)
        if not _needs_any_order(shape):
            return shape
    return _shape(plan, dispersed, min(care, at.ANY_ORDER))


def _shape(plan: Plan, dispersed: frozenset[str], care: int) -> Shape:
    names = Names(plan.scene)
    plan, dispersed = names.plan(plan), frozenset(names.path(path) for path in dispersed)
    scene = plan.scene
    spent = {
        s.name: s.bodies
        for s in scene.spring
        if math.isfinite(s.stroke) or f"spring.{s.name}.stroke" in dispersed
    }
    switches, releases = _breaks(scene, dispersed), _releases(plan, dispersed)
    stages, any_order = _stages(plan, dispersed, releases, care), care <= at.ANY_ORDER
    in_layers = scene.environment.atmosphere == "us1976" and any(
        body.aerodynamics is not None for body in scene.body.values()
    )
    borders = in_layers and (any_order or may_pass_borders(scene, plan.extremes))
    for stage in stages:
        stage.events += [
            Event(at.AT_SPRING_STROKE, name, plan.slots[f"spring.{name}.stroke"], False)
            for name, bodies in spent.items()
            if not _still(scene, stage, bodies)
        ]
        for body in plan.bodies if borders else []:
            if scene.body[body].aerodynamics is not None:
                stage.events += [
                    Event(what, body, -1, False) for what in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)
                ]
        stage.events += dict.fromkeys(
            event for release in stage.releases for event in release.events
        )
        stage.loads += dict.fromkeys(load for release in stage.releases for load in release.loads)
        times = len(stage.times) + sum(len(release.times) for release in stage.releases)
        others = sum(not event.ends_phase for event in (*stage.events, *stage.loads))
        told = sum(change.joint in stage.masked for change in _changes(scene))
        stage.stops = (
            1 + others + times + switches + told + (_UNTOLD if stage.waits_for_load else 0)
        )
        # lanes then go each at their own pace: an event may come much later than it is foretold
        stage.stops = max(stage.stops, 2) if any_order and stage.events else stage.stops
    turning: list[str] = []
    for stage in stages:
        turning += [b for b in stage.leaders if b not in turning]
    turning += [b for b in plan.bodies if b not in turning]
    failing = [name for name, joint in scene.joint.items() if _may_fail(scene, name, dispersed)]
    return Shape(
        plan,
        dispersed,
        names,
        stages,
        turning,
        _changes(scene),
        care,
        failing,
        switches > 0,
        borders,
    )


def _stages(
    plan: Plan, dispersed: frozenset[str], releases: list[Release], care: int
) -> list[Stage]:
    """The stages of a flight, with what ends each by itself."""
    scene, stages, any_order = plan.scene, list[Stage](), care <= at.ANY_ORDER
    for number, phase in enumerate(scene.phase):
        may = {name: _may_hold(scene, name, number, dispersed, any_order) for name in scene.joint}
        stage = _stage(scene, phase.name, phase.name, may, plan.bodies, releases, care)
        if phase.until is not None and _is_manifold(scene, phase.until):
            _add_clauses(stage, number, plan, dispersed)
        else:
            _add_end(stage, phase, plan, dispersed)
        if number and not any_order:
            _add_late(stages, stage, number, plan, dispersed, releases)
        stages.append(stage)
    return stages


def _may_fail(scene: Scene, joint: str, dispersed: frozenset[str]) -> bool:
    return scene.joint[joint].fails > 0.0 or f"joint.{joint}.fails" in dispersed


def _chain(scene: Scene, joint: str) -> list[tuple[int, ...]]:
    """What a joint holds over phases and releases, codes of rows, most first: it only lets go."""
    kinds = [phase.joints.get(joint, "free") for phase in scene.phase]
    kinds += [release.to for release in scene.release if release.joint == joint]
    found = dict.fromkeys(tuple(rows_of(scene.joint[joint], kind)) for kind in kinds)
    return sorted(found, key=len, reverse=True)


def _numbered(scene: Scene, joint: str, kind: str) -> int:
    """The number of a kind among those of a joint."""
    return _chain(scene, joint).index(tuple(rows_of(scene.joint[joint], kind)))


def _in_phase(scene: Scene, joint: str, phase: int) -> int:
    """The number of the kind that a phase tells a joint to be."""
    return _numbered(scene, joint, scene.phase[phase].joints.get(joint, "free"))


def _changes(scene: Scene) -> list[Change]:
    """What events tell joints: ends of phases, then releases."""
    found = []
    for (number, phase), joint in itertools.product(enumerate(scene.phase[:-1]), scene.joint):
        to = _in_phase(scene, joint, number + 1)
        if to > _in_phase(scene, joint, number):
            found.append(Change(joint, phase.name, to))
    return found + [
        Change(r.joint, r.name, _numbered(scene, r.joint, r.to), r.optional) for r in scene.release
    ]


def _may_hold(
    scene: Scene, joint: str, phase: int, dispersed: frozenset[str], any_order: bool
) -> Kinds:
    """What a joint may hold in a phase: that of the phase or what it was released to, or, if it may
    be late or fail and may let go in ``any_order``, what it held before."""
    told = [_in_phase(scene, joint, phase)]
    if any_order and (_may_be_late(scene, joint, dispersed) or _may_fail(scene, joint, dispersed)):
        told = [_in_phase(scene, joint, number) for number in range(phase + 1)]
    released = [
        _numbered(scene, joint, release.to) for release in scene.release if release.joint == joint
    ]
    numbers = sorted({*told, *(number for number in released if number > told[0])})
    chain = _chain(scene, joint)
    return {number: chain[number] for number in numbers}


def _add_late(
    stages: list[Stage],
    stage: Stage,
    number: int,
    plan: Plan,
    dispersed: frozenset[str],
    releases: list[Release],
) -> None:
    """What joints that are late in letting go before phase ``number`` add: a delay to the end of
    the one before, if that is a time and no other joint changes; or else a stage of its own, in
    which those joints hold as before and all others as from now on.

    What ends the second phase is waited for meanwhile, too: cases in which it may have come are
    lost (`Stage.after_late`).
    """
    scene, phase = plan.scene, plan.scene.phase[number]
    changed = [
        joint
        for joint in scene.joint
        if _in_phase(scene, joint, number) != _in_phase(scene, joint, number - 1)
    ]
    late = {
        joint: plan.slots[f"joint.{joint}.delay"]
        for joint in changed
        if _may_be_late(scene, joint, dispersed)
    }
    if not late:
        return
    stage.after_late, awaited = (
        True,
        next((event for event in stage.events if event.ends_phase), None),
    )
    if len(changed) == 1 and stages[-1].end_time:
        stages[-1].delay, stages[-1].awaited = late[changed[0]], awaited
        return
    may = dict(stage.may)
    for joint in late:
        before = _may_hold(scene, joint, number - 1, dispersed, False)
        may[joint] = before | stage.may[joint] if len(late) > 1 else before
    between = _stage(scene, f"{phase.name}_late", phase.name, may, plan.bodies, releases, at.USUAL)
    between.late, between.awaited = late, awaited
    if _holds_alike(stages[-1], between):
        stages[-1].flown_as = between.name
    stages.append(between)


def _holds_alike(stage: Stage, late: Stage) -> bool:
    """Whether a stage, in which nothing lets go, has the rows that the next has before its late
    joints let go."""
    return not (stage.masked or stage.dropped or stage.redundant or late.redundant) and (
        (stage.groups, stage.full, [(row.joint, row.code) for row in stage.rows])
        == (late.groups, late.full, [(row.joint, row.code) for row in late.rows])
    )


def _add_end(stage: Stage, phase: Phase, plan: Plan, dispersed: frozenset[str]) -> None:
    """What ends a phase: a time, the end of a burn, or a condition on a joint."""
    until, path = phase.until, f"phase.{phase.name}.until"
    leaves = {leaf.path: (leaf, place) for leaf, place in _thresholds(plan, dispersed)}
    if until is None:
        return
    if until.time is not None:
        stage.end_time = (leaves[f"{path}.time"][1],)
    elif until.burn_out is not None:
        stage.end_time = _burn_out(plan, until.burn_out).places
    else:
        key = next(key for key in (*_ON_LOAD, *_ON_STATE) if getattr(until, key) is not None)
        leaf, place = leaves[f"{path}.{key}"]
        event = Event(leaf.what, leaf.which, place, True, direction=leaf.direction)
        (stage.loads if key in _ON_LOAD else stage.events).append(event)


def _burn_out(plan: Plan, name: str) -> Due:
    """The time of a burn-out."""
    motor = next(one for one in plan.scene.motor if one.name == name)
    keys = ("burn",) if motor.trigger is not None else ("ignition", "delay", "burn")
    places = tuple(plan.slots[f"motor.{name}.{key}"] for key in keys)
    return Due(places, name if motor.trigger is not None else "")


def _add_clauses(stage: Stage, number: int, plan: Plan, dispersed: frozenset[str]) -> None:
    """Several conditions that end phase ``number``."""
    stage.clauses, stage.times, stage.springs, events, loads = _clauses(number, plan, dispersed)
    stage.events += events
    stage.loads += loads


def _clauses(
    number: int, plan: Plan, dispersed: frozenset[str]
) -> tuple[list[tuple[int, ...]], dict[int, Due], dict[int, str], list[Event], list[Event]]:
    """What makes the event ``number`` of all, the ends of phases first: any of clauses, each all of
    conditions; those that are times, ends of springs, those on the state, those on loads."""
    conditions, first = make_conditions(plan.scene, dispersed), int(plan.model.scene[0].leaves_p)
    start, count = conditions.events[2 * number : 2 * number + 2]
    clauses: list[tuple[int, ...]] = []
    times: dict[int, Due] = {}
    springs: dict[int, str] = {}
    on_state: list[Event] = []
    on_load: list[Event] = []
    for clause in range(start, start + count):
        begin, size = conditions.clauses[2 * clause : 2 * clause + 2]
        clauses.append(tuple(conditions.clause_leaves[begin : begin + size]))
    for k, leaf in enumerate(conditions.leaves):
        if leaf.event != number:
            continue
        if leaf.what == at.AT_TIME:
            times[k] = Due((first + k,))
        elif leaf.what == at.AT_BURN_OUT:
            times[k] = _burn_out(plan, leaf.which)
        elif leaf.what == at.AT_SPRING_STROKE:
            springs[k] = leaf.which
        else:
            apart = number >= len(plan.scene.phase)
            event = Event(leaf.what, leaf.which, first + k, False, k, apart, leaf.direction)
            (on_load if leaf.what in _ON_LOAD.values() else on_state).append(event)
    return clauses, times, springs, on_state, on_load


def _releases(plan: Plan, dispersed: frozenset[str]) -> list[Release]:
    """Releases apart from phases, and instants that are told of."""
    told = [(r.name, r.joint) for r in plan.scene.release]
    told += [(event.name, "") for event in plan.scene.event]
    return [
        Release(name, joint, *_clauses(number, plan, dispersed))
        for number, (name, joint) in enumerate(told, len(plan.scene.phase))
    ]


def _thresholds(plan: Plan, dispersed: frozenset[str]) -> Iterator[tuple[Leaf, int]]:
    """Leaves with a path of their own, and the place of their thresholds."""
    first = int(plan.model.scene[0].leaves_p)
    for number, leaf in enumerate(make_conditions(plan.scene, dispersed).leaves):
        if leaf.path is not None:
            yield leaf, first + number


def _still(scene: Scene, stage: Stage, bodies: tuple[str, str]) -> bool:
    """Whether two bodies cannot move relative to each other: one joint holds them altogether."""
    between = [
        row.joint
        for row in stage.rows
        if set(scene.joint[row.joint].bodies) == set(bodies) and not row.kinds
    ]
    return stage.leader(bodies[0]) == stage.leader(bodies[1]) and any(
        between.count(joint) == 3 for joint in between
    )


def brief_transient(scene: Scene) -> float:
    """Time constant, s, below which a transient is a stretch of its own, in which a kernel takes
    all steps of its phase."""
    return at.BRIEF / at.TRANSIENT * scene.run.end_time


def _breaks(scene: Scene, dispersed: frozenset[str]) -> int:
    """Number of times within a flight at which a load switches, at most."""
    count = 0
    for motor in scene.motor:
        path = f"motor.{motor.name}"
        count += (
            motor.ignition != 0.0
            or motor.delay > 0.0
            or bool(dispersed & {f"{path}.ignition", f"{path}.delay"})
        )
        count += (
            math.isfinite(motor.burn) or motor.profile is not None or f"{path}.burn" in dispersed
        )
        count += len(motor.profile.time) if motor.profile else 0
        # only a brief one is a stretch of its own, and some case may have one
        for key in ("build_up", "tail_off"):
            count += (
                0.0 < getattr(motor, key) < brief_transient(scene) or f"{path}.{key}" in dispersed
            )
    for load in scene.load:
        path = f"load.{load.name}"
        count += load.start > 0.0 or f"{path}.start" in dispersed
        count += math.isfinite(load.end) or f"{path}.end" in dispersed
    return int(count)


def _stage(
    scene: Scene,
    name: str,
    phase: str,
    may: dict[str, Kinds],
    bodies: list[str],
    releases: list[Release],
    care: int,
) -> Stage:
    """Groups and rows of a stage. Rotations within a group are left out: its bodies share one
    attitude. If rows are redundant, and joints may let go in any order, or if rows may become so,
    all bodies turn by themselves, and all rows are left in."""
    numbers = {r.name: _numbered(scene, r.joint, r.to) for r in scene.release}
    lighting = {motor.trigger.release for motor in scene.motor if motor.trigger is not None}
    told = [
        r
        for r in releases
        if not r.joint or r.name in lighting or numbers[r.name] > min(may[r.joint])
    ]
    made = Stage(name, phase, may, releases=told)
    ground = [GROUND] if is_ground_named(scene) else []
    alone: list[tuple[str, ...]] = [(body,) for body in [*bodies, *ground]]
    largest = [
        (row.joint, row.code)
        for row in made.every_row
        if min(may[row.joint]) in (row.kinds or may[row.joint])
    ]
    made.redundant = len(dependent_rows(scene, largest, []))
    made.groups = alone
    made.least_squares = bool(made.every_row) and (
        care == at.LEAST_SQUARES or (care == at.ANY_ORDER and made.redundant > 0)
    )
    made.full = (
        scene.solver.formulation == "full"
        and bool(made.every_row)
        and not (made.redundant or made.least_squares)
    )
    if made.least_squares or made.full:
        made.rows = made.every_row
        return made
    made.welds = [
        joint for joint, kinds in may.items() if all(_turns(codes) == 3 for codes in kinds.values())
    ]
    made.groups = _groups(scene, made.welds, [*bodies, GROUND])
    rows = [
        row
        for row in made.every_row
        if not (row.turns and len({made.leader(b) for b in scene.joint[row.joint].bodies}) == 1)
    ]
    held = [(row.joint, row.code) for row in rows]
    # of one kind or the other, rows of a joint that lets go are not all held at once
    redundant = made.redundant > 0 and not made.masked
    dependent = (
        dependent_rows(scene, held, [group for group in made.groups if group != (GROUND,)])
        if redundant
        else []
    )
    made.groups = [group for group in made.groups if group != (GROUND,) or ground]
    made.rows = [row for number, row in enumerate(rows) if number not in dependent]
    made.dropped = [rows[number] for number in dependent]
    return made


def _groups(scene: Scene, welds: list[str], order: list[str]) -> list[tuple[str, ...]]:
    """Bodies that turn as one, and the ground."""
    group: dict[str, tuple[str, ...]] = {body: (body,) for body in order}
    for joint in welds:
        first, second = scene.joint[joint].bodies
        merged = tuple(sorted({*group[first], *group[second]}, key=order.index))
        merged = (GROUND, *(b for b in merged if b != GROUND)) if GROUND in merged else merged
        for body in merged:
            group[body] = merged
    return list(dict.fromkeys(group.values()))


def _turns(codes: tuple[int, ...]) -> int:
    """How many rotations rows hold."""
    return sum(at.ROTATION <= code < at.ROD for code in codes)
