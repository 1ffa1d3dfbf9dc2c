"""Aerodynamic derivatives by rates, against closed forms and the independent flight."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate

AREA, LENGTH, SPEED, DENSITY = 0.4, 0.5, 100.0, 2.0  # of the aft body
AIR = {
    "body.fore.cg_m": [3.0, 0.0, 0.0],  # that of the aft body, which then moves straight on
    "environment": {
        "atmosphere": "table",
        "gravity": "none",
        "air": {
            "altitude_m": [0.0, 2000.0],
            "density_kg_per_m3": [DENSITY, DENSITY],
            "speed_of_sound_m_s": [50.0, 50.0],
        },
    },
    "initial.speed_m_s": SPEED,
    "phase": [{"name": "free"}],
    "run.end_time_s": 0.2,
    "solver.step_s": 0.005,
}
BODY = {"reference_area_m2": AREA, "reference_length_m": LENGTH}


def aero(**more):
    return {"body.aft.aerodynamics": BODY | more}


@pytest.mark.parametrize(
    ("damping", "axis", "inertia"),
    [({"roll": {"p": -0.2}}, "x", 1.0), ({"yaw": {"r": -0.2}}, "y", 2.0),
     ({"pitch": {"q": -0.2}}, "z", 2.0)],
)  # fmt: skip
@pytest.mark.parametrize("as_table", [False, True])
def test_a_rate_decays(pair, damping, axis, inertia, as_table):
    """Each damping derivative alone turns a rate into its exponential decay, and no other: M = q S
    L C (omega L / 2 V), in each of the three axes; a negative number damps in all of them."""
    ((coefficient, term),) = damping.items()
    ((rate, slope),) = term.items()
    if as_table:
        grid = {"mach": [1.0, 3.0], f"{coefficient}_{rate}": [slope, slope]}
        damping = {"table": grid}
    omega = [3.0 if one == axis else 0.0 for one in "xyz"]
    history = pair(AIR | aero(**damping) | {"initial.omega_rad_s": omega}).simulate(step_s=0.05)
    assert history.attrs["status"] == "ok"
    pressure = 0.5 * DENSITY * SPEED**2
    decay = pressure * AREA * LENGTH * slope * LENGTH / (2.0 * SPEED) / inertia
    assert decay * 0.2 < -0.09  # more than the accuracy hides
    first = history[f"aft_omega_{axis}_deg_s"].to_numpy()
    assert_allclose(first, first[0] * np.exp(decay * history["time_s"]), rtol=1e-9)


def test_every_derivative_against_the_independent_flight(pair):
    """All nine as terms of polynomials, with angles, and as tables over Mach number and alpha."""
    random = np.random.default_rng(7)
    names = ("axial_q", "normal_q", "pitch_q", "side_p", "side_r", "roll_p", "roll_r", "yaw_p",
             "yaw_r")  # fmt: skip
    table = {"mach": [1.0, 1.8, 2.1, 3.0], "alpha_deg": [-30.0, -10.0, 10.0, 30.0]}
    table |= {name: random.uniform(-0.3, 0.1, (4, 4)).tolist() for name in names}
    terms = {"side": {"r": 0.2, "beta_p": 0.4}, "pitch": {"q": -0.4, "alpha": -0.02},
             "roll": {"alpha_r": 0.3}, "normal": {"alpha": 0.4, "alpha2_beta_q": 0.6},
             "yaw": {"beta": 0.02}}  # fmt: skip
    settings = {"initial.omega_rad_s": [2.0, 0.5, -1.0], "initial.alpha_deg": 4.0}
    campaign = pair(AIR | aero(**terms, table=table) | settings)
    result = campaign.simulate(step_s=0.2).attrs
    expected = simulate(campaign.nominal().to_dict())
    assert result["status"] == expected.status == "ok"
    for name, value in expected.outcomes.items():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)
    without = pair(AIR | aero(**terms) | settings).simulate(step_s=0.2).attrs["outcomes"]
    assert abs(without["aft_omega_x_deg_s"] - result["outcomes"]["aft_omega_x_deg_s"]) > 0.1


def test_still_air_damps_nothing(pair):
    """A body that rotates in place: no airspeed, no moment, no division by zero."""
    settings = {"initial.speed_m_s": 0.0, "initial.omega_rad_s": [0.0, 0.0, 3.0]}
    history = pair(AIR | aero(pitch={"q": -5.0}) | settings).simulate(step_s=0.1)
    assert history.attrs["status"] == "ok"
    assert_allclose(history["aft_omega_z_deg_s"], math.degrees(3.0), rtol=1e-12)


def test_a_derivative_can_be_dispersed(pair, plainly):
    """Its path is that of any other term."""
    settings = aero(pitch={"q": -0.02}) | {"initial.omega_rad_s": [0.0, 0.0, 3.0]}
    law = {"dispersion.body.aft.aerodynamics.pitch.q": {"uniform": [-0.04, 0.0]}}
    table = pair(AIR | settings | law).run(cases=20).to_pandas()
    slope = table["in_body_aft_aerodynamics_pitch_q"]
    decay = 0.5 * DENSITY * SPEED * AREA * LENGTH**2 * slope / 2.0 / 2.0
    assert_allclose(table["aft_omega_z_deg_s"], math.degrees(3.0) * np.exp(0.2 * decay), rtol=1e-8)


def test_unknown_terms(pair):
    from sepmc.scene.messages import SceneError

    for term in ("p_q", "q2", "q_alpha", "s"):
        with pytest.raises(SceneError, match="one of the rates p, q, r alone or at the end"):
            pair(AIR | aero(pitch={term: 1.0}))
