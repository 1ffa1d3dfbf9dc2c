"""How a campaign is flown, and how large its error is: corners, relative errors, the pilot's steps, what a run tells of them."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

import sepmc
from sepmc import cases, cli, pilot
from sepmc.compiler.plan import make_plan
from sepmc.door import fly_block
from sepmc.schema import Status

INF, NAN = np.inf, np.nan
GENERAL = {"output.loads": ["pins"], "run.history_step_s": 0.0}  # what the general kernel alone computes


def error(found, reference, units=None):
    """`relative_error` of plain rows."""
    found, reference = np.atleast_2d(np.array(found, dtype=float)), np.atleast_2d(np.array(reference, dtype=float))
    return pilot.relative_error(found, reference, units or ["m"] * reference.shape[1])


# -- corners ----------------------------------------------------------------------------------------------------------------------


def test_corners_do_not_depend_on_the_seed(table2):
    """Nor on how many cases there are: how a campaign is flown is a matter of its scene and laws."""
    base = pilot.corners(table2)
    assert base.shape == (pilot.CORNERS + 1, len(table2.file.dispersions))
    assert_array_equal(pilot.corners(table2.with_settings({"run.seed": 1, "run.cases": 5})), base)


def test_corners_are_the_nominal_and_the_edges(table2):
    """The middle of every law first; then of each parameter a thousandth of the probability from either end, both ends often."""
    found = pilot.corners(table2) / table2.factors
    middle = [cases.quantile(d, np.array([0.5]))[0] for d in table2.file.dispersions]
    assert_allclose(found[0], middle, rtol=1e-12, atol=1e-12)
    for values, law in zip(found[1:].T, table2.file.dispersions, strict=True):
        low, high = cases.quantile(law, np.array([0.001, 0.999]))
        assert_allclose(np.unique(np.round((values - low) / (high - low), 9)), [0.0, 1.0], atol=1e-9)
        assert 4 <= np.sum(values > 0.5 * (low + high)) <= pilot.CORNERS - 4
    assert len(np.unique(found[1:] > found[0], axis=0)) == pilot.CORNERS


def test_corners_without_dispersion(table2):
    assert pilot.corners(table2.with_settings({"dispersion": {}})).shape == (pilot.CORNERS + 1, 0)


@pytest.mark.parametrize("law", [{"normal": 5.0}, {"triangular": [440.0, 458.0, 480.0]}, {"discrete": [450.0, 460.0]}, {"constant": 458.0}])
def test_corners_of_every_law(table2, law):
    """Finite: tails are cut at a thousandth, a discrete law gives its own values."""
    campaign = table2.with_settings({"dispersion": {"body.upper.mass_kg": law}})
    found = pilot.corners(campaign)
    assert np.isfinite(found).all()
    assert np.all((found > 400.0) & (found < 500.0))
    if "discrete" in law:
        assert set(found[1:, 0]) == {450.0, 460.0}


# -- relative errors --------------------------------------------------------------------------------------------------------------


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
    """Zero but for round-off: measured against a ten-thousandth of the largest of the same unit, and only of the same."""
    reference, found = [[5.0, 1e-16, 1e-16]], [[5.0, 2e-16, 2e-16]]
    assert_allclose(error(found, reference, ["m", "m", "rad"]), [0.0, 1e-16 / 5e-4, 1.0], rtol=1e-9)


def test_error_of_nan():
    """At the same place it agrees; at one only, nothing is worse. It does not enter the scatter as a number."""
    assert_array_equal(error([[NAN, 1.0], [2.0, 1.0]], [[NAN, 1.0], [2.0, 1.0]]), [0.0, 0.0])
    assert_array_equal(error([[NAN, 1.0]], [[2.0, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[2.0, 1.0]], [[NAN, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[INF]], [[1.0]]), [INF])


def test_error_of_zero():
    """Equal zeros agree although there is nothing to divide by; a number where the reference is nothing but zero is infinitely wrong."""
    assert_array_equal(error([[0.0, 0.0]], [[0.0, 0.0]]), [0.0, 0.0])
    assert_array_equal(error([[1e-30]], [[0.0]]), [INF])


def test_error_of_no_cases():
    assert_array_equal(pilot.relative_error(np.empty((0, 3)), np.empty((0, 3)), ["m"] * 3), [0.0] * 3)


def test_error_does_not_change_what_it_is_given():
    found, reference = np.array([[1.0, NAN]]), np.array([[1.0, NAN]])
    pilot.relative_error(found, reference, ["m", "m"])
    assert_array_equal(found, reference)


# -- how a campaign is flown --------------------------------------------------------------------------------------------------------


def test_general_kernel_at_a_step_that_has_settled(table2):
    """Halving the step changes no outcome of the corners by more than the accuracy; of other cases by no more than ten times that."""
    for accuracy in (1e-5, 1e-9):
        campaign = table2.with_settings(GENERAL | {"solver.accuracy": accuracy})
        assert pilot.reasons(campaign) == ["outputs of joint or pin loads"]
        flight = pilot.plan_flight(campaign)
        assert (flight.kernel, flight.why) == (None, ["outputs of joint or pin loads"])
        assert flight.error <= accuracy
        units = [column.unit for column in campaign.outcome_columns]
        peaks = [i for i, column in enumerate(campaign.outcome_columns) if not column.name.endswith("_time_s") or "release" in column.name]
        for draws, most in (
            (pilot.corners(campaign)[:9], accuracy),
            (cases.draw(campaign.file.dispersions, 3, 0, 50) * campaign.factors, 10.0 * accuracy),
        ):
            one, two = (
                fly_block(make_plan(campaign.scene, step=step), campaign.slots, draws, 0, 0, 0).outcomes[:, : len(units)]
                for step in (flight.step, 0.5 * flight.step)
            )
            changes = pilot.relative_error(one, two, units)
            assert changes[peaks].max() <= most


def test_a_coarser_accuracy_takes_a_longer_step(table2):
    steps = [pilot.plan_flight(table2.with_settings(GENERAL | {"solver.accuracy": accuracy})).step for accuracy in (1e-2, 1e-6, 1e-10)]
    assert steps == sorted(steps, reverse=True)
    assert steps[0] > steps[2]


def test_a_given_step_is_taken(table2):
    flight = pilot.plan_flight(table2.with_settings({"solver.step_s": 0.0123}))
    assert (flight.step, flight.kernel, flight.steps, flight.why) == (0.0123, None, None, ["a fixed solver.step_s"])
    assert flight.sharper().step == 0.00615


def test_a_case_that_is_never_released_settles_too(table2):
    """Its outcomes are numbers as any other's: a single run must not be cut into the most steps there are."""
    history = table2.with_settings({"run.end_time_s": 0.2}).simulate(step_s=0.1)
    assert history.attrs["status"] == "never-released"
    assert history.attrs["outcomes"]["steps"] <= 1000


