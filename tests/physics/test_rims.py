"""Distances of rims in shells, against a scan and by hand."""

import math

import numpy as np
from numpy.testing import assert_allclose
from support.compiled import compiled

from sepmc.physics.outlines import inside_gap
from sepmc.physics.rims import rim_gap

rim_gap = compiled(rim_gap)
ALONG_X, ALONG_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def tuples(v):
    """Components as Python floats."""
    return tuple(float(x) for x in v)


@compiled
def put_gaps(points, distances, count, shell):
    """Store the distance of each of the points, rows of an array."""
    for i in range(count):
        point = points[i, 0], points[i, 1], points[i, 2]
        distances[i] = inside_gap(point, shell)[0]


def rim_by_scan(rim, shell):
    """Smallest `inside_gap` of a rim: in steps of a degree, with both sides of the angles at which
    the rim meets the ends; then refined."""
    centre, normal, radius = (np.array(x) for x in rim)
    start, axis, length = (np.array(x) for x in shell[:3])
    u, v = np.linalg.svd(normal[None])[2][1:]

    def values(angles):
        """Distances at angles, each with its angle."""
        points = centre + radius * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v))
        distances = np.empty(len(angles))
        put_gaps(points, distances, len(angles), shell)
        return list(zip(distances.tolist(), angles, strict=True))

    angles, half = list(np.linspace(0.0, 2.0 * np.pi, 361)), radius * math.hypot(u @ axis, v @ axis)
    for plane in (0.0, length):
        cosine = (plane - (centre - start) @ axis) / half if half > 0.0 else 2.0
        if abs(cosine) < 1.0:
            top = math.atan2(v @ axis, u @ axis)
            angles += [
                top + s * math.acos(cosine) + e for s in (1.0, -1.0) for e in (-1e-13, 1e-13)
            ]
    minima = []
    for best in sorted(values(angles))[:4]:
        width = math.radians(1.0)
        for _ in range(12):
            near = best[1] + width * np.linspace(-1.0, 1.0, 21)
            best = min([best, *values(near)])
            width *= 0.12
        minima.append(best[0])
    return min(minima)


def some_rims(count, seed, offsets=(0.0, 1e-6, 0.01, 0.1, 0.5), fractions=(0.0, 0.3, 0.9, 0.98)):
    """Rims of all tilts and offsets in and around cylindrical and conical shells; one in two near
    an end."""
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
        radius = rng.choice(fractions) * (r0 + (r1 - r0) * min(max(along / length, 0.0), 1.0))
        centre = start + along * axis + aside - (aside @ axis) * axis
        yield (
            (tuples(centre), tuples(normal), float(radius)),
            (tuples(start), tuples(axis), float(length), float(r0), float(r1)),
        )


def test_rim_in_a_shell_against_a_scan():
    """Positive distances agree to 1e-11 m, for any tilt and past the ends; through the wall the
    result is never above that of the scan."""
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
    """Coaxial, shifted and tilted in a cylinder of 0.5 m: 0.5 minus 0.3; minus the shift; minus
    half the major axis of the ellipse."""
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


def test_margin_bounds_moved_rims():
    """A rim moved by at most the margin is nowhere nearer than the bound minus the margin."""
    rng = np.random.default_rng(21)
    for rim, shell in some_rims(300, seed=22, fractions=(0.0, 0.3, 0.9, 0.98, 1.02, 1.2)):
        margin = float(rng.choice([1e-6, 1e-3, 0.05]))
        way = rng.normal(size=3)
        moved_rim = tuples(np.add(rim[0], margin * way / np.linalg.norm(way))), *rim[1:]
        assert rim_gap(moved_rim, shell, 0.0)[0] >= rim_gap(rim, shell, margin)[0] - margin - 1e-9
