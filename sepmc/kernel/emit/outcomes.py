"""The outcomes of a flight: from the final state into slabs, from slabs into the columns of
results."""

import math
from collections.abc import Callable
from typing import Any

from sepmc.kernel.emit.clearances import clearance_now, counts_from_start
from sepmc.kernel.emit.context import Context, part
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import guide_outcomes
from sepmc.kernel.emit.ignition import ignition
from sepmc.kernel.emit.tables import call_look_up, has_wind_profile
from sepmc.kernel.tracer.formulas import ZERO, loads, quat, vec3
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import where
from sepmc.routines import layout as at
from sepmc.scene.contents import contents
from sepmc.scene.model import GROUND
from sepmc.schema import Status, transverse_components

# drift of a quaternion in a step, or share of energy lost, beyond which a case is not vouched for
_UNRESOLVED = 1e-6
AT_EVENT = 6  # the last outcomes of a body, which are told at events too: rates and attitude


def emit_report(out: Text, c: Context) -> None:
    """A function for the outcomes of all lanes."""
    shape, stage = c.shape, c.shape.stages[-1]
    text = out.function(
        "report(w)", "Outcomes of the final state, in the order of the columns, into OUT."
    )
    c.slabs.add(
        "OUT", len(shape.bodies) * at.BODY_OUTCOMES + len(shape.scene.joint) * at.JOINT_OUTCOMES
    )
    if has_wind_profile(shape):
        text.block("for e in range(SIZE_Y):")("w[S + e] = w[Y + e]")
        text.lanes()("w[CLOCK + l] = w[T + l]")
        call_look_up(text, c, stage)
    if c.guides:
        c.slabs.add("OF_GUIDES", sum(2 + c.pins(joint) for joint in c.guides), optional=True)
    s = State(c, c.scope(), stage, "Y")
    o = 0
    for body in shape.bodies:
        for k, value in enumerate(of_body(s, body, angles)):
            s.scope.store(part("OUT", o + k), value)
        o += at.BODY_OUTCOMES
    for joint in shape.scene.joint:
        line = s.separation(joint)
        c.start(f"RELEASE_{joint}", math.nan)
        for k, value in enumerate((line.rate, line.length, s.scope.load(f"RELEASE_{joint}"))):
            s.scope.store(part("OUT", o + k), value)
        o += at.JOINT_OUTCOMES
    for k, value in enumerate(guide_outcomes(s)):
        s.scope.store(part("OF_GUIDES", k), value)
    events = [event.name for event in shape.scene.event]
    for number, event in enumerate(events):
        _at_event(s, event, number * _told_at_event(c))
    _ignitions(s)
    s.scope.write(text)
    for number, event in enumerate(events):
        _clearances_at_event(text, s, event, (number + 1) * _told_at_event(c))


def kept(event: str) -> str:
    """The slab of the state at an event, and of the pitch and the roll of every body then."""
    return f"AT_{event}"


def kept_angle(c: Context, event: str, body: str, k: int) -> str:
    """The place of the pitch (0) or roll (1) of a body at an event, carried through turns."""
    return part(kept(event), c.size + 2 * c.shape.bodies.index(body) + k)


def _told_at_event(c: Context) -> int:
    """How many numbers are told at an event."""
    scene = c.shape.scene
    return 1 + AT_EVENT * len(c.shape.bodies) + 2 * len(scene.joint) + len(scene.clearance)


def _at_event(end: State, event: str, o: int) -> None:
    """The time of an event, rates and attitudes of all bodies and all separations then, from number
    ``o`` of OF_EVENTS on."""
    c, scope, shape = end.c, end.scope, end.shape
    c.slabs.add("OF_EVENTS", len(shape.scene.event) * _told_at_event(c), optional=True)
    c.start(f"COMES_{event}", math.inf)
    s = State(c, scope, end.stage, kept(event), f"COMES_{event}")

    def followed(s: State, leader: str) -> tuple[Any, Any]:
        pitch, roll = (scope.load(kept_angle(c, event, leader, k)) for k in range(2))
        return pitch, roll

    came = s.time < math.inf
    found = [where(came, s.time, math.nan)]
    for body in shape.bodies:
        found += of_body(s, body, followed)[-AT_EVENT:]
    for joint in shape.scene.joint:
        line = s.separation(joint)
        found += [line.rate, line.length]
    for k, value in enumerate(found):
        scope.store(part("OF_EVENTS", o + k), where(came, value, math.nan))


