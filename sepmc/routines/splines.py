"""Tables of one or more functions as piecewise cubics on a grid of up to three axes.

The data of a table, its pack, are stored in a flat array as ``sepmc.kernel.spec.splines`` writes
it: the number of functions; for each of three axes its number of spans q (intervals between
breaks), its q + 1 breaks and, for each span, four basis functions as cubics in the distance from
the span's start; then the coefficients, the last axis fastest, the functions side by side. An axis
of one point has no span and one coefficient, the others have q + 3. A cell is a span of each axis.
"""

import math

from sepmc.jit import long_formula, noinline, routine
from sepmc.routines import layout
from sepmc.routines.lanes import LANES

_BEYOND = 4e-16  # relative: the next larger number


@long_formula
def in_cell(w, cell, x, y, z):
    """Return True if the point (x, y, z), in the units of the axes, is in the cell that `load_cell`
    has last loaded for a lane at w[cell]. The start of each span is in it; the end is not, unless
    it is the end of the grid."""
    return (
        w[cell] <= x < w[cell + LANES]
        and w[cell + 3 * LANES] <= y < w[cell + 4 * LANES]
        and w[cell + 6 * LANES] <= z < w[cell + 7 * LANES]
    )


@long_formula
def load_cell(w, cell, at, x, y, z):
    """Load, for one lane, the data of the cell of a pack that contains a point into the workspace.

    The data of an axis are copied only if its span has changed. At first the start of each span in
    the cell must be infinite, which means that no cell is loaded. An axis of one point has no ends.

    Parameters
    ----------
    w : array
        Workspace.
    cell : int
        Position in w of the cell's data for the lane, LANES apart (`layout.CELL_ENDS`, ...).
    at : int
        Position in w of the pack.
    x, y, z : float
        The point, in the units of the axes.

    Returns
    -------
    bool
        False if the point is outside the grid (its ends are inside); the coefficients are then set
        to NaN. They are NaN, too, but the result is True, if a coordinate is NaN.
    """
    noinline()
    functions, inside = int(w[at]), True
    x_axis = at + 1
    y_axis = _after(w, x_axis)
    z_axis = _after(w, y_axis)
    z_stride = functions
    y_stride = z_stride * _coefficients(w, z_axis)
    x_stride = y_stride * _coefficients(w, y_axis)
    corner = _after(w, z_axis)
    for n, axis, value, stride in (
        (0, x_axis, x, x_stride),
        (1, y_axis, y, y_stride),
        (2, z_axis, z, z_stride),
    ):
        ends, basis, spans = (
            cell + (layout.CELL_ENDS + 3 * n) * LANES,
            cell + (layout.CELL_BASIS + 16 * n) * LANES,
            int(w[axis]),
        )
        if spans == 0:
            w[ends], w[ends + LANES] = -math.inf, math.inf
            inside = inside and not math.isnan(value)
            continue
        inside = inside and w[axis + 1] <= value <= w[axis + 1 + spans]
        low = _span(w, axis, value)
        corner += low * stride
        start = w[axis + 1 + low]
        if w[ends] == start:
            continue
        end = w[axis + 2 + low]
        if low == spans - 1:  # a coordinate may be held at the end of the grid for long
            end += _BEYOND * (end - start + abs(end))
        w[ends], w[ends + LANES], w[ends + 2 * LANES] = start, end, start
        for i in range(16):
            w[basis + i * LANES] = w[axis + spans + 2 + 16 * low + i]
    k = cell + layout.CELL_COEFFICIENTS * LANES
    for i in range(4 if w[x_axis] > 0.0 else 1):
        for j in range(4 if w[y_axis] > 0.0 else 1):
            for n in range(4 if w[z_axis] > 0.0 else 1):
                for f in range(functions):
                    w[k] = (
                        w[corner + i * x_stride + j * y_stride + n * z_stride + f]
                        if inside
                        else math.nan
                    )
                    k += LANES
    if not inside:
        w[cell] = math.inf  # no point is in it
    return inside or math.isnan(x) or math.isnan(y) or math.isnan(z)


@routine
def _span(numbers, axis, x):
    """Return the number, from 0, of the span of an axis that contains ``x``; the first or the last
    span if x is beyond the ends. ``axis`` is the position in ``numbers`` of the data of the
    axis."""
    low, high = 0, int(numbers[axis])
    while high - low > 1:
        middle = (low + high) // 2
        if x < numbers[axis + 1 + middle]:
            high = middle
        else:
            low = middle
    return low


@routine
def _coefficients(numbers, axis):
    """Return the number of spline coefficients along a whole axis: its number of spans plus 3, or 1
    for an axis of one point. ``axis`` is the position in ``numbers`` of the data of the axis."""
    return int(numbers[axis]) + 3 if numbers[axis] > 0.0 else 1


@routine
def _after(numbers, axis):
    """Return the position in ``numbers`` just after the data of the axis that start at
    numbers[axis]."""
    return axis + 2 + 17 * int(numbers[axis])
