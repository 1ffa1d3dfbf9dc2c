"""When the conditions on a state will be met, foretold, and noting that they are."""

import math
from typing import Any

from sepmc.kernel.emit.context import Context, component, height, reject_if, spent
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.loads import add_all
from sepmc.kernel.emit.steps import hold_back
from sepmc.kernel.spec.kernel_spec import Event, Segment
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, scalar, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, called, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND

_MET = -1e-12  # what counts as zero of a condition's value
# of a threshold, or of one: a quantity this close stands at it. Its rate (and acceleration) tell
# where it goes from there if they take it further within a millisecond: smaller ones are round-off
_TOUCH, _PER_RATE, _PER_ACCELERATION = 1e-12, 1e3, 1e6


def emit_event_step(out: Text, c: Context, segment: Segment) -> None:
    """A function that finds the time to a phase's next event."""
    says = (
        "Time to the next event, into STEP, foretold from values, rates and accelerations (in "
        "K1) of the conditions and from how fast"
    )
    text = out.function(
        f"event_step_{segment.name}(w, usual: float)", says + " these change; at most to END."
    )
    s = State(c, c.scope(), segment, "Y")
    ahead = s.scope.load("END") - s.time
    for event in segment.events:
        wait = _wait(s, event)
        ahead = where(wait < ahead, wait, ahead)
    s.scope.store("STEP", ahead)
    s.scope.write(text)


def _wait(s: State, event: Event) -> Any:
    """Time to an event."""
    if event.direction:
        return _wait_to_cross(s, event)
    scope, name = s.scope, f"{s.segment.name}_{event.name}"
    for field, count in (("VALUE", 1), ("RATE", 1), ("PREVIOUS", 2), ("MET_AT_START", 1)):
        s.c.workspace.add(f"{field}_{name}", count)
    scope.comment(f"{event.item}")
    value, rate, acceleration = (  # rates are numbers, zero, of bodies that are held to the ground
        called(x, name)
        for x, name in zip(_condition(s, event), ("value", "rate", "acceleration"), strict=True)
    )
    time, usual = s.time, scope.named("usual")
    earlier, before = scope.load(f"PREVIOUS_{name}"), scope.load(component(f"PREVIOUS_{name}", 1))
    first = earlier.equals(math.inf)
    jerk = where(time > earlier, (acceleration - before) / (time - earlier), 0.0)
    at_once = where(
        first, where(value >= _MET, 1.0, 0.0), scope.load(f"MET_AT_START_{name}")
    ).called("at_once")
    _note_graze(scope, event, s.segment.name, value, rate)
    noted = (
        (f"VALUE_{name}", value),
        (f"RATE_{name}", rate),
        (f"PREVIOUS_{name}", time),
        (f"MET_AT_START_{name}", at_once),
    )
    for place, now in (*noted, (component(f"PREVIOUS_{name}", 1), acceleration)):
        scope.store(
            place,
            where(scope.load("INACTIVE") > 0.0, scope.load(place), now)
            if s.c.has_lane_steps(s.segment)
            else now,
        )
    # 0: met before it was waited for
    wait = where(at_once > 0.0, 0.0, scalar.time_left(value, rate, acceleration, jerk)).called(
        "wait"
    )
    if event.ends_phase or event.number >= 0:
        wait = where(first & (wait > usual), usual, wait)
    return (
        wait
        if event.ends_phase or event.is_border
        else where(scope.load(event.flag(s.segment.name)) > 0.0, math.inf, wait)
    )


