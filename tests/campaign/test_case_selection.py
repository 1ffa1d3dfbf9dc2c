"""Which cases are flown: so many, those named, those of a table; no more than it takes."""

import re
import shlex
import time

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.random_scenes.interpreted import run_interpreted
from scipy.special import stdtrit
from small_scenes import SPRUNG
from support.stopping_problems import coverage

import sepmc
from sepmc.analysis.proportions import binomial_interval
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.stopping import parse_stopping_rule
from sepmc.campaign.case_selection import CaseSelection, parse, read
from sepmc.campaign.execution.step_selection import kernel_text
from sepmc.campaign.store.manifests import read_manifest
from sepmc.campaign.store.untrusted import StoreError
from sepmc.cli.app import main
from sepmc.cli.dry_run import _time_per_case
from sepmc.scene.messages import InputError, RunWarning, SceneError

INPUTS = ["in_body_fore_mass_kg", "in_spring_push_force_N"]


@pytest.fixture(autouse=True)
def _plainly():
    with run_interpreted():
        yield


@pytest.fixture
def file(tmp_path):
    """The campaign file of the sprung pair."""
    path = tmp_path / "sprung.toml"
    path.write_text(SPRUNG, encoding="utf-8")
    return path


def call(*words):
    return CliRunner().invoke(main, [str(word) for word in words])


def flown(campaign, *args, **kwargs):
    """The case table of a run."""
    return campaign.run(*args, **kwargs).to_pandas()


def command(*words):
    """Exit code and output of a command."""
    called = CliRunner().invoke(main, [str(word) for word in words])
    assert called.exception is None or isinstance(called.exception, SystemExit), called.output
    return called.exit_code, called.output


@settings(deadline=None)
@given(st.sets(st.integers(0, 60), min_size=1), st.sets(st.integers(0, 70)), st.integers(1, 9))
def test_numbers_are_a_set(numbers, others, size):
    """Ranges behave as the set of the numbers that they stand for, and as text they come back."""
    result, excluded = CaseSelection.of(numbers), np.array(sorted(others), dtype=np.int64)
    assert [i for a, b in result.ranges for i in range(a, b)] == sorted(numbers)
    assert all(b < c for (_, b), (c, _) in zip(result.ranges, result.ranges[1:], strict=False))
    assert (result.count, result.end) == (len(numbers), max(numbers) + 1)
    assert result.are_first == (numbers == set(range(len(numbers))))
    left = result.without(excluded)
    assert [i for a, b in left.split(size) for i in range(a, b)] == sorted(numbers - others)
    assert all(0 < b - a <= size for a, b in left.split(size))
    assert result.omits(excluded) == bool(others - numbers)
    assert result.count_common(CaseSelection.of(others)) == len(numbers & others)
    assert [i in result for i in range(75)] == [i in numbers for i in range(75)]
    assert parse(str(result)) == read(str(result)) == read(f"{result},{result}") == result


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("1e4", 10_000),
        (" 300 ", 300),
        ("25:28,73", CaseSelection(((25, 28), (73, 74)))),
        ("5,3,4", CaseSelection(((3, 6),))),
        ("7:900000000,0:9,3", CaseSelection(((0, 900_000_000),))),  # and takes no memory
        ("7,", None),
        ("4:4", None),
        ("-3", None),
        ("1.5", None),
        ("1e10", None),
        ("a:b", None),
        ("1:2:3", None),
        ("0", None),
    ],
)
def test_cases_as_text(text, result):
    """What the command line takes, and what it refuses."""
    if result is not None:
        assert read(text) == result
    else:
        with pytest.raises(InputError, match="cases = "):
            read(text)


@pytest.mark.parametrize("sampler", ["random", "lhs", "sobol"])
def test_some_cases_are_those_of_the_whole(file, sampler, tmp_path):
    """Named cases fly as they do among all, whatever draws them; the folder says which they are,
    goes on with others, replays only what it holds."""
    campaign = sepmc.load(file, {"run.sampler": sampler})
    every, folder = flown(campaign), tmp_path / "run"
    some = campaign.run("3:5,9", out=folder)
    assert flown(campaign, [9, 3, 4]).equals(some.to_pandas())
    pd.testing.assert_frame_equal(some.to_pandas(), every.loc[[3, 4, 9]])
    assert some.case(9).inputs == campaign.case(9).inputs
    with pytest.raises(InputError, match="case = 5: must be one of those run, 3:5,9"):
        some.case(5)
    manifest = read_manifest(folder)
    assert (manifest["cases"], manifest["numbers"], manifest["of"]) == (3, "3:5,9", 12)
    with pytest.raises(StoreError, match="would leave some out"):
        campaign.run("3:5", out=folder, resume=True)
    pd.testing.assert_frame_equal(flown(campaign, None, out=folder, resume=True), every)
    assert "numbers" not in read_manifest(folder)


