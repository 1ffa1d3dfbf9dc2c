"""Lines of a specialised kernel for a step: its length, its stages, what follows its end; and the short step to an event."""

from collections.abc import Callable

import numpy as np

from sepmc.compiler.emit_context import Context
from sepmc.compiler.emit_events import emit_met
from sepmc.compiler.emit_loads import feels_air
from sepmc.compiler.text import Text
from sepmc.kernels.methods import Method, method

# A step may be so many times as long as the last one; the way to an event, left to a method of low order, only a small part of it:
# hundredths are usual, and a way much longer is that to END, of an event that was foretold and does not come (a stroke just missed).
_LONGER, _SHORT = 3.0, 0.05
_UNEVEN = 1.6  # times as long as the last: such a step errs by more than the trial cases' and its estimate may not tell
_BEYOND = 0.55  # a height turns half of its rate times the time to its turning further on; a tenth more for an acceleration that changes


def coefficients(rk: Method) -> list[str]:
    """The coefficients a step uses, as named constants."""
    lines = []
    stages = len(rk.b)
    for i in range(1, stages):
        for j in range(i):
            if rk.a[i, j] != 0.0:
                lines.append(f"A{i + 1}_{j + 1} = {float(rk.a[i, j])!r}")
    lines += [f"B{j + 1} = {float(rk.b[j])!r}" for j in range(stages) if rk.b[j] != 0.0]
    lines += [f"E{j + 1} = {float(rk.doubt[j])!r}" for j in range(stages) if rk.doubt[j] != 0.0]
    lines += [f"C{i + 1} = {float(rk.c[i])!r}" for i in range(1, stages)]
    return lines


def emit_lengths(out: Text, c: Context) -> None:
    """A function for the step lengths of all lanes."""
    says = "Length of the first of ``left`` steps to END or to the next event, into all of STEP; an event is never foretold later than"
    text = out.function("set_step(w, phase: int, left: int, usual: float)", says + " ``usual`` at first.")
    text.lanes()("w[STEP + l] = w[END + l] - w[T + l]")
    for number, stage in enumerate(c.shape.stages):
        if stage.events:
            text.block(f"if phase == {number}:")(f"aim_{stage.name}(w, usual)")
    text.lanes()("w[STEP + l] /= left")
    emit_spread(text, c, "STEP")


def emit_spread(text: Text, c: Context, slab: str) -> None:
    """Lines that copy the first numbers of a slab, one a lane, to the places of all numbers of a state, by doubling."""
    filled = 1
    while filled < c.size:
        more = min(filled, c.size - filled)
        text.block(f"for e in range({more} * LANES):")(f"w[{slab} + {filled} * LANES + e] = w[{slab} + e]")
        filled += more


def emit_advance(out: Text, c: Context) -> None:
    """A function for one step by the method of the module; with a history, the beginning of the step is kept."""
    rk = c.method
    says = f"One of ``left`` steps of a phase by {rk.name}; ``size`` numbers of the state take part."
    text = out.function("advance(w, phase: int, size: int, left: int, usual: float)", says)
    stages, later = len(rk.b), np.empty((0, len(rk.b)))
    if c.history:
        later = np.vstack([rk.a[stages:, :stages], rk.dense[:stages].T])
    _begin(text, "left, usual", c.history)
    inner = text.lanes()  # an event that was foretold and then does not come leaves too long a way for the last step
    inner("h = abs(w[STEP + l])", "w[LOST + l] = w[LOST + l] if h <= w[LONGEST + l] else 1.0")
    inner(f"w[UNEVEN + l] = 1.0 if h > {_UNEVEN / _LONGER:.3g} * w[LONGEST + l] else w[UNEVEN + l]")
    inner(f"w[LONGEST + l] = {_LONGER} * h + 1e-9")
    _stages(text, rk, later, lambda name, _: name, rk.doubt)
    text("guard(w, phase)")
    if c.history:
        text("extend(w, phase)")
    text("settle(w, phase)")


