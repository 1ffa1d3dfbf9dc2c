"""The road around the kernel: calls, parts and the writer beside the flight never change a row;
--stats-only keeps no rows."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

import sepmc
from sepmc.analysis import row_statistics
from sepmc.campaign.execution import forecast, runner
from sepmc.campaign.store import ledger, manifests, result_files, shards
from sepmc.campaign.store.untrusted import StoreError
from sepmc.cli import app

FIGURES = ["mean", "sigma", "min", "max", "p0_135", "p50", "p99_865", "case_min", "case_max"]


def call(*arguments):
    return CliRunner().invoke(app.main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def campaign():
    """Never released in some cases, so that there are failures to count."""
    return sepmc.load(
        "table2", {"run.chunk": 20, "run.history_step_s": 0.1, "run.end_time_s": 0.26}
    )


@pytest.fixture(scope="module")
def result(campaign):
    outcome = campaign.run(cases=50, seed=7)
    assert 0 < outcome.status_counts["never-released"] < 50
    return outcome


def same(one, other):
    pd.testing.assert_frame_equal(one.to_pandas(), other.to_pandas(), check_exact=True)
    pd.testing.assert_frame_equal(one.histories(), other.histories(), check_exact=True)
    pd.testing.assert_frame_equal(one.statistics(), other.statistics(), check_exact=True)


@pytest.mark.slow
def test_calls_and_parts_change_nothing(campaign, result, tmp_path, monkeypatch):
    """A slow scene: one case a call, and a part as soon as something is flown."""
    monkeypatch.setattr(runner, "_FIRST", 3)
    monkeypatch.setattr(runner, "_CALL_S", 0.0)
    monkeypatch.setattr(runner, "_SHARD_S", 0.0)
    same(campaign.run(cases=50, seed=7), result)
    slow = campaign.run(cases=50, seed=7, out=tmp_path / "run")
    same(slow, result)
    assert len(list((tmp_path / "run" / "cases").iterdir())) > 3
    monkeypatch.setattr(shards.CaseColumns, "MAX_IN_MEMORY", 10)  # column by column
    same(slow, result)


def test_a_part_has_a_bound_in_memory(campaign, result, tmp_path, monkeypatch):
    monkeypatch.setattr(forecast, "_SHARD_BYTES", 10_000)
    same(campaign.run(cases=50, seed=7, out=tmp_path / "run"), result)
    assert len(list((tmp_path / "run" / "cases").iterdir())) > 3


@pytest.mark.slow
def test_statistics_of_a_long_run_are_streamed(campaign, result, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    monkeypatch.setattr(row_statistics, "MAX_EXACT_CASES", 10)
    outcome = campaign.run(cases=50, seed=7, out=folder)
    pd.testing.assert_frame_equal(outcome.statistics(), result.statistics(), rtol=1e-9)
    before = campaign.run(cases=50, seed=7, out=tmp_path / "again").statistics()
    pd.testing.assert_frame_equal(before, outcome.statistics(), check_exact=True)
    assert call("stats", folder).exit_code == 0
    assert call("plot", folder).exit_code == 0
    assert (folder / "histograms.png").exists()


def test_a_writer_that_fails_is_told(campaign, result, tmp_path, monkeypatch):
    """A full disk in the second part: a sentence, no traceback, and the finished part goes on from
    there."""
    folder, write = tmp_path / "run", ledger.write_atomically

    def full(path, content):
        if "cases" in str(path) and "0000000020" in str(path):
            raise OSError(28, "No space left on device")
        return write(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(ledger, "write_atomically", full)
        with pytest.raises(
            StoreError, match=r"part-0000000020\.parquet: cannot be written: .*No space left"
        ):
            campaign.run(cases=50, seed=7, out=folder)
        assert (
            json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["complete"] is False
        )
        failed = call("campaign", folder, "--out", folder, "--resume", "--quiet")
        assert (
            failed.exit_code,
            "No space left" in failed.stderr,
            "Traceback" in failed.output,
        ) == (2, True, False)
    same(campaign.run(cases=50, seed=7, out=folder, resume=True), result)
    entries = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert (entries["complete"], entries["n_stored"], entries["failures"]) == (
        True,
        50,
        result.status_counts["never-released"],
    )


def test_a_part_whose_histories_are_gone_is_flown_again(campaign, result, tmp_path):
    campaign.run(cases=50, seed=7, out=tmp_path)
    part = tmp_path / "histories" / "part-0000000020.parquet"
    count, texts = pq.read_metadata(tmp_path / "cases" / part.name).num_rows, []
    part.unlink()
    same(campaign.run(cases=50, seed=7, out=tmp_path, resume=True, announce=texts.append), result)
    assert any(f"{count} cases, or their histories, are missing" in text for text in texts)


@pytest.mark.parametrize(
    ("stats_only", "message"),
    [
        (False, "4 cases, or their histories, are missing or were changed"),
        (True, "the stored statistics are missing or were changed"),
    ],
)
def test_damage_of_all_that_is_stored_is_announced(campaign, tmp_path, stats_only, message):
    """Damaged shards are deleted, so they must not be passed over as no stored cases."""
    campaign.run(cases=4, out=tmp_path, stats_only=stats_only)
    (path,) = (tmp_path / ("accumulators" if stats_only else "cases")).iterdir()
    path.write_bytes(path.read_bytes()[:-9])
    texts = []
    campaign.run(cases=4, out=tmp_path, resume=True, announce=texts.append)
    assert message in texts[0]
    assert "no stored cases to continue from" in texts[1]


def test_an_interrupt_within_a_chunk_keeps_what_is_flown(campaign, result, tmp_path, monkeypatch):
    def told(done, left, failures):
        if done >= 25:
            raise KeyboardInterrupt

    monkeypatch.setattr(runner, "_FIRST", 3)
    monkeypatch.setattr(runner, "_CALL_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        campaign.run(cases=50, seed=7, out=tmp_path, progress=told)
    assert shards.stored_cases(tmp_path).tolist() == list(range(25))
    assert manifests.read_manifest(tmp_path)["n_stored"] == 25
    same(campaign.run(cases=50, seed=7, out=tmp_path, resume=True), result)


def test_statistics_only(campaign, result, tmp_path):
    """Those of the rows, without the rows, in memory and in a folder."""
    outcome = campaign.run(cases=50, seed=7, stats_only=True, out=tmp_path / "run")
    table, expected = outcome.statistics(), result.statistics()
    pd.testing.assert_frame_equal(table[FIGURES], expected[FIGURES], rtol=1e-9)
    assert (table["n"] == expected["n"]).all()
    assert outcome.status_counts == result.status_counts
    assert list(outcome.timing) == ["text", "compile", "steps", "sample", "kernel", "write"]
    for rows_of in (outcome.to_pandas, outcome.histories, lambda: outcome.table):
        with pytest.raises(ValueError, match="statistics only"):
            rows_of()
    assert outcome.case(3).inputs == result.case(3).inputs
    other = campaign.with_settings({"run.chunk": 7}).run(
        cases=50, seed=7, stats_only=True, threads=1
    )
    pd.testing.assert_frame_equal(other.statistics(), table, check_exact=True)


def test_statistics_only_on_the_command_line(result, tmp_path):
    options = [
        "--set",
        "run.end_time_s=0.26",
        "--set",
        "run.history_step_s=0.1",
        "--cases",
        50,
        "--seed",
        7,
    ]
    folder = tmp_path / "run"
    called = call("campaign", "table2.toml", *options, "--stats-only", "--out", folder)
    assert called.exit_code == 0, called.output
    failures = result.status_counts["never-released"]
    first = result.to_pandas().query("status == 'never-released'")["case"].iloc[0]
    assert f"{failures} cases never-released" in called.stdout
    assert f"(case {first}" in called.stdout
    names = {path.name for path in folder.iterdir()}
    assert {
        "campaign.toml",
        "manifest.json",
        "statistics.csv",
        "statistics.json",
        "histograms.png",
    } <= names
    assert "accumulators" in names
    assert not names & {"cases", "histories", "separation_speed.png"}
    manifest = manifests.read_manifest(folder)
    assert (
        manifest["complete"],
        manifest["stats_only"],
        manifest["cases"],
        manifest["n_stored"],
    ) == (True, True, 50, 0)
    data = json.loads((folder / "statistics.json").read_text(encoding="utf-8"))
    assert data["cases"] == {"ok": 50 - failures, "never-released": failures}
    assert data["failed_cases"]["never-released"][0] == first
    whole = tmp_path / "whole"
    assert (
        call("campaign", "table2.toml", *options, "--no-plots", "--quiet", "--out", whole).exit_code
        == 0
    )
    one, other = (pd.read_csv(at / "statistics.csv", index_col="outcome") for at in (folder, whole))
    pd.testing.assert_frame_equal(one[FIGURES], other[FIGURES], rtol=1e-9)
    assert (
        json.loads((whole / "statistics.json").read_text(encoding="utf-8"))["audit"]
        == data["audit"]
    )


@pytest.mark.slow
def test_histograms_of_statistics_only(campaign, tmp_path):
    """Are drawn again from their bins."""
    folder = tmp_path / "run"
    options = ["--cases", 300, "--set", "run.end_time_s=0.26", "--quiet", "--out", folder]
    assert call("campaign", "table2", *options, "--stats-only").exit_code == 0
    counted = campaign.run(cases=300, stats_only=True).kept.summary
    reported, names = result_files.read_stored_statistics(folder), campaign.outcome_columns
    for name in (column.name for column in names):
        one, other = reported.histogram(name), counted.histogram(name)
        assert (one is None) == (other is None)
        for ours, theirs in zip(one or (), other or (), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-14)
    (folder / "histograms.png").unlink()
    done = call("plot", folder)
    assert done.exit_code == 0, done.output
    assert (folder / "histograms.png").is_file()
    assert (folder / "hist_separation_distance_mm.png").is_file()
    assert call("doctor", folder).exit_code == 0
    (folder / "histograms.csv").write_text("outcome,from,to,cases")
    assert "histograms.csv: was changed" in call("plot", folder).stderr


def test_a_folder_of_statistics_only(tmp_path):
    """What needs rows says that there are none; a case is flown again from it, and it is replaced
    when asked."""
    folder = tmp_path / "run"
    options = ["table2.toml", "--cases", 5, "--no-plots", "--quiet", "--out", folder]
    assert call("campaign", *options, "--stats-only").exit_code == 0
    called = call("stats", folder)
    assert (called.exit_code, "statistics without case rows" in called.stderr) == (2, True), (
        called.output
    )
    assert call("campaign", *options, "--resume").exit_code == 0
    called = call("campaign", *options, "--resume", "--keep", "failed")
    assert (
        called.exit_code,
        "was run with --stats-only, and is to be continued saving the rows failed" in called.stderr,
    ) == (2, True)
    manifests.seal(folder, manifests.read_manifest(folder) | {"complete": False})
    assert "it was interrupted; to continue" in call("stats", folder).stderr
    assert (
        call(
            "run", folder, "--case", 3, "--no-plots", "--quiet", "--out", tmp_path / "one"
        ).exit_code
        == 0
    )
    assert call("campaign", *options, "--overwrite").exit_code == 0
    assert len(pd.read_parquet(folder / "cases")) == 5
    assert call("campaign", *options, "--overwrite", "--stats-only").exit_code == 0
    assert not (folder / "cases").exists()
    called = call("campaign", *options, "--resume", "--cases", 3)
    assert (called.exit_code, "--cases 3 would leave some out" in called.stderr) == (2, True)


def test_an_interrupt_of_statistics_only(tmp_path, monkeypatch):
    monkeypatch.setattr(runner.Runner, "run", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    called = call(
        "campaign",
        "table2.toml",
        "--cases",
        5,
        "--stats-only",
        "--quiet",
        "--out",
        tmp_path / "run",
    )
    assert (called.exit_code, "--resume" in called.stderr) == (130, True)


def test_status_of_a_part_is_a_dictionary_of_what_occurs(result, campaign, tmp_path):
    campaign.run(cases=50, seed=7, out=tmp_path)
    frame = pd.read_parquet(tmp_path / "cases")
    assert set(frame["status"].cat.categories) == {"ok", "never-released"}
    assert (frame["status"].to_numpy() == result.to_pandas()["status"].to_numpy()).all()
    metadata = shards.pq.read_metadata(tmp_path / "cases" / "part-0000000000.parquet").row_group(0)
    coded = {
        metadata.column(i).path_in_schema
        for i in range(metadata.num_columns)
        if metadata.column(i).has_dictionary_page
    }
    assert coded == {"status"}
    assert np.isfinite(frame["upper_roll_deg"]).any()


def test_scipy_is_left_alone_where_nothing_needs_it():
    """It takes longer to import than all else but pandas."""
    import subprocess
    import sys

    program = (
        "import sys, sepmc; sepmc.load('table2'); import sepmc.campaign.store.shards, "
        "sepmc.analysis.streaming; print('scipy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n"


@pytest.mark.slow
def test_numba_does_not_import_linear_algebra():
    """Its array maths asks for ``scipy.linalg``, which takes 0.24 s; whoever uses it still can."""
    import subprocess
    import sys

    program = (
        "import sys, sepmc.engine.blocks, numba, numpy as np\n"
        "print('scipy.linalg' in sys.modules)\n"
        "dot = numba.njit(lambda a: np.dot(a, a) + np.linalg.det(np.outer(a, a) + np.eye(2)))\n"
        "print(dot(np.ones(2)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n5.0\n"


def test_too_many_failures_stop_a_run(campaign, result, tmp_path, monkeypatch):
    """Soon after they are more than may be; what is flown is kept, told, and can be resumed."""
    monkeypatch.setattr(runner, "_FIRST", 10)
    monkeypatch.setattr(runner, "_CALL_S", 0.0)
    failed = result.status_counts["never-released"]
    stopped = campaign.run(cases=50, seed=7, out=tmp_path / "run", max_failures=2)
    assert stopped.stopped
    assert 2 < stopped.status_counts["never-released"] < failed
    assert any("did not end with status ok, and no more than 2 may" in n for n in stopped.notes)
    manifest = manifests.read_manifest(tmp_path / "run")
    assert not manifest["complete"]
    assert manifest["n_stored"] == len(stopped.to_pandas()) < 50
    again = campaign.run(cases=50, seed=7, out=tmp_path / "run", resume=True, max_failures=2)
    assert again.stopped
    rest = campaign.run(cases=50, seed=7, out=tmp_path / "run", resume=True, max_failures=failed)
    assert not rest.stopped
    same(rest, result)


def test_fail_fast(tmp_path):
    options = ["table2", "--cases", 300, "--seed", 7, "--no-plots", "--set", "run.end_time_s=0.26"]
    done = call("campaign", *options, "--out", tmp_path / "run", "--fail-fast")
    assert done.exit_code == 1
    assert "did not end with status ok, and none may" in done.stderr
    assert "not complete" in call("stats", tmp_path / "run").stderr
