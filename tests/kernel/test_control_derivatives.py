"""Control derivatives: terms of aerodynamic polynomials that multiply a signal."""

import math

import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate

from sepmc.scene.messages import SceneError
from sepmc.scene.signals import idle_signals

DENSITY, SPEED, AREA, LENGTH = 2.0, 100.0, 0.01, 0.5
INERTIA = 2.0  # of the aft body about z, kg m2
GAIN = 0.5 * DENSITY * SPEED**2 * AREA * LENGTH / INERTIA  # 1/s2, acceleration per coefficient


def scene(terms, *signals, **more):
    """Two free bodies in constant air; no force acts, so the speed stays. The aft body has moments
    by ``terms``."""
    air = {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [DENSITY, DENSITY]}
    return {
        "environment": {"atmosphere": "table", "gravity": "none", "air": air},
        "body.aft.aerodynamics": {"reference_area_m2": AREA, "reference_length_m": LENGTH, **terms},
        "signal": list(signals),
        "initial.speed_m_s": SPEED,
        "phase": [{"name": "free"}],
        "run.end_time_s": 1.0,
        "solver.step_s": 0.05,
    } | more


def last(pair, settings):
    """Pitch and rate of the aft body at the end, rad and rad/s."""
    history = pair(settings).simulate(step_s=1.0)
    assert history.attrs["status"] == "ok"
    row = history.iloc[-1]
    return [math.radians(row["aft_pitch_deg"]), math.radians(row["aft_omega_z_deg_s"])]


def test_an_elevator_over_time(pair):
    """omega' = gain C elevator(t), integrated by hand; half of the derivative per degree is not
    scaled: a signal counts as it stands."""
    elevator = {"name": "elevator", "formula": "size * cos(3 * time_s)", "size": 0.2}
    expected = GAIN * -0.8 * 0.2 / 3.0
    expected = [expected * (1.0 - math.cos(3.0)) / 3.0, expected * math.sin(3.0)]
    for per in ("rad", "deg"):
        terms = {"pitch": {"elevator": -0.8}, "per": per}
        assert_allclose(last(pair, scene(terms, elevator)), expected, rtol=1e-9)


def test_a_controller_with_an_elevator(pair):
    """A statically unstable body that an elevator holds: a damped oscillation in closed form."""
    elevator = {
        "name": "elevator",
        "formula": "angle_gain * aft.alpha_rad + rate_gain * aft.omega_z_rad_s",
        "angle_gain": 2.0,
        "rate_gain": 0.1,
    }
    settings = scene({"pitch": {"alpha": 0.3, "elevator": -0.8}}, elevator)
    # the path is level: alpha is the pitch
    settings |= {"initial.pitch_deg": 5.0, "initial.alpha_deg": 5.0}
    stiffness, damping = GAIN * (0.8 * 2.0 - 0.3), GAIN * 0.8 * 0.1
    half, start = 0.5 * damping, math.radians(5.0)
    rate = math.sqrt(stiffness - half**2)
    decay = start * math.exp(-half)
    angle = decay * (math.cos(rate) + half / rate * math.sin(rate))
    omega = -decay * stiffness / rate * math.sin(rate)
    assert_allclose(last(pair, settings), [angle, omega], rtol=1e-9)


@pytest.mark.slow
def test_all_coefficients_against_the_independent_flight(pair):
    """Signals in all six coefficients, one with a servo and one with a kink, beside terms of the
    flow and a table; a derivative is dispersed."""
    names = ("axial", "normal", "side", "roll", "yaw", "pitch")
    terms = {
        name: {"const": 0.01, "fin": 0.02 * (k + 1), "tab_q": -0.01 * k}
        for k, name in enumerate(names)
    }
    terms["table"] = {"alpha_deg": [-90.0, 0.0, 90.0], "pitch": [0.1, 0.0, -0.1]}
    fin = {"name": "fin", "formula": "clip(20 * sin(9 * time_s), -1, 1)"}
    tab = {
        "name": "tab_q",
        "formula": "aft.omega_z_rad_s + 1",
        "servo": {"natural_hz": 4.0, "damping": 0.5},
    }
    settings = scene(terms, fin, tab)
    settings["dispersion.body.aft.aerodynamics.yaw.fin"] = {"uniform": [0.05, 0.2]}
    campaign = pair(settings)
    for case in (campaign.nominal(), campaign.case(1)):
        result, expected = campaign.simulate(case, step_s=1.0).attrs, simulate(case.to_dict())
        assert result["status"] == expected.status == "ok"
        for name, value in expected.outcomes.items():
            assert_allclose(result["outcomes"][name], value, rtol=1e-8, atol=1e-9, err_msg=name)


def test_a_signal_of_a_term_is_not_idle(pair):
    elevator = {"name": "elevator", "formula": "time_s"}
    assert not idle_signals(pair(scene({"pitch": {"elevator": 1.0}}, elevator)).scene)
    assert idle_signals(pair(scene({}, elevator)).scene) == ["elevator"]


def test_an_unknown_signal_is_refused(pair):
    elevator = {"name": "elevator", "formula": "time_s"}
    with pytest.raises(SceneError, match=r"pitch\.elevater: terms are const.*did you mean 'elev"):
        pair(scene({"pitch": {"elevater": 1.0}}, elevator))
