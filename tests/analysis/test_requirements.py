"""Verdicts on requirements: from rows and as rows pass by, what violates, what is in doubt, what is
shown; in files, on the screen and as an exit code."""

import json
import math

import numpy as np
import pandas as pd
import pytest
import tomli_w
from click.testing import CliRunner
from oracles.random_scenes.interpreted import run_interpreted

import sepmc
from sepmc.analysis import requirements
from sepmc.analysis.proportions import binomial_interval
from sepmc.analysis.requirements import FAIL, NONE, NOT_SHOWN, PASS, RequirementCounter
from sepmc.analysis.requirements_text import render_verdicts
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.streaming import StreamingStatistics
from sepmc.cli import app
from sepmc.scene.messages import SceneError
from sepmc.scene.model import Requirement
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status

CLEAR = Requirement(name="clear", metric="gap_mm", at_least=5.0, probability=0.99, confidence=0.9)


def verdict(values, requirement=CLEAR, statuses=None, error=1e-9, audit=None):
    """The verdict on outcomes (n,), from rows; the same as they pass by."""
    count = len(values)
    labels = np.array(["ok"] * count if statuses is None else statuses, dtype=object)
    table = {"case": np.arange(count), "status": labels, "gap_mm": np.asarray(values, float)}
    table["energy_residual"] = np.zeros(count) if audit is None else audit
    parts = ["gap_mm"], ["energy_residual"], {"energy_residual": 1e-8}, [requirement]
    rows, stream = TableStatistics(table, *parts), StreamingStatistics(*parts)
    codes = {status.label: int(status) for status in Status}
    columns = np.array([table["gap_mm"], table["energy_residual"]])
    for first in range(0, count, 7):
        some = slice(first, first + 7)
        stream.add(
            table["case"][some], np.array([codes[x] for x in labels[some]]), columns[:, some]
        )
    collected = []
    for summary in (rows, stream):  # cases of the stream wait in its buffer
        collected += summary.verdicts({"gap_mm": (error, 1.0)}, rows.audit())
    assert collected[0] == collected[1]
    pd.testing.assert_frame_equal(rows.audit(), stream.audit())
    return collected[0]


@pytest.mark.parametrize(
    ("violations", "count", "message", "allowed", "more"),
    [
        (0, 230, PASS, 0, 0),  # 230 cases show 99 % with 90 %, 388 do in spite of one violation
        (0, 229, NOT_SHOWN, -1, 1),
        (1, 387, NOT_SHOWN, 0, 1),
        (1, 388, PASS, 1, 0),
        (9, 388, FAIL, 1, None),
        (3, 20, FAIL, -1, None),
        (1, 10, FAIL, -1, None),  # as improbable as 10 %, to the last bit or so
        (1, 11, NOT_SHOWN, -1, 377),
    ],
)
def test_verdicts(violations, count, message, allowed, more):
    values = np.linspace(6.0, 9.0, count)
    values[:violations] = 4.0
    result = verdict(values)
    assert (result.verdict, result.violations, result.cases, result.allowed) == (
        message,
        violations,
        count,
        allowed,
    )
    assert more is None or result.more == more


def test_consumer_risk_of_a_just_insufficient_system():
    """1 % violate; 1,000 campaigns of 400 cases: at most 10 % pass, and two standard errors."""
    random, passed = np.random.default_rng(4), 0
    for _ in range(1000):
        tally = requirements.RequirementCounter(CLEAR)
        values = np.where(random.random(400) < 0.01, 4.0, 6.0)
        tally.add(np.arange(400), np.ones(400, dtype=bool), values, np.zeros(400, dtype=bool))
        passed += requirements.judge(tally, {"gap_mm": (0.0, 1.0)}, math.nan).verdict == PASS
    assert 0 < passed / 1000.0 <= 0.1 + 2.0 * math.sqrt(0.09 / 1000.0)


def test_unknown_cases_violate():
    """One was lost, one has no gap: of 230 none may."""
    values = np.full(232, 6.0)
    values[3] = math.nan
    result = verdict(values, statuses=["ok"] * 100 + ["unresolved"] + ["ok"] * 131)
    assert (result.violations, result.missing, result.verdict) == (2, 2, NOT_SHOWN)
    assert (result.worst, result.worst_case, result.first_missing) == (6.0, 0, 3)
    assert "worst of the others 6.000 (case 0)" in render_verdicts([result], {})


