"""The run folder: nothing is lost unasked, every column says what it is, and what is read is what
was written."""

import json
import re
import shutil
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import sepmc
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.execution.replay import compare_row, earlier_integration
from sepmc.campaign.store import folders, ledger, manifests, result_files, shards
from sepmc.campaign.store.untrusted import StoreError
from sepmc.cli import app
from sepmc.schema import Column

COLUMNS = [
    Column("case", "1", "number"),
    Column("status", "", "how it went"),
    Column("speed_m_s", "m/s", "speed"),
]
# names without a unit of the list below
PLAIN = ("case", "status", "joint_angle_residual_rad", "attitude_drift", "error", "energy_residual")
PLAIN += ("smallest_pivot", "redundant_rows", "attitude_singular", "steps")
BODY = [
    "alpha_deg",
    "beta_deg",
    "alpha_ref_deg",
    "omega_x_deg_s",
    "omega_y_deg_s",
    "omega_z_deg_s",
    "roll_deg",
    "yaw_deg",
    "pitch_deg",
]
OUTCOMES = [f"{body}_{name}" for body in ("upper", "lower") for name in BODY]
OUTCOMES += ["separation_speed_m_s", "separation_distance_mm", "release_time_s"]
UNIT = [
    (r"_deg$", "deg"),
    (r"_deg_s$", "deg/s"),
    (r"_m_s$", "m/s"),
    (r"_rad_s$", "rad/s"),
    (r"_mm$", "mm"),
    (r"_kg$", "kg"),
    (r"_s$", "s"),
    (r"_m$", "m"),
]


def part(first, count):
    number = np.arange(first, first + count)
    speed = np.where(number == 4, np.nan, number / 7.0)
    return {
        "case": number,
        "status": np.array(["ok", "not-finite"], dtype=object)[number % 2],
        "speed_m_s": speed,
    }


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("store") / "run"
    sepmc.load("table2", {"run.chunk": 4}).run(cases=10, out=folder)
    return folder


def test_every_column_has_unit_and_meaning(run_folder):
    schema = pq.read_schema(run_folder / "cases" / "part-0000000000.parquet")
    inputs = [name for name in schema.names if name.startswith("in_")]
    assert schema.names == [
        "case",
        "status",
        *inputs,
        *OUTCOMES,
        "joint_gap_residual_m",
        "joint_angle_residual_rad",
        "joint_gap_rate_residual_m_s",
        "joint_angle_rate_residual_rad_s",
        "attitude_drift",
        "energy_residual",
        "smallest_pivot",
        "redundant_rows",
        "event_residual_s",
        "attitude_singular",
        "steps",
        "error",
    ]
    assert len(inputs) == len(sepmc.load("table2").file.dispersions)
    for field in schema:
        unit, meaning = field.metadata[b"unit"].decode(), field.metadata[b"meaning"].decode()
        assert len(meaning) >= 10, field.name
        expected_unit = next((u for pattern, u in UNIT if re.search(pattern, field.name)), None)
        assert expected_unit is None or expected_unit == unit, field.name
        assert expected_unit or field.name in PLAIN or field.name.endswith("_factor"), field.name
    for field in pq.read_schema(run_folder / "histories" / "part-0000000004.parquet"):
        assert field.metadata[b"unit"]
        assert field.metadata[b"meaning"]


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("body.upper.inertia_kg_m2.xx", "kg m2"),
        ("body.upper.inertia_slug_ft2.xx", "slug ft2"),
        ("initial.omega_rad_s.x", "rad/s"),
    ],
)
def test_units_of_inputs(key, unit):
    columns = sepmc.load("table2", {"dispersion": {key: {"uniform": 0.001}}}).input_columns
    assert [column.unit for column in columns] == [unit]


def test_numbers_without_dimension_have_unit_1():
    assert {c.unit for c in sepmc.load("table2").input_columns if c.name.endswith("_factor")} == {
        "1"
    }


def test_parts_are_named_by_their_first_case(run_folder):
    for kind in ("cases", "histories"):
        assert sorted(p.name for p in (run_folder / kind).iterdir()) == [
            f"part-{first:010d}.parquet" for first in (0, 4, 8)
        ]
    assert not list(run_folder.rglob("*.tmp"))
    assert shards.stored_cases(run_folder).tolist() == list(range(10))
    pd.testing.assert_frame_equal(
        shards.read_cases(run_folder).drop(columns="status"),
        pd.read_parquet(run_folder / "cases").drop(columns="status"),
    )
    assert shards.units(run_folder)["separation_distance_mm"] == "mm"


