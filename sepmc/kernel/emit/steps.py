"""Lines of a kernel for a step: its length, its stages, what follows its end; and the short step to
an event."""

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

# A step may be so many times as long as the last one; the way to an event, left to a method of low
# order, only a small component of it: hundredths are usual, and a way much longer is that to END,
# of an event that was foretold and does not come (a stroke just missed).
_LONGER, _SHORT = 3.0, 0.05
# of the way to an event goes a step before the last; the last is so much of the one before at most
_NEARLY, _LAST = 0.9, 0.2
# times as long as the first, and as the last, may a step be where an event does not come
_GROWS = 1.5
_MANY = 4096.0  # steps that it may take then; a case in which it does not come for longer is lost
# times as long as the last: such a step errs by more than the trial cases' and its estimate may not
# tell
_UNEVEN = 1.6
# s, of a step that is one of several: shorter ones are no time at all to what follows loads
_SHORTEST = 2.0 * GRAIN
_MOST_TURNED = 2.0  # rad in a step
# a height turns half of its rate times the time to its turning further on; a tenth more for an
# acceleration that changes
_BEYOND = 0.55


def coefficient(rk: Method, kind: str, *numbers: int) -> str:
    """The name of a coefficient of a method: A of the stage matrix, B of the weights, C of the
    nodes, E of the error_weights, counted from 1."""
    return f"{rk.name.upper()}_{kind}{'_'.join(str(number + 1) for number in numbers)}"


def coefficients(rk: Method, extends: bool) -> list[str]:
    """The coefficients that a step uses, and with its extension, as named constants."""
    rows = len(rk.a) if extends else rk.stages
    found = {coefficient(rk, "A", i, j): rk.a[i, j] for i in range(1, rows) for j in range(i)}
    found |= {coefficient(rk, "B", j): rk.b[j] for j in range(rk.stages)}
    found |= {coefficient(rk, "E", j): rk.error_weights[j] for j in range(rk.stages)}
    found |= {coefficient(rk, "C", i): rk.c[i] for i in range(1, rows)}
    return [f"{name} = {float(value)!r}" for name, value in found.items() if value]


def restore_stage(text: Text, rk: Method, i: int) -> None:
    """Lines for the state S and the time CLOCK of a stage, counted from 0, of the step just made
    from BEGIN: the derivatives of those before it are still there."""
    inner = text.block("for e in range(SIZE_Y):")
    used = [j for j in range(i) if rk.a[i, j] != 0.0]
    if not used:
        inner("w[S + e] = w[BEGIN + e]")
        text.lanes()("w[CLOCK + l] = w[BEGIN_T + l]")
        return
    terms = [f"{coefficient(rk, 'A', i, j)} * w[K{j + 1} + e]" for j in used]
    inner.wrapped("w[S + e] = w[BEGIN + e] + w[STEP + e] * (", terms, ")")
    text.lanes()(f"w[CLOCK + l] = w[BEGIN_T + l] + {coefficient(rk, 'C', i)} * w[STEP + l]")


def advance(rk: Method) -> str:
    """The name of the function that makes a step by a method."""
    return f"advance_{rk.name}"


def emit_step_length(out: Text, c: Context) -> None:
    """A function for the step lengths of all lanes."""
    says = (
        "Length of the first of ``parts`` steps to END or to the next event, into all of STEP; "
        "an event is never foretold later than"
    )
    text = out.function(
        "set_step(w, phase: int, parts: int, usual: float)", says + " ``usual`` at first."
    )
    text.lanes()("w[STEP + l] = w[END + l] - w[T + l]")
    for number, segment in enumerate(c.spec.segments):
        if not (segment.events or c.has_lane_steps(segment)):
            continue
        inner = text.block(f"if phase == {number}:")
        if segment.may_end_by_load:
            inner.lanes()("w[STEP + l] = min(w[STEP + l], w[TYPICAL_END + l] - w[T + l])")
        if segment.events:
            hold_back(inner, c, segment, "w[PROGRESS + l] < 1.0")
            inner(f"event_step_{segment.name}(w, usual)")
        if c.has_lane_steps(segment):
            end = "min(w[END + l], w[TYPICAL_END + l])" if segment.may_end_by_load else "w[END + l]"
            _keep_pace(inner.lanes(), end, c.spec.scene.solver.step is not None)
    text.lanes()(f"w[STEP + l] /= parts if abs(w[STEP + l]) > {_SHORTEST} * parts else 1.0")
    emit_broadcast(text, c, "STEP")
    if any(segment.events for segment in c.spec.segments):
        _emit_event_polish_step(out, c)