def test_worst_case_of_a_yes_or_no_outcome():
    """The first that is known to violate, or else the first of which nothing is known; none if all
    hold. No value is the worst."""

    def found(values, ok):
        tally = RequirementCounter(Requirement(name="clean", metric="gap_recontact", at_most=0.0))
        ok, values = np.array(ok), np.array(values)
        for k in range(len(values)):
            tally.add(np.array([10 + k]), ok[[k]], values[[k]], np.zeros(1, dtype=bool))
        judged = requirements.judge(tally, {}, math.nan)
        return judged.worst, judged.worst_case, judged.violations

    nan = math.nan
    assert found([0.0, nan, 0.0, 1.0, 1.0], [True, False, True, True, True]) == (None, 13, 3)
    assert found([0.0, 0.0, nan, nan], [True, True, False, False]) == (None, 12, 2)
    assert found([0.0, 0.0], [True, True]) == (None, None, 0)


def test_unknown_cases_refute_nothing():
    """Cases that were lost neither show a requirement nor that it fails; two that violate do."""
    statuses = ["unresolved"] * 30 + ["ok"] * 20
    values = np.full(50, 6.0)
    result = verdict(values, statuses=statuses)
    assert (result.violations, result.missing, result.verdict) == (30, 30, NOT_SHOWN)
    assert (result.share_low, result.share_at_least) == (0.0, 0.0)
    values[[40, 41, 42]] = 4.0
    assert verdict(values, statuses=statuses).verdict == FAIL
    lost = verdict(values, statuses=["unresolved"] * 50)
    assert (lost.verdict, lost.why) == (NONE, "no case finished with this outcome")
    assert (lost.worst, lost.worst_case) == (None, 0)


def test_many_cases_at_the_bound():
    """Most outcomes are the bound itself, to round-off; what lies far beyond it decides."""
    item = Requirement(name="x", metric="gap_mm", at_least=100.0, probability=0.9999)
    values = np.full(5000, 100.0)
    values[:230] = 90.0
    assert verdict(values, item, error=1e-8).verdict == FAIL
    values[:230] = 100.0
    assert verdict(values, item, error=1e-8).verdict == NONE


def test_a_status_that_must_not_occur():
    item = Requirement(name="released", metric="never-released", probability=0.9, confidence=0.5)
    statuses = ["ok"] * 50 + ["never-released"] * 2 + ["unresolved"]
    result = verdict(np.full(53, math.nan), item, statuses)
    # what became of the lost one is not known
    assert (result.violations, result.missing, result.verdict) == (3, 1, PASS)
    assert (result.worst, result.worst_case) == (None, 50)
    text = render_verdicts([result], {})
    assert "never-released does not occur in 90 %" in text
    assert "1 case ended in another way (case 52); it counts as a violation" in text


def test_two_bounds():
    """Between 5 and 8: below and beyond violate; the design value is a margin."""
    item = Requirement(name="in", metric="gap_mm", at_least=5.0, at_most=8.0, probability=0.5)
    result = verdict([5.0, 8.0, 4.0, 9.5, 6.0, 7.0, 7.0, 7.0, 7.0, 7.0], item)
    assert (result.violations, result.worst, result.worst_case) == (2, 9.5, 3)
    assert result.nearest == 0.0
    assert result.design_value == 0.0  # two of ten may lie outside, the third margin
    item = Requirement(name="in", metric="gap_mm", at_least=5.0, at_most=8.0, probability=0.9)
    for outer, margin, message in (
        (9.25, -1.25, "are at most 1.250 mm beyond a bound"),
        (7.25, 0.75, "are at least 0.7500 mm within both bounds"),
    ):
        result = verdict([outer] * 20 + [6.5] * 80, item)
        assert result.design_value == margin
        assert f"90 % of all cases {message}, with 90 %" in render_verdicts(
            [result], {"gap_mm": "mm"}, 200
        )


