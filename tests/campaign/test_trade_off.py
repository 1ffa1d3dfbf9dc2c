"""Trade-off of several costs."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from support.sizing_problem import FORCE, SPEED, campaign, risk

from sepmc.campaign.design_search import MAX_TRIES, Goal, accepted_violations
from sepmc.campaign.sizing import Variable
from sepmc.campaign.trade_off import dominated, trade_off
from sepmc.cli.app import main
from sepmc.scene.messages import InputError

MASS = Variable("mass", "body.fore.mass_kg", 60.0, 100.0)
TWO = ["push", "100 - mass"]


@pytest.mark.slow
def test_a_front_against_a_grid(tmp_path, monkeypatch):
    """No accepted design of a grid is better than one of the front by 1 % of both ranges, and the
    command leaves the front as a table and a figure."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pusher.toml").write_text(campaign().file.toml, encoding="utf-8")
    words = ["size", "pusher.toml", "--vary", f"push={FORCE.key}=1000:6000", "--cases", "200"]
    words += ["--vary", f"mass={MASS.key}=60:100", "--minimise", TWO[0], "--minimise", TWO[1]]
    result = CliRunner().invoke(main, [*words, "--check"])
    assert result.exit_code == 0, result.output
    assert "confidence raised for 15 runs" in result.output
    assert (tmp_path / "campaign-size-front.png").stat().st_size > 10_000
    front = pd.read_parquet("campaign-size-front.parquet")
    assert len(front) == 5
    assert front["shown"].all()
    costs = front[["cost_1", "cost_2"]].to_numpy()
    assert (np.diff(costs[:, 0]) > 0.0).all()
    assert (np.diff(costs[:, 1]) < 0.0).all()
    assert np.abs(np.diff(costs[:, 1])).max() < 0.5 * np.ptp(costs[:, 1])  # spread over the front
    session = campaign().session({FORCE.key: (1000.0, 6000.0), MASS.key: (60.0, 100.0)})
    push, mass = (
        x.ravel() for x in np.meshgrid(np.linspace(1000, 2000, 41), [60, 70, 80, 90, 100])
    )
    table = session.run_many(np.column_stack([push, mass]), cases=200)
    most = accepted_violations(campaign().file.requirements[0], 200, tries=5 * MAX_TRIES)
    grid = np.column_stack([push, 100.0 - mass])[table.summary["fast_violations"] <= most]
    better = (grid[:, None] < costs[None] - 0.01 * np.ptp(costs, axis=0)).all(axis=2)
    assert not better.any()
    again = CliRunner().invoke(main, words)
    assert again.exit_code == 2  # nothing is overwritten
    assert "exists" in again.output


@pytest.mark.slow
def test_costs_that_agree_have_one_design():
    result = trade_off(campaign(), [FORCE], ["push", "2 * push"], cases=100)
    assert len(result.table) == 1
    assert risk(result.table[FORCE.key].iloc[0]) < 1.0 - SPEED["probability"]


def test_designs_that_are_not_shown_dominate_none():
    costs = np.array([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0], [1.0, 1.0]])
    assert dominated(costs, np.array([True, True, True, False])).tolist() == [0, 0, 1, 0]
    assert dominated(costs, np.array([True, True, True, True])).tolist() == [1, 1, 1, 0]


def test_a_goal_is_the_largest_term_and_a_sum():
    goal = Goal(np.array([0.1, 0.0]), np.array([0.0, 2.0]), np.array([5.0, 1.0]))
    assert goal.of(np.array([[10.0, 3.0]])) == pytest.approx(1.0 + 2.0 * (3.0 - 1.0))
    assert Goal.weighted([1.0, 3.0]).of(np.array([[2.0, 1.0]])) == pytest.approx(5.0)


def test_wrong_input_is_refused_before_anything_is_run():
    with pytest.raises(InputError, match="has 4 costs: must be 2 to 3"):
        trade_off(campaign(), [FORCE], ["push"] * 4)
    unsure = campaign(SPEED | {"confidence": 0.5})
    with pytest.raises(InputError, match="fewer than 17: the run for the verdict has 4"):
        trade_off(unsure, [FORCE], TWO[:1] * 2, cases=15)
