"""Distances of sectors of shells from solids, against a scan of their lines and by hand."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import geometry
from scipy.spatial.transform import Rotation
from support.compiled import compiled

from sepmc.physics.outlines import gap
from sepmc.physics.sectors import point_gap, sector_gap

pytestmark = pytest.mark.slow  # the first test compiles `sector_gap`: 7 s
gap = compiled(gap)
point_gap = compiled(point_gap)
sector_gap = compiled(sector_gap)
ALONG_X, UP, RIGHT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def half_tube(length=2.0, radius=1.0, width=math.pi):
    """Sector along x from z = radius over y = radius."""
    return (0.0, 0.0, 0.0), ALONG_X, length, radius, radius, RIGHT, UP, width


def tuples(*vectors):
    return (tuple(map(float, vector)) for vector in vectors)


def some_pairs(seed, count):
    """Random sectors and solids, points and lines: nearly along the axis, across it, inside and
    outside."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        start, length, first = 0.2 * rng.normal(size=3), rng.choice([0.3, 1.0, 3.0]), rng.random()
        r0 = rng.uniform(0.2, 1.0)
        r1 = r0 if rng.random() < 0.4 else rng.uniform(0.1, 1.0)
        width = rng.choice([math.pi, 0.5 * math.pi, 1.5 * math.pi, rng.uniform(0.2, 6.2)])
        axis = Rotation.random(rng=rng).apply(ALONG_X)
        if rng.random() < 0.5:
            axis = np.array([1.0, *(rng.choice([0.0, 1e-6, 0.02, 0.2]) * rng.normal(size=2))])
            axis /= np.linalg.norm(axis)
        size = rng.choice([0.0, 0.5, 2.0, 4.0])
        radii = rng.choice([0.0, 1.0], 2) * rng.uniform(0.0, 0.7, 2)
        if size == 0.0 or rng.random() < 0.4:
            radii[1] = radii[0]
        middle = start - np.array(ALONG_X) * length * rng.uniform(-0.2, 1.2)
        middle = middle + rng.choice([0.0, 0.1, 0.5, 1.5]) * rng.normal(size=3)
        part = (middle - 0.5 * size * axis, axis, float(size), *map(float, radii))
        angles = 6.28 * first, 6.28 * first + float(width)
        yield (start, np.array([-1.0, 0.0, 0.0]), float(length), float(r0), float(r1)), angles, part


def test_a_scan_of_the_lines_of_a_sector():
    """Within 1e-9 m of scenes of a metre; both nearest points lie as far apart."""
    touching = 0
    for sector, angles, part in some_pairs(3, 80):
        begin, end = angles
        x, y = ((0.0, -math.sin(a), math.cos(a)) for a in (begin, begin + 0.5 * math.pi))
        distance, on_sector, on_part = sector_gap(
            (*tuples(*sector[:2]), *sector[2:], x, y, end - begin),
            (*tuples(*part[:2]), *part[2:]),
        )
        (expected,) = geometry.sector_distance(
            (sector[0][None], sector[1][None], *sector[2:]),
            angles,
            np.array([RIGHT]),
            np.array([UP]),
            (part[0][None], part[1][None], *part[2:]),
        )
        assert distance == pytest.approx(expected, abs=1e-9)
        if distance > 0.0:
            assert math.dist(on_sector, on_part) == pytest.approx(distance, abs=1e-9)
        touching += distance == 0.0
    assert 10 < touching < 40


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (((0.5, 0.0, 0.0), ALONG_X, 1.0, 0.6, 0.6), 0.4),  # on the axis, within
        (((-1.0, 0.0, 0.0), ALONG_X, 4.0, 0.6, 0.6), 0.4),  # longer than the sector
        (((0.5, 0.2, 0.0), ALONG_X, 1.0, 0.6, 0.6), 0.2),  # nearer to the crown
        (((0.5, 2.0, 0.0), ALONG_X, 1.0, 0.6, 0.6), 0.4),  # outside, over the crown
        (((0.5, -2.0, 0.0), ALONG_X, 1.0, 0.6, 0.6), math.hypot(2.0, 1.0) - 0.6),  # open side
        (((2.3, 0.0, 0.0), ALONG_X, 1.0, 1.0, 1.0), 0.3),  # behind an arc
        (((1.0, 0.9, 0.0), UP, 0.2, 0.0, 0.0), 0.0),  # a rod through the face
        (((1.0, 0.9, 0.0), UP, 0.2, 0.01, 0.01), 0.0),
        (((1.0, -1.2, 0.0), UP, 0.4, 0.01, 0.01), math.hypot(0.99, 0.8)),  # where the wall is not
        (((1.0, 0.3, 0.4), ALONG_X, 0.0, 0.0, 0.0), 0.5),  # a point
    ],
)
def test_by_hand(part, expected):
    assert_allclose(sector_gap(half_tube(), part)[0], expected, rtol=0, atol=1e-12)


def test_points():
    """Over the face, beside an edge, and on the axis."""
    assert point_gap((1.0, 3.0, 0.0), half_tube())[0] == pytest.approx(2.0, abs=1e-14)
    assert point_gap((1.0, -1.0, 2.0), half_tube())[0] == pytest.approx(math.sqrt(2.0), abs=1e-14)
    distance, nearest = point_gap((1.0, 0.0, 0.0), half_tube(width=0.1))
    assert (distance, nearest) == (pytest.approx(1.0, abs=1e-14), (1.0, 0.0, 1.0))


def test_a_full_turn_is_a_tube_and_a_narrow_one_a_line():
    part = ((0.5, 0.1, 0.2), ALONG_X, 1.0, 0.3, 0.2)
    inside = 1.0 - math.hypot(0.1, 0.2) - 0.3
    assert_allclose(sector_gap(half_tube(width=2.0 * math.pi), part)[0], inside, atol=1e-9)
    line = ((0.0, 0.0, 1.0), ALONG_X, 2.0, 0.0, 0.0)
    narrow = sector_gap(half_tube(width=1e-9), part)[0]
    assert_allclose(narrow, gap(line, part)[0], rtol=0, atol=2e-9)


def test_what_is_not_a_number_stays():
    part = ((math.nan, 0.1, 0.2), ALONG_X, 1.0, 0.3, 0.2)
    assert math.isnan(sector_gap(half_tube(), part)[0])
