"""Derivation of the kernel specification of a scene: its segments of time and, in each, the kinds
(sets of constraint rows) that joints may have, rigid groups, events and redundant rows.

In every function ``dispersed`` has the paths of the dispersed parameters: what their values may
cause in some case is included, also if the nominal case is without it.
"""

import itertools
import math
from collections.abc import Iterator

from sepmc.kernel.spec.conditions import Leaf, make_conditions
from sepmc.kernel.spec.heights import may_pass_borders
from sepmc.kernel.spec.kernel_spec import (
    Change,
    Due,
    Event,
    KernelSpec,
    Kinds,
    Release,
    Segment,
)
from sepmc.kernel.spec.kinks import Formulas, kink_name
from sepmc.kernel.spec.naming import Names
from sepmc.kernel.spec.parameter_layout import ParameterLayout, is_ground_named
from sepmc.kernel.spec.step_cells import step_cells
from sepmc.kernel.spec.variant import Variant
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
# maximum number of intervals of a segment that a joint load may end, or in which tables with kinks
# are used: each takes the typical duration of the phase, or a fraction of the time left
_MANY_INTERVALS = 2**17
# maximum number of intervals between kinks of formulas in a segment
_MOST_SWITCHES = 2**11


def _needs_any_order(spec: KernelSpec) -> bool:
    """True if a scene needs the kernel variant ANY_ORDER, given its specification ``spec`` in the
    variant STANDARD: a phase's end condition cannot be evaluated while delayed releases are
    pending, a joint fails in the nominal case, a release by a condition of its own (``release`` in
    the file) is partial or may be delayed, or rows are redundant in a segment in which joints
    change or pins slide."""
    scene, segments = spec.scene, spec.segments
    if any(
        segment.after_late and (segment.may_end_by_load or segment.clauses) for segment in segments
    ) or any(j.fails for j in scene.joint.values()):
        return True
    if any(
        release.to != "free" or _may_be_late(scene, release.joint, spec.dispersed)
        for release in scene.release
    ):
        return True
    guides = [name for name, joint in scene.joint.items() if joint.guide is not None]
    return any(
        segment.redundant and (segment.variable_joints or any(map(segment.sliding_kinds, guides)))
        for segment in segments
    )


def _has_several_conditions(scene: Scene, until: Condition) -> bool:
    """True if the condition ``until`` of a phase is handled by clauses: it combines several
    conditions, or is the end of a spring's stroke, or the burn-out of a motor that waits for a
    trigger."""
    keys = ("time", "burn_out", *_ON_LOAD, *_ON_STATE)
    return (
        bool(until.any or until.all or until.spring)
        or any(motor.name == until.burn_out and motor.trigger for motor in scene.motor)
        or sum(getattr(until, key) is not None for key in keys) != 1
    )


def _may_be_late(scene: Scene, joint: str, dispersed: frozenset[str]) -> bool:
    """True if a joint has a release delay above zero in the nominal case, or the path of its
    delay is among the paths ``dispersed``."""
    return scene.joint[joint].delay > 0.0 or f"joint.{joint}.delay" in dispersed


def make_kernel_spec(
    layout: ParameterLayout,
    dispersed: frozenset[str] = frozenset(),
    variant: int = Variant.STANDARD,
) -> KernelSpec:
    """Derive the kernel specification of a scene.

    In the variant STANDARD a joint with a release delay is released in a segment of its own between
    two phases; a case in which the next phase ends meanwhile is rejected, and needs ANY_ORDER. In
    ANY_ORDER (also chosen instead of STANDARD for scenes that need it) such a joint may be released
    in any phase: the segments are the phases, and rows of the joint are masked once it is released.
    In LEAST_SQUARES, besides, rows may become redundant, or cease to be, during a case.

    Parameters
    ----------
    layout : ParameterLayout
        with the names of the file; those of the specification are generated
    dispersed : frozenset of str
        paths of dispersed parameters: features that only some cases have are included
    variant : Variant

    Returns
    -------
    KernelSpec
    """
    if variant == Variant.STANDARD:
        spec = _make(layout, dispersed, Variant.STANDARD)
        if not _needs_any_order(spec):
            return spec
    return _make(layout, dispersed, Variant(min(variant, Variant.ANY_ORDER)))


