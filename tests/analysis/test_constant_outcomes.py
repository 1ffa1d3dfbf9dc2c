"""Outcomes that scatter by no more than their numerical error."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted

from sepmc.analysis import compare, constant_outcomes, distributions, sensitivity
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.statistics import statistics
from sepmc.analysis.statistics_text import render_summary
from sepmc.analysis.stopping import StoppingRule
from sepmc.campaign import run_statistics
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.store import result_files
from sepmc.cli import app
from sepmc.cli.figures import draw_figures
from sepmc.cli.options import load_campaign
from sepmc.report import convergence_figures, figures
from sepmc.scene.read import parse_campaign

# A body slides along another one. A cap hangs there at a spherical joint, which never comes apart:
# its separation is round-off.
SLIDING = """
name = "sliding"
environment = { atmosphere = "none", gravity = "none" }
[body.fore]
mass_kg = 30.0
inertia_kg_m2 = [1.0, 4.0, 4.0]
cg_m = [1.0, 0.03, 0.01]
[body.aft]
mass_kg = 10.0
inertia_kg_m2 = [0.5, 2.0, 2.0]
cg_m = [3.0, 0.02, -0.03]
[body.cap]
mass_kg = 2.0
inertia_kg_m2 = [0.2, 0.2, 0.2]
cg_m = [0.2, 0.1, 0.0]
[joint.pins]
bodies = ["aft", "fore"]
point_m = [2.0, 0.0, 0.0]
[joint.bolt]
bodies = ["fore", "cap"]
point_m = [0.4, 0.0, 0.0]
[[spring]]
name = "push"
bodies = ["aft", "fore"]
point_m = [2.0, 0.1, 0.0]
axis = [1.0, 0.0, 0.0]
force_N = 1200.0
stroke_m = 0.5
[[phase]]
name = "slide"
joints = { pins = "slider", bolt = "spherical" }
[initial]
altitude_m = 1000.0
speed_m_s = 20.0
omega_deg_s = [30.0, 2.0, 3.0]
[[requirement]]
name = "clear"
metric = "bolt_separation_distance_mm"
at_most = 1.0
probability = 0.9
confidence = 0.9
[dispersion]
"spring.push.force_N" = { normal = 60.0 }
"initial.omega_deg_s.x" = { normal = 3.0 }
[run]
cases = 20
end_time_s = 0.1
[solver]
step_s = 0.05
"""
SPEED, GAP = "bolt_separation_speed_m_s", "bolt_separation_distance_mm"
VARIES = "pins_separation_speed_m_s"


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of that scene, what the command printed, and its folder."""
    folder = tmp_path_factory.mktemp("sliding")
    (folder / "sliding.toml").write_text(SLIDING)
    with run_interpreted():
        called = call("campaign", folder / "sliding.toml", "--out", folder / "run")
    return folder / "run", called


def described(x, name="y_mm", share=1e-9, scale=1e-4):
    """Statistics of an outcome, and whether it is constant with such an error."""
    cases = {"case": np.arange(len(x)), "status": np.full(len(x), "ok"), name: np.array(x)}
    return constant_outcomes.with_constants(statistics(cases, [name]), {name: (share, scale)})


@pytest.mark.parametrize(
    ("share", "spread", "expected"),
    [
        (1e-9, 1.9e-9, True),  # both values may err by 1e-9 of 1
        (1e-9, 2.1e-9, False),
        (1e-9, 1e-6, False),  # small, and real
        (1e-13, 1e-9, False),  # smaller still, and real
        (1e-5, 1e-6, True),  # what is asked for no better does not know it
        (np.nan, 1e-6, False),  # an error that is not known excuses nothing
        (np.inf, 1e-6, False),
        (np.nan, 1e-14, True),  # round-off of numbers of size 1e0, 1e-10 of the scale 1e-4
    ],
)
def test_both_sides_of_the_rule(share, spread, expected):
    """Constant is what scatters by no more than twice its error; not what is small and real."""
    x = 1.0 + spread * np.linspace(0.0, 1.0, 50)
    table = described(x, share=share)
    assert table.at["y_mm", "constant"] == expected
    assert constant_outcomes.is_constant(table, "y_mm") == expected


