"""Rows of some cases are kept while all are counted: which, why, and of what columns."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import sepmc
from sepmc.analysis import quantile_sketch, streaming
from sepmc.analysis.moments import Moments
from sepmc.analysis.requirements import margins
from sepmc.campaign.execution import runner, sinks
from sepmc.campaign.store import folders, manifests, shards
from sepmc.campaign.store.row_selection import KeepRules, RowSelection
from sepmc.cli import app
from sepmc.scene.messages import InputError
from sepmc.scene.model import Requirement

CASES = 900
SETTINGS = {
    "run.chunk": 100,
    "run.history_step_s": 0.0,
    "run.end_time_s": 0.285,
    "requirement": [
        {"name": "fast", "metric": "separation_speed_m_s", "at_least": 0.5},
        {"name": "turn", "metric": "upper_omega_z_deg_s", "at_least": -1.5, "at_most": 3.0},
        {"name": "released", "metric": "never-released"},
    ],
}


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2", SETTINGS)


@pytest.fixture(scope="module")
def rows(campaign):
    return campaign.run(cases=CASES).to_pandas()


@pytest.fixture
def kept(campaign, tmp_path):
    def run(rule, **more):
        given = {"cases": CASES, "out": tmp_path / "run", "keep": rule, "overwrite": True}
        result = campaign.run(**given | more)
        frame = pd.read_parquet(tmp_path / "run" / "selected").sort_values(
            "case", ignore_index=True
        )
        return result, frame

    return run


def violates(campaign, rows, name):
    (one,) = (one for one in campaign.file.requirements if one.name == name)
    if name == "released":
        return rows["status"] == "never-released"
    return (rows["status"] == "ok") & (margins(rows[one.metric].to_numpy(), one) < 0.0)


def expected(campaign, rows, rule):
    ok = rows["status"] == "ok"
    if rule == "failed":
        return ~ok
    if rule == "every:250":
        return rows["case"] % 250 == 0
    if rule == "violating":
        result = [violates(campaign, rows, name) for name in ("fast", "turn", "released")]
        return np.any(result, axis=0)
    if rule == "all":
        return np.ones(len(rows), dtype=bool)
    result = set()
    for one in campaign.file.requirements[:2]:
        margin = pd.Series(np.where(ok, margins(rows[one.metric].to_numpy(), one), np.nan))
        result |= set(margin.dropna().sort_values(kind="stable").index[:7])
    return rows["case"].isin(result)


@pytest.mark.slow
@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("rule", ["failed", "every:250", "violating", "worst:7", "all"])
def test_rows_are_those_of_the_rule(campaign, rows, kept, rule, many, monkeypatch):
    """To the last bit, in one part or in many; statistics are of all cases."""
    monkeypatch.setattr(runner, "_FIRST", 100)
    if many:
        monkeypatch.setattr(sinks, "_ROWS_OF_A_SHARD", 0)
    result, frame = kept(rule)
    there = expected(campaign, rows, rule)
    assert 0 < there.sum() <= CASES
    pd.testing.assert_frame_equal(
        frame.drop(columns="kept_as").astype({"status": object}),
        rows[there].reset_index(drop=True).astype({"status": object}),
        check_exact=True,
    )
    assert frame["kept_as"].astype(str).str.contains(rule.partition(":")[0]).all()
    every = campaign.run(cases=CASES, stats_only=True)
    pd.testing.assert_frame_equal(result.statistics(), every.statistics(), check_exact=True)
    assert not manifests.diagnose(result.folder)
    assert (len(shards.entries(result.folder, folders.SELECTED)) > 1) == many


def test_why_rows_are_kept(campaign, rows, kept):
    _, frame = kept("failed,worst:2,violating,every:300")
    reasons = frame.set_index("case")["kept_as"].astype(str)
    for name in ("fast", "turn"):
        of_it = frame[reasons.str.contains(f"worst {name}").to_numpy()]
        assert len(of_it) == 2
        assert violates(campaign, of_it, name).all()
    failed = rows["case"][rows["status"] == "never-released"]
    assert (reasons[failed].str.startswith("failed; violating released")).all()
    assert "every" in reasons[300]


def test_columns_and_precision(rows, kept):
    _, whole = kept("every:250")
    _, frame = kept("every:250", keep_columns="in_body_upper_*,separation_*", float32=True)
    assert list(frame)[:2] == ["case", "status"]
    assert set(frame) < set(whole)
    assert {"kept_as", "separation_speed_m_s", "in_body_upper_mass_kg"} < set(frame)
    assert "upper_alpha_deg" not in frame
    for name in frame.select_dtypes("number").drop(columns="case"):
        assert frame[name].dtype == np.float32
        np.testing.assert_array_equal(frame[name], whole[name].astype(np.float32))


class Interrupted(Exception):
    pass


def until(most):
    def tell(done, total, failures):
        if done >= most:
            raise Interrupted

    return tell


@pytest.fixture
def often(campaign, monkeypatch):
    """The campaign, written after every chunk, of which there are many."""
    monkeypatch.setattr(runner, "_SAVE_S", 0.0)
    monkeypatch.setattr(runner, "_SHARD_S", 0.0)
    monkeypatch.setattr(runner, "_FIRST", 40)
    return campaign.with_settings({"run.chunk": 11})


def contents(folder):
    """What a run holds, but for when it was flown."""
    apart = ("manifest.json", "checksums.jsonl")
    files = [path for path in folder.rglob("*") if path.is_file() and path.name not in apart]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.slow
@pytest.mark.parametrize("orders", [{"stats_only": True}, {"keep": "failed,worst:7,every:100"}])
def test_a_run_that_counts_is_resumed(often, tmp_path, orders):
    """Interrupted twice, it holds what one holds that was left alone, to the last bit; and it grows
    to more cases, as if they had been asked for at once."""
    whole, folder = tmp_path / "whole", tmp_path / "run"
    left_alone = often.run(cases=CASES, out=whole, **orders)
    for most in (300, 250):
        with pytest.raises(Interrupted):
            often.run(cases=CASES, out=folder, progress=until(most), resume=True, **orders)
        assert manifests.diagnose(folder)
        assert 0 < shards.accumulator_entry(folder).first < CASES
    result = often.run(cases=CASES, out=folder, resume=True)
    assert result.resumed >= 500
    assert contents(folder) == contents(whole)
    assert not manifests.diagnose(folder)
    pd.testing.assert_frame_equal(result.statistics(), left_alone.statistics(), check_exact=True)
    assert result.status_counts == left_alone.status_counts
    assert result.kept.summary.counters[1].extreme == left_alone.kept.summary.counters[1].extreme
    more = often.run(cases=CASES + 400, out=folder, resume=True)
    at_once = often.run(cases=CASES + 400, stats_only=True)
    pd.testing.assert_frame_equal(more.statistics(), at_once.statistics(), check_exact=True)
    assert more.status_counts == at_once.status_counts


def test_a_refused_run_leaves_no_folder(tmp_path, monkeypatch):
    """Nor the folder of that folder, unless it was there."""
    monkeypatch.chdir(tmp_path)
    words = ["campaign", "table2", "--cases", "4", "--keep", "all", "--keep-columns", "no_such"]
    assert CliRunner().invoke(app.main, words).exit_code == 2
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "runs").mkdir()
    assert CliRunner().invoke(app.main, words).exit_code == 2
    assert [path.name for path in tmp_path.rglob("*")] == ["runs"]


@pytest.mark.slow
@pytest.mark.parametrize("damaged", ["accumulators", "selected"])
def test_what_was_counted_is_damaged(often, tmp_path, damaged):
    """It is told, and all cases are flown again."""
    whole, folder = tmp_path / "whole", tmp_path / "run"
    often.run(cases=CASES, out=whole, keep="every:100")
    with pytest.raises(Interrupted):
        often.run(cases=CASES, out=folder, keep="every:100", progress=until(500))
    (part, *_) = sorted((folder / damaged).glob("part-*.parquet"))
    part.write_bytes(part.read_bytes()[:-9] + b"123456789")
    assert any(part.name in finding.text for finding in manifests.diagnose(folder))
    texts = []
    result = often.run(cases=CASES, out=folder, resume=True, announce=texts.append)
    assert any("all are run" in one for one in texts)
    assert result.resumed == 0
    assert contents(folder) == contents(whole)


@pytest.mark.slow
def test_counts_beyond_what_is_kept_exactly(tmp_path, often, monkeypatch):
    """Values in a grid, in its tails, on its points of many values; and those that wait."""
    monkeypatch.setattr(quantile_sketch, "EXACT_VALUES", 256)
    monkeypatch.setattr(streaming, "ACCUMULATION_BLOCK", 64)
    loaded = sepmc.load("table2", {**SETTINGS, "run.chunk": 7})
    with pytest.raises(Interrupted):
        loaded.run(cases=CASES, out=tmp_path / "run", stats_only=True, progress=until(450))
    assert shards.accumulator_entry(tmp_path / "run").first % 64
    result = loaded.run(cases=CASES, out=tmp_path / "run", resume=True)
    whole = loaded.run(cases=CASES, stats_only=True)
    pd.testing.assert_frame_equal(result.statistics(), whole.statistics(), check_exact=True)
    for name in (column.name for column in loaded.outcome_columns):
        for one, other in zip(
            result.kept.summary.histogram(name) or (),
            whole.kept.summary.histogram(name) or (),
            strict=True,
        ):
            np.testing.assert_array_equal(one, other)


def test_statistics_are_written_again(campaign, tmp_path):
    """From what is counted, without a flight."""
    folder = tmp_path / "run"
    options = [f"--set={path}={value}" for path, value in SETTINGS.items() if path != "requirement"]
    words = ["campaign", "table2", *options, "--cases", "300", "--stats-only", "--no-plots"]
    run = CliRunner().invoke(app.main, [*words, "--quiet", "--out", str(folder)])
    assert run.exit_code == 0, run.output
    before = contents(folder)
    (folder / "statistics.csv").write_text("outcome,unit")
    mended = CliRunner().invoke(app.main, ["doctor", str(folder), "--repair"])
    assert mended.exit_code == 0, mended.output
    assert "0 cases run again" in mended.output
    assert contents(folder) == before
    (folder / "manifest.json").unlink()
    assert manifests.read_provenance(folder)["stats_only"]
    assert CliRunner().invoke(app.main, ["doctor", str(folder), "--repair"]).exit_code == 0
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"keep": "most"}, "of all, failed, violating, worst:N and every:N"),
        ({"keep": "worst:0"}, "must be one or several"),
        ({"keep": "failed", "keep_columns": "uper_*"}, "no such column; known here"),
        ({"keep_columns": "upper_*"}, "only to rows that keep selects"),
        ({"float32": True}, "only to rows that keep selects"),
        ({"keep": "failed", "out": None}, "give its path as out"),
    ],
)
def test_what_cannot_be_kept(campaign, tmp_path, given, message):
    with pytest.raises(InputError, match=message):
        campaign.run(**{"cases": 10, "out": tmp_path / "run"} | given)
    assert not (tmp_path / "run").exists()


def test_without_requirements(tmp_path):
    plain = sepmc.load("table2")
    for rule in ("worst:3", "violating"):
        with pytest.raises(InputError, match="requirement"):
            plain.run(cases=10, out=tmp_path / "run", keep=rule)


@pytest.mark.slow
def test_command_line(tmp_path):
    def call(*given):
        return CliRunner().invoke(app.main, [str(one) for one in given])

    options = ["table2", "--cases", 300, "--no-plots", "--quiet", "--out", tmp_path / "run"]
    options += ["--set", "run.end_time_s=0.285"]
    done = call("campaign", *options, "--keep", "failed,every:100", "--float32")
    assert done.exit_code == 0, done.output
    manifest = manifests.read_manifest(tmp_path / "run")
    assert manifest["keep"] == "failed,every:100; float32"
    assert manifest["complete"]
    assert not (tmp_path / "run" / "cases").exists()
    assert call("plot", tmp_path / "run").exit_code == 0
    for command in ("stats", "sensitivity"):
        called = call(command, tmp_path / "run")
        assert called.exit_code == 2
        assert "the rows selected by --keep" in called.stderr
    assert call("doctor", tmp_path / "run").exit_code == 0
    again = call("campaign", *options, "--keep", "failed", "--overwrite")
    assert again.exit_code == 0, again.output
    assert "float32" not in manifests.read_manifest(tmp_path / "run")["keep"]
    assert call("campaign", *options, "--keep", "failed", "--resume").exit_code == 0
    other = call("campaign", *options, "--keep", "all", "--resume")
    assert other.exit_code == 2
    assert (
        "was run saving the rows failed, and is to be continued saving the rows all" in other.stderr
    )


@pytest.mark.parametrize(
    "text", ["all", "failed,worst:20", "every:9; columns in_*,upper_*; float32", "all; float32"]
)
def test_rules_of_a_text(text):
    assert KeepRules.of_text(text).text == text


def test_text():
    assert KeepRules(("failed", "worst"), 20).text == "failed,worst:20"


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_a_count_that_is_none_is_refused(bad):
    one, two = Moments(), Moments()
    one.add(np.array([0.5, 1.5, 7.5]), np.array([4, 5, 6]))
    (state,) = one.state()
    two.restore(iter([state]))
    assert two.row() == one.row()
    with pytest.raises(ValueError, match="count"):
        two.restore(iter([np.where(state == 3.0, bad, state)]))


def test_cases_without_the_outcome_are_violating():
    """A finished case that lacks the outcome is kept, with the reason; a failed one is not."""
    item = Requirement(name="soon", metric="x_s", at_most=1.0)
    rows = {
        "case": np.arange(4),
        "status": np.array(["ok", "ok", "ok", "never-released"], dtype=object),
        "x_s": np.array([0.5, 2.0, np.nan, np.nan]),
    }
    positions, reasons = RowSelection(KeepRules(("violating",)), [item]).choose(rows)
    assert positions.tolist() == [1, 2]
    assert reasons.tolist() == ["violating soon", "violating soon, no outcome"]
