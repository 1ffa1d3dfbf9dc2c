"""The command line: `sepmc campaign` and what follows it, from the run folder alone."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import pandas as pd
import pytest
from click.testing import CliRunner
from small_scenes import BODIES

import sepmc as package
from sepmc.campaign.campaign import Campaign
from sepmc.cli import app, check

CASES = 50


def call(*arguments, code=0):
    """A command that must succeed, or end with that code; what it printed."""
    result = CliRunner().invoke(app.main, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.stderr
    return result


def fly(out, *options):
    return call("campaign", "table2.toml", "--no-plots", "--quiet", "--out", out, *options)


def rows(folder):
    return pd.read_parquet(folder / "cases").sort_values("case", ignore_index=True)


def same(one, other):
    pd.testing.assert_frame_equal(rows(one), rows(other), check_exact=True)


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A run of 50 cases in chunks of 20, never changed by a test."""
    folder = tmp_path_factory.mktemp("cli") / "run"
    result = fly(folder, "--cases", CASES, "--set", "run.chunk=20")
    assert (result.stdout, result.stderr) == ("", "")
    return folder


@pytest.fixture
def copied(campaign, tmp_path):
    return shutil.copytree(campaign, tmp_path / "copy")


def test_compile_fills_the_cache(tmp_path):
    """A campaign then compiles nothing."""
    cold = ("--set", "run.history_step_s=0.0")
    assert "table2: its kernel is in the cache" in call("compile", "table2.toml", *cold).stdout
    called = call(
        "campaign", "table2.toml", *cold, "--cases", 10, "--no-plots", "--out", tmp_path / "run"
    ).stdout
    assert "compiling" not in called


def test_run_folder(campaign):
    files = [
        "campaign.toml",
        "cases",
        "checksums.jsonl",
        "histories",
        "manifest.json",
        "statistics.csv",
        "statistics.json",
    ]
    assert sorted(p.name for p in campaign.iterdir()) == files
    frame, entries, loaded = rows(campaign), manifest(campaign), package.load(campaign)
    assert frame["case"].tolist() == list(range(CASES))
    assert (frame["status"] == "ok").all()
    assert entries["digest"] == loaded.digest == package.load("table2").digest
    assert (
        entries["campaign"],
        entries["seed"],
        entries["cases"],
        entries["complete"],
        entries["failures"],
    ) == (
        "table2",
        2019,
        CASES,
        True,
        0,
    )
    assert (loaded.scene.run.cases, loaded.scene.run.seed) == (CASES, 2019)
    (session,) = entries["sessions"]
    assert set(session["timing_s"]) == {"text", "compile", "steps", "sample", "kernel", "write"}
    assert {"python", "numpy", "numba", "pandas", "pyarrow"} <= set(session["versions"])
    assert (entries["n_stored"], session["cases_flown"]) == (CASES, CASES)
    table = pd.read_csv(campaign / "statistics.csv", index_col="outcome")
    assert table.loc["upper_roll_deg", "max"] == pytest.approx(
        frame["upper_roll_deg"].max(), rel=1e-12
    )


def test_stats_again(copied):
    """Byte for byte, and printed."""
    before = {p: p.read_bytes() for p in copied.glob("statistics.*")}
    for path in before:
        path.unlink()
    assert "50 cases, 50 ok" in call("stats", copied).stdout
    assert {p: p.read_bytes() for p in copied.glob("statistics.*")} == before


@pytest.mark.slow
def test_plots(copied):
    printed = call("plot", copied).stdout.split()
    figures = sorted(copied.glob("*.png"))
    assert sorted(printed) == [str(p) for p in figures]
    assert copied / "histograms.png" in figures
    (copied / "notes.txt").write_text("mine", encoding="utf-8")
    result = call("campaign", "table2.toml", "--cases", 3, "--out", copied, "--overwrite")
    assert len(rows(copied)) == manifest(copied)["cases"] == 3
    assert (copied / "notes.txt").read_text(encoding="utf-8") == "mine"
    printed_only = ("convergence", "hist_")
    assert sorted(copied.glob("*.png")) == [
        p for p in figures if not p.stem.startswith(printed_only)
    ]
    assert re.search(r"^3/3 cases, \d+ cases/s, 0 s left, 0 failures$", result.stderr, re.M)