def emit_approach(out: Text, c: Context) -> None:
    """A function for the rest of the way to an event: what is left is short, so that a method of low order will do."""
    rk = method("rk4")
    says = f"The rest of the way to an event: a short step by {rk.name}, and a last correction along the derivative."
    text = out.function("approach(w, phase: int, size: int)", says)
    _begin(text, "1, math.inf", False)
    text.lanes()(f"w[LOST + l] = w[LOST + l] if abs(w[STEP + l]) <= {_SHORT / _LONGER:.3g} * w[LONGEST + l] else 1.0")
    _stages(text, rk, np.empty((0, len(rk.b))), lambda _, value: repr(value))
    text("settle(w, phase)", "set_step(w, phase, 1, math.inf)")
    text.block("for e in range(size):")("w[Y + e] += w[STEP + e] * w[D + e]")
    inner = text.lanes()
    inner("h = w[STEP + l]", "w[T + l] += h", "w[EVENT_ERROR + l] = larger(w[EVENT_ERROR + l], h * h)")
    inner("w[LOST + l] = w[LOST + l] if abs(h) < 1e-6 else 1.0")
    emit_met(text, c)


def _begin(text: Text, length: str, keeps: bool) -> None:
    """Derivative K1 at the start of a step, and the step's length; ``keeps`` the state and the time it starts from."""
    inner = text.block("for e in range(size):")
    inner("w[S + e] = w[Y + e]")
    if keeps:
        inner("w[BEGIN + e] = w[Y + e]")
    inner = text.lanes()
    inner("w[CLOCK + l] = w[T + l]")
    if keeps:
        inner("w[BEGIN_T + l] = w[T + l]")
    text("rates(w, phase)")
    text.block("for e in range(size):")("w[K1 + e] = w[D + e]")
    text(f"set_step(w, phase, {length})")


def _stages(text: Text, rk: Method, later: np.ndarray, spell: Callable[[str, float], str], doubt: np.ndarray | None = None) -> None:
    """From K1 to the state Y and the time T at the end of a step; with weights of a ``doubt``, also what the step may do wrong, into DOUBT.

    later : weights of what uses the derivatives of the stages after the step, by rows: these derivatives are kept, the others never stored
    spell : what stands for a coefficient, given its name and value
    """
    stages = len(rk.b)
    weights = [*rk.a[:stages, :stages], rk.b, *later]
    ends = rk.b if doubt is None else np.abs(rk.b) + np.abs(doubt)
    names = [[f"A{i + 1}_{j + 1}" for j in range(stages)] for i in range(stages)] + [[f"B{j + 1}" for j in range(stages)]]
    for i in range(1, stages + 1):
        used = [j for j in range(i) if weights[i][j] != 0.0]
        kept = any(row[i - 1] != 0.0 for row in weights[i + 1 :]) or (i < stages and ends[i - 1] != 0.0)
        inner = text.block("for e in range(size):")
        if i > 1 and (i - 1 in used or kept):
            inner(f"k{i} = w[D + e]")
            if kept:
                inner(f"w[K{i} + e] = k{i}")
        values = [f"k{i}" if j == i - 1 and i > 1 else f"w[K{j + 1} + e]" for j in used]
        if i == stages and doubt is not None:
            wrong = [f"E{j + 1} * {f'k{i}' if j == i - 1 else f'w[K{j + 1} + e]'}" for j in np.flatnonzero(doubt)]
            inner.wrapped("w[DOUBT + e] = w[STEP + e] * (", wrong, ")")
        terms = [f"{spell(names[i][j], float(weights[i][j]))} * {value}" for j, value in zip(used, values, strict=True)]
        inner.wrapped(f"w[{'S' if i < stages else 'Y'} + e] = w[Y + e] + w[STEP + e] * (", terms, ")")
        if i < stages:
            text.lanes()(f"w[CLOCK + l] = w[T + l] + {spell(f'C{i + 1}', float(rk.c[i]))} * w[STEP + l]")
            text("rates(w, phase)")
    text.lanes()("w[T + l] += w[STEP + l]")


def emit_settle(out: Text, c: Context) -> None:
    """A function for what is done at the end of a step."""
    shape, slabs = c.shape, c.slabs
    says = "After a step: attitudes of unit length, pitch and roll followed through turns, constraints, and what disqualifies a case."
    text = out.function("settle(w, phase: int)", says)
    for body in shape.turning:
        first = next((n for n, stage in enumerate(shape.stages) if body in stage.leaders), None)
        if first is not None:
            slabs.add(f"ANGLES_{body}", 2)
            _settle_attitude(text if first == 0 else text.block(f"if phase >= {first}:"), body)
    inner = text.lanes()
    if slabs.has("AIR"):
        slabs.add("FAR", 1)
        inner("far = 0.0")
        for body in shape.bodies:
            if feels_air(shape, body):
                _settle_height(inner, c, body)
        inner("w[FAR + l], w[LOST + l] = far, w[LOST + l] if far <= NEAR else 1.0")
    inner("w[STEPS + l] += 1.0")
    if slabs.has("AIR"):
        text("farthest = 0.0")
        text.lanes()("farthest = max(farthest, w[FAR + l])")
        text.block("if farthest > 0.5 * NEAR:")("centre(w, 0.5 * NEAR)")
    for number, stage in enumerate(shape.stages):
        if stage.rows:
            text.block(f"if phase == {number}:")(f"correct_{stage.name}(w)")