def _make(layout: ParameterLayout, dispersed: frozenset[str], variant: Variant) -> KernelSpec:
    """Kernel specification of a scene in exactly the given variant, even if the scene needs a more
    general one; arguments as in `make_kernel_spec`."""
    names, of_file = Names(layout.scene), layout
    layout, dispersed = names.layout(layout), frozenset(names.path(path) for path in dispersed)
    scene = layout.scene
    springs_with_stroke = {
        s.name: s.bodies
        for s in scene.spring
        if math.isfinite(s.stroke) or f"spring.{s.name}.stroke" in dispersed
    }
    switches, releases = _count_switches(scene, dispersed), _releases(layout, dispersed)
    segments, any_order = (
        _make_segments(layout, dispersed, releases, variant),
        variant <= Variant.ANY_ORDER,
    )
    in_layers = scene.environment.atmosphere == "us1976" and any(
        body.aerodynamics is not None for body in scene.body.values()
    )
    borders = in_layers and (any_order or may_pass_borders(of_file.scene, of_file.extremes))
    samples = _count_samples(scene, dispersed)
    kinks = [kink_name(k) for k in range(len(Formulas(scene, names).kinks))]
    for segment in segments:
        segment.events += [
            Event(at.AT_SPRING_STROKE, name, layout.slots[f"spring.{name}.stroke"], False)
            for name, bodies in springs_with_stroke.items()
            if not _is_fixed(scene, segment, bodies)
        ]
        for body in layout.bodies if borders else []:
            if scene.body[body].aerodynamics is not None:
                segment.events += [
                    Event(quantity, body, -1, False)
                    for quantity in (at.AT_LAYER_TOP, at.AT_LAYER_BASE)
                ]
        segment.events += [Event(at.AT_KINK, kink, -1, False) for kink in kinks]
        cell_ends = [
            Event(quantity, cell, axis, False)
            for cell, axes in step_cells(scene, dispersed).items()
            for axis in axes
            for quantity in (at.AT_CELL_TOP, at.AT_CELL_BASE)
        ]
        segment.events += cell_ends
        segment.events += dict.fromkeys(
            event for release in segment.releases for event in release.events
        )
        segment.loads += dict.fromkeys(
            load for release in segment.releases for load in release.loads
        )
        times = len(segment.times) + sum(len(release.times) for release in segment.releases)
        others = sum(not event.ends_phase for event in (*segment.events, *segment.loads))
        changes = sum(change.joint in segment.variable_joints for change in _changes(scene))
        segment.max_intervals = (
            1
            + others
            + times
            + switches
            + changes
            + (_MANY_INTERVALS if segment.may_end_by_load or cell_ends else 0)
            + (_MOST_SWITCHES if kinks else 0)
            + samples
        )
        # lanes then use steps of their own: an event may occur much later than predicted
        segment.max_intervals = (
            max(segment.max_intervals, 2) if any_order and segment.events else segment.max_intervals
        )
    attitude_order: list[str] = []
    for segment in segments:
        attitude_order += [b for b in segment.leaders if b not in attitude_order]
    attitude_order += [b for b in layout.bodies if b not in attitude_order]
    failing = [name for name, joint in scene.joint.items() if _may_fail(scene, name, dispersed)]
    return KernelSpec(
        layout,
        dispersed,
        names,
        segments,
        attitude_order,
        _changes(scene),
        variant,
        failing,
        switches > 0,
        borders,
    )


def _count_samples(scene: Scene, dispersed: frozenset[str]) -> int:
    """Return an upper bound of the number of instants of a case at which any sampled signal takes
    a sample, or begins to output one that it took earlier (`delay`). A signal whose sampling
    interval is among the paths ``dispersed`` counts with the fixed maximum `_MANY_INTERVALS`; one
    whose delay is among them counts as delayed."""
    count = 0
    for signal in scene.signal:
        if signal.sample is not None:
            changes = 2 if signal.delay > 0.0 or f"signal.{signal.name}.delay" in dispersed else 1
            varies = f"signal.{signal.name}.sample" in dispersed
            most = _MANY_INTERVALS if varies else math.ceil(scene.run.end_time / signal.sample)
            count += changes * (most + 1)
    return count


