"""Springs that only push: no force where the sum of their forces is below zero."""

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import independent
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from support.pusher import MASSES, pusher_tree

from sepmc.campaign.campaign import Campaign
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

PHASES = [
    {"name": "held", "joints": {"ring": "fixed"}, "until": {"time_s": 0.01}},
    {"name": "free"},
]
END = 0.4
RUN = {"end_time_s": END, "cases": 20, "seed": 1}
SOLVER = {"step_s": 0.005}  # too long for a kink within a step
INVERSE_MASS = sum(1.0 / mass for mass in MASSES)
LINEAR = {"force_N": 2000.0, "stiffness_N_per_m": 40000.0}
ROWS, DIPS = [0.0, 0.02, 0.05, 0.07, 0.09, 0.12], [900.0, 600.0, -80.0, -100.0, 100.0, 150.0]


def campaign(spring, **more):
    """Campaign of two bodies, first held, that a spring that only pushes separates."""
    tree = pusher_tree({"push_only": True} | spring, phase=PHASES, run=RUN, solver=SOLVER)
    return Campaign(parse_campaign(tree | more, "pusher.toml"))


def simulated(one):
    """Separation speed of the nominal case, whose errors are checked."""
    result = one.simulate(step_s=END).attrs
    assert result["status"] == "ok"
    assert max(result["errors"].values()) < 1e-9
    return result["outcomes"]["separation_speed_m_s"]


def integrated(force):
    """Separation speed under a force of time, extension and rate, cut at zero, with scipy."""
    short = {"rtol": 1e-12, "atol": 1e-14, "max_step": 1e-3}
    flight = solve_ivp(
        lambda t, y: [y[1], max(0.0, force(t, *y)) * INVERSE_MASS],
        (0.01, END),
        [0.0, 0.0],
        method="DOP853",
        **short,
    )
    return flight.y[1, -1]


def test_a_linear_spring_gives_its_energy_and_no_more():
    """Force F0 - k x ends at F0 / k: speed by the energy F0^2 / 2k."""
    speed = math.sqrt(LINEAR["force_N"] ** 2 / LINEAR["stiffness_N_per_m"] * INVERSE_MASS)
    assert_allclose(simulated(campaign(LINEAR)), speed, rtol=1e-10)
    assert simulated(campaign(LINEAR | {"push_only": False})) < 0.9 * speed


def test_a_table_that_pulls_in_between_pushes_again():
    """Work of the positive parts of a cubic table, up to its last row."""
    spring = {"table": {"extension_m": ROWS, "force_N": DIPS}}
    points = np.sort([*CubicSpline(ROWS, DIPS).roots(extrapolate=False), ROWS[0], ROWS[-1]])
    curve = CubicSpline(ROWS, DIPS)
    parts = [curve.integrate(a, b) for a, b in pairwise(points)]
    work = sum(max(0.0, part) for part in parts)
    assert min(parts) < 0.0
    assert_allclose(simulated(campaign(spring)), math.sqrt(2.0 * work * INVERSE_MASS), rtol=1e-9)


def test_damping_is_cut_too():
    spring = {"force_N": 1500.0, "stiffness_N_per_m": 2e4, "damping_N_s_per_m": 600.0}
    speed = integrated(lambda t, x, v: 1500.0 - 2e4 * x - 600.0 * v)
    assert_allclose(simulated(campaign(spring)), speed, rtol=1e-8)


def test_a_force_by_a_signal_is_cut_and_comes_back():
    """Force 800 sin(w t) over several periods: only its positive halves push."""
    signal = {"name": "swing", "formula": "800.0 * sin(40.0 * time_s)"}
    one = campaign({"force_N": "swing"}, signal=[signal])
    speed = simulated(one)
    # the impulse of whole halves, without the fixed start
    times = np.linspace(0.01, END, 2_000_001)
    force = np.maximum(0.0, 800.0 * np.sin(40.0 * times))
    assert_allclose(speed, np.trapezoid(force, times) * INVERSE_MASS, rtol=1e-8)
    expected = independent.simulate(one.nominal().to_dict()).outcomes["separation_speed_m_s"]
    assert_allclose(speed, expected, rtol=1e-10)


@pytest.mark.slow
def test_bodies_that_come_back_are_pushed_again():
    """A load presses the bodies together again after the spring was slack; dispersed cases
    against the independent flight, with a table that loses force on the way back."""
    press = {"name": "press", "body": "fore", "force_N": [-900.0, 0.0, 0.0], "start_s": 0.06}
    table = {"extension_m": [0.0, 0.03], "force_N": [500.0, 0.0], "return_factor": 0.7}
    one = campaign(
        LINEAR | {"stroke_m": 0.5, "point_m": [1.0, 0.05, 0.0], "table": table},
        load=[press],
        dispersion={
            "spring.pusher.force_N": {"uniform": [1600.0, 2400.0]},
            "spring.pusher.factor": {"uniform": [0.9, 1.1]},
        },
    )
    for number in range(2):
        case = one.case(number)
        result = one.simulate(case, step_s=END).attrs
        assert result["status"] == "ok"
        expected = independent.simulate(case.to_dict()).outcomes
        for name in ("separation_speed_m_s", "separation_distance_mm", "fore_omega_z_deg_s"):
            assert_allclose(result["outcomes"][name], expected[name], rtol=1e-8)


def test_it_is_a_choice_of_the_scene():
    with pytest.raises(SceneError, match=r"spring\.pusher\.push_only = 1: must be true or false"):
        campaign({"force_N": 1.0, "push_only": 1})
