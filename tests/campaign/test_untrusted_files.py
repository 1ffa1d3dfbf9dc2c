"""Files of strangers: each is refused by a sentence, or flown; nothing is written beside a run. A
million of them, at random: ``python tests/measure/fuzz.py``."""

import os
import shutil
import tomllib
from uuid import UUID

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fuzz import brought_files, campaigns, channels, flights, formulas, mutate, run_folders, tables
from fuzz.watch import spread
from support.damaged_runs import call, make_run

import sepmc
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.store import folders, ledger, manifest_schema, manifests, sample_file, shards
from sepmc.scene import limits
from sepmc.scene.messages import InputError, Problems, SceneError
from sepmc.scene.read import parse_campaign, read_text

PLAN = "case,in_body_a_mass_kg,in_body_b_mass_kg\n0,1.0,2.0\n1,1.5,2.5\n"


@pytest.mark.parametrize(
    ("part", "count"),
    [
        (campaigns.trees, 600),
        (campaigns.texts, 600),
        (campaigns.sizes, 25),
        (campaigns.kernels, 6),
        (formulas.formulas, 2000),
        (tables.tables, 150),
        (brought_files.files, 300),
        (channels.channels, 40),
        pytest.param(run_folders.run_folders, 25, marks=pytest.mark.slow),
        pytest.param(flights.rows, 1, marks=pytest.mark.slow),
        pytest.param(flights.numbers, 2, marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_nothing_is_found(part, count):
    tried = spread(part, count, 300.0, seed=7, processes=1)
    assert tried.counts["inputs"] == count
    assert not tried.findings


def small(**changes):
    return tomllib.loads(mutate.SMALL) | changes


def refused(tree):
    """What is said of a tree."""
    with pytest.raises(SceneError) as caught:
        parse_campaign(tree, "x.toml", reader=sample_file.read_input_table)
    return str(caught.value)


def with_body(**values):
    tree = small()
    tree["body"]["a"] |= values
    return tree


def deep(depth):
    inner = {"time_s": 0.1}
    for _ in range(depth):
        inner = {"any": [inner]}
    tree = small()
    tree["phase"][0]["until"] = inner
    return tree


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (with_body(mass_kg=16**5000), "body.a.mass_kg: is a whole number of 20002 bits"),
        (with_body(mass_kg=2**63), "at most 64; write a larger one with a point"),
        (with_body(mass_kg=1e61), "body.a.mass_kg = 1e+61: must be at most 1e+60 in size"),
        (small(body={f"b{i}": {} for i in range(10**6)}), "body: has 1,000,000 entries: must be"),
        (small(title="\x1b[2J"), "title = '\\x1b[2J': must be text without control characters"),
        (small(title="x" * 10**6), "has 1,000,000 characters: must be at most 2,000"),
        (small(**{"a\x1b": 1}), "'a\\x1b': must be text without control characters"),
        (small(name="n" * 65), "letter or digit, at most 64 of them"),
        (small(body={"b" * 65: {}}), "must have at most 64 characters"),
        (deep(5000), "must be at most 32 tables deep"),
        (small(run={f"k{i}": 1 for i in range(2000)}), "there are more problems; only the first"),
        (small(dispersion={"body.a.mass_kg": {"discrete": [1.0] * 1001}}), "1,001 entries"),
        (small(run={"end_time_s": 0.5, "cases": 10**15}), "must be at most 1000000000"),
        (small(run={"end_time_s": 0.5, "samples": "x" * 1000 + ".csv"}), "File name too long"),
        (small(run={"end_time_s": 0.5, "samples": "x\0.csv"}), "without control characters"),
    ],
)
def test_what_is_too_large_is_refused_with_its_size(tree, message):
    assert message in refused(tree)


@pytest.mark.parametrize("size", [1e-300, 5e-324])
def test_what_has_no_direction_is_refused(size):
    pair = {"bodies": ["a", "b"], "point_m": [2.0, 0.0, 0.0]}
    spring = small(spring=[pair | {"name": "s", "axis": [size, 0.0, 0.0], "force_N": 1.0}])
    assert "spring.s.axis" in refused(spring)
    assert "joint.pins.y_axis" in refused(small(joint={"pins": pair | {"x_axis": [size, 0, 0]}}))
    rod = small(joint={"pins": pair | {"second_point_m": [2.0, size, 0.0]}})
    rod["phase"][0]["joints"] = {"pins": "rod"}
    assert "joint.pins.second_point_m" in refused(rod)


def test_tables_are_held_to_their_rows():
    rows = [float(k) for k in range(1001)]
    wind = {"profile": {"altitude_m": rows, "speed_m_s": rows, "direction_deg": rows}}
    assert "has 1,001 values: must have at most 1,000" in refused(
        small(environment={"atmosphere": "none", "wind": wind})
    )


def test_a_design_that_is_too_large_is_refused():
    tree = small()
    tree["run"] |= {"cases": 10**9, "sampler": "lhs"}
    with pytest.raises(InputError, match=r"cases = 1000000000: .* must be at most 150,000,000"):
        Campaign(parse_campaign(tree, "x.toml")).select_cases()


def test_keys_of_many_parts_are_refused_before_they_are_read():
    with pytest.raises(SceneError, match="a key must have at most 100 parts"):
        read_text(("a." * 20_000 + "b = 1").encode(), "x.toml")
    with pytest.raises(SceneError, match="a key must have at most 100 parts"):
        read_text(("a." * 100 + "b = 1").encode(), "x.toml")
    assert read_text(("a." * 99 + "b = 1").encode(), "x.toml")
    assert read_text(b"a = '....'\n# " + b"." * 300, "x.toml") == {"a": "...."}


def test_values_may_have_many_points():
    """A polynomial as a formula; what could be a key is refused even in part."""
    formula = " + ".join(f"0.{k} * time_s" for k in range(200))
    assert read_text(f'formula = "{formula}"  # 1.0'.encode(), "x.toml") == {"formula": formula}
    for key in (
        '"=".X',
        'X."="',
        '",".X',
        'X.","',
        '"=".X.","',
        '["="X]',
        '"=".X."="',
        '"=#".X',
        '",#".X',
    ):
        with pytest.raises(SceneError, match="a key must have at most 100 parts"):
            read_text(f"{key.replace('X', '.'.join('a' * 200))} = 1".encode(), "x.toml")


def sparse(path, size):
    with open(path, "wb") as file:
        file.truncate(size)
    return path


def test_files_are_refused_by_their_size(tmp_path):
    path = sparse(tmp_path / "x.toml", 2**30)
    with pytest.raises(SceneError, match="has 1,073,741,824 bytes: must be at most 4,000,000"):
        sepmc.load(path)
    problems = Problems()
    for name in ("x.csv", "x.parquet"):
        assert sample_file.read_input_table(sparse(tmp_path / name, 10**11), problems) is None
    assert [p.count("has 100,000,000,000 bytes: must be at most 1,000,000,000") for p in problems]


def read_plan(path):
    problems = Problems()
    return sample_file.read_input_table(path, problems), "; ".join(problems)


def test_a_small_table_that_unpacks_to_a_vast_one_is_refused(tmp_path):
    path = tmp_path / "x.parquet"
    column = pa.DictionaryArray.from_arrays(pa.array([0] * 10**6, pa.int32()), pa.array([1.0]))
    with pq.ParquetWriter(path, pa.schema([("a", column.type)])) as writer:
        for _ in range(101):
            writer.write_table(pa.table({"a": column}))
    assert path.stat().st_size < 10**6
    assert (
        "has 101,000,000 rows of 1 columns: must contain at most 100,000,000" in read_plan(path)[1]
    )


def test_a_pipe_is_no_table(tmp_path):
    os.mkfifo(tmp_path / "x.csv")
    assert "is no regular file" in read_plan(tmp_path / "x.csv")[1]


@pytest.mark.parametrize(
    ("column", "message"),
    [
        (pa.array([1, 2], pa.duration("ns")), "is no number"),
        (pa.array([1, 2], pa.timestamp("us", "Nowhere/X")), "is no number"),
        (pa.array([[1.0], [2.0]]), "is no number"),
        (pa.array([True, False]), "'True' in case 0 is no number"),
        (pa.array(["1.5", "\x1b[2J"]), "'\\x1b[2J' in case 1 is no number"),
    ],
)
def test_what_is_no_number_becomes_none(tmp_path, column, message):
    pq.write_table(pa.table({"x": column, "y": [1.0, 2.0]}), tmp_path / "x.parquet")
    table, _ = read_plan(tmp_path / "x.parquet")
    assert list(table.columns) == ["y"]
    assert message in table.words["x"]


def test_metadata_of_a_table_is_not_followed(tmp_path):
    table = pa.table({"y": [1.0, 2.0]}).replace_schema_metadata({b"pandas": b"{"})
    pq.write_table(table, tmp_path / "x.parquet")
    assert read_plan(tmp_path / "x.parquet")[0].columns["y"].tolist() == [1.0, 2.0]


def test_a_column_that_stands_twice_is_told(tmp_path):
    (tmp_path / "x.csv").write_text("a,a\n1,2\n")
    assert "has column a twice" in read_plan(tmp_path / "x.csv")[1]


@pytest.mark.parametrize("plan", ["../plan.csv", "/plan.csv", "link.csv", "sub/../../plan.csv"])
def test_a_file_names_a_table_beside_it_only(tmp_path, plan):
    (tmp_path / "plan.csv").write_text(PLAN)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.csv").symlink_to(tmp_path / "plan.csv")
    shutil.copy(tmp_path / "plan.csv", inside / "own.csv")
    path = inside / "x.toml"
    text = mutate.SMALL.replace("end_time_s = 0.5", 'end_time_s = 0.5, samples = "PLAN"')
    path.write_text(text.replace("PLAN", plan))
    with pytest.raises(SceneError, match="must lie beside the campaign, or in a folder there"):
        sepmc.load(path)
    path.write_text(text.replace("PLAN", "own.csv"))
    assert sepmc.load(path).numbers.count == 2
    assert sepmc.load(path, {"run.samples": str(tmp_path / "plan.csv")}).numbers.count == 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("strangers") / "whole")