def test_one_case_that_differs_is_enough():
    """Of a thousand cases alike but for one, that one is not lost."""
    x = np.full(1000, 83.7)
    assert described(x).at["y_mm", "constant"]
    x[500] += 1e-6
    assert not described(x).at["y_mm", "constant"]


def test_one_value_and_none_are_not_called_constant():
    """A single value, and an outcome that no case has, say nothing of scatter."""
    assert not described([1.0]).at["y_mm", "constant"]
    assert not described([np.nan, np.nan]).at["y_mm", "constant"]
    assert not described([1.0, np.inf]).at["y_mm", "constant"]


def test_times_of_extremes_are_constant_only_if_these_are():
    """An error as large as all times tells nothing where the extreme itself varies."""
    rng = np.random.default_rng(0)
    time, gap = rng.uniform(0.2, 0.3, 50), 80.0 + 1e-9 * rng.uniform(size=50)
    cases = {"case": np.arange(50), "status": np.full(50, "ok"), "a_clearance_time_s": time}
    errors = {"a_clearance_time_s": (5.0, 0.1), "a_clearance_mm": (1e-9, 1.0)}
    for x, expected in ((gap, True), (gap + rng.uniform(size=50), False)):
        table = statistics(cases | {"a_clearance_mm": x}, ["a_clearance_mm", "a_clearance_time_s"])
        table = constant_outcomes.with_constants(table, errors)
        assert table["constant"].tolist() == [expected, expected]
    table = statistics(cases | {"a_clearance_mm": gap}, ["a_clearance_mm", "a_clearance_time_s"])
    text = constant_outcomes.render_constants(constant_outcomes.with_constants(table, errors))
    assert "a_clearance_time_s: undetermined, as its extreme is flat" in text[1]


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [(6e-20, 1e-15, 0.0), (-6e-20, 1e-15, 0.0), (83.69999999564, 2e-8, 83.7), (83.7, 0.4, 84.0)],
)
def test_a_value_is_rounded_to_its_error(value, error, expected):
    """A value below its error is 0; digits below the error are dropped."""
    assert constant_outcomes.round_to_error(value, error) == expected


def test_drivers_and_laws_of_noise():
    """Noise below the error has no drivers and no law; ten times that has."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=500)
    cases = {
        "case": np.arange(500),
        "status": np.full(500, "ok"),
        "in_x": x,
        "y_mm": 5.0 + 1e-9 * x,
    }
    table = constant_outcomes.with_constants(statistics(cases, ["y_mm"]), {"y_mm": (1e-8, 1.0)})
    within = constant_outcomes.max_spread(table, "y_mm")
    with pytest.raises(ValueError, match="is constant, as its values differ by"):
        sensitivity.input_sensitivities(cases, ["in_x"], "y_mm", spread=within)
    assert (
        distributions.fit_distributions(cases, ["y_mm"], ["y_mm"]).at["y_mm", "distribution"]
        == "constant"
    )
    table = constant_outcomes.with_constants(statistics(cases, ["y_mm"]), {"y_mm": (1e-11, 1.0)})
    assert constant_outcomes.max_spread(table, "y_mm") == 0.0
    result = sensitivity.input_sensitivities(cases, ["in_x"], "y_mm", spread=0.0)
    assert result.at["in_x", "rank"] == pytest.approx(1.0)


def test_a_difference_below_the_error_is_none():
    """Two runs that differ in round-off alone do not differ, also where their cases scatter."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=200)
    one = {"case": np.arange(200), "status": np.full(200, "ok"), "in_x": x, "y_mm": x}
    two = one | {"y_mm": x + 1e-12 * (1.0 + 0.1 * rng.normal(size=200))}
    before = compare.compare(one, two, ["in_x"], ["y_mm"]).loc["y_mm"]
    assert before["low"] > 0.0  # taken for a difference, if nothing is known of the error
    result = compare.compare(one, two, ["in_x"], ["y_mm"], (), {"y_mm": 1e-11})
    assert result.at["y_mm", "below_error"]
    assert result.loc["y_mm", ["difference", "low", "high"]].tolist() == [0.0, 0.0, 0.0]
    assert "below numerical error" in compare.render_comparison(result)
    result = compare.compare(one, two, ["in_x"], ["y_mm"], (), {"y_mm": 1e-13})
    assert not result.at["y_mm", "below_error"]


