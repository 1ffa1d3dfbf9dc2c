"""Smooth tables: value of cubic splines on a grid of up to three axes.

A pack stands in a flat array as ``sepmc.compiler.splines`` wrote it: the number of functions; for each of three axes its spans q,
q + 1 breaks and, for each span, four basis functions as cubics in the distance from the span's start; the coefficients, the last axis
fastest, the functions side by side. An axis of one point has no span and one coefficient, the others have q + 3.
"""

import math

from sepmc.kernels._jit import keep_apart, routine, stage
from sepmc.kernels.lanes import LANES


@routine
def curve(numbers, at, function, x):
    """Value of one function of a one-dimensional pack at ``numbers[at]``; held constant beyond the ends, NaN for NaN."""
    keep_apart()
    axis = at + 1
    first, last = numbers[axis + 1], numbers[axis + 1 + int(numbers[axis])]
    if x < first:
        x = first
    elif x > last:
        x = last
    span, count, w = _basis(numbers, axis, x)
    functions = int(numbers[at])
    p = _after(numbers, _after(numbers, _after(numbers, axis))) + span * functions + function
    total = 0.0
    for i in range(count):
        total += w[i] * numbers[p + i * functions]
    return total


@routine
def grid6(numbers, at, x, y, z):
    """Values of the six functions of a pack at ``numbers[at]``.

    NaN outside the range of an axis that has more than one point: nothing is extrapolated. A value on the edge is inside.
    """
    keep_apart()
    x_axis = at + 1
    y_axis = _after(numbers, x_axis)
    z_axis = _after(numbers, y_axis)
    x_span, x_count, u = _basis(numbers, x_axis, x)
    y_span, y_count, v = _basis(numbers, y_axis, y)
    z_span, z_count, w = _basis(numbers, z_axis, z)
    y_stride = 6 * _coefficients(numbers, z_axis)
    x_stride = y_stride * _coefficients(numbers, y_axis)
    corner = _after(numbers, z_axis) + x_span * x_stride + y_span * y_stride + 6 * z_span
    s0 = s1 = s2 = s3 = s4 = s5 = 0.0
    for i in range(x_count):  # three plain loops: half the time of sums of tuples axis by axis
        for j in range(y_count):
            uv = u[i] * v[j]
            for k in range(z_count):
                uvw = uv * w[k]
                p = corner + i * x_stride + j * y_stride + 6 * k
                s0 += uvw * numbers[p]
                s1 += uvw * numbers[p + 1]
                s2 += uvw * numbers[p + 2]
                s3 += uvw * numbers[p + 3]
                s4 += uvw * numbers[p + 4]
                s5 += uvw * numbers[p + 5]
    return s0, s1, s2, s3, s4, s5


@stage
def put_grid6(w, k, at, x, y, z):
    """`grid6` of a pack in a workspace of lanes, into the six numbers from w[k] on."""
    found = grid6(w, at, x, y, z)
    for i in range(6):
        w[k + i * LANES] = found[i]


@stage
def put6_zero(w, k):
    """Zero into the six numbers from w[k] on."""
    for i in range(6):
        w[k + i * LANES] = 0.0


@stage
def add_curves6(w, k, at, x, factor):
    """Add to the six numbers from w[k] on, times a factor, the six functions of a pack in a workspace of lanes."""
    for i in range(6):
        w[k + i * LANES] += factor * curve(w, at, i, x)


@stage
def _basis(numbers, axis, x):
    """Span that holds x, how many basis functions are not zero there, and their values, which sum to one; NaN outside the axis."""
    spans = int(numbers[axis])
    if spans == 0:
        return 0, 1, (math.nan if math.isnan(x) else 1.0, 0.0, 0.0, 0.0)
    breaks = axis + 1
    if not numbers[breaks] <= x <= numbers[breaks + spans]:
        return 0, 4, (math.nan, math.nan, math.nan, math.nan)
    low, high = 0, spans
    while high - low > 1:
        middle = (low + high) // 2
        if x < numbers[breaks + middle]:
            high = middle
        else:
            low = middle
    s = x - numbers[breaks + low]
    p = breaks + spans + 1 + 16 * low
    return low, 4, (_cubic(numbers, p, s), _cubic(numbers, p + 4, s), _cubic(numbers, p + 8, s), _cubic(numbers, p + 12, s))


@stage
def _cubic(numbers, p, s):
    """Polynomial in s whose four coefficients start at ``numbers[p]``."""
    return numbers[p] + s * (numbers[p + 1] + s * (numbers[p + 2] + s * numbers[p + 3]))


@stage
def _coefficients(numbers, axis):
    """How many coefficients stand along an axis."""
    return int(numbers[axis]) + 3 if numbers[axis] > 0.0 else 1


@stage
def _after(numbers, axis):
    """Place after the numbers of an axis."""
    return axis + 2 + 17 * int(numbers[axis])
