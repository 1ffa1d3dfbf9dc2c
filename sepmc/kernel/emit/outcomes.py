"""Outcomes of a case, as lines of a kernel: from the final state into fields, from fields into the
result arrays."""

import math
from collections.abc import Callable
from typing import Any

from sepmc.kernel.emit.clearances import emit_clearance_at, is_active_at_start
from sepmc.kernel.emit.context import STROKE_END_TIMES, Context, change_time, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import guide_outcomes
from sepmc.kernel.emit.ignition import ignition
from sepmc.kernel.emit.relative import relative_values
from sepmc.kernel.emit.tables import call_look_up, has_wind_profile
from sepmc.kernel.tracer.formulas import ZERO, loads, quat, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND
from sepmc.schema import Status, transverse_components

# quaternion drift in a step, or relative energy defect, beyond which a case is rejected
_UNRESOLVED = 1e-6
AT_EVENT = 6  # last outcomes of a body, reported at events too: rates and attitude


def emit_outcomes(out: Text, c: Context) -> None:
    """Write the function for the outcomes of all lanes."""
    spec, segment = c.spec, c.spec.segments[-1]
    text = out.function(
        "compute_outcomes(w)",
        "Outcomes of the final state, in the order of the columns, into OUTCOMES.",
    )
    c.workspace.add(
        "OUTCOMES", len(spec.bodies) * at.BODY_OUTCOMES + len(spec.scene.joint) * at.JOINT_OUTCOMES
    )
    if has_wind_profile(spec):
        text.block("for e in range(SIZE_Y):")("w[S + e] = w[Y + e]")
        text.lanes()("w[CLOCK + l] = w[T + l]")
        call_look_up(text, c, segment)
    if c.output_guides:
        c.workspace.add(
            "GUIDE_OUTCOMES", sum(2 + c.pins(joint) for joint in c.output_guides), optional=True
        )
    s = State(c, c.scope(), segment, "Y")
    o = 0
    for body in spec.bodies:
        for k, value in enumerate(body_outcomes(s, body, angles)):
            s.scope.store(component("OUTCOMES", o + k), value)
        o += at.BODY_OUTCOMES
    for joint in spec.scene.joint:
        line = s.separation(joint)
        c.start(f"RELEASE_{joint}", math.nan)
        for k, value in enumerate((line.rate, line.length, s.scope.load(f"RELEASE_{joint}"))):
            s.scope.store(component("OUTCOMES", o + k), value)
        o += at.JOINT_OUTCOMES
    for k, value in enumerate(guide_outcomes(s)):
        s.scope.store(component("GUIDE_OUTCOMES", k), value)
    events = [event.name for event in spec.scene.event]
    for number, event in enumerate(events):
        _event_outcomes(s, event, number * _event_size(c))
    _ignition_outcomes(s)
    _relative_outcomes(s, events)
    s.scope.write(text)
    for number, event in enumerate(events):
        _event_clearances(text, s, event, (number + 1) * _event_size(c))


def event_field(event: str) -> str:
    """Name of the workspace field of the state at an event, then pitch and roll of each body."""
    return f"AT_{event}"


def event_angle(c: Context, event: str, body: str, k: int) -> str:
    """Index expression, in the workspace, of the pitch (k = 0) or roll (k = 1) of a body at an
    event. The angle counts full turns, so it is not limited to one turn."""
    return component(event_field(event), c.size + 2 * c.spec.bodies.index(body) + k)


def _event_size(c: Context) -> int:
    """Number of outcomes of one observation event."""
    scene = c.spec.scene
    return 1 + AT_EVENT * len(c.spec.bodies) + 2 * len(scene.joint) + len(scene.clearance)


def _event_outcomes(end: State, event: str, o: int) -> None:
    """Add lines to the scope of the state ``end`` that store the time of an observation event, and
    rates and attitudes of all bodies and all separations then, from component ``o`` of
    EVENT_OUTCOMES on; NaN if it did not occur."""
    c, scope, spec = end.c, end.scope, end.spec
    c.workspace.add("EVENT_OUTCOMES", len(spec.scene.event) * _event_size(c), optional=True)
    c.start(f"EVENT_TIME_{event}", math.inf)
    s = State(c, scope, end.segment, event_field(event), f"EVENT_TIME_{event}")

    def angles_at_event(s: State, leader: str) -> tuple[Any, Any]:
        pitch, roll = (scope.load(event_angle(c, event, leader, k)) for k in range(2))
        return pitch, roll

    occurred = s.time < math.inf
    values = [where(occurred, s.time, math.nan)]
    for body in spec.bodies:
        values += body_outcomes(s, body, angles_at_event)[-AT_EVENT:]
    for joint in spec.scene.joint:
        line = s.separation(joint)
        values += [line.rate, line.length]
    for k, value in enumerate(values):
        scope.store(component("EVENT_OUTCOMES", o + k), where(occurred, value, math.nan))


