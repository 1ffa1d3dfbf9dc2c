"""Every Runge-Kutta method proves its order: by its conditions, and over a whole run with a
release."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import DOP853

from sepmc.kernel.spec.methods import METHODS, method

# By method: the largest of five steps, each half of the one before, chosen so that errors lie
# between 1e-2 and round-off; and the order that a straight line through them must at least have.
STUDIES = {"rk4": (0.02, 3.7), "dopri5": (0.04, 4.7), "dop853": (0.1, 7.3)}
DENSE_STUDIES = {"rk4": 0.05, "dopri5": 0.1, "dop853": 0.4}
EXTENDED = [name for name in METHODS if method(name).has_extension]
# Table 2, lightly modified so that errors stand above round-off: it spins and flies longer, and its
# moments stay stable at large angles.
RAPID = {
    "initial.omega_deg_s": [300.0, 60.0, -60.0],
    "initial.yaw_deg": 5.0,
    "run.end_time_s": 2.0,
    "motor.retro.thrust_N": 800.0,
    "phase.locked.until": {"time_s": 0.4},
    "phase.guided.until.stroke_mm": 150.0,
    "body.upper.aerodynamics.pitch": {"const": 0.055, "alpha": -1.16},
    "body.lower.aerodynamics.pitch": {"const": -0.046, "alpha": -2.04},
    "body.upper.aerodynamics.yaw": {"beta": -0.8},
    "body.lower.aerodynamics.yaw": {"beta": -0.6},
    "body.upper.aerodynamics.axial": {"const": 0.15},
    "body.lower.aerodynamics.axial": {"const": 0.3, "alpha2": 0.5},
}
ROUND_OFF = 1e-12
OUTCOMES = (
    "release_time_s",
    "_distance_mm",
    "_speed_m_s",
    "deg_s",
    "roll_deg",
    "yaw_deg",
    "pitch_deg",
    "alpha_deg",
    "beta_deg",
)


def halved(largest):
    return [largest / 2**k for k in range(5)]


def order(steps, errors):
    """Slope of the line through log error over log step; errors near round-off are left out."""
    steps, errors = np.array(steps), np.array(errors)
    above = errors > ROUND_OFF
    assert np.count_nonzero(above) >= 2
    return np.polyfit(np.log(steps[above]), np.log(errors[above]), 1)[0]


@pytest.fixture(scope="module")
def rapid(table2):
    """Outcomes of the modified flight by method and step."""

    def fly(name, step):
        history = table2.with_settings(
            RAPID | {"solver.method": name, "solver.step_s": step}
        ).simulate(step_s=2.0)
        assert history.attrs["status"] == "ok"
        assert history["phase"].iloc[-1] == "free"
        return {k: v for k, v in history.attrs["outcomes"].items() if k.endswith(OUTCOMES)}

    return fly


@pytest.fixture(scope="module")
def reference(rapid):
    """The same run with steps of 2 ms; it differs from one with 4 ms by less than 1e-12, so its
    error is below all measured ones."""
    fine, coarser = rapid("dop853", 0.002), rapid("dop853", 0.004)
    assert_allclose(list(coarser.values()), list(fine.values()), rtol=1e-12, atol=1e-12)
    return fine


def test_every_method_is_studied():
    assert set(STUDIES) == set(DENSE_STUDIES) == set(EXTENDED)


@functools.cache
def trees(nodes):
    """All rooted trees with so many nodes, each as the sorted tuple of the trees below its root."""

    def forests(left, most):
        if left == 0:
            yield ()
        for size in range(min(left, most), 0, -1):
            for tree in trees(size):
                for others in forests(left - size, size):
                    yield (tree, *others)

    return sorted({tuple(sorted(forest)) for forest in forests(nodes - 1, nodes - 1)})


def order_conditions(rk, nodes):
    """Residuals of all conditions of an order, one for each rooted tree (Hairer, Norsett, Wanner,
    Solving ODE I, II.2, theorem 2.13)."""
    a = rk.a[: rk.stages, : rk.stages]

    def size(tree):
        return 1 + sum(map(size, tree))

    def density(tree):
        return size(tree) * math.prod(map(density, tree))

    def weight(tree):
        return math.prod((a @ weight(below) for below in tree), start=np.ones(rk.stages))

    return [float(rk.b @ weight(tree)) - 1.0 / density(tree) for tree in trees(nodes)]


@pytest.mark.parametrize("name", METHODS)
def test_every_order_condition_holds(name):
    """All conditions up to the method's order hold to round-off, and not all of the next."""
    rk = method(name)
    assert [len(trees(n)) for n in range(1, 11)] == [1, 1, 2, 4, 9, 20, 48, 115, 286, 719]
    for nodes in range(1, rk.order + 1):
        assert np.abs(order_conditions(rk, nodes)).max() <= 1e-14
    assert np.abs(order_conditions(rk, rk.order + 1)).max() >= 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("name", EXTENDED)
