"""Borders between the layers of the standard atmosphere: steps end there and nowhere else."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate

from sepmc.physics.us1976_table import R0

BORDER = R0 * 11_000.0 / (R0 - 11_000.0)  # m, 11 km of geopotential height
AIR = {"reference_area_m2": 0.5, "reference_length_m": 1.0}
CLIMBING = {
    "environment": {"atmosphere": "us1976", "gravity": "inverse-square"},
    "body.fore.aerodynamics": AIR | {"axial": {"const": 0.003}},
    "body.aft.aerodynamics": AIR | {"axial": {"const": 0.008}},
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.2}},
        {"name": "free", "joints": {}},
    ],
    "initial": {"altitude_m": BORDER - 101.0, "speed_m_s": 600.0, "pitch_deg": 30.0},
    "output.loads": ["pins"],
}


def outcomes(campaign, step_s=0.05):
    history = campaign.with_settings({"solver.step_s": step_s}).simulate(step_s=0.1)
    assert history.attrs["status"] == "ok"
    return history.attrs["outcomes"]


@pytest.mark.slow
@pytest.mark.parametrize("pitch", [30.0, -30.0])
def test_a_border_is_passed_in_long_steps_as_in_short_ones(pair, pitch):
    """Both bodies cross at 300 m/s, free and at different times, in the middle of a step: error
    1e-11, without border events 1e-6."""
    side = math.copysign(1.0, pitch)
    campaign = pair(CLIMBING).with_settings(
        {"initial.altitude_m": BORDER - side * 101.0, "initial.pitch_deg": pitch}
    )
    long, short = outcomes(campaign), outcomes(campaign, 0.001)
    for name in (
        "separation_distance_mm",
        "separation_speed_m_s",
        "pins_force_impulse_N_s",
        "fore_alpha_deg",
    ):
        assert_allclose(long[name], short[name], rtol=1e-11, err_msg=name)
    assert long["steps"] <= 10 + 2 * 4  # two borders, each with steps up to it and from there on


@pytest.mark.slow
def test_a_top_just_beyond_a_border(pair):
    """A trajectory that rises 4 m into the next layer and falls back, all within a step of 1 s: the
    step ends at both borders."""
    climb = 40.0 * math.sin(math.radians(80.0))
    lob = {
        "altitude_m": BORDER + 6.0 - climb**2 / (2.0 * 9.773),
        "speed_m_s": 40.0,
        "pitch_deg": 80.0,
    }
    campaign = pair(
        CLIMBING
        | {
            "initial": lob,
            "phase": [{"name": "locked", "joints": {"pins": "fixed"}}],
            "run.end_time_s": 8.0,
        }
    )
    long, short = outcomes(campaign, 1.0), outcomes(campaign, 0.01)
    expected = simulate(campaign.nominal().to_dict()).outcomes
    for name in ("pins_peak_force_N", "fore_alpha_deg"):
        assert_allclose(long[name], short[name], rtol=1e-9, err_msg=name)
        assert_allclose(short[name], expected[name], rtol=1e-9, err_msg=name)
    assert long["steps"] >= 8 + 2


def test_a_start_on_a_border(pair):
    """A body that starts on a border belongs to the layer that it moves into: no step ends there,
    up or down."""
    one = {name: value for name, value in CLIMBING.items() if name != "body.aft.aerodynamics"}
    for pitch in (30.0, -30.0):
        ahead = 0.5 * math.sin(math.radians(pitch))  # of the mass centre
        result = outcomes(
            pair(one).with_settings(
                {"initial.altitude_m": BORDER - ahead, "initial.pitch_deg": pitch}
            )
        )
        assert result["steps"] == 10.0
        assert np.isfinite(result["fore_alpha_deg"])


def test_layers_are_nothing_to_bodies_without_aerodynamics(pair):
    """They cross a border of the default atmosphere without an event."""
    bare = {name: value for name, value in CLIMBING.items() if not name.endswith("aerodynamics")}
    result = outcomes(pair(bare))
    empty = outcomes(
        pair(bare | {"environment": {"atmosphere": "none", "gravity": "inverse-square"}})
    )
    assert result == pytest.approx(empty, rel=1e-13, nan_ok=True)
