"""Sizing: the cheapest design that passes, judged on cases that did not choose it."""

import json
import math
import shlex

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from support.sizing_problem import FORCE, SPEED, campaign, risk

import sepmc
from sepmc.analysis.proportions import allowed_violations, binomial_cdf
from sepmc.campaign.sizing import (
    MAX_TRIES,
    VERDICT_CASES,
    Variable,
    accepted_violations,
    parse_variable,
    size,
)
from sepmc.campaign.store.folders import StoreError
from sepmc.cli.app import main
from sepmc.cli.report_content import sizing_table
from sepmc.scene.messages import InputError


@pytest.fixture(scope="module")
def sized():
    return size(campaign(), [FORCE], "2 * push", cases=500)


@pytest.mark.slow
def test_the_optimum_is_at_the_accepted_risk(sized):
    """The true risk of the chosen force is that of the accepted violations, to their scatter."""
    force = sized.values[FORCE.key]
    aimed = accepted_violations(campaign().file.requirements[0], 500) / 500.0
    scatter = 3.0 * math.sqrt(aimed * (1.0 - aimed) / 500.0)
    assert abs(risk(force) - aimed) <= scatter
    assert risk(force) < 1.0 - SPEED["probability"]
    assert sized.cost == 2.0 * force
    assert sized.shown
    assert not sized.at_ends


@pytest.mark.slow
def test_the_search_ends_at_the_border_of_the_accepted_designs(sized):
    """No searched design with a smaller cost was accepted, and one that is hardly smaller was not:
    the border is met to 1e-4 of the range."""
    table, force = sized.searched, sized.values[FORCE.key]
    assert (table.loc[table[FORCE.key] < force, "margin"] < 0.0).all()
    rejected = table.loc[table["margin"] < 0.0, FORCE.key].max()
    assert 0.0 < force - rejected <= 1e-4 * (FORCE.high - FORCE.low)


@pytest.mark.slow
def test_the_verdict_is_that_of_a_run_with_another_seed(sized):
    verdict = sized.verdicts.loc["fast"]
    assert sized.seed != 1
    assert sized.cases == VERDICT_CASES * 500 == verdict["cases"]
    assert verdict["confidence"] == pytest.approx(1.0 - 0.1 / MAX_TRIES)
    run = campaign().with_settings(sized.values).run(cases=sized.cases, seed=sized.seed)
    below = (run.to_pandas()["separation_speed_m_s"] < SPEED["at_least"]).sum()
    assert below == verdict["violations"]


@pytest.mark.slow
def test_two_variables_are_no_worse_than_a_grid():
    """Force and stroke enter as their product; a stroke is cheaper here."""
    variables = [
        Variable("push", "spring.pusher.force_N", 2000.0, 6000.0),
        Variable("mass", "body.fore.mass_kg", 60.0, 100.0),
    ]
    sizing = size(campaign(), variables, "push + 20 * (100 - mass)", cases=200)
    session = campaign().session({v.key: (v.low, v.high) for v in variables})
    push, mass = (axis.ravel() for axis in np.meshgrid(np.linspace(2000, 6000, 41), [60, 80, 100]))
    table = session.run_many(np.column_stack([push, mass]), cases=200)
    most = accepted_violations(campaign().file.requirements[0], 200)
    costs = (push + 20.0 * (100.0 - mass))[table.summary["fast_violations"] <= most]
    assert sizing.cost <= 1.01 * costs.min()
    assert sizing.shown


@pytest.mark.slow
def test_three_variables():
    """Their first designs are a power of two, as a Sobol sequence needs."""
    variables = [
        Variable("push", "spring.pusher.force_N", 1000.0, 6000.0),
        Variable("fore", "body.fore.mass_kg", 60.0, 100.0),
        Variable("aft", "body.aft.mass_kg", 200.0, 400.0),
    ]
    sizing = size(campaign(), variables, "push + fore + aft", cases=100)
    assert sizing.shown
    assert sizing.values["body.fore.mass_kg"] == pytest.approx(60.0, abs=0.5)
    assert risk(sizing.values[FORCE.key], masses=(200.0, 60.0)) < 0.05


@pytest.mark.slow
def test_a_cost_with_its_minimum_inside_the_range():
    """The grid of the search has steps of 417 N."""
    sizing = size(campaign(), [FORCE], "(push - 5123) ** 2", cases=100)
    assert abs(sizing.values[FORCE.key] - 5123.0) <= 1e-4 * (FORCE.high - FORCE.low)
    assert sizing.shown


