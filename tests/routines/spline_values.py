"""Values of packed splines by plain sums over their basis functions: reference for the kernels."""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.routines.splines import _after, _coefficients, _span


@long_formula
def curve(numbers, at, function, x):
    """Value of one function of a one-dimensional pack; constant beyond the ends, NaN for NaN.

    Parameters
    ----------
    numbers : array
    at : int
        Position of the pack.
    function : int
        Number of the function.
    x : float

    Returns
    -------
    float
    """
    noinline()
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


@long_formula
def grid6(numbers, at, x, y, z):
    """Values of the six functions of a pack.

    Parameters
    ----------
    numbers : array
    at : int
        Position of the pack.
    x, y, z : float

    Returns
    -------
    tuple of 6 float
        NaN outside the range of an axis with more than one point (no extrapolation); the ends are
        inside.
    """
    noinline()
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
    for i in range(x_count):  # plain loops: half the time of sums of tuples by axis
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


@routine
def _basis(numbers, axis, x):
    """Span of x, number of nonzero basis functions there, and their values, which sum to one; NaN
    outside the axis."""
    spans = int(numbers[axis])
    if spans == 0:
        return 0, 1, (math.nan if math.isnan(x) else 1.0, 0.0, 0.0, 0.0)
    breaks = axis + 1
    if not numbers[breaks] <= x <= numbers[breaks + spans]:
        return 0, 4, (math.nan, math.nan, math.nan, math.nan)
    low = _span(numbers, axis, x)
    s = x - numbers[breaks + low]
    p = breaks + spans + 1 + 16 * low
    return (
        low,
        4,
        (
            _cubic(numbers, p, s),
            _cubic(numbers, p + 4, s),
            _cubic(numbers, p + 8, s),
            _cubic(numbers, p + 12, s),
        ),
    )


@routine
def _cubic(numbers, p, s):
    """Polynomial in s with four coefficients from ``numbers[p]`` on."""
    return numbers[p] + s * (numbers[p + 1] + s * (numbers[p + 2] + s * numbers[p + 3]))
