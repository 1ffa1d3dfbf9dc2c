"""Peak, its time and the integral of the size of a vector over a step, from its components at the
nodes."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from sepmc.routines import peaks
from sepmc.routines.lanes import LANES

APART = 3 * LANES
NODES, SCRATCH, OUT, OTHER, GUARD = 0, 10 * APART, 20 * APART, 30 * APART, 35 * APART
NOTHING = (0.0, math.nan, 0.0)


@njit
def noted(w, t, h):
    peaks.update_size(w, NODES, APART, SCRATCH, OUT, OTHER, GUARD, t, h)


def follow(vector, t=0.0, h=1.0, before=NOTHING):
    """What is noted of a step in which the components are ``vector`` (share of the step)."""
    w = np.zeros(40 * APART)
    for i, theta in enumerate(peaks.THETA):
        w[NODES + i * APART : NODES + (i + 1) * APART : LANES] = vector(theta)
    w[OUT : OUT + APART : LANES] = before
    noted(w, t, h)
    return w[OUT : OUT + APART : LANES]


def exact(vector):
    """The greatest size, where it is, and the mean."""

    def size(theta):
        return math.sqrt(sum(x * x for x in vector(theta)))

    grid = np.linspace(0.0, 1.0, 2001)
    best = int(np.argmax([size(theta) for theta in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 2000)]
    inside = minimize_scalar(
        lambda theta: -size(theta), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    place = max((float(grid[best]), float(inside.x)), key=size)
    return size(place), place, quad(size, 0.0, 1.0, limit=1000, points=[0.37], epsabs=1e-14)[0]


VECTORS = {
    "falls": lambda x: (3.0 - x, 0.0, 0.1 * x),
    "rises to the end": lambda x: (x * x, 1.0, 0.0),
    "peak inside": lambda x: (5.0 - (x - 0.4) ** 2, 0.0, 0.0),
    "peak beside the start": lambda x: (1.0 - (x - 0.03) ** 2, 0.0, 0.0),
    "peak beside the end": lambda x: (1.0 - (x - 0.98) ** 2, 0.0, 0.0),
    "two peaks": lambda x: (1.0 + (x - 0.2) * (x - 0.5) * (x - 0.8) * (x - 0.1), 0.3 * x, 0.0),
    "through zero": lambda x: (x - 0.37, 0.0, 0.0),
    "almost through zero": lambda x: (x - 0.37, 0.001 * x, 0.0),
    "turns": lambda x: (math.cos(0.3 * x), math.sin(0.3 * x), 0.2 * math.sin(0.5 * x)),
}


@pytest.mark.parametrize("name", VECTORS)
def test_a_smooth_vector(name):
    """Peaks to round-off, integrals to 1e-11 of the peak, where the size has a corner too."""
    vector = VECTORS[name]
    peak, place, mean = exact(vector)
    found = follow(vector, t=2.0, h=0.5)
    assert abs(found[0] - peak) <= 1e-11 * peak
    assert abs(found[1] - (2.0 + 0.5 * place)) <= 1e-6
    assert abs(found[2] - 0.5 * mean) <= 1e-11 * peak


def test_the_size_of_a_load_that_does_not_change():
    """Its peak is where it is first seen, not where round-off is largest."""
    found = follow(lambda x: (1.0 + 1e-15 * math.sin(40.0 * x), 0.0, 0.0), t=3.0, h=2.0)
    assert found[0] == pytest.approx(1.0, rel=1e-14)
    assert found[1] == 3.0
    assert found[2] == pytest.approx(2.0, rel=1e-14)


def test_what_was_seen_before():
    """A greater peak stays with its time; the integral adds up."""
    found = follow(lambda x: (x, 0.0, 0.0), t=1.0, before=(2.0, 0.25, 7.0))
    assert tuple(found) == (2.0, 0.25, pytest.approx(7.5, rel=1e-14))
    higher = follow(lambda x: (3.0 * x, 0.0, 0.0), t=1.0, before=(2.0, 0.25, 7.0))
    assert tuple(higher) == (3.0, 2.0, pytest.approx(8.5, rel=1e-14))


def test_order():
    """What the polynomials leave out of a load that is none falls with the eighth power of the
    step's length."""

    def load(time):
        return math.exp(-time), math.sin(2.0 * time), 0.5

    def error(count):
        found = NOTHING
        for n in range(count):
            found = follow(
                lambda x, n=n: load((n + x) / count), n / count, 1.0 / count, tuple(found)
            )
        size = lambda time: math.sqrt(sum(x * x for x in load(time)))  # noqa: E731
        best = minimize_scalar(
            lambda time: -size(time), bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-12}
        )
        return abs(found[0] - size(best.x))

    coarse, fine = error(1), error(2)
    assert coarse <= 1e-6
    assert fine <= max(coarse / 2.0**7, 1e-14)
