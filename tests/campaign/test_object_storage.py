"""A run folder in object storage: flown by one process or by workers, resumed, read, mended."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from moto.server import ThreadedMotoServer

import sepmc
from sepmc.campaign.store import folders, manifests, shards
from sepmc.cli import app
from sepmc.cluster import dask_executor
from sepmc.paths import as_path

SETTINGS = {"run.chunk": 300, "run.history_step_s": 0.1, "run.end_time_s": 0.26}
CASES = 900


@pytest.fixture(scope="module", autouse=True)
def server():
    """A server of S3 on this machine, for this process and those it starts."""
    result = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    result.start()
    host, port = result.get_host_and_port()
    before = dict(os.environ)
    os.environ.update(
        AWS_ACCESS_KEY_ID="some",
        AWS_SECRET_ACCESS_KEY="key",
        AWS_DEFAULT_REGION="us-east-1",
        AWS_ENDPOINT_URL=f"http://{host}:{port}",
    )
    as_path("s3://bucket").mkdir()
    yield
    os.environ.clear()
    os.environ.update(before)
    result.stop()


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2", SETTINGS)


@pytest.fixture(scope="module")
def alone(campaign, tmp_path_factory):
    return campaign.run(cases=CASES, out=tmp_path_factory.mktemp("alone") / "run")


def same(folder, other):
    for read in (shards.read_cases, shards.read_histories):
        pd.testing.assert_frame_equal(read(folder), read(other), check_exact=True)


def call(*arguments):
    return CliRunner().invoke(app.main, [str(one) for one in arguments])


@pytest.mark.slow
@pytest.mark.parametrize("words", [("stats",), ("doctor",), ("campaign", "table2.toml", "--out")])
def test_storage_that_is_not_reached_is_told(monkeypatch, words):
    """By a process of its own: a client keeps the address it was made with."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    command = [sys.executable, "-m", "sepmc", *words, "s3://bucket/lost"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "s3://bucket/lost: cannot be reached: Could not connect" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_same_rows(campaign, alone):
    result = campaign.run(cases=CASES, out=as_path("s3://bucket/one"))
    same(result.folder, alone.folder)
    assert result.statistics().equals(alone.statistics())
    assert not manifests.diagnose(result.folder)


@pytest.mark.slow
def test_workers_write_it(campaign, alone):
    with dask_executor(2, threads=1) as workers:
        result = campaign.run(cases=CASES, out=as_path("s3://bucket/workers"), executor=workers)
    same(result.folder, alone.folder)
    assert result.statistics().equals(alone.statistics())


@pytest.mark.slow
def test_what_is_lost_is_flown_again(campaign, alone):
    folder = as_path("s3://bucket/lost")
    campaign.run(cases=CASES, out=folder)
    first, second, *_ = sorted((folder / "cases").glob("part-*"))
    first.unlink()
    second.write_bytes(b"some bytes")
    texts = [finding.text for finding in manifests.diagnose(folder)]
    assert any("is gone" in text for text in texts)
    assert any("was changed" in text for text in texts)
    with pytest.raises(folders.StoreError, match="resume=True"):
        shards.read_cases(folder)
    campaign.run(cases=CASES, out=folder, resume=True)
    same(folder, alone.folder)
    assert not manifests.diagnose(folder)


@pytest.mark.slow
def test_command_line(alone, tmp_path):
    """Commands take it by its name."""
    options = [f"--set={path}={value}" for path, value in SETTINGS.items()]
    where = "s3://bucket/typed"
    done = call("campaign", "table2", *options, "--cases", CASES, "--out", where, "--quiet")
    assert done.exit_code == 0, done.output
    same(as_path(where), alone.folder)
    assert as_path(f"{where}/histograms.png").read_bytes().startswith(b"\x89PNG")
    again = call("campaign", "table2", *options, "--out", where)
    assert again.exit_code == 2
    assert "add --resume" in again.stderr
    called = call("stats", where)
    assert called.exit_code == 0, called.output
    assert f"wrote {where}" in called.output
    assert "is as it was written" in call("doctor", where).output
    assert call("plot", where).exit_code == 0
    assert call("sensitivity", where).exit_code == 0
    ok = alone.to_pandas().query("status == 'ok'")["case"].iloc[0]
    one = call("replay", where, "--case", ok, "--no-plots", "--out", tmp_path / "one")
    assert one.exit_code == 0, one.output
    assert "is the same bit by bit" in one.output
    more = ["--cases", 2 * CASES, "--out", where, "--resume", "--no-plots"]
    assert call("campaign", where, *more).exit_code == 0
    assert np.array_equal(shards.stored_cases(as_path(where)), np.arange(2 * CASES))
    replaced = call(
        "campaign", "table2", "--cases", 50, "--out", where, "--overwrite", "--keep", "every:10"
    )
    assert replaced.exit_code == 0, replaced.output
    assert not shards.entries(as_path(where), folders.CASES)
    assert (
        len(
            shards.read_shard(as_path(where), shards.entries(as_path(where), folders.SELECTED)[0])[
                "case"
            ]
        )
        == 5
    )


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("s3://nowhere/run", "s3://nowhere/run: cannot be"),
        ("s4://bucket/run", "s4://bucket/run: cannot be reached"),
    ],
)
def test_what_cannot_be_reached(where, message):
    done = call("campaign", "table2", "--cases", 5, "--out", where)
    assert done.exit_code == 2, done.output
    assert message in done.stderr