def test_table_round_trip(tmp_path):
    for first in (3, 0):  # written in any order, read in order of case
        written = shards.write_shard(tmp_path, folders.CASES, first, 3, COLUMNS, part(first, 3), {})
        shards.record_shards(tmp_path, [written])
    frame = shards.read_cases(tmp_path)
    assert frame["case"].tolist() == list(range(6))
    assert frame["status"].tolist() == ["ok", "not-finite"] * 3
    np.testing.assert_array_equal(frame["speed_m_s"], part(0, 6)["speed_m_s"])
    # NaN is a number that is none, not null
    assert pq.read_table(shards.shard_path(tmp_path, folders.CASES, 3))["speed_m_s"].null_count == 0
    field = shards.arrow_table(COLUMNS, part(0, 2)).schema.field("speed_m_s")
    assert field.metadata == {b"unit": b"m/s", b"meaning": b"speed"}


def test_next_folder(tmp_path):
    assert folders.next_folder("a", tmp_path) == tmp_path / "a-1"
    (tmp_path / "a-1").mkdir()
    (tmp_path / "a-3").mkdir()
    assert folders.next_folder("a", tmp_path) == tmp_path / "a-2"
    assert folders.next_folder("b", tmp_path) == tmp_path / "b-1"


def test_open_folder(tmp_path):
    with folders.opened(tmp_path / "deep" / "run") as folder:
        assert folder.is_dir()
    assert not folder.parent.exists()  # nothing came of it
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(StoreError, match=r"no manifest\.json, so it is not a run"):
        enter(folder)
    (folder / "notes.txt").unlink()
    enter(folder)  # empty: nothing to lose
    folders.write_json(folder / folders.MANIFEST, {})
    with pytest.raises(StoreError, match=r"exists; add overwrite=True.*another out"):
        enter(folder)  # no cases to go on from
    (folder / folders.CASES).mkdir()
    with pytest.raises(StoreError, match=r"resume=True.*overwrite=True.*another out"):
        enter(folder)
    enter(folder, resume=True)
    assert (folder / folders.MANIFEST).exists()
    enter(folder, overwrite=True)
    assert not (folder / folders.MANIFEST).exists()


def enter(folder, **how):
    with folders.opened(folder, **how):
        pass


HOLDS = """
import sys, time
from pathlib import Path
from sepmc.campaign.store import folders
with folders.opened(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_one_process_writes(tmp_path):
    """A second one is refused, until the first is through, or killed."""
    command = [sys.executable, "-c", HOLDS, str(tmp_path / "run")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    for end in (lambda one: one.communicate(""), lambda one: one.kill()):
        with subprocess.Popen(command, **pipes) as other:
            assert other.stdout.readline() == "held\n"
            with pytest.raises(StoreError, match="another process writes into it"):
                enter(tmp_path / "run")
            end(other)
            other.wait()
        enter(tmp_path / "run")


def test_a_write_that_fails_leaves_the_old_text(tmp_path, monkeypatch):
    folders.write_text(tmp_path / "a.txt", "old")
    monkeypatch.setattr(ledger.os, "replace", lambda *_: (_ for _ in ()).throw(OSError("no space")))
    with pytest.raises(OSError, match="no space"):
        folders.write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize("content", [b"{", b"", b"[]", b"\xff\xfe"])
def test_broken_manifest(tmp_path, content):
    """Half a table, nothing, a list, binary junk."""
    (tmp_path / folders.MANIFEST).write_bytes(content)
    with pytest.raises(StoreError, match=r"manifest\.json"):
        manifests.read_manifest(tmp_path)


@pytest.mark.parametrize(
    "mine", ["notes.txt", "mine/cases/part-0000000000.parquet", "test_stand.png"]
)
def test_overwrite_takes_only_what_a_run_made(tmp_path, mine):
    """What the user put into the folder stays, pictures too."""
    made = [
        "manifest.json",
        "statistics.csv",
        "statistics.json",
        "campaign.toml",
        "histograms.png",
        "cases/part-0000000000.parquet",
    ]
    for name in (mine, *made):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x", encoding="utf-8")
    enter(tmp_path, overwrite=True)
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [tmp_path / mine]


@settings(deadline=None)
@given(st.integers(1, 60), st.lists(st.integers(0, 80)), st.integers(1, 20))
def test_numbers_left(cases, done, chunk):
    """Every case not done once, in order, in ranges no longer than a chunk, split only where they
    must be."""
    stored = np.array(sorted({i for i in done if i < cases}), dtype=np.int64)
    ranges = list(CaseSelection.first(cases).without(stored).split(chunk))
    assert [i for first, end in ranges for i in range(first, end)] == [
        i for i in range(cases) if i not in done
    ]
    assert all(0 < end - first <= chunk for first, end in ranges)
    assert all(b[0] > a[1] or a[1] - a[0] == chunk for a, b in pairwise(ranges))


def test_broken_part(tmp_path):
    """A sentence, not pyarrow's traceback, where the checksum is that of junk too."""
    (tmp_path / "cases").mkdir()
    junk = b"PAR1 junk PAR1"
    (tmp_path / "cases" / "part-0000000000.parquet").write_bytes(junk)
    ledger.add(tmp_path, ledger.make_entry("cases/part-0000000000.parquet", junk, 0, 3))
    with pytest.raises(StoreError, match="cannot be read"):
        shards.read_cases(tmp_path)


