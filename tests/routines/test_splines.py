"""Tables as splines, against closed forms and scipy."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline, PchipInterpolator, RegularGridInterpolator
from spline_values import curve, grid6
from support.compiled import compiled

from sepmc.kernel.emit.tables import cell_sum_lines
from sepmc.kernel.spec.splines import pack
from sepmc.routines import layout
from sepmc.routines.lanes import LANES
from sepmc.routines.splines import in_cell, load_cell

curve = compiled(curve)
grid6 = compiled(grid6)
in_cell = compiled(in_cell)
load_cell = compiled(load_cell)
X = [-1.0, -0.2, 0.1, 0.9, 1.4]
Y = [0.0, 1.0, 1.5, 2.5]
Z = [-3.0, -2.0, 0.0, 0.5, 1.0, 4.0]
NAN = [math.nan] * 6


def table(axes, functions=6, seed=1):
    """Numbers of order one on a grid."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (functions, *map(len, axes)))


def inside(axes, count, seed=2):
    """Random points within the axes."""
    return np.random.default_rng(seed).uniform(
        [a[0] for a in axes], [a[-1] for a in axes], (count, len(axes))
    )


def test_cubic_polynomials_are_exact():
    """Degree 3 in each of three coordinates, on uneven axes of four points and more."""
    c = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 4, 4, 6))
    values = np.polynomial.polynomial.polygrid3d(X, Y, Z, c)  # functions first
    numbers = pack([X, Y, Z], values)
    for point in inside([X, Y, Z], 50):
        expected = np.polynomial.polynomial.polyval3d(*point, c)
        # terms to 500, some hundred of them
        assert_allclose(grid6(numbers, 0, *point), expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    "counts",
    [
        (1, 1, 1),
        (2, 1, 1),
        (1, 3, 1),
        (1, 1, 4),
        (2, 3, 4),
        (4, 1, 5),
        (5, 4, 6),
        (3, 2, 1),
        (2, 2, 2),
    ],
)
def test_data_are_reproduced(counts):
    """Also with one, two and three points on an axis; the pack may start anywhere in the array."""
    axes = [axis[:n] for axis, n in zip((X, Y, Z[:2] + Z[2:]), counts, strict=True)]
    values = table(axes)
    numbers = np.concatenate([[9.0, 8.0, 7.0], pack(axes, values)])
    for i, x in enumerate(axes[0]):
        for j, y in enumerate(axes[1]):
            for k, z in enumerate(axes[2]):
                assert_allclose(grid6(numbers, 3, x, y, z), values[:, i, j, k], rtol=0, atol=1e-13)


def test_three_axes_agree_with_scipy():
    values = table([X, Y, Z])
    numbers = pack([X, Y, Z], values)
    for x, y, z in inside([X, Y, Z], 30):
        expected = CubicSpline(
            Z, CubicSpline(Y, CubicSpline(X, values, axis=1)(x), axis=1)(y), axis=1
        )(z)
        assert_allclose(grid6(numbers, 0, x, y, z), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("counts", "interpolation"),
    [
        ((1, 1, 1), "cubic"),
        ((3, 1, 1), "cubic"),
        ((1, 5, 1), "cubic"),
        ((4, 5, 1), "cubic"),
        ((2, 4, 6), "cubic"),
        ((4, 5, 1), "linear"),
        ((4, 5, 1), "monotone"),
    ],
)
def test_loaded_cells_agree_with_lookups(counts, interpolation):
    """Lanes moving through a table, each with a loaded cell, stay in it or leave it; on edges, too,
    and NaN outside."""
    axes = [axis[:n] for axis, n in zip((X, Y, Z), counts, strict=True)]
    pack_of = pack(axes, table(axes), interpolation=interpolation)
    seen = [4 if n > 1 else 1 for n in counts]
    at, cell, point = (
        0,
        len(pack_of),
        len(pack_of) + LANES * (layout.CELL_COEFFICIENTS + 6 * math.prod(seen)),
    )
    out = point + 3 * LANES
    w = np.concatenate([pack_of, np.zeros(out + 6 * LANES - at - len(pack_of))])
    for n in range(3):
        w[cell + 3 * n * LANES : cell + (3 * n + 1) * LANES] = math.inf
    lines = "\n".join(cell_sum_lines(str(cell), str(point), str(out), 6, seen))
    random, n_in_cell = np.random.default_rng(4), 0
    lanes = inside(axes, LANES)
    for turn in range(60):
        lanes = np.clip(
            lanes + random.normal(0.0, 0.05, lanes.shape),
            [a[0] for a in axes],
            [a[-1] for a in axes],
        )
        if turn == 30:  # a point outside, and back
            lanes[0, int(np.argmax(seen))] += 1e3
        w[point : point + 3 * LANES] = lanes.T.ravel()
        for lane in range(LANES):
            if in_cell(w, cell + lane, *lanes[lane]):
                n_in_cell += 1
            else:
                load_cell(w, cell + lane, at, *lanes[lane])
        for lane in range(LANES):
            exec(lines, {"w": w, "l": lane, "LANES": LANES})
        expected = np.array([grid6(pack_of, 0, *lanes[lane]) for lane in range(LANES)])
        assert_allclose(w[out:].reshape(6, LANES).T, expected, rtol=0, atol=1e-13)
        assert np.isnan(expected[0]).all() == (turn == 30 and max(counts) > 1)
    assert n_in_cell > 20 * LANES


