"""Lines of a specialised kernel that write separations over time."""

from sepmc.compiler.context import Context, part
from sepmc.compiler.geometry import State
from sepmc.compiler.shape import Stage
from sepmc.compiler.steps import emit_spread
from sepmc.compiler.text import Text


def emit_history(out: Text, c: Context) -> None:
    """Functions for the separations at the instants of a history."""
    for stage in c.shape.stages:
        _separation(out, c, stage)
    _keep(out, c)


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
    says = "Separations at the instants within the step just made, every so many seconds."
    text = out.function("keep(w, phase: int, first: int, a: Arrays)", says)
    text("every, history = vector(a, 5)[0], block(a, 8)")
    text("low, high = math.inf, 0.0")
    text.lanes()("low = min(low, w[BEGIN_T + l])", "high = max(high, w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l])")
    text.block("if not high < math.inf:")("return")
    rows = "range(math.ceil(low / every - 1e-9), min(math.floor(high / every + 1e-9), history.shape[1] - 1) + 1)"
    text = text.block(f"for row in {rows}:")
    inner = text.lanes()
    inner("theta = (row * every - w[BEGIN_T + l]) / w[LENGTH + l] if w[LENGTH + l] > 0.0 else 0.0", "w[THETA + l] = theta")
    emit_spread(text, c, "THETA")
    text("sample(w, phase)")
    for number, stage in enumerate(c.shape.stages):
        text.block(f"{'elif' if number else 'if'} phase == {number}:")(f"separation_{stage.name}(w)")
    inner = text.block("for l in range(min(LANES, history.shape[0] - first)):")
    inner("t, last = row * every, w[BEGIN_T + l] + w[REACH + l] * w[LENGTH + l]")
    inner = inner.block("if w[BEGIN_T + l] - 1e-12 <= t <= last + 1e-12 and w[LENGTH + l] > 0.0:")
    inner.block(f"for k in range({2 * len(c.shape.scene.joint)}):")("history[first + l, row, k] = w[APART + k * LANES + l]")