def test_design_value():
    """The 20th largest of 10,000 bounds 99.73 % with 90 %."""
    values = np.random.default_rng(8).permutation(10_000).astype(float)
    item = Requirement(name="load", metric="gap_mm", at_most=9_985.0)
    result = verdict(values, item)
    assert (result.design_value, result.violations, result.verdict) == (9_980.0, 14, PASS)
    assert result.worst == 9_999.0
    text = render_verdicts([result], {"gap_mm": "mm"})
    assert "14 of 10000 cases violate it, 19 are allowed" in text
    assert "99.73 % of all cases are <= 9980 mm, with 90 %" in text


@pytest.mark.parametrize(
    ("values", "more", "why"),
    [
        ([4.9999] + [6.0] * 300, {"error": 1e-4}, "numerical error"),
        ([6.0] * 400, {"error": math.inf}, "numerical error"),
        ([6.0] * 1500, {"error": math.inf}, "numerical error"),
        ([6.0] * 400, {"error": math.nan}, "is not known"),
        ([6.0] * 400, {"audit": np.full(400, 1.0)}, "audit"),
        ([], {}, "no case"),
    ],
)
def test_no_verdict(values, more, why):
    result = verdict(values, **more)
    assert result.verdict == NONE
    assert why in result.why
    assert why in render_verdicts([result], {})


def test_an_error_that_does_not_matter():
    """Two of 400 cases may be on either side; 1 of 388 may violate: of 600 two may."""
    values = np.full(600, 6.0)
    values[[5, 77]] = 5.00001, 4.99999
    assert verdict(values, error=1e-5).verdict == PASS
    values[78] = 4.0
    assert verdict(values, error=1e-5).verdict == NONE
    assert verdict(values, error=1e-9).verdict == PASS


BAD = [
    ({"metric": "gap"}, "requirement.a.metric = 'gap': no such outcome or status"),
    ({"metric": "seperation_speed_m_s"}, "did you mean 'separation_speed_m_s'?"),
    ({}, "requirement.a: needs at_least or at_most"),
    ({"metric": "never-released", "at_most": 1.0}, "is a status, which has no bound"),
    ({"at_least": 2.0, "at_most": 1.0}, "must be at least at_least = 2"),
    (
        {"at_least": 2.0, "probability": 1.0},
        "requirement.a.probability = 1.0: must be a number < 1",
    ),
    ({"at_least": 2.0, "confidence": 0.0}, "requirement.a.confidence = 0.0: must be > 0"),
    ({"at_least": 2.0, "risk": 0.1}, "unknown key"),
    ({"metric": "gap_recontact", "at_most": 1.0}, "is always satisfied"),
]


