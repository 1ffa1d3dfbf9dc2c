"""Lines of a kernel that fly a block of cases: phase after phase, hand-over between them, results;
and its entry."""

import functools
import math
from collections.abc import Iterator
from typing import Any

from sepmc.kernel.emit.context import Context, component, reject_unless, went
from sepmc.kernel.emit.history import fit_curves
from sepmc.kernel.emit.ignition import ignition, lights, note_ignitions
from sepmc.kernel.emit.monitor import side_before
from sepmc.kernel.emit.outcomes import emit_results, kept, kept_angle, tip_off, tip_offs
from sepmc.kernel.emit.steps import advance
from sepmc.kernel.emit.tables import has_tables
from sepmc.kernel.spec.kernel_spec import (
    ANY_PHASE,
    Change,
    Due,
    Release,
    Segment,
    condition_flag,
    condition_numbers,
    stroke_flag,
)
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, scalar, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, Scope, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status

_SAME_TIME = 1e-12  # s
# of a lane: no status has ended its case (what only needs more care goes on)
_GOES_ON = "w[REJECTED + l] <= 0.0"
# of the time left: a stretch where a load usually ends a phase at once, for the cases in which it
# does not
_LEAST_SHARE = 2.0**-16
_CONSISTENT = 1e-9  # m, rad, m/s, rad/s: how far the start may be off the joints
_COMES = "nominal, slots, draws = vector(a, 0), indices(a, 1), table(a, 2)"
_STEPS = (
    "steps, usual, pace = indices(a, 3), vector(a, 4), vector(a, 13)",
    "times, methods = indices(a, 14), indices(a, 15)",
)
_GOES = "draws, outcomes, ends, status = table(a, 2), table(a, 6), table(a, 7), indices(a, 9)"


def emit_block(out: Text, c: Context) -> None:
    """The function that flies a block, with its arrays in the order of
    `sepmc.engine.blocks.integrate`, and those that it calls between steps: a piece that an output
    changes is the shorter to compile."""
    parts = Text()
    _begin(parts, c)
    says = (
        "Fly the cases of a block, LANES from number ``first`` on; ``a`` holds the arrays that "
        "come in and go out."
    )
    block = Text()
    text = block.function("integrate_block(w, first: int, a: Arrays)", says)
    text(*_STEPS, "load_cases(w, first, a)")
    for number, segment in enumerate(c.spec.segments):
        text(f"# {segment.name}", f"enter_{segment.name}(w)")
        _enter(parts, c, number, segment)
        if segment.max_intervals > 1:
            _stretch(text.block(f"for _ in range({segment.max_intervals}):"), c, number, segment)
        else:
            _stretch(text, c, number, segment)
        text(f"leave_{segment.name}(w)")
        _leave(parts, c, number, segment)
    text("write_results(w, first, a)")
    says = "Outcomes of a block, and what is told of its cases, into the arrays that go out."
    results = parts.function("write_results(w, first: int, a: Arrays)", says)
    results(_GOES)
    emit_results(results, c)
    out.lines += parts.lines + block.lines


