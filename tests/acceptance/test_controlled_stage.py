"""The campaign `controlled-stage` against the hand calculation in its header."""

import copy
import math

import numpy as np
import pytest

import sepmc

FILE = "controlled-stage.toml"
ENGINE_S = 0.58  # start of the engine


def without_lags():
    """Signals of the campaign with an ideal computer and gimbal, and thrust at once."""
    signals = copy.deepcopy(sepmc.load(FILE).file.tree["signal"])
    for signal in signals:
        for key in ("sample_s", "delay_s", "servo"):
            signal.pop(key, None)
    return {"signal": signals, "signal.thrust.rise_s": 1e-4, "dispersion": {}}


def pitch(t, start_deg=1.16, rate_deg_s=2.0):
    """Pitch of the closed loop without lags, deg, a time t after the start of the engine, s."""
    a, b = 1.4, 2.0 * math.sqrt(1.0 - 0.49)
    along = start_deg * np.cos(b * t) + (rate_deg_s + a * start_deg) / b * np.sin(b * t)
    return np.exp(-a * t) * along


@pytest.mark.slow
def test_loop_without_lags():
    history = sepmc.load(FILE, without_lags()).simulate(step_s=0.02)
    assert history.attrs["status"] == "ok"
    after = history[history["time_s"] > ENGINE_S + 0.01]
    expected = pitch(after["time_s"].to_numpy() - ENGINE_S)
    # sin(x) for x up to 0.7 deg, gains of five digits, and a rise of 0.1 ms
    np.testing.assert_allclose(after["upper_pitch_deg"], expected, rtol=0, atol=5e-4)
    assert history["upper_pitch_deg"].max() == pytest.approx(1.3910, abs=5e-4)


@pytest.mark.slow
def test_as_flown():
    """The computer and the gimbal are late: the stage turns further, and is caught all the same."""
    history = sepmc.load(FILE).simulate(step_s=0.02)
    assert history["upper_pitch_deg"].max() == pytest.approx(1.51, abs=0.005)
    assert abs(history["upper_pitch_deg"].iloc[-1]) < 0.02
    assert history.attrs["outcomes"]["energy_residual"] < 1e-9


def test_failed_channel():
    settings = {"signal.pitch_command.works": 0.0, "dispersion": {}}
    outcomes = sepmc.load(FILE, settings).simulate(step_s=1.0).attrs["outcomes"]
    assert outcomes["upper_pitch_deg"] == pytest.approx(8.0, abs=0.01)


def test_springs():
    settings = {"initial.omega_deg_s": [0.0, 0.0, 0.0], "dispersion": {}}
    outcomes = sepmc.load(FILE, settings).simulate(step_s=1.0).attrs["outcomes"]
    assert outcomes["start_separation_speed_m_s"] == pytest.approx(1.0247, abs=1e-4)
