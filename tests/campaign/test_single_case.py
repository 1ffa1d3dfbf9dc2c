"""One case by itself, flown by the kernel written for its scene in plain Python, with rows over
time."""

import re

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from oracles.independent import simulate
from small_scenes import scene

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import single_case
from sepmc.cli import app
from sepmc.engine import kernel_cache
from sepmc.scene.read import parse_campaign


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table1.toml", "table2.toml", "spring-pushers.toml", "stack"])
def test_formulations_agree(name):
    """Every column of every row, forces and moments at both ends of the joints among them, by the
    reduced and by the full system: 1e-8 of the largest of its unit. Rows at every instant and on
    both sides of the end of every phase."""
    campaign = sepmc.load(name) if name.endswith("toml") else scene(name)
    if campaign.scene.solver.step:
        solver = {
            key: value for key, value in campaign.file.tree["solver"].items() if key != "step_s"
        }
        campaign = campaign.with_settings({"solver": solver})
    every_s = campaign.scene.run.end_time / 40
    one, two = (
        campaign.with_settings({"solver.formulation": which}).simulate(step_s=every_s)
        for which in ("reduced", "full")
    )
    assert one.attrs["notes"] == two.attrs["notes"] == []
    assert one.attrs["status"] == two.attrs["status"] == "ok"
    assert list(one["phase"]) == list(two["phase"])
    assert set(one["phase"]) == {phase.name for phase in campaign.scene.phase}
    assert_allclose(one["time_s"], two["time_s"], rtol=0.0, atol=1e-9)
    grid = np.arange(41) * every_s
    assert np.abs(one["time_s"].to_numpy()[None, :] - grid[:, None]).min(axis=1).max() < 1e-9
    units = one.attrs["units"]
    for column in one.columns[2:]:
        size = max(
            np.abs(one[other]).max() for other in one.columns[2:] if units[other] == units[column]
        )
        assert_allclose(
            one[column], two[column], rtol=0.0, atol=1e-8 * max(size, 1e-6), err_msg=column
        )


@pytest.mark.parametrize(
    "solver", [{"step_s": 0.25}, {"step_s": 0.1}, {"accuracy": 1e-6}, {"accuracy": 1e-9}]
)
def test_the_error_of_a_case_is_told(solver):
    """No error of an outcome is larger than it is told to be. How long the phases of a case last is
    learnt at finer steps, if the one that is given is as long as a phase and tells nothing."""
    table1 = sepmc.load("table1.toml")
    columns = [column.name for column in table1.outcome_columns]
    result, right = (
        table1.with_settings({"solver": s}).simulate(step_s=0.5).attrs
        for s in (solver, {"step_s": 0.005})
    )
    assert result["status"] == right["status"] == "ok"
    reported = np.array([result["errors"][name] for name in columns])
    values, exact = (
        np.array([attrs["outcomes"][name] for name in columns]) for attrs in (result, right)
    )
    true = np.abs(values - exact) / np.maximum(np.abs(exact), 1e-3)
    assert (true <= reported + 1e-11).all()
    assert reported.max() <= solver.get("accuracy", 100.0 * true.max())


@pytest.mark.slow
def test_a_late_joint_is_late_in_the_next_phase():
    """Its force goes on, in the phase that has begun, until it lets go."""
    campaign = sepmc.load(
        "table2.toml", {"joint.pins.delay_ms": 5.0, "phase.guided.until": {"time_s": 0.4}}
    )
    frame = campaign.simulate(step_s=0.01)
    late = frame[(frame["phase"] == "free") & (frame["time_s"] < 0.405 - 1e-9)]
    assert len(late) >= 1
    assert (late["pins_force_on_lower_z_N"].abs() > 0.0).all()
    assert (frame.loc[frame["time_s"] > 0.405 + 1e-9, "pins_force_on_lower_z_N"] == 0.0).all()


LEAVES = {
    "environment": {
        "atmosphere": "table",
        "gravity": "none",
        "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]},
    },
    "phase": [{"name": "free"}],
    "initial": {"altitude_m": 1000.0, "speed_m_s": 100.0, "omega_deg_s": [0.0, 0.0, 40.0]},
    "body.aft.aerodynamics": {
        "reference_area_m2": 1.0,
        "reference_length_m": 0.5,
        "table": {"alpha_deg": [-5.0, 5.0], "pitch": [0.001, -0.001]},
    },
    "solver": {"accuracy": 1e-9},
}


@pytest.mark.slow
def test_a_case_that_fails(pair):
    """It has rows as far as it got: to where alpha, 2 deg to begin with, leaves its table."""
    result = pair(LEAVES).simulate(step_s=0.02)
    assert (
        result.attrs["status"]
        == simulate(pair(LEAVES).nominal().to_dict()).status
        == "outside-table"
    )
    assert np.isnan(result.attrs["outcomes"]["fore_omega_z_deg_s"])
    assert 3 < len(result) < 26
    alpha = result["aft_alpha_deg"].to_numpy()
    assert (np.abs(alpha) <= 5.0 + 1e-6).all()
    assert np.abs(alpha).max() > 4.0


@pytest.mark.slow
def test_a_case_that_is_never_released():
    result = sepmc.load("table2.toml", {"phase.guided.until.stroke_mm": 1e5}).simulate(step_s=0.1)
    assert result.attrs["status"] == "never-released"
    assert np.isfinite(result.attrs["outcomes"]["upper_omega_z_deg_s"])
    assert_allclose(result["time_s"].iloc[-1], 0.5)