@pytest.mark.slow
def test_an_accepted_range_narrower_than_the_grid():
    """Speeds between 2 and 2.6 m/s: forces in a hundredth of the range, from 2.0 to 2.2 kN."""
    item = SPEED | {"at_most": 2.6}
    wide = Variable("push", FORCE.key, 1000.0, 30000.0)
    sizing = size(campaign(item), [wide], "-push", cases=200)
    assert sizing.shown
    accepted = sizing.searched.loc[sizing.searched["margin"] >= 0.0, FORCE.key]
    assert np.ptp(accepted) < 29000.0 / 12.0
    assert 1900.0 < accepted.min() < accepted.max() < 2400.0


@pytest.mark.slow
def test_a_requirement_on_any_violation_leaves_the_direction_of_the_search():
    """All cases of all these designs violate one: those with the largest force by the least."""
    both = campaign(SPEED, {"name": "none", "metric": "violation", "probability": 0.95})
    weak = Variable("push", FORCE.key, 100.0, 400.0)
    with pytest.raises(InputError, match=r"the nearest is spring.pusher.force_N = 400$"):
        size(both, [weak], "push", cases=100)


@pytest.mark.slow
def test_the_border_where_cases_lack_the_outcome():
    """No margin says there how far the border is."""
    far = {"event": [{"name": "far", "when": {"joint": "ring", "stroke_m": 1.6}}]}
    item = SPEED | {"metric": "far_time_s", "at_least": 0.0}
    problem = campaign().with_settings(far | {"requirement": [item]})
    table = size(problem, [FORCE], "push", cases=100).searched
    accepted = table["margin"] >= 0.0
    assert not np.isfinite(table["margin"]).all()
    gap = table.loc[accepted, FORCE.key].min() - table.loc[~accepted, FORCE.key].max()
    assert 0.0 < gap <= 1e-4 * (FORCE.high - FORCE.low)


@pytest.mark.slow
def test_a_case_with_another_status_does_not_show_that_one_does_not_occur():
    never = {"release": [{"name": "off", "joint": "ring", "when": {"time_s": 9.0}}]}
    held = never | {"phase": [{"name": "held", "joints": {"ring": "fixed"}}]}
    item = {"name": "small", "metric": "outside-atmosphere", "probability": 0.95}
    with pytest.raises(InputError, match="no design of the ranges passes"):
        size(campaign(item).with_settings(held), [FORCE], "push", cases=100)


@pytest.mark.slow
def test_the_command_for_the_same_cases_where_a_setting_is_in_another_unit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pusher.toml").write_text(campaign().file.toml, encoding="utf-8")
    words = ["size", "pusher.toml", "--vary", "push=spring.pusher.force_N=1000:6000"]
    words += ["--minimise", "push", "--cases", "100", "--set", "spring.*.force_kN=3"]
    result = CliRunner().invoke(main, [*words, "--set", "body.fore.mass_kg=90"])
    assert result.exit_code == 0, result.output
    (line,) = (one for one in result.output.splitlines() if one.startswith("the same cases again"))
    again = CliRunner().invoke(main, [*shlex.split(line)[5:], "--out", "again"])
    assert again.exit_code == 0, again.output
    chosen = sepmc.load("again").file.tree
    assert chosen["body"]["fore"]["mass_kg"] == 90.0
    assert 1000.0 < chosen["spring"][0]["force_N"] < 6000.0


def test_cases_that_verdicts_cannot_use_are_refused(tmp_path):
    sobol = campaign().with_settings({"run.sampler": "sobol"})
    with pytest.raises(InputError, match="sampler = 'sobol': verdicts need random cases"):
        size(sobol, [FORCE], "push", cases=100)
    path = tmp_path / "rows.csv"
    path.write_text("in_spring_pusher_factor\n" + "1.0\n1.1\n" * 300, encoding="utf-8")
    with pytest.raises(InputError, match="the run for the verdict has the cases of the search"):
        size(campaign().with_settings({"run.samples": str(path)}), [FORCE], "push", cases=100)


@pytest.mark.slow
def test_a_cost_without_a_value_is_refused():
    with pytest.raises(InputError, match=r"minimise: has no value at .*force_N = 1000"):
        size(campaign(), [FORCE], "sqrt(push - 2000)", cases=100)


@pytest.mark.parametrize("probability", [0.9, 0.99])
@pytest.mark.parametrize("cases", [400, 2000])
def test_an_accepted_design_is_likely_to_be_shown(probability, cases):
    item = campaign(SPEED | {"probability": probability}).file.requirements[0]
    most = accepted_violations(item, cases)
    raised, count = 1.0 - 0.1 / MAX_TRIES, VERDICT_CASES * cases
    allowed = allowed_violations(count, probability, raised)
    assert binomial_cdf(allowed, count, most / cases) >= 0.95
    assert binomial_cdf(allowed, count, (most + 1) / cases) < 0.95


