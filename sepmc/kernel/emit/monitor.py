"""Emitter of the monitoring of joint loads: peaks, their times, impulses, and load events
(conditions on joint loads, which end phases, trigger releases or are observed).

Loads are evaluated at PEAK_NODES nodes (instants) of each step by the continuous extension;
polynomials through them give peaks (`sepmc.routines.peaks`) and crossings of thresholds
(`sepmc.routines.crossings`).
"""

import math

from sepmc.kernel.emit.context import Context, component
from sepmc.kernel.emit.geometry import State
from sepmc.kernel.emit.guides import guide_loads, reset_guides, update_guides
from sepmc.kernel.emit.signals import reject_undefined
from sepmc.kernel.emit.steps import emit_cut_attitudes
from sepmc.kernel.emit.wrenches import before_wrenches, make_wrenches, store_wrenches
from sepmc.kernel.spec.kernel_spec import ANY_PHASE, Event, Segment
from sepmc.kernel.tracer.text import Text
from sepmc.routines import layout as at

_INITIAL = (0.0, math.nan, 0.0)  # at the start of a case: peak, its time, integral


def emit_monitor(out: Text, c: Context) -> None:
    """Write the kernel functions that monitor joint loads over the step just made; add the fields
    that they need (PEAKS, GUIDES, ...). If no segment has monitored loads, no function is written,
    but the fields of outputs (PEAKS, GUIDES) are still added and get their initial values.

    ``wrenches_SEGMENT(w)`` stores the loads at one state, ``node_loads(w, phase)`` those at all
    nodes of the step. ``stop_at_load_SEGMENT`` (only for segments with conditions on joint loads)
    looks for load events within the step; ``monitor_loads`` (only if peaks or guide loads are
    outputs) updates peaks, impulses and guide outcomes."""
    segments = {
        number: segment
        for number, segment in enumerate(c.spec.segments)
        if c.monitors_loads(segment)
    }
    if c.output_joints:
        for k in range(6 * len(c.output_joints)):
            c.case.scope.store(component("PEAKS", k), _INITIAL[k % 3])
        c.workspace.add("PEAKS", 6 * len(c.output_joints))
    reset_guides(c)
    if not segments:
        return
    numbers = c.node_size
    c.workspace.add("WRENCHES", at.PEAK_NODES * numbers), c.workspace.add("SCRATCH", _scratch(c))
    for segment in segments.values():
        if not c.emit_alias(out, segment, "wrenches"):
            _emit_wrenches(out, c, segment)
    text = out.function(
        "node_loads(w, phase: int)",
        "Joint loads at the nodes of the step just made, up to its end, into WRENCHES.",
    )
    c.workspace.add("CONTINUES", 1)
    text("first = 1")  # in lanes that go on from a step, it ended at the first node
    text.lanes()("first = 0 if w[CONTINUES + l] == 0.0 else first")
    inner = text.block(f"for i in range(first, {at.PEAK_NODES}):")
    inner.lanes()("w[THETA + l] = peaks.THETA[i] * w[REACH + l]")
    for offset, (number, segment) in enumerate(segments.items()):
        inner.block(f"{'elif' if offset else 'if'} phase == {number}:")(
            f"interpolate_{segment.name}(w)", f"wrenches_{segment.name}(w)"
        )
    inner.components(f"{numbers} * LANES")(
        f"w[WRENCHES + i * {numbers} * LANES + e + l] = w[WRENCH + e + l]"
    )
    for number, segment in segments.items():
        if segment.loads:
            _emit_stop_at_load(out, c, number, segment)
    if c.output_joints or c.output_guides:
        _emit_peaks(out, c, segments)


def _scratch(c: Context) -> int:
    """Number of components of the field SCRATCH, the temporary memory of functions of
    `sepmc.routines.peaks`: at least `PEAK_SCRATCH`, more the more pins a monitored guide has."""
    return max(
        [at.PEAK_SCRATCH, *(at.PEAK_NODES * (4 + 6 * c.pins(joint)) for joint in c.output_guides)]
    )


def _emit_peaks(out: Text, c: Context, segments: dict[int, Segment]) -> None:
    """Write the kernel function ``monitor_loads(w, phase)``, which updates, by the step just made,
    the peaks and impulses of joint loads (field PEAKS) and the guide outcomes (field GUIDES).
    ``segments`` are the segments with monitored loads, by number."""
    if c.output_joints:
        _emit_update_record(out, c)
    text = out.function(
        "monitor_loads(w, phase: int)",
        "Update peaks and impulses of joint loads by the step just made, in PEAKS.",
    )
    text("node_loads(w, phase)")
    if c.output_joints:
        text.lanes()("w[SPAN + l] = w[REACH + l] * w[LENGTH + l]")
    for k in range(0, 6 * len(c.output_joints), 3):
        _update_peak(text, c, k)
    guided = [
        (number, segment)
        for number, segment in segments.items()
        if any(map(segment.sliding_kinds, c.output_guides))
    ]
    if guided:
        inner = text.lanes().block(
            f"if w[REACH + l] * w[LENGTH + l] > {at.GRAIN}:  # shorter steps count as zero"
        )
        inner("h = w[REACH + l] * w[LENGTH + l]")
        for number, segment in guided:
            update_guides(inner.block(f"if phase == {number}:"), c, segment)
    last = at.PEAK_NODES - 1
    text.components(f"{c.node_size} * LANES")(
        f"w[WRENCHES + e + l] = w[{component('WRENCHES', last * c.node_size)} + e + l]"
    )
    text.lanes()("w[CONTINUES + l] = 1.0")


