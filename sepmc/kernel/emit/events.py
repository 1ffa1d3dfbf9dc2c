"""Emitter of event location: the instants at which conditions on the state are met.

The step to the next event of a segment is predicted from value, rate, acceleration and jerk of each
condition (`emit_event_step`); the remaining microseconds are one RK4 step
(`sepmc.kernel.emit.steps.emit_event_polish`). Then the flags of the conditions that are met are set
(`emit_event_flags`). A case is marked (field UNEVEN) if a condition may have been met and left
again within a step, and left to the kernel variant ANY_ORDER if one may have been met during a
release delay (`emit_pending_event`).
"""

import math
from typing import Any

from sepmc.kernel.emit.cells import BESIDE, call_table_rates, cell_end
from sepmc.kernel.emit.context import Context, component, height, reject_if, stroke_end_time
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.kinks import set_mode, time_to_kink
from sepmc.kernel.emit.loads import vector_sum
from sepmc.kernel.emit.steps import mark_inactive
from sepmc.kernel.spec.kernel_spec import Event, Segment
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, scalar, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, called, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND

_MET = -1e-12  # a condition is met from this value on
# A quantity is at its threshold if it is closer than this fraction of the threshold (or of 1). The
# sign of its rate or acceleration then gives the direction if, by it, the quantity moves further
# than that within a millisecond; smaller ones are round-off.
_AT_THRESHOLD, _PER_RATE, _PER_ACCELERATION = 1e-12, 1e3, 1e6