@pytest.mark.parametrize("axis", [[-1.0, 0.0], [0.0, 1.0, 3.0], [-3.0, -2.0], [1.0, 1.0 + 1e-9]])
def test_a_coordinate_held_at_an_end_stays_in_its_cell(axis):
    """As the distance of a table of increments beyond its range: the cell is loaded once. The next
    number beyond is outside, and the end of a span within begins the next."""
    pack_of = pack([axis], np.zeros((1, len(axis))), interpolation="linear")
    for value, beyond in ((axis[0], -math.inf), (axis[-1], math.inf)):
        w = np.concatenate([pack_of, np.zeros(LANES * (layout.CELL_COEFFICIENTS + 4))])
        cell = len(pack_of)
        w[cell : cell + 9 * LANES] = math.inf
        assert load_cell(w, cell, 0, value, 0.0, 0.0)
        assert in_cell(w, cell, value, 0.0, 0.0)
        outside = value + math.copysign(1e-14 * (abs(value) + axis[-1] - axis[0]), beyond)
        assert not in_cell(w, cell, outside, 0.0, 0.0)
        assert not load_cell(w, cell, 0, outside, 0.0, 0.0)
        assert load_cell(w, cell, 0, axis[0], 0.0, 0.0)
        assert in_cell(w, cell, axis[1], 0.0, 0.0) == (len(axis) == 2)


def test_few_points_give_the_line_and_the_parabola():
    # 5 - 3 x; 1 - 3 x + 2 x2
    line, parabola = pack([[1.0, 3.0]], [[2.0, -4.0]]), pack([[0.0, 1.0, 3.0]], [[1.0, 0.0, 10.0]])
    for x in (1.0, 1.3, 2.9, 3.0):
        assert_allclose(curve(line, 0, 0, x), 5.0 - 3.0 * x, rtol=0, atol=1e-14)
        assert_allclose(curve(parabola, 0, 0, x), 1.0 - 3.0 * x + 2.0 * x * x, rtol=0, atol=1e-14)
    assert curve(pack([[1.0]], [[7.0]]), 0, 0, 5.0) == 7.0


@pytest.mark.parametrize("ends", ["not-a-knot", "flat"])
def test_twice_continuously_differentiable(ends):
    """The cubics left and right of a grid point differ by a jump of the third derivative only: by
    an eighth at half the distance."""
    axis = [0.0, 1.0, 1.8, 3.1, 4.0, 5.2, 6.0]
    numbers = pack([axis], table([axis], 2), ends)

    def miss(b, h):
        f = [curve(numbers, 0, 1, b + i * h) for i in (1, 0, -1, -2, -3)]
        return f[0] - 4.0 * f[1] + 6.0 * f[2] - 4.0 * f[3] + f[4]

    for b in axis[2:-2]:
        assert abs(miss(b, 0.1)) > 1e-5
        assert_allclose(miss(b, 0.05) / miss(b, 0.1), 0.125, rtol=1e-8)


@pytest.mark.parametrize("points", [2, 3, 4, 7])
def test_flat_ends(points):
    axis = list(np.cumsum(np.arange(1.0, points + 1.0)))
    values = table([axis], 1)
    numbers, expected = (
        pack([axis], values, "flat"),
        CubicSpline(axis, values[0], bc_type="clamped"),
    )
    for x in np.linspace(axis[0], axis[-1], 30):
        assert_allclose(curve(numbers, 0, 0, x), expected(x), rtol=0, atol=1e-13)
    step = 1e-4
    assert abs(curve(numbers, 0, 0, axis[0] + step) - values[0, 0]) < 10.0 * step**2


@pytest.mark.parametrize("ends", ["not-a-knot", "flat"])
def test_curves_are_constant_beyond_their_ends(ends):
    values = table([X], 3)
    numbers = pack([X], values, ends)
    for function in range(3):
        assert_allclose(
            curve(numbers, 0, function, -100.0), values[function, 0], rtol=0, atol=1e-14
        )
        assert_allclose(
            curve(numbers, 0, function, math.inf), values[function, -1], rtol=0, atol=1e-14
        )
    assert math.isnan(curve(numbers, 0, 0, math.nan))


