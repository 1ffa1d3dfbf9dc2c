"""Tables as functions on a grid of up to three axes: piecewise cubics, packed into one flat array
(a pack).

An axis is divided at breaks into spans. On each span it has four basis functions, stored as cubic
polynomials, so that a kernel finds the span and evaluates four cubics without a division. Packs of
all interpolations are read in the same way, by ``sepmc.routines.splines``:

- ``"cubic"``: cubic B-splines on a clamped knot vector. Unless the ends are flat, two and three
  points give a line and a parabola, raised to cubics on one span.
- ``"linear"``: two hat functions; the other two basis functions are zero.
- ``"monotone"``: the Hermite functions of values and slopes at both ends of a span. Slopes are
  those of Fritsch and Butland (scipy's ``PchipInterpolator``), axis by axis: between two rows no
  value is outside the range of the two. Each row has two coefficients (value, slope), so it is two
  breaks at one point, with an empty span between them.
- ``"steps"``: constant from each row up to the next one.
"""

from collections.abc import Sequence
from math import factorial

import numpy as np

AXES = 3
FAR = 1e15  # length of the spans beyond the ends of a function that is continued as a constant
_BOUNDARY = {"flat": "clamped"}
# the Hermite functions on 0 to 1 in powers of the coordinate: value and slope at the start, at the
# end
_HERMITE = ((1, 0, -3, 2), (0, 1, -2, 1), (0, 0, 3, -2), (0, 0, -1, 1))


def pack(
    axes: Sequence[Sequence[float]],
    values: np.ndarray,
    ends: str = "not-a-knot",
    interpolation: str | Sequence[str] = "cubic",
) -> np.ndarray:
    """Interpolate tabulated functions and pack the interpolant into one array.

    Parameters
    ----------
    axes : sequence of sequences of float
        grid points of each axis, strictly increasing; at most three axes. A function is constant
        along a missing axis or one with a single point.
    values : ndarray, shape (functions, n1, n2, n3), without the missing axes
        the functions at the grid points
    ends : {"not-a-knot", "flat", "constant"}
        behaviour at the ends of every axis. "not-a-knot" reproduces cubic polynomials; "flat" has
        zero slope at both ends, which is smooth if the function is constant beyond (ignored with
        the interpolations "linear" and "steps"). "constant" is "not-a-knot" within the range, with
        one more, very long span beyond each end, in which the function is constant: it has kinks at
        the ends.
    interpolation : {"cubic", "linear", "monotone", "steps"}, or one for each axis
        with "steps" each value holds from its point up to the next one, the last one without end

    Returns
    -------
    ndarray, shape (size,)
        number of functions; for each of three axes the number of spans q, q + 1 breaks and 16 q
        basis coefficients; then the coefficients over the grid, the last axis fastest, with the
        functions side by side. The functions are twice ("cubic"), once ("monotone") or not
        ("linear") continuously differentiable.
    """
    coefficients = np.asarray(values, float)
    assert len(axes) <= AXES
    assert coefficients.shape[1:] == tuple(len(points) for points in axes)
    head = [[float(len(coefficients))]]
    kinds = [interpolation] * len(axes) if isinstance(interpolation, str) else interpolation
    for points, kind in zip(axes, kinds, strict=True):  # each pass moves the first axis to the end
        places, rows = np.asarray(points, float), coefficients
        if len(points) > 1 and kind == "monotone":
            basis, coefficients = _monotone(places, rows, ends)
        else:
            make = {"linear": _lines, "steps": _steps}.get(kind) if len(points) > 1 else None
            basis, matrix = make(places) if make else _axis(places, ends)
            coefficients = np.tensordot(rows, matrix, (1, 1))
        if ends == "constant" and len(points) > 1 and kind != "steps":
            basis = _with_constant_ends(basis)
            edges = (rows[:, :1], rows[:, -1:])
            first, last = (np.moveaxis(edge, 1, -1) for edge in edges)
            coefficients = np.concatenate([first, coefficients, last], axis=-1)
        head.append(basis)
    head += [[0.0, 0.0]] * (AXES - len(axes))
    return np.concatenate([*head, np.moveaxis(coefficients, 0, -1).ravel()])