def _ignitions(end: State) -> None:
    """When motors lit that waited for an instant of the flight, into IGNITIONS; NaN if they did
    not."""
    c, motors = end.c, end.shape.triggered
    if motors:
        c.slabs.add("IGNITIONS", len(motors), optional=True)
    for k, motor in enumerate(motors):
        time = ignition(end.scope, c, motor)
        end.scope.store(part("IGNITIONS", k), where(time <= end.time, time, math.nan))


def _clearances_at_event(text: Text, end: State, event: str, behind: int) -> None:
    """Lines for all clearances at an event, into OF_EVENTS, up to number ``behind``."""
    c, clearances = end.c, end.shape.scene.clearance
    s = State(c, end.scope, end.stage, kept(event), f"COMES_{event}")
    for i, entry in enumerate(clearances):
        counts = f"w[COMES_{event} + l] < math.inf"
        if not counts_from_start(c, i):
            counts += f" and w[COMES_{event} + l] >= w[RELEASE_{entry.after} + l]"
        clearance_now(text, s, i, counts, part("OF_EVENTS", behind - len(clearances) + i))


def of_body(s: State, body: str, followed: Callable[[State, str], tuple[Any, Any]]) -> list[Any]:
    """Angles of the flow, the pitch above the nominal path, rates and attitude of a body;
    ``followed`` gives the pitch and the roll of a group that turns, carried through turns."""
    leader, attitude, case = s.stage.leader(body), s.attitude(body), s.case
    flow = vec3.unrotate(attitude, vec3.add(s.speed(body), s.stream(body))).called("flow")
    alpha, beta = loads.angles_told(flow, loads.flow_angles(flow).called("angles"))
    held = leader == GROUND
    pitch, roll = (case.number(at.PITCH), case.number(at.ROLL)) if held else followed(s, leader)
    found = [
        alpha,
        beta,
        pitch - case.number(at.PATH_REFERENCE),
        *(ZERO if held else s.rate(leader)),
    ]
    return [*found, roll, quat.yaw(attitude), pitch]


def angles(s: State, leader: str) -> tuple[Any, Any]:
    """Pitch and roll of a group at the end of a step."""
    return s.scope.load(f"ANGLES_{leader}"), s.scope.load(part(f"ANGLES_{leader}", 1))


def emit_results(text: Text, c: Context) -> None:
    """Lines that copy outcomes, rates at release, audit columns and ends of phases into the arrays
    of a block, and say which cases hold. Numbers go from slabs to columns for all lanes at once:
    one by one they took a tenth of a flight."""
    shape, bodies = c.shape, len(c.shape.bodies)
    own = bodies * at.BODY_OUTCOMES + len(shape.scene.joint) * at.JOINT_OUTCOMES
    audits = _audits(c)
    text("# outcomes", "report(w)")
    _judge(text, c)
    c.slabs.add("AUDITS", len(audits))
    inner = text.lanes()
    for k, value in enumerate(audits):
        inner(f"w[{part('AUDITS', k)} + l] = {value}")
    inner(
        "unknown = -math.inf if w[UNCLEAR + l] > 0.0 else math.nan",
        "known = w[UNCLEAR + l] == 0.0 and w[UNEVEN + l] == 0.0",
    )
    for k in range(len(c.guards)):
        place = part("GUARD", k)
        inner(f"w[{place} + l] = w[{place} + l] if known else unknown")
    o = 0
    for slab, count in [("OUT", own), *_other_outcomes(c)]:
        text(f"put_columns(outcomes, {o}, w, {slab}, {count}, first)")
        o += count
    for y, z in transverse_components(contents(shape.scene)):
        text.block("for i in range(first, min(first + LANES, draws.shape[1])):")(
            f"outcomes[{o}, i] = math.hypot(outcomes[{y}, i], outcomes[{z}, i])"
        )
        o += 1
    text(f"put_columns(outcomes, {o}, w, AUDITS, {len(audits)}, first)")
    o += len(audits) + 1  # the estimate of the error is not known here
    text(f"put_columns(outcomes, {o}, w, GUARD, GUARDS, first)")
    for number, place in enumerate([*(f"ENDED_{one.name}" for one in shape.stages), *c.sudden]):
        text(f"put_columns(ends, {number}, w, {place}, 1, first)")
    inner = text.block("for i in range(first, min(first + LANES, draws.shape[1])):")
    inner("status[i] = int(w[TOLD + i - first])")
    inner.block(f"if w[TOLD + i - first] > {float(Status.NEVER_RELEASED)}:").block(
        f"for k in range({o}):"
    )("outcomes[k, i] = math.nan")