@pytest.fixture
def folder(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "run")


READERS = (["stats"], ["doctor"], ["doctor", "--repair"], ["fit"], ["replay", "--case", "1"],
           ["export", "--format", "csv"])  # fmt: skip


@pytest.mark.parametrize(
    "name", ["manifest.json", "checksums.jsonl", "cases", "statistics.csv.tmp"]
)
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_links_and_pipes_in_a_run_are_refused(folder, tmp_path, name, kind):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "part-0000000000.parquet").write_text("precious")
    path = folder / name
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    target = outside if name == "cases" else outside / "part-0000000000.parquet"
    path.symlink_to(target) if kind == "link" else os.mkfifo(path)
    for words in READERS:
        assert call(words[0], str(folder), *words[1:]) == 2
    for way in ("--resume", "--overwrite"):
        again = ("campaign", "table2.toml", "--cases", "14", "--out", str(folder), way)
        assert call(*again, "--no-plots", "--quiet") == 2
    assert [p.read_text() for p in outside.iterdir()] == ["precious"]


def test_a_file_with_another_name_elsewhere_is_refused(folder, tmp_path):
    os.link(folder / ledger.LEDGER, tmp_path / "other")
    assert call("stats", str(folder)) == 2


def test_a_file_that_is_written_is_a_new_one(tmp_path, monkeypatch):
    monkeypatch.setattr(ledger, "uuid4", lambda: UUID(int=0))
    draft = f"x.{UUID(int=0).hex[:8]}.tmp"
    other = tmp_path / "other"
    for link in (os.link, os.symlink):
        other.write_text("precious")
        link(other, tmp_path / draft)
        with pytest.raises(FileExistsError):
            ledger.write_atomically(tmp_path / "x", b"new")
        assert other.read_text() == "precious"
        (tmp_path / draft).unlink()
        link(other, tmp_path / "x")
        ledger.write_atomically(tmp_path / "x", b"new")
        assert (tmp_path / "x").read_bytes() == b"new"
        assert other.read_text() == "precious"
        (tmp_path / "x").unlink()


