"""Run folders that were damaged: every damage is told, and mended but for the campaign itself. Ten
thousand of them: ``python tests/measure/damage.py``."""

import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from support.damaged_runs import (
    RUNS,
    SETTINGS,
    call,
    contents,
    damage,
    files,
    is_repaired,
    is_reported,
    make_run,
    rows,
)

import sepmc
from sepmc.campaign.store import folders, ledger, manifest_schema, manifests, shards
from sepmc.cli import app


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """A run that keeps all rows, and one that counts its cases and keeps some."""
    folder = tmp_path_factory.mktemp("damage")
    return [make_run(folder / name, *words) for name, words in RUNS.items()]


@pytest.fixture(scope="module")
def whole(wholes):
    return wholes[0]


@pytest.fixture
def folder(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "run")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_every_damage_is_told(wholes, tmp_path, seed):
    whole, rng = wholes[seed % 2], np.random.default_rng(1000 + seed)
    folder = shutil.copytree(whole, tmp_path / "run")
    before = {name: (whole / name).read_bytes() for name in files(whole)}
    done = [damage(folder, rng) for _ in range(int(rng.integers(1, 4)))]
    assert is_reported(folder, before, rows(whole)), done


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_what_is_damaged_is_mended(wholes, tmp_path, seed):
    whole, rng = wholes[seed % 2], np.random.default_rng(2000 + seed)
    folder = shutil.copytree(whole, tmp_path / "run")
    done = [damage(folder, rng) for _ in range(2)]
    assert is_repaired(folder, contents(whole)), done


@pytest.mark.parametrize("lost", ["selected", "accumulators"])
def test_what_is_counted_is_mended(wholes, tmp_path, lost):
    """Also where the list of files forgot some: rows that were kept are not let go unseen."""
    whole, folder = wholes[1], shutil.copytree(wholes[1], tmp_path / "run")
    entries = ledger.read(folder).values()
    ledger.rewrite(folder, [one for one in entries if not one.file.startswith(lost)])
    assert call("doctor", str(folder)) == 1
    assert is_repaired(folder, contents(whole))


def test_selected_rows_are_not_named_as_consecutive_cases(wholes, tmp_path):
    """Of 14 cases 0, 5 and 10 are selected: they are no cases 0 to 2."""
    folder = shutil.copytree(wholes[1], tmp_path / "run")
    (entry,) = shards.entries(folder, folders.SELECTED)
    (folder / entry.file).unlink()
    texts = [one.text for one in manifests.diagnose(folder)]
    assert f"{folder / entry.file}: is gone, with 3 of the cases from 0 on" in texts
    with pytest.raises(folders.StoreError, match="it contained 3 of the cases from 0 on"):
        shards.read_shard(folder, entry)


def test_titles_are_those_of_before(whole, folder):
    """What was set stands in the parts too: without a manifest, a figure is drawn as it was."""
    (folder / folders.MANIFEST).unlink()
    (folder / "histograms.png").unlink()
    assert is_repaired(folder, contents(whole))


@pytest.mark.slow
def test_what_told_of_fewer_cases_goes(folder):
    """A run that grows keeps no table, figure or report of the cases it had; those that come later
    are known to its doctor."""
    reported = ["causes.csv", "distributions.csv", "report.html"]
    for words in (["sensitivity", folder], ["fit", folder], ["report", folder, "--no-replay"]):
        assert call(*map(str, words)) == 0
    assert all((folder / name).is_file() for name in reported)
    assert call("doctor", str(folder)) == 0
    settings = [f"--set={path}={value}" for path, value in SETTINGS.items()]
    words = ["campaign", "table2.toml", *settings, "--quiet", "--out", str(folder), "--resume"]
    assert call(*words, "--cases", "14") == 0
    assert all((folder / name).is_file() for name in reported)
    (folder / "notes.txt").write_text("mine")  # whatever the list of files says
    manifests.record_derived(folder, [folder / "notes.txt"])
    assert call(*words, "--cases", "20") == 0
    assert (folder / "notes.txt").read_text() == "mine"
    assert not any((folder / name).exists() for name in reported)
    assert (folder / "statistics.csv").is_file()
    assert call("doctor", str(folder)) == 0
    assert call("fit", str(folder)) == 0
    (folder / "distributions.csv").write_text("")
    assert call("doctor", str(folder)) == 1
    assert call("doctor", str(folder), "--repair") == 0


