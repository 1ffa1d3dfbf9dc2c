"""Emitter of steps: step length, Runge-Kutta stages, completion of a step, and the last short step
to an event."""

import math
from typing import Any

import numpy as np

from sepmc.kernel.emit.context import Context, component, height, reject_unless, rejection_unless
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.spec.methods import Method, method
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import air, quat, scalar, square_root, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, total, where
from sepmc.routines.layout import FULL_HISTORY, GRAIN

# A step may be at most _LONGER times the last one. The short step to an event, by RK4, may be at
# most the fraction _SHORT of the last one: hundredths are typical, and a much longer one leads to
# END, because a predicted event did not occur (a stroke just missed).
_LONGER, _SHORT = 3.0, 0.05
# Until the last one, a step to an event covers the fraction _NEARLY of the distance, unless it is
# at most the fraction _LAST of the step before.
_NEARLY, _LAST = 0.9, 0.2
# While a predicted event does not occur, a step is at most _GROWS times the first one of the
# interval, and at most _GROWS times the one before it.
_GROWS = 1.5
_MANY = 4096.0  # maximum number of remaining steps that is planned then
# A step longer than _UNEVEN times the last one has a larger error than those of the calibration
# cases, and its estimate may miss it.
_UNEVEN = 1.6
# s: minimum length of one of several steps; for the monitoring of loads shorter ones count as zero
_SHORTEST = 2.0 * GRAIN
_MOST_TURNED = 2.0  # rad, maximum rotation of a body in a step
# After its rate has changed sign, a height has moved on by half the rate times the time to the
# change; a tenth more for an acceleration that varies.
_BEYOND = 0.55


def coefficient(rk: Method, kind: str, *numbers: int) -> str:
    """Name of the kernel's constant for a coefficient of a method, such as DOP853_A2_1.

    ``kind`` is A (stage matrix), B (weights), C (nodes), D (extension) or E (error weights);
    ``numbers`` are the indices of the coefficient, which count from 0, in the name from 1. Those of
    D are of the power, from the first on, and of the stage.
    """
    return f"{rk.name.upper()}_{kind}{'_'.join(str(number + 1) for number in numbers)}"


def coefficients(rk: Method, extends: bool) -> list[str]:
    """Lines of code that define, as constants of a kernel, the nonzero coefficients of a method;
    with ``extends`` also those of its continuous extension."""
    rows = len(rk.a) if extends else rk.stages
    values = {coefficient(rk, "A", i, j): rk.a[i, j] for i in range(1, rows) for j in range(i)}
    values |= {coefficient(rk, "B", j): rk.b[j] for j in range(rk.stages)}
    values |= {coefficient(rk, "E", j): rk.error_weights[j] for j in range(rk.stages)}
    values |= {coefficient(rk, "C", i): rk.c[i] for i in range(1, rows)}
    if extends:
        by_power = enumerate(rk.dense.T[1:])
        values |= {coefficient(rk, "D", q, j): d for q, row in by_power for j, d in enumerate(row)}
    return [f"{name} = {float(value)!r}" for name, value in values.items() if value]


def restore_stage(text: Text, rk: Method, i: int, size: str) -> None:
    """Append lines that compute again the state S and the time CLOCK of stage ``i`` (from 0) of the
    step just made from BEGIN, from the stored derivatives of the stages before it; ``size`` is the
    code of the number of components of the state times LANES."""
    inner = text.components(size)
    used = [j for j in range(i) if rk.a[i, j] != 0.0]
    if not used:
        inner("w[S + e + l] = w[BEGIN + e + l]")
        text.lanes()("w[CLOCK + l] = w[BEGIN_T + l]")
        return
    terms = [f"{coefficient(rk, 'A', i, j)} * w[K{j + 1} + e + l]" for j in used]
    inner.wrapped("w[S + e + l] = w[BEGIN + e + l] + w[STEP + e + l] * (", terms, ")")
    text.lanes()(f"w[CLOCK + l] = w[BEGIN_T + l] + {coefficient(rk, 'C', i)} * w[STEP + l]")


def advance(rk: Method) -> str:
    """Name of the kernel function that makes a step by the method ``rk``."""
    return f"advance_{rk.name}"


