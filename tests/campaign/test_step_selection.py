"""Selection of steps, and the error that a run reports."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

import sepmc
from sepmc.campaign import cases
from sepmc.campaign.execution import chunk, common_steps, step_search, step_selection
from sepmc.campaign.execution.accuracy import scene_scales
from sepmc.cli import app
from sepmc.schema import Status

NAN = np.nan


# -- how a campaign is flown
# --------------------------------------------------------------------------------------------------


def test_a_given_step_is_taken(table2):
    """No step is longer."""
    flight = step_selection.select_steps(table2.with_settings({"solver.step_s": 0.0123}))
    assert (flight.step, flight.steps.tolist()) == (0.0123, [1, 1, 1])
    assert (flight.refined().step, flight.refined().steps.tolist()) == (0.00615, [2, 2, 2])


def test_a_case_that_is_never_released_settles_too(table2):
    """Its outcomes are numbers as any other's: a single run must not be cut into the most steps
    there are."""
    history = table2.with_settings({"run.end_time_s": 0.2}).simulate(step_s=0.1)
    assert history.attrs["status"] == "never-released"
    assert history.attrs["outcomes"]["steps"] <= 1000


@pytest.mark.parametrize("accuracy", [1e-4, 1e-9])
def test_the_pilot_keeps_within_its_share(table2, accuracy):
    """Half of the accuracy, over its own cases; the steps it chose are the fewest: one less in any
    phase is too few."""
    campaign = table2.with_settings({"run.history_step_s": 0.0, "solver.accuracy": accuracy})
    flight = step_selection.select_steps(campaign)
    assert flight.error <= 0.5 * accuracy
    assert_allclose(flight.durations.sum(), campaign.scene.run.end_time, rtol=1e-9)
    assert flight.durations[0] == pytest.approx(0.05, rel=1e-9)
    again = step_selection.select_steps(campaign.with_settings({"run.seed": 8}))
    assert_array_equal(again.steps, flight.steps)
    assert again.error == flight.error


def test_errors_are_shares_of_what_statistics_are_of():
    """Cases that are never released have outcomes and are in no statistics: their outcomes, apart
    from all others, would make sigma larger than the one that is told."""
    ok, never, other = Status.OK, Status.NEVER_RELEASED, Status.UNRESOLVED
    block = SimpleNamespace(
        status=np.array([ok, never, ok, other, ok]),
        outcomes=np.array([[1.0], [50.0], [1.2], [NAN], [1.4]]),
        has_outcomes=np.array([True, True, True, False, True]),
        has_indicators=np.array([True, True, True, True, False]),
    )
    assert_array_equal(common_steps._completed(block, None), [[1.0], [1.2]])
    assert_array_equal(common_steps._completed(block, 0.1), [[1.0], [1.2], [1.4]])
    block.status[:] = [never, never, other, other, never]
    assert_array_equal(common_steps._completed(block, None), [[1.0], [50.0]])


# -- what a run tells
# --------------------------------------------------------------------------------------------------


def told(folder, name):
    return json.loads((folder / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({}, id="reduced"),
        pytest.param({"solver.formulation": "full"}, id="full", marks=pytest.mark.slow),
        pytest.param({"solver.step_s": 0.02}, id="step"),
    ],
)
def test_a_run_tells_its_error(table2, settings, tmp_path):
    """In the result, the manifest and the statistics: what was asked for, what was achieved over
    trial cases, by outcome."""
    campaign = table2.with_settings({"run.history_step_s": 0.0} | settings)
    result = campaign.run(cases=80, out=tmp_path / "run")
    achieved, written = result.accuracy, told(tmp_path / "run", "manifest.json")["accuracy"]
    assert (achieved.asked, achieved.cases) == (
        1e-9,
        step_selection.CORNERS + 1 + step_selection.SAMPLE,
    )
    assert set(achieved.errors) == set(result.outcomes)
    name, worst = achieved.worst
    assert (
        worst
        == max(error for key, error in achieved.errors.items() if key not in achieved.positions)
        == achieved.errors[name]
    )
    assert achieved.positions == {
        key for key in result.outcomes if "peak" in key and key.endswith("time_s")
    }
    assert written.get("places", []) == sorted(achieved.positions)
    formulation = campaign.scene.solver.formulation
    assert (written["formulation"], written["method"]) == (formulation, "auto")
    assert len(written["methods"]) == len(campaign.scene.phase)
    assert set(written["methods"]) <= {"sharp9", "tp7"}
    assert (written["achieved"], written["worst_outcome"], written["cases"]) == (
        worst,
        name,
        achieved.cases,
    )
    given = campaign.scene.solver.step is not None
    assert ("asked" in written) is not given
    assert given or (written["asked"], written["met"]) == (1e-9, worst <= 1e-9)
    assert written["errors"] == achieved.errors
    if not given:
        assert written["steps"] == result.integration.steps.tolist()
        assert worst <= 1e-9
    else:
        assert written["step_s"] == result.integration.step
    printed = (
        CliRunner()
        .invoke(app.main, ["stats", str(tmp_path / "run")], catch_exceptions=False)
        .stdout
    )
    assert f"numerical error <= {worst:.1e} ({name})" in printed
    assert ("; full system, " in printed) is (formulation == "full")
    assert all(name in printed for name in written["methods"])
    table = pd.read_csv(tmp_path / "run" / "statistics.csv", index_col="outcome")
    assert_allclose(table["error"], [achieved.errors[name] for name in table.index], rtol=1e-9)


# Laws of table2 that trial cases might miss: the same parameters vary, so that the same kernel
# flies them.
HARD = {
    "shipped": {},
    "coarse": {"solver.accuracy": 1e-4},
    "angles all round": {
        "dispersion.motor.retro.deflection_deg": {"uniform": [0.0, 20.0]},
        "environment.wind.speed_m_s": 300.0,
    },
    "a rare value": {
        "dispersion.body.lower.mass_kg": {"discrete": [587.0, 60.0], "weights": [0.999, 0.001]}
    },
    "a fast spin": {
        "dispersion.initial.omega_deg_s.x": {"discrete": [0.0, 3000.0], "weights": [0.95, 0.05]},
        "solver.accuracy": 1e-5,
    },
    "leaves its layer of air": {"initial.altitude_m": 70500.0, "initial.pitch_deg": 20.0},
}


def true_error(campaign, flight, count):
    """Largest error of the first cases of a campaign, and what is told of those that were flown
    again."""
    drawn = (
        cases.sample(campaign.file.dispersions, campaign.scene.run.seed, 0, count)
        * campaign.factors
    )
    exact = campaign.with_settings({"solver.accuracy": 1e-11})
    n, columns = len(campaign.outcome_columns), campaign.outcome_columns
    here = step_selection.integrate(campaign, flight, drawn)
    fine = step_selection.integrate(exact, flight.refined().refined().refined(), drawn)
    ok = (here.status == Status.OK) & (fine.status == Status.OK)
    scale = scene_scales(campaign.scene, [c.unit for c in columns])
    return step_selection.relative_error(
        here.outcomes[ok, :n], fine.outcomes[ok, :n], [c.unit for c in columns], scale
    ).max(), here.refinement


@pytest.mark.parametrize("name", HARD)
def test_the_error_told_is_the_error_there_is(table2, name):
    """2,000 cases against eight times the steps: never below a third of the true one, nor met when
    it is not."""
    campaign = table2.with_settings({"run.history_step_s": 0.0} | HARD[name])
    result = campaign.run(cases=2000)
    error, again = true_error(campaign, result.integration, 2000)
    told = result.accuracy.worst[1]
    print(f"{name}: told {told:.1e}, true {error:.1e}, steps {result.integration.steps}, {again}")
    assert told >= error / 3.0
    assert not result.accuracy.met or error <= result.accuracy.asked
    assert result.accuracy.met
    seldom = [note for note in result.notes if "occurred in" in note]
    assert (len(seldom), result.notes) == (int(name == "a rare value"), seldom)
    assert again.n_fallback == again.n_unconverged == 0
    if "spin" in name:
        assert again.n_refined > 50


def test_what_trial_cases_tell_does_not_depend_on_seed_or_cases(table2):
    campaign = table2.with_settings({"run.history_step_s": 0.0})
    one, two = campaign.run(cases=5), campaign.run(cases=700, seed=3)
    assert one.integration.achieved == two.integration.achieved
    for result in (one, two):
        told = result.accuracy.errors
        assert all(told[name] >= error for name, error in one.integration.achieved.errors.items())
        assert result.accuracy.worst[1] >= result.to_pandas()["error"].max()


def test_the_error_of_failed_cases_does_not_count(table2):
    """Trial cases some of which are invalid or never released: the others are compared."""
    campaign = table2.with_settings(
        {"run.history_step_s": 0.0, "dispersion.body.upper.mass_kg": {"normal": 250.0}}
    )
    result = campaign.run(cases=64)
    failed = 64 - result.status_counts[Status.OK.label]
    assert 0 < failed < 30
    assert 0.7 * step_selection.SAMPLE < result.accuracy.cases < step_selection.SAMPLE
    assert np.isfinite(result.accuracy.worst[1])


@pytest.mark.slow
def test_outcomes_of_round_off_alone(table2):
    """A joint that stays shut: its separation is zero but for round-off, and the pilot is not put
    off by that."""
    shut = {"run.history_step_s": 0.0, "phase": [{"name": "locked", "joints": {"pins": "fixed"}}]}
    result = table2.with_settings(shut).run(cases=20)
    assert result.accuracy.met
    assert result.accuracy.errors["separation_distance_mm"] <= 1e-10
    assert np.abs(result.table["separation_distance_mm"]).max() <= 1e-9


def test_the_program_tells_it(tmp_path):
    """The line after a campaign, and what `check` says of a scene's kernel."""
    arguments = [
        "campaign",
        "table2.toml",
        "--cases",
        "10",
        "--no-plots",
        "--out",
        str(tmp_path / "run"),
    ]
    called = CliRunner().invoke(app.main, arguments, catch_exceptions=False)
    assert called.exit_code == 0, called.output
    assert "numerical error <= " in called.output
    assert "requested 1e-09" in called.output
    checked = CliRunner().invoke(app.main, ["check", "table2.toml"], catch_exceptions=False).stdout
    assert "1e-09" in checked
    code = (
        CliRunner()
        .invoke(app.main, ["check", "table2.toml", "--code"], catch_exceptions=False)
        .stdout
    )
    assert "# body1 upper, body2 lower" in code
    assert "def rates_phase2(w):" in code
    full = ["check", "table2.toml", "--code", "--set", "solver.formulation=full"]
    assert "linear.eliminate" in CliRunner().invoke(app.main, full, catch_exceptions=False).stdout


