"""Emitter of the entry of a kernel, which integrates a block of cases: the loop over segments and
intervals, transitions between segments, and results."""

import functools
import math

from sepmc.kernel.emit.clauses import due_time, record_events, reset_clauses, update_clauses
from sepmc.kernel.emit.context import Context, component, reject_unless
from sepmc.kernel.emit.history import fit_curves
from sepmc.kernel.emit.ignition import ignition_time, store_ignitions
from sepmc.kernel.emit.joint_changes import (
    due_changes,
    event_time,
    flag_unreleased,
    kind_of,
    record_change,
    record_release,
    release_joints,
)
from sepmc.kernel.emit.monitor import load_side
from sepmc.kernel.emit.outcomes import (
    emit_results,
    event_field,
    time_fields,
    tip_off_fields,
)
from sepmc.kernel.emit.samples import next_samples, take_samples
from sepmc.kernel.emit.steps import advance
from sepmc.kernel.emit.tables import has_tables
from sepmc.kernel.spec.kernel_spec import (
    ANY_PHASE,
    Segment,
    condition_flag,
)
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import scalar, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status

# code of the condition that the case of a lane has no final status: a case that is rejected only
# for this variant or these steps (negative status) goes on
_CONTINUES = "w[REJECTED + l] <= 0.0"
# minimum length of an interval that a joint load may end, as a fraction of the time left
_MIN_FRACTION = 2.0**-16
_SHORTEST_S = 100.0 * at.GRAIN
_CONSISTENT = 1e-9  # m, rad, m/s, rad/s: tolerated joint residuals at the start
_INPUTS = "nominal, slots, draws = vector(a, 0), indices(a, 1), table(a, 2)"
_STEPS = (
    "steps, typical, max_step = indices(a, 3), vector(a, 4), vector(a, 13)",
    "step_factor, methods = indices(a, 14), indices(a, 15)",
)
_OUTPUTS = "draws, outcomes, ends, status = table(a, 2), table(a, 6), table(a, 7), indices(a, 9)"


def emit_block(out: Text, c: Context) -> None:
    """Write the kernel functions ``integrate_block(w, first, a)``, the entry of a kernel, and those
    that it calls to load cases, to begin and end segments and to write results.

    ``w`` is the workspace, ``first`` the number of the block's first case, ``a`` the input and
    output arrays in the order of `sepmc.engine.blocks.integrate`. The functions are short, so that
    a scene with one more output has few compile units to compile again.
    """
    functions = Text()
    _begin(functions, c)
    docstring = (
        "Integrate the cases of a block, LANES from number ``first`` on; ``a`` holds the input "
        "and output arrays."
    )
    block = Text()
    text = block.function("integrate_block(w, first: int, a: Arrays)", docstring)
    text(*_STEPS, "load_cases(w, first, a)")
    for number, segment in enumerate(c.spec.segments):
        text(f"# {segment.name}", f"enter_{segment.name}(w)")
        _enter(functions, c, number, segment)
        if segment.max_intervals > 1:
            _interval(text.block(f"for _ in range({segment.max_intervals}):"), c, number, segment)
        else:
            _interval(text, c, number, segment)
        text(f"leave_{segment.name}(w)")
        _leave(functions, c, number, segment)
    text("write_results(w, first, a)")
    docstring = "Write outcomes, segment ends and status of the cases into the output arrays."
    results = functions.function("write_results(w, first: int, a: Arrays)", docstring)
    results(_OUTPUTS)
    emit_results(results, c)
    out.lines += functions.lines + block.lines