def emit_step_length(out: Text, c: Context) -> None:
    """Write the kernel function ``set_step(w, phase, parts, typical)``, which sets the field STEP
    to the length of the next step of every lane in segment number ``phase``: the first of ``parts``
    equal steps to END or to the next predicted event or, in segments in which lanes make different
    numbers of steps, the length that `_lane_step` gives. ``typical`` is as in `emit_event_step`.
    With events, also write ``set_event_polish_step`` (`_emit_event_polish_step`)."""
    docstring = (
        "Length of the first of ``parts`` steps to END or to the next event, into all of STEP; "
        "at first, an event is predicted no later than"
    )
    text = out.function(
        "set_step(w, phase: int, parts: int, typical: float)", docstring + " ``typical``."
    )
    text.lanes()("w[STEP + l] = w[END + l] - w[T + l]")
    for number, segment in enumerate(c.spec.segments):
        if not (segment.events or c.has_lane_steps(segment)):
            continue
        inner = text.block(f"if phase == {number}:")
        if segment.may_end_by_load:
            inner.lanes()("w[STEP + l] = min(w[STEP + l], w[TYPICAL_END + l] - w[T + l])")
        if segment.events:
            mark_inactive(inner, c, segment, "w[PROGRESS + l] < 1.0")
            inner(f"event_step_{segment.name}(w, typical)")
        if c.has_lane_steps(segment):
            end = "min(w[END + l], w[TYPICAL_END + l])" if segment.may_end_by_load else "w[END + l]"
            _lane_step(inner.lanes(), end, c.spec.scene.solver.step is not None)
    text.lanes()(f"w[STEP + l] /= parts if abs(w[STEP + l]) > {_SHORTEST} * parts else 1.0")
    emit_broadcast(text, c, "STEP")
    if any(segment.events for segment in c.spec.segments):
        _emit_event_polish_step(out, c)


def mark_inactive(text: Text, c: Context, segment: Segment, goes: str) -> None:
    """Append lines that set INACTIVE to 1 in lanes that do not satisfy the condition ``goes``
    (kernel code), else to 0: in inactive lanes the stored values of conditions are not updated.
    Nothing is appended if all lanes make the same number of steps."""
    if c.has_lane_steps(segment):
        text.lanes()(f"w[INACTIVE + l] = 0.0 if {goes} else 1.0")


def _lane_step(lane: Text, end: str, is_limited: bool) -> None:
    """Append lines, within a loop over lanes (``lane``), that set the field STEP to the length of
    the next step of a lane. Before these lines STEP has the time to END or to the next event.

    The remaining time, at most to ``end`` (kernel code), is divided into equal steps. Their number
    STEPS_LEFT is the smaller of two: one less than at the last step, and STEP_FACTOR times the
    fewest steps that are not longer than MAX_STEP. It is raised where a predicted event does not
    occur: with ``is_limited`` (``solver.step`` is given), no step is longer than MAX_STEP /
    STEP_FACTOR; otherwise none is longer than 1.5 times the first one of the interval, nor than
    1.5 times the one before it.

    PROGRESS is 0 before the first step of an interval, -1 before the second and -2 before all later
    ones; then 1 at the last step and 2 after it. Until an event has been predicted twice, the step
    before the last stops short of it, so that no state past the event is used.
    """
    lane(f"h, progress, remaining = w[STEP + l], w[PROGRESS + l], {end} - w[T + l]")
    lane(
        "left, needed = w[STEPS_LEFT + l] - 1.0, "
        "w[STEP_FACTOR + l] * np.ceil(h / w[MAX_STEP + l] - 1e-9)"
    )
    lane(f"needed = min(needed, np.floor(h / {_SHORTEST}))")
    lane("left = larger(left if left < needed else needed, 1.0)  # 1 for NaN")
    if is_limited:
        lane("left = larger(np.ceil(w[STEP_FACTOR + l] * h / w[MAX_STEP + l] - 1e-9), left)")
    lane("w[STEPS_LEFT + l] = left")
    if not is_limited:
        lane(
            "w[FIRST_STEP + l] = larger(h, min(typical, remaining)) / left if progress == 0.0 "
            "else w[FIRST_STEP + l]"
        )
        lane(f"left = larger(min(np.ceil(h / ({_GROWS} * w[FIRST_STEP + l])), {_MANY}), left)")
        lane(f"left = larger(np.ceil(h / ({_GROWS / _LONGER:.3g} * w[MAX_NEXT_STEP + l])), left)")
    lane(f"short = progress == 0.0 or abs(h) > {_LAST / _LONGER:.3g} * w[MAX_NEXT_STEP + l]")
    lane(f"goes_on = left > 1.0 or (short and progress > -2.0 and {GRAIN} < h < remaining)")
    lane(
        f"step = h / left if left > 1.0 or not goes_on else {_NEARLY} * h",
        "w[STEP + l] = step if progress < 1.0 else 0.0",
    )
    lane(
        "w[PROGRESS + l] = (max(progress - 1.0, -2.0) if goes_on else 1.0) "
        "if progress < 1.0 else 2.0"
    )
    lane(rejection_unless(f"progress >= 1.0 or h >= -{GRAIN}"))