def test_statistics_of_named_cases_continue_with_these_only(file, tmp_path):
    """Rows are not stored, so that another selection cannot have these cases out or others in; the
    error names the selection that can be continued."""
    campaign, folder = sepmc.load(file), tmp_path / "run"
    campaign.run("3:5,9", out=folder, stats_only=True)
    for other in ("3:6,9", "3:5"):
        with pytest.raises(StoreError, match=re.escape("continue with cases=3:5,9, or give")):
            campaign.run(other, out=folder, stats_only=True, resume=True)
    campaign.run("3:5,9", out=folder, stats_only=True, resume=True)
    assert read_manifest(folder)["numbers"] == "3:5,9"


def _as_earlier_versions(selection):
    """Text of a selection in manifests of earlier versions: that of one case is its number."""
    return ",".join(str(a) if b == a + 1 else f"{a}:{b}" for a, b in selection.ranges)


@pytest.mark.slow
@pytest.mark.parametrize("stats_only", [False, True])
@pytest.mark.parametrize("earlier", [False, True])
@pytest.mark.parametrize("number", [0, 7])
def test_a_run_of_one_case_is_that_case(file, tmp_path, monkeypatch, number, earlier, stats_only):
    """A folder of one case reopens, resumes, replays and is repaired as that case, not as a number
    of cases, also if an earlier version wrote it."""
    folder, of_folder = tmp_path / "run", tmp_path / "run" / "case"
    with monkeypatch.context() as patched:
        if earlier:
            patched.setattr(CaseSelection, "__str__", _as_earlier_versions)
        sepmc.load(file).run([number], out=folder, stats_only=stats_only)
    one = CaseSelection.of([number])
    assert parse(read_manifest(folder)["numbers"]) == one
    again = sepmc.load(folder).run(out=folder, resume=True)
    assert (again.numbers, again.resumed) == (one, 1)
    code, message = command("campaign", folder, "--out", folder, "--resume", "--no-plots")
    assert (code, read_manifest(folder)["cases"]) == (0, 1), message
    assert command("doctor", folder)[0] == 0
    for damaged in folder.glob("*/part-*.parquet"):
        damaged.unlink()
    code, message = command("doctor", folder, "--repair")
    assert (code, read_manifest(folder)["cases"]) == (0, 1), message
    if stats_only:
        return
    code, message = command("compare", folder, folder)
    assert (code, "cases:" in message) == (0, False), message
    assert sepmc.open(folder).numbers == one
    assert sepmc.open(folder).to_pandas().index.tolist() == [number]
    code, message = command("replay", folder, "--case", number, "--out", of_folder, "--no-plots")
    assert code == 0, message
    code, message = command("replay", folder, "--case", 3)
    assert (code, f"contains cases {one}; --case 3 is none" in message) == (2, True), message
    assert command("report", folder)[0] == 0


def test_figures_of_cases_far_down(file, tmp_path):
    """Cases with large numbers alone have their bands, too."""
    text = SPRUNG.replace("cases = 12", "history_step_s = 0.1")
    file.write_text(text, encoding="utf-8")
    folder = tmp_path / "run"
    code, message = command("campaign", file, "--cases", "30000:30004", "--out", folder)
    assert (code, (folder / "separation_speed.png").is_file()) == (0, True), message


def test_a_hypercube_has_no_other_cases(file):
    """Cases beyond a Latin hypercube are refused."""
    campaign = sepmc.load(file, {"run.sampler": "lhs"})
    with pytest.raises(InputError, match="cases = 10:14: 2 of them are not among 0:12"):
        campaign.run("10:14")


