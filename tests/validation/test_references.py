"""The closed forms of `sepmc.validation.references` against scipy's DOP853 of the equations they
solve; nothing here knows the engine."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sepmc.validation import references as ref

TIMES = np.linspace(0.0, 6.0, 13)
TURNED = Rotation.from_euler("zyx", [0.4, -0.7, 1.1]).as_matrix()
# By branch: principal moments and rates in principal axes.
TOPS = {
    "about the greatest": ([1.0, 2.0, 4.0], [0.5, -0.3, 1.5]),
    "about the least": ([1.0, 2.0, 4.0], [1.5, 0.4, -0.2]),
    "backward": ([4.0, 1.0, 2.0], [-1.2, -0.9, -0.1]),
    "flips: near the middle axis": ([1.0, 2.0, 3.0], [1e-3, 1.5, -2e-3]),
    "separatrix": ([1.0, 2.0, 3.0], [math.sqrt(3.0), 0.5, 1.0]),
    "separatrix, other way": ([1.0, 2.0, 3.0], [-math.sqrt(3.0), 0.5, 1.0]),
    "disc": ([1.0, 1.0, 1.8], [0.6, 0.2, 1.0]),
    "rod": ([3.0, 3.0, 0.4], [0.6, 0.2, -1.0]),
    "sphere": ([2.0, 2.0, 2.0], [0.6, 0.2, 1.0]),
    "steady": ([1.0, 2.0, 3.0], [0.0, 1.4, 0.0]),
    "nearly a rod": ([3.0, 3.0 + 1e-9, 0.4], [0.6, 0.2, -1.0]),
    "at rest": ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0]),
}
# the last on the separatrix
SWINGS = [
    (0.3, 0.0),
    (2.9, 0.0),
    (-1.0, 2.0),
    (0.5, -6.5),
    (0.0, 7.0),
    (0.2, 2.0 * 3.0 * math.cos(0.1)),
]


def integrate(rate, start, times):
    result = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-14)
    return result.y.T


@pytest.mark.parametrize("turned", [np.eye(3), TURNED], ids=["principal axes", "other axes"])
@pytest.mark.parametrize("name", TOPS)
def test_asymmetric_top(name, turned):
    """Rates and attitude to 1e-11: DOP853 at rtol 1e-13 over 6 s, and the flip amplifies by about
    e^5."""
    moments, w = (np.array(x) for x in TOPS[name])
    inertia, omega, start = turned @ np.diag(moments) @ turned.T, turned @ w, TURNED.T

    def euler(_, y):
        r, w = y[:9].reshape(3, 3), y[9:]
        return np.concatenate(
            [
                (r @ np.cross(np.eye(3), w)).ravel(),
                np.linalg.solve(inertia, np.cross(inertia @ w, w)),
            ]
        )

    expected = integrate(euler, [*start.ravel(), *omega], TIMES)
    rates, attitude = ref.asymmetric_top(TIMES, inertia, omega, start)
    assert_allclose(rates, expected[:, 9:], rtol=0, atol=1e-11)
    assert_allclose(attitude, expected[:, :9].reshape(-1, 3, 3), rtol=0, atol=1e-11)


def test_weld_wrench():
    """NASA/TP-2016-219326 test case 1: the forces of two welded boxes, against the digits of an
    independent solution with 24 unknowns."""
    a, b = np.diag([5 / 12, 26 / 12, 29 / 12]), np.diag([1 / 6, 1 / 6, 4 / 15])
    whole = ref.composite([1.0, 0.4], [a, b], [[0.0, 0.0, 0.0], [3.5, 0.0, 0.0]])
    assert_allclose(whole.centre, [1.0, 0.0, 0.0], rtol=1e-15)
    assert_allclose(whole.inertia, 1.4 / 12 * np.diag([5, 50, 53]), rtol=1e-15, atol=1e-15)
    force, moment = ref.weld_wrench(
        whole,
        0.4,
        b,
        np.array([3.5, 0.0, 0.0]),
        np.array([2.5, 0.0, 0.0]),
        np.array([0.5, 1.0, -0.3]),
    )
    assert_allclose(force[0], [-1.09, 0.0754717, -0.006], rtol=0, atol=5e-8)
    assert_allclose(moment[0], [0.0, -0.003, -0.0377358], rtol=0, atol=5e-8)
    rates, _ = ref.asymmetric_top([10.0], whole.inertia, [0.5, 1.0, -0.3])
    assert_allclose(rates[0], [0.43643767, 1.04653498, -0.07596399], rtol=0, atol=5e-9)


@pytest.mark.parametrize(("stiffness", "damping"), [(0.0, 0.0), (40.0, 0.0), (40.0, 6.0)])
def test_spring(stiffness, damping):
    mass, force, stroke = ref.reduced_mass(3.0, 6.0), 8.0, 0.15
    times = np.linspace(0.0, 1.0, 11)
    expected = integrate(
        lambda _, y: [y[1], (force - stiffness * y[0] - damping * y[1]) / mass], [0.0, 0.0], times
    )
    assert_allclose(
        np.stack(ref.spring_extension(times, mass, force, stiffness, damping), axis=1),
        expected,
        rtol=0,
        atol=1e-12,
    )
    time, speed = ref.spring_release(mass, force, stiffness, stroke, damping)
    assert_allclose(
        [float(q) for q in ref.spring_extension(time, mass, force, stiffness, damping)],
        [stroke, speed],
        rtol=1e-13,
    )


@pytest.mark.parametrize("build_up", [0.0, 0.2])
def test_thrust(build_up):
    times = np.linspace(0.0, 1.0, 11)
    rate = (
        (lambda t, y: [y[1], 3.0 * -math.expm1(-t / build_up)])
        if build_up
        else (lambda t, y: [y[1], 3.0])
    )
    assert_allclose(
        np.stack(ref.thrust_gap(times, 3.0, build_up), axis=1),
        integrate(rate, [0.0, 0.0], times),
        rtol=0,
        atol=1e-12,
    )


def test_tail_off():
    times = np.linspace(0.4, 1.5, 12)
    expected = integrate(lambda t, y: [y[1], 3.0 * math.exp(-t / 0.1)], [0.24, 1.2], times - 0.4)
    assert_allclose(
        np.stack(ref.burn_gap(times, 3.0, 0.4, 0.1), axis=1), expected, rtol=0, atol=1e-12
    )
    assert_allclose(
        np.stack(ref.burn_gap([0.1, 0.4], 3.0, 0.4, 0.1)), [[0.015, 0.24], [0.3, 1.2]], rtol=1e-14
    )


@pytest.mark.parametrize(("angle", "rate"), SWINGS)
def test_pendulum(angle, rate):
    """To 1e-11; on the separatrix, which amplifies round-off by e^9 over 3 s, to 1e-9."""
    times = np.linspace(0.0, 3.0, 13)
    expected = integrate(lambda _, y: [y[1], -9.0 * math.sin(y[0])], [angle, rate], times)
    assert_allclose(
        np.stack(ref.pendulum(times, 3.0, angle, rate), axis=1),
        expected,
        rtol=0,
        atol=1e-9 if (angle, rate) == SWINGS[-1] else 1e-11,
    )


def test_pendulum_period():
    """pi/2: K(1/2) = 1.8540746773013719 (Abramowitz and Stegun, table 17.1); after a period it
    stands where it was released."""
    assert_allclose(ref.pendulum_period(2.0, 0.5 * math.pi), 2.0 * 1.8540746773013719, rtol=1e-15)
    assert_allclose(ref.pendulum(ref.pendulum_period(2.0, 2.0), 2.0, 2.0)[0], 2.0, rtol=1e-14)


def test_hinge_wrench():
    """A rod of products zero: F = m (g + w^2 l) at the bottom; a skew inertia J_xz loads the hinge
    with J_xz w' and -+J w^2."""
    force, moment = ref.hinge_wrench(
        2.0, np.diag([1.0, 1.0, 0.1]), [0.0, -0.5, 0.0], 3.0, 0.0, [0.0, -20.0, 0.0]
    )
    assert_allclose(force, [0.0, 29.0, 0.0], atol=1e-14)
    assert_allclose(moment, 0.0, atol=1e-14)
    skew = np.diag([1.0, 1.0, 1.0]) - 0.2 * np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0]])
    _, moment = ref.hinge_wrench(2.0, skew, [0.0, 0.0, 0.0], 3.0, 5.0, [0.0, 0.0, 0.0])
    assert_allclose(moment, [-1.0, -1.8, 5.0], rtol=1e-15)