def _emit_event_polish_step(out: Text, c: Context) -> None:
    """Write the kernel function ``set_event_polish_step(w, phase)``, which sets the field STEP to
    the time left to the end of an interval of segment number ``phase`` or to the next event. Where
    lanes make different numbers of steps, it is 0 in all lanes that have not just made their last
    regular step."""
    text = out.function(
        "set_event_polish_step(w, phase: int)",
        "Length of the remaining step to END or to the next event, into all of STEP.",
    )
    text.lanes()("w[STEP + l] = w[END + l] - w[T + l]")
    for number, segment in enumerate(c.spec.segments):
        if segment.events:
            inner = text.block(f"if phase == {number}:")
            if segment.may_end_by_load:
                inner.lanes()("w[STEP + l] = min(w[STEP + l], w[TYPICAL_END + l] - w[T + l])")
            mark_inactive(inner, c, segment, "w[PROGRESS + l] == 1.0")
            inner(f"event_step_{segment.name}(w, math.inf)")
            if c.has_lane_steps(segment):
                inner.lanes()("w[STEP + l] = w[STEP + l] if w[PROGRESS + l] == 1.0 else 0.0")
    emit_broadcast(text, c, "STEP")


def emit_broadcast(text: Text, c: Context, field: str) -> None:
    """Append lines that copy the first component of a field, which has as many components as a
    state vector, to all others, by doubling."""
    filled = 1
    while filled < c.size:
        more = min(filled, c.size - filled)
        text.components(f"{more} * LANES")(
            f"w[{field} + {filled} * LANES + e + l] = w[{field} + e + l]"
        )
        filled += more


def emit_advance(out: Text, c: Context, rk: Method) -> None:
    """Write the kernel function ``advance_METHOD(w, phase, size, left, typical)``, which makes one
    step in all lanes by a method in segment number ``phase``: the first of ``left`` remaining ones.
    ``size`` is the number of state components that the segment integrates, times LANES; ``typical``
    is as in `emit_event_step`. It sets step length, state Y and time T, error indicators and, if
    needed, the continuous extension. Cases whose step is much longer than the one before are
    marked (field UNEVEN); if it is more than three times as long, they are integrated again with
    smaller steps."""
    docstring = (
        f"One of ``left`` steps of a phase by {rk.name}, of ``size`` components of the state."
    )
    text = out.function(
        f"{advance(rk)}(w, phase: int, size: int, left: int, typical: float)", docstring
    )
    stages, later = rk.stages, np.empty((0, rk.stages))
    extends = c.has_extension and rk is c.extended
    if extends:
        later = np.vstack([rk.a[stages:, :stages], rk.dense[:stages].T])
    _begin(text, c, "set_step(w, phase, left, typical)", extends)
    # a predicted event that does not occur leaves too long a distance for the last step
    inner = text.lanes()
    inner("h = abs(w[STEP + l])", rejection_unless("h <= w[MAX_NEXT_STEP + l]"))
    inner(
        f"w[UNEVEN + l] = 1.0 if h > {_UNEVEN / _LONGER:.3g} * w[MAX_NEXT_STEP + l] "
        "else w[UNEVEN + l]"
    )
    inner(f"w[MAX_NEXT_STEP + l] = {_LONGER} * h + 1e-9")
    _emit_stages(text, rk, later, rk.error_weights)
    text("note_indicators(w, phase)")
    if extends:
        _extends(text, c)
    text("finish_step(w, phase)")


def _extends(text: Text, c: Context) -> None:
    """Append lines that compute the continuous extension of the step just made: in segments that
    need it for outcomes or events, and for a full history in all segments, if rows are asked
    for."""
    where = [
        f"phase == {number}"
        for number, one in enumerate(c.spec.segments)
        if c.needs_interpolation(one)
    ]
    if len(where) == len(c.spec.segments):
        text("make_extension(w, phase, size)")
        return
    if c.history == FULL_HISTORY:
        where.append("w[WANTS_ROWS] > 0.0")
    if where:
        text.block(f"if {' or '.join(where)}:")("make_extension(w, phase, size)")


