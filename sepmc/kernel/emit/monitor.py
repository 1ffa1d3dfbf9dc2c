"""Lines of a written kernel that follow the loads of joints over a flight: peaks, their times,
impulses; and phases that a load ends."""

import math

from sepmc.kernel.emit.context import Context, part
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import note_guides, start_guides, watch_guide
from sepmc.kernel.emit.steps import emit_attitudes_where, emit_spread
from sepmc.kernel.emit.wrenches import before_wrenches, make_wrenches, store_wrenches
from sepmc.kernel.spec.kernel_spec import APART, Event, Stage
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at

_AT_FIRST = (0.0, math.nan, 0.0)  # peak, its time, integral


def emit_watch(out: Text, c: Context) -> None:
    """Functions that follow the loads over a step."""
    stages = {
        number: stage for number, stage in enumerate(c.shape.stages) if c.follows_loads(stage)
    }
    if c.watched:
        for k in range(6 * len(c.watched)):
            c.case.scope.store(part("PEAKS", k), _AT_FIRST[k % 3])
        c.slabs.add("PEAKS", 6 * len(c.watched))
    start_guides(c)
    if not stages:
        return
    numbers = c.node_size
    c.slabs.add("WRENCHES", at.PEAK_NODES * numbers), c.slabs.add("SCRATCH", _scratch(c))
    for stage in stages.values():
        if not c.carried_by_rates(stage):
            _wrenches(out, c, stage)
    text = out.function(
        "load_joints(w, phase: int)",
        "Loads of joints at the nodes of what counts of the step just made, into WRENCHES.",
    )
    inner = text.block(f"for i in range({at.PEAK_NODES}):")
    inner.lanes()("w[THETA + l] = peaks.THETA[i] * w[REACH + l]")
    emit_spread(inner, c, "THETA")
    inner("sample(w, phase)")
    for place, (number, stage) in enumerate(stages.items()):
        what = "rates" if c.carried_by_rates(stage) else "wrenches"
        inner.block(f"{'elif' if place else 'if'} phase == {number}:")(f"{what}_{stage.name}(w)")
    inner.block(f"for e in range({numbers} * LANES):")(
        f"w[WRENCHES + i * {numbers} * LANES + e] = w[WRENCH + e]"
    )
    for number, stage in stages.items():
        if stage.loads:
            _break(out, c, number, stage)
    if c.watched or c.guides:
        _watch(out, c, stages)


def _scratch(c: Context) -> int:
    """Numbers, so many to a lane, that following loads works in."""
    return max([at.PEAK_SCRATCH, *(at.PEAK_NODES * (4 + 6 * c.pins(joint)) for joint in c.guides)])


