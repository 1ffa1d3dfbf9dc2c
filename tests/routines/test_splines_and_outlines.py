"""Tables as splines, and distances between outlines, against closed forms and scipy."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from sepmc.kernel.emit.tables import cell_sum_lines
from sepmc.kernel.spec.splines import pack
from sepmc.physics.outlines import gap, gap_bound, inside_gap, wall_gap
from sepmc.physics.rims import rim_gap
from sepmc.physics.separation import widest_gap
from sepmc.routines import layout
from sepmc.routines.lanes import LANES
from sepmc.routines.splines import curve, grid6, in_cell, load_cell

X = [-1.0, -0.2, 0.1, 0.9, 1.4]
Y = [0.0, 1.0, 1.5, 2.5]
Z = [-3.0, -2.0, 0.0, 0.5, 1.0, 4.0]
NAN = [math.nan] * 6


def table(axes, functions=6, seed=1):
    """Numbers of order one on a grid."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (functions, *map(len, axes)))


def inside(axes, count, seed=2):
    """Random places within the axes."""
    return np.random.default_rng(seed).uniform(
        [a[0] for a in axes], [a[-1] for a in axes], (count, len(axes))
    )


def test_cubic_polynomials_are_exact():
    """Degree 3 in each of three coordinates, on uneven axes of four points and more."""
    c = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 4, 4, 6))
    values = np.polynomial.polynomial.polygrid3d(X, Y, Z, c)  # functions first
    numbers = pack([X, Y, Z], values)
    for place in inside([X, Y, Z], 50):
        expected = np.polynomial.polynomial.polyval3d(*place, c)
        # terms to 500, some hundred of them
        assert_allclose(grid6(numbers, 0, *place), expected, rtol=0, atol=1e-11)


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
    """Also that one, two and three points on an axis serve; the pack need not stand at the start of
    the array."""
    axes = [axis[:n] for axis, n in zip((X, Y, Z[:2] + Z[2:]), counts, strict=True)]
    values = table(axes)
    numbers = np.concatenate([[9.0, 8.0, 7.0], pack(axes, values)])
    for i, x in enumerate(axes[0]):
        for j, y in enumerate(axes[1]):
            for k, z in enumerate(axes[2]):
                assert_allclose(grid6(numbers, 3, x, y, z), values[:, i, j, k], rtol=0, atol=1e-13)


