"""Emitter of the continuous extension of a step: the polynomial of the state between its ends."""

import numpy as np

from sepmc.kernel.emit.context import Context
from sepmc.kernel.emit.steps import coefficient, restore_stage, rotating_from
from sepmc.kernel.spec.kernel_spec import Segment
from sepmc.kernel.tracer.formulas import square_root
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import total


def emit_extension(out: Text, c: Context) -> None:
    """Write the kernel functions ``make_extension(w, phase, size)``, which computes the
    coefficients of the continuous extension of the step just made, and, for each segment that
    needs it, ``interpolate_SEGMENT(w)``, which computes the state at the fraction THETA (a field)
    of that step. The fields that they need are added to the workspace."""
    c.workspace.add("BEGIN", c.size)
    # fraction of the step to interpolate at; start and length of the step; its present end as a
    # fraction of that length: less than 1 if it was cut short
    for name in ("THETA", "BEGIN_T", "LENGTH", "REACH"):
        c.workspace.add(name, 1)
    _emit_make_extension(out, c)
    for segment in c.spec.segments:
        if c.uses_extension(segment):
            _emit_interpolate(out, c, segment)


def _emit_make_extension(out: Text, c: Context) -> None:
    """Write the kernel function ``make_extension(w, phase, size)``, which evaluates the stages that
    only the extension needs, and stores the coefficients of the powers 1, 2, ... of the elapsed
    fraction of the step into the field POWERS (after room for power 0, which is in BEGIN).
    ``phase`` is the number of the segment, ``size`` that of its state components, times LANES."""
    docstring = (
        "Coefficients of the state over the step just made, by powers of the elapsed fraction, "
        "into POWERS."
    )
    text = out.function("make_extension(w, phase: int, size: int)", docstring)
    rk = c.extended
    stages, total, order = rk.stages, rk.dense.shape[0], rk.dense.shape[1] - 1
    c.workspace.add("POWERS", (order + 1) * c.size)
    for i in range(stages, total):
        if np.array_equal(rk.a[i, :stages], rk.b) and not rk.a[i, stages:].any():
            text.components("size")("w[S + e + l] = w[Y + e + l]")  # not projected yet
            text.lanes()("w[CLOCK + l] = w[T + l]")
        else:
            restore_stage(text, rk, i, "size")
        text("rates(w, phase)")
        text.components("size")(f"w[K{i + 1} + e + l] = w[D + e + l]")
    text.lanes()("w[LENGTH + l] = w[STEP + l]", "w[REACH + l] = 1.0")
    for first in range(1, order + 1, 2):  # registers hold the constants of two powers
        inner = text.components("size")
        pair = rk.dense[:, first : first + 2]
        inner("h = w[STEP + e + l]")
        inner(*(f"k{j + 1} = w[K{j + 1} + e + l]" for j in range(total) if pair[j].any()))
        for q, weights in enumerate(pair.T, first):
            terms = [
                f"{coefficient(rk, 'D', q - 1, j)} * k{j + 1}"
                for j in np.flatnonzero(weights).tolist()
            ]
            inner.wrapped(f"w[POWERS + {q} * SIZE_Y + e + l] = h * (", terms, ")")


def _emit_interpolate(out: Text, c: Context, segment: Segment) -> None:
    """Write the kernel function ``interpolate_SEGMENT(w)``, which stores the state at the fraction
    THETA of the step just made in a segment into S, its time into CLOCK; attitudes have unit
    length."""
    docstring = (
        "State at the fractions THETA of the step just made, attitudes of unit length, into S; "
        "time into CLOCK."
    )
    text = out.function(f"interpolate_{segment.name}(w)", docstring)
    text.lanes()("w[CLOCK + l] = w[BEGIN_T + l] + w[THETA + l] * w[LENGTH + l]")
    order = c.extended.dense.shape[1] - 1
    inner = text.components(f"{c.spec.active_size(segment)} * LANES")
    inner(f"total = w[POWERS + {order} * SIZE_Y + e + l]")
    for power in range(order - 1, 0, -1):
        inner(f"total = w[POWERS + {power} * SIZE_Y + e + l] + w[THETA + l] * total")
    inner("w[S + e + l] = w[BEGIN + e + l] + w[THETA + l] * total")
    number = c.spec.segments.index(segment)
    for first, bodies in rotating_from(c):
        if first <= number:
            scope = c.scope()
            for body in bodies:
                q = scope.load(f"S + Q_{body}", 4).called("q")
                length = square_root(total([q[i] * q[i] for i in range(4)]))
                inverse = (1.0 / length).called("inverse")
                scope.store(f"S + Q_{body}", tuple(q[i] * inverse for i in range(4)))
            scope.write(text)