def _make_segments(
    layout: ParameterLayout, dispersed: frozenset[str], releases: list[Release], variant: Variant
) -> list[Segment]:
    """Segments of a case in order of time, each with what ends it: one for each phase, preceded by
    one for delayed releases where needed. Other events are added by the caller. ``dispersed`` are
    the paths of dispersed parameters."""
    scene, segments, any_order = layout.scene, list[Segment](), variant <= Variant.ANY_ORDER
    for number, phase in enumerate(scene.phase):
        joint_kinds = {
            name: _possible_kinds(scene, name, number, dispersed, any_order) for name in scene.joint
        }
        segment = _make_segment(
            scene, phase.name, phase.name, joint_kinds, layout.bodies, releases, variant
        )
        if phase.until is not None and _has_several_conditions(scene, phase.until):
            _add_clauses(segment, number, layout, dispersed)
        else:
            _add_end(segment, phase, layout, dispersed)
        if number and not any_order:
            _add_late(segments, segment, number, layout, dispersed, releases)
        segments.append(segment)
    return segments


def _may_fail(scene: Scene, joint: str, dispersed: frozenset[str]) -> bool:
    """True if a joint fails to release in the nominal case, or may in another: the path of its
    ``fails`` is among the paths ``dispersed``."""
    return scene.joint[joint].fails > 0.0 or f"joint.{joint}.fails" in dispersed


def _kinds_of(scene: Scene, joint: str) -> list[tuple[int, ...]]:
    """Kinds that a joint has in any phase or after a release, each as the codes of its constraint
    rows, each once. The index in the list is the number of the kind; kinds with more rows come
    first, since a joint only loses rows."""
    kinds = [phase.joints.get(joint, "free") for phase in scene.phase]
    kinds += [release.to for release in scene.release if release.joint == joint]
    codes = dict.fromkeys(tuple(rows_of(scene.joint[joint], kind)) for kind in kinds)
    return sorted(codes, key=len, reverse=True)


def _kind_number(scene: Scene, joint: str, kind: str) -> int:
    """Number of a kind of a joint (index in `_kinds_of`: a higher one has no more rows), given its
    name, such as "slider". Raises ValueError if the joint never has that kind."""
    return _kinds_of(scene, joint).index(tuple(rows_of(scene.joint[joint], kind)))


def _kind_in_phase(scene: Scene, joint: str, phase: int) -> int:
    """Number of the kind (index in `_kinds_of`) that a joint has in phase number ``phase``."""
    return _kind_number(scene, joint, scene.phase[phase].joints.get(joint, "free"))


def _changes(scene: Scene) -> list[Change]:
    """Changes of all joints to kinds with fewer rows: first those at ends of phases, then those by
    releases."""
    changes = []
    for (number, phase), joint in itertools.product(enumerate(scene.phase[:-1]), scene.joint):
        to = _kind_in_phase(scene, joint, number + 1)
        if to > _kind_in_phase(scene, joint, number):
            changes.append(Change(joint, phase.name, to))
    return changes + [
        Change(r.joint, r.name, _kind_number(scene, r.joint, r.to), r.optional)
        for r in scene.release
    ]


def _possible_kinds(
    scene: Scene, joint: str, phase: int, dispersed: frozenset[str], any_order: bool
) -> Kinds:
    """Kinds that a joint may have in phase number ``phase``, as row codes by the number of the
    kind: the kind of the phase, those with fewer rows to which releases change it and, with
    ``any_order``, those of earlier phases if its release may be delayed or fail, nominally or
    because its ``delay`` or ``fails`` is in ``dispersed``."""
    numbers_of_phases = [_kind_in_phase(scene, joint, phase)]
    if any_order and (_may_be_late(scene, joint, dispersed) or _may_fail(scene, joint, dispersed)):
        numbers_of_phases = [_kind_in_phase(scene, joint, number) for number in range(phase + 1)]
    released = [
        _kind_number(scene, joint, release.to)
        for release in scene.release
        if release.joint == joint
    ]
    numbers = sorted(
        {*numbers_of_phases, *(number for number in released if number > numbers_of_phases[0])}
    )
    chain = _kinds_of(scene, joint)
    return {number: chain[number] for number in numbers}