def _begin(out: Text, c: Context) -> None:
    """The function that puts the cases of a block into the workspace, as they start."""
    text = out.function(
        "load_cases(w, first: int, a: Arrays)",
        "Put the cases of a block into the workspace, as they start.",
    )
    text(_COMES, "numbers = vector(a, 12)")
    text.block("for k in range(SIZE_SHARED):")("w[SHARED + k] = numbers[k]")
    text.block("for k in range(nominal.shape[0]):").lanes()("w[P + k * LANES + l] = nominal[k]")
    text.lanes()("w[NOT_FINITE + l] = 0.0")
    text.block("for k in range(slots.shape[0]):")(
        "get_column(w, P + slots[k] * LANES, draws, k, first)",
        "for l in range(LANES):  # not 0 if a number is not finite",
        "    w[NOT_FINITE + l] += w[P + slots[k] * LANES + l] - w[P + slots[k] * LANES + l]",
    )
    text("prepare(w)")
    for field in tip_offs(c):
        c.workspace.add(field, 3, optional=True)
        text.block("for e in range(3 * LANES):")(f"w[{field} + e] = math.nan")
    for event in c.spec.scene.event:
        c.workspace.add(kept(event.name), c.size + 2 * len(c.spec.bodies), optional=True)
        text.block(f"for e in range({c.workspace.counts[kept(event.name)]} * LANES):")(
            f"w[{kept(event.name)} + e] = math.nan"
        )
    if c.history == at.FULL_HISTORY:
        c.workspace.add("WANTS_ROWS", 1, optional=True)
        text.lanes()("w[WANTS_ROWS + l] = 1.0 if table(a, 5).shape[0] > 0 else 0.0")
    if c.spec.layer_borders:
        text("enter_layers(w)")
    if c.spec.layer_borders or c.workspace.has("AIR"):
        text("recentre_air(w, 0.0)")
    if c.spec.load_switches:
        text.lanes().block("for k in range(nominal.shape[0]):")(
            f"w[CASES + {int(c.model.size_w)} * l + k] = w[P + k * LANES + l]"
        )
    text(f"energy_{c.spec.segments[0].name}(w, 1.0)")


def _enter(out: Text, c: Context, number: int, segment: Segment) -> None:
    """The function of what is so as a phase begins."""
    text = out.function(f"enter_{segment.name}(w)", "What is so as a phase begins.")
    if number == 0 and segment.rows:
        text(f"correct_{segment.name}(w)")
        _check_start(text, c)
    if number == 0 and any(GROUND in group and len(group) > 1 for group in segment.groups):
        _stand_still(text, c)
    if number and segment.end_time:
        _begin_timed(text, c, segment)
    if segment.late:
        _begin_late(text, c, segment)
    _forget_sides(text, c, segment)
    if segment.pending_event:
        text(f"pending_event_{segment.name}(w, 1.0)")
    if segment.releases:
        _note_told(text, c, segment)
    if segment.variable_joints:
        _let_go(text, c, segment)
    if segment.max_intervals > 1:
        text.lanes()("w[DONE + l] = 0.0")
        if segment.clauses:
            _begin_clauses(text, c, segment)


def _leave(out: Text, c: Context, number: int, segment: Segment) -> None:
    """The function of what is so as a phase ends."""
    text = out.function(f"leave_{segment.name}(w)", "What is so as a phase ends.")
    if segment.rows:
        text(f"correct_{segment.name}(w)")
        text.block("for e in range(4 * LANES):")(
            "w[RESIDUAL + e] = larger(w[RESIDUAL + e], w[RESIDUAL_NOW + e])"
        )
    scope = c.scope()
    c.workspace.add(f"ENDED_{segment.name}", 1)
    if number:
        reject_unless(
            scope,
            scope.load("T") >= scope.load(f"ENDED_{c.spec.segments[number - 1].name}") - _SAME_TIME,
        )
    scope.store(f"ENDED_{segment.name}", scope.load("T"))
    scope.write(text)
    if number + 1 < len(c.spec.segments):
        _hand_over(text, c, segment, c.spec.segments[number + 1])
    elif c.spec.initial_kinds:
        _note_unreleased(text, c)


def _note_unreleased(text: Text, c: Context) -> None:
    """Whether a joint still holds at the end that was told to let go, or should have been."""
    scope = c.scope()
    for joint in c.spec.initial_kinds:
        for change in c.spec.changes_of(joint):
            holds = _kind(scope, c, joint) < float(change.to)
            if change.optional:
                holds = holds & (_comes(scope, c, change) < math.inf)
            scope.store("UNRELEASED", where(holds, 1.0, scope.load("UNRELEASED")))
    scope.write(text)


def _kind(scope: Scope, c: Context, joint: str) -> Expr:
    """As which of its kinds a joint holds, by number."""
    c.start(f"KIND_{joint}", float(c.spec.initial_kinds[joint]))
    return scope.load(f"KIND_{joint}")