def _wait_to_cross(s: State, event: Event) -> Any:
    """Time to an event whose quantity must cross its threshold, from the side on which it is, or
    goes to from where it stands at it, as a stretch begins.

    On the side from which a crossing does not count, another one is waited for, to the other side:
    that is noted at the end of a step.
    """
    scope, name = s.scope, f"{s.segment.name}_{event.name}"
    for field, count in (
        ("VALUE", 1),
        ("RATE", 1),
        ("PREVIOUS", 2),
        ("SIDE", 1),
        ("STARTED_AT_THRESHOLD", 1),
    ):
        s.c.workspace.add(f"{field}_{name}", count)
    scope.comment(f"{event.item}, {event.direction}")
    time, usual = s.time, scope.named("usual")
    earlier, before = scope.load(f"PREVIOUS_{name}"), scope.load(component(f"PREVIOUS_{name}", 1))
    first = earlier.equals(math.inf)
    excess, rate, acceleration = (
        called(x, name)
        for x, name in zip(_condition(s, event), ("excess", "rate", "acceleration"), strict=True)
    )
    since = where(time > earlier, time - earlier, math.inf)
    if event.quantity == at.AT_VERTICAL_SPEED:  # how its rate changes is not known from the state
        acceleration = ((rate - scope.load(f"RATE_{name}")) / since).called("acceleration")
    jerk = (acceleration - before) / since
    touch = _touch(s.c, event)
    stands = scalar.abs(excess) <= touch
    goes = where(scalar.abs(acceleration) > _PER_ACCELERATION * touch, acceleration, 0.0)
    goes = where(scalar.abs(rate) > _PER_RATE * touch, rate, goes)
    goes = where(stands, goes, excess).called("goes")
    was = scope.load(f"SIDE_{name}")
    again = first | was.equals(0.0)
    if event.direction != "either":
        again = again | (_counts(event, -was) & (was * excess > touch))
    side = where(again, where(goes < 0.0, 1.0, where(goes > 0.0, -1.0, 0.0)), was).called("side")
    value, slope = side * excess, side * rate
    _note_graze(scope, event, s.segment.name, value, slope, side)
    stood = scope.load(f"STARTED_AT_THRESHOLD_{name}")
    noted = (
        (f"VALUE_{name}", excess),
        (f"RATE_{name}", rate),
        (f"PREVIOUS_{name}", time),
        (component(f"PREVIOUS_{name}", 1), acceleration),
        (f"SIDE_{name}", side),
        (f"STARTED_AT_THRESHOLD_{name}", where(first, where(stands, time, -math.inf), stood)),
    )
    for place, now in noted:
        held = scope.load("INACTIVE") > 0.0 if s.c.has_lane_steps(s.segment) else None
        scope.store(place, now if held is None else where(held, scope.load(place), now))
    wait = scalar.time_left(value, slope, side * acceleration, side * jerk).called("wait")
    wait = where(_counts(event, side), where(first & stands, math.inf, wait), math.inf)
    wait = where(first & (wait > usual), usual, wait)
    met = scope.load(event.flag(s.segment.name))
    return wait if event.ends_phase else where(met > 0.0, math.inf, wait)


def _touch(c: Context, event: Event) -> Expr:
    """How far from its threshold a quantity still stands at it."""
    return _TOUCH * scalar.larger(1.0, scalar.abs(c.case.number(event.threshold)))


def _counts(event: Event, side: Expr) -> Expr:
    """Whether a crossing counts from a side: 1 below the threshold, -1 above, 0 neither."""
    if event.direction == "either":
        return side * side > 0.0
    return side > 0.0 if event.direction == "rising" else side < 0.0


def _note_graze(
    scope: Scope, event: Event, segment: str, value: Expr, rate: Any, side: Any = 1.0
) -> None:
    """A condition may be met and left again within a step: then the case is on its own. What was
    noted of it counts from a ``side``."""
    name = f"{segment}_{event.name}"
    earlier, past, slope = (
        scope.load(f"PREVIOUS_{name}"),
        scope.load(f"VALUE_{name}") * side,
        scope.load(f"RATE_{name}") * side,
    )
    grazes = (
        _may_rise(past, slope, value, rate, scope.load("T") - earlier)
        & (earlier < math.inf)
        & (past < 0.0)
    )
    if not event.is_border:
        grazes = grazes & scope.load(event.flag(segment)).equals(0.0)
    scope.store("UNEVEN", where(grazes, 1.0, scope.load("UNEVEN")))


def _may_rise(past: Expr, slope: Expr, value: Expr, rate: Any, length: Expr) -> Any:
    """Whether a value may be zero or more between two times: it rises at the first, falls at the
    second, and its tangents there cross beyond zero."""
    turns = (slope > 0.0) & (rate < 0.0)
    return turns & (
        past + slope * (value - past - rate * length) / where(turns, slope - rate, 1.0) >= 0.0
    )