def _add_late(
    segments: list[Segment],
    segment: Segment,
    number: int,
    layout: ParameterLayout,
    dispersed: frozenset[str],
    releases: list[Release],
) -> None:
    """Prepare the segments for joints whose release at the start of phase ``number`` is delayed.
    ``segment`` is that of the phase, and is marked (`Segment.after_late`); ``segments`` are those
    before it. A release is delayed if its ``delay`` is above 0 or in ``dispersed``; without one,
    change nothing.

    If the last of ``segments`` ends at a time and only one joint changes, the delay is added to
    that time. Otherwise a segment is appended to ``segments`` in which the delayed joints keep
    their kinds and all others have those of phase ``number``.

    The end condition of phase ``number`` is evaluated meanwhile (`Segment.pending_event`); cases in
    which it may have been met are rejected (`Variant`): another kernel integrates them.
    """
    scene, phase = layout.scene, layout.scene.phase[number]
    changed = [
        joint
        for joint in scene.joint
        if _kind_in_phase(scene, joint, number) != _kind_in_phase(scene, joint, number - 1)
    ]
    late = {
        joint: layout.slots[f"joint.{joint}.delay"]
        for joint in changed
        if _may_be_late(scene, joint, dispersed)
    }
    if not late:
        return
    segment.after_late, awaited = (
        True,
        next((event for event in segment.events if event.ends_phase), None),
    )
    if len(changed) == 1 and segments[-1].end_time:
        segments[-1].delay, segments[-1].pending_event = late[changed[0]], awaited
        return
    joint_kinds = dict(segment.joint_kinds)
    for joint in late:
        previous = _possible_kinds(scene, joint, number - 1, dispersed, False)
        joint_kinds[joint] = previous | segment.joint_kinds[joint] if len(late) > 1 else previous
    between = _make_segment(
        scene,
        f"{phase.name}_late",
        phase.name,
        joint_kinds,
        layout.bodies,
        releases,
        Variant.STANDARD,
    )
    between.late, between.pending_event = late, awaited
    if _has_equal_rows(segments[-1], between):
        segments[-1].alias_of = between.name
    segments.append(between)


def _has_equal_rows(segment: Segment, late: Segment) -> bool:
    """True if no joint changes in a segment, it has the same rigid groups and constraint rows as
    the next one, ``late``, has until its delayed releases, and neither has redundant rows."""
    return not (
        segment.variable_joints or segment.dropped or segment.redundant or late.redundant
    ) and (
        (segment.groups, segment.full, [(row.joint, row.code) for row in segment.rows])
        == (late.groups, late.full, [(row.joint, row.code) for row in late.rows])
    )


def _add_end(
    segment: Segment, phase: Phase, layout: ParameterLayout, dispersed: frozenset[str]
) -> None:
    """Set in ``segment`` what ends its phase, for a phase that needs no clauses (`_add_clauses`): a
    time, a burn-out, or one condition on the state or on a joint load. A phase without a condition
    ends with the run. ``dispersed`` has the paths of the dispersed parameters (it decides only
    which springs have an end of stroke)."""
    until, path = phase.until, f"phase.{phase.name}.until"
    leaves = {leaf.path: (leaf, slot) for leaf, slot in _thresholds(layout, dispersed)}
    if until is None:
        return
    if until.time is not None:
        segment.end_time = (leaves[f"{path}.time"][1],)
    elif until.burn_out is not None:
        segment.end_time = _burn_out(layout, until.burn_out).slots
    else:
        key = next(key for key in (*_ON_LOAD, *_ON_STATE) if getattr(until, key) is not None)
        leaf, slot = leaves[f"{path}.{key}"]
        event = Event(leaf.quantity, leaf.item, slot, True, direction=leaf.direction)
        (segment.loads if key in _ON_LOAD else segment.events).append(event)


def _burn_out(layout: ParameterLayout, name: str) -> Due:
    """Time of the burn-out of motor ``name``, as a condition: its burn duration since ignition if
    it waits for a trigger, else ignition time, delay and burn duration since the start."""
    motor = next(one for one in layout.scene.motor if one.name == name)
    keys = ("burn",) if motor.trigger is not None else ("ignition", "delay", "burn")
    slots = tuple(layout.slots[f"motor.{name}.{key}"] for key in keys)
    return Due(slots, name if motor.trigger is not None else "")