def _comes(scope: Scope, c: Context, change: Change) -> Expr:
    """When an event came that tells a joint to let go."""
    c.start(f"EVENT_TIME_{change.event}", math.inf)
    return scope.load(f"EVENT_TIME_{change.event}")


def _due(scope: Scope, c: Context, segment: Segment, joint: str) -> Iterator[tuple[Change, Expr]]:
    """Changes that a joint may make in a segment, and when each is due."""
    slots = c.spec.layout.slots
    delay = c.case.number(slots[f"joint.{joint}.delay"])
    if joint in c.spec.failing_joints:  # it never lets go
        delay = where(c.case.number(slots[f"joint.{joint}.fails"]) >= 0.5, math.inf, delay)
    for change in c.spec.changes_of(joint):
        if change.to in segment.joint_kinds[joint] and change.to > min(segment.joint_kinds[joint]):
            yield change, _comes(scope, c, change) + delay


def _forget_sides(text: Text, c: Context, segment: Segment) -> None:
    """On which side of its threshold a load is, is new to a phase that waits for it to cross it."""
    for load in segment.loads:
        if load.direction and not load.any_phase:
            text.lanes()(f"w[{side_before(segment, load)} + l] = 0.0")


def _begin_clauses(text: Text, c: Context, segment: Segment) -> None:
    """None of several conditions is met, but for times that are past."""
    scope = c.scope()
    for number in condition_numbers(segment.clauses):
        c.workspace.add(condition_flag(segment.name, number), 1)
        scope.store(condition_flag(segment.name, number), 0.0)
    scope.write(text)
    _note_clauses(text, c, segment)


def _note_clauses(text: Text, c: Context, segment: Segment) -> None:
    """Which of several conditions are times that have come, and whether a phase is at its end."""
    scope = c.scope()
    done = (scope.load("DONE") > 0.0) | _holds(scope, c, segment.name, segment)
    scope.store("DONE", where(done, 1.0, 0.0))
    scope.write(text)


def _holds(
    scope: Scope,
    c: Context,
    segment: str,
    told: Segment | Release,
) -> Expr:
    """Whether any of the clauses of what is told is met, each all of conditions; of these, times
    that have come and ends of springs are noted."""
    flags = {}
    for number in condition_numbers(told.clauses):
        flags[number] = scope.load(condition_flag(segment, number)) > 0.0
    for number, comes in _comes_now(scope, c, told):
        flags[number] = flags[number] | comes
        scope.store(condition_flag(segment, number), where(flags[number], 1.0, 0.0))
    found = None
    for clause in told.clauses:
        together = flags[clause[0]]
        for number in clause[1:]:
            together = together & flags[number]
        found = together if found is None else found | together
    assert found is not None
    return found


def _comes_now(scope: Scope, c: Context, told: Segment | Release) -> Iterator[tuple[int, Expr]]:
    """Conditions, by number, that no step is aimed at, for time or a spring tell: whether each
    holds."""
    now = scope.load("T")
    for number, due in told.times.items():
        yield number, now >= _time(scope, c, due) - _SAME_TIME
    for number, spring in told.springs.items():
        c.start(stroke_flag(spring), 0.0)
        yield number, scope.load(stroke_flag(spring)) > 0.0


def _time(scope: Scope, c: Context, due: Due) -> Expr:
    """When something is due."""
    terms = [c.case.number(place) for place in due.slots]
    for motor in c.spec.triggered_motors:
        if motor.name == due.motor:
            terms.insert(0, ignition(scope, c, motor))
    return total(terms)


def _note_told(text: Text, c: Context, segment: Segment) -> None:
    """Which releases apart from phases have come, and instants that are told of, with the state
    then."""
    scope = c.scope()
    for release in segment.releases:
        for number in condition_numbers(release.clauses):
            c.start(condition_flag(ANY_PHASE, number), 0.0)
        place = f"EVENT_TIME_{release.name}"
        c.start(place, math.inf)
        told = _holds(scope, c, ANY_PHASE, release) & scope.load(place).equals(math.inf)
        scope.store(place, where(told, scope.load("T"), scope.load(place)))
        if not release.joint:
            c.workspace.add(f"OCCURS_NOW_{release.name}", 1)
            scope.store(f"OCCURS_NOW_{release.name}", where(told, 1.0, 0.0))
    scope.write(text)
    for release in segment.releases:
        if not release.joint:
            _keep_state(text, c, segment, release.name)


