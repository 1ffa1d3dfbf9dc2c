"""Lines of a written kernel that follow the loads of joints over a flight: peaks, their times,
impulses; and phases that a load ends."""

import math

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import note_guides, start_guides, watch_guide
from sepmc.kernel.emit.steps import emit_attitudes_where, emit_broadcast
from sepmc.kernel.emit.wrenches import before_wrenches, make_wrenches, store_wrenches
from sepmc.kernel.spec.kernel_spec import ANY_PHASE, Event, Segment
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at

_AT_FIRST = (0.0, math.nan, 0.0)  # peak, its time, integral


def emit_monitor(out: Text, c: Context) -> None:
    """Functions that follow the loads over a step."""
    segments = {
        number: segment
        for number, segment in enumerate(c.spec.segments)
        if c.monitors_loads(segment)
    }
    if c.output_joints:
        for k in range(6 * len(c.output_joints)):
            c.case.scope.store(component("PEAKS", k), _AT_FIRST[k % 3])
        c.workspace.add("PEAKS", 6 * len(c.output_joints))
    start_guides(c)
    if not segments:
        return
    numbers = c.node_size
    c.workspace.add("WRENCHES", at.PEAK_NODES * numbers), c.workspace.add("SCRATCH", _scratch(c))
    for segment in segments.values():
        if not c.wrenches_from_rates(segment):
            _wrenches(out, c, segment)
    text = out.function(
        "node_loads(w, phase: int)",
        "Loads of joints at the nodes of what counts of the step just made, into WRENCHES.",
    )
    inner = text.block(f"for i in range({at.PEAK_NODES}):")
    inner.lanes()("w[THETA + l] = peaks.THETA[i] * w[REACH + l]")
    emit_broadcast(inner, c, "THETA")
    inner("interpolate(w, phase)")
    for place, (number, segment) in enumerate(segments.items()):
        what = "rates" if c.wrenches_from_rates(segment) else "wrenches"
        inner.block(f"{'elif' if place else 'if'} phase == {number}:")(f"{what}_{segment.name}(w)")
    inner.block(f"for e in range({numbers} * LANES):")(
        f"w[WRENCHES + i * {numbers} * LANES + e] = w[WRENCH + e]"
    )
    for number, segment in segments.items():
        if segment.loads:
            _break(out, c, number, segment)
    if c.output_joints or c.output_guides:
        _watch(out, c, segments)


def _scratch(c: Context) -> int:
    """Numbers, so many to a lane, that following loads works in."""
    return max(
        [at.PEAK_SCRATCH, *(at.PEAK_NODES * (4 + 6 * c.pins(joint)) for joint in c.output_guides)]
    )