def _begin(out: Text, c: Context) -> None:
    """Write the kernel function ``load_cases(w, first, a)`` (arguments as in `emit_block`), which
    loads the parameters of a block's cases into the workspace and prepares the start of the
    cases. Lanes beyond the last case get the inputs of the last case."""
    text = out.function(
        "load_cases(w, first: int, a: Arrays)",
        "Load the parameters of the cases into the workspace and prepare their start.",
    )
    text(_INPUTS, "numbers = vector(a, 12)")
    text.block("for k in range(SIZE_SHARED):")("w[SHARED + k] = numbers[k]")
    text.block("for k in range(nominal.shape[0]):").lanes()("w[P + k * LANES + l] = nominal[k]")
    text.lanes()("w[NOT_FINITE + l] = 0.0")
    text.block("for k in range(slots.shape[0]):")(
        "get_column(w, P + slots[k] * LANES, draws, k, first)",
        "for l in range(LANES):  # not 0 for NaN and inf",
        "    w[NOT_FINITE + l] += w[P + slots[k] * LANES + l] - w[P + slots[k] * LANES + l]",
    )
    text("prepare(w)")
    for field, count in [*((field, 3) for field in tip_off_fields(c)), *time_fields(c)]:
        c.workspace.add(field, count, optional=True)
        text.components(f"{count} * LANES")(f"w[{field} + e + l] = math.nan")
    for event in c.spec.scene.event:
        c.workspace.add(event_field(event.name), c.size + 2 * len(c.spec.bodies), optional=True)
        text.components(f"{c.workspace.counts[event_field(event.name)]} * LANES")(
            f"w[{event_field(event.name)} + e + l] = math.nan"
        )
    if c.history == at.FULL_HISTORY:
        c.workspace.add("WANTS_ROWS", 1, optional=True)
        text.lanes()("w[WANTS_ROWS + l] = 1.0 if table(a, 5).shape[0] > 0 else 0.0")
    if c.spec.layer_borders:
        text("enter_layers(w)")
    if c.spec.layer_borders or c.workspace.has("AIR"):
        text("recentre_air(w, 0.0)")
    if c.spec.formulas.sampled:
        text(take_samples(c.spec.segments[0]))
    if c.spec.formulas.kinks:
        text("set_modes(w)")
    if c.spec.load_switches:
        text.lanes().block("for k in range(nominal.shape[0]):")(
            f"w[CASES + {int(c.model.size_w)} * l + k] = w[P + k * LANES + l]"
        )
    text(f"energy_{c.spec.segments[0].name}(w, 1.0)")


def _enter(out: Text, c: Context, number: int, segment: Segment) -> None:
    """Write the kernel function ``enter_SEGMENT(w)``, which begins segment ``number``: it sets end
    times and flags and makes changes of joints that are due. In the first segment (``number`` 0)
    it also calls ``correct_SEGMENT`` (`emit_correct`), rejects cases whose start violates the
    joints, and loads the first cells of tables with kinks."""
    text = out.function(
        f"enter_{segment.name}(w)", "Begin a phase: check the start, set end times and flags."
    )
    if number == 0 and segment.rows:
        text(f"correct_{segment.name}(w)")
        _check_start(text, c)
    if number == 0 and any(GROUND in group and len(group) > 1 for group in segment.groups):
        _check_rotation(text, c)
    if number and segment.end_time:
        _begin_timed(text, c, segment)
    if segment.late:
        _begin_delayed(text, c, segment)
    _reset_load_sides(text, segment)
    if number == 0 and any(event.is_cell_end for event in segment.events):
        _enter_first_cells(text, c, segment)
    if segment.pending_event:
        text(f"pending_event_{segment.name}(w, 1.0)")
    if segment.releases:
        record_events(text, c, segment)
    if segment.variable_joints:
        release_joints(text, c, segment)
    if segment.max_intervals > 1:
        text.lanes()("w[DONE + l] = 0.0")
        if segment.clauses:
            reset_clauses(text, c, segment)


