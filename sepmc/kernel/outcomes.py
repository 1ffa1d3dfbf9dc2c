"""The outcomes of a flight: from the final state into slabs, from slabs into the columns of
results."""

import math
from collections.abc import Callable
from typing import Any

from sepmc.kernel.clearances import clearance_now, counts_from_start
from sepmc.kernel.context import Context, part
from sepmc.kernel.formulas import ZERO, loads, quat, vec3
from sepmc.kernel.geometry import State
from sepmc.kernel.guides import guide_outcomes
from sepmc.kernel.recorder import where
from sepmc.kernel.tables import call_look_up, has_wind_profile
from sepmc.kernel.text import Text
from sepmc.routines import layout as at
from sepmc.scene.contents import contents
from sepmc.scene.model import GROUND
from sepmc.schema import Status, across

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
    of a block, and say which cases hold."""
    shape, bodies = c.shape, len(c.shape.bodies) * at.BODY_OUTCOMES
    text("# outcomes", "report(w)")
    text = text.block("for l in range(min(LANES, draws.shape[1] - first)):")
    text("i, lost = first + l, w[ENERGY + l] / w[ENERGY + 2 * LANES + l]")
    text(
        f"sound = w[T + l] >= w[RUN_END + l] and w[DRIFT + l] <= {_UNRESOLVED} and lost <= "
        f"{_UNRESOLVED}"
    )
    o = bodies + len(shape.scene.joint) * at.JOINT_OUTCOMES
    inner = text.block(f"for k in range({o}):")
    inner(
        "outcomes[k, i] = w[OUT + k * LANES + l]",
        f"may_lack = k >= {bodies} or k % {at.BODY_OUTCOMES} < {at.FLOW_ANGLES}",
        "sound = sound and (may_lack or math.isfinite(outcomes[k, i]))",
    )
    for slab in ("PEAKS", "OF_GUIDES", "CLEARANCES"):
        if slab in c.slabs.counts:
            text.block(f"for k in range({c.slabs.counts[slab]}):")(
                f"outcomes[{o} + k, i] = w[{slab} + k * LANES + l]"
            )
            o += c.slabs.counts[slab]
    for joint in shape.scene.output.tip_off:
        for body in shape.scene.joint[joint].bodies:
            if body != GROUND:
                if c.slabs.has(f"TIP_OFF_{joint}_{body}"):
                    text(
                        f"outcomes[{o}, i], outcomes[{o + 1}, i], outcomes[{o + 2}, i] = get3(w, "
                        f"TIP_OFF_{joint}_{body} + l)"
                    )
                o += 3
    if "OF_EVENTS" in c.slabs.counts:
        text.block(f"for k in range({c.slabs.counts['OF_EVENTS']}):")(
            f"outcomes[{o} + k, i] = w[OF_EVENTS + k * LANES + l]"
        )
        o += c.slabs.counts["OF_EVENTS"]
    for y, z in across(contents(shape.scene)):
        text(f"outcomes[{o}, i] = math.hypot(outcomes[{y}, i], outcomes[{z}, i])")
        o += 1
    text.block("for k in range(4):")(f"outcomes[{o} + k, i] = w[RESIDUAL + k * LANES + l]")
    pivot, redundant = (
        "w[PIVOT + l]" if c.slabs.has("PIVOT") else "1.0",
        str(float(max(stage.redundant for stage in shape.stages))),
    )
    redundant = "w[REDUNDANT + l]" if c.slabs.has("REDUNDANT") else redundant
    audits = (
        "w[DRIFT + l]",
        "lost",
        pivot,
        redundant,
        "w[EVENT_ERROR + l]",
        "w[TURNED_FAR + l]",
        "w[STEPS + l]",
    )
    for k, value in enumerate(audits):
        text(f"outcomes[{o + 4 + k}, i] = {value}")
    guards = o + 4 + len(audits) + 1  # after the estimate of the error, which is not known here
    text(
        "unknown = -math.inf if w[UNCLEAR + l] > 0.0 else math.nan",
        "known = w[UNCLEAR + l] == 0.0 and w[UNEVEN + l] == 0.0",
    )
    text.block("for k in range(GUARDS):")(
        f"outcomes[{guards} + k, i] = w[GUARD + k * LANES + l] if known else unknown"
    )
    for number, stage in enumerate(shape.stages):
        text(f"ends[{number}, i] = w[ENDED_{stage.name} + l]")
    for number, place in enumerate(c.sudden, len(shape.stages)):
        text(f"ends[{number}, i] = w[{place} + l]")
    text(
        "told = w[LOST + l] if w[LOST + l] != 0.0 else w[UNRELEASED + l] if sound else "
        f"{float(at.FINER_STEPS)}",
        "status[i] = int(told)",
    )
    inner = text.block(f"if told > {float(Status.NEVER_RELEASED)}:")
    inner.block(f"for k in range({guards}):")("outcomes[k, i] = math.nan")