def test_a_part_of_a_hypercube_is_told_from_a_smaller_one(file):
    """A range takes cases of the file's design; a number of cases makes a design of its own."""
    campaign = sepmc.load(file, {"run.sampler": "lhs"})
    message = "cases 0:4 are a part of a design of 12 cases"
    assert any(message in note for note in campaign.run("0:4").notes)
    assert not any("a part of a design" in note for note in campaign.run(4).notes)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_plan_is_flown_exactly(file, tmp_path, ending):
    """A table that ``sample`` writes gives all inputs to the last bit, whatever the laws of the
    file now say; its run folder replays, resumes and is refused to another plan."""
    table, folder = tmp_path / f"plan.{ending}", tmp_path / "run"
    code, message = command("sample", file, "--cases", "2:6,9", "--out", table)
    assert (code, "5 cases, 2 inputs" in message) == (0, True), message
    assert command("sample", file, "--out", table)[0] == 2  # is not overwritten
    drawn = sepmc.load(file)
    other = {"run.samples": str(table), "dispersion": {"body.fore.mass_kg": {"constant": 3.0}}}
    other["dispersion"]["spring.push.force_N"] = {"uniform": [1.0, 2.0]}
    result = sepmc.load(file, other).run(out=folder)
    rows = result.to_pandas()
    expected = flown(drawn, "2:6,9")
    assert rows[["case", *INPUTS]].equals(expected[["case", *INPUTS]])
    pd.testing.assert_frame_equal(rows, expected, rtol=1e-9, atol=1e-12)
    table.unlink()  # the folder holds its own
    again = sepmc.load(folder)
    assert again.digest == result.campaign.digest
    assert again.case(9).inputs == drawn.case(9).inputs
    with pytest.raises(InputError, match=r"case = 7: no such case in samples\.parquet"):
        again.case(7)
    assert again.run(out=folder, resume=True).resumed == 5
    changed = pd.read_parquet(folder / "samples.parquet")
    changed.loc[0, INPUTS[0]] += 1e-9
    changed.to_parquet(tmp_path / "changed.parquet")
    with pytest.raises(
        StoreError, match=r"another campaign.* It differs in .*; rows of run\.samples"
    ):
        again.with_settings({"run.samples": str(tmp_path / "changed.parquet")}).run(
            out=folder, resume=True
        )


def test_columns_of_an_upstream_campaign(file, tmp_path):
    """A column of any name gives an input, row by row, in the unit of the key; what the table does
    not give is drawn; what it holds besides is left alone."""
    upstream = tmp_path / "trajectories.csv"
    speeds = np.linspace(10.0, 20.0, 40)
    pd.DataFrame({"V_sep": speeds, "note": ["x"] * 40, "h": 1.0}).to_csv(upstream, index=False)
    text = SPRUNG.replace(
        "[dispersion]", '[dispersion]\n"initial.speed_m_s" = { column = "V_sep" }'
    )
    file.write_text(text.replace("cases = 12", 'samples = "trajectories.csv"'), encoding="utf-8")
    campaign = sepmc.load(file)
    rows = flown(campaign)
    assert rows["in_initial_speed_m_s"].tolist() == speeds.tolist()
    drawn = sepmc.load(
        file,
        {
            "dispersion": {
                "body.fore.mass_kg": {"uniform": 0.5},
                "initial.speed_m_s": {"column": "V_sep"},
            }
        },
    )
    assert flown(drawn, 5)[INPUTS[0]].equals(rows[INPUTS[0]][:5])
    assert "column V_sep of run.samples (10, 20)" in campaign.input_columns[0].meaning
    assert campaign.file.dispersions[0].distribution == "given"  # trial cases: over all its range
    assert campaign.file.dispersions[0].support == (10.0, 20.0)


