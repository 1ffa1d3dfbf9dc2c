"""Scenarios: failure cases of a campaign by name."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.scenarios import run_scenarios
from sepmc.cli.app import main
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.read import parse_campaign

WEAK = {"name": "weak", "title": "half the thrust", "set": {"motor.retro.thrust_N": 250.0}}
HEAVY = {"name": "heavy", "set": {"body.upper.mass_lb": 1000.0, "environment.wind.speed_m_s": 0.0}}
ITEM = {
    "name": "speed",
    "metric": "separation_speed_m_s",
    "at_least": 0.38,
    "probability": 0.9,
    "confidence": 0.9,
}


@pytest.fixture(scope="module")
def table2_tree():
    return sepmc.load("table2", {"run.history_step_s": 0.0}).file.tree


def campaign(tree, *scenarios, **more):
    return Campaign(
        parse_campaign(tree | {"scenario": list(scenarios), "requirement": [ITEM]} | more, "t.toml")
    )


def test_a_scenario_differs_in_what_it_sets_alone(table2_tree):
    one = campaign(table2_tree, WEAK, HEAVY)
    weak, heavy = one.scenarios().values()
    cases = [each.case(7).to_dict() for each in (one, weak, heavy)]
    base, changed, other = (
        {item["name"]: item for item in case["motor"]}["retro"] | {"body": case["body"]}
        for case in cases
    )
    assert changed["thrust"] == 250.0 != base["thrust"]
    assert {**changed, "thrust": 0.0} == {**base, "thrust": 0.0}  # the other random numbers stay
    assert other["body"]["upper"]["mass"] == pytest.approx(453.59237)
    assert other["body"]["lower"] == base["body"]["lower"]
    assert other["thrust"] == base["thrust"]


def test_a_scenario_needs_no_kernel_of_its_own(table2_tree):
    from sepmc.campaign.execution.step_selection import kernel_text

    one = campaign(table2_tree, WEAK)
    texts = [kernel_text(each) for each in (one, one.scenarios()["weak"])]
    assert texts[0] == texts[1]


def test_scenarios_change_no_row_of_the_campaign(table2_tree):
    assert campaign(table2_tree, WEAK).digest == campaign(table2_tree).digest


@pytest.mark.slow
def test_results_side_by_side(table2_tree, tmp_path):
    one = campaign(table2_tree, WEAK, HEAVY)
    runs = run_scenarios(one, cases=60, out=tmp_path / "all")
    table = runs.table
    assert list(table["scenario"]) == ["baseline", "weak", "heavy"]
    assert (table["run"] == 60).all()
    speed = {name: r.to_pandas()["separation_speed_m_s"] for name, r in runs.results.items()}
    assert (speed["weak"] < speed["baseline"]).all()
    for name, result in runs.results.items():
        violations = int((speed[name] < ITEM["at_least"]).sum())
        assert int(table.loc[table["scenario"] == name, "violations"].iloc[0]) == violations
        stored = pd.read_parquet(tmp_path / "all" / name / "cases")
        np.testing.assert_array_equal(stored["separation_speed_m_s"], speed[name])
        assert result.status_counts == {"ok": 60}
    again = one.scenarios()["weak"].run(cases=60).to_pandas()
    pd.testing.assert_frame_equal(again, runs.results["weak"].to_pandas())


@pytest.mark.slow
def test_the_command(table2_tree, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.toml").write_text(campaign(table2_tree, WEAK, HEAVY).file.toml)
    words = ["scenarios", "two.toml", "--cases", "40", "--out", "all"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("scenario "))
    assert [line.split()[0] for line in lines[first + 1 :][:3]] == ["baseline", "weak", "heavy"]
    assert (tmp_path / "all" / "weak" / "manifest.json").is_file()
    assert len(pd.read_csv(tmp_path / "all" / "scenarios.csv")) == 3
    assert CliRunner().invoke(main, words).exit_code == 2  # nothing is overwritten
    checked = CliRunner().invoke(main, [*words[:-1], "other", "--check"])
    assert checked.exit_code == 1
    for command in ("stats", "doctor"):
        assert CliRunner().invoke(main, [command, "all/heavy"]).exit_code == 0


def test_a_campaign_without_scenarios_is_refused(table2_tree):
    with pytest.raises(InputError, match="has no scenario"):
        run_scenarios(campaign(table2_tree), cases=2)


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ({"name": "a"}, r"scenario\.a\.set: must be a table"),
        ({"name": "a", "set": {}}, r"scenario\.a\.set: must be a table"),
        ({"name": "1a", "set": {"run.seed": 1}}, r"scenario\.1\.name = '1a'"),
        ({"name": "../a", "set": {"run.seed": 1}}, r"scenario\.1\.name"),
        ({"name": "baseline", "set": {"run.seed": 1}}, "is the campaign itself"),
        ({"name": "weak", "set": {"run.seed": 1}}, "the name is used twice"),
        ({"name": "a", "set": {"run.seed": 1}, "probability": 0.1}, "probability: unknown key"),
        ({"name": "a", "set": {"motor.retr.thrust_N": 1.0}}, r"a\.set\.motor\.retr\.thrust_N"),
        ({"name": "a", "set": {"spring.*.factor": 0.0}}, r"a\.set\.spring\.\*\.factor.*no table"),
        ({"name": "a", "set": {"motor": {"retro": {"thrust_N": 1.0}}}}, "put the path in quotes"),
        ({"name": "a", "set": {"run.seed": 1}, "title": 3}, r"a\.title = 3: must be text"),
    ],
)
def test_wrong_scenarios_are_refused_when_the_file_is_read(table2_tree, scenario, message):
    with pytest.raises(SceneError, match=message):
        campaign(table2_tree, WEAK, scenario)


def test_a_value_that_is_out_of_range_is_refused_before_anything_is_run(table2_tree, tmp_path):
    one = campaign(table2_tree, {"name": "a", "set": {"body.upper.mass_kg": -3.0}})
    with pytest.raises(SceneError, match=r"scenario a: .*mass"):
        run_scenarios(one, cases=2, out=tmp_path / "none")
    assert not (tmp_path / "none").exists()