@pytest.mark.slow
def test_the_figures_that_matter(copied, monkeypatch):
    """By default of a few outcomes, the first by rank, and it says so; of all if asked."""
    for figure in copied.glob("*.png"):
        figure.unlink()
    monkeypatch.setattr("sepmc.cli.figures._DRAWN", 2)
    result = call("plot", copied)
    assert len(list(copied.glob("hist_*.png"))) == 2
    assert re.search(r"first 2 outcomes; of all: sepmc plot .* --all", result.stderr)
    result = call("plot", copied, "--all")
    assert len(list(copied.glob("hist_*.png"))) > 5
    assert not result.stderr


def test_options_reach_the_run(campaign, tmp_path):
    fly(tmp_path / "a", "--cases", CASES, "--threads", 1)
    same(tmp_path / "a", campaign)
    options = [
        "--set",
        "body.upper.mass_g=460000",
        "--set",
        "body.upper.cg_mm.x=1300",
        "--set",
        "motor.retro.thrust_kN=0.6",
    ]
    options += [
        "--set",
        "phase.guided.until.stroke_mm=20",
        "--set",
        'dispersion."initial.yaw_deg"={ constant = 1.0 }',
        "--set",
        'dispersion."initial.pitch_deg".uniform=0.25',
        "--seed",
        7,
    ]
    fly(tmp_path / "b", "--cases", 4, *options)
    law = package.load(tmp_path / "b").file.tree["dispersion"]["initial.pitch_deg"]
    assert law == {"uniform": 0.25}
    kept = package.load(tmp_path / "b").scene
    assert (
        kept.body["upper"].mass,
        kept.motor[0].thrust,
        kept.phase[1].until.stroke,
        kept.run.seed,
    ) == (460.0, 600.0, 0.02, 7)
    assert kept.body["upper"].cg == pytest.approx((1.3, 0.0056, 0.0001))
    assert (rows(tmp_path / "b")["in_initial_yaw_deg"] == 1.0).all()
    assert rows(tmp_path / "b")["in_body_upper_mass_kg"].between(440.0, 480.0).all()


@pytest.mark.parametrize(
    ("gone", "cases"), [("part-0000000020.parquet", CASES), ("statistics.*", 70)]
)
def test_resume_makes_the_table_of_an_uninterrupted_run(copied, tmp_path, gone, cases):
    """After the loss of a part, and with more cases than before: 20 are flown, and the whole is
    that of a single run."""
    for path in copied.rglob(gone):
        path.unlink()
    options = ["--no-plots", "--out", copied, "--cases", cases, "--resume"]
    called = call("campaign", "table2.toml", *options).stdout
    assert f"{cases} cases, 20 of them run now: " in called
    fly(tmp_path / "whole", "--cases", cases)
    same(copied, tmp_path / "whole")
    assert (copied / "statistics.csv").read_bytes() == (
        tmp_path / "whole" / "statistics.csv"
    ).read_bytes()
    entries = manifest(copied)
    assert (entries["cases"], entries["complete"], entries["n_stored"], entries["failures"]) == (
        cases,
        True,
        cases,
        0,
    )
    assert [session["cases_flown"] for session in entries["sessions"]] == [CASES, 20]


def interrupt(monkeypatch, *arguments):
    """Run a command with Ctrl-C in the middle: as the first chunk is told."""

    def told(done, left, failures):
        if done:
            raise KeyboardInterrupt

    run = Campaign.run
    with monkeypatch.context() as patch:
        patch.setattr(
            Campaign, "run", lambda *given, **named: run(*given, **(named | {"progress": told}))
        )
        return CliRunner().invoke(app.main, [str(a) for a in arguments])