def hold_back(text: Text, c: Context, segment: Segment, goes: str) -> None:
    """Lines by which nothing is noted of the conditions of a phase but for the lanes that go
    now."""
    if c.has_lane_steps(segment):
        text.lanes()(f"w[INACTIVE + l] = 0.0 if {goes} else 1.0")


def _keep_pace(lane: Text, end: str, given: bool) -> None:
    """Lines for the step of a lane: the way ahead, at most to an ``end``, in equal parts, of which
    no more are STEPS_LEFT than there were, nor more than STEP_FACTOR what it takes for none to be
    longer than MAX_STEP; but more where an event that was foretold does not come: so that no step
    is longer than is ``given``, or else longer by more than half than the first one or the last.

    PROGRESS is less than 1 on the way, and tells how many steps were made, up to two; 1 if this
    step is the last; 2 if the last one was. Until an event has been aimed at twice, the step before
    the last stops short of it, so that nothing is noted of what comes after.
    """
    lane(f"h, way, ahead = w[STEP + l], w[PROGRESS + l], {end} - w[T + l]")
    lane(
        "left, needed = w[STEPS_LEFT + l] - 1.0, "
        "w[STEP_FACTOR + l] * np.ceil(h / w[MAX_STEP + l] - 1e-9)"
    )
    lane(f"needed = min(needed, np.floor(h / {_SHORTEST}))")
    lane("left = larger(left if left < needed else needed, 1.0)  # 1 if a number is NaN")
    if given:
        lane("left = larger(np.ceil(w[STEP_FACTOR + l] * h / w[MAX_STEP + l] - 1e-9), left)")
    lane("w[STEPS_LEFT + l] = left")
    if not given:
        lane(
            "w[FIRST_STEP + l] = larger(h, min(usual, ahead)) / left if way == 0.0 "
            "else w[FIRST_STEP + l]"
        )
        lane(f"left = larger(min(np.ceil(h / ({_GROWS} * w[FIRST_STEP + l])), {_MANY}), left)")
        lane(f"left = larger(np.ceil(h / ({_GROWS / _LONGER:.3g} * w[MAX_NEXT_STEP + l])), left)")
    lane(f"short = way == 0.0 or abs(h) > {_LAST / _LONGER:.3g} * w[MAX_NEXT_STEP + l]")
    lane(f"goes_on = left > 1.0 or (short and way > -2.0 and {GRAIN} < h < ahead)")
    lane(
        f"step = h / left if left > 1.0 or not goes_on else {_NEARLY} * h",
        "w[STEP + l] = step if way < 1.0 else 0.0",
    )
    lane("w[PROGRESS + l] = (max(way - 1.0, -2.0) if goes_on else 1.0) if way < 1.0 else 2.0")
    lane(rejection_unless(f"way >= 1.0 or h >= -{GRAIN}"))