def test_a_doctor_wants_a_run(tmp_path):
    assert call("doctor", str(tmp_path)) == 2


def test_another_campaign_is_not_replayed(folder):
    """One edited number in the run's own file: neither a case nor the run goes on with it."""
    path = folder / folders.CAMPAIGN
    path.write_text(path.read_text(encoding="utf-8").replace("458", "459", 1), encoding="utf-8")
    with pytest.raises(folders.StoreError, match="is not the campaign that was run"):
        sepmc.load(folder)
    for words in (["run", folder, "--case", "5"], ["stats", folder], ["doctor", folder]):
        assert call(*map(str, words)) in (1, 2)


def test_a_part_that_is_gone_is_told_with_its_cases(folder):
    part = folder / "cases" / "part-0000000004.parquet"
    part.unlink()
    message = (
        r"part-0000000004\.parquet: is gone; it contained cases 4 to 7\. To run .*, resume=True\)"
    )
    with pytest.raises(folders.StoreError, match=message):
        shards.read_cases(folder)
    assert call("stats", str(folder)) == 2


def test_what_differs_is_named(folder):
    with pytest.raises(folders.StoreError, match=r"upper\.mass_kg: 458.* -> 460"):
        sepmc.load("table2", {"body.upper.mass_kg": 460.0, "run.history_step_s": 0.1}).run(
            cases=14, out=folder, resume=True
        )


def test_a_run_that_was_killed_knows_its_errors(whole, folder):
    """Without a last manifest: what was counted of its parts stands in them."""
    manifest = manifests.read_manifest(folder)
    lost = shards.entries(folder, folders.CASES)[-1]
    ledger.rewrite(folder, [one for one in ledger.read(folder).values() if one != lost])
    message = manifest | {"complete": False, "accuracy": {}, "failures": 0}
    manifests.seal(folder, message)
    campaign = sepmc.load("table2", {"run.chunk": 4, "run.history_step_s": 0.1})
    campaign.run(cases=14, out=folder, resume=True)
    again = manifests.read_manifest(folder)
    assert again["accuracy"] == manifest["accuracy"]
    assert [again[key] for key in ("failures", "complete", "n_stored")] == [0, True, 14]