def _keep_state(text: Text, c: Context, segment: Segment, event: str) -> None:
    """Lines that keep the state of the lanes in which an event comes now: of every body that turns
    by itself in the end, its attitude and its angles, whoever leads it now."""
    place = kept(event)
    text.block(f"for k in range({c.size}):").lanes()(
        f"w[{place} + k * LANES + l] = w[Y + k * LANES + l] "
        f"if w[OCCURS_NOW_{event} + l] > 0.0 else w[{place} + k * LANES + l]"
    )
    scope = c.scope()
    now = scope.load(f"OCCURS_NOW_{event}") > 0.0
    for body in c.spec.segments[-1].leaders:
        leader = segment.leader(body)
        if leader == GROUND:
            values: list[tuple[str, int, Any]] = [
                (f"{place} + Q_{body}", 4, c.case.attitude),
                (f"{place} + OMEGA_{body}", 3, ZERO),
            ]
            angles = [c.case.number(at.PITCH), c.case.number(at.ROLL)]
        else:
            values = [
                (f"{place} + Q_{body}", 4, scope.load(f"Y + Q_{leader}", 4)),
                (f"{place} + OMEGA_{body}", 3, scope.load(f"Y + OMEGA_{leader}", 3)),
            ]
            angles = [scope.load(component(f"ANGLES_{leader}", k)) for k in range(2)]
        if leader != body:
            for field, count, value in values:
                for k in range(count):
                    scope.store(
                        component(field, k), where(now, value[k], scope.load(component(field, k)))
                    )
        for k, value in enumerate(angles):
            angle = kept_angle(c, event, body, k)
            scope.store(angle, where(now, value, scope.load(angle)))
    scope.write(text)


def _check_start(text: Text, c: Context) -> None:
    """Whether the joints allow the start."""
    scope = c.scope()
    for k in range(4):
        reject_unless(
            scope,
            scope.load(component("RESIDUAL_NOW", k)) <= _CONSISTENT,
            Status.INCONSISTENT_START,
        )
    scope.write(text)


def _begin_timed(text: Text, c: Context, segment: Segment) -> None:
    """A time that is past as its phase begins ends it at once; a joint that lets go late is late
    from then on."""
    scope, time = c.scope(), total([c.case.number(place) for place in segment.end_time])
    now = scope.load("T")
    if segment.after_late:  # its end came while a late joint held on
        reject_unless(
            scope, (time >= now - _SAME_TIME) | (scope.load("UNRELEASED") > 0.0), Variant.ANY_ORDER
        )
    until = scalar.larger(time, now)
    scope.store(
        f"UNTIL_{segment.name}",
        until if segment.delay is None else until + c.case.number(segment.delay),
    )
    scope.write(text)


def _begin_late(text: Text, c: Context, segment: Segment) -> None:
    """The last of late joints to let go ends the segment."""
    scope = c.scope()
    first, *others = (c.case.number(place) for place in segment.late.values())
    last = functools.reduce(scalar.larger, others, first)
    c.workspace.add(f"UNTIL_{segment.name}", 1)
    scope.store(f"UNTIL_{segment.name}", scope.load("T") + last)
    scope.write(text)


def _stand_still(text: Text, c: Context) -> None:
    """A start may not turn where a joint holds the vehicle's attitude to the ground: rows that
    would tell are left out."""
    scope = c.scope()
    omega = c.case.vector(at.OMEGA)
    reject_unless(scope, vec3.dot(omega, omega) <= _CONSISTENT**2, Status.INCONSISTENT_START)
    scope.write(text)