def _ignition_outcomes(end: State) -> None:
    """Add lines to the scope of the final state that store the ignition times of triggered motors
    into IGNITIONS; NaN for a motor that did not ignite."""
    c, motors = end.c, end.spec.triggered_motors
    if motors:
        c.workspace.add("IGNITIONS", len(motors), optional=True)
    for k, motor in enumerate(motors):
        time = ignition(end.scope, c, motor)
        end.scope.store(component("IGNITIONS", k), where(time <= end.time, time, math.nan))


def _relative_outcomes(end: State, events: list[str]) -> None:
    """Add lines to the scope of the final state that store hinge angles and relative motions of
    pairs of bodies, at the end and at all observation events, into RELATIVE_OUTCOMES."""
    c, scope = end.c, end.scope
    values = relative_values(end)
    if not values:
        return
    c.workspace.add("RELATIVE_OUTCOMES", len(values) * (1 + len(events)), optional=True)
    for event in events:
        s = State(c, scope, end.segment, event_field(event), f"EVENT_TIME_{event}")
        occurred = s.time < math.inf
        values += [where(occurred, value, math.nan) for value in relative_values(s)]
    for k, value in enumerate(values):
        scope.store(component("RELATIVE_OUTCOMES", k), value)


def _event_clearances(text: Text, end: State, event: str, end_index: int) -> None:
    """Append lines that store the distances of all clearances at an observation event into
    EVENT_OUTCOMES, up to but without component ``end_index``."""
    c, clearances = end.c, end.spec.scene.clearance
    s = State(c, end.scope, end.segment, event_field(event), f"EVENT_TIME_{event}")
    for i, entry in enumerate(clearances):
        counts = f"w[EVENT_TIME_{event} + l] < math.inf"
        if not is_active_at_start(c, i):
            counts += f" and w[EVENT_TIME_{event} + l] >= w[RELEASE_{entry.after} + l]"
        emit_clearance_at(
            text, s, i, counts, component("EVENT_OUTCOMES", end_index - len(clearances) + i)
        )


def body_outcomes(
    s: State, body: str, angles_of: Callable[[State, str], tuple[Any, Any]]
) -> list[Any]:
    """Outcomes of a body: flow angles, pitch above the nominal path, angular rates and attitude.

    Parameters
    ----------
    s : State
    body : str
    angles_of : callable
        pitch and roll of a rigid group with full turns

    Returns
    -------
    list of Expr
        alpha, beta, pitch minus the nominal path angle, rates about x, y, z, roll, yaw, pitch; rad,
        rad/s
    """
    leader, attitude, case = s.segment.leader(body), s.attitude(body), s.case
    flow = vec3.unrotate(attitude, vec3.add(s.velocity(body), s.stream(body))).called("flow")
    alpha, beta = loads.reported_angles(flow, loads.flow_angles(flow).called("angles"))
    fixed = leader == GROUND
    pitch, roll = (case.number(at.PITCH), case.number(at.ROLL)) if fixed else angles_of(s, leader)
    outcomes = [
        alpha,
        beta,
        pitch - case.number(at.PATH_REFERENCE),
        *(ZERO if fixed else s.rate(leader)),
    ]
    return [*outcomes, roll, quat.yaw(attitude), pitch]


def angles(s: State, leader: str) -> tuple[Any, Any]:
    """Pitch and roll of a rigid group, by its leader, at the end of a step, with full turns,
    rad."""
    return s.scope.load(f"ANGLES_{leader}"), s.scope.load(component(f"ANGLES_{leader}", 1))


def emit_results(text: Text, c: Context) -> None:
    """Append lines that copy outcomes, audit columns, error indicators and segment ends into the
    result arrays and set the status.

    Whole columns are copied for all lanes at once: one number at a time took a tenth of the run
    time.
    """
    spec, bodies = c.spec, len(c.spec.bodies)
    n_own = bodies * at.BODY_OUTCOMES + len(spec.scene.joint) * at.JOINT_OUTCOMES
    audits = _audits(c)
    text("# outcomes", "compute_outcomes(w)")
    _set_status(text, c)
    c.workspace.add("AUDIT", len(audits))
    inner = text.lanes()
    for k, value in enumerate(audits):
        inner(f"w[{component('AUDIT', k)} + l] = {value}")
    inner(
        "unknown = -math.inf if w[WINDING_UNCLEAR + l] > 0.0 else math.nan",
        "known = w[WINDING_UNCLEAR + l] == 0.0 and w[UNEVEN + l] == 0.0",
    )
    for k in range(len(c.indicators)):
        path = component("INDICATORS", k)
        inner(f"w[{path} + l] = w[{path} + l] if known else unknown")
    o = 0
    for field, count in [("OUTCOMES", n_own), *_other_outcomes(c)]:
        text(f"put_columns(outcomes, {o}, w, {field}, {count}, first)")
        o += count
    for y, z in transverse_components(spec.layout.contents):
        text.block("for i in range(first, min(first + LANES, draws.shape[1])):")(
            f"outcomes[{o}, i] = math.hypot(outcomes[{y}, i], outcomes[{z}, i])"
        )
        o += 1
    o += len(spec.layout.contents.formulas)  # computed from the others, `engine.formula_outcomes`
    text(f"put_columns(outcomes, {o}, w, AUDIT, {len(audits)}, first)")
    o += len(audits) + 1  # the error estimate is filled in later
    text(f"put_columns(outcomes, {o}, w, INDICATORS, N_INDICATORS, first)")
    for number, path in enumerate(
        [*(f"ENDED_{one.name}" for one in spec.segments), *c.change_times]
    ):
        text(f"put_columns(ends, {number}, w, {path}, 1, first)")
    inner = text.block("for i in range(first, min(first + LANES, draws.shape[1])):")
    inner("status[i] = int(w[STATUS + i - first])")
    inner.block(f"if w[STATUS + i - first] > {float(Status.NEVER_RELEASED)}:").block(
        f"for k in range({o}):"
    )("outcomes[k, i] = math.nan")


