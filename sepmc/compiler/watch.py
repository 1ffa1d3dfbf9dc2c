"""Lines of a written kernel that follow the loads of joints over a flight: peaks, their times, impulses."""

import math

from sepmc.compiler.context import Context, part
from sepmc.compiler.steps import emit_spread
from sepmc.compiler.text import Text
from sepmc.compiler.wrenches import emit_wrenches
from sepmc.kernels import layout as at
from sepmc.kernels import peaks

_AT_FIRST = (0.0, math.nan, 0.0)  # peak, its time, integral


def emit_watch(out: Text, c: Context) -> None:
    """A function that follows the loads over a step."""
    stages = {number: stage for number, stage in enumerate(c.shape.stages) if c.watches(stage)}
    numbers = 6 * len(c.watched)
    for k in range(numbers):
        c.case.scope.store(part("PEAKS", k), _AT_FIRST[k % 3])
    c.slabs.add("PEAKS", numbers)
    if not stages:
        return
    c.slabs.add("WRENCHES", peaks.COUNT * numbers), c.slabs.add("SCRATCH", peaks.SCRATCH)
    for stage in stages.values():
        emit_wrenches(out, c, stage)
    says = "Loads of joints at nodes of the step just made, their peaks and integrals over it into PEAKS."
    text = out.function("watch(w, phase: int)", says)
    inner = text.block(f"for i in range({peaks.COUNT}):")
    inner.lanes()("w[THETA + l] = peaks.THETA[i] * w[REACH + l]")
    emit_spread(inner, c, "THETA")
    inner("sample(w, phase)")
    for place, (number, stage) in enumerate(stages.items()):
        inner.block(f"{'elif' if place else 'if'} phase == {number}:")(f"wrenches_{stage.name}(w)")
    inner.block(f"for e in range({numbers} * LANES):")(f"w[WRENCHES + i * {numbers} * LANES + e] = w[WRENCH + e]")
    inner = text.lanes().block("if w[REACH + l] * w[LENGTH + l] > 0.0:")
    inner("h = w[REACH + l] * w[LENGTH + l]")
    for k in range(0, numbers, 3):
        nodes, found, other = (f"{place} + l" for place in (part("WRENCHES", k), part("PEAKS", k), part("PEAKS", _other(k))))
        inner(f"peaks.note_size(w, {nodes}, {numbers} * LANES, SCRATCH, {found}, {other}, w[BEGIN_T + l], h)")


def _other(k: int) -> int:
    """Where the peak of a moment stands, given that of the force, and the other way round."""
    return k + 3 if k % at.LOADS_OUTCOMES == 0 else k - 3