def _emit_event_polish_step(out: Text, c: Context) -> None:
    """A function for the lengths of last short steps."""
    text = out.function(
        "set_event_polish_step(w, phase: int)",
        "What is left of the way to END or to the next event, into all of STEP.",
    )
    text.lanes()("w[STEP + l] = w[END + l] - w[T + l]")
    for number, segment in enumerate(c.spec.segments):
        if segment.events:
            inner = text.block(f"if phase == {number}:")
            if segment.may_end_by_load:
                inner.lanes()("w[STEP + l] = min(w[STEP + l], w[TYPICAL_END + l] - w[T + l])")
            hold_back(inner, c, segment, "w[PROGRESS + l] == 1.0")
            inner(f"event_step_{segment.name}(w, math.inf)")
            if c.has_lane_steps(segment):
                inner.lanes()("w[STEP + l] = w[STEP + l] if w[PROGRESS + l] == 1.0 else 0.0")
    emit_broadcast(text, c, "STEP")


def emit_broadcast(text: Text, c: Context, field: str) -> None:
    """Lines that copy the first numbers of a field, one a lane, to the places of all numbers of a
    state, by doubling."""
    filled = 1
    while filled < c.size:
        more = min(filled, c.size - filled)
        text.block(f"for e in range({more} * LANES):")(
            f"w[{field} + {filled} * LANES + e] = w[{field} + e]"
        )
        filled += more


def emit_advance(out: Text, c: Context, rk: Method) -> None:
    """A function for one step by a method; if the step is extended, its beginning is kept."""
    says = f"One of ``left`` steps of a phase by {rk.name}, of ``size`` components of the state."
    text = out.function(f"{advance(rk)}(w, phase: int, size: int, left: int, usual: float)", says)
    stages, later = rk.stages, np.empty((0, rk.stages))
    extends = c.has_extension and rk is c.extended
    if extends:
        later = np.vstack([rk.a[stages:, :stages], rk.dense[:stages].T])
    _begin(text, c, "set_step(w, phase, left, usual)", extends)
    # an event that was foretold and then does not come leaves too long a way for the last step
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
    """Lines that extend the step just made where states within it are needed. Rows of a full
    history are asked for in few of the flights of a case."""
    where = [
        f"phase == {number}"
        for number, one in enumerate(c.spec.segments)
        if c.needs_interpolation(one)
    ]
    if len(where) == len(c.spec.segments):
        text("make_extension(w, phase)")
        return
    if c.history == FULL_HISTORY:
        where.append("w[WANTS_ROWS] > 0.0")
    if where:
        text.block(f"if {' or '.join(where)}:")("make_extension(w, phase)")


def emit_event_polish(out: Text, c: Context) -> None:
    """A function for the rest of the way to an event: what is left is short, so that a method of
    low order will do."""
    rk = method("rk4")
    says = (
        f"The rest of the way to an event: a short step by {rk.name}, and a last correction "
        "along the derivative."
    )
    text = out.function("polish_event(w, phase: int, size: int)", says)
    _begin(text, c, "set_event_polish_step(w, phase)", False)
    text.lanes()(
        rejection_unless(f"abs(w[STEP + l]) <= {_SHORT / _LONGER:.3g} * w[MAX_NEXT_STEP + l]")
    )
    _emit_stages(text, rk, np.empty((0, rk.stages)))
    text("finish_step(w, phase)", "set_event_polish_step(w, phase)")
    text.block("for e in range(size):")("w[Y + e] += w[STEP + e] * w[D + e]")
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
    """Derivative K1 at the start of a step, and the step's length; ``keeps`` the state and the time
    it starts from."""
    if c.may_idle:
        text.block("for e in range(SIZE_Y):")("w[STATE_BEFORE + e] = w[Y + e]")
        if c.workspace.has("PIVOT"):
            text.lanes()("w[PIVOT_BEFORE + l] = w[PIVOT + l]")
    inner = text.block("for e in range(size):")
    inner("w[S + e] = w[Y + e]")
    if keeps:
        inner("w[BEGIN + e] = w[Y + e]")
    inner = text.lanes()
    inner("w[CLOCK + l] = w[T + l]")
    if keeps:
        inner("w[BEGIN_T + l] = w[T + l]")
    text("rates(w, phase)")
    text.block("for e in range(size):")("w[K1 + e] = w[D + e]")
    text(set_length)


