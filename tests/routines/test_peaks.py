"""Peak, its time and integral of the magnitude of a vector over a step, from its components at the
nodes."""

import math

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from support.compiled import compiled

from sepmc.routines import between_nodes, peaks
from sepmc.routines.lanes import LANES, get3, put3
from sepmc.routines.layout import PEAK_NODES, PEAK_PAIRS, PEAK_SCRATCH

STRIDE = 3 * LANES
NODES, OUT, RELATED, INDICATOR = 0, 10 * STRIDE, 11 * STRIDE, 12 * STRIDE
ROUGH, SUMMIT, BEGIN, LENGTH, SCRATCH = (k * STRIDE for k in (13, 14, 15, 16, 20))
SIZE = SCRATCH + PEAK_SCRATCH * LANES
NOTHING = (0.0, math.nan, 0.0)


def at_nodes(w, t, h):
    """What a kernel does in all lanes."""
    nodes = (
        get3(w, NODES),
        get3(w, NODES + STRIDE),
        get3(w, NODES + 2 * STRIDE),
        get3(w, NODES + 3 * STRIDE),
        get3(w, NODES + 4 * STRIDE),
        get3(w, NODES + 5 * STRIDE),
        get3(w, NODES + 6 * STRIDE),
        get3(w, NODES + 7 * STRIDE),
    )
    fine, coarse = 0.0, 0.0
    for j in range(PEAK_PAIRS):
        sizes = peaks.sizes_between(j, nodes)
        fine += peaks.KRONROD_PAIRS[j] * sizes
        coarse += peaks.GAUSS_PAIRS[j] * sizes
    w[INDICATOR] = max(w[INDICATOR], peaks.truncation(nodes) * h)
    return peaks.update_by_nodes(nodes, fine, coarse, get3(w, OUT), w[RELATED], t, h)


@compiled
def update(w, t, h):
    w[BEGIN], w[LENGTH] = t, h
    record, w[ROUGH], w[SUMMIT] = at_nodes(w, t, h)
    put3(w, OUT, record)
    between_nodes.update(w, NODES, OUT, ROUGH, SUMMIT, BEGIN, LENGTH, SCRATCH)


def updated(vector, t=0.0, h=1.0, before=NOTHING):
    """Peak, time and integral after a step with the components ``vector`` (of the fraction of the
    step)."""
    w = np.zeros(SIZE)
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


@pytest.mark.parametrize("half", [0.05, 0.01, 0.003, 0.001])
def test_a_component_that_reverses_twice(half):
    """A dip below zero counts wherever it is in the step, and however short it is."""
    for middle in np.linspace(half, 1.0 - half, 200):
        result = updated(lambda x, c=middle: ((x - c) ** 2 - half * half, 0.0, 0.0))
        dip = 4.0 / 3.0 * half**3
        mean = ((1.0 - middle) ** 3 + middle**3) / 3.0 - half * half + 2.0 * dip
        assert abs(result[2] - mean) <= 1e-11 * result[0]


@pytest.mark.parametrize("zeros", [(0.21, 0.5, 0.83), (0.02, 0.11, 0.3, 0.52, 0.71, 0.9, 0.97)])
def test_several_corners(zeros):
    """Each zero of a component that has no others beside it is found as closely as a single one."""
    polynomial = np.polynomial.Polynomial.fromroots(zeros)
    result = updated(lambda x: (1e3 * polynomial(x), 0.0, 0.0))
    total = polynomial.integ()
    parts = np.diff([total(x) for x in (0.0, *zeros, 1.0)])
    assert result[2] == pytest.approx(1e3 * np.abs(parts).sum(), abs=3e-12 * result[0])


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


def test_rule():
    """Kronrod's rule is exact to degree 22, and that of Gauss to degree 13; points between the
    nodes are those of the polynomial."""
    x = peaks.BETWEEN @ -np.cos(np.arange(PEAK_NODES) * math.pi / (PEAK_NODES - 1))
    for degree in range(0, 24, 2):
        mean = 1.0 / (degree + 1)
        assert peaks.KRONROD @ x**degree == pytest.approx(mean, rel=1e-14)
        assert (abs(peaks.GAUSS @ x**degree - mean) < 1e-15) == (degree < 14)


def mean_of(coefficients):
    """Mean magnitude of a vector of Chebyshev series, by Gauss's rule on intervals that halve
    towards the zeros of the magnitude."""
    square = sum(Chebyshev(c) ** 2 for c in coefficients)
    zeros = [root.real for root in square.roots() if abs(root.real) < 1.0]
    near = [zero + side * 0.5**k for zero in zeros for side in (-1, 1) for k in range(45)]
    ends = np.unique(np.clip([-1.0, 1.0, *np.linspace(-1, 1, 41), *zeros, *near], -1.0, 1.0))
    x, weights = np.polynomial.legendre.leggauss(12)
    half = 0.5 * np.diff(ends)
    inside = (ends[:-1] + half)[:, None] + half[:, None] * x
    size = np.sqrt(sum(Chebyshev(c)(inside) ** 2 for c in coefficients))
    return 0.5 * float((half[:, None] * weights * size).sum())


def test_random_vectors():
    """Means without halving are within 1e-12 of the largest magnitude, as those with it; both
    occur."""
    random = np.random.default_rng(3)
    n_halved, count = 0, 400
    for _ in range(count):
        decay = 10.0 ** random.uniform(-2.5, -0.2)
        coefficients = random.normal(size=(3, PEAK_NODES)) * decay ** np.arange(PEAK_NODES)
        coefficients[1:] *= 10.0 ** random.uniform(-6.0, 0.0)
        coefficients[0, 0] *= 10.0 ** random.uniform(-3.0, 0.0)
        series = [Chebyshev(c) for c in coefficients]
        w = np.zeros(SIZE)
        for i, theta in enumerate(peaks.THETA):
            w[NODES + i * STRIDE : NODES + (i + 1) * STRIDE : LANES] = [
                one(2.0 * theta - 1.0) for one in series
            ]
        w[OUT : OUT + STRIDE : LANES] = NOTHING
        n_halved += at_nodes(w, 0.0, 1.0)[1] > 0.0
        update(w, 0.0, 1.0)
        assert w[OUT + 2 * LANES] == pytest.approx(mean_of(coefficients), abs=3e-12 * w[OUT])
    assert 0.1 * count < n_halved < 0.9 * count


def test_a_step_of_no_length_changes_nothing():
    before = (2.0, 0.25, 7.0)
    result = updated(lambda x: (3.0 + x, 1.0, math.nan), t=1.0, h=0.0, before=before)
    assert tuple(result) == before