def _axis(points, ends):
    """Return the numbers of one axis of a pack (number of spans, breaks, basis polynomials) for
    cubic splines, and the matrix, shape (coefficients, points), that maps tabulated values to
    spline coefficients. The ``points`` must rise strictly. An axis of one point has no span and the
    matrix 1. ``ends`` is as in `pack`, but constants beyond the ends are added by
    `_with_constant_ends`."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415  (0.3 s that scenes without tables do not need)

    assert np.all(np.diff(points) > 0.0)
    count = len(points)
    if count == 1:
        return [0.0, points[0]], np.eye(1)
    if ends == "flat" or count > 3:
        spline = make_interp_spline(points, np.eye(count), k=3, bc_type=_BOUNDARY.get(ends))
        knots, matrix = spline.t, spline.c
    else:
        matrix = make_interp_spline(points, np.eye(count), k=count - 1).c
        for degree in range(count - 1, 3):
            matrix = _raised(degree) @ matrix
        knots = np.repeat(points[[0, -1]], 4)
    breaks = knots[3:-3]
    return [float(len(breaks) - 1), *breaks, *_pieces(knots, breaks[:-1]).ravel()], matrix


def _lines(points):
    """Return the numbers of one axis of a pack (number of spans, breaks, basis polynomials) for
    linear interpolation, and the matrix, shape (points + 2, points), that maps tabulated values
    to coefficients: the values and two zeros."""
    widths = np.diff(points)
    pieces = np.zeros((len(widths), 4, 4))
    pieces[:, 0, 0], pieces[:, 0, 1], pieces[:, 1, 1] = 1.0, -1.0 / widths, 1.0 / widths
    return [float(len(widths)), *points, *pieces.ravel()], np.eye(len(points) + 2, len(points))


def _steps(points):
    """Return the numbers of one axis of a pack (number of spans, breaks, basis polynomials) for
    steps (each value from its point up to the next one, the last value without end: one span for
    each point), and the matrix, shape (points + 3, points), that maps tabulated values to
    coefficients: the values and three zeros."""
    pieces = np.zeros((len(points), 4, 4))
    pieces[:, 0, 0] = 1.0
    breaks = [*points, points[-1] + FAR]
    return [float(len(points)), *breaks, *pieces.ravel()], np.eye(len(points) + 3, len(points))


def _with_constant_ends(basis):
    """Return the numbers of one axis of a pack, given as ``basis``, with one more span of length
    FAR beyond each end, on which the function is constant. The caller adds the constants to the
    coefficients: one before the first, one after the last."""
    spans = int(basis[0])
    breaks, pieces = basis[1 : spans + 2], basis[spans + 2 :]
    constants = np.zeros((2, 4, 4))
    constants[0, 0, 0] = constants[1, 3, 0] = 1.0
    before, after = constants.reshape(2, 16)
    breaks = [breaks[0] - FAR, *breaks, breaks[-1] + FAR]
    return [float(spans + 2), *breaks, *before, *pieces, *after]


def _monotone(points, values, ends):
    """Return the numbers of one axis of a pack (number of spans, breaks, basis polynomials) for
    monotone cubics, and the coefficients of functions with the tabulated ``values``, shape
    (functions, points, ...): value and slope of each point in turn, shape (functions, ..., 2
    points). ``ends`` is as in `_axis`."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415

    slopes = PchipInterpolator(points, values, axis=1).derivative()(points)
    if ends == "flat":
        slopes[:, [0, -1]] = 0.0
    breaks = np.repeat(points, 2)[1:-1]
    widths = np.diff(breaks)
    powers = np.where(widths > 0.0, widths, 1.0)[:, None] ** -np.arange(4.0)
    pieces = np.array(_HERMITE) * powers[:, None]  # (spans, functions, powers)
    pieces[:, 1::2] *= widths[:, None, None]  # slopes are per unit of the axis
    both = np.stack([values, slopes], axis=2)  # (functions, points, 2, ...)
    coefficients = both.reshape(len(values), 2 * len(points), *values.shape[2:])
    return [float(len(widths)), *breaks, *pieces.ravel()], np.moveaxis(coefficients, 1, -1)


def _raised(degree):
    """Matrix, shape (degree + 2, degree + 1), that maps the Bernstein coefficients of a polynomial
    of a degree to those of the same polynomial written with a degree one higher."""
    raised = np.zeros((degree + 2, degree + 1))
    for i in range(degree + 1):
        raised[i, i] = 1.0 - i / (degree + 1)
        raised[i + 1, i] = (i + 1) / (degree + 1)
    return raised


def _pieces(knots, starts):
    """Coefficients of the cubic B-spline basis functions i to i + 3 on span i, as polynomials in x
    minus the start of the span, shape (spans, 4 functions, 4 ascending powers). ``knots`` is the
    whole clamped knot vector, ``starts`` has the start of each span."""
    from scipy.interpolate import BSpline  # noqa: PLC0415

    basis = BSpline(knots, np.eye(len(knots) - 4), 3)
    # each (spans, functions)
    powers = [basis(starts, nu=power) / factorial(power) for power in range(4)]
    rows = np.arange(len(starts))[:, None]
    return np.stack([power[rows, rows + np.arange(4)] for power in powers], axis=-1)
