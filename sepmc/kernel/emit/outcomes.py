"""Emitter of the outcomes of a case: they are computed from the final state into workspace fields,
and copied from these into the result arrays."""

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
# number of the last outcomes of a body that are also reported at observation events: angular rates
# and attitude
AT_EVENT = 6


def emit_outcomes(out: Text, c: Context) -> None:
    """Write the kernel function ``compute_outcomes(w)``, which computes the outcomes of the cases
    in all lanes from the final state: those of bodies and joints into the field OUTCOMES, those of
    guides, events, ignitions and relative motions into fields of their own."""
    spec, segment = c.spec, c.spec.segments[-1]
    text = out.function(
        "compute_outcomes(w)",
        "Outcomes of the final state, in the order of the columns, into OUTCOMES.",
    )
    c.workspace.add(
        "OUTCOMES", len(spec.bodies) * at.BODY_OUTCOMES + len(spec.scene.joint) * at.JOINT_OUTCOMES
    )
    if has_wind_profile(spec):
        text.components("SIZE_Y")("w[S + e + l] = w[Y + e + l]")
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
    """Name of the workspace field of the state vector at an observation event, followed by pitch
    and roll, rad, of each body; all NaN before the event."""
    return f"AT_{event}"


def event_angle(c: Context, event: str, body: str, k: int) -> str:
    """Workspace path of the pitch (k = 0) or roll (k = 1) of a body at an observation event, rad.
    The angle counts full turns, so it is not limited to one turn."""
    return component(event_field(event), c.size + 2 * c.spec.bodies.index(body) + k)


def _event_size(c: Context) -> int:
    """Number of outcomes of one observation event: its time, six of each body, separation speed and
    distance of each joint, one of each clearance."""
    scene = c.spec.scene
    return 1 + AT_EVENT * len(c.spec.bodies) + 2 * len(scene.joint) + len(scene.clearance)


def _event_outcomes(end: State, event: str, o: int) -> None:
    """Add lines to the scope of the final state ``end`` that store the outcomes of an observation
    event from component ``o`` of EVENT_OUTCOMES on: its time, then angular rates and attitude of
    each body and separation speed and distance of each joint at that time; NaN if it did not
    occur."""
    c, scope, spec = end.c, end.scope, end.spec
    c.workspace.add("EVENT_OUTCOMES", len(spec.scene.event) * _event_size(c), optional=True)
    c.start(f"EVENT_TIME_{event}", math.inf)
    s = State(c, scope, end.segment, event_field(event), f"EVENT_TIME_{event}")

    def angles_at_event(s: State, leader: str) -> tuple[Any, Any]:
        """Pitch and roll of a rigid group at the event, with full turns, rad."""
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
    """Add lines to the scope of the final state ``end`` that store the ignition times, s, of
    triggered motors into the field IGNITIONS; NaN for a motor that has not ignited by then."""
    c, motors = end.c, end.spec.triggered_motors
    if motors:
        c.workspace.add("IGNITIONS", len(motors), optional=True)
    for k, motor in enumerate(motors):
        time = ignition(end.scope, c, motor)
        end.scope.store(component("IGNITIONS", k), where(time <= end.time, time, math.nan))


def _relative_outcomes(end: State, events: list[str]) -> None:
    """Add lines to the scope of the final state ``end`` that store hinge angles and relative
    positions of pairs of bodies (`relative_values`) into the field RELATIVE_OUTCOMES: at the end,
    then at each observation event (NaN if it did not occur)."""
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
    """Append lines that store the distance of every clearance at an observation event into the
    components of EVENT_OUTCOMES that end just before number ``end_index``; NaN if the event did not
    occur, or the clearance was not measured yet."""
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
    """Outcomes of a body at a state: flow angles, pitch above the reference path, angular rates and
    attitude.

    Parameters
    ----------
    s : State
    body : str
    angles_of : callable
        function of the state and the leader of a rigid group that gives pitch and roll of the group
        with full turns, rad

    Returns
    -------
    list of Expr
        alpha, beta, pitch minus the reference path angle of the scene, rates about body x, y, z,
        roll, yaw, pitch; rad, rad/s
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
    """Pitch and roll, rad, of the rigid group of ``leader`` (not GROUND) at the end of the last
    step, with full turns."""
    return s.scope.load(f"ANGLES_{leader}"), s.scope.load(component(f"ANGLES_{leader}", 1))


def emit_results(text: Text, c: Context) -> None:
    """Append lines that compute the outcomes, set the status of each case, and copy outcomes, audit
    columns, error indicators and end times of segments into the result arrays.

    With a final status other than ok and never-released, outcomes and audit columns are NaN. Error
    indicators are NaN in a case that is marked as uneven, and -inf if its full turns are unclear;
    both lead to another integration of the case.

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
    """Name of the workspace field of the angular rates of a body, body axes, rad/s, at the instant
    at which a joint becomes free; NaN before."""
    return f"TIP_OFF_{joint}_{body}"


def tip_off_fields(c: Context) -> list[str]:
    """Workspace fields of all tip-off rates that are outputs, in the order of the columns."""
    scene = c.spec.scene
    return [
        tip_off_field(joint, body)
        for joint in scene.output.tip_off
        for body in scene.joint[joint].bodies
        if body != GROUND
    ]


def time_fields(c: Context) -> list[tuple[str, int]]:
    """Workspace fields of the times of stroke ends and of partial releases, in the order of the
    columns; each with its number of components."""
    strokes = len(c.spec.stroke_columns)
    fields = [(change_time(joint, number), 1) for joint, number in c.spec.partial_releases]
    return [(STROKE_END_TIMES, strokes), *fields] if strokes else fields


def _other_outcomes(c: Context) -> list[tuple[str, int]]:
    """Workspace fields of the outcomes that follow those in OUTCOMES (of bodies, and separations of
    joints), in the order of the columns, each with its number of components: from peak loads and
    clearances to times and relative motion. Audit columns and values that are computed from other
    outcomes are not included."""
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
    """Kernel code, within a loop over lanes, of the value of each audit column, in the order of the
    columns, without the last one (the error estimate, which is filled in later)."""
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
    """Append lines that set the status of each case: that of its rejection, if it is rejected; else
    `FINER_STEPS` if the end time is not reached, attitude or energy drifted, or an outcome of a
    body other than a flow angle is not finite; else never-released or ok."""
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