def _stretch(text: Text, c: Context, number: int, segment: Segment) -> None:
    """Flight to the end of a phase, or to the next event or switch of a load within it."""
    scope = c.scope()
    now, run_end = scope.load("T"), scope.load("RUN_END")
    end = (
        scalar.larger(scope.load(f"UNTIL_{segment.name}"), now) if segment.ends_by_time else run_end
    )
    if segment.max_intervals > 1:
        end = where(scope.load("DONE") > 0.0, now, end)
    else:
        scope.store("DONE", 0.0)
    for joint in segment.variable_joints:
        for change, due in _due(scope, c, segment, joint):
            waits = _kind(scope, c, joint) < float(change.to)
            end = where(waits & (due < end), scalar.larger(due, now), end)
    times = [(condition_flag(segment.name, number), due) for number, due in segment.times.items()]
    times += [
        (condition_flag(ANY_PHASE, number), due)
        for release in segment.releases
        for number, due in release.times.items()
    ]
    for flag, instant in times:
        comes, waits = _time(scope, c, instant), scope.load(flag).equals(0.0)
        end = where(
            waits & (scope.load("DONE").equals(0.0)) & (comes < end), scalar.larger(comes, now), end
        )
    scope.store("END", where(end < run_end, end, run_end))
    scope.store("MAX_NEXT_STEP", math.inf)
    note_ignitions(scope, c)
    for event in segment.events:
        scope.store(f"PREVIOUS_{segment.name}_{event.name}", math.inf)
    scope.write(text)
    if c.spec.load_switches:
        text("next_load_switch(w, a)")
    if segment.max_intervals > 1:
        text("going = False")
        text.lanes()("going = going or w[T + l] < w[END + l]")
        text.block("if not going:")("break")
    if c.has_lane_steps(segment):
        _at_a_pace(text, c, number, segment)
    else:
        _in_steps(text, c, number, segment)
    if segment.events:
        text(f"set_event_flags(w, {number})")
    elif segment.may_end_by_load:
        text.lanes()(f"w[T + l] = w[END + l] if w[END + l] - w[T + l] <= {at.GRAIN} else w[T + l]")
    else:
        text.lanes()("w[T + l] = w[END + l]")
    if segment.clauses:
        _note_clauses(text, c, segment)
    if segment.releases:
        _note_told(text, c, segment)
    if segment.variable_joints:
        _let_go(text, c, segment)


def _in_steps(text: Text, c: Context, number: int, segment: Segment) -> None:
    """As many steps for all lanes."""
    size, awaited, noted = (
        f"{c.spec.active_size(segment)} * LANES",
        _awaited(segment),
        _noted(c, number),
    )
    inner = text.block(f"for left in range(steps[{number}], 0, -1):")
    _advance(inner, c, number, segment, "left")
    inner(*awaited)
    if has_tables(c.spec) or any(joint.guide is not None for joint in c.spec.scene.joint.values()):
        inner("going = False")
        inner.lanes()(f"going = going or {_GOES_ON}")
        inner.block("if not going:")("break")
    if not segment.events:
        inner(*noted)
        return
    if noted:
        inner.block("if left > 1:")(*noted)
    # of the last step only what comes before the event counts
    text(f"polish_event(w, {number}, {size})", *awaited, *noted)


def _at_a_pace(text: Text, c: Context, number: int, segment: Segment) -> None:
    """Each lane in as many steps as it needs for none to be longer than its pace, so many times,
    but in no more than the phase has."""
    size, awaited = f"{c.spec.active_size(segment)} * LANES", _awaited(segment)
    inner = text.lanes()
    inner(f"w[MAX_STEP + l] = pace[{number}] if pace[{number}] > 0.0 else {at.GRAIN}")
    inner(
        "w[STEP_FACTOR + l], w[STEPS_LEFT + l], w[PROGRESS + l] = "
        f"float(times[0]), 1.0 + steps[{number}], 0.0"
    )
    if segment.may_end_by_load:
        inner(
            f"w[TYPICAL_END + l] = w[T + l] + max(usual[{number}], "
            f"{_LEAST_SHARE} * (w[END + l] - w[T + l]))"
        )
    text("going = True")
    inner = text.block("while going:")
    _advance(inner, c, number, segment, "1")
    inner(*([f"stop_at_load_{segment.name}(w)"] if segment.loads else []), *awaited)
    if segment.events:
        inner("arrive = False")
        inner.lanes()("arrive = arrive or w[PROGRESS + l] == 1.0")
        inner.block("if arrive:")(f"polish_event(w, {number}, {size})", *awaited)
    inner(*_noted(c, number), "going = False")
    inner.lanes()(f"going = going or (w[PROGRESS + l] < 1.0 and {_GOES_ON})")