def _add_clauses(
    segment: Segment, number: int, layout: ParameterLayout, dispersed: frozenset[str]
) -> None:
    """Set in ``segment`` the clauses that end phase ``number``, and their conditions.
    ``dispersed`` has the paths of the dispersed parameters (it decides only which springs have an
    end of stroke)."""
    segment.clauses, segment.times, segment.springs, events, loads = _clauses(
        number, layout, dispersed
    )
    segment.events += events
    segment.loads += loads


def _clauses(
    number: int, layout: ParameterLayout, dispersed: frozenset[str]
) -> tuple[list[tuple[int, ...]], dict[int, Due], dict[int, str], list[Event], list[Event]]:
    """Return the clauses of event ``number`` (as numbered in `Conditions`), each a tuple of
    condition numbers (indices of ``leaves`` there). The event occurs when all conditions of at
    least one clause are met.

    Returned after the clauses are their conditions by type: times by condition number, springs
    whose end of stroke is a condition by its number, conditions on the state, conditions on joint
    loads. ``dispersed`` has the paths of the dispersed parameters (it decides only which springs
    have an end of stroke).
    """
    conditions, first = (
        make_conditions(layout.scene, dispersed),
        int(layout.model.scene[0].leaves_p),
    )
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
        if leaf.quantity == at.AT_TIME:
            times[k] = Due((first + k,))
        elif leaf.quantity == at.AT_BURN_OUT:
            times[k] = _burn_out(layout, leaf.item)
        elif leaf.quantity == at.AT_SPRING_STROKE:
            springs[k] = leaf.item
        else:
            any_phase = number >= len(layout.scene.phase)
            event = Event(leaf.quantity, leaf.item, first + k, False, k, any_phase, leaf.direction)
            (on_load if leaf.quantity in _ON_LOAD.values() else on_state).append(event)
    return clauses, times, springs, on_state, on_load


def _releases(layout: ParameterLayout, dispersed: frozenset[str]) -> list[Release]:
    """Releases with conditions of their own (``release`` in the file), then the observation events
    of a scene, which are releases without a joint. ``dispersed`` has the paths of the
    dispersed parameters (it decides only which springs have an end of stroke)."""
    names = [(r.name, r.joint) for r in layout.scene.release]
    names += [(event.name, "") for event in layout.scene.event]
    return [
        Release(name, joint, *_clauses(number, layout, dispersed))
        for number, (name, joint) in enumerate(names, len(layout.scene.phase))
    ]


def _thresholds(layout: ParameterLayout, dispersed: frozenset[str]) -> Iterator[tuple[Leaf, int]]:
    """Yield each leaf of the conditions of a scene that has a threshold, and the index of the
    threshold in the parameter vector. A burn-out and the end of a spring's stroke have none.
    ``dispersed`` has the paths of the dispersed parameters (it decides only which springs have an
    end of stroke)."""
    first = int(layout.model.scene[0].leaves_p)
    for number, leaf in enumerate(make_conditions(layout.scene, dispersed).leaves):
        if leaf.path is not None:
            yield leaf, first + number


def _is_fixed(scene: Scene, segment: Segment, bodies: tuple[str, str]) -> bool:
    """True if the two bodies cannot move relative to each other in a segment: they are in one rigid
    group, and one joint between them has three rows that are always active."""
    joints = [
        row.joint
        for row in segment.rows
        if set(scene.joint[row.joint].bodies) == set(bodies) and not row.kinds
    ]
    return segment.leader(bodies[0]) == segment.leader(bodies[1]) and any(
        joints.count(joint) == 3 for joint in joints
    )


def brief_transient(scene: Scene) -> float:
    """Time constant of a motor's build-up or tail-off below which an interval of integration ends
    with that transient.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        s; a fraction of the end time of the run. Each interval takes the number of steps that is
        chosen for the phase, so a brief transient, as an interval of its own, takes that many.
    """
    return at.BRIEF / at.TRANSIENT * scene.run.end_time


def _count_switches(scene: Scene, dispersed: frozenset[str]) -> int:
    """Maximum number of instants within a case at which a motor or constant load switches on or
    off, a thrust profile has a row, or a brief build-up or tail-off is over. A time whose path is
    in ``dispersed`` counts whatever its nominal value."""
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
        # only a brief transient is an interval of its own; some case may have one
        for key in ("build_up", "tail_off"):
            count += (
                0.0 < getattr(motor, key) < brief_transient(scene) or f"{path}.{key}" in dispersed
            )
    for load in scene.load:
        path = f"load.{load.name}"
        count += load.start > 0.0 or f"{path}.start" in dispersed
        count += math.isfinite(load.end) or f"{path}.end" in dispersed
    return int(count)