def test_a_range_in_which_nothing_passes_is_refused():
    with pytest.raises(InputError, match=r"no design of the ranges passes.*force_N = 1200"):
        size(campaign(), [Variable("push", FORCE.key, 1000.0, 1200.0)], "push", cases=100)


@pytest.mark.parametrize(
    ("minimise", "cases", "message"),
    [
        ("push +", 100, r"minimise = push \+: is no formula"),
        ("pull", 100, r"minimise = pull: no variable 'pull'"),
        ("3", 100, "must contain a variable"),
        ("push", 20, "cannot be shown with fewer than"),
    ],
)
def test_wrong_input_is_refused_before_anything_is_run(minimise, cases, message):
    with pytest.raises(InputError, match=message):
        size(campaign(), [FORCE], minimise, cases=cases)


def test_a_variable_is_not_named_as_a_number():
    """The formula of the cost would not see it."""
    with pytest.raises(InputError, match="vary: pi is a number in formulas"):
        size(campaign(), [FORCE, Variable("pi", "body.fore.mass_kg", 60.0, 90.0)], "push + pi")


@pytest.mark.parametrize("text", ["push", "push=a.b_N", "push=a.b_N=1", "1=a.b_N=1:2", "p=a=x:2"])
def test_a_variable_names_what_is_allowed(text):
    with pytest.raises(InputError, match=r"must be NAME=KEY=LOW:HIGH"):
        parse_variable(text)


@pytest.mark.parametrize("ends", ["2:1", "1:1", "1:inf", "nan:2"])
def test_a_range_is_finite_and_rises(ends):
    with pytest.raises(InputError, match="LOW and HIGH must be finite, and LOW below HIGH"):
        parse_variable(f"push=a.b_N={ends}")


@pytest.mark.slow
def test_a_design_whose_springs_pull_is_reported():
    """The warnings of the verdict run are those of the chosen design, not of the file."""
    tree = {"spring.pusher.stiffness_N_per_m": 20000.0, "run.end_time_s": 0.05}
    variable = Variable("push", FORCE.key, 1000.0, 1500.0)
    easy = SPEED | {"at_least": 0.1}
    result = size(campaign(easy).with_settings(tree), [variable], "push", cases=100)
    assert any("pulls with" in note for note in result.verdict.notes)


@pytest.mark.slow
def test_the_command(tmp_path, monkeypatch):
    """The variable is that of [size] in the file; the option replaces the cost there."""
    monkeypatch.chdir(tmp_path)
    table = (
        '[size]\nminimise = "-push"\nvary = { push = "spring.*.force_N=1000:6000" }\ncases = 200\n'
    )
    (tmp_path / "pusher.toml").write_text(campaign().file.toml + table, encoding="utf-8")
    words = ["size", "pusher.toml"]
    result = CliRunner().invoke(main, [*words, "--minimise", "push", "--check", "--run", "sized"])
    assert result.exit_code == 0, result.output
    assert "fast         PASS" in result.output
    searched, key = pd.read_csv(tmp_path / "campaign-size.csv"), "spring.*.force_N"
    record = json.loads((tmp_path / "campaign-size.json").read_text(encoding="utf-8"))
    assert record["vary"] == {"push": {"key": key, "low": 1000.0, "high": 6000.0}}
    assert record["search"]["designs"] == len(searched.drop_duplicates(key))
    (chosen,), (rejected,) = record["design"].values(), record["nearest_not_accepted"].values()
    accepted = searched["margin"] >= 0.0
    assert chosen == searched.loc[accepted, key].min()
    assert rejected == searched.loc[~accepted, key].max()
    stored = sepmc.open("sized")  # the run for the verdict, as it was judged
    verdict = stored.requirements().loc["fast"]
    assert stored.seed == record["verdict"]["seed"] != record["search"]["seed"]
    assert verdict["violations"] == record["verdict"]["requirements"]["fast"]["violations"]
    assert verdict["confidence"] == pytest.approx(1.0 - 0.1 / MAX_TRIES)
    assert f"of {record['search']['designs']} searched" in result.output
    before = (tmp_path / "sized" / "manifest.json").read_bytes()
    with pytest.raises(StoreError, match="exists"):  # before any design is run
        size(campaign(), [FORCE], "push", cases=200, out=tmp_path / "sized")
    assert (tmp_path / "sized" / "manifest.json").read_bytes() == before
    (section,) = sizing_table(tmp_path / "sized")
    assert f"{key} = {chosen:.6g}" in section.note
    assert [f"{chosen:.6g}"] * 2 in [row[:2] for row in section.rows]
    assert not sizing_table(tmp_path)
    again = CliRunner().invoke(main, [*words, "--minimise", "push"])
    assert again.exit_code == 2  # the table of the search is not overwritten
    assert "exists" in again.output