@pytest.mark.parametrize(
    "entry",
    [
        ledger.Entry("../outside", 1, "0"),
        ledger.Entry("/etc/passwd", 1, "0"),
        ledger.Entry("cases/../../x", 1, "0"),
        ledger.Entry("cases/x", 10**15, "0"),
        ledger.Entry("cases/x", 10, "0", 0, 10**6),
        ledger.Entry("cases/x", 10**6, "0", 10**9, 1),
        ledger.Entry("cases/x", 10**6, "0", -1, 1),
    ],
)
def test_lines_that_tell_of_what_cannot_be_say_nothing(folder, entry):
    before = dict(ledger.read(folder))
    ledger.add(folder, entry)
    assert dict(ledger.read(folder)) == before
    assert ledger.count_damaged_lines(folder) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cases": 10**15}, "<= 1000000000"),
        ({"cases": "x"}, "Expected `int`"),
        ({"sessions": []}, "sessions is missing"),
        ({"notes": ["\x1b[2J"]}, "must be text without control characters"),
        ({"seed": None}, "seed is missing"),
        ({"accuracy": {"errors": {"x": "y"}}}, "Expected `float | null`"),
    ],
)
def test_a_forged_manifest_is_told(folder, changes, message):
    """With the checksum that it should have."""
    run_folders._seal(
        folder, manifest_schema.read((folder / folders.MANIFEST).read_bytes()) | changes
    )
    with pytest.raises(folders.StoreError) as caught:
        manifests.read_manifest(folder)
    assert message in str(caught.value)


