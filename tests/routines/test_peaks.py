"""Peak, its time and integral of the magnitude of a vector over a step, from its components at the
nodes."""

import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from sepmc.routines import peaks
from sepmc.routines.lanes import LANES

STRIDE = 3 * LANES
NODES, SCRATCH, OUT, RELATED, INDICATOR = 0, 10 * STRIDE, 20 * STRIDE, 30 * STRIDE, 35 * STRIDE
NOTHING = (0.0, math.nan, 0.0)


@njit
def update(w, t, h):
    peaks.update_size(w, NODES, STRIDE, SCRATCH, OUT, RELATED, INDICATOR, t, h)


def updated(vector, t=0.0, h=1.0, before=NOTHING):
    """Peak, time and integral after a step with the components ``vector`` (of the fraction of the
    step)."""
    w = np.zeros(40 * STRIDE)
    for i, theta in enumerate(peaks.THETA):
        w[NODES + i * STRIDE : NODES + (i + 1) * STRIDE : LANES] = vector(theta)
    w[OUT : OUT + STRIDE : LANES] = before
    update(w, t, h)
    return w[OUT : OUT + STRIDE : LANES]


def exact(vector):
    """Largest magnitude, its fraction of the step, and the mean."""

    def size(theta):
        return math.sqrt(sum(x * x for x in vector(theta)))

    grid = np.linspace(0.0, 1.0, 2001)
    best = int(np.argmax([size(theta) for theta in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 2000)]
    inside = minimize_scalar(
        lambda theta: -size(theta), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    theta_peak = max((float(grid[best]), float(inside.x)), key=size)
    return (
        size(theta_peak),
        theta_peak,
        quad(size, 0.0, 1.0, limit=1000, points=[0.37], epsabs=1e-14)[0],
    )


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
    """Peaks to round-off, integrals to 1e-11 of the peak, also where the magnitude has a corner."""
    vector = VECTORS[name]
    peak, theta_peak, mean = exact(vector)
    result = updated(vector, t=2.0, h=0.5)
    assert abs(result[0] - peak) <= 1e-11 * peak
    assert abs(result[1] - (2.0 + 0.5 * theta_peak)) <= 1e-6
    assert abs(result[2] - 0.5 * mean) <= 1e-11 * peak


def test_constant_load():
    """The peak of a constant load is at its first time, not where round-off is largest."""
    result = updated(lambda x: (1.0 + 1e-15 * math.sin(40.0 * x), 0.0, 0.0), t=3.0, h=2.0)
    assert result[0] == pytest.approx(1.0, rel=1e-14)
    assert result[1] == 3.0
    assert result[2] == pytest.approx(2.0, rel=1e-14)


def test_earlier_peaks_and_integrals():
    """A larger peak stays with its time; the integral adds up."""
    result = updated(lambda x: (x, 0.0, 0.0), t=1.0, before=(2.0, 0.25, 7.0))
    assert tuple(result) == (2.0, 0.25, pytest.approx(7.5, rel=1e-14))
    higher = updated(lambda x: (3.0 * x, 0.0, 0.0), t=1.0, before=(2.0, 0.25, 7.0))
    assert tuple(higher) == (3.0, 2.0, pytest.approx(8.5, rel=1e-14))


def test_order():
    """The truncation error of a smooth load decreases with the eighth power of the step length."""

    def load(time):
        return math.exp(-time), math.sin(2.0 * time), 0.5

    def error(count):
        result = NOTHING
        for n in range(count):
            result = updated(
                lambda x, n=n: load((n + x) / count), n / count, 1.0 / count, tuple(result)
            )
        size = lambda time: math.sqrt(sum(x * x for x in load(time)))  # noqa: E731
        best = minimize_scalar(
            lambda time: -size(time), bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-12}
        )
        return abs(result[0] - size(best.x))

    coarse, fine = error(1), error(2)
    assert coarse <= 1e-6
    assert fine <= max(coarse / 2.0**7, 1e-14)