def _enter_first_cells(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that, at the start of a case, load the cells of tables with kinks: first those
    that contain the tables' arguments, then, for an argument at the end of a cell, the cell that it
    moves into. The rates of the arguments are computed with all motors and constant loads off if
    the scene has any that switches."""
    switched = [(f"BURNING_{motor.name}", 3) for motor in c.spec.scene.motor]
    switched += [(f"ACTS_{load.name}", 1) for load in c.spec.scene.load]
    for name, count in switched if c.spec.load_switches else []:
        c.workspace.add(name, count)
        text.components(f"{count} * LANES")(f"w[{name} + e + l] = 0.0")
    text.components("SIZE_Y")("w[K1 + e + l] = 0.0")
    text(f"table_rates_{segment.name}(w)", f"enter_cells_{segment.name}(w, 0.0)")
    text.components("SIZE_Y")("w[S + e + l] = w[Y + e + l]")
    text.lanes()("w[CLOCK + l] = w[T + l]")
    text(f"rates_{segment.name}(w)")
    text.components("SIZE_Y")("w[K1 + e + l] = w[D + e + l]")
    text(f"table_rates_{segment.name}(w)", f"enter_cells_{segment.name}(w, 1.0)")


def _leave(out: Text, c: Context, number: int, segment: Segment) -> None:
    """Write the kernel function ``leave_SEGMENT(w)``, which ends segment ``number``: it projects
    the state onto the constraints, records the end time, rejects cases in which that is before the
    end of the previous segment, and hands over to the next segment or, at the end of the last one,
    flags cases with joints that have not been released."""
    text = out.function(
        f"leave_{segment.name}(w)",
        "End a phase: project onto the constraints, record its end, hand over to the next.",
    )
    if segment.rows:
        text(f"correct_{segment.name}(w)")
        text.components("4 * LANES")(
            "w[RESIDUAL + e + l] = larger(w[RESIDUAL + e + l], w[RESIDUAL_NOW + e + l])"
        )
    scope = c.scope()
    c.workspace.add(f"ENDED_{segment.name}", 1)
    if number:
        reject_unless(
            scope,
            scope.load("T") >= scope.load(f"ENDED_{c.spec.segments[number - 1].name}") - at.GRAIN,
        )
    scope.store(f"ENDED_{segment.name}", scope.load("T"))
    scope.write(text)
    if number + 1 < len(c.spec.segments):
        _hand_over(text, c, segment, c.spec.segments[number + 1])
    elif c.spec.initial_kinds:
        flag_unreleased(text, c)


def _reset_load_sides(text: Text, segment: Segment) -> None:
    """Append lines that, at the start of a segment, set the side field (`load_side`) of load
    conditions to 0, not known. They do so for conditions that end the phase and have a crossing
    direction; those of releases and events keep their side from segment to segment."""
    for load in segment.loads:
        if load.direction and not load.any_phase:
            text.lanes()(f"w[{load_side(segment, load)} + l] = 0.0")


def _check_start(text: Text, c: Context) -> None:
    """Append lines that reject cases whose initial state violates constraint rows by more than the
    tolerance (status inconsistent-start). They read the residuals in RESIDUAL_NOW, which
    ``correct_SEGMENT(w)`` stores: its call must come before them."""
    scope = c.scope()
    for k in range(4):
        reject_unless(
            scope,
            scope.load(component("RESIDUAL_NOW", k)) <= _CONSISTENT,
            Status.INCONSISTENT_START,
        )
    scope.write(text)


def _begin_timed(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that, as a segment begins, set its end time (the field ``UNTIL_SEGMENT``): the
    time at which its condition is met (a sum of parameters) or, if that is past, the present time;
    plus the release delay of the segment, if any. Cases in which the end came while the delayed
    releases of the segment before were pending are rejected (`Variant.ANY_ORDER`)."""
    scope, time = c.scope(), total([c.case.number(slot) for slot in segment.end_time])
    now = scope.load("T")
    if segment.after_late:  # its end came during a release delay
        reject_unless(
            scope, (time >= now - at.GRAIN) | (scope.load("UNRELEASED") > 0.0), Variant.ANY_ORDER
        )
    until = scalar.larger(time, now)
    scope.store(
        f"UNTIL_{segment.name}",
        until if segment.delay is None else until + c.case.number(segment.delay),
    )
    scope.write(text)


def _begin_delayed(text: Text, c: Context, segment: Segment) -> None:
    """Append lines that, as a segment of delayed releases begins, set its end time (the field
    ``UNTIL_SEGMENT``): the present time plus the longest of the delays."""
    scope = c.scope()
    first, *others = (c.case.number(slot) for slot in segment.late.values())
    last = functools.reduce(scalar.larger, others, first)
    c.workspace.add(f"UNTIL_{segment.name}", 1)
    scope.store(f"UNTIL_{segment.name}", scope.load("T") + last)
    scope.write(text)


def _check_rotation(text: Text, c: Context) -> None:
    """Append lines that reject cases with an initial angular rate (status inconsistent-start). They
    are for a scene in which a joint fixes the attitude of the vehicle to the ground; this function
    does not check that. Rotation rows within a rigid group are left out, so no residual shows the
    rate."""
    scope = c.scope()
    omega = c.case.vector(at.OMEGA)
    reject_unless(scope, vec3.dot(omega, omega) <= _CONSISTENT**2, Status.INCONSISTENT_START)
    scope.write(text)


def _interval(text: Text, c: Context, number: int, segment: Segment) -> None:
    """Append lines that integrate one interval: to the end of segment ``number``, or to the next
    event, time condition, load switch, release or sample of a signal within it; and that then
    update the conditions and make the changes of joints that are due."""
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
        for change, due in due_changes(scope, c, segment, joint):
            pending = kind_of(scope, c, joint) < float(change.to)
            end = where(pending & (due < end), scalar.larger(due, now), end)
    times = [(condition_flag(segment.name, number), due) for number, due in segment.times.items()]
    times += [
        (condition_flag(ANY_PHASE, number), due)
        for release in segment.releases
        for number, due in release.times.items()
    ]
    for flag, instant in times:
        due, pending = due_time(scope, c, instant), scope.load(flag).equals(0.0)
        end = where(
            pending & (scope.load("DONE").equals(0.0)) & (due < end),
            scalar.larger(due, now),
            end,
        )
    for due in next_samples(scope, c):
        waits = (scope.load("DONE").equals(0.0)) & (due < end)
        end = where(waits, scalar.larger(due, now), end)
    scope.store("END", where(end < run_end, end, run_end))
    scope.store("MAX_NEXT_STEP", math.inf)
    if c.monitors_loads(segment):
        scope.store("CONTINUES", 0.0)
    store_ignitions(scope, c)
    for event in segment.events:
        scope.store(f"PREVIOUS_{segment.name}_{event.name}", math.inf)
    scope.write(text)
    if c.spec.load_switches:
        text("end_at_load_switch(w, a)")
    if segment.max_intervals > 1:
        text("going = False")
        goes = "w[T + l] < w[END + l]"
        if any(event.is_cell_end for event in segment.events):  # or a rejected one never ends
            goes = f"({goes} and {_CONTINUES})"
        text.lanes()(f"going = going or {goes}")
        text.block("if not going:")("break")
    if any(event.is_cell_end for event in segment.events):
        text(f"cell_second_rates_{segment.name}(w)")
    if c.has_lane_steps(segment):
        _lane_steps(text, c, number, segment)
    else:
        _common_steps(text, c, number, segment)
    if segment.events:
        text(f"set_event_flags(w, {number})")
    elif segment.may_end_by_load:
        text.lanes()(f"w[T + l] = w[END + l] if w[END + l] - w[T + l] <= {at.GRAIN} else w[T + l]")
    else:
        text.lanes()("w[T + l] = w[END + l]")
    if c.spec.formulas.sampled:
        text(take_samples(segment))
    if segment.clauses:
        update_clauses(text, c, segment)
    if segment.releases:
        record_events(text, c, segment)
    if segment.variable_joints:
        release_joints(text, c, segment)


def _common_steps(text: Text, c: Context, number: int, segment: Segment) -> None:
    """Append the loop over the steps of an interval for a segment in which all lanes take the same
    number of steps: ``steps[number]``, an argument of the kernel; ``number`` is the index of the
    segment. With tables or guides, the loop ends early once all lanes are rejected. If the segment
    has events, every step is a fraction of the time left to the predicted one, so it lies about at
    the end of the last step: its instant is located after the loop, and that step is monitored up
    to it only."""
    size, pending, after = (
        f"{c.spec.active_size(segment)} * LANES",
        _pending_calls(segment),
        _after_step(c, number),
    )
    inner = text.block(f"for left in range(steps[{number}], 0, -1):")
    _advance(inner, c, number, segment, "left")
    inner(*pending)
    if has_tables(c.spec) or any(joint.guide is not None for joint in c.spec.scene.joint.values()):
        inner("going = False")
        inner.lanes()(f"going = going or {_CONTINUES}")
        inner.block("if not going:")("break")
    if not segment.events:
        inner(*after)
        return
    if after:
        inner.block("if left > 1:")(*after)
    # of the last step, only the part before the event is monitored
    text(f"polish_event(w, {number}, {size})", *pending, *after)


def _lane_steps(text: Text, c: Context, number: int, segment: Segment) -> None:
    """Append the loop over the steps of an interval for a segment in which each lane takes a number
    of steps of its own: the smaller of the number chosen for segment ``number`` and STEP_FACTOR
    times the fewest steps that are not longer than MAX_STEP; more if an event comes later than
    predicted."""
    size, pending = f"{c.spec.active_size(segment)} * LANES", _pending_calls(segment)
    inner = text.lanes()
    inner(f"w[MAX_STEP + l] = max_step[{number}] if max_step[{number}] > 0.0 else {at.GRAIN}")
    inner(
        "w[STEP_FACTOR + l], w[STEPS_LEFT + l], w[PROGRESS + l] = "
        f"float(step_factor[0]), 1.0 + steps[{number}], 0.0"
    )
    if segment.may_end_by_load:
        inner(
            f"w[TYPICAL_END + l] = w[T + l] + max(typical[{number}], "
            f"{_MIN_FRACTION} * (w[END + l] - w[T + l]))"
        )
    text("going = True")
    inner = text.block("while going:")
    _advance(inner, c, number, segment, "1")
    inner(*([f"stop_at_load_{segment.name}(w)"] if segment.loads else []), *pending)
    if segment.events:
        inner("arrive = False")
        inner.lanes()("arrive = arrive or w[PROGRESS + l] == 1.0")
        inner.block("if arrive:")(f"polish_event(w, {number}, {size})", *pending)
    inner(*_after_step(c, number), "going = False")
    inner.lanes()(f"going = going or (w[PROGRESS + l] < 1.0 and {_CONTINUES})")


def _advance(text: Text, c: Context, number: int, segment: Segment, left: str) -> None:
    """Append lines that make one step in segment ``number`` by the method that the run selects for
    the segment. ``left`` is the code of the number of steps that remain, this one included."""
    methods, typical = c.methods(segment), f"typical[{number}]"
    if segment.may_end_by_load:  # no load is looked at in a step without length
        typical = f"max({typical}, {_SHORTEST_S})"
    size = f"{c.spec.active_size(segment)} * LANES"
    if c.history == at.SEPARATION_HISTORY:
        text.components(size)("w[BEGIN + e + l] = w[Y + e + l]")
        text.lanes()("w[BEGIN_T + l] = w[T + l]")
    for k, rk in enumerate(methods):
        inner = text
        if len(methods) > 1:
            inner = text.block(f"{'elif' if k else 'if'} methods[{number}] == {k}:")
        inner(f"{advance(rk)}(w, {number}, {size}, {left}, {typical})")
        if c.history == at.SEPARATION_HISTORY:
            inner(f"{fit_curves(rk)}(w, {number}, {size})")


def _pending_calls(segment: Segment) -> list[str]:
    """Lines (one, or none if not needed) that call the check whether the condition that ends the
    next phase is met too early: while delayed releases before that phase are pending. It rejects
    such cases, which another variant of the kernel then integrates again
    (`events.emit_pending_event`)."""
    return [f"pending_event_{segment.name}(w, 0.0)"] if segment.pending_event else []


def _after_step(c: Context, number: int) -> list[str]:
    """Lines that call, after a step in segment ``number``, the functions that write the history,
    monitor joint loads and search clearances; only those that the kernel needs."""
    segment = c.spec.segments[number]
    calls = [f"write_history(w, {number}, first, a)"] if c.history else []
    calls += [f"monitor_loads(w, {number})"] if c.monitors_outputs(segment) else []
    return calls + (
        [f"search_clearances_{segment.name}(w)"] if c.active_clearances(segment) else []
    )


def emit_load_switch(out: Text, c: Context) -> None:
    """Write the kernel function ``end_at_load_switch(w, a)``, which ends an interval at the next
    switch of a motor or constant load, if one comes before END, and stores which of them act until
    then; nothing is written if no load switches."""
    if not c.spec.load_switches:
        return
    docstring = "End the interval at the next load switch; update the loads that act until then."
    c.workspace.add("CASES", int(c.model.size_w))  # read by `sepmc.routines.load_intervals`
    text = out.function("end_at_load_switch(w, a: Arrays)", docstring)
    text("m = Model(record(a, 10), indices(a, 11), vector(a, 12))")
    text = text.lanes()
    text(f"case = CASES + {int(c.model.size_w)} * l", "t = w[T + l]")
    for i, motor in enumerate(c.spec.scene.motor):
        if motor.trigger is not None:
            p = int(c.model.motors_p) + at.MOTOR_SIZE * i
            text(f"w[case + {p + at.IGNITION}] = w[{ignition_time(motor.name)} + l]")
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
    """Append lines that hand over from a segment to the next one, ``after``.

    They reject cases that reached neither the end of the segment nor that of the run, flag in
    UNRELEASED those that reached only the end of the run, copy attitude and rate of a rigid group
    to bodies that leave it, change the kinds of joints, and record their releases.
    """
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
        leader_before = segment.leader(leader)
        if leader not in segment.leaders and leader_before != GROUND:
            for field, count in (("Y + Q", 4), ("Y + OMEGA", 3)):
                scope.store(f"{field}_{leader}", scope.load(f"{field}_{leader_before}", count))
            for field, count in (("ANGLES", 2), ("HEADING", 4), ("LAST_RATE", 3)):
                for k in range(count):
                    scope.store(
                        component(f"{field}_{leader}", k),
                        scope.load(component(f"{field}_{leader_before}", k)),
                    )
    for change in c.spec.changes:
        if (
            change.event == segment.phase
            and not segment.late
            and change.joint in c.spec.initial_kinds
        ):
            scope.store(
                f"EVENT_TIME_{change.event}", where(ended, now, event_time(scope, c, change))
            )
    for joint, kinds in after.joint_kinds.items():
        masked, to = joint in c.spec.initial_kinds, min(kinds)
        if segment.constrains(joint) and not kinds[to]:
            record_release(
                scope, c, segment, joint, kind_of(scope, c, joint) < float(to) if masked else None
            )
        if masked and to > min(segment.joint_kinds[joint]):
            kind = kind_of(scope, c, joint)
            changed = where(ended & (kind < float(to)), float(to), kind)
            scope.store(f"KIND_{joint}", changed)
            record_change(scope, c, joint, kind, changed)
    scope.write(text)