def test_three_axes_agree_with_scipy_one_after_the_other():
    values = table([X, Y, Z])
    numbers = pack([X, Y, Z], values)
    for x, y, z in inside([X, Y, Z], 30):
        expected = CubicSpline(
            Z, CubicSpline(Y, CubicSpline(X, values, axis=1)(x), axis=1)(y), axis=1
        )(z)
        assert_allclose(grid6(numbers, 0, x, y, z), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("counts", [(1, 1, 1), (3, 1, 1), (1, 5, 1), (4, 5, 1), (2, 4, 6)])
def test_cells_that_lanes_hold_give_what_is_looked_up(counts):
    """Lanes that wander through a table, each in a cell of its own, stay in it or leave it; on
    edges too, and NaN outside."""
    axes = [axis[:n] for axis, n in zip((X, Y, Z), counts, strict=True)]
    pack_of = pack(axes, table(axes))
    seen = [4 if n > 1 else 1 for n in counts]
    at, cell, place = (
        0,
        len(pack_of),
        len(pack_of) + LANES * (layout.CELL_COEFFICIENTS + 6 * math.prod(seen)),
    )
    found = place + 3 * LANES
    w = np.concatenate([pack_of, np.zeros(found + 6 * LANES - at - len(pack_of))])
    for n in range(3):
        w[cell + 3 * n * LANES : cell + (3 * n + 1) * LANES] = math.inf
    lines = "\n".join(cell_sum_lines(str(cell), str(place), str(found), 6, seen))
    random, held = np.random.default_rng(4), 0
    lanes = inside(axes, LANES)
    for turn in range(60):
        lanes = np.clip(
            lanes + random.normal(0.0, 0.05, lanes.shape),
            [a[0] for a in axes],
            [a[-1] for a in axes],
        )
        if turn == 30:  # a place outside, and back
            lanes[0, int(np.argmax(seen))] += 1e3
        w[place : place + 3 * LANES] = lanes.T.ravel()
        for lane in range(LANES):
            if in_cell(w, cell + lane, *lanes[lane]):
                held += 1
            else:
                load_cell(w, cell + lane, at, *lanes[lane])
        for lane in range(LANES):
            exec(lines, {"w": w, "l": lane, "LANES": LANES})
        expected = np.array([grid6(pack_of, 0, *lanes[lane]) for lane in range(LANES)])
        assert_allclose(w[found:].reshape(6, LANES).T, expected, rtol=0, atol=1e-13)
        assert np.isnan(expected[0]).all() == (turn == 30 and max(counts) > 1)
    assert held > 20 * LANES


def test_few_points_give_the_line_and_the_parabola():
    # 5 - 3 x; 1 - 3 x + 2 x2
    line, parabola = pack([[1.0, 3.0]], [[2.0, -4.0]]), pack([[0.0, 1.0, 3.0]], [[1.0, 0.0, 10.0]])
    for x in (1.0, 1.3, 2.9, 3.0):
        assert_allclose(curve(line, 0, 0, x), 5.0 - 3.0 * x, rtol=0, atol=1e-14)
        assert_allclose(curve(parabola, 0, 0, x), 1.0 - 3.0 * x + 2.0 * x * x, rtol=0, atol=1e-14)
    assert curve(pack([[1.0]], [[7.0]]), 0, 0, 5.0) == 7.0


@pytest.mark.parametrize("ends", ["not-a-knot", "flat"])
def test_twice_continuously_differentiable(ends):
    """The cubic left of a grid point misses the right by a jump of the third derivative only: by an
    eighth at half the distance."""
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
def test_curves_are_held_beyond_their_ends(ends):
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
    """The edge is inside, the next number beyond is not; NaN stays NaN along an axis of one point
    too."""
    axes = [X, Y, Z]
    numbers = pack(axes, table(axes))
    middle = [0.0, 1.2, 0.3]
    for i, axis in enumerate(axes):
        for edge, beyond in ((axis[0], -math.inf), (axis[-1], math.inf)):
            place = middle.copy()
            place[i] = edge
            assert np.all(np.isfinite(grid6(numbers, 0, *place)))
            for bad in (math.nextafter(edge, beyond), beyond, math.nan):
                place[i] = bad
                assert_allclose(grid6(numbers, 0, *place), NAN)
    assert_allclose(grid6(pack([], table([])), 0, 0.0, math.nan, 0.0), NAN)


def test_missing_axes():
    """An axis of one point or none is one along which nothing varies, wherever its argument is."""
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
            place = (u, v, w)
            expected = CubicSpline(b[0], CubicSpline(a[0], values, axis=1)(a[1]), axis=1)(b[1])
            assert_allclose(grid6(numbers, 0, *place), expected, rtol=0, atol=1e-12)


# --- outlines
# --------------------------------------------------------------------------------------------------

ALONG_X, ALONG_Y, ALONG_Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
CLOSE = 1e-10  # m, of parts of metres
SLAB = 1e-6  # m; the direction between the points is known to the root of what the distance is
SHAPES = ["frustum", "cylinder", "cone", "disc", "needle", "point"]


def tuples(v):
    return tuple(float(x) for x in v)


def as_point(p):
    """A point as a part."""
    return p, ALONG_X, 0.0, 0.0, 0.0


def a_part(rng, shape, spread=3.0):
    """A part of random size, place and attitude."""
    axis = rng.normal(size=3)
    length, r0, r1 = rng.uniform(0.1, 3.0), *rng.uniform(0.05, 1.5, 2)
    if shape in ("disc", "point"):
        length = 0.0
    if shape in ("needle", "point"):
        r0 = r1 = 0.0
    r1 = {"cylinder": r0, "cone": 0.0}.get(shape, r1)
    return (
        tuples(rng.uniform(-spread, spread, 3)),
        tuples(axis / np.linalg.norm(axis)),
        length,
        float(r0),
        float(r1),
    )


def some_pairs(count, seed, spread=3.0):
    """Pairs of all shapes; one in four with parallel axes, one in four on one axis."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        a, b = (a_part(rng, rng.choice(SHAPES), spread) for _ in range(2))
        if i % 4 == 0:
            b = (b[0], a[1], *b[2:])
        elif i % 4 == 1:
            b = (
                tuples(np.add(a[0], rng.uniform(-5.0, 5.0) * np.array(a[1]))),
                tuples(np.negative(a[1])),
                *b[2:],
            )
        yield a, b


def moved(part, rotation, shift):
    """The same part seen in other axes."""
    return tuples(rotation.apply(part[0]) + shift), tuples(rotation.apply(part[1])), *part[2:]


def reach(part, u):
    """Greatest u . p over a part: the further of its two discs."""
    start, axis, length, r0, r1 = (np.array(x) for x in part)
    across = np.linalg.norm(u - (u @ axis) * axis)
    return max(u @ start + r0 * across, u @ (start + length * axis) + r1 * across)


def excess(part, p):
    """How far a point is out of a part at most along or across its axis, m."""
    start, axis, length, r0, r1 = (np.array(x) for x in part)
    along = (p - start) @ axis
    rho = np.linalg.norm(p - start - along * axis)
    share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    largest = max(r0, r1) if length == 0.0 else r0 + (r1 - r0) * share
    return max(-along, along - length, rho - largest)


def check(a, b, close=CLOSE, found=None):
    """Distance, proved: the points are in their parts and that far apart, and the slab between them
    separates the parts."""
    distance, x, y = found or gap(a, b)
    x, y = np.array(x), np.array(y)
    assert excess(a, x) < close
    assert excess(b, y) < close
    assert_allclose(np.linalg.norm(y - x), distance, rtol=0, atol=close)
    if distance > 1e-3:
        u = (y - x) / distance
        assert -reach(b, -u) - reach(a, u) > distance - SLAB
    return distance


def test_distance_is_proved_on_random_pairs():
    distances = [check(a, b) for a, b in some_pairs(400, seed=5)]
    assert 0.05 < np.mean(np.array(distances) == 0.0) < 0.5


def test_widest_gap_is_proved_where_it_is_found():
    """From directions up to 6 degrees off, and from any: what it finds is the distance."""
    rng, apart, near, far = np.random.default_rng(7), 0, 0, 0
    for a, b in some_pairs(400, seed=12):
        distance, x, y = gap(a, b)
        if distance < 1e-3:
            assert math.isnan(widest_gap(a, b, tuples(rng.normal(size=3)), 1e-12, 1e-15)[0])
            continue
        apart += 1
        u = (np.array(x) - y) / distance
        for off in (0.1 * rng.uniform(-1.0, 1.0, 3), rng.normal(size=3)):
            found = widest_gap(a, b, tuples(u + off), 1e-12, 1e-15)
            if not math.isnan(found[0]):
                assert_allclose(check(a, b, found=found), distance, rtol=0, atol=CLOSE)
                near, far = near + (abs(off).max() <= 0.1), far + (abs(off).max() > 0.1)
    assert near > 0.6 * apart  # the others meet at an end or on both sides
    assert far > 0.1 * apart


def test_widest_gap_of_a_rim_and_a_side():
    """A disc on edge above a cone: nearest on the normal of its side (slope 1 in 2, so a point at
    (1, 2.5) is 2.0 above the side at x = 1, 2.0 cos from it)."""
    cone, point = ((0.0, 0.0, 0.0), ALONG_X, 2.0, 0.0, 1.0), as_point((1.0, 2.5, 0.0))
    disc = ((1.0, 3.0, 0.0), ALONG_Y, 0.0, 0.5, 0.5)  # faces the cone: its end, not its rim
    on_edge = ((1.0, 3.0, 0.0), ALONG_X, 0.0, 0.5, 0.5)
    foot = (1.8, 0.9, 0.0)
    for part in (point, on_edge):
        distance, x, y = widest_gap(cone, part, (0.0, -1.0, 0.1), 1e-12, 1e-15)
        assert_allclose(distance, 2.0 * 2.0 / math.sqrt(5.0), rtol=1e-12)
        assert_allclose(x, foot, atol=1e-9)
        assert_allclose(y, (1.0, 2.5, 0.0), atol=1e-9)
    assert math.isnan(
        widest_gap(as_point((1.0, 0.0, 0.0)), disc, (0.0, -1.0, 0.0), 1e-12, 1e-15)[0]
    )


def test_distance_against_a_minimiser():
    """Over both points, each told by its share of the length and by two coordinates across, in
    radii there."""

    def point(part, across, q):
        start, axis, length, r0, r1 = part
        if length == 0.0:
            r0 = r1 = max(r0, r1)
        return start + q[0] * length * np.array(axis) + (r0 + q[0] * (r1 - r0)) * (q[1:] @ across)

    for a, b in some_pairs(60, seed=6):
        across_a, across_b = (np.linalg.svd(np.array([part[1]]))[2][1:] for part in (a, b))

        def square(q, a=a, b=b, across_a=across_a, across_b=across_b):
            return np.sum((point(a, across_a, q[:3]) - point(b, across_b, q[3:])) ** 2)

        found = minimize(
            square,
            [0.5, 0.01, 0.01] * 2,
            method="SLSQP",
            bounds=[(0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)] * 2,
            constraints={
                "type": "ineq",
                "fun": lambda q: [1.0 - q[1] ** 2 - q[2] ** 2, 1.0 - q[4] ** 2 - q[5] ** 2],
            },
            options={"ftol": 1e-14, "maxiter": 500},
        )
        # what the minimiser gives
        assert_allclose(gap(a, b)[0], math.sqrt(found.fun), rtol=1e-5, atol=1e-5)


def test_points_and_spheres_of_no_radius():
    distance, x, y = gap(as_point((1.0, 2.0, 3.0)), as_point((1.0, -1.0, 7.0)))
    assert (distance, x, y) == (5.0, (1.0, 2.0, 3.0), (1.0, -1.0, 7.0))
    assert gap(as_point((1.0, 2.0, 3.0)), as_point((1.0, 2.0, 3.0)))[0] == 0.0


@pytest.mark.parametrize("apart", [2.0, 1e-3, 1e-6, 1e-9, 1e-12])
def test_cylinders_side_by_side_and_crossed(apart):
    """Parallel, crossed at right angles and skew: distance of the lines less both radii."""
    a = ((-2.0, 0.0, 0.0), ALONG_X, 4.0, 0.5, 0.5)
    for angle in (0.0, 0.5 * math.pi, 0.3):
        across = (math.cos(angle), math.sin(angle), 0.0)
        b = (
            tuples(np.add(np.multiply(across, -1.5), [0.0, 0.0, 0.5 + 0.25 + apart])),
            across,
            3.0,
            0.25,
            0.25,
        )
        assert_allclose(check(a, b), apart, rtol=0, atol=CLOSE)
        within = (tuples(np.subtract(b[0], [0.0, 0.0, apart + min(apart, 0.5)])), *b[1:])
        assert gap(a, within)[0] <= (0.0 if apart > 1e-10 else CLOSE)


def test_end_to_end_cylinders():
    """Crossed lines beyond their ends: the nearest points are on the rims."""
    a = ((0.0, 0.0, 0.0), ALONG_X, 1.0, 0.5, 0.5)
    b = ((1.5, 2.0, 0.0), ALONG_Y, 1.0, 0.25, 0.25)
    assert_allclose(check(a, b), math.hypot(0.25, 1.5), rtol=1e-12)


@pytest.mark.parametrize("offset", [0.0, 0.3, 1.2])
@pytest.mark.parametrize("apart", [1.0, 1e-7, 0.0])
def test_discs_face_to_face(offset, apart):
    """Whole areas are equally near; 1.2 m aside the faces still overlap by 0.3 m."""
    a, b = ((0.0, 0.0, 0.0), ALONG_X, 0.0, 1.0, 1.0), ((apart, offset, 0.0), ALONG_X, 0.0, 0.5, 0.5)
    assert_allclose(check(a, b), apart, rtol=0, atol=1e-14)


def test_discs_in_one_plane():
    a, b = ((0.0, 0.0, 0.0), ALONG_X, 0.0, 1.0, 1.0), ((0.0, 3.0, 4.0), ALONG_X, 0.0, 0.5, 0.5)
    assert_allclose(check(a, b), 3.5, rtol=1e-12)
    assert gap(a, ((0.0, 0.6, 0.8), ALONG_X, 0.0, 0.5, 0.5))[0] == 0.0


def test_faces_of_a_stage_and_a_skirt():
    """Mated cylinders touch at their faces, whichever of them is wider; a millimetre apart they are
    a millimetre apart."""
    aft = ((0.0, 0.0, 0.0), ALONG_X, 2.0, 0.6, 0.6)
    for radius in (0.3, 0.6, 0.9):
        assert gap(aft, ((2.0, 0.0, 0.0), ALONG_X, 1.0, radius, 0.1))[0] <= 1e-15
        assert_allclose(
            check(aft, ((2.001, 0.0, 0.0), ALONG_X, 1.0, radius, 0.1)), 0.001, rtol=1e-12
        )


def test_cone_tip_over_a_disc():
    tip_down = ((0.2, 0.3, 0.7), ALONG_Z, 1.0, 0.0, 0.4)
    disc = ((0.0, 0.0, 0.0), ALONG_Z, 0.0, 1.0, 1.0)
    distance, x, y = gap(tip_down, disc)
    assert_allclose([distance, *x, *y], [0.7, 0.2, 0.3, 0.7, 0.2, 0.3, 0.0], rtol=0, atol=1e-14)


def test_point_beside_a_frustum():
    """Radius 1 to 2 over 1 m: a side at 45 deg."""
    frustum = ((0.0, 0.0, 0.0), ALONG_X, 1.0, 1.0, 2.0)
    distance, _, y = gap(as_point((-0.2, 0.0, 2.2)), frustum)  # foot on the side at (0.5, 1.5)
    assert_allclose([distance, *y], [0.7 * math.sqrt(2.0), 0.5, 0.0, 1.5], rtol=0, atol=1e-12)
    distance, _, y = gap(as_point((0.5, 0.0, 3.5)), frustum)  # past the rim
    assert_allclose([distance, *y], [math.hypot(0.5, 1.5), 1.0, 0.0, 2.0], rtol=0, atol=1e-12)
    assert gap(as_point((0.5, 1.0, 1.0)), frustum)[0] == 0.0


def test_swapping_and_moving_change_nothing():
    rng = np.random.default_rng(8)
    for a, b in some_pairs(100, seed=9):
        distance = gap(a, b)[0]
        assert_allclose(gap(b, a)[0], distance, rtol=0, atol=CLOSE)
        rotation, shift = Rotation.random(rng=rng), rng.uniform(-5.0, 5.0, 3)
        assert_allclose(
            gap(moved(a, rotation, shift), moved(b, rotation, shift))[0],
            distance,
            rtol=0,
            atol=CLOSE,
        )
        larger = tuple(
            (tuples(np.multiply(p[0], 1000.0)), p[1], *(1000.0 * n for n in p[2:])) for p in (a, b)
        )
        assert_allclose(gap(*larger)[0], 1000.0 * distance, rtol=0, atol=1000.0 * CLOSE)


@pytest.mark.parametrize("apart", [1e-2, 1e-6, 1e-10])
def test_near_contact(apart):
    """Pairs brought together along the line between their nearest points, where the triangles of
    the method are at their thinnest."""
    for a, b in some_pairs(150, seed=10):
        distance, x, y = gap(a, b)
        if distance > 1e-2:
            u = np.subtract(y, x) / distance
            nearer = (tuples(b[0] - u * (distance - apart)), *b[1:])
            assert_allclose(gap(a, nearer)[0], apart, rtol=0, atol=2.0 * CLOSE)


def test_overlap_gives_zero_and_a_point_of_both():
    for a, b in some_pairs(200, seed=11, spread=0.4):
        distance = check(a, b)
        if distance == 0.0:
            x, y = gap(a, b)[1:]
            assert_allclose(x, y, rtol=0, atol=CLOSE)
    solid = ((0.0, 0.0, 0.0), ALONG_X, 2.0, 1.0, 1.0)
    assert gap(solid, solid)[0] == 0.0
    assert gap(solid, ((0.5, 0.1, 0.0), ALONG_Y, 0.2, 0.1, 0.1))[0] == 0.0  # one within the other


def test_a_number_that_is_none_is_told():
    solid = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 1.0, 1.0]
    other = ((5.0, 0.0, 0.0), ALONG_X, 1.0, 1.0, 1.0)
    for i in range(9):
        n = solid.copy()
        n[i] = math.nan
        part = (tuple(n[:3]), tuple(n[3:6]), *n[6:])
        assert math.isnan(gap(part, other)[0])
        assert math.isnan(gap(other, part)[0])


def test_inside_a_cylindrical_shell():
    shell = ((1.0, 0.0, 0.0), ALONG_X, 2.0, 0.5, 0.5)
    distance, wall = inside_gap((2.0, 0.3, 0.0), shell)
    assert_allclose([distance, *wall], [0.2, 2.0, 0.5, 0.0], rtol=0, atol=1e-15)
    distance, wall = inside_gap((2.0, 0.0, -0.54), shell)  # through the wall
    assert_allclose([distance, *wall], [-0.04, 2.0, 0.0, -0.5], rtol=0, atol=1e-15)
    distance, wall = inside_gap((2.0, 0.0, -0.6), shell)  # beside the shell
    assert_allclose([distance, *wall], [0.1, 2.0, 0.0, -0.5], rtol=0, atol=1e-15)
    assert_allclose(inside_gap((1.0, 0.0, 0.5), shell)[0], 0.0, rtol=0, atol=1e-15)
    assert inside_gap((0.999, 0.0, 0.0), shell)[0] == math.inf
    assert inside_gap((3.001, 0.0, 0.9), shell)[0] == math.inf
    assert math.isnan(inside_gap((2.0, math.nan, 0.0), shell)[0])


@pytest.mark.parametrize("axis", [ALONG_X, ALONG_Y, ALONG_Z, (0.6, 0.0, -0.8)])
def test_on_the_axis_of_a_shell_any_side_is_as_near(axis):
    start = np.array([1.0, 2.0, 3.0])
    distance, wall = inside_gap(
        tuples(start + np.array(axis)), (tuples(start), axis, 2.0, 0.5, 0.5)
    )
    assert_allclose(distance, 0.5, rtol=1e-14)
    assert_allclose(np.linalg.norm(wall - start - np.array(axis)), 0.5, rtol=1e-14)


def test_inside_a_conical_shell():
    """Radius 1 to 2 over 1 m: a wall at 45 deg."""
    shell = ((0.0, 0.0, 0.0), ALONG_X, 1.0, 1.0, 2.0)
    # foot at (0.5, 1.5)
    assert_allclose(inside_gap((0.8, 0.0, 1.2), shell)[0], 0.3 * math.sqrt(2.0), rtol=1e-14)
    # through the wall, foot at (0.25, 1.25)
    assert_allclose(inside_gap((0.2, 0.0, 1.3), shell)[0], -0.05 * math.sqrt(2.0), rtol=1e-14)
    # beside it
    assert_allclose(inside_gap((0.2, 0.0, 1.8), shell)[0], 0.3 * math.sqrt(2.0), rtol=1e-14)
    distance, wall = inside_gap((0.1, 0.0, 0.2), shell)  # the nearest is the rim of the narrow end
    assert_allclose([distance, *wall], [math.hypot(0.1, 0.8), 0.0, 0.0, 1.0], rtol=1e-14)
    # beyond the ends the wall is still somewhere
    distance, wall = wall_gap((-0.3, 0.0, 0.6), shell)
    assert_allclose([distance, *wall], [0.5, 0.0, 0.0, 1.0], rtol=1e-14)


def test_shells_in_other_axes():
    rng = np.random.default_rng(12)
    for _ in range(50):
        shell, point = a_part(rng, "frustum"), tuples(rng.uniform(-3.0, 3.0, 3))
        rotation, shift = Rotation.random(rng=rng), rng.uniform(-5.0, 5.0, 3)
        distance, wall = inside_gap(point, shell)
        there, there_wall = inside_gap(
            tuples(rotation.apply(point) + shift), moved(shell, rotation, shift)
        )
        assert_allclose(there, distance, rtol=0, atol=1e-12)
        assert_allclose(there_wall, rotation.apply(wall) + shift, rtol=0, atol=1e-12)
        assert_allclose(
            np.linalg.norm(np.subtract(wall, point)), wall_gap(point, shell)[0], rtol=1e-12
        )


def test_least_gap_is_a_lower_bound():
    """Of random slender and stout frustums, near and far, some parallel: never above their
    distance, and within it by a few radii."""
    random = np.random.default_rng(11)
    for trial in range(300):
        parts = []
        for _ in range(2):
            axis = (
                random.normal(size=3) if trial % 3 else np.array([1.0, 1e-7 * random.normal(), 0.0])
            )
            axis /= np.linalg.norm(axis)
            r0, r1 = random.uniform(0.0, 2.0, size=2)
            parts.append(
                (
                    tuple(random.normal(size=3) * 10.0),
                    tuple(axis),
                    random.uniform(0.0, 40.0),
                    r0,
                    r1,
                )
            )
        assert gap_bound(*parts) <= gap(*parts)[0] + 1e-9
    side_by_side = [((0.0, 0.0, z), (1.0, 0.0, 0.0), 40.0, 2.0, 2.0) for z in (0.0, 7.0)]
    assert gap_bound(*side_by_side) == pytest.approx(3.0, abs=1e-4)


# --- rims in shells
# --------------------------------------------------------------------------------------------------


def rim_by_scan(rim, shell):
    """Least of `inside_gap` over a rim: in steps of a degree, with both sides of the angles where
    the rim meets the ends; then closer."""
    centre, normal, radius = (np.array(x) for x in rim)
    start, axis, length = (np.array(x) for x in shell[:3])
    u, v = np.linalg.svd(normal[None])[2][1:]

    def value(angle):
        return inside_gap(
            tuples(centre + radius * (math.cos(angle) * u + math.sin(angle) * v)), shell
        )[0]

    angles, half = list(np.linspace(0.0, 2.0 * np.pi, 361)), radius * math.hypot(u @ axis, v @ axis)
    for plane in (0.0, length):
        share = (plane - (centre - start) @ axis) / half if half > 0.0 else 2.0
        if abs(share) < 1.0:
            top = math.atan2(v @ axis, u @ axis)
            angles += [top + s * math.acos(share) + e for s in (1.0, -1.0) for e in (-1e-13, 1e-13)]
    found = []
    for best in sorted((value(angle), angle) for angle in angles)[:4]:
        width = math.radians(1.0)
        for _ in range(12):
            best = min(
                [
                    best,
                    *(
                        (value(angle), angle)
                        for angle in best[1] + width * np.linspace(-1.0, 1.0, 21)
                    ),
                ]
            )
            width *= 0.12
        found.append(best[0])
    return min(found)


def some_rims(count, seed, offsets=(0.0, 1e-6, 0.01, 0.1, 0.5), shares=(0.0, 0.3, 0.9, 0.98)):
    """Rims of all tilts and offsets in and about cylindrical and conical shells; one in two near an
    end."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        axis, start, length = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.3, 3.0)
        axis /= np.linalg.norm(axis)
        r0 = rng.uniform(0.3, 1.2)
        r1 = r0 * rng.uniform(0.7, 1.4) if i % 2 else r0
        normal = axis + rng.choice([0.0, 1e-9, 1e-3, 0.02, 0.3, 3.0]) * rng.normal(size=3)
        normal *= rng.choice([1.0, -1.0]) / np.linalg.norm(normal)
        along = (
            rng.choice([0.0, length]) + 0.02 * rng.normal()
            if i % 4 < 2
            else rng.uniform(-0.1, 1.1) * length
        )
        aside = rng.normal(size=3) * rng.choice(offsets)
        radius = rng.choice(shares) * (r0 + (r1 - r0) * min(max(along / length, 0.0), 1.0))
        centre = start + along * axis + aside - (aside @ axis) * axis
        yield (
            (tuples(centre), tuples(normal), float(radius)),
            (tuples(start), tuples(axis), float(length), float(r0), float(r1)),
        )


def test_rim_in_a_shell_against_a_scan():
    """All that is positive to 1e-11 m, of any tilt, past the ends too; never more than what the
    scan finds through the wall."""
    for rim, shell in some_rims(150, seed=20):
        distance, on_rim, on_wall = rim_gap(rim, shell, 0.0)
        scanned = rim_by_scan(rim, shell)
        if math.isinf(scanned):
            assert distance == math.inf
            continue
        assert distance <= scanned + 1e-11
        # below, the scan stops short of where the rim stops being through the wall
        if distance > 0.0:
            assert_allclose(distance, scanned, rtol=0, atol=1e-11)
        assert_allclose(
            np.linalg.norm(np.subtract(on_rim, on_wall)), abs(distance), rtol=0, atol=1e-12
        )
        assert_allclose(np.linalg.norm(np.subtract(on_rim, rim[0])), rim[2], rtol=0, atol=1e-12)


def test_rims_by_hand():
    """Coaxial, shifted and tilted in a cylinder of 0.5 m: 0.5 less 0.3; less the shift too; less
    half the ellipse's greater axis."""
    shell = ((0.0, 0.0, 0.0), ALONG_X, 2.0, 0.5, 0.5)
    assert_allclose(rim_gap(((1.0, 0.0, 0.0), ALONG_X, 0.3), shell, 0.0)[0], 0.2, rtol=1e-15)
    distance, on_rim, on_wall = rim_gap(((1.0, 0.06, -0.08), ALONG_X, 0.3), shell, 0.0)
    assert_allclose(
        [distance, *on_rim, *on_wall], [0.1, 1.0, 0.24, -0.32, 1.0, 0.3, -0.4], rtol=1e-14
    )
    tilted = tuples([math.cos(0.4), math.sin(0.4), 0.0])
    distance, on_rim, _ = rim_gap(((1.0, 0.0, 0.1), tilted, 0.3), shell, 0.0)
    assert_allclose([distance, *on_rim], [0.1, 1.0, 0.0, 0.4], rtol=0, atol=1e-15)
    # in a plane with the axis
    distance, on_rim, _ = rim_gap(((1.0, 0.0, 0.0), ALONG_Y, 0.3), shell, 0.0)
    assert_allclose([distance, abs(on_rim[2])], [0.2, 0.3], rtol=1e-14)
    assert rim_gap(((2.01, 0.0, 0.0), ALONG_X, 0.3), shell, 0.0)[0] == math.inf
    assert_allclose(rim_gap(((2.01, 0.0, 0.0), ALONG_X, 0.3), shell, 0.02)[0], 0.2, rtol=1e-15)
    # through the wall
    assert_allclose(rim_gap(((1.0, 0.0, 0.0), ALONG_X, 0.52), shell, 0.0)[0], -0.02, rtol=1e-13)
    # beside it
    assert_allclose(rim_gap(((1.0, 0.0, 0.0), ALONG_X, 0.6), shell, 0.0)[0], 0.1, rtol=1e-13)
    assert math.isnan(rim_gap(((math.nan, 0.0, 0.0), ALONG_X, 0.3), shell, 0.0)[0])


def test_a_margin_bounds_what_a_rim_can_come_to():
    """A rim moved by no more than the margin is nowhere nearer than the bound less the way."""
    rng = np.random.default_rng(21)
    for rim, shell in some_rims(300, seed=22, shares=(0.0, 0.3, 0.9, 0.98, 1.02, 1.2)):
        margin = float(rng.choice([1e-6, 1e-3, 0.05]))
        way = rng.normal(size=3)
        moved_rim = tuples(np.add(rim[0], margin * way / np.linalg.norm(way))), *rim[1:]
        assert rim_gap(moved_rim, shell, 0.0)[0] >= rim_gap(rim, shell, margin)[0] - margin - 1e-9