def _update_peak(text: Text, c: Context, k: int) -> None:
    """Append lines that update, by the step just made, the peak magnitude, its time and the
    integral of the magnitude of a force or moment; its first component has the number ``k`` both in
    WRENCHES (the vector) and in PEAKS (peak, time, integral). The error indicator of the integral
    (`Context.load_indicators`) becomes that of this step, if this is larger."""
    inner = text.block(f"for i in range({at.PEAK_NODES}):").components("3 * LANES")
    inner(
        "w[NODES + 3 * i * LANES + e + l] = "
        f"w[{component('WRENCHES', k)} + {c.node_size} * i * LANES + e + l]"
    )
    text.components("3 * LANES")(f"w[RECORD + e + l] = w[{component('PEAKS', k)} + e + l]")
    text.lanes()(f"w[RELATED + l] = w[{component('PEAKS', _other_peak(k))} + l]")
    text("update_record(w)")
    text.components("3 * LANES")(f"w[{component('PEAKS', k)} + e + l] = w[RECORD + e + l]")
    indicator = f"w[{c.indicator(c.load_indicators[k // 3])} + l]"
    text.lanes()(f"{indicator} = larger({indicator}, w[TRUNCATION + l])")


def _emit_update_record(out: Text, c: Context) -> None:
    """Write the kernel function ``update_record(w)``, which updates the peak magnitude of a vector,
    its time and the integral of the magnitude (field RECORD) by the step just made, from the vector
    at the nodes (field NODES). First all lanes are updated by the nodes, then those in which a
    corner or a peak between nodes must be searched."""
    text = out.function(
        "update_record(w)", "Update peak, its time and integral in RECORD by the vectors in NODES."
    )
    c.workspace.add("NODES", 3 * at.PEAK_NODES)
    c.workspace.add("RECORD", 3)
    for field in ("RELATED", "TRUNCATION", "SPAN", "FINE", "COARSE", "ROUGH", "SUMMIT"):
        c.workspace.add(field, 1)
    names = [f"node_{i}" for i in range(at.PEAK_NODES)]
    read_nodes = [
        f"{name} = get3(w, {component('NODES', 3 * i)} + l)" for i, name in enumerate(names)
    ]
    vectors = f"({', '.join(names)})"
    text.lanes()("w[FINE + l], w[COARSE + l] = 0.0, 0.0")
    inner = text.block(f"for j in range({at.PEAK_PAIRS}):").lanes()
    inner(
        *read_nodes,
        f"sizes = peaks.sizes_between(j, {vectors})",
        "w[FINE + l] = w[FINE + l] + peaks.KRONROD_PAIRS[j] * sizes",
        "w[COARSE + l] = w[COARSE + l] + peaks.GAUSS_PAIRS[j] * sizes",
    )
    text.lanes()(
        "h = w[SPAN + l]",
        *read_nodes,
        f"w[TRUNCATION + l] = peaks.truncation({vectors}) * h if h > {at.GRAIN} else 0.0",
        "record, w[ROUGH + l], w[SUMMIT + l] = peaks.update_by_nodes(",
        f"    {vectors}, w[FINE + l], w[COARSE + l], get3(w, RECORD + l), w[RELATED + l], "
        "w[BEGIN_T + l], h",
        ")",
        "put3(w, RECORD + l, record)",
    )
    text("missing = False")
    text.lanes()("missing = missing or w[ROUGH + l] > 0.0 or w[SUMMIT + l] > 0.0")
    text.block("if missing:")(
        "between_nodes.update(w, NODES, RECORD, ROUGH, SUMMIT, BEGIN_T, SPAN, SCRATCH)"
    )


def _other_peak(k: int) -> int:
    """Component of PEAKS with the peak moment of a joint if ``k`` is the one with its peak force,
    and vice versa."""
    return k + 3 if k % at.LOADS_OUTCOMES == 0 else k - 3