@pytest.mark.parametrize(
    ("table", "law", "message"),
    [
        ({"V": [1.0, -1.0]}, "V", "the distribution reaches -1, but the value must be >= 0"),
        ({"V": [1.0, np.nan]}, "V", "column V of plan.csv is no number in case 1"),
        ({"V": ["fast", "slow"]}, "V", "'fast' in case 0 is no number"),
        ({"V": [1.0, 2.0], "in_body_fore_mass_kg": [3.0, "x"]}, "V", "'x' in case 1 is no number"),
        ({"V": ["1.0", "2.0", "3,5"]}, "V", "column V of plan.csv: '3,5' in case 2 is no number"),
        ({"case": [10**12], "V": [1.0]}, "V", "whole numbers from 0 to 999999999"),
        ({"V": [1.0, 2.0]}, "W", "no such column of numbers in plan.csv; did you mean|known here"),
        ({"case": [0, 0], "V": [1.0, 2.0]}, "V", "column case: contains a case number twice"),
        (
            {"case": [0.5, 1], "V": [1.0, 2.0]},
            "V",
            "column case = '0.5': must contain whole numbers",
        ),
        ({"V": [1.0], "in_body_fore_mas_kg": [1.0]}, "V", "no such input here: did you mean"),
        ({"V": [1.0], "body.fore.mass_kg": [3.0]}, "V", "must be called in_body_fore_mass_kg"),
        ({"V": [1.0], "IN_Body_fore_mass_kg": [3.0]}, "V", "must be called in_body_fore_mass_kg"),
        ({"V": [1.0], "body_fore_mass_kg": ["x"]}, "V", "must be called in_body_fore_mass_kg"),
        ({"V": [1.0], "Case": [5]}, "V", "column Case: no such column; it must be called case"),
        ({"V": []}, "V", "has no rows"),
    ],
)
def test_plans_that_cannot_be(file, tmp_path, table, law, message):
    """What is wrong with a table is told with its place, before anything is flown."""
    pd.DataFrame(table).to_csv(tmp_path / "plan.csv", index=False)
    text = SPRUNG.replace(
        "[dispersion]", f'[dispersion]\n"initial.speed_m_s" = {{ column = "{law}" }}'
    )
    file.write_text(text.replace("cases = 12", 'samples = "plan.csv"'), encoding="utf-8")
    with pytest.raises(SceneError, match=message):
        sepmc.load(file)


def test_a_plan_meets_correlations(file, tmp_path):
    """Parameters that a table gives vary together as they do there; to correlate one of them with
    another that is drawn is refused."""
    together = {
        "correlation": [
            {"parameters": ["body.fore.mass_kg", "spring.push.force_N"], "coefficient": 0.9}
        ]
    }
    table = tmp_path / "plan.csv"
    pd.DataFrame({INPUTS[0]: [3.0, 3.1]}).to_csv(table, index=False)
    with pytest.raises(SceneError, match=r"mass_kg'?: is given by run\.samples, unlike the others"):
        sepmc.load(file, {"run.samples": str(table), **together})
    pd.DataFrame({INPUTS[0]: [3.0, 3.1], INPUTS[1]: [30.0, 29.0]}).to_csv(table, index=False)
    assert flown(sepmc.load(file, {"run.samples": str(table), **together}))[INPUTS[1]].tolist() == [
        30.0,
        29.0,
    ]


@pytest.mark.slow
def test_until_a_statistic_is_known(file, tmp_path, monkeypatch):
    """A campaign ends with the first 64, 128, ... cases (2,048 and so on as it comes) whose
    interval is narrow enough, as the first cases of the whole, and says so."""
    monkeypatch.setattr("sepmc.analysis.stopping._FIRST_LOOK_OF_MOMENTS", 64)
    campaign = sepmc.load(file)
    row = campaign.run(128).statistics().loc["separation_speed_m_s"]
    looks = 3  # at 64, 128 and 200 cases
    half = stdtrit(127, 1.0 - 0.025 / looks) * row["mean_se"]
    result = campaign.run(200, out=tmp_path / "run", until=f"separation_speed_m_s:{half * 1.01}")
    assert result.numbers.count == 128
    assert result.to_pandas().equals(flown(campaign, 128))
    manifest = read_manifest(tmp_path / "run")
    assert manifest["until"].startswith(
        "after 128 of 200 cases the mean of separation_speed_m_s is"
    )
    assert not [note for note in result.notes if note.startswith("after")]
    assert (
        manifest["cases"],
        manifest["complete"],
        sepmc.load(tmp_path / "run").scene.run.cases,
    ) == (
        128,
        True,
        128,
    )
    short = campaign.run(20, until="separation_speed_m_s.p95:1e-9", stats_only=True)
    assert (short.numbers.count, short.notes[-1].endswith("NOT MET")) == (20, True)


