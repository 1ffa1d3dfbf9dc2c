"""How a campaign is flown, and how large its error is: corners, relative errors, the pilot's steps,
what a run tells of them."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal
from oracles.independent import simulate

import sepmc
from sepmc.campaign import cases
from sepmc.campaign.execution import chunk, common_steps, step_search, step_selection
from sepmc.campaign.execution.accuracy import SAFETY, achieved, decisive, errors, scene_scales
from sepmc.campaign.execution.diagnostics import accuracy_notes
from sepmc.campaign.execution.integration import Integration, _is_calibrated
from sepmc.cli import app
from sepmc.engine.dispatch import Block
from sepmc.schema import Status

INF, NAN = np.inf, np.nan


def error(result, reference, units=None):
    """`relative_error` of plain rows."""
    result, reference = (
        np.atleast_2d(np.array(result, dtype=float)),
        np.atleast_2d(np.array(reference, dtype=float)),
    )
    return step_selection.relative_error(result, reference, units or ["m"] * reference.shape[1])


# -- corners
# --------------------------------------------------------------------------------------------------


def test_corners_do_not_depend_on_the_seed(table2):
    """Nor on how many cases there are: how a campaign is flown is a matter of its scene and
    laws."""
    base = step_selection.corner_cases(table2)
    assert base.shape == (step_selection.CORNERS + 1, len(table2.file.dispersions))
    assert_array_equal(
        step_selection.corner_cases(table2.with_settings({"run.seed": 1, "run.cases": 5})), base
    )


def test_corners_are_the_nominal_and_the_edges(table2):
    """The middle of every law first; then of each parameter a thousandth of the probability from
    either end, both ends often."""
    result = step_selection.corner_cases(table2) / table2.factors
    middle = [cases.quantile(d, np.array([0.5]))[0] for d in table2.file.dispersions]
    assert_allclose(result[0], middle, rtol=1e-12, atol=1e-12)
    for values, law in zip(result[1:].T, table2.file.dispersions, strict=True):
        if law.numbers == (0.0, 360.0):
            continue
        low, high = cases.quantile(law, np.array([0.001, 0.999]))
        assert_allclose(
            np.unique(np.round((values - low) / (high - low), 9)), [0.0, 1.0], atol=1e-9
        )
        assert 4 <= np.sum(values > 0.5 * (low + high)) <= step_selection.CORNERS - 4
    assert len(np.unique(result[1:] > result[0], axis=0)) == step_selection.CORNERS


@pytest.mark.parametrize(
    ("law", "wide"),
    [
        ({"uniform": [0.0, 360.0]}, True),
        ({"uniform": [-60.0, 60.0]}, True),
        ({"normal": [0.0, 40.0]}, True),
        ({"uniform": 40.0}, False),
    ],
)
def test_corners_of_an_angle_all_round(table2, law, wide):
    """Both ends of a full turn are one direction: angles that spread over more than 90 deg are
    spaced over all of it."""
    result = np.sort(
        step_selection.corner_cases(
            table2.with_settings({"dispersion": {"environment.wind.direction_deg": law}})
        )[1:, 0]
    )
    if not wide:
        assert len(np.unique(result)) == 2
        return
    assert len(np.unique(result)) == step_selection.CORNERS
    assert np.diff(result).max() <= 0.25 * (result[-1] - result[0])
    if law == {"uniform": [0.0, 360.0]}:
        assert_allclose(np.degrees(result), 7.5 + 15.0 * np.arange(24))


def test_corners_have_every_value_of_a_discrete_law(table2):
    """However rare, each at least three times; there are more corners if there are many values. A
    weight of 0 is never drawn."""
    values = [440.0 + i for i in range(12)]
    weights = [1.0] * 10 + [1e-12, 0.0]
    laws = {
        "body.upper.mass_kg": {"discrete": values, "weights": weights},
        "body.lower.mass_kg": {"uniform": 25.0},
    }
    campaign = table2.with_settings({"dispersion": laws})
    result = step_selection.corner_cases(campaign)
    assert len(result) == 3 * 11 + 1
    assert [np.count_nonzero(result[1:, 0] == value) for value in values] == [3] * 11 + [0]
    drawn = step_selection.calibration_sample(campaign, 40)
    assert set(drawn[:, 0]) == set(values[:-1])
    assert set(drawn[:20, 0]) <= set(values[:10])


def test_the_sample_covers_every_law(table2):
    """A Latin hypercube in each half: one case in every share of the probability of each parameter;
    not of the seed."""
    result = step_selection.calibration_sample(table2, 32)
    assert_array_equal(
        result, step_selection.calibration_sample(table2.with_settings({"run.seed": 5}), 32)
    )
    for values, law, factor in zip(result.T, table2.file.dispersions, table2.factors, strict=True):
        low, high = law.numbers
        for half in (values[:16], values[16:]):
            assert_array_equal(
                np.sort(((half / factor - low) / (high - low) * 16.0).astype(int)), np.arange(16)
            )


def test_corners_without_dispersion(table2):
    assert step_selection.corner_cases(table2.with_settings({"dispersion": {}})).shape == (
        step_selection.CORNERS + 1,
        0,
    )


@pytest.mark.parametrize(
    "law",
    [
        {"normal": 5.0},
        {"triangular": [440.0, 458.0, 480.0]},
        {"discrete": [450.0, 460.0]},
        {"constant": 458.0},
    ],
)
def test_corners_of_every_law(table2, law):
    """Finite: tails are cut at a thousandth, a discrete law gives its own values."""
    campaign = table2.with_settings({"dispersion": {"body.upper.mass_kg": law}})
    result = step_selection.corner_cases(campaign)
    assert np.isfinite(result).all()
    assert np.all((result > 400.0) & (result < 500.0))
    if "discrete" in law:
        assert set(result[1:, 0]) == {450.0, 460.0}


# -- relative errors
# --------------------------------------------------------------------------------------------------


def test_error_is_over_size():
    """Alone, so without scatter: the difference over the reference."""
    assert_allclose(error([2.02, -3.0], [2.0, -3.03]), [0.01, 0.03 / 3.03])


def test_error_is_over_scatter_if_that_is_larger():
    """Numbers about zero: a case that happens to lie near zero does not count as wrong."""
    reference = np.array([[-1.0], [1e-9], [1.0]])
    spread = np.std(reference)
    assert_allclose(error(reference + np.array([[0.0], [0.01], [0.0]]), reference), 0.01 / spread)
    offset = reference + 100.0  # then size counts
    assert_allclose(error(offset + np.array([[0.0], [0.01], [0.0]]), offset), 1e-4, rtol=1e-6)


def test_error_of_what_cancels():
    """Zero but for round-off: measured against a ten-thousandth of the largest of the same unit,
    and only of the same."""
    reference, results = [[5.0, 1e-16, 1e-16]], [[5.0, 2e-16, 2e-16]]
    assert_allclose(
        error(results, reference, ["m", "m", "rad"]), [0.0, 1e-16 / 5e-4, 1.0], rtol=1e-9
    )


def test_error_of_nan():
    """At the same place it agrees; at one only, nothing is worse. It does not enter the scatter as
    a number."""
    assert_array_equal(error([[NAN, 1.0], [2.0, 1.0]], [[NAN, 1.0], [2.0, 1.0]]), [0.0, 0.0])
    assert_array_equal(error([[NAN, 1.0]], [[2.0, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[2.0, 1.0]], [[NAN, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[INF]], [[1.0]]), [INF])


def test_error_of_zero():
    """Equal zeros agree although there is nothing to divide by; a number where the reference is
    nothing but zero is infinitely wrong."""
    assert_array_equal(error([[0.0, 0.0]], [[0.0, 0.0]]), [0.0, 0.0])
    assert_array_equal(error([[1e-30]], [[0.0]]), [INF])


def test_error_of_no_cases():
    assert_array_equal(
        step_selection.relative_error(np.empty((0, 3)), np.empty((0, 3)), ["m"] * 3), [0.0] * 3
    )


def test_error_does_not_change_what_it_is_given():
    result, reference = np.array([[1.0, NAN]]), np.array([[1.0, NAN]])
    step_selection.relative_error(result, reference, ["m", "m"])
    assert_array_equal(result, reference)


# -- how a campaign is flown
# --------------------------------------------------------------------------------------------------


def test_bodies_that_turn_far_in_a_step():
    """In the eight steps that first tell how far outcomes spread no case can be vouched for: then
    more steps tell it."""
    campaign = sepmc.load("nasa-fixed-joint", {"run.history_step_s": 0.0})
    flight = step_selection.select_steps(campaign)
    names = [column.name for column in campaign.outcome_columns]
    draws = cases.sample(campaign.file.dispersions, 3, 0, 100) * campaign.factors
    rate = names.index("A_omega_z_deg_s")
    spread = step_selection.integrate(campaign, flight, draws).outcomes[:, rate].std()
    assert 0.5 * spread <= flight.scale[rate] <= 2.0 * spread
    assert flight.achieved.met


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
    [{}, {"solver.formulation": "full"}, {"solver.step_s": 0.02}],
    ids=["reduced", "full", "step"],
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


def test_the_end_of_a_long_tail_is_flown_at_finer_steps(pair):
    """Rates of a normal law that is not cut, in 20,000 cases: those at 4 sigma would err by more
    than any trial case."""
    settings = {
        "phase": [
            {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.5}},
            {"name": "free"},
        ],
        "run.end_time_s": 5.0,
        "solver": {"accuracy": 1e-9},
        "dispersion": {"initial.omega_deg_s.z": {"normal": 30.0}},
    }
    result = pair(settings).run(cases=20_000, seed=1)
    table = result.to_pandas()
    # the bodies turn as one until 0.5 s and go on evenly: 5 s at the rate of the start
    exact = 5.0 * table["in_initial_omega_z_deg_s"]
    off = (table["fore_pitch_deg"] - exact).abs() / np.maximum(
        exact.abs(), table["fore_pitch_deg"].std()
    )
    assert off.max() <= result.accuracy.errors["fore_pitch_deg"]
    assert result.accuracy.met


REEL = {
    "environment": {"atmosphere": "none", "gravity": "constant"},
    "body.fore": {"mass_kg": 300.0, "inertia_kg_m2": [60.0, 200.0, 200.0], "cg_m": [1.0, 0.0, 0.0]},
    "body.aft": {"mass_kg": 100.0, "inertia_kg_m2": [20.0, 80.0, 80.0], "cg_m": [3.0, 0.0, 0.0]},
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.05}},
        {"name": "free"},
    ],
    "motor": [{"name": "retro", "body": "aft", "thrust_N": 2000.0, "station_m": 4.0}],
    "spring": [
        {
            "name": "reel",
            "bodies": ["fore", "aft"],
            "point_m": [3.0, 0.0, 0.0],
            "second_point_m": [2.75, 0.0, 0.0],
            "force_N": -300.0,
        }
    ],
    "initial": {"altitude_m": 60000.0, "speed_m_s": 1000.0},
    "run.end_time_s": 0.4,
    "solver": {"accuracy": 1e-9},
    "dispersion": {"spring.reel.point_m.y": {"uniform": [-1.4, 2.6]}},
}


@pytest.mark.parametrize("settings", [{}, {"solver.step_s": 5e-4}], ids=["settled", "given"])
@pytest.mark.slow
def test_a_case_closer_to_a_singular_place_than_any_trial(pair, settings):
    """A spring of constant force along a line that shrinks to nothing in one case of a thousand:
    such are seen and settled, or told."""
    campaign = pair(REEL | settings)
    flight = step_selection.select_steps(campaign)
    places = np.array([[-6.1e-5], [1.5e-3], [0.5]])
    block, names = (
        step_selection.integrate(campaign, flight, places),
        [column.name for column in campaign.outcome_columns],
    )
    once = step_selection.integrate(
        campaign, replace(flight, limits=None, error_limit=np.inf), places
    )
    expected = [
        simulate(pair(REEL | {"spring.reel.point_m": [3.0, float(y), 0.0]}).nominal().to_dict())
        for (y,) in places
    ]
    right = np.array([[one.outcomes.get(name, 0.0) / column.scale for name, column in zip(names,
    campaign.outcome_columns, strict=True)]
                      for one in expected])  # fmt: skip
    judged = np.array(
        [
            names.index(name)
            for name in ("fore_omega_z_deg_s", "separation_speed_m_s", "aft_pitch_deg")
        ]
    )
    before, now = (
        errors(flown.outcomes[:, judged], right[:, judged], flight.scale[judged]).max(axis=1)
        for flown in (once, block)
    )
    told = max(
        SAFETY * flight.error, block.refinement.error[decisive(campaign.outcome_columns)].max()
    )
    assert block.refinement.n_refined == 2
    assert before[0] > 50.0 * SAFETY * flight.error
    assert now.max() <= told
    assert "solver.step_s" in settings or told <= campaign.scene.solver.accuracy


# a spring pushes two bodies apart and pulls them back, unless they come as far as its stroke
SHOT = {
    "phase": [{"name": "free"}],
    "spring": [
        {
            "name": "push",
            "bodies": ["fore", "aft"],
            "point_m": [2.0, 0.0, 0.0],
            "axis": [-1.0, 0.0, 0.0],
        }
        | {"force_N": 30.0, "stiffness_N_per_m": 75.0, "stroke_m": 0.93}
    ],
    "run.end_time_s": 0.38,
    "solver": {"accuracy": 1e-7},
    "dispersion": {
        "spring.push.force_N": {"normal": 2.0, "truncate_sigma": 4},
        "spring.push.stiffness_N_per_m": {"uniform": 7.5},
    },
}


def shot(force, stiffness, stroke, time):
    """Speed and distance in closed form: a harmonic motion about F / k, until 2 F / k >= stroke
    ends it."""
    rate, reach = np.sqrt(stiffness / 0.75), force / stiffness
    end = np.minimum(
        time,
        np.where(
            2.0 * reach >= stroke,
            np.arccos(np.clip(1.0 - stroke / reach, -1.0, 1.0)) / rate,
            np.inf,
        ),
    )
    speed = reach * rate * np.sin(rate * end)
    return speed, reach * (1.0 - np.cos(rate * end)) + speed * (time - end)


@pytest.mark.parametrize("settings", [{}, {"solver.accuracy": 1e-4}], ids=["fine", "coarse"])
def test_a_stroke_that_is_only_just_reached(pair, settings):
    """With 1e-5 ... 1e-2 to spare or to miss: a long step may jump over such a stroke."""
    campaign = pair(SHOT | settings)
    flight = step_selection.select_steps(campaign)
    stroke, beyond = campaign.scene.spring[0].stroke, np.geomspace(1e-5, 1e-2, 40)
    stiffness = 75.0 + 5.0 * np.sin(np.arange(80))
    force = 0.5 * stroke * stiffness * (1.0 + np.concatenate([beyond, -beyond]))
    places = np.array(
        [
            [
                ("force" in law.parameter.path, "stiffness" in law.parameter.path)
                for law in campaign.file.dispersions
            ]
        ]
    )
    draws = np.where(places[0, :, 0], force[:, None], stiffness[:, None])
    block, names = (
        step_selection.integrate(campaign, flight, draws),
        [column.name for column in campaign.outcome_columns],
    )
    speed, distance = shot(force, stiffness, stroke, campaign.scene.run.end_time)
    assert (block.status == Status.OK).all()
    for name, right in (("separation_speed_m_s", speed), ("separation_distance_mm", distance)):
        k = names.index(name)
        result = errors(block.outcomes[:, [k]], right[:, None], flight.scale[[k]])[:, 0]
        # a row's own error is known to a factor of 3
        assert (result <= np.maximum(3.0 * block.error, 1e-12)).all()
        if not settings:
            of_cases = flight.estimate.largest(block.refinement.error, block.refinement.indicators)
            told = max(flight.achieved.errors[name], of_cases[k])
            assert result.max() <= max(told, 1e-12)


def test_a_trial_case_that_would_be_flown_again_tells_no_error():
    """One that grazes a stroke within a long step was told as an error of 0.2, though no row keeps
    what such a step gives."""
    campaign = sepmc.load(str(Path(__file__).parents[1] / "data" / "grazing.toml"))
    accuracy = step_selection.select_steps(campaign).achieved
    assert accuracy.met, accuracy.worst


def test_a_flow_almost_from_the_side(pair):
    """Alpha turns about where sideslip is 90 deg, and an error of the attitude with it: 57 times
    what trial cases told."""
    campaign = pair(
        {
            "environment": {
                "atmosphere": "none",
                "gravity": "none",
                "wind": {"speed_m_s": 60.0, "direction_deg": 90.0},
            },
            "body.fore.inertia_kg_m2": [30.0, 80.0, 100.0],
            "phase": [{"name": "free"}],
            "initial": {"altitude_m": 1e4, "speed_m_s": 60.0, "omega_deg_s": [100.0, 15.0, 20.0]},
            "run.end_time_s": 2.0,
            "solver": {"accuracy": 1e-6},
            "dispersion": {
                "initial.alpha_deg": {"uniform": 70.0},
                "initial.path_yaw_deg": {"uniform": 60.0},
                "environment.wind.direction_deg": {"uniform": [0.0, 360.0]},
            },
        }
    )
    result = campaign.run(cases=200_000)
    rows = result.to_pandas()
    worst = int(rows["fore_beta_deg"].abs().argmax())
    right = simulate(result.case(worst).to_dict()).outcomes["fore_alpha_deg"]
    assert abs(rows["fore_beta_deg"][worst]) > 89.8
    assert abs(rows["fore_alpha_deg"][worst] - right) <= result.accuracy.errors[
        "fore_alpha_deg"
    ] * abs(right)


def test_an_angle_that_does_not_exist_is_no_reason_to_fly_again():
    """Sideslip of still air; one beyond what trial cases had is."""
    usual = Integration(None, np.ones(1), np.ones(1), limits=np.ones(1), angles={0: 0.5})
    result = np.array([[0.4], [0.6], [NAN]])
    block = Block(result, *np.zeros((5, 3)), indicators=np.zeros((3, 1)))
    assert_array_equal(_is_calibrated(usual, block), [True, False, True])


def test_histories_have_an_error_of_their_own(pair):
    """Between the ends of steps the motion is interpolated; against the closed form."""
    campaign = pair(
        SHOT | {"run.history_step_s": 0.007, "spring.push.stroke_m": 0.85, "solver.accuracy": 1e-7}
    )
    result = campaign.run(cases=300)
    rows, histories = result.to_pandas(), result.histories()
    force, stiffness = (
        rows[f"in_spring_push_{name}"].to_numpy()[histories["case"]]
        for name in ("force_N", "stiffness_N_per_m")
    )
    speed, _ = shot(force, stiffness, 0.85, histories["time_s"].to_numpy())
    off = np.abs(histories["separation_speed_m_s"] - speed) / np.maximum(
        np.abs(speed), rows["separation_speed_m_s"].std()
    )
    assert off.max() <= result.accuracy.history < 1e-4


def test_the_error_of_histories_is_that_of_the_middle_of_a_law_too():
    """Tail-offs of 0.1 ms to 3 s: the shortest have steps of their own and the longest are smooth;
    in between, steps are interpolated least exactly. v = F / m (0.1 + tau (1 - exp(-(t - 0.2) /
    tau))) after burn-out at 0.2 s, let go at 0.1 s."""
    campaign = sepmc.load(Path(__file__).parents[1] / "scenes" / "tail-off-of-any-length.toml")
    result = campaign.run(cases=500)
    rows, inputs = result.histories(), result.to_pandas()
    tau = inputs["in_motor_m_tail_off_s"].to_numpy()[rows["case"]]
    late = (rows["time_s"] > 0.2).to_numpy()
    t, speed = rows["time_s"].to_numpy()[late], rows["separation_speed_m_s"].to_numpy()[late]
    exact = 4000.0 / 400.0 * (0.1 + tau[late] * (1.0 - np.exp(-(t - 0.2) / tau[late])))
    error = np.abs(speed - exact) / np.maximum(exact, inputs["separation_speed_m_s"].std())
    assert 0.0 < error.max() <= 3.0 * result.accuracy.history


def test_no_trial_case_tells_no_error(table2):
    """The error is not known then, which is not that it is zero; a step that is given does not
    change that."""
    told = achieved(table2, np.zeros(len(table2.outcome_columns)), 0)
    assert set(told.errors.values()) == {np.inf}
    assert not told.met
    for fixed in (False, True):
        assert "numerical " in accuracy_notes(told, fixed)[0]