def emit_event_polish(out: Text, c: Context) -> None:
    """Write the kernel function ``polish_event(w, phase, size)`` (arguments as in `emit_advance`),
    which makes the last step to an event: a short step by RK4, accurate enough since it is short,
    then a correction along the derivative. Cases in which either is too long are integrated again
    with smaller steps."""
    rk = method("rk4")
    docstring = (
        f"Last step to an event: a short step by {rk.name}, then a correction along the derivative."
    )
    text = out.function("polish_event(w, phase: int, size: int)", docstring)
    _begin(text, c, "set_event_polish_step(w, phase)", False)
    text.lanes()(
        rejection_unless(f"abs(w[STEP + l]) <= {_SHORT / _LONGER:.3g} * w[MAX_NEXT_STEP + l]")
    )
    _emit_stages(text, rk, np.empty((0, rk.stages)))
    text("finish_step(w, phase)", "set_event_polish_step(w, phase)")
    text.components("size")("w[Y + e + l] += w[STEP + e + l] * w[D + e + l]")
    inner = text.lanes()
    inner(
        "h = w[STEP + l]", "w[T + l] += h", "w[EVENT_ERROR + l] = larger(w[EVENT_ERROR + l], h * h)"
    )
    inner(rejection_unless("abs(h) < 1e-6"))
    if c.has_extension:
        inner("reach = (w[T + l] - w[BEGIN_T + l]) / w[LENGTH + l] if w[LENGTH + l] > 0.0 else 0.0")
        inner(
            "w[REACH + l] = reach if w[T + l] != w[BEGIN_T + l] + w[LENGTH + l] else w[REACH + l]"
        )


def _begin(text: Text, c: Context, set_length: str, keeps: bool) -> None:
    """Append lines that begin a step: they compute the derivative K1 at the state Y, then run
    ``set_length``, the code of the call that sets the step length; with ``keeps``, they also store
    state and time at the start of the step into BEGIN and BEGIN_T."""
    if c.may_idle:
        text.components("SIZE_Y")("w[STATE_BEFORE + e + l] = w[Y + e + l]")
        if c.workspace.has("PIVOT"):
            text.lanes()("w[PIVOT_BEFORE + l] = w[PIVOT + l]")
    inner = text.components("size")
    inner("w[S + e + l] = w[Y + e + l]")
    if keeps:
        inner("w[BEGIN + e + l] = w[Y + e + l]")
    inner = text.lanes()
    inner("w[CLOCK + l] = w[T + l]")
    if keeps:
        inner("w[BEGIN_T + l] = w[T + l]")
    text("rates(w, phase)")
    text.components("size")("w[K1 + e + l] = w[D + e + l]")
    text(set_length)


def _emit_stages(
    text: Text,
    rk: Method,
    later: np.ndarray,
    error_weights: np.ndarray | None = None,
) -> None:
    """Append lines that compute, from the derivative K1, the further stages of a step by the method
    ``rk``, the state Y and the time T at its end and, with ``error_weights``, its embedded error in
    every component of the state (field EMBEDDED_ERROR).

    ``later``, shape (n, stages), has rows of weights by which derivatives of the stages are used
    after the step; of the derivatives that the step itself needs no more, only those with a nonzero
    weight are stored.
    """
    stages = len(rk.b)
    weights = [*rk.a[:stages, :stages], rk.b, *later]
    ends = rk.b if error_weights is None else np.abs(rk.b) + np.abs(error_weights)
    for i in range(1, stages + 1):
        used = [j for j in range(i) if weights[i][j] != 0.0]
        stored = any(row[i - 1] != 0.0 for row in weights[i + 1 :]) or (
            i < stages and ends[i - 1] != 0.0
        )
        inner = text.components("size")
        if i > 1 and (i - 1 in used or stored):
            inner(f"k{i} = w[D + e + l]")
            if stored:
                inner(f"w[K{i} + e + l] = k{i}")
        values = [f"k{i}" if j == i - 1 and i > 1 else f"w[K{j + 1} + e + l]" for j in used]
        if i == stages and error_weights is not None:
            error_terms = [
                f"{coefficient(rk, 'E', j)} * {f'k{i}' if j == i - 1 else f'w[K{j + 1} + e + l]'}"
                for j in np.flatnonzero(error_weights).tolist()
            ]
            inner.wrapped("w[EMBEDDED_ERROR + e + l] = w[STEP + e + l] * (", error_terms, ")")
        of_end = i == stages
        terms = [
            f"{coefficient(rk, 'B', j) if of_end else coefficient(rk, 'A', i, j)} * {value}"
            for j, value in zip(used, values, strict=True)
        ]
        inner.wrapped(
            f"w[{'S' if i < stages else 'Y'} + e + l] = w[Y + e + l] + w[STEP + e + l] * (",
            terms,
            ")",
        )
        if i < stages:
            text.lanes()(f"w[CLOCK + l] = w[T + l] + {coefficient(rk, 'C', i)} * w[STEP + l]")
            text("rates(w, phase)")
    text.lanes()("w[T + l] += w[STEP + l]")