def emit_pending_event(out: Text, c: Context, segment: Segment) -> None:
    """A function by which a case is lost if the condition that ends the next phase may be met while
    joints are late."""
    event = segment.pending_event
    assert event is not None
    says = (
        "Note the condition that ends the next phase; a case is lost if it may have been met "
        "while joints were late, since the last note"
    )
    text = out.function(
        f"pending_event_{segment.name}(w, first: float)", says + " unless it is the ``first``."
    )
    name = f"PENDING_{segment.name}"
    c.workspace.add(name, 3)
    s = State(c, c.scope(), segment, "Y")
    scope, time = s.scope, s.time
    value, rate, _ = _condition(s, event)
    past, slope, earlier = (scope.load(component(name, k)) for k in range(3))
    length = time - earlier
    met = (value >= _MET) | _may_rise(past, slope, value, rate, length)
    if event.direction:  # from below or from above
        met = (
            (value * past <= 0.0)
            | _may_rise(past, slope, value, rate, length)
            | _may_rise(-past, -slope, -value, -rate, length)
        )
    late = time >= scope.load(f"UNTIL_{segment.name}") - (
        s.case.number(segment.delay) if segment.delay is not None else math.inf
    )
    counts = scope.named("first").equals(0.0) & late & met
    reject_if(scope, counts, Variant.ANY_ORDER)
    for k, now in enumerate((value, rate, time)):
        scope.store(component(name, k), now)
    scope.write(text)


def _condition(s: State, event: Event) -> tuple[Any, Any, Any]:
    """Value, rate and acceleration of a condition: below zero before the event or, if it has a
    direction, below the threshold."""
    if event.is_border:
        return _border(s, event)
    scene, threshold = s.spec.scene, s.case.number(event.threshold)
    if event.quantity == at.AT_SPRING_STROKE:
        spring = next(one for one in scene.spring if one.name == event.item)
        line = s.spring(spring)
        value, rate = line.length - s.spring_start(spring) - threshold, line.rate
        return value, rate, s.lengthening_by("K1", spring.bodies, line)
    if event.quantity in (at.AT_ALTITUDE, at.AT_VERTICAL_SPEED):
        acceleration = s.scope.load(f"K1 + V_{event.item}", 3)[1]
        excess, rate = _climb(s, event.item, threshold)
        return (
            (excess, rate, acceleration)
            if event.quantity == at.AT_ALTITUDE
            else (_climb_rate(s, event.item) - threshold, acceleration, 0.0)
        )
    bodies = scene.joint[event.item].bodies
    if event.quantity == at.AT_ANGLE:
        return _angle(s, event.item, threshold)
    if event.quantity == at.AT_DISTANCE:
        line = s.rod(s.joint(event.item))
        together = line.length > 0.0  # a direction there is not where the points are one
        acceleration = s.lengthening_by("K1", bodies, line)
        return (
            line.length - threshold,
            where(together, line.rate, 0.0),
            where(together, acceleration, 0.0),
        )
    line = s.separation(event.item)  # its distance counts positive apart
    return (
        line.length - threshold,
        line.rate,
        s.case.separation_sign(event.item) * s.lengthening_by("K1", bodies, line),
    )


def _border(s: State, event: Event) -> tuple[Any, Any, Any]:
    """How far a body is above the top of its layer of air, or below its base."""
    up = event.quantity == at.AT_LAYER_TOP
    value, rate = _climb(s, event.item, s.scope.load(component(f"BORDERS_{event.item}", int(up))))
    acceleration = s.scope.load(f"K1 + V_{event.item}", 3)[1]
    return (value, rate, acceleration) if up else (-value, -rate, -acceleration)


def _climb(s: State, body: str, threshold: Expr) -> tuple[Any, Any]:
    """Height of a body above a threshold, and its rate."""
    return height(s.scope, body) - threshold, _climb_rate(s, body)


def _climb_rate(s: State, body: str) -> Any:
    """Vertical speed of a body."""
    return s.speed(body)[1] + s.scope.load("ORIGIN_CLIMB")