def _emit_stop_at_load(out: Text, c: Context, number: int, segment: Segment) -> None:
    """Write the kernel function ``stop_at_load_SEGMENT(w)``, which cuts the step just made in a
    segment (given with its number) short at the first load event within it: state and time become
    those of the event, by the continuous extension, and the flags of all load events at that time
    are set."""
    c.workspace.add("CUT", 1)
    docstring = (
        f"Cut the step just made in phase {segment.name} short at the first load event, or at "
        "simultaneous ones."
    )
    text = out.function(f"stop_at_load_{segment.name}(w)", docstring)
    text.lanes()("w[CONTINUES + l] = 0.0")  # a load event may be at the first node
    text(f"node_loads(w, {number})", "any_reached = 0.0")
    inner = text.lanes()
    inner("w[CUT + l], w[THETA + l] = 0.0, 1.0")
    inner = inner.block(f"if w[DONE + l] == 0.0 and w[LENGTH + l] > {at.GRAIN}:")
    inner("first, slope = 2.0, 0.0")
    sides: list[str] = []
    for i, load in enumerate(segment.loads):
        offset = 6 * c.monitored_joints.index(load.item) + (
            3 if load.quantity == at.AT_MOMENT else 0
        )
        threshold, nodes = (
            f"w[P + {load.threshold} * LANES + l]",
            f"{component('WRENCHES', offset)} + l, {c.node_size} * LANES",
        )
        inner(f"theta_{i} = math.inf")
        pending = (
            inner
            if load.ends_phase
            else inner.block(f"if w[{load.flag(segment.name)} + l] == 0.0:")
        )
        arguments = f"w, {nodes}, SCRATCH, {threshold}"
        if load.direction:
            side = load_side(segment, load)
            c.start(side, 0.0)
            counts = [
                load.direction in (side_name, "either") for side_name in ("rising", "falling")
            ]
            sides.append(
                f"w[{side} + l] = crossings.side_at({arguments}, w[THETA + l], w[{side} + l])"
            )
            arguments += f", w[{side} + l], {counts[0]}, {counts[1]}"
        routine = "first_crossed" if load.direction else "first_reached"
        pending(f"theta_{i}, rate = crossings.{routine}({arguments})")
        pending.block(f"if theta_{i} < first:")(f"first, slope = theta_{i}, rate")
    reached = inner.block("if first <= 1.0:")
    reached("any_reached, w[CUT + l], w[THETA + l], w[REACH + l] = 1.0, 1.0, first, first")
    reached(
        "w[T + l] = w[BEGIN_T + l] + first * w[LENGTH + l]",
        "w[END + l], w[PROGRESS + l] = w[T + l], 2.0",
    )
    reached("slow = w[LENGTH + l] / slope if slope > 0.0 else math.inf")
    for i, load in enumerate(segment.loads):
        indicator = f"{c.indicator(f'{segment.name}_{load.name}')} + l"
        simultaneous = reached.block(f"if (theta_{i} - first) * w[LENGTH + l] <= {at.GRAIN}:")
        simultaneous(
            f"w[{load.flag(segment.name)} + l], w[{indicator}] = 1.0, "
            f"max(w[{indicator}], slow if first > 0.0 else 0.0)"
        )
    inner(*sides)
    inner = text.block("if any_reached > 0.0:")
    inner(f"interpolate_{segment.name}(w)")
    inner.components(f"{c.spec.active_size(segment)} * LANES")(
        "w[Y + e + l] = w[S + e + l] if w[CUT + l] > 0.0 else w[Y + e + l]"
    )
    emit_cut_attitudes(inner, c, segment, "CUT")


def load_side(segment: Segment, load: Event) -> str:
    """Name of the workspace field of the side of its threshold on which the joint load of a
    condition was at the end of the last step: 1 below, -1 above, 0 not known. The condition of a
    phase has a field in each segment; one that counts in any phase has a single field."""
    return (
        f"SIDE_{ANY_PHASE}_{load.number}" if load.any_phase else f"SIDE_{segment.name}_{load.name}"
    )


def _emit_wrenches(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``wrenches_SEGMENT(w)``, which stores the monitored loads of joints
    and guides at the state S into the field WRENCH, and ends cases in which a formula is undefined
    there. It is not part of the derivative, which is evaluated more often than the loads."""
    docstring = (
        "Force and moment of every monitored joint at the state S and the times CLOCK, in axes "
        "of its first body, into WRENCH"
    )
    docstring += "; and monitored guide loads." if c.output_guides else "."
    text = out.function(f"wrenches_{segment.name}(w)", docstring)
    before_wrenches(text, c, segment)
    s = State(c, c.scope(), segment, "S")
    motion = make_wrenches(s)
    store_wrenches(s, motion)
    for joint, first, _, _ in c.guide_fields:
        for k, vector in enumerate(
            guide_loads(s, motion, joint) if segment.sliding_kinds(joint) else []
        ):
            s.scope.store(component("WRENCH", first + 3 * k), vector)
    if c.spec.formulas.used:
        reject_undefined(s)
    s.scope.write(text)