def test_a_manifest_that_is_deep_is_told(folder):
    (folder / folders.MANIFEST).write_text("[" * 10**5)
    assert call("stats", str(folder)) == 2


def _changed(table, way):
    if way == "status":
        return table.set_column(1, "status", pa.array(["fine"] * table.num_rows))
    if way == "rows":
        return pa.concat_tables([table, table])
    if way == "case":
        return table.set_column(0, "case", pa.array([7] * table.num_rows))
    if way == "text":
        last = table.num_columns - 1
        return table.set_column(last, table.column_names[last], pa.array(["1"] * table.num_rows))
    return table.drop_columns(["separation_distance_mm"])


@pytest.mark.parametrize(
    ("way", "message"),
    [
        ("status", "unknown status: 'fine'"),
        ("rows", "has 8 rows, and should have 4"),
        ("case", "has other cases than 0 to 3"),
        ("text", "of another type than runs write: string"),
        ("lost", "differ in columns|no column separation_distance_mm"),
    ],
)
def test_forged_parts_are_told(folder, way, message):
    path = folder / "cases" / "part-0000000000.parquet"
    pq.write_table(_changed(pq.read_table(path), way), path)
    run_folders._reseal(folder)
    with pytest.raises(folders.StoreError, match=message):
        shards.CaseColumns(folder)["separation_distance_mm"]
    for words in READERS[0], READERS[3]:
        assert call(words[0], str(folder)) == 2


def test_limits_leave_room_for_what_is_flown():
    """Ten times what the largest campaign that is shipped has."""
    texts = mutate.bases()
    assert max(map(len, texts.values())) * 10 < limits.CAMPAIGN_BYTES
    for text in texts.values():
        tree = tomllib.loads(text)
        for key in ("body", "joint", "phase", "motor", "spring"):
            assert len(tree.get(key, ())) * 5 < limits.ITEMS[key]