def _advance(text: Text, c: Context, number: int, segment: Segment, left: str) -> None:
    """A step of a phase, by the method that is asked for if it has several."""
    methods = c.methods(segment)
    if c.history == at.SEPARATION_HISTORY:
        text.block("for e in range(SIZE_Y):")("w[BEGIN + e] = w[Y + e]")
        text.lanes()("w[BEGIN_T + l] = w[T + l]")
    for k, rk in enumerate(methods):
        inner = text
        if len(methods) > 1:
            inner = text.block(f"{'elif' if k else 'if'} methods[{number}] == {k}:")
        size = f"{c.spec.active_size(segment)} * LANES"
        inner(f"{advance(rk)}(w, {number}, {size}, {left}, usual[{number}])")
        if c.history == at.SEPARATION_HISTORY:
            inner(f"{fit_curves(rk)}(w, {number})")


def _awaited(segment: Segment) -> list[str]:
    """What looks for the condition that ends the next phase, if it is waited for meanwhile."""
    return [f"pending_event_{segment.name}(w, 0.0)"] if segment.pending_event else []


def _let_go(text: Text, c: Context, segment: Segment) -> None:
    """Joints change that are due to, and what is noted of that."""
    scope = c.scope()
    now = scope.load("T")
    for joint in segment.variable_joints:
        before = kind = _kind(scope, c, joint)
        for change, due in _due(scope, c, segment, joint):
            kind = where(
                (now >= due - _SAME_TIME) & (kind < float(change.to)), float(change.to), kind
            )
        scope.store(f"KIND_{joint}", kind)
        _note_change(scope, c, joint, before, kind)
        for free in segment.free_kinds(joint):
            _note_release(scope, c, segment, joint, (before < float(free)) & (kind >= float(free)))
    scope.write(text)


def _note_change(scope: Scope, c: Context, joint: str, before: Expr, kind: Expr) -> None:
    """For rows of a history on both sides of it: when a joint takes another of its kinds."""
    for changing, number in c.spec.kind_changes if c.change_times else []:
        if changing == joint:
            place = went(joint, number)
            c.start(place, math.nan)
            goes = (before < float(number)) & (kind >= float(number))
            scope.store(place, where(goes, scope.load("T"), scope.load(place)))


def _note_release(
    scope: Scope, c: Context, segment: Segment, joint: str, goes: Expr | None
) -> None:
    """A joint becomes free, in all cases or in those in which it ``goes``, that have got so far:
    when, and the rates of its bodies if they are asked for."""
    c.start(f"RELEASE_{joint}", math.nan)
    in_time = scope.load("UNRELEASED").equals(0.0)
    goes = in_time if goes is None else goes & in_time
    noted = [(f"RELEASE_{joint}", scope.load("T"))]
    for place, rate in _tip_off(scope, c, segment, joint):
        noted += [(component(place, k), rate[k]) for k in range(3)]
    for place, now in noted:
        scope.store(place, where(goes, now, scope.load(place)))


def _tip_off(scope: Scope, c: Context, segment: Segment, joint: str) -> Iterator[tuple[str, Any]]:
    """Workspace for the rates of the bodies of a joint that becomes free, if they are asked for,
    and these rates."""
    if joint in c.spec.scene.output.tip_off:
        for body in c.spec.scene.joint[joint].bodies:
            if body != GROUND:
                leader = segment.leader(body)
                yield (
                    tip_off(joint, body),
                    ZERO if leader == GROUND else scope.load(f"Y + OMEGA_{leader}", 3),
                )


