"""Limit cases: inputs at their ends, one at a time and in the worst combination."""

import itertools
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from support.sizing_problem import END_S, SPEED
from support.sizing_problem import campaign as pusher

import sepmc
from sepmc.campaign.limit_cases import _LimitSearch, limit_cases, limit_ends
from sepmc.cli.app import main
from sepmc.scene.messages import InputError

ITEMS = [
    SPEED | {"at_least": 2.55, "at_most": 3.25},  # the worst is at either end of all inputs
    {"name": "whole", "metric": "jammed"},
]
LAWS = {
    "spring.pusher.factor": {"normal": 0.03},
    "spring.pusher.force_N": {"uniform": 300.0},
    "body.fore.mass_kg": {"uniform": 5.0},
    "initial.roll_deg": {"uniform": 180.0},
}


@pytest.fixture(scope="module")
def campaign():
    return pusher(*ITEMS).with_settings({"dispersion": LAWS})


@pytest.fixture(scope="module")
def limits(campaign):
    return limit_cases(campaign).table.set_index("limit")


@pytest.mark.slow
def test_each_input_is_at_its_ends_alone(campaign, limits):
    nominal, dispersions = limits.loc["nominal"], campaign.file.dispersions
    assert len(limits) == 1 + 2 * 4 + 7 + len(ITEMS)
    assert limits.loc["initial.roll_deg = 90", "between"] == "initial.roll_deg = 90"
    for one in dispersions:
        for word, end in zip(("low", "high"), limit_ends(one), strict=True):
            row = limits.loc[f"{one.parameter.key} {word}"]
            assert row[one.parameter.column] == end
            assert (row["low"] + row["high"], row[word]) == (one.parameter.key,) * 2
            others = [d.parameter.column for d in dispersions if d is not one]
            assert (row[others] == nominal[others]).all()


@pytest.mark.slow
def test_the_worst_combination_is_the_worst_of_all(campaign, limits):
    search = _LimitSearch(campaign, campaign.file.requirements, None, None)
    levels = np.array(list(itertools.product((-1, 0, 1), repeat=len(LAWS))))
    item = campaign.file.requirements[0]
    _, margin, _ = search.judge(item, *search.run(levels))
    assert limits.loc["worst of fast", "fast_margin"] == pytest.approx(margin.min(), rel=1e-9)
    assert margin.min() < limits["fast_margin"].drop("worst of fast").min()
    assert set(limits["fast"]) == {"met", "violated"}
    assert (limits["whole"] == "met").all()
    assert limits["whole_margin"].isna().all()


@pytest.mark.slow
def test_the_command_and_its_table_as_samples(campaign, limits, tmp_path, monkeypatch):
    """A campaign with these samples has the same outcomes."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text(campaign.file.toml, encoding="utf-8")
    result = CliRunner().invoke(main, ["scenarios", "t.toml", "--limits", "--out", "all"])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("limit case "))
    assert lines[first + 1].split()[0] == "nominal"
    assert any(line.startswith("worst of fast; low: ") for line in lines)
    stored = pd.read_csv("all/limits.csv")
    assert stored["limit"].tolist() == limits.index.tolist()
    again = sepmc.load("t.toml", {"run.samples": "all/limits.csv"}).run().to_pandas()
    np.testing.assert_allclose(again["separation_speed_m_s"], limits["fast_outcome"], rtol=1e-9)


def test_ends_of_a_normal_distribution_are_three_sigma_or_its_truncation():
    (one,) = pusher().file.dispersions  # truncated at 8 sigma of 0.1
    assert limit_ends(one) == pytest.approx((0.7, 1.3))
    cut = pusher().with_settings({"dispersion.spring.pusher.factor.truncate_sigma": 2.0})
    assert limit_ends(cut.file.dispersions[0]) == pytest.approx((0.8, 1.2))
    weights = {"discrete": [0.0, 1.0, 2.0], "weights": [0.0, 1.0, 1.0]}
    some = pusher().with_settings({"dispersion.spring.pusher.factor": weights})
    assert limit_ends(some.file.dispersions[0]) == (1.0, 2.0)
    assert 0.5 * math.erfc(3.0 / math.sqrt(2.0)) == pytest.approx(0.00135, rel=1e-3)


def test_a_campaign_without_requirements_or_ends_is_refused():
    with pytest.raises(InputError, match="limit cases are judged"):
        limit_cases(pusher().with_settings({"requirement": []}))
    constant = {"dispersion.spring.pusher.factor": {"constant": 1.0}}
    with pytest.raises(InputError, match="no input has two ends"):
        limit_cases(pusher().with_settings(constant))


@pytest.mark.slow
def test_a_case_without_the_outcome_is_violated(tmp_path, monkeypatch):
    """The weak end of the spring does not end its stroke in time: it is so marked, and the worst
    case with a value is a further one."""
    item = {"name": "soon", "metric": "pusher_stroke_end_time_s", "at_most": 0.0}
    one = pusher(item).with_settings({"run.end_time_s": END_S})
    table = limit_cases(one).table.set_index("limit")
    assert table.loc["worst of soon", "soon"] == "no outcome"
    other = table.loc["worst of soon with an outcome"]
    assert other["soon"] == "violated"
    assert other["soon_margin"] == table["soon_margin"].min()
    monkeypatch.chdir(tmp_path)
    Path("t.toml").write_text(one.file.toml, encoding="utf-8")
    result = CliRunner().invoke(main, ["scenarios", "t.toml", "--limits"])
    assert result.exit_code == 0, result.output
    rows = [line for line in result.stdout.splitlines() if line.startswith("spring.pusher.factor ")]
    assert rows[0].split()[2:5] == ["no", "outcome", "VIOLATED"]
    assert "no outcome: the case lacks it, which counts as a violation" in result.stdout


def test_limit_cases_have_no_verdict_to_check(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("t.toml").write_text(pusher(SPEED).file.toml, encoding="utf-8")
    words = ["scenarios", "t.toml", "--limits", "--check", "--out", "none"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 2
    assert "--check judges the cases of scenarios, not limit cases" in result.output
    assert not Path("none").exists()