def tip_off_field(joint: str, body: str) -> str:
    """Workspace field of the angular rates of a body at the time at which a joint becomes free."""
    return f"TIP_OFF_{joint}_{body}"


def tip_off_fields(c: Context) -> list[str]:
    """Fields of all tip-off rates that are outputs, in the order of the columns."""
    scene = c.spec.scene
    return [
        tip_off_field(joint, body)
        for joint in scene.output.tip_off
        for body in scene.joint[joint].bodies
        if body != GROUND
    ]


def time_fields(c: Context) -> list[tuple[str, int]]:
    """Fields of the ends of strokes and of partial releases, in the order of the columns, with
    their sizes."""
    strokes = len(c.spec.stroke_columns)
    fields = [(change_time(joint, number), 1) for joint, number in c.spec.partial_releases]
    return [(STROKE_END_TIMES, strokes), *fields] if strokes else fields


def _other_outcomes(c: Context) -> list[tuple[str, int]]:
    """Fields of outcomes after those of bodies and joints, in the order of the columns, with their
    sizes."""
    fields: list[tuple[str, int]] = [
        (field, c.workspace.counts[field])
        for field in ("PEAKS", "GUIDE_OUTCOMES", "CLEARANCES")
        if field in c.workspace.counts
    ]
    fields += [(field, 3) for field in tip_off_fields(c)]
    if "EVENT_OUTCOMES" in c.workspace.counts:
        fields.append(("EVENT_OUTCOMES", c.workspace.counts["EVENT_OUTCOMES"]))
    if "IGNITIONS" in c.workspace.counts:
        fields.append(("IGNITIONS", c.workspace.counts["IGNITIONS"]))
    fields += time_fields(c)
    if "RELATIVE_OUTCOMES" in c.workspace.counts:
        fields.append(("RELATIVE_OUTCOMES", c.workspace.counts["RELATIVE_OUTCOMES"]))
    return fields


def _audits(c: Context) -> list[str]:
    """Code, within a loop over lanes, of the value of each audit column but the last, in their
    order."""
    redundant = str(float(max(segment.redundant for segment in c.spec.segments)))
    return [
        *(f"w[{component('RESIDUAL', k)} + l]" for k in range(4)),
        "w[DRIFT + l]",
        "w[ENERGY + l] / w[ENERGY + 2 * LANES + l]",
        "w[PIVOT + l]" if c.workspace.has("PIVOT") else "1.0",
        "w[REDUNDANT + l]" if c.workspace.has("REDUNDANT") else redundant,
        "w[EVENT_ERROR + l]",
        "w[TURNED_FAR + l]",
        "w[STEPS + l]",
    ]


def _set_status(text: Text, c: Context) -> None:
    """Append lines that set the status of each case: that of its rejection; else `FINER_STEPS` if
    the end time is not reached, attitude or energy drifted, or an outcome of a body is not finite;
    else ok or never released."""
    c.workspace.add("STATUS", 1)
    text.lanes()("w[NOT_FINITE + l] = 0.0")
    bodies = len(c.spec.bodies)
    for body in range(bodies):
        finite = range(at.BODY_OUTCOMES * body + at.FLOW_ANGLES, at.BODY_OUTCOMES * (body + 1))
        text.block(f"for k in range({finite.start}, {finite.stop}):").lanes()(
            "w[NOT_FINITE + l] += w[OUTCOMES + k * LANES + l] - w[OUTCOMES + k * LANES + l]"
        )
    text.lanes()(
        "defect = w[ENERGY + l] / w[ENERGY + 2 * LANES + l]",
        "valid = w[NOT_FINITE + l] == 0.0 and w[T + l] >= w[RUN_END + l] and w[DRIFT + l] <= "
        f"{_UNRESOLVED} and defect <= {_UNRESOLVED}",
        f"case_status = w[UNRELEASED + l] if valid else {float(at.FINER_STEPS)}",
        "w[STATUS + l] = w[REJECTED + l] if w[REJECTED + l] != 0.0 else case_status",
    )