def test_interrupt_keeps_what_is_done(campaign, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    result = interrupt(monkeypatch, "campaign", campaign, "--quiet", "--no-plots", "--out", folder)
    assert (result.exit_code, "--resume" in result.stderr) == (130, True)
    assert rows(folder)["case"].tolist() == list(range(20))
    assert manifest(folder)["complete"] is False
    call("campaign", folder, "--quiet", "--no-plots", "--out", folder, "--resume")
    same(folder, campaign)
    assert manifest(folder)["complete"] is True


def _interrupted(*_, **__):
    raise KeyboardInterrupt


def _terminated(*_, **__):
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    ("end", "code", "word"), [(_interrupted, 130, "interrupted"), (_terminated, 143, "terminated")]
)
def test_end_before_anything_is_flown(tmp_path, monkeypatch, end, code, word):
    """Nothing to go on from; any command that Ctrl-C or SIGTERM ends has the exit code of that;
    what handled the signal before handles it afterwards."""
    monkeypatch.setattr(Campaign, "run", end)
    result = CliRunner().invoke(
        app.main, ["campaign", "table2.toml", "--out", str(tmp_path / "run")]
    )
    assert (result.exit_code, f"\n{word}; no case was run yet" in result.stderr) == (code, True)
    monkeypatch.setattr(check, "load_campaign", end)
    result = CliRunner().invoke(app.main, ["check", "table2.toml"])
    assert (result.exit_code, result.stderr) == (code, f"\n{word}\n")
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_only_a_folder_with_cases_may_be_resumed(tmp_path):
    call("run", "table1.toml", "--no-plots", "--quiet", "--every-s", 0.1, "--out", tmp_path / "one")
    arguments = ["campaign", "table1.toml", "--quiet", "--out", str(tmp_path / "one")]
    result = CliRunner().invoke(app.main, arguments)
    assert (result.exit_code, "--resume" in result.stderr) == (2, False)
    assert "add --overwrite to replace it" in result.stderr


def test_a_scene_without_dispersions_is_said(tmp_path):
    """Its cases are all the nominal one."""
    out = ("--no-plots", "--quiet", "--out", tmp_path / "one")
    result = call("run", "table1.toml", "--case", 3, "--every-s", 0.1, *out)
    assert "nothing is dispersed" in result.stderr


def test_check_says_what_has_no_effect():
    result = call("check", "table2.toml", "--set", "environment.wind.direction_deg=90")
    assert "environment.wind.direction_deg = 90 applies to the nominal case only" in result.stderr


@pytest.mark.parametrize("from_folder", [False, True])
def test_replay(campaign, tmp_path, from_folder):
    """One case alone, from the file or from the run folder: the campaign's own row, to the accuracy
    of either kernel."""
    row = rows(campaign).iloc[3]
    printed = call(
        "run",
        campaign if from_folder else "table2.toml",
        "--case",
        3,
        "--out",
        tmp_path,
        "--no-plots",
    ).stdout
    assert f"{row['separation_distance_mm']:.9g}" in printed
    entries = manifest(tmp_path)
    assert (entries["case"], entries["status"], entries["digest"]) == (
        3,
        "ok",
        manifest(campaign)["digest"],
    )
    assert entries["inputs"] == row.filter(like="in_").to_dict()
    scatter = rows(campaign).std(numeric_only=True)
    for name in (column.name for column in package.load(campaign).outcome_columns):
        assert entries["outcomes"][name] == pytest.approx(
            row[name], rel=0, abs=2e-9 * max(abs(row[name]), scatter[name])
        ), name
    if from_folder:  # and its figures, from its files alone
        assert (
            sorted(call("plot", tmp_path).stdout.split())
            == sorted(str(p) for p in tmp_path.glob("*.png"))
            != []
        )


@pytest.mark.slow
def test_figures_of_a_case_that_are_drawn_again_are_noted(tmp_path):
    """So that none of them counts as changed."""
    words = ["run", "table1.toml", "--quiet", "--every-s", "0.1", "--out", str(tmp_path / "one")]
    for each in (words, ["plot", str(tmp_path / "one")], ["doctor", str(tmp_path / "one")]):
        result = CliRunner().invoke(app.main, each)
        assert result.exit_code == 0, result.output


def test_replay_at_a_given_step(tmp_path):
    """By the full system: the same inputs to the last bit, the same outcomes to round-off."""
    fly(
        tmp_path / "run",
        "--cases",
        5,
        "--set",
        "solver.step_s=0.05",
        "--set",
        "solver.formulation=full",
    )
    call("run", tmp_path / "run", "--case", 3, "--out", tmp_path / "one", "--no-plots")
    entries, row = manifest(tmp_path / "one"), rows(tmp_path / "run").iloc[3]
    assert entries["inputs"] == row.filter(like="in_").to_dict()
    for name in (column.name for column in package.load("table2").outcome_columns):
        assert entries["outcomes"][name] == pytest.approx(row[name], rel=1e-9, abs=1e-9), name