def test_rows_on_both_sides_of_a_release_in_part(pair):
    """A fixed joint that becomes a slider within a phase, under a moment: it goes on holding that,
    and lets go of the force along x."""
    push = {"name": "push", "body": "aft", "force_N": [-6.0, 0.0, 0.0], "point_m": [3.0, 0.0, 0.0]}
    release = {"name": "cut", "joint": "pins", "when": {"time_s": 0.13}, "to": "slider"}
    result = pair({"load": [push], "release": [release]}).simulate(step_s=0.1)
    force = result["pins_force_on_aft_x_N"].to_numpy()
    at = np.flatnonzero(np.abs(result["time_s"] - 0.13) < 1e-9)
    assert len(at) == 2
    assert_allclose(force[: at[1]], 4.5, rtol=1e-9)  # of the 6 N, what moves the 3 kg of 4 kg
    assert_allclose(force[at[1] :], 0.0, atol=1e-12)


def test_a_number_that_may_not_be(pair):
    """A mass below zero, drawn: nothing is flown, and the note says why."""
    campaign = pair({"dispersion": {"body.aft.mass_kg": {"normal": 5.0}}})
    number = next(i for i in range(50) if campaign.case(i).scene.body["aft"].mass <= 0.0)
    result = campaign.simulate(campaign.case(number))
    assert (result.attrs["status"], len(result)) == ("invalid-input", 0)
    assert "body.aft.mass_kg" in result.attrs["notes"][0]


@pytest.mark.slow
def test_many_steps_are_compiled(pair, monkeypatch):
    """A body that turns once in 0.2 ms for a second: some 10^4 steps take plain Python too long; it
    is told."""
    heard = []
    # as if nothing had been compiled before
    monkeypatch.setattr(kernel_cache, "missing_units", lambda pieces: list(pieces.names))
    campaign = pair(
        {
            "phase": [{"name": "free"}],
            "initial.omega_deg_s": [1.8e6, 0.0, 0.0],
            "run.end_time_s": 1.0,
            "solver": {"accuracy": 1e-6},
        }
    )
    result = campaign.simulate(step_s=0.5, announce=heard.append)
    assert result.attrs["compiled"]
    assert any("compiling" in text for text in heard)
    assert any(re.fullmatch(r"compiled (\d+) of \1 units", text) for text in heard)
    assert_allclose(result.attrs["outcomes"]["fore_roll_deg"], 1.8e6, rtol=1e-6)


def test_nothing_is_compiled(tmp_path, monkeypatch):
    """`sepmc run table1.toml` with an empty cache."""
    monkeypatch.setattr(kernel_cache, "compile_missing", None)
    result = CliRunner().invoke(
        app.main,
        ["run", "table1.toml", "--out", str(tmp_path / "one"), "--every-s", "0.05", "--no-plots"],
    )
    assert result.exit_code == 0, result.output
    assert "as plain Python" in result.output


def test_a_long_flight_says_that_it_goes_on(pair, monkeypatch):
    """Now and then, with what it is at."""
    monkeypatch.setattr(single_case, "REPORT_EVERY_S", -1.0)
    calls = []
    pair({"solver": {"accuracy": 1e-9}}).simulate(announce=calls.append)
    assert calls[0] == "still running after 0 s, now in 2 steps a phase ..."
    assert len(calls) > 3


def test_a_load_that_ends_a_phase_at_once_beside_a_later_event():
    """The phase has no duration, so its typical one is 0 as well; the load is looked at all the
    same, and the case is that of the row."""
    tree = {
        "environment": {"atmosphere": "none", "gravity": "none"},
        "body": {
            "fore": {"mass_kg": 10.0, "inertia_kg_m2": [1.0, 2.0, 2.0], "cg_m": [1.0, 0.0, 0.0]},
            "aft": {"mass_kg": 20.0, "inertia_kg_m2": [2.0, 5.0, 5.0], "cg_m": [3.0, 0.0, 0.0]},
        },
        "joint": {"bolt": {"bodies": ["aft", "fore"], "point_m": [2.0, 0.0, 0.0]}},
        "motor": [{"name": "push", "body": "fore", "thrust_N": 1000.0, "station_m": 1.0}],
        "phase": [
            {
                "name": "held",
                "joints": {"bolt": "fixed"},
                "until": {
                    "any": [
                        {"joint": "bolt", "force_N": 100.0},
                        {"body": "aft", "altitude_m": 5.0},
                    ]
                },
            },
            {"name": "free"},
        ],
        "initial": {"altitude_m": 0.0, "speed_m_s": 100.0, "pitch_deg": 90.0},
        "run": {"end_time_s": 0.2, "cases": 2},
    }
    campaign = Campaign(parse_campaign(tree, "at once"))
    history = campaign.simulate(None)
    assert history.attrs["status"] == "ok"
    table = campaign.run(cases=1).table
    assert table["status"][0] == "ok"
    for name in ("release_time_s", "separation_speed_m_s", "fore_pitch_deg"):
        assert history.attrs["outcomes"][name] == pytest.approx(table[name][0], abs=1e-9)
    assert history.attrs["outcomes"]["release_time_s"] == 0.0