@pytest.mark.parametrize("accuracy", [1e-4, 1e-9])
def test_the_pilot_keeps_within_its_share(table2, accuracy):
    """Half of the accuracy, over its own cases; the steps it chose are the fewest: one less in any phase is too few."""
    campaign = table2.with_settings({"run.history_step_s": 0.0, "solver.accuracy": accuracy})
    flight = pilot.plan_flight(campaign)
    assert flight.why == []
    assert flight.error <= 0.5 * accuracy
    assert_allclose(flight.usual.sum(), campaign.scene.run.end_time, rtol=1e-9)
    assert flight.usual[0] == pytest.approx(0.05, rel=1e-9)
    again = pilot.plan_flight(campaign.with_settings({"run.seed": 8}))
    assert_array_equal(again.steps, flight.steps)
    assert again.error == flight.error


# -- what a run tells ---------------------------------------------------------------------------------------------------------------


def told(folder, name):
    return json.loads((folder / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("settings", "kernel"), [({}, "specialised"), (GENERAL, "general"), ({"solver.step_s": 0.02}, "general")], ids=["fast", "loads", "step"]
)
def test_a_run_tells_its_error(table2, settings, kernel, tmp_path):
    """In the result, the manifest and the statistics: what was asked for, what was achieved over 64 cases, by outcome."""
    campaign = table2.with_settings({"run.history_step_s": 0.0} | settings)
    result = campaign.run(cases=80, out=tmp_path / "run")
    achieved, written = result.accuracy, told(tmp_path / "run", "manifest.json")["accuracy"]
    assert (achieved.asked, achieved.cases) == (1e-9, pilot.SAMPLE)
    assert set(achieved.errors) == set(result.outcomes)
    name, worst = achieved.worst
    assert worst == max(achieved.errors.values()) == achieved.errors[name]
    assert written["kernel"] == kernel
    assert written["method"] == "dop853"
    assert (written["achieved"], written["worst_outcome"], written["cases"]) == (worst, name, pilot.SAMPLE)
    given = campaign.scene.solver.step is not None
    assert ("asked" in written) is not given
    assert given or (written["asked"], written["met"]) == (1e-9, worst <= 1e-9)
    assert written["errors"] == achieved.errors
    if kernel == "specialised":
        assert written["steps"] == result.flight.steps.tolist()
        assert worst <= 1e-9
    else:
        assert written["step_s"] == result.flight.step
    printed = CliRunner().invoke(cli.main, ["stats", str(tmp_path / "run")], catch_exceptions=False).stdout
    assert f"numerical error at most {worst:.1e} ({name})" in printed
    assert f"{kernel} kernel, dop853" in printed
    table = pd.read_csv(tmp_path / "run" / "statistics.csv", index_col="outcome")
    assert_allclose(table["error"], [achieved.errors[name] for name in table.index], rtol=1e-9)


def test_the_error_told_is_the_error_there_is(table2):
    """64 cases against twenty times the steps: twice the resolution finds it to a few per cent."""
    campaign = table2.with_settings({"run.history_step_s": 0.0, "solver.accuracy": 1e-4})
    result = campaign.run(cases=pilot.SAMPLE)
    flight = result.flight
    drawn = cases.draw(campaign.file.dispersions, campaign.scene.run.seed, 0, pilot.SAMPLE) * campaign.factors
    count = len(campaign.outcome_columns)
    fine = pilot.fly(campaign, type(flight)(kernel=flight.kernel, steps=20 * flight.steps, usual=flight.usual), drawn).outcomes[:, :count]
    here = pilot.fly(campaign, flight, drawn).outcomes[:, :count]
    errors = pilot.relative_error(here, fine, [column.unit for column in campaign.outcome_columns])
    assert result.accuracy.worst[1] == pytest.approx(errors.max(), rel=0.2)
    assert 0.0 < errors.max() <= 1e-4


def test_fewer_cases_than_the_sample(table2):
    assert table2.run(cases=5).accuracy.cases == 5


def test_the_error_of_failed_cases_does_not_count(table2):
    """A sample in which some are invalid: the others are compared."""
    campaign = table2.with_settings({"run.history_step_s": 0.0, "dispersion.body.upper.mass_kg": {"normal": 250.0}})
    result = campaign.run(cases=64)
    failed = 64 - result.status_counts[Status.OK.label]
    assert 0 < failed < 30
    assert result.accuracy.cases == 64 - failed
    assert np.isfinite(result.accuracy.worst[1])


def test_the_program_tells_it(tmp_path):
    """The line after a campaign, and what `check` says of a scene's kernel."""
    arguments = ["campaign", "table2.toml", "--cases", "10", "--no-plots", "--out", str(tmp_path / "run")]
    found = CliRunner().invoke(cli.main, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    assert "numerical error at most" in found.output
    assert "asked 1e-09" in found.output
    checked = CliRunner().invoke(cli.main, ["check", "table2.toml"], catch_exceptions=False).stdout
    assert "1e-09" in checked
    code = CliRunner().invoke(cli.main, ["check", "table2.toml", "--code"], catch_exceptions=False).stdout
    assert "def rates_phase2(w):" in code
    general = CliRunner().invoke(cli.main, ["check", "table2.toml", "--set", "solver.step_s=0.05"], catch_exceptions=False).stdout
    assert "a fixed solver.step_s" in general


def test_sepmc_load_is_not_slowed(table2):
    """Planning compiles; reading and checking a campaign must not."""
    campaign = sepmc.load("table2")
    assert "plan" not in campaign.__dict__
    assert campaign.digest == table2.digest