def test_sepmc_load_is_not_slowed(table2):
    """Planning compiles; reading and checking a campaign must not."""
    campaign = sepmc.load("table2")
    assert "layout" not in campaign.__dict__
    assert campaign.digest == table2.digest


def test_nothing_is_flown_after_an_interrupt(table2, tmp_path, monkeypatch):
    """The error is known before the flight: leaving a run flies no case more, and what is left
    behind tells it."""
    calls = []
    monkeypatch.setattr(
        chunk,
        "integrate",
        lambda *given, **named: calls.append("flown") or step_selection.integrate(*given, **named),
    )

    def stop(done, total, failures):
        if done:
            calls.append("stopped")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        table2.run(cases=2000, out=tmp_path / "run", progress=stop)
    assert calls == ["flown", "stopped"]
    written = told(tmp_path / "run", "manifest.json")
    assert written["complete"] is False
    assert 0.0 < written["accuracy"]["achieved"] <= 1e-9
    resumed = table2.run(cases=2000, out=tmp_path / "run", resume=True)
    assert all(
        error >= written["accuracy"]["errors"][name]
        for name, error in resumed.accuracy.errors.items()
    )
    assert resumed.accuracy.met


@pytest.mark.parametrize("settings", [{}, {"run.history_step_s": 0.1}], ids=["rows", "histories"])
def test_where_no_steps_suit_most_trial_cases(table2, monkeypatch, settings):
    """Every case then finds its own: the same rows, to the accuracy asked, and its error is
    told."""
    campaign = table2.with_settings({"run.history_step_s": 0.0, "solver.accuracy": 1e-7} | settings)
    expected = campaign.run(cases=60)
    monkeypatch.setattr(step_selection, "common_steps", lambda *given: None)
    result = campaign.run(cases=60)
    assert result.notes == []
    assert result.accuracy.met
    assert result.accuracy.cases > 50
    n, columns = 60, campaign.outcome_columns
    one, two = (
        np.column_stack([of.table[c.name] / c.scale for c in columns])[:n]
        for of in (result, expected)
    )
    scale = scene_scales(campaign.scene, [c.unit for c in columns])
    assert step_selection.relative_error(one, two, [c.unit for c in columns], scale).max() <= 1e-7