@pytest.mark.parametrize(("table", "message"), BAD)
def test_bad_requirements(table, message):
    table = {"name": "a", "metric": "separation_speed_m_s"} | table
    tree = sepmc.load("residual-thrust" if "gap" in table["metric"] else "table2").file.tree
    with pytest.raises(SceneError, match=r"t\.toml: ") as error:
        parse_campaign(tree | {"requirement": [table]}, "t.toml")
    assert message in str(error.value)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Table 2 with two requirements: one that 20 cases show, and one that they refute."""
    tree = sepmc.load("table2").file.tree
    items = [
        {"name": "apart", "metric": "separation_speed_m_s", "at_least": 0.1, "probability": 0.8},
        {"name": "level", "metric": "upper_pitch_deg", "at_most": 0.0, "probability": 0.8},
    ]
    path = tmp_path_factory.mktemp("required") / "required.toml"
    path.write_text(tomli_w.dumps(tree | {"requirement": items}), encoding="utf-8")
    return path


def test_requirements_do_not_change_a_flight(file, table2):
    assert sepmc.load(file).digest == table2.digest


def test_from_the_command_line(file, tmp_path):
    """The verdicts stand on the screen and in statistics.json, from the run and from its files;
    with --check one that is not passed ends with 1."""
    options = ["campaign", str(file), "--cases", "20", "--no-plots", "--out", str(tmp_path / "r")]
    called = CliRunner().invoke(app.main, [*options, "--check"])
    assert called.exit_code == 1, called.output
    assert "PASS        apart: separation_speed_m_s >= 0.1 m/s in 80 %" in called.stdout
    assert "FAIL        level" in called.stdout
    assert "error: not every requirement has the verdict pass" in called.stderr
    again = CliRunner().invoke(app.main, ["stats", str(tmp_path / "r")])
    assert again.exit_code == 0
    assert CliRunner().invoke(app.main, ["stats", str(tmp_path / "r"), "--check"]).exit_code == 1
    for line in called.stdout[called.stdout.index("requirements") :].splitlines()[:6]:
        assert line in again.stdout
    text = json.loads((tmp_path / "r" / "statistics.json").read_text(encoding="utf-8"))
    assert [item["verdict"] for item in text["requirements"]] == [PASS, FAIL]
    loose = [*options, "--overwrite", "--set", "solver.step_s=0.05"]
    assert CliRunner().invoke(app.main, loose).exit_code == 0


def test_nothing_to_check():
    called = CliRunner().invoke(app.main, ["campaign", "table2", "--check"])
    assert (called.exit_code, "--check needs a [[requirement]]" in called.stderr) == (2, True)


def test_in_python(file):
    result = sepmc.load(file).run(cases=20).requirements()
    assert list(result["verdict"]) == [PASS, FAIL]
    assert list(result.index) == ["apart", "level"]
    none = sepmc.load("table2", {"run.history_step_s": 0.0}).run(cases=2).requirements()
    assert (len(none), "verdict" in none) == (0, True)


ALL = Requirement(name="clean", metric="violation", probability=0.9, confidence=0.9)
FAST = Requirement(name="fast", metric="speed_m_s", at_least=1.0, probability=0.9)
PARTS = Requirement(name="parts", metric="never-released")


def together(gap, speed, statuses, errors, required=(ALL, CLEAR, FAST, PARTS)):
    """The verdict on all requirements together, from rows; the same as cases pass by."""
    count = len(gap)
    labels = np.array(statuses, dtype=object)
    table = {"case": np.arange(count), "status": labels, "gap_mm": gap, "speed_m_s": speed}
    parts = ["gap_mm", "speed_m_s"], [], {}, list(required)
    rows, stream = TableStatistics(table, *parts), StreamingStatistics(*parts)
    codes = {status.label: int(status) for status in Status}
    columns = np.array([gap, speed])
    for first in range(0, count, 7):
        some = slice(first, first + 7)
        numbers = np.array([codes[x] for x in labels[some]])
        stream.add(table["case"][some], numbers, columns[:, some])
    result = [
        next(v for v in summary.verdicts(errors, summary.audit()) if v.metric == "violation")
        for summary in (rows, stream)
    ]
    assert result[0] == result[1]
    return result[0], table


def test_masks_are_those_that_verdicts_count():
    """Also for a requirement on a status: a case that ended with another one is not known to have
    met it."""
    statuses = ["ok"] * 96 + ["jammed", "never-released", "jammed", "unresolved"]
    gap = np.full(100, 9.0)
    gap[[5, 96]], gap[7] = 4.0, math.nan  # of 96 it does not count, as it did not finish
    items = [CLEAR, PARTS, ALL]
    table = {"case": np.arange(100), "status": np.array(statuses, dtype=object), "gap_mm": gap}
    rows = TableStatistics(table, ["gap_mm"], [], {}, items)
    for item, verdict in zip(items, rows.verdicts({}, rows.audit(), "random"), strict=True):
        violates, known = requirements.violation_masks(item, table, items)
        assert not (violates & ~known).any()
        assert (verdict.violations, verdict.missing) == (
            np.count_nonzero(violates | ~known),
            np.count_nonzero(~known),
        )
    violates, known = requirements.violation_masks(PARTS, table)
    assert np.flatnonzero(violates).tolist() == [97]
    assert np.flatnonzero(~known).tolist() == [96, 98, 99]


def test_all_requirements_together():
    """A case that violates several counts once; one of which nothing is known counts as it does for
    each; what is in doubt for one may leave no verdict on all."""
    gap, speed = np.full(200, 9.0), np.full(200, 3.0)
    gap[[5, 6]], speed[[6, 7]] = 4.0, 0.5
    statuses = ["ok"] * 200
    statuses[8] = "never-released"
    statuses[9] = "jammed"
    errors = {"gap_mm": (1e-9, 1.0), "speed_m_s": (1e-9, 1.0)}
    result, table = together(gap, speed, statuses, errors)
    # 5, 6, 7 and 8 violate something; of 9 nothing is known
    assert (result.violations, result.missing, result.worst_case, result.worst) == (5, 1, 5, None)
    assert (result.verdict, result.error, result.nearest) == (PASS, None, None)
    low, high = binomial_interval(4, 200)[0], binomial_interval(5, 200)[1]
    assert (result.share_low, result.share_high) == (low, high)
    violates, known = requirements.violation_masks(ALL, table, [ALL, CLEAR, FAST, PARTS])
    assert np.flatnonzero(violates & known).tolist() == [5, 6, 7, 8]
    assert np.flatnonzero(~known).tolist() == [9]
    text = " ".join(render_verdicts([result], {}).split())
    assert "clean: no other requirement is violated in 90 % of all cases" in text
    assert "1 case did not finish or lacks an outcome (case 9); it counts as a violation" in text
    for doubtful, message in ((5, PASS), (30, NONE)):  # of 200 cases 14 may violate
        near = speed.copy()
        near[100 : 100 + doubtful] = 1.0 + 1e-6
        wrong = errors | {"speed_m_s": (1e-5, 1.0)}
        assert together(gap, near, statuses, wrong)[0].verdict == message
    faster = Requirement(name="faster", metric="speed_m_s", at_least=1.0, probability=0.5)
    twice = (ALL, CLEAR, FAST, faster)  # what is in doubt for both is so once
    near = speed.copy()
    near[100:108] = 1.0 + 1e-6
    wrong = errors | {"speed_m_s": (1e-5, 1.0)}
    assert together(gap, near, statuses, wrong, twice)[0].verdict == PASS
    unknown = together(gap, speed, statuses, {"gap_mm": (1e-9, 1.0)})[0]
    assert (unknown.verdict, "speed_m_s is not known" in unknown.why) == (NONE, True)


@pytest.mark.parametrize(
    ("required", "message"),
    [
        ([{"name": "a", "metric": "violation"}], "needs other requirements"),
        (
            [{"name": "a", "metric": "violation", "at_most": 0.0},
             {"name": "b", "metric": "never-released"}],
            "has no bound",
        ),
    ],
)  # fmt: skip
def test_violation_of_nothing(required, message):
    with pytest.raises(SceneError, match=message):
        sepmc.load("table2", {"requirement": required})


@pytest.mark.slow
def test_all_together_through_a_run(tmp_path):
    """Verdict, worst case, causes and report of a run."""
    required = [
        {"name": "clean", "metric": "violation", "probability": 0.5},
        {"name": "fast", "metric": "separation_speed_m_s", "at_least": 0.55, "probability": 0.5},
        {"name": "low", "metric": "upper_pitch_deg", "at_most": 0.5, "probability": 0.5},
    ]
    folder = tmp_path / "run"
    with run_interpreted():
        result = sepmc.load("table2", {"requirement": required}).run(cases=150, seed=7, out=folder)
    rows = result.to_pandas()
    either = (rows["separation_speed_m_s"] < 0.55) | (rows["upper_pitch_deg"] > 0.5)
    row = result.requirements().loc["clean"]
    assert row["violations"] == either.sum() > (rows["separation_speed_m_s"] < 0.55).sum()
    assert row["worst_case"] == rows["case"][either].min()
    cause = result.causes("clean")[0]
    assert cause.violations == either.sum()
    called = CliRunner().invoke(app.main, ["sensitivity", str(folder)])
    assert called.exit_code == 0, called.output
    assert f"clean, {either.sum()} of 150 cases" in called.output
    called = CliRunner().invoke(app.main, ["report", str(folder), "--no-replay"])
    assert called.exit_code == 0, called.output
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "clean: no other requirement is violated" in page


@pytest.mark.parametrize(
    ("violations", "missing", "decides"),
    [(30, 30, True), (30, 28, True), (45, 15, False), (12, 12, False), (0, 0, False)],
)
def test_cases_without_an_outcome_decide(violations, missing, decides):
    """Of 200 cases, of which a tenth may violate, 30 known violations refute, and 14 pass."""
    item = Requirement(name="a", metric="x_mm", at_most=5.0, probability=0.9, confidence=0.9)
    assert requirements.lacking_decides(violations, missing, 200, item) == decides