def tip_off(joint: str, body: str) -> str:
    """The slab of the rates of a body of a joint as that becomes free."""
    return f"TIP_OFF_{joint}_{body}"


def tip_offs(c: Context) -> list[str]:
    """All of them that are asked for, in the order of the columns."""
    scene = c.shape.scene
    return [
        tip_off(joint, body)
        for joint in scene.output.tip_off
        for body in scene.joint[joint].bodies
        if body != GROUND
    ]


def _other_outcomes(c: Context) -> list[tuple[str, int]]:
    """Slabs of outcomes after those of bodies and joints, in the order of the columns, and how many
    numbers each has."""
    found: list[tuple[str, int]] = [
        (slab, c.slabs.counts[slab])
        for slab in ("PEAKS", "OF_GUIDES", "CLEARANCES")
        if slab in c.slabs.counts
    ]
    found += [(slab, 3) for slab in tip_offs(c)]
    if "OF_EVENTS" in c.slabs.counts:
        found.append(("OF_EVENTS", c.slabs.counts["OF_EVENTS"]))
    if "IGNITIONS" in c.slabs.counts:
        found.append(("IGNITIONS", c.slabs.counts["IGNITIONS"]))
    return found


def _audits(c: Context) -> list[str]:
    """Values of the audit columns, for a lane."""
    redundant = str(float(max(stage.redundant for stage in c.shape.stages)))
    return [
        *(f"w[{part('RESIDUAL', k)} + l]" for k in range(4)),
        "w[DRIFT + l]",
        "w[ENERGY + l] / w[ENERGY + 2 * LANES + l]",
        "w[PIVOT + l]" if c.slabs.has("PIVOT") else "1.0",
        "w[REDUNDANT + l]" if c.slabs.has("REDUNDANT") else redundant,
        "w[EVENT_ERROR + l]",
        "w[TURNED_FAR + l]",
        "w[STEPS + l]",
    ]


def _judge(text: Text, c: Context) -> None:
    """Lines that say how cases end, into TOLD: they hold if they came to the end, the integration
    is sound and the outcomes that all have are finite."""
    c.slabs.add("TOLD", 1)
    text.lanes()("w[UNSOUND + l] = 0.0")
    bodies = len(c.shape.bodies)
    for body in range(bodies):
        finite = range(at.BODY_OUTCOMES * body + at.FLOW_ANGLES, at.BODY_OUTCOMES * (body + 1))
        text.block(f"for k in range({finite.start}, {finite.stop}):").lanes()(
            "w[UNSOUND + l] += w[OUT + k * LANES + l] - w[OUT + k * LANES + l]"
        )
    text.lanes()(
        "lost = w[ENERGY + l] / w[ENERGY + 2 * LANES + l]",
        "sound = w[UNSOUND + l] == 0.0 and w[T + l] >= w[RUN_END + l] and w[DRIFT + l] <= "
        f"{_UNRESOLVED} and lost <= {_UNRESOLVED}",
        f"told = w[UNRELEASED + l] if sound else {float(at.FINER_STEPS)}",
        "w[TOLD + l] = w[LOST + l] if w[LOST + l] != 0.0 else told",
    )