def emit_finish_step(out: Text, c: Context) -> None:
    """Write the kernel function ``finish_step(w, phase)``, which completes a step in segment number
    ``phase``: it normalises attitudes, counts full turns, checks heights in atmosphere layers,
    projects the state onto the constraints, and updates the energy audit; lanes with a step of zero
    length keep their values.

    It rejects cases: for smaller steps, if a body turned too far or left the range of its air
    expansion in the step; for another kernel variant, if a body left its atmosphere layer
    (`_finish_height`) or rows became redundant (`sepmc.kernel.emit.motion.emit_correct`).
    """
    spec = c.spec
    docstring = (
        "After a step: normalise attitudes, count full turns of pitch and roll, project onto "
        "the constraints, and reject cases."
    )
    text = out.function("finish_step(w, phase: int)", docstring)
    for first, bodies in rotating_from(c):
        scope = c.scope()
        for body in bodies:
            _finish_attitude(scope, c, body)
        scope.write(text if first == 0 else text.block(f"if phase >= {first}:"))
    scope = c.scope()
    in_air = [body for body in spec.bodies if spec.in_layers(body)]
    if in_air:
        c.workspace.add("AIR_DISTANCE", 1)
        scope.store("AIR_DISTANCE", 0.0)
        for body in in_air:
            _finish_height(scope, c, body)
        reject_unless(scope, scope.load("AIR_DISTANCE") <= scope.named("NEAR"))
    steps = scope.load("STEPS")
    scope.store("STEPS", _unless_idle(scope, c, steps + 1.0, steps))
    scope.write(text)
    if in_air:
        text("farthest = 0.0")
        text.lanes()("farthest = max(farthest, w[AIR_DISTANCE + l])")
        text.block("if farthest > 0.5 * NEAR:")("recentre_air(w, 0.5 * NEAR)")
    for number, segment in enumerate(spec.segments):
        if segment.rows:
            text.block(f"if phase == {number}:")(f"correct_{segment.name}(w)")
    if c.may_idle:
        text.components("SIZE_Y")(
            "w[Y + e + l] = w[STATE_BEFORE + e + l] if w[STEP + e + l] == 0.0 else w[Y + e + l]"
        )
        if c.workspace.has("PIVOT"):
            text.lanes()(
                "w[PIVOT + l] = w[PIVOT_BEFORE + l] if w[STEP + l] == 0.0 else w[PIVOT + l]"
            )
        # an idle lane must not update its energy
        text.components("3 * LANES")("w[ENERGY_BEFORE + e + l] = w[ENERGY + e + l]")
    for number, segment in enumerate(spec.segments):
        text.block(f"if phase == {number}:")(f"energy_{segment.name}(w, 0.0)")
    if c.may_idle:
        text.components("3 * LANES")(
            "w[ENERGY + e + l] = "
            "w[ENERGY_BEFORE + e + l] if w[STEP + e + l] == 0.0 else w[ENERGY + e + l]"
        )


def rotating_from(c: Context) -> list[tuple[int, list[str]]]:
    """Pairs (number of a segment, names of the bodies whose attitudes are integrated from that
    segment on), in ascending order of the number."""
    bodies_from: dict[int, list[str]] = {}
    for body in c.spec.attitude_order:
        first = next(
            (n for n, segment in enumerate(c.spec.segments) if body in segment.leaders), None
        )
        if first is not None:
            bodies_from.setdefault(first, []).append(body)
    return sorted(bodies_from.items())