def test_a_constant_is_known_as_soon_as_it_is_looked_at():
    """The mean of noise about zero is known to its numerical error, not to a share of itself."""
    x = 1e-17 * np.random.default_rng(3).standard_cauchy(4096)
    cases = {"case": np.arange(4096), "status": np.full(4096, "ok"), "y_mm": x}
    summary = TableStatistics(cases, ["y_mm"], [], {})
    within = 2.0 * float(np.abs(x).max())
    look = StoppingRule("y_mm", "mean", 1e-3, relative=False, text="y_mm:0.001").look(
        summary, 4, [], within
    )
    assert (look.value, look.sufficient, look.shortfall) == (0.0, True, "")
    assert (
        not StoppingRule("y_mm", "mean", 0.01, relative=True, text="y_mm:1%")
        .look(summary, 4, [], within)
        .sufficient
    )


def test_statistics_mark_constant(run):
    """On the screen, in both files and in Python; what varies is described as ever."""
    folder, reported = run
    assert reported.exit_code == 0
    assert f"{SPEED}: constant 0 m/s (20 values differ by no more than" in reported.output
    assert f"{GAP}: constant 0 mm" in reported.output
    assert "e-16" not in reported.output.split("audit")[0]
    assert f"\n{VARIES} " in reported.output
    outcomes = json.loads((folder / "statistics.json").read_text())["outcomes"]
    assert [outcomes[name]["constant"] for name in (SPEED, GAP, VARIES)] == [True, True, False]
    assert 0.0 < outcomes[VARIES]["error_size"] < 1e-4 * outcomes[VARIES]["sigma"]
    frame = pd.read_csv(folder / "statistics.csv", index_col="outcome")
    assert frame.loc[[SPEED, GAP, VARIES], "constant"].tolist() == [True, True, False]
    again = call("stats", folder)
    assert f"{GAP}: constant 0 mm" in again.output
    given = call("stats", folder, "--where", "initial.omega_deg_s.x>30")
    assert f"{GAP}: constant 0 mm" in given.output


def test_no_drivers_and_no_law_of_a_constant(run):
    """Neither the command nor the defaults tell drivers of a constant; laws say what it is."""
    folder, _ = run
    called = call("sensitivity", folder, SPEED, VARIES, "--no-plots")
    assert f"warning: {SPEED}: is constant" in called.output
    assert f"sensitivity of {SPEED}" not in called.output
    assert f"sensitivity of {VARIES}" in called.output
    called = call("sensitivity", folder, "--no-plots")
    assert f"sensitivity of {GAP}" not in called.output
    lines = call("fit", folder, GAP).output.splitlines()
    cells = [cell for line in lines if line.startswith(GAP) for cell in line.split()[1:]]
    assert "constant" in cells  # in the second part of a table that is split at 80 columns
    frame = pd.read_csv(folder / "distributions.csv", index_col="outcome")
    assert frame.at[SPEED, "distribution"] == "constant"
    assert np.isnan(frame.at[SPEED, "skewness"])