def test_statistics_files(tmp_path):
    table = pd.DataFrame(
        {"n": [2, 0], "mean": [0.1 + 0.2, np.nan]},
        index=pd.Index(["speed_m_s", "release_time_s"], name="outcome"),
    )
    units = {"speed_m_s": "m/s", "release_time_s": "s"}
    rows = result_files.statistics_as_json(table, {"ok": 2}, units, pd.DataFrame())
    result_files.write_statistics(tmp_path, table, units, rows)
    csv = (tmp_path / "statistics.csv").read_text(encoding="utf-8")
    assert csv.splitlines() == [
        "outcome,unit,n,mean",
        "speed_m_s,m/s,2,0.30000000000000004",
        "release_time_s,s,0,",
    ]
    data = json.loads(
        (tmp_path / "statistics.json").read_text(encoding="utf-8"), parse_constant=pytest.fail
    )
    assert data["cases"] == {"ok": 2}
    assert [data["outcomes"][name]["mean"] for name in ("speed_m_s", "release_time_s")] == [
        0.1 + 0.2,
        None,
    ]


@pytest.mark.parametrize(
    "other", [{"run.seed": 5}, {"body.upper.mass_kg": 460.0}, {"solver.formulation": "full"}]
)
def test_resume_of_another_campaign_is_refused(run_folder, other):
    before = {p: p.read_bytes() for p in run_folder.rglob("*") if p.is_file()}
    with pytest.raises(StoreError, match="was run with another"):
        sepmc.load("table2", other).run(cases=20, out=run_folder, resume=True)
    with pytest.raises(StoreError, match="resume=True"):
        sepmc.load("table2").run(cases=20, out=run_folder)
    assert {p: p.read_bytes() for p in run_folder.rglob("*") if p.is_file()} == before


def test_resume_with_fewer_cases(run_folder, tmp_path):
    """Refused: the folder would hold more cases than its manifest says."""
    folder = shutil.copytree(run_folder, tmp_path / "run")
    before = (folder / folders.MANIFEST).read_bytes()
    with pytest.raises(StoreError, match="contains cases up to 9; cases=5 would leave some out"):
        sepmc.load("table2", {"run.chunk": 4}).run(cases=5, out=folder, resume=True)
    assert (folder / folders.MANIFEST).read_bytes() == before


def test_manifest_is_json(tmp_path):
    """A number that is not finite is null: no JSON reader but Python's takes the word NaN."""
    folders.write_json(tmp_path / folders.MANIFEST, {"outcomes": {"release_time_s": float("nan")}})
    json.loads(
        (tmp_path / folders.MANIFEST).read_text(encoding="utf-8"), parse_constant=pytest.fail
    )


def test_a_run_of_a_version_with_other_columns(run_folder, tmp_path):
    """Its statistics and replays stay, but it is not continued: parts would not fit together."""
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    manifest = manifests.read_manifest(folder)
    for one in shards.entries(folder, "cases"):
        path = folder / one.file
        pq.write_table(pq.ParquetFile(path).read().drop_columns(["error"]), path)
        ledger.add(folder, ledger.make_entry(one.file, path.read_bytes(), one.first, one.cases))
    manifests.seal(folder, manifest)
    campaign = sepmc.load("table2", {"run.chunk": 4})
    with pytest.raises(StoreError, match="of sepmc, whose rows differ in the columns error, so"):
        campaign.run(cases=12, out=folder, resume=True)
    again = sepmc.load(str(folder))
    result = compare_row(again, earlier_integration(again), folder, 7, campaign.scene.run.seed, 10)
    assert (result.was_run, result.columns) == (True, ())
    assert CliRunner().invoke(app.main, ["stats", str(folder)]).exit_code == 0


def test_a_disk_that_is_full_at_once_leaves_nothing(table2, tmp_path, monkeypatch):
    """No folder that the same command then refuses; nor does what a killed process left."""
    folder = tmp_path / "run"
    table2.run(cases=10)  # writes its kernel into the cache, which has other errors

    def full(*paths):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(ledger.os, "replace", full)
        with pytest.raises(folders.StoreError, match="No space left"):
            table2.run(cases=10, out=folder)
    assert not folder.exists()
    folder.mkdir()
    (folder / "manifest.json.0123abcd.tmp").write_bytes(b"")
    assert table2.run(cases=10, out=folder).status_counts["ok"] == 10
    assert not list(folder.glob("*.tmp"))