def test_intervals_that_until_looks_at():
    """Of the mean by Student's law, of order statistics, and of Clopper and Pearson, of which the
    longer side is to be short enough."""
    x = np.random.default_rng(3).normal(2.0, 0.1, 400)
    rows = {"case": np.arange(400), "status": np.full(400, "ok", dtype=object), "speed_m_s": x}
    summary, names = TableStatistics(rows, ["speed_m_s"], [], {}), ["speed_m_s"]
    row = summary.statistics().loc["speed_m_s"]
    half = stdtrit(399, 0.975) * row["mean_se"]
    assert parse_stopping_rule("speed_m_s:1", names).interval(summary) == pytest.approx(
        (row["mean"], row["mean"] - half, row["mean"] + half)
    )
    result = parse_stopping_rule("speed_m_s.p95:1%", names)
    assert (result.tolerance, result.relative) == (0.01, True)
    assert result.interval(summary) == (row["p95"], row["p95_low"], row["p95_high"])
    ends = binomial_interval(0, 400)
    for tolerance, enough in ((0.99 * ends[1], False), (1.01 * ends[1], True)):
        result = parse_stopping_rule(f"never-released:{tolerance}", names)
        assert result.interval(summary) == (0.0, *ends)
        assert result.is_met(*result.interval(summary)) == enough


def test_a_mean_is_not_known_before_a_rare_value_occurred(file):
    """What a discrete distribution gives a probability must occur before a mean is stated: if the
    cases are too few for that, it is refused before any is flown; a percentile needs no such."""
    text = file.read_text(encoding="utf-8")
    at = "[dispersion]\n"
    law = '"spring.push.factor" = { discrete = [1.0, 0.5], weights = [0.9999, 0.0001] }\n'
    file.write_text(text.replace(at, at + law), encoding="utf-8")
    campaign = sepmc.load(file)
    message = r"push\.factor = 0\.5 \(probability 0\.0001\) occurs 10 times, in about 100,000 cases"
    with pytest.raises(InputError, match=message):
        campaign.run(4000, until="separation_speed_m_s:10%")
    with pytest.warns(RunWarning, match=r"push\.factor = 0\.5 .* occurred in 0 of 256 cases"):
        campaign.run(300, until="separation_speed_m_s.p50:10%", stats_only=True)


@pytest.mark.parametrize("name", ["a rare failure decides the mean", "two failures that correlate"])
def test_until_holds_what_it_states(name):
    """Where a rare value decides the mean, the interval at the end holds the true one: in 20 of 20
    seeds, of which intervals of 95 % miss more than five with a probability below 1e-3."""
    assert coverage(name, 20)[0] >= 0.75


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("separation_speed_m_s", "must be METRIC:TOLERANCE"),
        ("separation_speed_m_s:-1", "must be METRIC:TOLERANCE"),
        ("separation_sped_m_s:1", "did you mean 'separation_speed_m_s'"),
        ("separation_speed_m_s.p98:1", "no such statistic as 'p98'; allowed: mean, sigma"),
        ("never-released.mean:1", "no such statistic as 'mean'; allowed: share"),
    ],
)
def test_what_until_refuses(file, text, message):
    """What cannot be asked for is told before anything is flown."""
    with pytest.raises(InputError, match=message):
        sepmc.load(file).run(4, until=text)


def test_dry_run_names_a_command_that_compiles(file, tmp_path, monkeypatch):
    """The file as it was given, what was set and the table, so that the command can be copied."""
    table, reported = tmp_path / "plan.csv", {}
    assert call("sample", file, "--cases", 3, "--out", table).exit_code == 0
    more = ["--set", "run.end_time_s=0.2", "--samples", table, "--stats-only"]
    monkeypatch.setattr(
        "sepmc.campaign.execution.step_selection.units_to_compile", lambda text: (1, 2)
    )
    monkeypatch.setattr(
        "sepmc.engine.dispatch.load_kernel", lambda text, say: reported.update(text=text)
    )
    dry = call("campaign", file, *more, "--dry-run")
    assert dry.exit_code == 0, dry.output
    (line,) = [one for one in dry.output.splitlines() if "sepmc compile" in one]
    program, *words = shlex.split(line.partition("compiled: ")[2])
    assert program == "sepmc"
    called = call(*words)
    assert called.exit_code == 0, called.output
    campaign = sepmc.load(file, {"run.end_time_s": 0.2, "run.samples": str(table)})
    assert reported["text"] == kernel_text(campaign, history=False)