def _emit_stages(
    text: Text,
    rk: Method,
    later: np.ndarray,
    error_weights: np.ndarray | None = None,
) -> None:
    """From K1 to the state Y and the time T at the end of a step; with weights of a
    ``error_weights``, also what the step may do wrong, into EMBEDDED_ERROR.

    later : weights of what uses the derivatives of the stages after the step, by rows: these
        derivatives are kept, the others never stored
    """
    stages = len(rk.b)
    weights = [*rk.a[:stages, :stages], rk.b, *later]
    ends = rk.b if error_weights is None else np.abs(rk.b) + np.abs(error_weights)
    for i in range(1, stages + 1):
        used = [j for j in range(i) if weights[i][j] != 0.0]
        kept = any(row[i - 1] != 0.0 for row in weights[i + 1 :]) or (
            i < stages and ends[i - 1] != 0.0
        )
        inner = text.block("for e in range(size):")
        if i > 1 and (i - 1 in used or kept):
            inner(f"k{i} = w[D + e]")
            if kept:
                inner(f"w[K{i} + e] = k{i}")
        values = [f"k{i}" if j == i - 1 and i > 1 else f"w[K{j + 1} + e]" for j in used]
        if i == stages and error_weights is not None:
            wrong = [
                f"{coefficient(rk, 'E', j)} * {f'k{i}' if j == i - 1 else f'w[K{j + 1} + e]'}"
                for j in np.flatnonzero(error_weights).tolist()
            ]
            inner.wrapped("w[EMBEDDED_ERROR + e] = w[STEP + e] * (", wrong, ")")
        of_end = i == stages
        terms = [
            f"{coefficient(rk, 'B', j) if of_end else coefficient(rk, 'A', i, j)} * {value}"
            for j, value in zip(used, values, strict=True)
        ]
        inner.wrapped(
            f"w[{'S' if i < stages else 'Y'} + e] = w[Y + e] + w[STEP + e] * (", terms, ")"
        )
        if i < stages:
            text.lanes()(f"w[CLOCK + l] = w[T + l] + {coefficient(rk, 'C', i)} * w[STEP + l]")
            text("rates(w, phase)")
    text.lanes()("w[T + l] += w[STEP + l]")


def emit_finish_step(out: Text, c: Context) -> None:
    """A function for what is done at the end of a step."""
    spec = c.spec
    says = (
        "After a step: attitudes of unit length, pitch and roll followed through turns, "
        "constraints, and what disqualifies a case."
    )
    text = out.function("finish_step(w, phase: int)", says)
    for first, bodies in turning_from(c):
        scope = c.scope()
        for body in bodies:
            _settle_attitude(scope, c, body)
        scope.write(text if first == 0 else text.block(f"if phase >= {first}:"))
    scope = c.scope()
    in_air = [body for body in spec.bodies if spec.in_layers(body)]
    if in_air:
        c.workspace.add("AIR_DISTANCE", 1)
        scope.store("AIR_DISTANCE", 0.0)
        for body in in_air:
            _settle_height(scope, c, body)
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
        text.block("for e in range(SIZE_Y):")(
            "w[Y + e] = w[STATE_BEFORE + e] if w[STEP + e] == 0.0 else w[Y + e]"
        )
        if c.workspace.has("PIVOT"):
            text.lanes()(
                "w[PIVOT + l] = w[PIVOT_BEFORE + l] if w[STEP + l] == 0.0 else w[PIVOT + l]"
            )
        # a state would count for the energy that is none at the end of a step of the case
        text.block("for e in range(3 * LANES):")("w[ENERGY_BEFORE + e] = w[ENERGY + e]")
    for number, segment in enumerate(spec.segments):
        text.block(f"if phase == {number}:")(f"energy_{segment.name}(w, 0.0)")
    if c.may_idle:
        text.block("for e in range(3 * LANES):")(
            "w[ENERGY + e] = w[ENERGY_BEFORE + e] if w[STEP + e] == 0.0 else w[ENERGY + e]"
        )


