"""Lines of a written kernel for the state between the ends of a step: the continuous extension of
the step just made."""

from collections.abc import Iterable

from sepmc.kernel.emit.context import Context
from sepmc.kernel.emit.steps import restore_stage, turning_from
from sepmc.kernel.tracer.formulas import square_root
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total


def emit_extension(out: Text, c: Context) -> None:
    """Functions for the coefficients of the extension, and for a state by them."""
    c.workspace.add("BEGIN", c.size), c.workspace.add("THETA", c.size)
    # start and length of the step, and where its phase ends, as a share of it: about 1
    for name in ("BEGIN_T", "LENGTH", "REACH"):
        c.workspace.add(name, 1)
    _extend(out, c)
    _sample(out, c)


def _extend(out: Text, c: Context) -> None:
    """A function for the continuous extension, after the stages that only it needs."""
    says = (
        "Coefficients P1, P2, ... of the state over the step just made, by powers of its share "
        "gone by."
    )
    text = out.function("make_extension(w, phase: int)", says)
    rk = c.extended
    stages, total, order = rk.stages, rk.dense.shape[0], rk.dense.shape[1] - 1
    c.workspace.add("POWERS", (order + 1) * c.size)
    for i in range(stages, total):
        restore_stage(text, rk, i)
        text("rates(w, phase)")
        text.block("for e in range(SIZE_Y):")(f"w[K{i + 1} + e] = w[D + e]")
    text.lanes()("w[LENGTH + l] = w[STEP + l]", "w[REACH + l] = 1.0")
    text.block("for e in range(SIZE_Y):")("w[POWERS + e] = 0.0")
    used = [j for j in range(total) if rk.dense[j].any()]
    inner = text.block(f"for q in range(1, {order + 1}):")
    names = [f"by_{j + 1}" for j in used]
    inner.broken(f"{', '.join(names)} = {', '.join(f'DENSE[q, {j}]' for j in used)}")
    sum_of_stages = _weighted(zip(used, names, strict=True))
    inner.block("for e in range(SIZE_Y):").broken(
        f"w[POWERS + q * SIZE_Y + e] = w[STEP + e] * ({sum_of_stages})"
    )


def _weighted(stages: Iterable[tuple[int, str]]) -> str:
    """The sum of stages by number, each times a coefficient."""
    return " + ".join(f"{coefficient} * w[K{j + 1} + e]" for j, coefficient in stages)


def _sample(out: Text, c: Context) -> None:
    """A function for a state between the ends of a step."""
    says = (
        "The state at the shares THETA of the step just made, attitudes of unit length, into "
        "S, and its time into CLOCK."
    )
    text = out.function("interpolate(w, phase: int)", says)
    text.lanes()("w[CLOCK + l] = w[BEGIN_T + l] + w[THETA + l] * w[LENGTH + l]")
    order = c.extended.dense.shape[1] - 1
    inner = text.block("for e in range(SIZE_Y):")
    inner(f"total = w[POWERS + {order} * SIZE_Y + e]")
    for power in range(order - 1, 0, -1):
        inner(f"total = w[POWERS + {power} * SIZE_Y + e] + w[THETA + e] * total")
    inner("w[S + e] = w[BEGIN + e] + w[THETA + e] * total")
    for first, bodies in turning_from(c):
        scope = c.scope()
        for body in bodies:
            q = scope.load(f"S + Q_{body}", 4).called("q")
            inverse = (1.0 / square_root(total([q[i] * q[i] for i in range(4)]))).called("inverse")
            scope.store(f"S + Q_{body}", tuple(q[i] * inverse for i in range(4)))
        scope.write(text if first == 0 else text.block(f"if phase >= {first}:"))
