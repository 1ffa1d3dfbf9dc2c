"""Lines of a written kernel for the state between the ends of a step: the continuous extension of
the step just made."""

from sepmc.kernel.context import Context
from sepmc.kernel.formulas import square_root
from sepmc.kernel.recorder import total
from sepmc.kernel.steps import turning_from
from sepmc.kernel.text import Text


def emit_extension(out: Text, c: Context) -> None:
    """Functions for the coefficients of the extension, and for a state by them."""
    c.slabs.add("BEGIN", c.size), c.slabs.add("THETA", c.size)
    # start and length of the step, and where its phase ends, as a share of it: about 1
    for name in ("BEGIN_T", "LENGTH", "REACH"):
        c.slabs.add(name, 1)
    _add(out)
    _extend(out, c)
    _sample(out, c)


def _add(out: Text) -> None:
    """A function for a weighted sum of stages."""
    says = "Add the stages K1, K2, ..., each times its coefficient in row i, to a slab."
    text = out.function("add(w, target, i, coefficients)", says).block(
        "for j in range(coefficients.shape[1]):"
    )
    text("weight = coefficients[i, j]")
    text.block("if weight != 0.0:").block("for e in range(SIZE_Y):")(
        "w[target + e] += weight * w[K1 + j * SIZE_Y + e]"
    )


def _extend(out: Text, c: Context) -> None:
    """A function for the continuous extension, after the stages that only it needs."""
    says = (
        "Coefficients P1, P2, ... of the state over the step just made, by powers of its share "
        "gone by."
    )
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
    text.lanes()("w[LENGTH + l] = w[STEP + l]", "w[REACH + l] = 1.0")
    text.block(f"for e in range({order + 1} * SIZE_Y):")("w[POWERS + e] = 0.0")
    inner = text.block(f"for q in range(1, {order + 1}):")
    inner("add(w, POWERS + q * SIZE_Y, q, DENSE)")
    inner.block("for e in range(SIZE_Y):")("w[POWERS + q * SIZE_Y + e] *= w[STEP + e]")


def _sample(out: Text, c: Context) -> None:
    """A function for a state between the ends of a step."""
    says = (
        "The state at the shares THETA of the step just made, attitudes of unit length, into "
        "S, and its time into CLOCK."
    )
    text = out.function("sample(w, phase: int)", says)
    text.lanes()("w[CLOCK + l] = w[BEGIN_T + l] + w[THETA + l] * w[LENGTH + l]")
    order = c.method.dense.shape[1] - 1
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