def turning_from(c: Context) -> list[tuple[int, list[str]]]:
    """Phases and the bodies whose attitudes are integrated from then on."""
    found: dict[int, list[str]] = {}
    for body in c.spec.attitude_order:
        first = next(
            (n for n, segment in enumerate(c.spec.segments) if body in segment.leaders), None
        )
        if first is not None:
            found.setdefault(first, []).append(body)
    return sorted(found.items())


def emit_attitudes_where(text: Text, c: Context, segment: Segment, flag: str) -> None:
    """Lines that follow attitudes to the state Y in the lanes in which a flag is set.

    A step that was cut short leaves pitch, roll and heading as they were at its full length.
    """
    for body in c.spec.attitude_order:
        if body not in segment.leaders:
            continue
        scope = c.scope()
        cut, q = scope.load(flag) > 0.0, scope.load(f"Y + Q_{body}", 4).called("q")
        inverse = (1.0 / square_root(total([q[i] * q[i] for i in range(4)]))).called("inverse")
        unit = tuple(q[i] * inverse for i in range(4))
        r = quat.matrix(unit).called("r")
        changes: list[tuple[str, Any]] = [
            (component(f"Y + Q_{body}", k), unit[k]) for k in range(4)
        ]
        for field, value, count in (
            (f"HEADING_{body}", quat.heading(r), 4),
            (f"LAST_RATE_{body}", scope.load(f"Y + OMEGA_{body}", 3), 3),
        ):
            changes += [(component(field, k), value[k]) for k in range(count)]
        for k, angle in enumerate((quat.pitch, quat.roll)):
            last = component(f"ANGLES_{body}", k)
            changes.append((last, scalar.nearest_turn(angle(r), scope.load(last))))
        for place, value in changes:
            scope.store(place, where(cut, value, scope.load(place)))
        scope.write(text)


def _settle_attitude(scope: Scope, c: Context, body: str) -> None:
    """A body's attitude after a step; a case is lost if it turned too far to tell how many turns it
    made."""
    c.workspace.add(f"ANGLES_{body}", 2)
    q, last = (
        scope.load(f"Y + Q_{body}", 4).called("q"),
        (f"ANGLES_{body}", component(f"ANGLES_{body}", 1)),
    )
    length = square_root(total([q[i] * q[i] for i in range(4)])).called("length")
    inverse = (1.0 / length).called("inverse")
    drift = _unless_idle(scope, c, scalar.abs(length - 1.0), 0.0)
    scope.store("DRIFT", scalar.larger(scope.load("DRIFT"), drift))
    unit = tuple(q[i] * inverse for i in range(4))
    scope.store(f"Y + Q_{body}", unit)
    r = quat.matrix(unit).called("r")
    now = [
        scalar.nearest_turn(angle(r), scope.load(place))
        for angle, place in zip((quat.pitch, quat.roll), last, strict=True)
    ]
    omega = scope.load(f"Y + OMEGA_{body}", 3)
    turned = (square_root(vec3.dot(omega, omega)) * scalar.abs(scope.load("STEP"))).called("turned")
    change = turned
    for angle, place in zip(now, last, strict=True):
        change = scalar.larger(scalar.abs(angle - scope.load(place)), change)
    _note_winding(scope, c, body, r, omega)
    unclear = (scalar.abs(r[6]) > scope.named("SINE_SINGULAR")) | (change > 0.5 * math.pi)
    scope.store("TURNED_FAR", where(unclear, 1.0, scope.load("TURNED_FAR")))
    reject_unless(scope, turned <= _MOST_TURNED)
    for angle, place in zip(now, last, strict=True):
        scope.store(place, _unless_idle(scope, c, angle, scope.load(place)))


