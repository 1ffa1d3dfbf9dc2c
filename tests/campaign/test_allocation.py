"""Tolerance allocation against a problem of known risk."""

import shlex

import pandas as pd
import pytest
from click.testing import CliRunner
from support.sizing_problem import FORCE, SIGMA, campaign, risk

from sepmc.campaign.allocation import MAX_TRIES, allocate, scaled_distribution
from sepmc.cli.allocation_results import render_allocation
from sepmc.cli.app import main
from sepmc.scene.messages import InputError

KEY = "spring.pusher.factor"


def at(force, **settings):
    """The problem with a force, and a truncation that stays positive with twice the spread."""
    cut = {f"dispersion.{KEY}.truncate_sigma": 4.0}
    return campaign().with_settings({FORCE.key: force, **cut, **settings})


@pytest.mark.slow
def test_changes_are_those_of_the_closed_form():
    """The intervals contain the true changes; the largest gain stands first."""
    # the bound is one sigma below the mean
    force = next(f for f in range(1000, 6000, 10) if risk(f) < 0.16)
    result = allocate(at(force, **{"dispersion.body.aft.cg_m.y": {"uniform": 1e-6}}), 2000, 3)
    assert list(result.table["input"]) == [KEY, "body.aft.cg_m.y"]
    row = result.table.iloc[0]
    for name, factor in (("half", 0.5), ("double", 2.0)):
        change = risk(force, factor) - risk(force)
        assert row[f"{name}_low"] < change < row[f"{name}_high"]
        assert row[f"{name}_high"] - row[f"{name}_low"] < 0.05
    assert not result.passes
    assert abs(result.probability - risk(force)) < 0.03
    assert list(result.factors) == [KEY]  # the other one does not help
    assert result.factors[KEY] == 0.5
    assert result.settings == {
        f"dispersion.{KEY}": {"normal": [1.0, 0.5 * SIGMA], "truncate_sigma": 4.0}
    }
    assert result.shown == (risk(force, 0.5) < 0.05)


@pytest.mark.slow
def test_a_spread_is_doubled_where_the_requirement_allows_it():
    result = allocate(at(5500.0), 2000, 3)
    assert risk(5500.0, 2.0) < 0.02
    assert result.passes
    assert result.factors == {KEY: 2.0}
    assert result.shown
    assert result.verdict_seed == 4
    assert result.verdicts.loc["fast", "confidence"] == pytest.approx(1.0 - 0.1 / MAX_TRIES)


@pytest.mark.slow
def test_no_proposal_where_a_doubled_spread_fails():
    force = next(f for f in range(1000, 6000, 10) if risk(f) < 0.02)
    result = allocate(at(force), 2000, 3)
    assert result.passes
    assert result.table["double_passes"].to_list() == [False]
    assert (result.factors, result.shown) == ({}, True)  # the unchanged campaign passes again
    assert (result.verdicts["verdict"] == "pass").all()
    assert "no run with doubled spreads did" in render_allocation(result, "pusher.toml", ())


@pytest.mark.slow
def test_no_proposal_where_a_fresh_run_of_the_campaign_itself_fails():
    """The first run passes by chance: no doubled spread is blamed, and none is proposed."""
    force = next(f for f in range(1000, 6000, 10) if risk(f) < 0.036)
    result = allocate(at(force, **{"dispersion.body.aft.cg_m.y": {"uniform": 1e-6}}), 500, 5)
    assert result.passes
    assert "body.aft.cg_m.y" in list(result.table["input"][result.table["double_passes"].eq(True)])
    assert (result.factors, result.settings, result.shown) == ({}, {}, False)
    text = render_allocation(result, "pusher.toml", ())
    assert "no proposal: even with no spread doubled" in text
    assert "truncate_sigma" not in text


@pytest.mark.slow
def test_a_spread_that_cannot_be_doubled_is_a_row_with_the_reason():
    """Twice the spread of a mass reaches below 0."""
    nominal = campaign().scene.body["aft"].mass
    wide = {"dispersion.body.aft.mass_kg": {"uniform": 0.6 * nominal}}
    table = allocate(at(5500.0, **wide), 500, 3).table.set_index("input")
    row = table.loc["body.aft.mass_kg"]
    assert row["note"].startswith("double: dispersion.body.aft.mass_kg")
    assert row[["double", "double_low", "double_high"]].isna().all()
    assert row["double_passes"] is None
    assert row["half_low"] <= row["half"] <= row["half_high"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dispersion": {}}, "no input has a spread to scale"),
        ({"dispersion": {KEY: {"discrete": [0.9, 1.0]}}}, "no input has a spread to scale"),
        ({"run.sampler": "lhs"}, "verdicts need random cases"),
        ({"requirement": []}, "has no requirement to judge by"),
    ],
)
def test_refused(settings, message):
    with pytest.raises(InputError, match=message):
        allocate(campaign().with_settings(settings), 500)


def test_scaled_distributions():
    """Mean, middle and mode stay; a truncation in sigma scales with sigma."""
    changed = campaign().with_settings(
        {
            "dispersion": {
                "spring.pusher.force_N": {"triangular": [2000.0, 3000.0, 3500.0]},
                "body.aft.mass_kg": {"uniform": [9.0, 12.0]},
                KEY: {"normal": 0.1, "truncate_sigma": 3},
            }
        }
    )
    assert [scaled_distribution(one, 2.0) for one in changed.file.dispersions] == [
        {"triangular": [1000.0, 3000.0, 4000.0]},
        {"uniform": [7.5, 13.5]},
        {"normal": [1.0, 0.2], "truncate_sigma": 3.0},
    ]


@pytest.mark.slow
def test_command(tmp_path, monkeypatch):
    """The printed command runs the same cases with the proposed spreads."""
    monkeypatch.chdir(tmp_path)
    arguments = ["allocate", "lightband", "--cases", "2000", "--check"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    table = pd.read_csv("lightband-allocation.csv")
    assert len(table) == 10
    assert "of 10 spreads halved:" in result.output
    again = result.output.split("the same cases again: ")[1].splitlines()[0]
    words = [*shlex.split(again)[1:], "--no-plots", "--out", "again"]
    run = CliRunner().invoke(main, words)
    assert run.exit_code == 0, run.output
    line = next(line for line in result.output.splitlines() if line.startswith("tip_off"))
    cases = pd.read_parquet("again/cases")
    beyond = (cases["clear_craft_transverse_rate_deg_s"] > 1.0).sum()
    assert int(line.split()[2]) == beyond
    refused = CliRunner().invoke(main, arguments)
    assert refused.exit_code != 0
    assert "exists" in refused.output
