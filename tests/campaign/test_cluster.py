"""Workers of a Dask scheduler fly what one process flies, to the last bit, whatever becomes of
them."""

import json
import os
import signal
from pathlib import Path

import dask
import pytest
from click.testing import CliRunner
from distributed import LocalCluster
from support.runs import same, statistics_of

import sepmc
from sepmc import cluster
from sepmc.analysis.quantile_sketch import EXACT_VALUES
from sepmc.analysis.streaming import ACCUMULATION_BLOCK
from sepmc.campaign.execution import runner
from sepmc.campaign.execution.work_ranges import StaleWorkerError
from sepmc.campaign.store import manifests, shards
from sepmc.cli import app
from sepmc.cluster import ClusterError, DaskExecutor, dask_executor
from sepmc.engine import threads
from sepmc.scene.messages import InputError

SETTINGS = {"run.chunk": 300, "run.history_step_s": 0.1, "run.end_time_s": 0.26}
CASES = 2000


@pytest.fixture(scope="module")
def campaign():
    """Never released in some cases, so that there are failures to count."""
    return sepmc.load("table2", SETTINGS)


@pytest.fixture(scope="module")
def alone(campaign, tmp_path_factory):
    return campaign.run(cases=CASES, out=tmp_path_factory.mktemp("alone") / "run")


@pytest.fixture
def workers():
    with dask_executor(2, threads=1) as result:
        yield result


@pytest.mark.slow
def test_workers_fly_the_same(campaign, alone, workers, tmp_path):
    result = campaign.run(cases=CASES, out=tmp_path / "run", executor=workers)
    assert same(alone.folder, tmp_path / "run")
    assert statistics_of(result) == statistics_of(alone)
    assert not manifests.diagnose(tmp_path / "run")
    one, other = (manifests.read_manifest(folder) for folder in (alone.folder, tmp_path / "run"))
    for name in ("failures", "accuracy", "notes", "complete", "n_stored"):
        assert one[name] == other[name], name
    (kind, flown), *more = other["sessions"][0]["workers"].items()
    assert kind.startswith(f"sepmc {sepmc.__version__}, ")
    assert (flown, more) == (CASES, [])


@pytest.mark.slow
def test_statistics_alone(campaign, workers, tmp_path):
    """After the cases that lay out their grids, and a last range that is no whole grain."""
    cases = EXACT_VALUES + 4 * ACCUMULATION_BLOCK + 7
    given = {"cases": cases, "stats_only": True}
    one = campaign.run(**given)
    other = campaign.run(**given, out=tmp_path / "run", executor=workers)
    assert statistics_of(one) == statistics_of(other)
    assert one.status_counts == other.status_counts
    assert one.kept.summary.failed == other.kept.summary.failed


@pytest.mark.slow
def test_a_worker_that_is_killed(campaign, alone, workers, tmp_path):
    """Its ranges are flown by others, and it leaves no files."""
    pids = list(workers.client.run(os.getpid).values())

    def progress(done, total, failures):
        if done and pids:
            os.kill(pids.pop(), signal.SIGKILL)
            pids.clear()

    result = campaign.run(cases=CASES, out=tmp_path / "run", executor=workers, progress=progress)
    assert not pids
    assert same(alone.folder, tmp_path / "run")
    assert statistics_of(result) == statistics_of(alone)
    assert not manifests.diagnose(tmp_path / "run")


@pytest.mark.slow
def test_what_workers_flew_is_resumed(campaign, alone, workers, tmp_path):
    class Enough(Exception):
        pass

    def progress(done, total, failures):
        if done:
            raise Enough

    with pytest.raises(Enough):
        campaign.run(cases=CASES, out=tmp_path / "run", executor=workers, progress=progress)
    assert 0 < len(shards.stored_cases(tmp_path / "run")) < CASES
    campaign.run(cases=CASES, out=tmp_path / "run", resume=True)
    assert same(alone.folder, tmp_path / "run")
    (tmp_path / "run" / "cases" / "part-0000000000.parquet").unlink()
    campaign.run(cases=CASES, out=tmp_path / "run", resume=True, executor=workers)
    assert same(alone.folder, tmp_path / "run")


@pytest.mark.slow
def test_what_workers_counted_is_resumed(campaign, workers, tmp_path, monkeypatch):
    """By one process, which ends within a grain, and by workers again."""
    monkeypatch.setattr(runner, "_SAVE_S", 0.0)
    given = {
        "cases": EXACT_VALUES + 7 * ACCUMULATION_BLOCK + 7,
        "out": tmp_path / "run",
        "resume": True,
    }
    for most, by in ((EXACT_VALUES + 1, workers), (2 * ACCUMULATION_BLOCK + 99, None)):

        def progress(done, total, failures, most=most):
            if done >= most:
                raise InterruptedError

        with pytest.raises(InterruptedError):
            campaign.run(**given, stats_only=True, executor=by, progress=progress)
    n_stored = shards.accumulator_entry(tmp_path / "run").first
    assert EXACT_VALUES + ACCUMULATION_BLOCK < n_stored < given["cases"]
    result = campaign.run(**given, executor=workers)
    assert result.resumed == n_stored
    whole = campaign.run(cases=given["cases"], stats_only=True)
    assert statistics_of(result) == statistics_of(whole)
    assert result.status_counts == whole.status_counts