def test_the_line_to_go_on_with_goes_on(tmp_path, monkeypatch):
    """It leaves out --cases, --seed and --set; the folder as FILE would hold them all."""
    options = ["--cases", 6, "--seed", 5, "--set", "run.chunk=2", "--set", "body.upper.mass_kg=460"]
    result = interrupt(
        monkeypatch, "campaign", "table2.toml", *options, "--no-plots", "--out", tmp_path / "run"
    )
    call(*result.stderr.rsplit("Continue with: sepmc ", 1)[1].split(), "--no-plots")
    assert len(rows(tmp_path / "run")) == 6


def test_words():
    assert (
        f"{len(package.load('table2').file.dispersions)} parameters"
        in call("check", "table2").stdout
    )
    laws = ", ".join(
        f'"body.lower.inertia_kg_m2.{axis}" = {{ uniform = 0.1, relative = true }}'
        for axis in ("xx", "yy", "zz")
    )
    warned = call("check", "table2", "--set", f"dispersion={{{laws}}}").stderr
    assert re.search(
        r"warning: \d+ of 10000 sampled cases have an inertia that breaks the triangle inequality",
        warned,
    )
    assert "table2.toml" in call("list").stdout
    assert package.__version__ in call("--version").stdout
    for command in ([], ["campaign"], ["run"], ["stats"], ["plot"], ["check"], ["list"]):
        assert call(*command, "--help").stdout.startswith("Usage:")


def python(*arguments, **options):
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def test_help_imports_nothing_heavy():
    done = python("-X", "importtime", "-m", "sepmc", "--help")
    assert done.returncode == 0
    imported = {
        line.rsplit("|", 1)[1].strip().split(".")[0]
        for line in done.stderr.splitlines()
        if "|" in line
    }
    assert "click" in imported
    assert not imported & {"numba", "pandas", "pyarrow", "matplotlib", "numpy", "scipy", "tqdm"}


@pytest.mark.slow
def test_the_program_itself(tmp_path):
    """`python -m sepmc` in a folder of its own, good and bad."""
    good = python(
        "-m", "sepmc", "campaign", "table2.toml", "--cases", 5, "--no-plots", cwd=tmp_path
    )
    assert (good.returncode, "5 cases, 5 ok" in good.stdout) == (0, True), good.stderr
    assert len(rows(tmp_path / "runs" / "table2-1")) == 5
    second = python(
        "-m",
        "sepmc",
        "campaign",
        "table2.toml",
        "--cases",
        2,
        "--no-plots",
        "--quiet",
        cwd=tmp_path,
    )
    assert (second.returncode, second.stdout) == (0, "")
    bad = python(
        "-m", "sepmc", "campaign", "table2.toml", "--set", "body.upper.mass_kg=-3", cwd=tmp_path
    )
    assert (bad.returncode, bad.stdout, bad.stderr) == (
        2,
        "",
        "error: table2.toml: body.upper.mass_kg = -3: must be > 0\n",
    )
    assert sorted(os.listdir(tmp_path / "runs")) == ["table2-1", "table2-2"]


SPINNING = (
    """
initial = { altitude_m = 0.0, speed_m_s = 1.0, omega_deg_s = [50.0, 100.0, 150.0] }
run = { end_time_s = 20.0, cases = 2 }
solver = { method = "rk4", step_s = 0.005, drift = "none" }
"""
    + BODIES
    + """
[joint.pins]
bodies = ["fore", "aft"]
point_m = [2.0, 0.0, 0.0]
[joint.again]
bodies = ["fore", "aft"]
point_m = [2.0, 1.0, 0.0]
[[phase]]
name = "locked"
joints = { pins = "fixed" }
"""
)


def test_a_single_run_that_fails_ends_with_1(tmp_path):
    """With its status, and without an error of outcomes that it does not have."""
    file = tmp_path / "tumbling.toml"
    air = "{ altitude_m = [-9.0, 9.0], density_kg_per_m3 = [1.0, 1.0] }"
    text = SPINNING.replace('{ atmosphere = "none"', f'{{ atmosphere = "table", air = {air}')
    file.write_text(
        text.replace("end_time_s = 20.0", "end_time_s = 0.5")
        + "[body.aft.aerodynamics]\nreference_area_m2 = 1.0\nreference_length_m = 1.0\n"
        + "table = { alpha_deg = [-5.0, 5.0], pitch = [0.0, 0.0] }\n",
        encoding="utf-8",
    )
    arguments = ["run", str(file), "--no-plots", "--out", str(tmp_path / "run")]
    result = CliRunner().invoke(app.main, arguments)
    assert result.exit_code == 1, result.output
    assert "outside-table" in result.stdout
    assert "numerical error" not in result.stdout


