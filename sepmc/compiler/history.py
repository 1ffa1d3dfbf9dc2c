"""Lines of a specialised kernel that write separations over time: the continuous extension of a step, and what is kept of it."""

from sepmc.compiler.context import Context, part
from sepmc.compiler.geometry import State
from sepmc.compiler.shape import Stage
from sepmc.compiler.steps import emit_spread
from sepmc.compiler.text import Text


def emit_history(out: Text, c: Context) -> None:
    """Functions for the state between the ends of a step, and for the separations at the instants of a history."""
    c.slabs.add("BEGIN", c.size), c.slabs.add("BEGIN_T", 1), c.slabs.add("THETA", c.size)
    _add(out)
    _extend(out, c)
    for stage in c.shape.stages:
        _separation(out, c, stage)
    _keep(out, c)


def _add(out: Text) -> None:
    """A function for a weighted sum of stages."""
    says = "Add the stages K1, K2, ..., each times its coefficient in row i, to a slab."
    text = out.function("add(w, target, i, coefficients)", says).block("for j in range(coefficients.shape[1]):")
    text("weight = coefficients[i, j]")
    text.block("if weight != 0.0:").block("for e in range(SIZE_Y):")("w[target + e] += weight * w[K1 + j * SIZE_Y + e]")


def _extend(out: Text, c: Context) -> None:
    """A function for the continuous extension, after the stages that only it needs."""
    says = "Coefficients P1, P2, ... of the state over the step just made, by powers of its share gone by."
    text = out.function("extend(w, phase: int)", says)
    stages, total, order = len(c.method.b), c.method.dense.shape[0], c.method.dense.shape[1] - 1
    c.slabs.add("POWERS", (order + 1) * c.size)
    if total > stages:
        inner = text.block(f"for i in range({stages}, {total}):")
        inner.block("for e in range(SIZE_Y):")("w[S + e] = 0.0")
        inner("add(w, S, i, A)")
        inner.block("for e in range(SIZE_Y):")("w[S + e] = w[BEGIN + e] + w[STEP + e] * w[S + e]")
        inner.lanes()("w[CLOCK + l] = w[BEGIN_T + l] + C[i] * w[STEP + l]")
        inner("rates(w, phase)")
        inner.block("for e in range(SIZE_Y):")("w[K1 + i * SIZE_Y + e] = w[D + e]")
    text.block(f"for e in range({order + 1} * SIZE_Y):")("w[POWERS + e] = 0.0")
    inner = text.block(f"for q in range(1, {order + 1}):")
    inner("add(w, POWERS + q * SIZE_Y, q, DENSE)")
    inner.block("for e in range(SIZE_Y):")("w[POWERS + q * SIZE_Y + e] *= w[STEP + e]")


def _separation(out: Text, c: Context, stage: Stage) -> None:
    """A function for the separations at a state of a phase."""
    says = f"Speed and distance of every joint at the state S of phase {stage.name}, into APART."
    text = out.function(f"separation_{stage.name}(w)", says)
    c.slabs.add("APART", 2 * len(c.shape.scene.joint))
    s = State(c, c.scope(), stage, "S")
    for j, joint in enumerate(c.shape.scene.joint):
        line = s.separation(joint)
        s.scope.store(part("APART", 2 * j), line.rate)
        s.scope.store(part("APART", 2 * j + 1), line.length)
    s.scope.write(text)


def _keep(out: Text, c: Context) -> None:
    """A function that writes the rows of a history that fall within a step. A row is written for the lanes whose step holds its instant."""
    says = "Separations at the instants within the step just made, and ``beyond`` it as a share of its length, every so many seconds."
    text = out.function("keep(w, phase: int, beyond: float, first: int, a: Arrays)", says)
    text("every, history = vector(a, 5)[0], block(a, 8)")
    text("low, high = math.inf, 0.0")
    text.lanes()("low = min(low, w[BEGIN_T + l])", "high = max(high, w[T + l] + beyond * w[STEP + l])")
    text.block("if not high < math.inf:")("return")
    rows = "range(math.ceil(low / every - 1e-9), min(math.floor(high / every + 1e-9), history.shape[1] - 1) + 1)"
    text = text.block(f"for row in {rows}:")
    inner = text.lanes()
    inner("theta = (row * every - w[BEGIN_T + l]) / w[STEP + l] if w[STEP + l] > 0.0 else 0.0", "w[THETA + l] = theta")
    emit_spread(text, c, "THETA")
    order = c.method.dense.shape[1] - 1
    inner = text.block("for e in range(SIZE_Y):")
    inner(f"total = w[POWERS + {order} * SIZE_Y + e]")
    for q in range(order - 1, 0, -1):
        inner(f"total = w[POWERS + {q} * SIZE_Y + e] + w[THETA + e] * total")
    inner("w[S + e] = w[BEGIN + e] + w[THETA + e] * total")
    for number, stage in enumerate(c.shape.stages):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"separation_{stage.name}(w)")
    inner = text.block("for l in range(min(LANES, history.shape[0] - first)):")
    inner("t, past = row * every, beyond * w[STEP + l]")
    inner = inner.block("if w[BEGIN_T + l] - 1e-12 <= t <= w[T + l] + past + 1e-12 and w[STEP + l] > 0.0:")
    inner.block(f"for k in range({2 * len(c.shape.scene.joint)}):")("history[first + l, row, k] = w[APART + k * LANES + l]")