@pytest.mark.slow
def test_a_scheduler_that_is_started_again(campaign, alone, tmp_path):
    """What it was given is handed out once more."""
    options = {"n_workers": 1, "threads_per_worker": 1, "memory_limit": 0}
    options |= {"dashboard_address": ":0", "silence_logs": "CRITICAL"}
    first = LocalCluster(**options)
    port, clusters = first.scheduler.port, [first]

    def progress(done, total, failures):
        if done and len(clusters) == 1:
            first.close()
            clusters.append(LocalCluster(**options, scheduler_port=port))

    try:
        with dask_executor(address=first.scheduler_address) as workers:
            campaign.run(cases=CASES, out=tmp_path / "run", executor=workers, progress=progress)
    finally:
        for cluster in clusters:
            cluster.close()
    assert len(clusters) == 2
    assert same(alone.folder, tmp_path / "run")


def test_a_worker_that_sees_another_folder(campaign, tmp_path):
    """It says which, and what it takes."""

    class Elsewhere(DaskExecutor):
        def map(self, job, function, ranges):
            (Path(job.folder) / "campaign.toml").write_text("other = 1")
            return super().map(job, function, ranges)

    with (
        dask_executor(1) as own,
        pytest.raises(StaleWorkerError, match="sees another campaign there"),
    ):
        campaign.run(cases=CASES, out=tmp_path / "run", executor=Elsewhere(own.client, None, 1, 1))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give its path as out"),
        ({"out": "run", "until": "release_time_s:0.1"}, "cannot be combined with workers"),
        ({"out": "run", "cases": "5:9", "stats_only": True}, "cannot be combined with workers"),
    ],
)
def test_what_workers_do_not_fly(campaign, tmp_path, monkeypatch, given, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        campaign.run(**{"cases": 9} | given, executor=DaskExecutor(None, None, 1, 1))
    assert not (tmp_path / "run").exists()


def test_a_worker_with_fewer_cores_than_threads():
    """It uses those that it has; `--threads` was checked where the command runs, not there."""
    with threads.using_threads(threads.max_threads() + 3) as count:
        assert count == threads.max_threads()


def test_no_scheduler(tmp_path):
    with (
        pytest.raises(ClusterError, match="no Dask scheduler with a worker there"),
        dask_executor(address="tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.slow
def test_command_line(alone, tmp_path):
    options = [f"--set={path}={value}" for path, value in SETTINGS.items()]
    options += ["--cases", str(CASES), "--quiet", "--no-plots", "--out", str(tmp_path / "run")]
    called = CliRunner().invoke(app.main, ["campaign", "table2", *options, "--workers", "2"])
    assert called.exit_code == 0, called.output
    assert same(alone.folder, tmp_path / "run")
    content = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert content["sessions"][0]["workers"]
    both = CliRunner().invoke(
        app.main, ["campaign", "table2", "--workers", "2", "--cluster", "tcp://h:1"]
    )
    assert both.exit_code == 2


@pytest.mark.slow
@pytest.mark.parametrize("orders", [{"stats_only": True}, {"keep": "failed"}])
def test_too_many_failures_among_the_first_cases(tmp_path, orders):
    """Those that lay out the grids: nobody else flies any more, and what was flown is told."""
    loaded = sepmc.load("table2", {**SETTINGS, "run.end_time_s": 0.26})
    with dask_executor(2, threads=1) as workers:
        result = loaded.run(
            cases=100_000, out=tmp_path / "run", executor=workers, max_failures=50, **orders
        )
    assert result.stopped
    assert 50 < sum(result.status_counts.values()) < 100_000
    assert (tmp_path / "run" / "manifest.json").is_file()


def test_workers_that_are_gone_are_not_waited_for(monkeypatch):
    """While no range is done it is looked whether there are workers; none for too long ends the
    wait with what to do, and some do not."""
    looks = []

    def wait(futures, timeout, return_when):
        looks.append(timeout)
        raise TimeoutError

    class Client:
        """Has workers at the first two looks."""

        def nthreads(self):
            return {"a": 1} if len(looks) <= 2 else {}

    monkeypatch.setattr(cluster, "wait", wait)
    monkeypatch.setattr(cluster, "_TIMEOUT_S", 0.0)
    with pytest.raises(
        ClusterError, match="all workers have been gone for 0 s; finished cases are stored"
    ):
        DaskExecutor(Client(), None, 1, 1)._completed({"future": 0})
    assert len(looks) == 3
    assert all(timeout <= 10.0 for timeout in looks)


def test_what_restarts_a_worker_is_not_closed():
    """A worker that is down long after an earlier one was lost is still started again."""
    with dask_executor(1):
        assert dask.config.get("distributed.deploy.lost-worker-timeout") == "30 days"