@pytest.mark.parametrize(
    ("tilt", "spin", "precession"),
    [(1.0, 8.0, 0.3), (1.0, 8.0, 9.0), (2.2, 0.0, 1.5), (2.2, 0.0, 6.0), (2.0, -5.0, 1.0)],
)
def test_heavy_top(tilt, spin, precession):
    """Lagrange's top in Euler angles, tilt'' from d/dt(dL/dtilt'): 1e-11."""
    axial, transverse, torque = 0.4, 1.3, 6.0
    times = np.linspace(0.0, 3.0, 13)
    vertical = transverse * precession * math.sin(tilt) ** 2 + axial * spin * math.cos(tilt)

    def rate(_, y):
        s, c = math.sin(y[0]), math.cos(y[0])
        turning = (vertical - axial * spin * c) / (transverse * s * s)
        return [
            y[1],
            turning * s * (turning * c - axial * spin / transverse) + torque / transverse * s,
        ]

    expected = np.cos(integrate(rate, [tilt, 0.0], times)[:, 0])
    assert_allclose(
        ref.heavy_top(times, axial, transverse, torque, tilt, spin, precession),
        expected,
        atol=1e-11,
    )
    period = ref.nutation_period(axial, transverse, torque, tilt, spin, precession)
    assert_allclose(
        ref.heavy_top(period, axial, transverse, torque, tilt, spin, precession),
        math.cos(tilt),
        rtol=1e-12,
    )