def _watch(out: Text, c: Context, stages: dict[int, Stage]) -> None:
    """A function for peaks and impulses."""
    numbers = c.node_size
    text = out.function(
        "watch(w, phase: int)",
        "Peaks and integrals of the loads of joints over the step just made, into PEAKS.",
    )
    text("load_joints(w, phase)")
    inner = text.lanes().block(
        f"if w[REACH + l] * w[LENGTH + l] > {at.GRAIN}:  # shorter, and it is no time at all"
    )
    inner("h = w[REACH + l] * w[LENGTH + l]")
    for k in range(0, 6 * len(c.watched), 3):
        places = (
            part("WRENCHES", k),
            part("PEAKS", k),
            part("PEAKS", _other(k)),
            c.guard(c.load_guards[k // 3]),
        )
        nodes, found, other, guard = (f"{place} + l" for place in places)
        inner(
            f"peaks.update_size(w, {nodes}, {numbers} * LANES, SCRATCH, {found}, {other}, {guard}, "
            "w[BEGIN_T + l], h)"
        )
    for number, stage in stages.items():
        if any(map(stage.sliding, c.guides)):
            note_guides(inner.block(f"if phase == {number}:"), c, stage)


def _other(k: int) -> int:
    """Where the peak of a moment stands, given that of the force, and the other way round."""
    return k + 3 if k % at.LOADS_OUTCOMES == 0 else k - 3


def _break(out: Text, c: Context, number: int, stage: Stage) -> None:
    """A function that ends the step just made where the first load is reached that a phase waits
    for: by the continuous extension."""
    c.slabs.add("MET", c.size)
    says = (
        f"End the step just made in phase {stage.name} where a load that is waited for is "
        "reached, or several are at once."
    )
    text = out.function(f"break_{stage.name}(w)", says)
    text(f"load_joints(w, {number})", "found = 0.0")
    inner = text.lanes()
    inner("w[MET + l], w[THETA + l] = 0.0, 1.0")
    inner = inner.block(f"if w[DONE + l] == 0.0 and w[LENGTH + l] > {at.GRAIN}:")
    inner("first, slope = 2.0, 0.0")
    sides: list[str] = []
    for i, load in enumerate(stage.loads):
        place = 6 * c.followed.index(load.which) + (3 if load.what == at.AT_MOMENT else 0)
        threshold, nodes = (
            f"w[P + {load.threshold} * LANES + l]",
            f"{part('WRENCHES', place)} + l, {c.node_size} * LANES",
        )
        inner(f"theta_{i} = math.inf")
        waits = (
            inner if load.ends_phase else inner.block(f"if w[{load.flag(stage.name)} + l] == 0.0:")
        )
        asked = f"w, {nodes}, SCRATCH, {threshold}"
        if load.direction:
            side = side_before(stage, load)
            c.start(side, 0.0)
            ways = [load.direction in (way, "either") for way in ("rising", "falling")]
            sides.append(f"w[{side} + l] = peaks.side_at({asked}, w[THETA + l], w[{side} + l])")
            asked += f", w[{side} + l], {ways[0]}, {ways[1]}"
        how = "first_crossed" if load.direction else "first_reached"
        waits(f"theta_{i}, rate = peaks.{how}({asked})")
        waits.block(f"if theta_{i} < first:")(f"first, slope = theta_{i}, rate")
    met = inner.block("if first <= 1.0:")
    met("found, w[MET + l], w[THETA + l], w[REACH + l] = 1.0, 1.0, first, first")
    met(
        "w[T + l] = w[BEGIN_T + l] + first * w[LENGTH + l]",
        "w[END + l], w[WAY + l] = w[T + l], 2.0",
    )
    met("slow = w[LENGTH + l] / slope if slope > 0.0 else math.inf")
    for i, load in enumerate(stage.loads):
        guard = f"{c.guard(f'{stage.name}_{load.name}')} + l"
        at_it = met.block(f"if (theta_{i} - first) * w[LENGTH + l] <= {at.GRAIN}:")
        at_it(
            f"w[{load.flag(stage.name)} + l], w[{guard}] = 1.0, max(w[{guard}], slow if first > "
            "0.0 else 0.0)"
        )
    inner(*sides)
    inner = text.block("if found > 0.0:")
    emit_spread(inner, c, "THETA")
    emit_spread(inner, c, "MET")
    inner(f"sample(w, {number})")
    inner.block(f"for e in range({c.shape.active(stage)} * LANES):")(
        "w[Y + e] = w[S + e] if w[MET + e] > 0.0 else w[Y + e]"
    )
    emit_attitudes_where(inner, c, stage, "MET")


def side_before(stage: Stage, load: Event) -> str:
    """Where it is noted on which side of its threshold a load was at the end of the last step."""
    return f"SIDE_{APART}_{load.number}" if load.apart else f"SIDE_{stage.name}_{load.name}"


def _wrenches(out: Text, c: Context, stage: Stage) -> None:
    """A function for the loads of the joints that are followed, in a phase whose derivative does
    not give them."""
    says = (
        "Force and moment of every joint that is followed at the state S and the times CLOCK, "
        "in axes of its first body, into WRENCH"
    )
    says += "; and what is followed of guides." if c.guides else "."
    text = out.function(f"wrenches_{stage.name}(w)", says)
    before_wrenches(text, c, stage)
    s = State(c, c.scope(), stage, "S")
    motion = make_wrenches(s)
    store_wrenches(s, motion)
    for joint, first, _, _ in c.noted_of_guides:
        for k, vector in enumerate(watch_guide(s, motion, joint) if stage.sliding(joint) else []):
            s.scope.store(part("WRENCH", first + 3 * k), vector)
    s.scope.write(text)