def _note_winding(scope: Scope, c: Context, body: str, r: Expr, omega: Expr) -> None:
    """Whether pitch or roll may have gone on by a turn more or less in the step
    (`quat.turns_unclear`)."""
    c.workspace.add(f"HEADING_{body}", 4), c.workspace.add(f"LAST_RATE_{body}", 3)
    heading, rate = scope.load(f"HEADING_{body}", 4), scope.load(f"LAST_RATE_{body}", 3)
    now = quat.heading(r).called("heading")
    unclear = quat.turns_unclear(heading, now, rate, omega, scalar.abs(scope.load("STEP")))
    scope.store("WINDING_UNCLEAR", where(unclear, 1.0, scope.load("WINDING_UNCLEAR")))
    scope.store(f"HEADING_{body}", _unless_idle(scope, c, now, heading))
    scope.store(f"LAST_RATE_{body}", _unless_idle(scope, c, omega, rate))


def _unless_idle(scope: Scope, c: Context, now: Expr, before: Any) -> Expr:
    """What holds after a step, if it had any length, and before."""
    return where(scope.load("STEP").equals(0.0), before, now) if c.may_idle else now


def _settle_height(scope: Scope, c: Context, body: str) -> None:
    """How far a body is from where its air was expanded. Where no borders of layers are events, a
    case is lost if the body leaves its layer at the end of a step or, if it turns from climbing to
    falling or back, within."""
    now = height(scope, body).called("height")
    scope.store(
        "AIR_DISTANCE",
        scalar.larger(
            scope.load("AIR_DISTANCE"), scalar.abs(now - scope.load(f"AIR_CENTRE_{body}"))
        ),
    )
    if c.spec.layer_borders:
        return
    c.workspace.add(f"CLIMB_{body}", 2)  # height and its rate at the last end of a step
    climb = (scope.load(f"Y + V_{body}", 3)[1] + scope.load("ORIGIN_CLIMB")).called("climb")
    before, rate = scope.load(f"CLIMB_{body}"), scope.load(component(f"CLIMB_{body}", 1))
    turns = (rate * climb < 0.0).called("turns")
    further = (
        _BEYOND
        * rate
        * scalar.abs(rate)
        * scalar.abs(scope.load("STEP"))
        / scalar.abs(where(turns, climb - rate, 1.0))
    )
    top = where(turns, before + further, now).called("top")
    scope.store(f"CLIMB_{body}", _unless_idle(scope, c, now, before))
    scope.store(component(f"CLIMB_{body}", 1), _unless_idle(scope, c, climb, rate))
    for reached in (
        air.geopotential(now).called("reached"),
        air.geopotential(top).called("reached"),
    ):
        reject_unless(
            scope,
            (reached >= scope.load("AIR")) & (reached <= scope.load("AIR_TOP")),
            Variant.ANY_ORDER,
        )


def emit_note_indicators(out: Text, c: Context) -> None:
    """A function that keeps the largest error_weights there was of any step."""
    text = out.function(
        "note_indicators(w, phase: int)",
        "The largest that steps may have done wrong, for every body, into INDICATORS.",
    )
    scope = c.scope()
    for body in c.spec.bodies:
        _largest(scope, c, "V", body)
    scope.write(text)
    for first, bodies in turning_from(c):
        scope = c.scope()
        for body in bodies:
            _largest(scope, c, "Q", body)
            _largest(scope, c, "OMEGA", body)
        scope.write(text if first == 0 else text.block(f"if phase >= {first}:"))


def _largest(scope: Scope, c: Context, what: str, body: str) -> None:
    indicator, largest, count = (
        c.indicator(f"{what}_{body}"),
        *((scalar.largest4, 4) if what == "Q" else (scalar.largest3, 3)),
    )
    scope.store(
        indicator,
        scalar.larger(
            scope.load(indicator), largest(scope.load(f"EMBEDDED_ERROR + {what}_{body}", count))
        ),
    )