def emit_event_step(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``event_step_SEGMENT(w, typical)``, which stores the predicted time
    to the next event of a segment, at most to END, into STEP. At the start of an interval, an event
    that ends the phase or belongs to a clause is predicted no later than after the typical duration
    of the segment, ``typical``, s.

    Each condition is a scalar g(t) of the state, below zero before the event. Its Taylor polynomial
    to third order gives the time to the event (`sepmc.routines.lanes.time_left`); the jerk is the
    difference quotient of accelerations at the last two steps.
    """
    docstring = (
        "Predict the step to the next event, at most to END, into STEP: from value, rate, "
        "acceleration (of the derivative K1) and jerk"
    )
    text = out.function(
        f"event_step_{segment.name}(w, typical: float)", docstring + " of each condition."
    )
    call_table_rates(text, c, segment)
    s = State(c, c.scope(), segment, "Y")
    step = s.scope.load("END") - s.time
    for event in segment.events:
        time_to_event = _time_to_event(s, event)
        step = where(time_to_event < step, time_to_event, step)
    s.scope.store("STEP", step)
    s.scope.write(text)


def _time_to_event(s: State, event: Event) -> Any:
    """Expression of the predicted time from the state to an event, s (0 if its condition was met at
    the start of the interval, infinite if none is in sight or, unless it ends the phase or is the
    border of a layer, it has occurred); add to the scope lines that store value and rate of its
    condition for later steps."""
    if event.direction:
        return _time_to_crossing(s, event)
    if event.quantity == at.AT_KINK:
        return _time_to_kink(s, event)
    scope, name = s.scope, f"{s.segment.name}_{event.name}"
    for field, count in (("VALUE", 1), ("RATE", 1), ("PREVIOUS", 2), ("MET_AT_START", 1)):
        s.c.workspace.add(f"{field}_{name}", count)
    scope.comment(f"{event.item}")
    value, rate, acceleration = (  # rates of bodies fixed to the ground are known zeros
        called(x, name)
        for x, name in zip(_condition(s, event), ("value", "rate", "acceleration"), strict=True)
    )
    time, typical = s.time, scope.named("typical")
    previous_time, previous_acceleration = (
        scope.load(f"PREVIOUS_{name}"),
        scope.load(component(f"PREVIOUS_{name}", 1)),
    )
    first = previous_time.equals(math.inf)
    if event.is_cell_end:  # its acceleration does not follow from the state
        elapsed = where(time > previous_time, time - previous_time, math.inf)
        later = (rate - scope.load(f"RATE_{name}")) / elapsed
        acceleration = where(first, acceleration, later).called("acceleration")
    jerk = where(
        time > previous_time, (acceleration - previous_acceleration) / (time - previous_time), 0.0
    )
    met_at_start = where(
        first, where(value >= _MET, 1.0, 0.0), scope.load(f"MET_AT_START_{name}")
    ).called("met_at_start")
    _flag_graze(scope, event, s.segment.name, value, rate)
    records = (
        (f"VALUE_{name}", value),
        (f"RATE_{name}", rate),
        (f"PREVIOUS_{name}", time),
        (f"MET_AT_START_{name}", met_at_start),
    )
    for path, value_now in (*records, (component(f"PREVIOUS_{name}", 1), acceleration)):
        scope.store(
            path,
            where(scope.load("INACTIVE") > 0.0, scope.load(path), value_now)
            if s.c.has_lane_steps(s.segment)
            else value_now,
        )
    # 0: the condition was met at the start of the interval
    time_left = where(
        met_at_start > 0.0, 0.0, scalar.time_left(value, rate, acceleration, jerk)
    ).called("remaining")
    if event.ends_phase or event.number >= 0:
        time_left = where(first & (time_left > typical), typical, time_left)
    return (
        time_left
        if event.ends_phase or event.is_border
        else where(scope.load(event.flag(s.segment.name)) > 0.0, math.inf, time_left)
    )


def _time_to_kink(s: State, event: Event) -> Any:
    """Expression of the predicted time from the state to the event that a switching function
    reaches zero, s (as `time_to_kink` returns it). Add to the scope lines that flag a case in which
    the function may have been above zero within the step (`_flag_graze`), and lines that store its
    value and rate for later steps, except in lanes that are INACTIVE."""
    time_left, records = time_to_kink(s, event)
    (_, value), (_, rate) = records[:2]
    _flag_graze(s.scope, event, s.segment.name, value, rate)
    inactive = s.scope.load("INACTIVE") > 0.0
    for path, value_now in records:
        s.scope.store(path, where(inactive, s.scope.load(path), value_now))
    return time_left


def _time_to_crossing(s: State, event: Event) -> Any:
    """Expression of the predicted time from the state, s, to an event with a direction: its
    quantity must cross the threshold from the side on which it is at the start of an interval (or
    to which it moves then, if it starts at the threshold).

    On the side from which a crossing does not count, the time is infinite until the quantity has
    returned to the other side, which is detected at the end of a step. Lines that store the
    quantity's excess over the threshold, its rate and side are added to the scope.
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
    time, typical = s.time, scope.named("typical")
    previous_time, previous_acceleration = (
        scope.load(f"PREVIOUS_{name}"),
        scope.load(component(f"PREVIOUS_{name}", 1)),
    )
    first = previous_time.equals(math.inf)
    excess, rate, acceleration = (
        called(x, name)
        for x, name in zip(_condition(s, event), ("excess", "rate", "acceleration"), strict=True)
    )
    elapsed = where(time > previous_time, time - previous_time, math.inf)
    if event.quantity == at.AT_VERTICAL_SPEED:  # its acceleration does not follow from the state
        acceleration = ((rate - scope.load(f"RATE_{name}")) / elapsed).called("acceleration")
    jerk = (acceleration - previous_acceleration) / elapsed
    tolerance = _tolerance(s.c, event)
    at_threshold = scalar.abs(excess) <= tolerance
    trend = where(scalar.abs(acceleration) > _PER_ACCELERATION * tolerance, acceleration, 0.0)
    trend = where(scalar.abs(rate) > _PER_RATE * tolerance, rate, trend)
    trend = where(at_threshold, trend, excess).called("trend")
    previous_side = scope.load(f"SIDE_{name}")
    restart = first | previous_side.equals(0.0)
    if event.direction != "either":
        restart = restart | (_counts(event, -previous_side) & (previous_side * excess > tolerance))
    side = where(
        restart, where(trend < 0.0, 1.0, where(trend > 0.0, -1.0, 0.0)), previous_side
    ).called("side")
    value, slope = side * excess, side * rate
    _flag_graze(scope, event, s.segment.name, value, slope, side)
    started_at_threshold = scope.load(f"STARTED_AT_THRESHOLD_{name}")
    records = (
        (f"VALUE_{name}", excess),
        (f"RATE_{name}", rate),
        (f"PREVIOUS_{name}", time),
        (component(f"PREVIOUS_{name}", 1), acceleration),
        (f"SIDE_{name}", side),
        (
            f"STARTED_AT_THRESHOLD_{name}",
            where(first, where(at_threshold, time, -math.inf), started_at_threshold),
        ),
    )
    for path, value_now in records:
        inactive = scope.load("INACTIVE") > 0.0 if s.c.has_lane_steps(s.segment) else None
        scope.store(
            path, value_now if inactive is None else where(inactive, scope.load(path), value_now)
        )
    time_left = scalar.time_left(value, slope, side * acceleration, side * jerk).called("remaining")
    time_left = where(
        _counts(event, side), where(first & at_threshold, math.inf, time_left), math.inf
    )
    time_left = where(first & (time_left > typical), typical, time_left)
    flag = scope.load(event.flag(s.segment.name))
    return time_left if event.ends_phase else where(flag > 0.0, math.inf, time_left)


def _tolerance(c: Context, event: Event) -> Expr:
    """Largest distance from the threshold of an event, in its SI unit, at which the quantity counts
    as at the threshold: `_AT_THRESHOLD` times the magnitude of the threshold, or times 1 if that
    is below 1."""
    return _AT_THRESHOLD * scalar.larger(1.0, scalar.abs(c.case.number(event.threshold)))


def _counts(event: Event, side: Expr) -> Expr:
    """Condition that a crossing of the threshold that begins on ``side`` is in a direction that
    counts for the event; ``side`` is 1 below the threshold, -1 above it, 0 if not known."""
    if event.direction == "either":
        return side * side > 0.0
    return side > 0.0 if event.direction == "rising" else side < 0.0


def _flag_graze(
    scope: Scope, event: Event, segment: str, value: Expr, rate: Any, side: Any = 1.0
) -> None:
    """Add lines to a scope that set UNEVEN (the case is simulated again at steps of its own) where
    a condition that was below zero at the previous step may have been met and left again since.
    Lanes in which the condition is already flagged as met are left out, but not for kinks and
    borders.

    ``value`` and ``rate`` are those of the condition now; the stored ones of the previous step are
    multiplied by ``side`` first. ``segment`` is the name of the segment.
    """
    name = f"{segment}_{event.name}"
    previous_time, previous, slope = (
        scope.load(f"PREVIOUS_{name}"),
        scope.load(f"VALUE_{name}") * side,
        scope.load(f"RATE_{name}") * side,
    )
    grazes = (
        _may_rise(previous, slope, value, rate, scope.load("T") - previous_time)
        & (previous_time < math.inf)
        & (previous < 0.0)
    )
    if not (event.is_border or event.quantity == at.AT_KINK):
        grazes = grazes & scope.load(event.flag(segment)).equals(0.0)
    scope.store("UNEVEN", where(grazes, 1.0, scope.load("UNEVEN")))


def _may_rise(previous: Expr, slope: Expr, value: Expr, rate: Any, length: Expr) -> Any:
    """Condition that a quantity may reach zero from below between two instants that are ``length``
    apart, s: it rises at the first (value ``previous``, rate ``slope``), falls at the second (value
    ``value``, rate ``rate``), and its tangents there intersect at or above zero. Whether both
    values are below zero is not asked."""
    turns = (slope > 0.0) & (rate < 0.0)
    return turns & (
        previous + slope * (value - previous - rate * length) / where(turns, slope - rate, 1.0)
        >= 0.0
    )


def emit_pending_event(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``pending_event_SEGMENT(w, first)``, which leaves a case to the
    kernel variant ANY_ORDER (rejects it) if the condition that ends the next phase may have been
    met since its last call, while a delayed release is pending; the call with ``first`` = 1.0 only
    stores values.

    Parameters
    ----------
    out : Text
    c : Context
    segment : Segment
        with a ``pending_event``
    """
    event = segment.pending_event
    assert event is not None
    docstring = (
        "Evaluate the condition that ends the next phase; reject cases in which it may have been "
        "met during a release delay, since the last call"
    )
    text = out.function(
        f"pending_event_{segment.name}(w, first: float)", docstring + " unless it is the ``first``."
    )
    name = f"PENDING_{segment.name}"
    c.workspace.add(name, 3)
    s = State(c, c.scope(), segment, "Y")
    scope, time = s.scope, s.time
    value, rate, _ = _condition(s, event)
    previous, slope, previous_time = (scope.load(component(name, k)) for k in range(3))
    length = time - previous_time
    met = (value >= _MET) | _may_rise(previous, slope, value, rate, length)
    if event.direction:  # crossed from below or from above
        met = (
            (value * previous <= 0.0)
            | _may_rise(previous, slope, value, rate, length)
            | _may_rise(-previous, -slope, -value, -rate, length)
        )
    delayed = time >= scope.load(f"UNTIL_{segment.name}") - (
        s.case.number(segment.delay) if segment.delay is not None else math.inf
    )
    counts = scope.named("first").equals(0.0) & delayed & met
    reject_if(scope, counts, Variant.ANY_ORDER)
    for k, now in enumerate((value, rate, time)):
        scope.store(component(name, k), now)
    scope.write(text)


def _condition(s: State, event: Event) -> tuple[Any, Any, Any]:
    """Expressions of the value of an event's condition (quantity minus threshold, SI), its rate and
    its second rate (0 for a vertical speed, of which it is not known), at a state with the
    derivative K1. Without a direction the value is below zero before the event."""
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
        together = line.length > 0.0  # coincident points have no direction
        acceleration = s.lengthening_by("K1", bodies, line)
        return (
            line.length - threshold,
            where(together, line.rate, 0.0),
            where(together, acceleration, 0.0),
        )
    line = s.separation(event.item)  # positive in the direction of separation
    return (
        line.length - threshold,
        line.rate,
        s.case.separation_sign(event.item) * s.lengthening_by("K1", bodies, line),
    )


def _border(s: State, event: Event) -> tuple[Any, Any, Any]:
    """Expressions of the distance by which a body is beyond the top or base of its atmosphere
    layer, m, or a point beyond an end of its table cell, in the unit of the axis (negative within);
    with its rate and second rate."""
    if event.is_cell_end:
        top = event.quantity == at.AT_CELL_TOP
        return cell_end(s, event.item, event.threshold, top)
    up = event.quantity == at.AT_LAYER_TOP
    value, rate = _climb(s, event.item, s.scope.load(component(f"BORDERS_{event.item}", int(up))))
    acceleration = s.scope.load(f"K1 + V_{event.item}", 3)[1]
    return (value, rate, acceleration) if up else (-value, -rate, -acceleration)


def _climb(s: State, body: str, threshold: Expr) -> tuple[Any, Any]:
    """Height of the mass centre of a body minus the height ``threshold``, m, and its rate, m/s."""
    return height(s.scope, body) - threshold, _climb_rate(s, body)


def _climb_rate(s: State, body: str) -> Any:
    """Vertical speed of the mass centre of a body relative to the ground, m/s."""
    return s.velocity(body)[1] + s.scope.load("ORIGIN_CLIMB")


def _angle(s: State, joint: str, threshold: Expr) -> tuple[Any, Any, Any]:
    """Angle of the rotation between the two bodies of a joint since the start, minus a threshold,
    rad, with its rate and second rate.

    The axis n of the rotation is that of the sum of the cross products of corresponding joint axes;
    at angle 0, which has no axis, rates are the magnitudes of the relative ones.
    """
    first, second = s.spec.scene.joint[joint].bodies
    if s.segment.leader(first) == s.segment.leader(second) == GROUND:
        return -threshold, 0.0, 0.0
    spin_a, spin_b = s.spin(first), s.spin(second)
    relative_rate = vec3.sub(spin_b, spin_a).called("relative_rate")
    relative_acceleration = vec3.sub(_spin_rate(s, second), _spin_rate(s, first)).called(
        "relative_acceleration"
    )
    square: Any = 0.0
    products, product_rates = [], []
    for k in range(3):
        a, b = s.axis(joint, k), s.axis(joint, k, second=True)
        difference = vec3.sub(b, a)
        square = square + vec3.dot(difference, difference)
        products.append(vec3.cross(a, b))
        product_rates.append(
            vec3.add(vec3.cross(vec3.cross(spin_a, a), b), vec3.cross(a, vec3.cross(spin_b, b)))
        )
    half = (0.125 * square).called("half")  # squared sine of half the angle
    angle = 2.0 * scalar.arctan2(square_root(half), square_root(where(half < 1.0, 1.0 - half, 0.0)))
    axis_sum, axis_sum_rate = vector_sum(products).called("axis_sum"), vector_sum(product_rates)
    length = square_root(vec3.dot(axis_sum, axis_sum)).called("length")
    rotated = length > 0.0
    inverse = 1.0 / where(rotated, length, 1.0)
    n = vec3.scale(inverse, axis_sum).called("n")
    n_rate = vec3.scale(inverse, vec3.sub(axis_sum_rate, vec3.scale(vec3.dot(n, axis_sum_rate), n)))
    rate = where(
        rotated, vec3.dot(n, relative_rate), square_root(vec3.dot(relative_rate, relative_rate))
    )
    acceleration = where(
        rotated,
        vec3.dot(n, relative_acceleration) + vec3.dot(n_rate, relative_rate),
        square_root(vec3.dot(relative_acceleration, relative_acceleration)),
    )
    return angle - threshold, rate, acceleration


def _spin_rate(s: State, body: str) -> Any:
    """Angular acceleration of a body, ground axes, rad/s2, from the stored derivative K1; `ZERO`
    for one that is in the rigid group of the ground."""
    leader = s.segment.leader(body)
    return (
        ZERO
        if leader == GROUND
        else vec3.rotate(s.attitude(leader), s.scope.load(f"K1 + OMEGA_{leader}", 3))
    )


def emit_event_flags(out: Text, c: Context) -> None:
    """Write the kernel function ``set_event_flags(w, phase)``, which, at the end of an interval of
    segment number ``phase``, sets the flags of the events whose conditions are met, raises the
    error indicators of their times, and loads the next cells and layers of tables."""
    text = out.function(
        "set_event_flags(w, phase: int)",
        "After the last step to an event: set the flags of the conditions that are met.",
    )
    for number, segment in enumerate(c.spec.segments):
        if segment.events:
            inner = text.block(f"if phase == {number}:")
            mark_inactive(inner, c, segment, "True")
            inner(f"event_step_{segment.name}(w, math.inf)")
            scope = c.scope()
            for event in segment.events:
                _set_flag(scope, c, segment, event)
            scope.write(inner)
            if any(event.is_cell_end for event in segment.events):
                inner(f"enter_cells_{segment.name}(w, 1.0)")
    if c.spec.layer_borders:
        text("enter_layers(w)", "recentre_air(w, 0.5 * NEAR)")


def _set_flag(scope: Scope, c: Context, segment: Segment, event: Event) -> None:
    """Add lines to a scope that set the flag of an event to 1 if its condition is met now. If it
    was met neither before nor at the start of the interval, they also raise its error indicator to
    1 / rate of the condition (infinite if it does not rise), since an error of the condition's
    value causes an error of the event time of error / rate; but not for ends of table cells.

    For a kink the mode is set instead (`set_mode`), for an event with a direction the flag of a
    crossing (`_set_crossing_flag`). For the end of a spring's stroke its time is stored too.
    """
    name, flag = f"{segment.name}_{event.name}", event.flag(segment.name)
    if event.quantity == at.AT_KINK:
        set_mode(scope, c, event, segment.name)
        return
    if event.direction:
        _set_crossing_flag(scope, c, segment, event)
        return
    if not event.ends_phase and event.number < 0:
        c.start(flag, 1.0 if event.is_border else 0.0)  # every body enters a layer at the start
    # several points may leave their cells at one instant but for round-off
    met, flag_before, rate = (
        scope.load(f"VALUE_{name}") >= (-0.5 * BESIDE if event.is_cell_end else _MET),
        scope.load(flag),
        scope.load(f"RATE_{name}"),
    )
    time_per_unit = where(rate > 0.0, 1.0 / rate, math.inf)
    new = met & flag_before.equals(0.0) & scope.load(f"MET_AT_START_{name}").equals(0.0)
    if not event.is_cell_end:  # at which lines meet: the time of a kink may have an error
        indicator = c.indicator(name)
        scope.store(indicator, scalar.larger(scope.load(indicator), where(new, time_per_unit, 0.0)))
    scope.store(flag, where(met, 1.0, flag_before))
    if event.quantity == at.AT_SPRING_STROKE:
        path = stroke_end_time(c.spec, event.item)
        scope.store(path, where(met & flag_before.equals(0.0), scope.load("T"), scope.load(path)))


def _set_crossing_flag(scope: Scope, c: Context, segment: Segment, event: Event) -> None:
    """Add lines to a scope that set the flag of an event with a direction, and raise its error
    indicator, if its quantity has crossed the threshold in a direction that counts; that a quantity
    starts at the threshold is no crossing."""
    name, flag = f"{segment.name}_{event.name}", event.flag(segment.name)
    side, flag_before = scope.load(f"SIDE_{name}"), scope.load(flag)
    met = (
        (side * scope.load(f"VALUE_{name}") >= -_tolerance(c, event))
        & _counts(event, side)
        & (scope.load("T") > scope.load(f"STARTED_AT_THRESHOLD_{name}") + at.GRAIN)
    )
    rate = side * scope.load(f"RATE_{name}")
    time_per_unit = where(rate > 0.0, 1.0 / rate, math.inf)
    indicator = c.indicator(name)
    new = met & flag_before.equals(0.0)
    scope.store(indicator, scalar.larger(scope.load(indicator), where(new, time_per_unit, 0.0)))
    scope.store(flag, where(met, 1.0, flag_before))
