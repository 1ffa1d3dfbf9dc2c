"""Polynomials of separations over a step reproduce polynomials."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from sepmc.kernel.spec.methods import METHODS, method
from sepmc.routines import curves
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import AT_POINT

START, STEP = 0.3, 0.08  # s


def test_stages_within_a_step_are_in_order():
    """Stages inside a step are in order, and the end of the step uses their derivatives."""
    for name in METHODS:
        rk = method(name)
        fractions = rk.c[list(rk.within)]
        assert (np.diff([0.0, *fractions, 1.0]) > 0.0).all()
        assert (rk.b[list(rk.within)] != 0.0).all()


@pytest.mark.parametrize("name", METHODS)
def test_polynomials_are_reproduced(name):
    """Polynomials of the largest exact degree (four above the number of accelerations) in every
    lane, at instants every 10 ms within the step and to its end, which is earlier than that of the
    method's step in one lane."""
    rk, random = method(name), np.random.default_rng(3)
    fractions = [0.0, *rk.c[list(rk.within)], 1.0]
    count, joints, stride = len(fractions), 2, len(fractions) + 4
    exact = [
        [Polynomial(random.normal(size=count + 4), [START, START + STEP]) for _ in range(joints)]
        for _ in range(LANES)
    ]
    size = AT_POINT * joints
    points, coefficients, length, begin, end, values = np.cumsum(
        np.array([0, count * size, joints * stride, 1, 1, 1]) * LANES
    )
    w = np.full(values + 2 * LANES, np.nan)
    w[length : length + LANES], w[begin : begin + LANES] = STEP, START
    w[end : end + LANES] = START + STEP
    w[end + 1] = START + 0.5 * STEP
    for lane, of_lane in enumerate(exact):
        for i, fraction in enumerate(fractions):
            for j, curve in enumerate(of_lane):
                t = START + fraction * STEP
                for k in range(AT_POINT):
                    position = points + (i * size + AT_POINT * j + k) * LANES + lane
                    w[position] = curve.deriv(k)(t) if k else curve(t)
    curves.fit(w, points, joints, count, rk.curve, length, coefficients, stride)
    history = np.full((LANES, 60, 2 * joints), np.nan)
    curves.write(w, coefficients, joints, stride, begin, end, length, values, 0.01, history, 0)
    times = 0.01 * np.arange(60)
    for lane, of_lane in enumerate(exact):
        last = w[end + lane]
        within = (times >= START - 1e-12) & (times <= last + 1e-12)
        assert np.isnan(history[lane, ~within]).all()
        for j, curve in enumerate(of_lane):
            speed, distance = history[lane, within, 2 * j], history[lane, within, 2 * j + 1]
            assert_allclose(distance, curve(times[within]), rtol=0, atol=1e-9)
            assert_allclose(speed, curve.deriv()(times[within]), rtol=0, atol=1e-7)


def test_negative_times_have_no_rows():
    """A diverging case may step from a negative time."""
    joints, stride = 1, 3
    coefficients, length, begin, end, values = np.cumsum(
        np.array([0, joints * stride, 1, 1, 1]) * LANES
    )
    w = np.zeros(values + 2 * LANES)
    w[length : length + LANES], w[begin : begin + LANES] = 0.1, START
    w[end : end + LANES] = START + 0.1
    w[length], w[begin], w[end] = 2.0, -1.2, 0.8
    history = np.full((LANES, 60, 2), np.nan)
    curves.write(w, coefficients, joints, stride, begin, end, length, values, 0.01, history, 0)
    assert np.isfinite(history[0]).all()
    assert (np.isfinite(history[1:]).sum(axis=(1, 2)) == 2 * 11).all()
    w[begin] = -np.inf
    history[:] = np.nan
    curves.write(w, coefficients, joints, stride, begin, end, length, values, 0.01, history, 0)
    assert np.isnan(history).all()