def test_python_says_so_too():
    """A result of a run that is kept in memory."""
    with run_interpreted():
        result = Campaign(parse_campaign(tomllib.loads(SLIDING), "sliding")).run(20)
    table = result.statistics()
    assert table.at[SPEED, "constant"]
    assert not table.at[VARIES, "constant"]
    with pytest.raises(ValueError, match="is constant"):
        result.sensitivity(SPEED)
    assert result.fit().at[SPEED, "distribution"] == "constant"
    assert "e-16" not in result._repr_html_()


def test_a_required_constant_is_drawn_as_one_value(run, monkeypatch):
    """The histogram and the requirement of a constant show its value, without bins or a curve."""
    kept = {}

    def keep(figure, path, order=()):
        kept[path.name] = figure
        return path

    monkeypatch.setattr(figures, "save", keep)
    monkeypatch.setattr(convergence_figures, "save", keep)
    folder, _ = run
    loaded = load_campaign(str(folder), (), warn=False)
    read = run_statistics.read_run(folder, loaded)
    draw_figures(folder, loaded, read.summary, read.table, read.verdicts, log=str, converging=True)
    panel = kept["histograms.png"].axes[0]
    assert panel.get_title() == "n 20, constant 0 mm"
    assert not panel.patches
    names = [ax.get_xlabel() for ax in kept["histograms.png"].axes]
    assert not any(name.startswith("bolt separation speed") for name in names)
    (panel,) = kept["requirements.png"].axes
    assert panel.get_title() == "clear: not shown; constant"
    assert not panel.collections
    titles = [ax.get_title() for ax in kept["convergence.png"].axes]
    assert "bolt separation distance" not in titles


def test_one_case_prints_no_noise(run, tmp_path):
    """A single run prints 0 where an outcome is below its error; files keep what was found."""
    folder, _ = run
    with run_interpreted():
        called = call("run", folder, "--case", 3, "--out", tmp_path / "one", "--no-plots")
    line = next(one for one in called.output.splitlines() if one.strip().startswith(SPEED))
    assert line.split() == [SPEED, "0"]


def test_joint_error_of_two_runs():
    """Both errors together; nothing of times of extremes, unless these are flat in both runs."""
    one, two = (described([1.0, x]) for x in (2.0, 3.0))
    sizes = one.at["y_mm", "error_size"] + two.at["y_mm", "error_size"]
    assert constant_outcomes.joint_error(one, two, "y_mm") == sizes > 0.0
    one, two = (described([1.0, x], "a_clearance_time_s") for x in (2.0, 3.0))
    assert constant_outcomes.joint_error(one, two, "a_clearance_time_s") == 0.0


@pytest.mark.slow
def test_counted_statistics_say_constant(tmp_path):
    """So does a run that keeps no rows, whose figures are drawn from its files."""
    (tmp_path / "sliding.toml").write_text(SLIDING)
    with run_interpreted():
        called = call(
            "campaign", tmp_path / "sliding.toml", "--out", tmp_path / "run", "--stats-only"
        )
    assert f"{GAP}: constant 0 mm" in called.output
    result = result_files.read_stored_statistics(tmp_path / "run")
    assert constant_outcomes.is_constant(result.table, GAP)
    assert (
        constant_outcomes.collapse_constant(result.histogram(GAP), result.table, GAP).edges.size
        == 0
    )
    bins = pd.read_csv(tmp_path / "run" / "histograms.csv")
    assert GAP not in set(bins["outcome"])
    assert VARIES in set(bins["outcome"])
    assert call("plot", tmp_path / "run").exit_code == 0


def test_text_without_constants_is_as_ever():
    """Tables of other origin, which do not tell what is constant, are written whole."""
    x = np.array([1.0, 2.0, 4.0])
    table = statistics({"case": np.arange(3), "status": np.full(3, "ok"), "y_mm": x}, ["y_mm"])
    assert constant_outcomes.with_constant_values(table) is table
    assert "y_mm" in render_summary(table, {"ok": 3})