def _angle(s: State, joint: str, threshold: Expr) -> tuple[Any, Any, Any]:
    """The angle by which the second body of a joint has turned from the first; at 0 its axis is
    that of the motion to come."""
    first, second = s.spec.scene.joint[joint].bodies
    if s.segment.leader(first) == s.segment.leader(second) == GROUND:
        return -threshold, 0.0, 0.0
    spin_a, spin_b = s.spin(first), s.spin(second)
    change = vec3.sub(spin_b, spin_a).called("relative_rate")
    faster = vec3.sub(_spin_rate(s, second), _spin_rate(s, first)).called("relative_acceleration")
    square: Any = 0.0
    turns, turning = [], []
    for k in range(3):
        a, b = s.axis(joint, k), s.axis(joint, k, second=True)
        between = vec3.sub(b, a)
        square = square + vec3.dot(between, between)
        turns.append(vec3.cross(a, b))
        turning.append(
            vec3.add(vec3.cross(vec3.cross(spin_a, a), b), vec3.cross(a, vec3.cross(spin_b, b)))
        )
    half = (0.125 * square).called("half")  # the square of the sine of half of it
    angle = 2.0 * scalar.arctan2(square_root(half), square_root(where(half < 1.0, 1.0 - half, 0.0)))
    turn, turn_rate = add_all(turns).called("turn"), add_all(turning)
    size = square_root(vec3.dot(turn, turn)).called("size")
    apart = size > 0.0
    inverse = 1.0 / where(apart, size, 1.0)
    n = vec3.scale(inverse, turn).called("n")
    n_rate = vec3.scale(inverse, vec3.sub(turn_rate, vec3.scale(vec3.dot(n, turn_rate), n)))
    rate = where(apart, vec3.dot(n, change), square_root(vec3.dot(change, change)))
    acceleration = where(
        apart, vec3.dot(n, faster) + vec3.dot(n_rate, change), square_root(vec3.dot(faster, faster))
    )
    return angle - threshold, rate, acceleration


def _spin_rate(s: State, body: str) -> Any:
    """Angular acceleration of a body in ground axes, from the derivative K1."""
    leader = s.segment.leader(body)
    return (
        ZERO
        if leader == GROUND
        else vec3.rotate(s.attitude(leader), s.scope.load(f"K1 + OMEGA_{leader}", 3))
    )


def emit_event_flags(out: Text, c: Context) -> None:
    """A function that notes which conditions are met."""
    text = out.function(
        "set_event_flags(w, phase: int)",
        "After the last step to an event: which conditions of the phase are met.",
    )
    for number, segment in enumerate(c.spec.segments):
        if segment.events:
            inner = text.block(f"if phase == {number}:")
            hold_back(inner, c, segment, "True")
            inner(f"event_step_{segment.name}(w, math.inf)")
            scope = c.scope()
            for event in segment.events:
                _note_met(scope, c, segment, event)
            scope.write(inner)
    if c.spec.layer_borders:
        text("enter_layers(w)", "recentre_air(w, 0.5 * NEAR)")


def _note_met(scope: Scope, c: Context, segment: Segment, event: Event) -> None:
    """Whether a condition is met, and how slowly: an error of its value is so much of an error of
    its time."""
    name, flag = f"{segment.name}_{event.name}", event.flag(segment.name)
    if event.direction:
        _note_crossed(scope, c, segment, event)
        return
    if not event.ends_phase and event.number < 0:
        c.start(flag, 1.0 if event.is_border else 0.0)  # at the start every body enters a layer
    met, before, rate = (
        scope.load(f"VALUE_{name}") >= _MET,
        scope.load(flag),
        scope.load(f"RATE_{name}"),
    )
    slow = where(rate > 0.0, 1.0 / rate, math.inf)
    waited_for = met & before.equals(0.0) & scope.load(f"MET_AT_START_{name}").equals(0.0)
    indicator = c.indicator(name)
    scope.store(indicator, scalar.larger(scope.load(indicator), where(waited_for, slow, 0.0)))
    scope.store(flag, where(met, 1.0, before))
    if event.quantity == at.AT_SPRING_STROKE and c.change_times:
        place = spent(event.item)
        c.start(place, math.nan)
        scope.store(place, where(met & before.equals(0.0), scope.load("T"), scope.load(place)))


def _note_crossed(scope: Scope, c: Context, segment: Segment, event: Event) -> None:
    """Whether a quantity has crossed its threshold in the direction that counts: not by standing at
    it as the stretch began."""
    name, flag = f"{segment.name}_{event.name}", event.flag(segment.name)
    side, before = scope.load(f"SIDE_{name}"), scope.load(flag)
    met = (
        (side * scope.load(f"VALUE_{name}") >= -_touch(c, event))
        & _counts(event, side)
        & (scope.load("T") > scope.load(f"STARTED_AT_THRESHOLD_{name}") + at.GRAIN)
    )
    rate = side * scope.load(f"RATE_{name}")
    slow = where(rate > 0.0, 1.0 / rate, math.inf)
    indicator = c.indicator(name)
    waited_for = met & before.equals(0.0)
    scope.store(indicator, scalar.larger(scope.load(indicator), where(waited_for, slow, 0.0)))
    scope.store(flag, where(met, 1.0, before))
