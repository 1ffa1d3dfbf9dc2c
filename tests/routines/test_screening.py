"""Screening of steps for clearances, against dense scans of the step."""

import math

import numpy as np
import pytest
from support.compiled import compiled

from sepmc.physics.outlines import gap
from sepmc.routines import layout as at
from sepmc.routines.clearances import from_layout, placed, relative_pose
from sepmc.routines.lanes import LANES
from sepmc.routines.screening import screen_motion, screen_parts

POWERS, SCREEN = 4, 0
MARKS = (at.SCREEN_PATH + POWERS * at.PATH) * LANES
PARTS = MARKS + 4 * LANES  # two parts of a, then two of b for every lane
gap = compiled(gap)
screen_motion, screen_parts = compiled(screen_motion), compiled(screen_parts)


def random_parts(rng, aside):
    """Numbers of two solid parts of an outline, beside the axis by about ``aside`` m."""
    return [
        (0.0, rng.normal(), aside + 0.3 * rng.normal(), rng.normal(), rng.choice([0.0, 1.5]))
        + (rng.uniform(0.1, 0.6),) * 2
        for _ in range(2)
    ]


def screened(seed, limit):
    """Marks (pairs, lanes) of a screening of a random motion in every lane; and the smallest
    distance of each pair at 100 times of the step."""
    rng = np.random.default_rng(seed)
    sizes = np.array([1.0, 0.1, 0.05, 0.02])
    path = rng.normal(size=(POWERS, at.PATH, LANES)) * sizes[:, None, None]
    path[0, 3:] *= 0.3
    path[1:, 3:] *= 0.1
    path[0, 3], path[0, 7] = 1.0, 1.0
    centres = 0.1 * rng.normal(size=(6, LANES))
    a = random_parts(rng, 0.0)
    b = [random_parts(rng, 2.0) for _ in range(LANES)]
    w = np.zeros(PARTS + at.PART_SIZE * (2 + 2 * LANES))
    w[: at.SCREEN_PATH * LANES] = math.nan
    w[at.SCREEN_PATH * LANES : MARKS] = path.ravel()
    w[at.SCREEN_CENTRES * LANES : (at.SCREEN_CENTRES + 6) * LANES] = centres.ravel()
    w[at.SCREEN_LIMIT * LANES :][:LANES], w[at.SCREEN_NEAR * LANES :][:LANES] = limit, 0.0
    w[PARTS:] = [*np.ravel(a), *np.ravel(b)]
    first_b = PARTS + 2 * at.PART_SIZE
    screen_motion(w, SCREEN, POWERS)
    screen_parts(w, SCREEN, MARKS, PARTS, 0, 2, first_b, 2 * at.PART_SIZE, 2)
    least = np.full((4, LANES), np.inf)
    for theta in np.linspace(0.0, 1.0, 100):
        point = np.einsum("q,qkl->kl", theta ** np.arange(POWERS), path)
        for lane in range(LANES):
            x = [float(number) for number in point[:, lane]]
            pose = relative_pose(tuple(x[:3]), tuple(x[3:7]), tuple(x[7:]))
            one, other = (tuple(map(float, centres[k : k + 3, lane])) for k in (0, 3))
            for n, part in enumerate(a):
                for m, second in enumerate(b[lane]):
                    first, last = (
                        from_layout((p[0], p[1:4], *map(float, p[4:])), cg)
                        for p, cg in ((part, one), (second, other))
                    )
                    distance = gap(first, placed(last, *pose))[0]
                    least[2 * n + m, lane] = min(least[2 * n + m, lane], distance)
    return w[MARKS : MARKS + 4 * LANES].reshape(4, LANES), least, w


@pytest.mark.parametrize("seed", range(6))
def test_pairs_that_come_nearer_are_marked(seed):
    """All pairs that come below the limit; of those that stay far from it, hardly any."""
    limit = 1.0
    marks, least, w = screened(seed, limit)
    assert (marks[least < limit] == 1.0).all()
    assert np.array_equal(w[at.SCREEN_NEAR * LANES :][:LANES], marks.max(axis=0))
    assert (least < limit).any()
    assert (marks[least > 2.0 * limit] == 0.0).mean() > 0.9


def test_without_a_distance_so_far_all_pairs_are_marked():
    assert (screened(1, math.nan)[0] == 1.0).all()