def test_the_finest_affordable_steps_if_none_will_do(table2, monkeypatch, tmp_path):
    """No number of steps below the most allowed meets the goal: as many as bring the cases to what
    the reference settles to, and said, on the command line by its exit code too."""
    monkeypatch.setattr(step_search, "_MAX_STEPS", 16)
    settings = {"run.history_step_s": 0.0, "solver.accuracy": 1e-12, "solver.method": "dopri5"}
    result = table2.with_settings(settings).run(cases=20)
    coarse = table2.with_settings(settings | {"solver.accuracy": 1e-3}).run(cases=20)
    assert (result.integration.steps >= coarse.integration.steps).all()
    assert result.integration.steps.sum() > 1.3 * coarse.integration.steps.sum()
    assert not result.accuracy.met
    assert result.accuracy.worst[1] > 1e-12
    (note,) = result.notes
    name, error = result.accuracy.worst
    for part in ("accuracy 1e-12", f"{error:.1e}", name, "solver.accuracy"):
        assert part in note
    arguments = ["campaign", "table2.toml", "--cases", "20", "--no-plots", "--out", tmp_path / "a"]
    for path, value in settings.items():
        arguments += ["--set", f"{path}={value}"]
    called = CliRunner().invoke(app.main, list(map(str, arguments)), catch_exceptions=False)
    again = CliRunner().invoke(app.main, ["stats", str(tmp_path / "a")], catch_exceptions=False)
    for one in (called, again):
        assert one.exit_code == 3
        assert "accuracy was not met" in one.stderr


@pytest.mark.parametrize(("corners", "sample"), [(0, 0), (1, 1), (3, 4)])
@pytest.mark.parametrize("settings", [{}, {"solver.step_s": 0.05}], ids=["fast", "step"])
def test_fewer_trial_cases(table2, monkeypatch, corners, sample, settings):
    """Both numbers are read when they are needed, and may be small: for flights that are
    interpreted."""
    monkeypatch.setattr(step_selection, "CORNERS", corners)
    monkeypatch.setattr(step_selection, "SAMPLE", sample)
    law = {"dispersion.body.upper.mass_kg": {"discrete": [450.0, 460.0]}, "run.history_step_s": 0.0}
    flight = step_selection.select_steps(table2.with_settings(law | settings))
    assert flight.achieved.cases == max(corners, 6) + 1 + sample


def test_repr_is_one_line():
    """It names the method and the number of steps of each segment, and no arrays."""
    integration = step_selection.select_steps(sepmc.load("table2"))
    shown = repr(integration)
    assert len(shown) < 200
    for stage, steps, method in zip(
        integration.stages, integration.steps, integration.method_names, strict=True
    ):
        assert f"{stage}: {steps} x {method}" in shown
    assert "array" not in shown