def emit_cut_attitudes(text: Text, c: Context, segment: Segment, flag: str) -> None:
    """Append lines that, in lanes where the field ``flag`` is above 0, normalise attitudes of the
    state Y and set pitch, roll, heading and rate to those of Y: a step that was cut short has left
    them at their values at its full length."""
    for body in c.spec.attitude_order:
        if body not in segment.leaders:
            continue
        scope = c.scope()
        is_cut, (_, unit, r, angles) = scope.load(flag) > 0.0, _attitude(scope, body)
        omega = scope.load(f"Y + OMEGA_{body}", 3)
        fields: list[tuple[str, Any, int]] = [
            (f"Y + Q_{body}", unit, 4),
            (f"HEADING_{body}", quat.heading(r), 4),
            (f"LAST_RATE_{body}", omega, 3),
            (f"ANGLES_{body}", angles, 2),
        ]
        changes = [(component(f, k), v[k]) for f, v, count in fields for k in range(count)]
        for path, value in changes:
            scope.store(path, where(is_cut, value, scope.load(path)))
        scope.write(text)


def _attitude(scope: Scope, body: str) -> tuple[Expr, tuple[Any, ...], Expr, list[Any]]:
    """Expressions for the attitude, at the state Y, of a body that leads a rigid group (not
    GROUND): length of its quaternion; unit quaternion; rotation matrix; pitch and roll, rad, with
    the full turns that bring them nearest to their last values."""
    q = scope.load(f"Y + Q_{body}", 4).called("q")
    length = square_root(total([q[i] * q[i] for i in range(4)])).called("length")
    inverse = (1.0 / length).called("inverse")
    unit = tuple(q[i] * inverse for i in range(4))
    r = quat.matrix(unit).called("r")
    angles = [
        scalar.nearest_turn(angle(r), scope.load(component(f"ANGLES_{body}", k)))
        for k, angle in enumerate((quat.pitch, quat.roll))
    ]
    return length, unit, r, angles


def _finish_attitude(scope: Scope, c: Context, body: str) -> None:
    """Add lines to a scope that, after a step, raise the field DRIFT to the deviation from unit
    length of the quaternion of a body that leads a rigid group (not GROUND), normalise the
    quaternion, and update pitch and roll with full turns.

    They set WINDING_UNCLEAR in a case in which the full turns are unclear (`_flag_winding`), and
    TURNED_FAR where pitch and roll cannot be followed: near a yaw of 90 deg, or after more than a
    quarter turn in the step. A case in which the body turned by more than 2 rad is rejected
    (`FINER_STEPS`): it is integrated again with smaller steps.
    """
    c.workspace.add(f"ANGLES_{body}", 2)
    last = [component(f"ANGLES_{body}", k) for k in range(2)]
    length, unit, r, angles = _attitude(scope, body)
    drift = _unless_idle(scope, c, scalar.abs(length - 1.0), 0.0)
    scope.store("DRIFT", scalar.larger(scope.load("DRIFT"), drift))
    scope.store(f"Y + Q_{body}", unit)
    omega = scope.load(f"Y + OMEGA_{body}", 3)
    turned = (square_root(vec3.dot(omega, omega)) * scalar.abs(scope.load("STEP"))).called("turned")
    change = turned
    for angle, path in zip(angles, last, strict=True):
        change = scalar.larger(scalar.abs(angle - scope.load(path)), change)
    _flag_winding(scope, c, body, r, omega)
    unclear = (scalar.abs(r[6]) > scope.named("SINE_SINGULAR")) | (change > 0.5 * math.pi)
    scope.store("TURNED_FAR", where(unclear, 1.0, scope.load("TURNED_FAR")))
    reject_unless(scope, turned <= _MOST_TURNED)
    for angle, path in zip(angles, last, strict=True):
        scope.store(path, _unless_idle(scope, c, angle, scope.load(path)))