def test_a_folder_of_an_earlier_format_is_refused_with_the_remedy(folder):
    manifest = manifests.read_manifest(folder)
    assert manifest.pop("format") == manifest_schema.FORMAT
    folders.write_json(folder / folders.MANIFEST, manifest)
    for command in ("stats", "doctor"):
        assert call(command, str(folder)) in (1, 2)
    assert call("doctor", str(folder), "--repair") == 2
    campaign = sepmc.load("table2", {"run.chunk": 4, "run.history_step_s": 0.1})
    with pytest.raises(folders.StoreError, match="folder format 1, this version reads 2"):
        campaign.run(cases=14, out=folder, resume=True)
    campaign.run(cases=14, out=folder, overwrite=True)
    assert call("stats", str(folder)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("how", ["edited", "edited, no manifest", "gone, no manifest"])
def test_the_file_that_was_flown_mends_its_campaign(whole, folder, how):
    """What to do is told by name, and does it."""
    before, path = contents(whole), folder / folders.CAMPAIGN
    if how.startswith("edited"):
        path.write_text(path.read_text().replace("mass_kg = 4", "mass_kg = 5"))
    else:
        path.unlink()
    if "no manifest" in how:
        (folder / folders.MANIFEST).unlink()
    called = CliRunner().invoke(app.main, ["doctor", str(folder), "--repair"])
    assert called.exit_code == 2
    assert f"sepmc campaign FILE --out {folder} --resume" in called.stderr
    settings = [f"--set={path}={value}" for path, value in SETTINGS.items()]
    words = [
        "campaign",
        "table2.toml",
        "--cases",
        "14",
        "--quiet",
        "--out",
        str(folder),
        "--resume",
    ]
    assert call(*words, *settings) == 0
    assert call("doctor", str(folder)) == 0
    assert contents(folder) == before


def test_cases_alone_say_what_was_flown(folder, whole):
    """Neither the manifest nor the list of files is left; a folder without either, nor cases, is
    none of a run."""
    before = contents(whole)
    for name in (folders.MANIFEST, ledger.LEDGER):
        (folder / name).unlink()
    assert call("doctor", str(folder)) == 1
    assert call("doctor", str(folder), "--repair") == 0
    assert contents(folder) == before
    for path in [folder / folders.MANIFEST, folder / ledger.LEDGER, *folder.glob("cases/*")]:
        path.unlink()
    assert call("doctor", str(folder), "--repair") == 2
    assert not (folder / ledger.LEDGER).exists()


def test_the_cases_that_are_flown_stay(tmp_path):
    """Those of a run of some cases only, though its manifest is gone, or one of its parts."""
    for lost in (folders.MANIFEST, "cases/part-0000000020.parquet"):
        folder = tmp_path / lost.partition("/")[0]
        sepmc.load("table2", {"run.history_step_s": 0.0}).run("5:9,20", out=folder)
        assert call("stats", str(folder)) == 0
        before = contents(folder)
        (folder / lost).unlink()
        assert call("doctor", str(folder), "--repair") == 0
        assert contents(folder) == before
        (folder / lost).unlink()
        again = ["campaign", str(folder), "--out", str(folder), "--resume", "--no-plots", "--quiet"]
        assert call(*again) == 0
        assert shards.stored_cases(folder).tolist() == [5, 6, 7, 8, 20]


@pytest.mark.slow
@pytest.mark.parametrize("left", [0, 1])
@pytest.mark.parametrize("kind", ["cases", "single", "statistics"])
def test_a_shorter_list_of_files_is_told(folder, tmp_path, kind, left):
    """Cut at the end of a line, where every line that is left is whole."""
    if kind != "cases":
        folder = tmp_path / kind
        words = ["run", "table1.toml", "--every-s", "0.05"]
        words = words if kind == "single" else ["campaign", "table2.toml", "--stats-only"]
        words += ["--cases", "20"] if kind == "statistics" else []
        assert call(*words, "--quiet", "--out", str(folder)) == 0
    assert manifests.diagnose(folder) == []
    lines = (folder / ledger.LEDGER).read_bytes().splitlines(keepends=True)
    assert len(lines) > left
    (folder / ledger.LEDGER).write_bytes(b"".join(lines[:left]))
    assert manifests.diagnose(folder)
    assert call("doctor", str(folder)) == 1


def test_figures_of_a_single_run_are_told(tmp_path):
    folder = str(tmp_path / "one")
    assert call("run", "table1.toml", "--every-s", "0.05", "--quiet", "--out", folder) == 0
    (tmp_path / "one" / "angles.png").write_bytes(b"")
    (reported,) = manifests.diagnose(tmp_path / "one")
    assert "angles.png: was changed" in reported.text


@pytest.mark.parametrize("with_ledger", [False, True])
def test_the_campaign_and_manifest_of_another_run(wholes, tmp_path, with_ledger):
    """Cases that the ledger knows were flown with another seed than the manifest says: neither
    doctor nor --resume flies on without a word; where the ledger is foreign too, it tells."""
    whole, folder, other = wholes[0], tmp_path / "run", tmp_path / "other"
    shutil.copytree(whole, folder)
    seed = manifests.read_manifest(folder)["seed"]
    sepmc.load(folder).run(seed=seed + 1, out=other)
    names = [folders.MANIFEST, folders.CAMPAIGN, *([ledger.LEDGER] if with_ledger else [])]
    for name in names:
        shutil.copy(other / name, folder / name)
    before = contents(folder)
    message = f"was run with seed {seed}, not the seed {seed + 1}"
    completed = CliRunner().invoke(app.main, ["doctor", str(folder)])
    assert message in " ".join(completed.output.split())
    if with_ledger:
        return
    for words in (
        ["doctor", str(folder), "--repair"],
        ["campaign", str(folder), "--out", str(folder), "--resume", "--seed", str(seed + 1)],
    ):
        called = CliRunner().invoke(app.main, words)
        assert called.exit_code == 2, called.output
        assert "are of another run" in " ".join(called.output.split())
    assert contents(folder) == before


def test_a_summary_that_cannot_be_read_names_its_file(folder, monkeypatch):
    """Of the shards of a run that is continued, in place of the summary another text."""
    read = shards.read_metadata
    monkeypatch.setattr(
        shards, "read_metadata", lambda path: (read(path)[0], read(path)[1] | {b"summary": b"[1"})
    )
    campaign = sepmc.load("table2", {"run.chunk": 4, "run.history_step_s": 0.1})
    first = folder / shards.entries(folder, folders.CASES)[0].file
    message = f"{re.escape(str(first))}: has a summary in its metadata that cannot be read"
    with pytest.raises(folders.StoreError, match=message):
        campaign.run(cases=14, out=folder, resume=True)
