"""Polynomials of separations over a step, against polynomials that they have to give back."""

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
    for name in METHODS:
        rk = method(name)
        shares = rk.c[list(rk.within)]
        assert (np.diff([0.0, *shares, 1.0]) > 0.0).all()
        # the derivative of such a stage is kept, as the end of the step is made of it
        assert (rk.b[list(rk.within)] != 0.0).all()


@pytest.mark.parametrize("name", METHODS)
def test_polynomials_are_given_back(name):
    """Of a degree four above the number of accelerations at most, in every lane, at instants every
    10 ms within the step and up to its end, which is earlier than that of the step of the method in
    one lane."""
    rk, random = method(name), np.random.default_rng(3)
    shares = [0.0, *rk.c[list(rk.within)], 1.0]
    count, joints, stride = len(shares), 2, len(shares) + 4
    exact = [
        [Polynomial(random.normal(size=count + 4), [START, START + STEP]) for _ in range(joints)]
        for _ in range(LANES)
    ]
    size = AT_POINT * joints
    points, found, length, begin, end = np.cumsum(
        np.array([0, count * size, joints * stride, 1, 1]) * LANES
    )
    w = np.full(end + LANES, np.nan)
    w[length : length + LANES], w[begin : begin + LANES], w[end:] = STEP, START, START + STEP
    w[end + 1] = START + 0.5 * STEP
    for lane, of_lane in enumerate(exact):
        for i, share in enumerate(shares):
            for j, curve in enumerate(of_lane):
                t = START + share * STEP
                for k in range(AT_POINT):
                    place = points + (i * size + AT_POINT * j + k) * LANES + lane
                    w[place] = curve.deriv(k)(t) if k else curve(t)
    curves.fit.py_func(w, points, joints, count, rk.curve, length, found, stride)
    history = np.full((LANES, 60, 2 * joints), np.nan)
    curves.write.py_func(w, found, joints, stride, begin, end, length, 0.01, history, 0)
    times = 0.01 * np.arange(60)
    for lane, of_lane in enumerate(exact):
        last = w[end + lane]
        within = (times >= START - 1e-12) & (times <= last + 1e-12)
        assert np.isnan(history[lane, ~within]).all()
        for j, curve in enumerate(of_lane):
            speed, distance = history[lane, within, 2 * j], history[lane, within, 2 * j + 1]
            assert_allclose(distance, curve(times[within]), rtol=0, atol=1e-9)
            assert_allclose(speed, curve.deriv()(times[within]), rtol=0, atol=1e-7)


def test_times_before_the_flight_have_no_rows():
    """A flight that goes astray may step from a time before it began."""
    joints, stride = 1, 3
    found, length, begin, end = np.cumsum(np.array([0, joints * stride, 1, 1]) * LANES)
    w = np.zeros(end + LANES)
    w[length : length + LANES], w[begin : begin + LANES], w[end:] = 0.1, START, START + 0.1
    w[length], w[begin], w[end] = 2.0, -1.2, 0.8
    history = np.full((LANES, 60, 2), np.nan)
    curves.write.py_func(w, found, joints, stride, begin, end, length, 0.01, history, 0)
    assert np.isfinite(history[0]).all()
    assert (np.isfinite(history[1:]).sum(axis=(1, 2)) == 2 * 11).all()
    w[begin] = -np.inf
    history[:] = np.nan
    curves.write.py_func(w, found, joints, stride, begin, end, length, 0.01, history, 0)
    assert np.isnan(history).all()
