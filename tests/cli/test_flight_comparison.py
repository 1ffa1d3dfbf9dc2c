"""`sepmc compare RUN --data`: a run and the telemetry of a flight."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted
from small_scenes import SPRUNG

import sepmc
from sepmc.campaign.execution.batch_histories import BatchHistories
from sepmc.cli import app

SHIFT = 41.75


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of twelve cases, and telemetry of case 7: a rate in rad/s with the other sign."""
    folder = tmp_path_factory.mktemp("flight")
    (folder / "c.toml").write_text(SPRUNG)
    with run_interpreted():
        result = sepmc.load(folder / "c.toml").run(out=folder / "run")
        history = result.campaign.simulate(result.case(7), 0.01)
    end = float(history["time_s"].iloc[-1])
    time = np.arange(-0.2, end + 0.3, 0.007)
    rng = np.random.default_rng(0)
    table = {"time_s": time + SHIFT}
    for column in ("separation_speed_m_s", "separation_distance_mm"):
        values = np.interp(np.clip(time, 0.0, end), history["time_s"], history[column])
        table[column] = values + 1e-4 * np.ptp(values) * rng.standard_normal(len(time))
    table["back_m_s"] = -table["separation_speed_m_s"]
    pd.DataFrame(table).to_csv(folder / "flight.csv", index=False)
    return folder / "run", folder / "flight.csv"


def compare(*arguments):
    with run_interpreted():
        return CliRunner().invoke(app.main, ["compare", *map(str, arguments)])


@pytest.mark.slow
def test_flight_of_a_case_is_that_case(run, tmp_path):
    folder, data = run
    done = compare(folder, "--data", data, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "out" / "telemetry.json").read_text())
    assert summary["nearest"][0]["case"] == 7
    error = summary["clock_shift_error_s"]
    assert 0.0 < error < 0.01
    assert abs(summary["clock_shift_s"] - SHIFT) < 4.0 * error
    assert f"sepmc replay {folder} --case 7" in " ".join(done.output.split())
    curves = pd.read_csv(tmp_path / "out" / "telemetry.csv")
    assert set(curves["channel"]) == {"separation_speed_m_s", "separation_distance_mm"}
    assert (tmp_path / "out" / "telemetry.png").stat().st_size > 10_000


@pytest.mark.slow
def test_run_folder_keeps_its_comparison_and_the_report_shows_it(run):
    folder, data = run
    arguments = (folder, "--data", data, "--map", "separation_speed_m_s=-back_m_s")
    done = compare(*arguments, "--shift", SHIFT, "--cases", 5)
    assert done.exit_code == 0, done.output
    summary = json.loads((folder / "telemetry.json").read_text())
    assert (summary["cases"], summary["clock_shift_s"]) == (5, SHIFT)
    assert not summary["clock_shift_is_estimated"]
    again = compare(*arguments)
    assert again.exit_code == 2
    assert "exists; add --overwrite" in again.output
    with run_interpreted():
        reported = CliRunner().invoke(app.main, ["report", str(folder), "--no-replay"])
    assert reported.exit_code == 0, reported.output
    assert "<h2>Flight</h2>" in (folder / "report.html").read_text()
    (folder / "telemetry.json").write_text("{}")  # changed by another program: not shown
    with run_interpreted():
        CliRunner().invoke(app.main, ["report", str(folder), "--no-replay"])
    assert "<h2>Flight</h2>" not in (folder / "report.html").read_text()


@pytest.mark.slow
def test_stored_separations_are_taken_as_they_are(run, tmp_path):
    folder, data = run
    with run_interpreted():
        campaign = sepmc.load(folder.parent / "c.toml", {"run.history_step_s": 0.01})
        campaign.run(out=tmp_path / "stored")
    done = compare(tmp_path / "stored", "--data", data, "--cases", 3)
    assert done.exit_code == 0, done.output
    assert "stored histories of 12 cases" in done.output
    summary = json.loads((tmp_path / "stored" / "telemetry.json").read_text())
    assert (summary["cases"], summary["nearest"][0]["case"]) == (12, 7)
    assert abs(summary["clock_shift_s"] - SHIFT) < 4.0 * summary["clock_shift_error_s"]