def test_order_over_a_whole_flight(rapid, reference, name):
    """Largest relative error of all outcomes, and the error of the release time, over five halvings
    of the step."""
    largest, least = STUDIES[name]
    steps = halved(largest)
    flown = [rapid(name, step) for step in steps]
    errors = [
        max(abs(result[k] - value) / abs(value) for k, value in reference.items())
        for result in flown
    ]
    release = [abs(result["release_time_s"] - reference["release_time_s"]) for result in flown]
    print(
        f"{name}: order {order(steps, errors):.2f}, of the release time {order(steps, release):.2f}"
    )
    assert order(steps, errors) >= least
    # the last of the way to it is a short step of order 4
    assert order(steps, release) >= min(least, 5.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXTENDED)
def test_order_of_the_continuous_extension(table2, name):
    """Rows inside a single step: an extension of order p leaves an error of h^(p+1), less 0.3 for
    what is not yet asymptotic."""
    guided = {"phase": [{"name": "guided", "joints": {"pins": "slider"}}]}
    steps, errors = halved(DENSE_STUDIES[name]), []
    settings = {k: v for k, v in RAPID.items() if not k.startswith("phase.")} | guided
    for h in steps:
        single = table2.with_settings(
            settings | {"solver.method": name, "solver.step_s": h, "run.end_time_s": h}
        ).simulate(step_s=h / 8)
        fine = table2.with_settings(
            settings | {"solver.step_s": h / 32, "run.end_time_s": h}
        ).simulate(step_s=h / 8)
        assert single.attrs["outcomes"]["steps"] == 1
        columns = [c for c in single if c.endswith(OUTCOMES)]
        # between the ends, where the step itself is
        errors.append(np.abs(single[columns] - fine[columns]).to_numpy()[1:-1].max())
    print(f"{name}: extension {order(steps, errors):.2f}")
    assert order(steps, errors) >= method(name).dense_order + 1 - 0.3


def test_dop853_is_scipys():
    """Coefficients of an independent source, to the last digit but one."""
    result = method("dop853")
    stages = len(result.b)
    assert_allclose(result.a[:stages, :stages], DOP853.A[:stages, :stages], rtol=4e-16, atol=0)
    assert_allclose(result.b, DOP853.B, rtol=4e-16, atol=0)
    assert_allclose(result.c[:stages], DOP853.C[:stages], rtol=4e-16, atol=0)
    assert_allclose(result.a[stages + 1 :], DOP853.A_EXTRA, rtol=4e-16, atol=0)
    assert_allclose(result.c[stages + 1 :], DOP853.C_EXTRA, rtol=4e-16, atol=0)


def test_dop853_extension_is_scipys():
    """The polynomial per stage against scipy's nested form, on random stage derivatives (some tens
    of round-off)."""
    result = method("dop853")
    k = np.random.default_rng(1).normal(size=16)
    delta = k[:12] @ result.b
    f = [delta, k[0] - delta, 2.0 * delta - (k[12] + k[0]), *(DOP853.D @ k)]
    for theta in (0.1, 0.5, 0.9, 1.0):
        expected = 0.0
        for i, coefficient in enumerate(reversed(f)):
            expected = (expected + coefficient) * (theta if i % 2 == 0 else 1.0 - theta)
        powers = theta ** np.arange(result.dense.shape[1])
        assert_allclose(k @ (result.dense @ powers), expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "part"),
    [
        (name, part)
        for name in METHODS
        for part in ("a", "b", "dense")
        if part != "dense" or name in EXTENDED
    ],
)
def test_a_wrong_coefficient_is_refused(name, part):
    """A method checks itself: an error of 1e-8 in one entry is found."""
    good = method(name)
    wrong = getattr(good, part).copy()
    # in the last stage's row
    wrong.flat[-1 if part == "b" else wrong.shape[-1] * (len(good.b) - 1)] += 1e-8
    with pytest.raises(ValueError, match=name):
        dataclasses.replace(good, **{part: wrong})