def test_grids_are_not_extrapolated():
    """The edge is inside, the next number beyond is not; NaN stays NaN along an axis of one point,
    too."""
    axes = [X, Y, Z]
    numbers = pack(axes, table(axes))
    middle = [0.0, 1.2, 0.3]
    for i, axis in enumerate(axes):
        for edge, beyond in ((axis[0], -math.inf), (axis[-1], math.inf)):
            point = middle.copy()
            point[i] = edge
            assert np.all(np.isfinite(grid6(numbers, 0, *point)))
            for bad in (math.nextafter(edge, beyond), beyond, math.nan):
                point[i] = bad
                assert_allclose(grid6(numbers, 0, *point), NAN)
    assert_allclose(grid6(pack([], table([])), 0, 0.0, math.nan, 0.0), NAN)


def test_missing_axes():
    """Nothing varies along an axis of one point or none, for any argument."""
    y, yz, xz, xy = table([Y]), table([Y, Z]), table([X, Z]), table([X, Y])
    assert_allclose(grid6(pack([], y[:, 0]), 0, 5.0, 6.0, 7.0), y[:, 0], rtol=0)
    along_x, along_y = pack([Y], y), pack([[0.0], Y], y[:, None])
    first = pack([[0.0], Y, Z], yz[:, None])
    second, third = pack([X, [3.0], Z], xz[:, :, None]), pack([X, Y], xy)
    for u, v, w in inside([X, Y, Z], 20):
        assert_allclose(
            grid6(along_x, 0, v, u, w), CubicSpline(Y, y, axis=1)(v), rtol=0, atol=1e-13
        )
        assert_allclose(grid6(along_y, 0, 1e9, v, w), grid6(along_x, 0, v, 0.0, 0.0), rtol=0)
        for numbers, values, a, b in (
            (first, yz, (Y, v), (Z, w)),
            (second, xz, (X, u), (Z, w)),
            (third, xy, (X, u), (Y, v)),
        ):
            point = (u, v, w)
            expected = CubicSpline(b[0], CubicSpline(a[0], values, axis=1)(a[1]), axis=1)(b[1])
            assert_allclose(grid6(numbers, 0, *point), expected, rtol=0, atol=1e-12)


def test_lines_agree_with_scipy():
    """Three axes at random points, rows and edges: scipy's interpolator of grids."""
    axes, values = [X, Y, Z], table([X, Y, Z])
    numbers = pack(axes, values, interpolation="linear")
    expected = RegularGridInterpolator(axes, np.moveaxis(values, 0, -1))
    for point in [*inside(axes, 50), [X[2], Y[1], Z[3]], [X[0], Y[-1], Z[-1]]]:
        assert_allclose(grid6(numbers, 0, *point), expected(point)[0], rtol=0, atol=1e-14)
    assert_allclose(grid6(numbers, 0, X[-1], math.nextafter(Y[-1], 9.0), 0.0), NAN)


def test_lines_between_two_points_are_lines():
    numbers = pack([[1.0, 3.0]], [[2.0, -4.0]], "flat", "linear")
    for x in (1.0, 1.3, 2.9, 3.0):
        assert_allclose(curve(numbers, 0, 0, x), 5.0 - 3.0 * x, rtol=0, atol=1e-14)


def test_monotone_cubics_agree_with_scipy():
    """One axis, every row and between them; the same along a line of rows of two axes."""
    values = table([Z])
    numbers, expected = (
        pack([Z], values, interpolation="monotone"),
        PchipInterpolator(Z, values, axis=1),
    )
    for x in [*np.linspace(Z[0], Z[-1], 40), *Z]:
        assert_allclose(grid6(numbers, 0, x, 0.0, 0.0), expected(x), rtol=0, atol=1e-14)
    values = table([X, Z])
    numbers = pack([X, [0.0], Z], values[:, :, None], interpolation="monotone")
    for i, x in enumerate(X):
        for z in np.linspace(Z[0], Z[-1], 20):
            result = PchipInterpolator(Z, values[:, i], axis=1)(z)
            assert_allclose(grid6(numbers, 0, x, 7.0, z), result, rtol=0, atol=1e-13)


def test_monotone_cubics_stay_between_their_rows():
    """A step of a table: the spline leaves it, monotone cubics do not, also with flat ends."""
    axis, values = [0.0, 1.0, 1.1, 1.2, 3.0], np.array([[0.0, 0.0, 1.0, 1.0, 1.0]])
    points = np.linspace(0.0, 3.0, 301)

    def reached(interpolation, ends):
        numbers = pack([axis], values, ends, interpolation)
        found = [curve(numbers, 0, 0, x) for x in points]
        return min(found), max(found)

    assert reached("cubic", "flat")[1] > 1.05
    for ends in ("flat", "not-a-knot"):
        assert reached("monotone", ends) == (0.0, 1.0)