def test_failed_audit_ends_with_3(tmp_path):
    """A joint that drifts apart uncorrected, in cases that are otherwise ok: said, stored, and an
    exit code of its own."""
    file = tmp_path / "spinning.toml"
    file.write_text(SPINNING, encoding="utf-8")
    arguments = ["campaign", str(file), "--no-plots", "--out", str(tmp_path / "run")]
    result = CliRunner().invoke(app.main, arguments)
    assert (
        result.exit_code,
        "AUDIT FAILED: 2 cases have joint_gap_residual_m > 1e-09" in result.stdout,
    ) == (3, True), result.output
    audited = json.loads((tmp_path / "run" / "statistics.json").read_text(encoding="utf-8"))[
        "audit"
    ]["joint_gap_residual_m"]
    assert audited["beyond"] == 2
    assert (
        audited["worst"]
        == rows(tmp_path / "run")["joint_gap_residual_m"].max()
        > audited["bound"]
        == 1e-9
    )
    corrected = CliRunner().invoke(
        app.main, [*arguments, "--overwrite", "--set", "solver.drift=projection"]
    )
    assert (corrected.exit_code, "audit passed" in corrected.stdout) == (0, True), corrected.output


def test_check_names_redundant_joints(tmp_path):
    file = tmp_path / "twice.toml"
    file.write_text(
        SPINNING.replace('{ pins = "fixed" }', '{ pins = "fixed", again = "spherical" }'),
        encoding="utf-8",
    )
    result = call("check", file)
    assert "phase locked: 3 of 9 constraint rows are redundant, among pins, again" in result.stderr
    assert "redundant" not in call("check", "srb.toml", "--no-flight").stderr


@pytest.mark.parametrize(("reference", "code"), [(1.0, 0), (1.1, 1)])
def test_verify_tells_by_its_exit_code(monkeypatch, reference, code):
    from sepmc.validation import verify

    monkeypatch.setattr(
        verify, "CHECKS", {"one": lambda: [verify.Line("a case", "a number", reference, 1.0, 1e-3)]}
    )
    result = CliRunner().invoke(app.main, ["verify", "--quiet"])
    assert (result.exit_code, "1 lines" in result.stdout) == (code, True)


def test_a_fault_of_its_own_is_not_called_bad_input(monkeypatch, tmp_path):
    """A ValueError from within is raised as such, with its traceback; only what was asked for
    wrongly ends with exit code 2."""
    from sepmc.campaign.campaign import Campaign

    def broken(self, *given, **named):
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(Campaign, "run", broken)
    called = CliRunner().invoke(
        app.main, ["campaign", "table2.toml", "--out", str(tmp_path / "run")]
    )
    assert isinstance(called.exception, ValueError)
    assert called.exit_code != 2


def test_check_names_the_time_in_which_joints_are_late():
    """A stage of the kernel that no phase of the file is."""
    result = call("check", "table2.toml", "--set", "joint.pins.delay_s=0.01")
    assert result.exit_code == 0, result.output
    assert "free (late joints)" in result.output


@pytest.mark.parametrize(
    ("words", "new"),
    [
        (["laws", "run"], "sepmc fit"),
        (["drivers", "run"], "sepmc sensitivity"),
        (["stats", "run", "--given", "x=1"], "--where"),
        (["replay", "run", "--least", "x"], "--min"),
        (["replay", "run", "--greatest", "x"], "--max"),
        (["replay", "run", "--film", "gif"], "--animate"),
        (["campaign", "table2.toml", "--plan", "x.csv"], "--samples"),
        (["compile", "table2.toml", "--spares"], "--fallbacks"),
    ],
)
def test_renamed_words_name_their_successors(words, new):
    called = CliRunner().invoke(app.main, words)
    assert called.exit_code == 2
    assert f"was renamed: {new}" in called.output
