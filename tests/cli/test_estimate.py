"""`sepmc estimate`: parameters from telemetry."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import SPRUNG

import sepmc
from sepmc.campaign import estimation
from sepmc.campaign.estimation import estimate
from sepmc.cli import app, estimate_results
from sepmc.scene.messages import InputError, SceneError

SIGMA, CASE = 0.01, 5
MEASURED = f"""
[[measurement]]
column = "separation_speed_m_s"
file = "flight.csv"
channel = "-2 * back [m/s]"
sigma = {SIGMA}
delay_s = 100.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A campaign and telemetry of one of its cases, on another clock."""
    folder = tmp_path_factory.mktemp("flight")
    (folder / "c.toml").write_text(SPRUNG + MEASURED)
    with run_interpreted():
        campaign = sepmc.load(folder / "c.toml")
        history = campaign.simulate(CASE, 0.03)
    speed = history["separation_speed_m_s"]
    noise = SIGMA * np.random.default_rng(0).standard_normal(len(speed))
    table = {"time_s": history["time_s"] + 100.0, "back": -0.5 * (speed + noise)}
    pd.DataFrame(table).to_csv(folder / "flight.csv", index=False)
    return folder


def estimated(*arguments):
    with run_interpreted():
        return CliRunner().invoke(app.main, ["estimate", *map(str, arguments)])


@pytest.mark.slow
def test_an_estimate_is_a_run_of_the_posterior(folder):
    out = folder / "run"
    done = estimated(folder / "c.toml", "--cases", "100", "--out", out)
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out / "posterior.csv").set_index("parameter")
    summary = json.loads((out / "posterior.json").read_text())
    assert not summary["model_is_short"]
    truth = sepmc.load(folder / "c.toml").sample(CASE, 1)[0]
    away = (truth - table["mean"]) / table["std"]
    assert np.abs(away).max() < 3.0
    assert (table["std"] < table["prior_std"]).all()
    assert summary["effective_cases"] == pytest.approx(table["effective_cases"].min())
    assert summary["effective_cases"] > 50.0
    assert 0.0 < summary["acceptance"] <= 1.0
    assert "cases are worth at least" in done.output
    assert "warning" not in done.output
    samples = pd.read_parquet(out / "samples.parquet")
    rows = sepmc.open(out).to_pandas()
    assert list(rows["in_spring_push_force_N"]) == list(samples["in_spring_push_force_N"])
    assert len(rows) == 100
    assert rows["separation_speed_m_s"].std() < 3.0 * SIGMA
    assert "explains the measurements" in done.output
    assert (out / "posterior.png").stat().st_size > 10_000
    again = CliRunner().invoke(app.main, ["doctor", str(out)])
    assert again.exit_code == 0, again.output


@pytest.mark.slow
def test_a_sigma_far_too_large_and_bad_mixing_are_warned_of(folder, monkeypatch):
    monkeypatch.setattr(estimation, "_MIXED", 2.0)
    campaign = sepmc.load(folder / "c.toml", {"measurement.0.sigma": 10.0 * SIGMA})
    with run_interpreted():
        result = estimate(campaign, 100, announce=str)
    sigma, mixing = result.notes
    assert "of sigma = 0.1, which is far too large: give a sigma of 0.0" in sigma
    assert "100 cases are worth" in mixing
    assert "far too large" in result._repr_html_()
    assert "explained by the model" in repr(result)


@pytest.mark.parametrize("scatters", [False, True])
def test_residuals_that_scatter_are_not_called_explained(scatters):
    """One line or the other: too small a sigma is no shortfall of the model, but no explanation."""
    test = {"chi_square": 1.0, "freedom": 1, "p_value": 0.5}
    holds, fails = SimpleNamespace(**test, fails=False), SimpleNamespace(**test, fails=scatters)
    check = SimpleNamespace(
        blocks=holds,
        parameters=holds,
        noise=fails,
        is_short=False,
        channels=[SimpleNamespace(ratio=3.0)],
    )
    channels = [SimpleNamespace(column="x")]
    _, line = estimate_results._check(SimpleNamespace(check=check, channels=channels))
    assert ("explains the measurements" in line) != scatters
    assert ("residuals scatter more" in line) == scatters


def test_a_run_stays_if_the_estimate_that_replaces_it_fails(folder):
    out = folder / "kept"
    with run_interpreted():
        sepmc.load(folder / "c.toml").run(3, out=out)
    before = sorted(path.name for path in out.iterdir())
    wrong = "measurement.0.file=none.csv"
    done = estimated(folder / "c.toml", "--set", wrong, "--out", out, "--overwrite")
    assert done.exit_code == 2, done.output
    assert sorted(path.name for path in out.iterdir()) == before
    assert len(sepmc.open(out).to_pandas()) == 3


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"delay_s": 0.0}, "0 samples within the run"),
        ({"file": "none.csv"}, "measurement.0.file = none.csv: "),
        ({"channel": "gone"}, "no channel 'gone'"),
        ({"channel": "0 * back"}, "measurement.0.channel"),
    ],
)
def test_measurements_that_cannot_be_read_are_refused(folder, change, reason):
    campaign = sepmc.load(folder / "c.toml")
    campaign = campaign.with_settings({f"measurement.0.{key}": x for key, x in change.items()})
    with pytest.raises(InputError, match=reason):
        estimate(campaign)


def test_a_campaign_needs_measurements_and_distributions(folder):
    campaign = sepmc.load(folder / "c.toml")
    for settings, reason in (({"measurement": []}, "no measurement"), ({"dispersion": {}}, "disp")):
        with pytest.raises(InputError, match=reason):
            estimate(campaign.with_settings(settings))
    done = estimated(folder / "c.toml", "--cases", "50", "--out", folder / "few")
    assert done.exit_code == 2
    assert "cases = 50: must be" in done.output


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"column": "speed"}, "measurement.0.column = 'speed': no such column"),
        ({"sigma": 0.0}, "measurement.0.sigma = 0.0: must be > 0"),
        ({"delay_sigma_ms": -1.0}, "measurement.0.delay_sigma_ms"),
    ],
)
def test_wrong_measurements_are_named(folder, change, reason):
    with pytest.raises(SceneError, match=reason):
        sepmc.load(folder / "c.toml", {f"measurement.0.{k}": x for k, x in change.items()})


def test_one_file_has_one_clock(folder):
    text = SPRUNG + MEASURED + "delay_sigma_ms = 1.0" + MEASURED
    (folder / "two.toml").write_text(text)
    with pytest.raises(SceneError, match=r"measurement.1.delay_sigma_s = 0.0: must be 0.001 s"):
        sepmc.load(folder / "two.toml")


def test_measurements_change_no_row_and_are_shown_by_check(folder):
    campaign = sepmc.load(folder / "c.toml")
    assert campaign.with_settings({"measurement": []}).digest == campaign.digest
    done = CliRunner().invoke(app.main, ["check", str(folder / "c.toml"), "--no-flight"])
    assert done.exit_code == 0, done.output
    assert "separation_speed_m_s: flight.csv, sigma 0.01 m/s" in done.output
