"""Measurements: angles count up to full turns."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import SPRUNG

import sepmc
from sepmc.campaign.estimation import Model
from sepmc.campaign.measured_channels import MeasuredChannel, at_samples, read_measurements

MEASURED = """
[[measurement]]
column = "fore_pitch_deg"
file = "flight.csv"
sigma = 0.1
"""


def measured(folder, count, noise):
    """Campaign whose pitch, which stays 0, is measured from 0 to 360 deg."""
    (folder / "c.toml").write_text(SPRUNG + MEASURED)
    errors = noise * np.random.default_rng(0).standard_normal(count)
    table = {"time_s": np.linspace(0.0, 0.3, count), "fore_pitch_deg": errors % 360.0}
    pd.DataFrame(table).to_csv(folder / "flight.csv", index=False)
    return sepmc.load(folder / "c.toml"), errors


def test_residuals_of_a_measured_angle_do_not_jump_by_a_turn(tmp_path):
    campaign, errors = measured(tmp_path, 20, 0.1)
    settings = {"file": str(tmp_path / "flight.csv"), "delay_sigma_s": 0.001}
    settings = {f"measurement.0.{key}": value for key, value in settings.items()}
    campaign = campaign.with_settings(settings | {"run.sampler": "lhs"})  # one trial case
    with run_interpreted():
        model = Model(campaign, announce=str)
        residuals = model.residuals(np.zeros((1, model.dimensions)))[0]
    assert "an angle, up to full turns" in model.understood[0]
    assert residuals == pytest.approx(errors[1:-1] / 0.1, abs=1e-9)
    table = model.table(np.zeros((2, model.dimensions)), np.random.default_rng(0))
    assert table["parameter"].iloc[-1] == "delay of flight.csv"


def test_means_of_groups_of_angles_are_not_taken_over_a_jump(tmp_path):
    campaign, errors = measured(tmp_path, 1500, 0.1)
    (channel,), _ = read_measurements(campaign)
    assert channel.averaged == 2
    near = (channel.values + 180.0) % 360.0 - 180.0
    assert near == pytest.approx(errors.reshape(-1, 2).mean(axis=1), abs=1e-9)


def test_histories_are_brought_to_the_turn_of_the_telemetry():
    """At the samples, and between rows that lie on both sides of a jump."""
    times = np.array([0.0, 1.0, 2.0])
    histories = np.array([[358.0, 361.0, 364.0], [178.0, -179.0, -176.0]])
    values = np.array([-2.0, 1.0, 4.0])
    channel = MeasuredChannel(
        "pitch_deg", "deg", times, values, np.ones(3), "f.csv", 0.0, 0.0, 0, 1, True
    )
    exact = at_samples(histories, times, channel, None)
    assert exact[0] == pytest.approx(values)
    assert np.abs(exact - values).max() <= 180.0
    between = at_samples(histories, times, channel, np.array([-0.5]))
    assert between[0, :2] == pytest.approx([-0.5, 2.5])
    assert between[1, 0] == pytest.approx(179.5)
    plain = at_samples(histories, times, replace(channel, wraps=False), None)
    assert plain == pytest.approx(histories)