def _flag_winding(scope: Scope, c: Context, body: str, r: Expr, omega: Expr) -> None:
    """Add lines to a scope that set WINDING_UNCLEAR to 1 if the number of full turns of a body's
    pitch or roll in a step is ambiguous (`sepmc.physics.quat.turns_unclear`). ``r`` is the rotation
    matrix of the body and ``omega`` its rate at the end of the step; the heading
    (`sepmc.physics.quat.heading`) and the rate are stored for the next step."""
    c.workspace.add(f"HEADING_{body}", 4), c.workspace.add(f"LAST_RATE_{body}", 3)
    heading, rate = scope.load(f"HEADING_{body}", 4), scope.load(f"LAST_RATE_{body}", 3)
    heading_now = quat.heading(r).called("heading")
    unclear = quat.turns_unclear(heading, heading_now, rate, omega, scalar.abs(scope.load("STEP")))
    scope.store("WINDING_UNCLEAR", where(unclear, 1.0, scope.load("WINDING_UNCLEAR")))
    scope.store(f"HEADING_{body}", _unless_idle(scope, c, heading_now, heading))
    scope.store(f"LAST_RATE_{body}", _unless_idle(scope, c, omega, rate))


def _unless_idle(scope: Scope, c: Context, now: Expr, before: Any) -> Expr:
    """Value ``now``, but ``before`` in a lane whose step has zero length, because it has finished
    the segment."""
    return where(scope.load("STEP").equals(0.0), before, now) if c.may_idle else now


def _finish_height(scope: Scope, c: Context, body: str) -> None:
    """Add lines to a scope that, after a step, raise AIR_DISTANCE to the distance, m, of a body
    from the height about which its air density was expanded.

    If layer borders are not events, they also leave a case to the kernel variant ANY_ORDER in which
    the body is outside its atmosphere layer at the end of the step or, if its vertical speed
    changed sign, may have been outside within the step.
    """
    height_now = height(scope, body).called("height")
    scope.store(
        "AIR_DISTANCE",
        scalar.larger(
            scope.load("AIR_DISTANCE"), scalar.abs(height_now - scope.load(f"AIR_CENTRE_{body}"))
        ),
    )
    if c.spec.layer_borders:
        return
    c.workspace.add(f"CLIMB_{body}", 2)  # height and its rate at the end of the last step
    climb = (scope.load(f"Y + V_{body}", 3)[1] + scope.load("ORIGIN_CLIMB")).called("climb")
    height_before, rate = scope.load(f"CLIMB_{body}"), scope.load(component(f"CLIMB_{body}", 1))
    reverses = (rate * climb < 0.0).called("reverses")
    rise = (
        _BEYOND
        * rate
        * scalar.abs(rate)
        * scalar.abs(scope.load("STEP"))
        / scalar.abs(where(reverses, climb - rate, 1.0))
    )
    top = where(reverses, height_before + rise, height_now).called("top")
    scope.store(f"CLIMB_{body}", _unless_idle(scope, c, height_now, height_before))
    scope.store(component(f"CLIMB_{body}", 1), _unless_idle(scope, c, climb, rate))
    for reached in (
        air.geopotential(height_now).called("reached"),
        air.geopotential(top).called("reached"),
    ):
        reject_unless(
            scope,
            (reached >= scope.load("AIR")) & (reached <= scope.load("AIR_TOP")),
            Variant.ANY_ORDER,
        )


def emit_indicators(out: Text, c: Context) -> None:
    """Write the kernel function ``note_indicators(w, phase)``, which, after a step in segment
    number ``phase``, updates in INDICATORS the maximum embedded error of all steps of the case so
    far, over all segments: of velocity, attitude and angular rate of every body. Attitude and
    rate of a body count from the first segment that integrates its attitude (`rotating_from`)."""
    text = out.function(
        "note_indicators(w, phase: int)",
        "Update the maximum embedded error of the steps of every body, into INDICATORS.",
    )
    scope = c.scope()
    for body in c.spec.bodies:
        _update_indicator(scope, c, "V", body)
    scope.write(text)
    for first, bodies in rotating_from(c):
        scope = c.scope()
        for body in bodies:
            _update_indicator(scope, c, "Q", body)
            _update_indicator(scope, c, "OMEGA", body)
        scope.write(text if first == 0 else text.block(f"if phase >= {first}:"))


def _update_indicator(scope: Scope, c: Context, quantity: str, body: str) -> None:
    """Add lines to a scope that raise the error indicator of a ``quantity`` (V velocity, Q
    attitude, OMEGA angular rate) of a body to the largest embedded error of its components."""
    indicator, maximum, count = (
        c.indicator(f"{quantity}_{body}"),
        *((scalar.largest4, 4) if quantity == "Q" else (scalar.largest3, 3)),
    )
    scope.store(
        indicator,
        scalar.larger(
            scope.load(indicator), maximum(scope.load(f"EMBEDDED_ERROR + {quantity}_{body}", count))
        ),
    )