def emit_guard(out: Text, c: Context) -> None:
    """A function that keeps the largest doubt there was of any step."""
    text = out.function("guard(w, phase: int)", "The largest that steps may have done wrong, for every body, into GUARD.")
    shape = c.shape
    inner = text.lanes()
    for body in shape.bodies:
        _largest(inner, c, "V", body, 3)
    for body in shape.turning:
        first = next((n for n, stage in enumerate(shape.stages) if body in stage.leaders), None)
        if first is not None:
            inner = (text if first == 0 else text.block(f"if phase >= {first}:")).lanes()
            _largest(inner, c, "Q", body, 4)
            _largest(inner, c, "OMEGA", body, 3)


def _largest(text: Text, c: Context, what: str, body: str, count: int) -> None:
    guard = c.guard(f"{what}_{body}")
    text(f"{guard} = larger({guard}, largest{count}(get{count}(w, DOUBT + {what}_{body} + l)))")


def _settle_height(text: Text, c: Context, body: str) -> None:
    """A case is lost if a body leaves its layer of air at the end of a step or, where it turns from climbing to falling or back, within."""
    height = f"w[Y + X_{body} + LANES + l] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * w[T + l])"
    climb = f"w[Y + V_{body} + LANES + l] + w[ORIGIN_CLIMB + l]"
    if c.slabs.add(f"CLIMB_{body}", 2):  # height and its rate at the last end of a step
        c.parameters(f"w[CLIMB_{body} + l], w[CLIMB_{body} + LANES + l] = {height}, {climb}")
    text(f"height, climb = {height}, {climb}")
    text(f"before, rate = w[CLIMB_{body} + l], w[CLIMB_{body} + LANES + l]")
    text(f"w[CLIMB_{body} + l], w[CLIMB_{body} + LANES + l] = height, climb")
    text("turns = rate * climb < 0.0")
    text(f"top = before + {_BEYOND} * rate * abs(rate) * abs(w[STEP + l]) / abs(climb - rate if turns else 1.0) if turns else height")
    text(f"level, far = geopotential(height), larger(far, abs(height - w[NEAR_{body} + l]))")
    text("w[LOST + l] = w[LOST + l] if level >= w[AIR + l] and level <= w[AIR_TOP + l] else 1.0")
    text("level = geopotential(top)", "w[LOST + l] = w[LOST + l] if level >= w[AIR + l] and level <= w[AIR_TOP + l] else 1.0")


def _settle_attitude(text: Text, body: str) -> None:
    """A body's attitude after a step; a case is lost if it turned too far to tell how many turns it made."""
    text = text.lanes()
    text(f"q0, q1, q2, q3 = get4(w, Y + Q_{body} + l)")
    text("length = math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)", "inverse = 1.0 / length")
    text("w[DRIFT + l] = larger(w[DRIFT + l], abs(length - 1.0))")
    text("q = (q0 * inverse, q1 * inverse, q2 * inverse, q3 * inverse)", f"put4(w, Y + Q_{body} + l, q)")
    text("r = quat.matrix(q)", f"last_pitch, last_roll = w[ANGLES_{body} + l], w[ANGLES_{body} + LANES + l]")
    text("pitch, roll = nearest_turn(quat.pitch(r), last_pitch), nearest_turn(quat.roll(r), last_roll)")
    text(f"omega = get3(w, Y + OMEGA_{body} + l)", "turned = math.sqrt(vec3.dot(omega, omega)) * abs(w[STEP + l])")
    text("change = larger(larger(abs(pitch - last_pitch), abs(roll - last_roll)), turned)")
    text("unclear = abs(r[6]) > SINE_SINGULAR or change > 0.5 * math.pi")
    text("w[TURNED_FAR + l] = 1.0 if unclear else w[TURNED_FAR + l]", "w[LOST + l] = 1.0 if turned > 2.0 else w[LOST + l]")
    text(f"w[ANGLES_{body} + l], w[ANGLES_{body} + LANES + l] = pitch, roll")