def _watch(out: Text, c: Context, segments: dict[int, Segment]) -> None:
    """A function for peaks and impulses."""
    numbers = c.node_size
    text = out.function(
        "monitor_loads(w, phase: int)",
        "Peaks and integrals of the loads of joints over the step just made, into PEAKS.",
    )
    text("node_loads(w, phase)")
    inner = text.lanes().block(
        f"if w[REACH + l] * w[LENGTH + l] > {at.GRAIN}:  # shorter, and it is no time at all"
    )
    inner("h = w[REACH + l] * w[LENGTH + l]")
    for k in range(0, 6 * len(c.output_joints), 3):
        places = (
            component("WRENCHES", k),
            component("PEAKS", k),
            component("PEAKS", _other(k)),
            c.indicator(c.load_indicators[k // 3]),
        )
        nodes, found, other, indicator = (f"{place} + l" for place in places)
        inner(
            f"peaks.update_size(w, {nodes}, {numbers} * LANES, SCRATCH, {found}, {other}, "
            f"{indicator}, w[BEGIN_T + l], h)"
        )
    for number, segment in segments.items():
        if any(map(segment.sliding_kinds, c.output_guides)):
            note_guides(inner.block(f"if phase == {number}:"), c, segment)


def _other(k: int) -> int:
    """Where the peak of a moment stands, given that of the force, and the other way round."""
    return k + 3 if k % at.LOADS_OUTCOMES == 0 else k - 3


def _break(out: Text, c: Context, number: int, segment: Segment) -> None:
    """A function that ends the step just made where the first load is reached that a phase waits
    for: by the continuous extension."""
    c.workspace.add("CUT", c.size)
    says = (
        f"End the step just made in phase {segment.name} where a load that is waited for is "
        "reached, or several are at once."
    )
    text = out.function(f"stop_at_load_{segment.name}(w)", says)
    text(f"node_loads(w, {number})", "found = 0.0")
    inner = text.lanes()
    inner("w[CUT + l], w[THETA + l] = 0.0, 1.0")
    inner = inner.block(f"if w[DONE + l] == 0.0 and w[LENGTH + l] > {at.GRAIN}:")
    inner("first, slope = 2.0, 0.0")
    sides: list[str] = []
    for i, load in enumerate(segment.loads):
        place = 6 * c.monitored_joints.index(load.item) + (
            3 if load.quantity == at.AT_MOMENT else 0
        )
        threshold, nodes = (
            f"w[P + {load.threshold} * LANES + l]",
            f"{component('WRENCHES', place)} + l, {c.node_size} * LANES",
        )
        inner(f"theta_{i} = math.inf")
        waits = (
            inner
            if load.ends_phase
            else inner.block(f"if w[{load.flag(segment.name)} + l] == 0.0:")
        )
        asked = f"w, {nodes}, SCRATCH, {threshold}"
        if load.direction:
            side = side_before(segment, load)
            c.start(side, 0.0)
            ways = [load.direction in (way, "either") for way in ("rising", "falling")]
            sides.append(f"w[{side} + l] = peaks.side_at({asked}, w[THETA + l], w[{side} + l])")
            asked += f", w[{side} + l], {ways[0]}, {ways[1]}"
        how = "first_crossed" if load.direction else "first_reached"
        waits(f"theta_{i}, rate = peaks.{how}({asked})")
        waits.block(f"if theta_{i} < first:")(f"first, slope = theta_{i}, rate")
    met = inner.block("if first <= 1.0:")
    met("found, w[CUT + l], w[THETA + l], w[REACH + l] = 1.0, 1.0, first, first")
    met(
        "w[T + l] = w[BEGIN_T + l] + first * w[LENGTH + l]",
        "w[END + l], w[PROGRESS + l] = w[T + l], 2.0",
    )
    met("slow = w[LENGTH + l] / slope if slope > 0.0 else math.inf")
    for i, load in enumerate(segment.loads):
        indicator = f"{c.indicator(f'{segment.name}_{load.name}')} + l"
        at_it = met.block(f"if (theta_{i} - first) * w[LENGTH + l] <= {at.GRAIN}:")
        at_it(
            f"w[{load.flag(segment.name)} + l], w[{indicator}] = 1.0, "
            f"max(w[{indicator}], slow if first > 0.0 else 0.0)"
        )
    inner(*sides)
    inner = text.block("if found > 0.0:")
    emit_broadcast(inner, c, "THETA")
    emit_broadcast(inner, c, "CUT")
    inner(f"interpolate(w, {number})")
    inner.block(f"for e in range({c.spec.active_size(segment)} * LANES):")(
        "w[Y + e] = w[S + e] if w[CUT + e] > 0.0 else w[Y + e]"
    )
    emit_attitudes_where(inner, c, segment, "CUT")


def side_before(segment: Segment, load: Event) -> str:
    """Where it is noted on which side of its threshold a load was at the end of the last step."""
    return (
        f"SIDE_{ANY_PHASE}_{load.number}" if load.any_phase else f"SIDE_{segment.name}_{load.name}"
    )


def _wrenches(out: Text, c: Context, segment: Segment) -> None:
    """A function for the loads of the joints that are followed, in a phase whose derivative does
    not give them."""
    says = (
        "Force and moment of every joint that is followed at the state S and the times CLOCK, "
        "in axes of its first body, into WRENCH"
    )
    says += "; and what is followed of guides." if c.output_guides else "."
    text = out.function(f"wrenches_{segment.name}(w)", says)
    before_wrenches(text, c, segment)
    s = State(c, c.scope(), segment, "S")
    motion = make_wrenches(s)
    store_wrenches(s, motion)
    for joint, first, _, _ in c.guide_fields:
        for k, vector in enumerate(
            watch_guide(s, motion, joint) if segment.sliding_kinds(joint) else []
        ):
            s.scope.store(component("WRENCH", first + 3 * k), vector)
    s.scope.write(text)