def test_released_without_motion():
    """The top without spin falls as a plane pendulum, pi - tilt from the bottom."""
    times = np.linspace(0.0, 3.0, 13)
    swing, _ = ref.pendulum(times, math.sqrt(6.0 / 1.3), math.pi - 2.5)
    assert_allclose(ref.heavy_top(times, 0.4, 1.3, 6.0, 2.5, 0.0, 0.0), -np.cos(swing), atol=1e-12)


@pytest.mark.parametrize(("tilt", "spin"), [(1.0, 12.0), (2.3, 0.0), (2.3, 3.0)])
def test_steady_precession(tilt, spin):
    """At either rate the tilt is constant. 1e-7: both extremes of the tilt meet in a double
    root."""
    for precession in ref.steady_precession(0.4, 1.3, 6.0, tilt, spin):
        u = ref.heavy_top(np.linspace(0.0, 3.0, 7), 0.4, 1.3, 6.0, tilt, spin, precession)
        assert_allclose(u, math.cos(tilt), rtol=0, atol=1e-7)
    assert_allclose(
        max(ref.steady_precession(0.0, 2.0, 2.0 * 9.81 / 0.5, 2.3, 0.0)),
        ref.conical_rate(0.5, 9.81, math.pi - 2.3),
    )


def test_hooke():
    """60 deg: a quarter turn of one shaft is a quarter turn of the other; the ratio is the slope,
    and runs from cos to 1 / cos."""
    assert_allclose(
        ref.hooke_angle([0.5 * math.pi, math.pi, 7.0 * math.pi], math.pi / 3),
        [0.5 * math.pi, math.pi, 7.0 * math.pi],
        rtol=1e-15,
    )
    assert_allclose(np.tan(ref.hooke_angle(0.3, math.pi / 3)), 0.5 * math.tan(0.3), rtol=1e-14)
    slope = (ref.hooke_angle(0.3 + 1e-5, 1.0) - ref.hooke_angle(0.3 - 1e-5, 1.0)) / 2e-5
    assert_allclose(ref.hooke_ratio(0.3, 1.0), slope, rtol=1e-9)
    assert_allclose(ref.hooke_ratio([0.0, 0.5 * math.pi], math.pi / 3), [0.5, 2.0], rtol=1e-14)


@pytest.mark.parametrize("above", [0.0, 0.2])
def test_tip_off(above):
    """Against the equations of motion of the turning body until its rear shoe reaches the end of
    the rail: 1e-12."""
    mass, inertia, ahead, gravity, elevation, speed, travel = 50.0, 40.0, 0.8, 9.8, 0.9, 12.0, 1.5

    def rate(_, y):
        # J a'' + c R = 0 with R = m (c' + g cos), across the rail: h'' = lever a'' - (ahead sin +
        # above cos) a'^2
        lever, fall = (
            ahead * math.cos(y[0]) - above * math.sin(y[0]),
            ahead * math.sin(y[0]) + above * math.cos(y[0]),
        )
        turning = (
            mass
            * lever
            * (fall * y[1] ** 2 - gravity * math.cos(elevation))
            / (inertia + mass * lever**2)
        )
        return [y[1], turning]

    def end(t, y):
        shift = ahead * (1.0 - math.cos(y[0])) + above * math.sin(y[0])
        return speed * t - 0.5 * gravity * math.sin(elevation) * t * t + shift - travel

    end.terminal = True
    result = solve_ivp(rate, (0.0, 1.0), [0.0, 0.0], "DOP853", events=end, rtol=1e-13, atol=1e-15)
    tip = ref.tip_off(mass, inertia, ahead, above, gravity, elevation, speed, travel)
    assert_allclose([tip.time, tip.angle, tip.rate], [result.t[-1], *result.y[:, -1]], rtol=1e-11)
