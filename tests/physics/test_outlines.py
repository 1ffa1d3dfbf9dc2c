"""Distances between outlines, against closed forms, separating planes and a minimiser."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from support.compiled import compiled

from sepmc.physics.outlines import gap, gap_bound, gap_from, inside_gap, wall_gap
from sepmc.physics.separation import widest_gap

gap = compiled(gap)
gap_bound, gap_from = compiled(gap_bound), compiled(gap_from)
inside_gap = compiled(inside_gap)
wall_gap = compiled(wall_gap)
widest_gap = compiled(widest_gap)
ALONG_X, ALONG_Y, ALONG_Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
CLOSE = 1e-10  # m, of parts of metres
SLAB = 1e-6  # m; the direction between the points has the square root of the relative error
SHAPES = ["frustum", "cylinder", "cone", "disc", "needle", "point"]


def tuples(v):
    """Components as Python floats."""
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
    """The same part in other axes."""
    return tuples(rotation.apply(part[0]) + shift), tuples(rotation.apply(part[1])), *part[2:]


def reach(part, u):
    """Largest u . p over a part: that of the further of its two discs."""
    start, axis, length, r0, r1 = (np.array(x) for x in part)
    across = np.linalg.norm(u - (u @ axis) * axis)
    return max(u @ start + r0 * across, u @ (start + length * axis) + r1 * across)


def excess(part, p):
    """Largest distance of a point beyond a part, along or across its axis, m."""
    start, axis, length, r0, r1 = (np.array(x) for x in part)
    along = (p - start) @ axis
    rho = np.linalg.norm(p - start - along * axis)
    fraction = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    largest = max(r0, r1) if length == 0.0 else r0 + (r1 - r0) * fraction
    return max(-along, along - length, rho - largest)


def check(a, b, close=CLOSE, result=None):
    """Prove a distance: the points are in their parts and have that distance, and the slab between
    them separates the parts."""
    distance, x, y = result or gap(a, b)
    x, y = np.array(x), np.array(y)
    assert excess(a, x) < close
    assert excess(b, y) < close
    assert_allclose(np.linalg.norm(y - x), distance, rtol=0, atol=close)
    if distance > 1e-3:
        u = (y - x) / distance
        assert -reach(b, -u) - reach(a, u) > distance - SLAB
    return distance


@pytest.mark.slow
def test_distance_is_proved_on_random_pairs():
    distances = [check(a, b) for a, b in some_pairs(400, seed=5)]
    assert 0.05 < np.mean(np.array(distances) == 0.0) < 0.5


def test_widest_gap_is_proved_where_it_is_found():
    """From directions up to 6 degrees off, and from any: every finite result is the distance."""
    rng, separate, near, far = np.random.default_rng(7), 0, 0, 0
    for a, b in some_pairs(400, seed=12):
        distance, x, y = gap(a, b)
        if distance < 1e-3:
            assert math.isnan(widest_gap(a, b, tuples(rng.normal(size=3)), 1e-12, 1e-15)[0])
            continue
        separate += 1
        u = (np.array(x) - y) / distance
        for off in (0.1 * rng.uniform(-1.0, 1.0, 3), rng.normal(size=3)):
            result = widest_gap(a, b, tuples(u + off), 1e-12, 1e-15)
            if not math.isnan(result[0]):
                assert_allclose(check(a, b, result=result), distance, rtol=0, atol=CLOSE)
                near, far = near + (abs(off).max() <= 0.1), far + (abs(off).max() > 0.1)
    assert near > 0.6 * separate  # the others meet at an end or on both sides
    assert far > 0.1 * separate


def test_a_direction_to_start_from_does_not_change_the_distance():
    """That of the nearest points, one near it, any other, the opposite one, none and NaN."""
    rng = np.random.default_rng(8)
    for a, b in some_pairs(300, 12):
        distance, x, y = gap(a, b)
        v = np.subtract(x, y)
        near = v + 0.1 * np.linalg.norm(v) * rng.normal(size=3)
        for guess in (v, near, rng.normal(size=3), -v, np.zeros(3), np.full(3, np.nan)):
            found, p, q = gap_from(a, b, tuples(guess))
            assert_allclose(found, distance, rtol=1e-10, atol=CLOSE)
            if found > CLOSE:
                assert_allclose(np.linalg.norm(np.subtract(p, q)), found, rtol=1e-10)


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
    """Over both points, each described by its fraction of the length and by two coordinates across,
    in radii there."""

    def point(part, across, q):
        start, axis, length, r0, r1 = part
        if length == 0.0:
            r0 = r1 = max(r0, r1)
        return start + q[0] * length * np.array(axis) + (r0 + q[0] * (r1 - r0)) * (q[1:] @ across)

    for a, b in some_pairs(60, seed=6):
        across_a, across_b = (np.linalg.svd(np.array([part[1]]))[2][1:] for part in (a, b))

        def square(q, a=a, b=b, across_a=across_a, across_b=across_b):
            return np.sum((point(a, across_a, q[:3]) - point(b, across_b, q[3:])) ** 2)

        result = minimize(
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
        assert_allclose(gap(a, b)[0], math.sqrt(result.fun), rtol=1e-5, atol=1e-5)


def test_points_and_spheres_of_no_radius():
    distance, x, y = gap(as_point((1.0, 2.0, 3.0)), as_point((1.0, -1.0, 7.0)))
    assert (distance, x, y) == (5.0, (1.0, 2.0, 3.0), (1.0, -1.0, 7.0))
    assert gap(as_point((1.0, 2.0, 3.0)), as_point((1.0, 2.0, 3.0)))[0] == 0.0


@pytest.mark.parametrize("spacing", [2.0, 1e-3, 1e-6, 1e-9, 1e-12])
def test_cylinders_side_by_side_and_crossed(spacing):
    """Parallel, crossed at right angles and skew: distance of the lines minus both radii."""
    a = ((-2.0, 0.0, 0.0), ALONG_X, 4.0, 0.5, 0.5)
    for angle in (0.0, 0.5 * math.pi, 0.3):
        across = (math.cos(angle), math.sin(angle), 0.0)
        b = (
            tuples(np.add(np.multiply(across, -1.5), [0.0, 0.0, 0.5 + 0.25 + spacing])),
            across,
            3.0,
            0.25,
            0.25,
        )
        assert_allclose(check(a, b), spacing, rtol=0, atol=CLOSE)
        within = (tuples(np.subtract(b[0], [0.0, 0.0, spacing + min(spacing, 0.5)])), *b[1:])
        assert gap(a, within)[0] <= (0.0 if spacing > 1e-10 else CLOSE)


def test_end_to_end_cylinders():
    """Crossed lines beyond their ends: the nearest points are on the rims."""
    a = ((0.0, 0.0, 0.0), ALONG_X, 1.0, 0.5, 0.5)
    b = ((1.5, 2.0, 0.0), ALONG_Y, 1.0, 0.25, 0.25)
    assert_allclose(check(a, b), math.hypot(0.25, 1.5), rtol=1e-12)


@pytest.mark.parametrize("offset", [0.0, 0.3, 1.2])
@pytest.mark.parametrize("spacing", [1.0, 1e-7, 0.0])
def test_discs_face_to_face(offset, spacing):
    """Whole areas are nearest; with 1.2 m offset the faces still overlap by 0.3 m."""
    a, b = (
        ((0.0, 0.0, 0.0), ALONG_X, 0.0, 1.0, 1.0),
        ((spacing, offset, 0.0), ALONG_X, 0.0, 0.5, 0.5),
    )
    assert_allclose(check(a, b), spacing, rtol=0, atol=1e-14)


def test_discs_in_one_plane():
    a, b = ((0.0, 0.0, 0.0), ALONG_X, 0.0, 1.0, 1.0), ((0.0, 3.0, 4.0), ALONG_X, 0.0, 0.5, 0.5)
    assert_allclose(check(a, b), 3.5, rtol=1e-12)
    assert gap(a, ((0.0, 0.6, 0.8), ALONG_X, 0.0, 0.5, 0.5))[0] == 0.0


def test_faces_of_a_stage_and_a_skirt():
    """Mated cylinders touch at their faces, whichever of them is wider; at 1 mm the distance is 1
    mm."""
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


@pytest.mark.parametrize("spacing", [1e-2, 1e-6, 1e-10])
def test_near_contact(spacing):
    """Pairs moved together along the line between their nearest points, where the triangles of the
    method are thinnest."""
    for a, b in some_pairs(150, seed=10):
        distance, x, y = gap(a, b)
        if distance > 1e-2:
            u = np.subtract(y, x) / distance
            nearer = (tuples(b[0] - u * (distance - spacing)), *b[1:])
            assert_allclose(gap(a, nearer)[0], spacing, rtol=0, atol=2.0 * CLOSE)


def test_overlap_gives_zero_and_a_point_of_both():
    for a, b in some_pairs(200, seed=11, spread=0.4):
        distance = check(a, b)
        if distance == 0.0:
            x, y = gap(a, b)[1:]
            assert_allclose(x, y, rtol=0, atol=CLOSE)
    solid = ((0.0, 0.0, 0.0), ALONG_X, 2.0, 1.0, 1.0)
    assert gap(solid, solid)[0] == 0.0
    assert gap(solid, ((0.5, 0.1, 0.0), ALONG_Y, 0.2, 0.1, 0.1))[0] == 0.0  # one within the other


def test_nan_gives_nan():
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
        distance_moved, wall_moved = inside_gap(
            tuples(rotation.apply(point) + shift), moved(shell, rotation, shift)
        )
        assert_allclose(distance_moved, distance, rtol=0, atol=1e-12)
        assert_allclose(wall_moved, rotation.apply(wall) + shift, rtol=0, atol=1e-12)
        assert_allclose(
            np.linalg.norm(np.subtract(wall, point)), wall_gap(point, shell)[0], rtol=1e-12
        )


def test_gap_bound_is_a_lower_bound():
    """Random slender and stout frustums, near and far, some parallel: never above their
    distance."""
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