def _make_segment(
    scene: Scene,
    name: str,
    phase: str,
    joint_kinds: dict[str, Kinds],
    bodies: list[str],
    releases: list[Release],
    variant: Variant,
) -> Segment:
    """Build the segment called ``name`` of a phase, in which joints may have the ``joint_kinds``:
    its rigid groups of the moving ``bodies``, constraint rows, and those of the ``releases`` that
    may occur in it. What ends it is set by the caller.

    A rigid group are bodies that rotate together, but may slide on each other: the joints between
    them (`Segment.welds`) have all three rotation rows in each kind that they may have. Rotation
    rows within a group are left out, since its bodies share one attitude; so are redundant rows
    (`Segment.dropped`), unless a joint may change its kind within the segment. In the full
    formulation without redundant rows, in the variant LEAST_SQUARES, and in ANY_ORDER with
    redundant rows, every body is a group of its own and all rows stay.
    """
    numbers = {r.name: _kind_number(scene, r.joint, r.to) for r in scene.release}
    lighting = {motor.trigger.release for motor in scene.motor if motor.trigger is not None}
    releases_in = [
        r
        for r in releases
        if not r.joint or r.name in lighting or numbers[r.name] > min(joint_kinds[r.joint])
    ]
    segment = Segment(name, phase, joint_kinds, releases=releases_in)
    ground = [GROUND] if is_ground_named(scene) else []
    alone: list[tuple[str, ...]] = [(body,) for body in [*bodies, *ground]]
    largest = [
        (row.joint, row.code)
        for row in segment.all_rows
        if min(joint_kinds[row.joint]) in (row.kinds or joint_kinds[row.joint])
    ]
    segment.redundant = len(dependent_rows(scene, largest, []))
    segment.groups = alone
    segment.least_squares = bool(segment.all_rows) and (
        variant == Variant.LEAST_SQUARES or (variant == Variant.ANY_ORDER and segment.redundant > 0)
    )
    segment.full = (
        scene.solver.formulation == "full"
        and bool(segment.all_rows)
        and not (segment.redundant or segment.least_squares)
    )
    if segment.least_squares or segment.full:
        segment.rows = segment.all_rows
        return segment
    segment.welds = [
        joint
        for joint, kinds in joint_kinds.items()
        if all(_count_rotations(codes) == 3 for codes in kinds.values())
    ]
    segment.groups = _groups(scene, segment.welds, [*bodies, GROUND])
    rows = [
        row
        for row in segment.all_rows
        if not (row.turns and len({segment.leader(b) for b in scene.joint[row.joint].bodies}) == 1)
    ]
    codes_of_rows = [(row.joint, row.code) for row in rows]
    # the rows of a joint that changes its kind are not all active at once
    redundant = segment.redundant > 0 and not segment.variable_joints
    dependent = (
        dependent_rows(
            scene, codes_of_rows, [group for group in segment.groups if group != (GROUND,)]
        )
        if redundant
        else []
    )
    segment.groups = [group for group in segment.groups if group != (GROUND,) or ground]
    segment.rows = [row for number, row in enumerate(rows) if number not in dependent]
    segment.dropped = [rows[number] for number in dependent]
    return segment


def _groups(scene: Scene, welds: list[str], order: list[str]) -> list[tuple[str, ...]]:
    """Rigid groups of the bodies in ``order``: those connected by joints without relative rotation
    (``welds``), and single bodies. Bodies of a group are in the given order, the ground first."""
    group: dict[str, tuple[str, ...]] = {body: (body,) for body in order}
    for joint in welds:
        first, second = scene.joint[joint].bodies
        merged = tuple(sorted({*group[first], *group[second]}, key=order.index))
        merged = (GROUND, *(b for b in merged if b != GROUND)) if GROUND in merged else merged
        for body in merged:
            group[body] = merged
    return list(dict.fromkeys(group.values()))


def _count_rotations(codes: tuple[int, ...]) -> int:
    """Number of rotation rows among the row codes of a joint."""
    return sum(at.ROTATION <= code < at.ROD for code in codes)