def test_dry_run_writes_nothing(file, tmp_path):
    """A dry run says how many cases would go where, and leaves no folder."""
    folder = tmp_path / "run"
    code, message = command("campaign", file, "--cases", "1e3", "--out", folder, "--dry-run")
    assert (code, folder.exists()) == (0, False), message
    assert "sprung: 1000 cases, seed 4, sampler random" in message
    assert "2 inputs" in message
    one = command("campaign", file, "--cases", "1", "--out", folder, "--dry-run")[1]
    assert "sprung: 1 case, seed 4" in one
    assert "1 cases" not in one
    folder.mkdir()
    (folder / "mine").write_text("x", encoding="utf-8")
    for more in (["--out", folder], ["--until", "separation_speed_m_s:0"]):
        assert command("campaign", file, "--dry-run", *more)[0] == 2


@pytest.mark.parametrize("setting", ["run.samples", "run"])
def test_a_table_set_relative_to_the_working_folder_is_found(file, tmp_path, monkeypatch, setting):
    """As any other file of a setting, unless one of that name lies beside the campaign."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    value = "some.csv" if setting == "run.samples" else {"end_time_s": 0.2, "samples": "some.csv"}
    assert call("sample", file, "--cases", 3, "--out", "some.csv").exit_code == 0
    assert sepmc.load(file, {setting: value}).numbers.count == 3
    assert call("sample", file, "--cases", 4, "--out", tmp_path / "some.csv").exit_code == 0
    assert sepmc.load(file, {setting: value}).numbers.count == 4


@pytest.mark.parametrize(("cases", "measured"), [("5:6", 1), ("5,100:103", 3)])
def test_a_dry_run_measures_the_longest_range(file, monkeypatch, cases, measured):
    """Also if that, or the first one, is a single case."""
    monkeypatch.setattr(
        "sepmc.campaign.execution.integration.integrate", lambda *args: time.sleep(0.01)
    )
    campaign, selection = sepmc.load(file), parse(cases)
    case_s, count = _time_per_case(campaign, None, selection, 4, selection.end, [])
    assert count == measured
    assert count * case_s >= 0.01


def test_the_earlier_name_of_the_sample_table_is_answered_with_the_new_one(file):
    with pytest.raises(SceneError, match=r"run\.plan.*'samples'"):
        sepmc.load(file, {"run.plan": "table.csv"})


SPEED = '[dispersion]\n"initial.speed_m_s" = { column = "V" }'


def load_text(file, tmp_path, text):
    (tmp_path / "plan.csv").write_text(text, encoding="utf-8")
    written = SPRUNG.replace("[dispersion]", SPEED)
    file.write_text(written.replace("cases = 12", 'samples = "plan.csv"'), encoding="utf-8")
    return sepmc.load(file)


@pytest.mark.parametrize(
    "text",
    [
        "V;h\n10;1\n20;2\n",
        "V\th\n10\t1\n20\t2\n",
        "# from upstream\n# two cases\nV,h\n10,1\n20,2\n",
        "\ufeff# from upstream\n\nV;h\n10;1\n20;2\n",
    ],
    ids=["semicolons", "tabs", "comments", "comments and semicolons"],
)
def test_tables_of_other_programs(file, tmp_path, text):
    """Separators and comment lines as other programs write them."""
    campaign = load_text(file, tmp_path, text)
    assert campaign.file.input_table.columns["V"].tolist() == [10.0, 20.0]
    assert campaign.numbers.count == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("V,h\n10,1\n20,2\n,3\n", "column V of plan.csv is no number in case 2, line 4"),
        ("# a\n\nV;h\n10;1\n;2\n", "column V of plan.csv is no number in case 1, line 5"),
        ("case,V\n1,10\n0,\n", "column V of plan.csv is no number in case 0, line 3"),
        ("V;h\n10;1\n20,5;2\n", "line 3: 20,5 has a decimal comma; write it with a point, 20.5"),
    ],
)
def test_cells_that_are_no_numbers(file, tmp_path, text, message):
    """With the line of the file."""
    with pytest.raises(SceneError) as caught:
        load_text(file, tmp_path, text)
    assert message in str(caught.value)