@pytest.mark.slow
def test_histories_of_cases_are_those_of_single_ones(run):
    folder, _ = run
    result = sepmc.open(folder)
    names, times = ["separation_speed_m_s", "upper_omega_z_deg_s"], np.linspace(0.0, 0.3, 31)
    names = [n for n in names if n in result.campaign.simulate(None, 0.1).columns]
    with run_interpreted():
        case = result.campaign.sample(3, 1, result.seed, result.total)
        nominal = result.campaign.layout.nominal[None, result.campaign.slots]
        histories = BatchHistories(result.campaign, names, times, [1e-9] * len(names), case)
        values = np.concatenate([histories.of_samples(nominal), histories(case)])
        for number, rows in zip([None, 3], values, strict=True):
            case = None if number is None else result.case(number)
            history = result.campaign.simulate(case, 0.01)
            for name, own in zip(names, rows, strict=True):
                expected = np.interp(times, history["time_s"], history[name])
                assert_allclose(own, expected, rtol=1e-6, atol=1e-6 * np.ptp(expected) + 1e-12)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((), "give RUN_B, or the telemetry of a flight"),
        (("--map", "a=b"), "give RUN_B, or the telemetry of a flight"),
        (("{run}", "--map", "a=b"), "--map needs --data"),
        (("{run}", "--shift", "300"), "--shift needs --data"),
        (("--data", "{data}", "--map", "a=b"), "no column a of histories"),
        (("--data", "{data}", "--map", "a"), "--map a: must be COLUMN=CHANNEL"),
        (("--data", "{data}", "--map", "a=b", "--map", "a=c"), "a second channel for a"),
        (("--data", "absent.csv"), "absent.csv: no such file"),
    ],
)
def test_wrong_requests_are_refused(run, tmp_path, arguments, reason):
    folder, data = run
    filled = [each.format(run=folder, data=data) for each in arguments]
    done = compare(folder, *filled, "--out", tmp_path)
    assert done.exit_code == 2
    assert reason in " ".join(done.output.split())


@pytest.mark.slow
def test_a_shift_that_slides_the_flight_off_the_run_is_noted(run, tmp_path):
    """Feet that are taken for metres, 3.28 times too large: the nearest shift is a wrong one."""
    folder, data = run
    arguments = ("--data", data, "--map", "separation_speed_m_s=3.28*separation_speed_m_s")
    done = compare(folder, *arguments, "--out", tmp_path / "wrong")
    assert done.exit_code == 0, done.output
    assert "check sign, factor and unit of the channels" in " ".join(done.output.split())
    assert json.loads((tmp_path / "wrong" / "telemetry.json").read_text())["left_out"] > 0.05
    right = compare(folder, "--data", data, "--out", tmp_path / "right")
    assert "check sign" not in right.output


@pytest.mark.slow
def test_python_compares_as_the_command_does(run, tmp_path):
    folder, data = run
    compare(folder, "--data", data, "--out", tmp_path, "--shift", SHIFT, "--cases", 4)
    result, told = sepmc.open(folder), []
    with run_interpreted():
        flight = result.compare_flight(data, shift_s=SHIFT, cases=4, announce=told.append)
    summary = json.loads((tmp_path / "telemetry.json").read_text())
    assert flight.to_dict() == summary
    curves = pd.read_csv(tmp_path / "telemetry.csv")
    pd.testing.assert_frame_equal(flight.curves, curves)
    assert any("4 of 12 ok cases" in each for each in told)
    assert "clock shift 41.75 s, nearest case" in repr(flight)
    assert sepmc.draw_flight(flight, tmp_path / "own.svg").stat().st_size > 10_000
    turned = {"separation_speed_m_s": "-back_m_s"}
    with run_interpreted():
        own = result.compare_flight(data, turned, shift_s=SHIFT, cases=4).channels
    assert_allclose(
        own.loc["separation_speed_m_s", "envelope_used"],
        flight.channels.loc["separation_speed_m_s", "envelope_used"],
    )


def test_a_suspicious_shift_warns_in_python(run, tmp_path):
    """Half a second of the flight is before the run at this shift."""
    folder, data = run
    result = sepmc.open(folder)
    with run_interpreted(), pytest.warns(sepmc.RunWarning, match="leaves .* outside the run"):
        flight = result.compare_flight(data, shift_s=SHIFT + 0.4, cases=2)
    assert flight.left_out > 0.05
    with pytest.raises(sepmc.InputError, match="no column a of histories"):
        result.compare_flight(data, {"a": "b"})
    with pytest.raises(sepmc.InputError, match="cases = 1"):
        result.compare_flight(data, cases=1)
    for wrong, reason in (
        ({"map": "a=b"}, "map = 'a=b': must be a dict"),
        ({"shift_s": "1"}, "shift_s = '1': must be a finite number"),
        ({"shift_s": float("nan")}, "shift_s = nan: must be a finite number"),
        ({"data": [1]}, "must be the path of a file"),
    ):
        with pytest.raises(sepmc.InputError, match=reason):
            result.compare_flight(**({"data": data} | wrong))
