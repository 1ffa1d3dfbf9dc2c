"""Scenarios: failure cases of a campaign by name."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.scenarios import run_scenarios
from sepmc.campaign.store.untrusted import StoreError
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
    own = {"scenario": list(scenarios), "requirement": [ITEM]}
    return Campaign(parse_campaign(tree | own | more, "t.toml"))


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


def inputs(one, count=4):
    names = [column.name for column in one.input_columns]
    return pd.DataFrame(one.sample(0, count), columns=names)


def changed(one):
    """Values of the inputs that differ between the campaign and its only scenario."""
    (scenario,) = one.scenarios().values()
    base, other = inputs(one), inputs(scenario)
    return {name: set(other[name]) for name in base if not base[name].equals(other[name])}


def test_a_component_of_a_vector_that_is_set_is_constant(table2_tree):
    laws = {f"body.upper.cg_mm.{axis}": {"uniform": 3.0} for axis in "xyz"}
    one = campaign(
        table2_tree,
        {"name": "aside", "set": {"body.upper.cg_m": [1.3, 0.01, -0.02]}},
        dispersion=table2_tree["dispersion"] | laws,
    )
    assert changed(one) == {
        "in_body_upper_cg_x_mm": {1300.0},
        "in_body_upper_cg_y_mm": {10.0},
        "in_body_upper_cg_z_mm": {-20.0},
    }


@pytest.mark.parametrize("sampler", ["random", "lhs", "sobol"])
def test_correlated_parameters_keep_their_numbers(table2_tree, sampler):
    names = ["motor.retro.thrust_N", "body.upper.mass_kg", "body.lower.mass_kg"]
    laws = {name: {"normal": 0.02, "relative": True} for name in names}
    together = [{"parameters": names, "coefficient": 0.7}]
    run = table2_tree["run"] | {"sampler": sampler}
    more = {"dispersion": laws, "correlation": together, "run": run}
    assert changed(campaign(table2_tree, WEAK, **more)) == {"in_motor_retro_thrust_N": {250.0}}


def test_a_value_that_samples_give_cannot_be_set(table2_tree, tmp_path):
    one = campaign(table2_tree, {"name": "light", "set": {"body.upper.mass_kg": 400.0}})
    inputs(one).to_csv(tmp_path / "samples.csv", index=False)
    (tmp_path / "two.toml").write_text(one.file.toml)
    taken = sepmc.load(str(tmp_path / "two.toml"), {"run.samples": "samples.csv"})
    with pytest.raises(SceneError, match=r"upper\.mass_kg: is given by column in_body_upper_mass"):
        taken.scenarios()


def test_a_scenario_may_change_a_distribution(table2_tree):
    wide = {"name": "wide", "set": {"dispersion.body.upper.mass_kg": {"uniform": [300, 400]}}}
    ((name, values),) = changed(campaign(table2_tree, wide)).items()
    assert name == "in_body_upper_mass_kg"
    assert all(300.0 <= value <= 400.0 for value in values)


def test_check_reports_scenarios_and_those_that_are_not_valid(table2_tree, tmp_path):
    light = {"name": "light", "set": {"body.upper.mass_kg": 400.0}}
    path = tmp_path / "two.toml"
    path.write_text(campaign(table2_tree, light).file.toml)
    result = CliRunner().invoke(main, ["check", str(path), "--no-flight"])
    assert "  scenario     light: body.upper.mass_kg = 400.0" in result.stdout
    light["set"]["body.upper.mass_kg"] = -1.0
    path.write_text(campaign(table2_tree, light).file.toml)
    result = CliRunner().invoke(main, ["check", str(path), "--no-flight"])
    assert result.exit_code == 2
    assert "scenario light: body.upper.mass_kg = -1" in result.stderr


@pytest.mark.slow
def test_the_screen_with_requirements_that_a_scenario_changes(table2_tree, tmp_path):
    bare = {"name": "bare", "set": {"requirement": []}}
    loose = {"name": "loose", "set": {"requirement.speed.at_least": 0.1}}
    (tmp_path / "two.toml").write_text(campaign(table2_tree, bare, loose).file.toml)
    words = ["scenarios", str(tmp_path / "two.toml"), "--cases", "3", "--out"]
    result = CliRunner().invoke(main, [*words, str(tmp_path / "all")])
    assert result.exit_code == 0, result.output
    assert "loose: speed: separation_speed_m_s >= 0.1 m/s" in result.stdout
    (row,) = [line for line in result.stdout.splitlines() if line.startswith("bare ")]
    assert row.split() == ["bare", "3", "3", "-"]
    checked = CliRunner().invoke(main, [*words, str(tmp_path / "again"), "--check", "--quiet"])
    assert checked.exit_code == 1
    (message,) = checked.stderr.splitlines()
    assert message.startswith("error: --check: not every requirement is shown: baseline: speed NOT")
    assert "; bare: has no requirement, so no verdict; " in message


@pytest.mark.slow
def test_the_screen_without_requirements(table2_tree, tmp_path):
    (tmp_path / "two.toml").write_text(campaign(table2_tree, WEAK, requirement=[]).file.toml)
    words = ["scenarios", str(tmp_path / "two.toml"), "--cases", "3", "--out"]
    result = CliRunner().invoke(main, [*words, str(tmp_path / "all")])
    assert result.exit_code == 0, result.output
    lines = [line.split() for line in result.stdout.splitlines()]
    first = lines.index(["scenario", "cases", "ok", "not", "ok"])
    assert lines[first + 1 : first + 3] == [["baseline", "3", "3"], ["weak", "3", "3"]]


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


def test_a_folder_of_something_else_is_not_to_be_resumed(table2_tree, tmp_path, monkeypatch):
    """Only options that the command has, and that help, are advised."""
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text(campaign(table2_tree, WEAK).file.toml, encoding="utf-8")
    Path("mine").mkdir()
    result = CliRunner().invoke(main, ["scenarios", "two.toml", "--cases", "4", "--out", "mine"])
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.endswith("mine: exists; choose another --out\n")


@pytest.mark.slow
def test_an_interrupted_command_is_resumed(table2_tree, tmp_path, monkeypatch):
    """The second scenario was begun and the third not: all end with the rows of a whole run."""
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text(campaign(table2_tree, WEAK, HEAVY).file.toml, encoding="utf-8")
    words = ["scenarios", "two.toml", "--cases", "40", "--out"]
    assert CliRunner().invoke(main, [*words, "whole"]).exit_code == 0
    names = sorted(path.name for path in Path("whole").iterdir() if path.is_dir())
    shutil.copytree("whole/baseline", "cut/baseline")
    begun = sepmc.load("two.toml").scenarios()[names[-1]]
    begun.run(cases=10, out=Path("cut", names[-1]))
    result = CliRunner().invoke(main, [*words, "cut", "--resume"])
    assert result.exit_code == 0, result.output
    for name in names:
        one, other = (pd.read_parquet(f"{folder}/{name}/cases") for folder in ("whole", "cut"))
        pd.testing.assert_frame_equal(one, other, check_exact=True)
    again = CliRunner().invoke(main, [*words, "cut"])
    assert "cut: exists; add --resume to run its missing cases, or choose another" in again.output
    nothing = CliRunner().invoke(main, [*words, "none", "--resume"])
    assert "has no run of the scenarios to resume" in nothing.output
    unnamed = CliRunner().invoke(main, [*words[:-1], "--resume"])
    assert "--resume needs --out" in unnamed.output


def test_scenarios_of_another_seed_or_campaign_advise_another_folder(table2_tree, tmp_path):
    """And not to overwrite, which neither the command nor the function can."""
    one, out = campaign(table2_tree, WEAK), tmp_path / "runs"
    (tmp_path / "one.toml").write_text(one.file.toml, encoding="utf-8")
    with run_interpreted(cases=1):
        one.run(cases=1, out=out / "baseline")
    words = ["scenarios", tmp_path / "one.toml", "--cases", 1, "--out", out, "--resume"]
    for more in (["--seed", 5], ["--set", "run.end_time_s=1.0"]):
        result = CliRunner().invoke(main, [str(word) for word in (*words, *more)])
        assert result.exit_code == 2
        assert "cannot be continued; use another --out" in result.stderr
    with pytest.raises(StoreError, match="cannot be continued; use another out"):
        run_scenarios(one, 1, 5, out=out, resume=True)


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
        ({"name": "baseline", "set": {"run.seed": 1}}, "names the campaign itself"),
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