def _noted(c: Context, number: int) -> list[str]:
    """What is written or followed of a step of a phase."""
    segment = c.spec.segments[number]
    found = [f"write_history(w, {number}, first, a)"] if c.history else []
    found += [f"monitor_loads(w, {number})"] if c.monitors_outputs(segment) else []
    return found + (
        [f"search_clearances_{segment.name}(w)"] if c.active_clearances(segment) else []
    )


def emit_load_switch(out: Text, c: Context) -> None:
    """A function that ends a stretch at the next switch of a load, and notes what acts until
    then."""
    if not c.spec.load_switches:
        return
    says = "Stop at the next switch of a load, and note what acts until then."
    c.workspace.add("CASES", int(c.model.size_w))  # as `sepmc.routines.load_intervals` reads them
    text = out.function("next_load_switch(w, a: Arrays)", says)
    text("m = Model(record(a, 10), indices(a, 11), vector(a, 12))")
    text = text.lanes()
    text(f"case = CASES + {int(c.model.size_w)} * l", "t = w[T + l]")
    for i, motor in enumerate(c.spec.scene.motor):
        if motor.trigger is not None:
            p = int(c.model.motors_p) + at.MOTOR_SIZE * i
            text(f"w[case + {p + at.IGNITION}] = w[{lights(motor.name)} + l]")
            text(f"w[case + {p + at.IGNITION_DELAY}] = 0.0")
    text("end = min(w[END + l], next_load_switch(t, m, w, case))", "w[END + l] = end")
    text("set_active_loads(0.5 * (t + end), m, w, case)")
    for i, motor in enumerate(c.spec.scene.motor):
        c.workspace.add(f"BURNING_{motor.name}", 3)
        work = int(c.model.motors_w) + at.MOTOR_WORK * i
        text(f"put3(w, BURNING_{motor.name} + l, vec3.get(w, case + {work + at.BURNING}))")
    for i, load in enumerate(c.spec.scene.load):
        c.workspace.add(f"ACTS_{load.name}", 1)
        work = int(c.model.loads_w) + at.LOAD_WORK * i
        text(f"w[ACTS_{load.name} + l] = w[case + {work + at.ACTS}]")


def _hand_over(text: Text, c: Context, segment: Segment, after: Segment) -> None:
    """From a phase to the next: who did not get there before the end, attitudes of bodies that
    component, what is noted of a release."""
    scope = c.scope()
    now = scope.load("T")
    ended = (
        scope.load("DONE") > 0.0
        if segment.ends_by_state
        else now >= scope.load(f"UNTIL_{segment.name}")
    )
    reject_unless(scope, ended | (now >= scope.load("RUN_END")))
    scope.store("UNRELEASED", where(ended, scope.load("UNRELEASED"), 1.0))
    for leader in after.leaders:
        old = segment.leader(leader)
        if leader not in segment.leaders and old != GROUND:
            for field, count in (("Y + Q", 4), ("Y + OMEGA", 3)):
                scope.store(f"{field}_{leader}", scope.load(f"{field}_{old}", count))
            for field, count in (("ANGLES", 2), ("HEADING", 4), ("LAST_RATE", 3)):
                for k in range(count):
                    scope.store(
                        component(f"{field}_{leader}", k),
                        scope.load(component(f"{field}_{old}", k)),
                    )
    for told in c.spec.changes:
        if told.event == segment.phase and not segment.late and told.joint in c.spec.initial_kinds:
            scope.store(f"EVENT_TIME_{told.event}", where(ended, now, _comes(scope, c, told)))
    for joint, kinds in after.joint_kinds.items():
        masked, to = joint in c.spec.initial_kinds, min(kinds)
        if segment.constrains(joint) and not kinds[to]:
            _note_release(
                scope, c, segment, joint, _kind(scope, c, joint) < float(to) if masked else None
            )
        if masked and to > min(segment.joint_kinds[joint]):
            kind = _kind(scope, c, joint)
            changed = where(ended & (kind < float(to)), float(to), kind)
            scope.store(f"KIND_{joint}", changed)
            _note_change(scope, c, joint, kind, changed)
    scope.write(text)
