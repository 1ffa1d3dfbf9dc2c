"""Bad input: exit code 2, a line per problem with its place, value and what is allowed, no traceback, and nothing written."""

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from sepmc.cli import main

TEXT = (Path(__file__).parents[1] / "campaigns" / "table2.toml").read_text(encoding="utf-8")
MASS, INERTIA, UNTIL = "mass_kg = 458.0", "inertia_kg_m2 = [18.6, 156.3, 157.2]", "until = { time_s = 0.05 }"
LAW = '"initial.altitude_m" = { uniform = 150.0 }'
BROKEN = [  # what to replace in table2.toml, by what, and what the message must contain
    (MASS, "mas_kg = 458.0", ["body.upper.mas_kg", "unknown key", "'mass_kg'"]),
    (MASS, "mass_km = 458.0", ["body.upper.mass_km", "not a unit of mass", "mass_kg, mass_g, mass_t, mass_lb, mass_slug"]),
    (MASS, "mass = 458.0", ["body.upper.mass", "the unit is missing", "mass_kg"]),
    (MASS, "", ["body.upper", "'mass_kg' is missing"]),
    (MASS, "mass_kg = -3", ["body.upper.mass_kg = -3", "must be > 0"]),
    (MASS, "mass_g = 0.0", ["body.upper.mass_g = 0.0", "must be > 0"]),
    (MASS, "mass_kg = nan", ["body.upper.mass_kg = nan", "must be finite"]),
    (MASS, "mass_kg = inf", ["body.upper.mass_kg = inf", "must be finite"]),
    (MASS, "mass_kg = '458'", ["body.upper.mass_kg = '458'", "must be a number"]),
    (MASS, "mass_kg = true", ["body.upper.mass_kg = true", "must be a number"]),
    (MASS, "mass_kg = [458.0]", ["body.upper.mass_kg = [458.0]", "must be a number"]),
    (MASS, MASS + "\nmass_g = 458e3", ["body.upper.mass_g", "given twice", "'mass_kg'"]),
    (INERTIA, "inertia_kg_m2 = [-1.0, 156.3, 157.2]", ["body.upper.inertia_kg_m2 = [-1.0, 156.3, 157.2]", "positive definite"]),
    (INERTIA, INERTIA + "\ninertia_products_kg_m2 = [60.0, 0.0, 0.0]", ["body.upper.inertia_kg_m2", "positive definite"]),
    (INERTIA, "inertia_kg_m2 = [1.0, 10.0, 11.2]", ["body.upper.inertia_kg_m2", "triangle inequality", "1 + 10 < 11.2"]),
    (INERTIA, "inertia_kg_m2 = [18.6, 156.3]", ["body.upper.inertia_kg_m2 = [18.6, 156.3]", "length 3"]),
    (INERTIA, "inertia_kg_m2 = [18.6, nan, 157.2]", ["body.upper.inertia_kg_m2", "nan", "must be finite"]),
    ("[initial]", "[initia]", ["initia", "did you mean 'initial'"]),
    ("[run]\nend_time_s = 0.5", "", ["run", "missing"]),
    ("cases = 10000", "cases = 0", ["run.cases = 0", "must be >= 1"]),
    ("cases = 10000", "cases = 1.5", ["run.cases = 1.5", "whole number"]),
    ("cases = 10000", "chunk = 0", ["run.chunk = 0", "must be >= 1"]),
    ("seed = 2019", "seed = -1", ["run.seed = -1", "must be >= 0"]),
    ("end_time_s = 0.5", "end_time_s = 0.0", ["run.end_time_s = 0.0", "must be > 0"]),
    (UNTIL, "", ["phase.locked", "never ends"]),
    (UNTIL, "until = {}", ["phase.locked.until", "never ends"]),
    (UNTIL, "until = { time_s = 0.6 }", ["phase.locked.until.time_s = 0.6", "run.end_time_s = 0.5"]),
    (UNTIL, 'until = { joint = "pins", stroke_mm = 3.0 }', ["phase.locked.until.joint = 'pins'", "'fixed' in this phase, which has no stroke"]),
    ('name = "free"', 'name = "free"\nuntil = { time_s = 0.4 }', ["phase.free.until", "end_time_s"]),
    ('name = "free"', 'name = "guided"', ["phase.guided", "used twice"]),
    ('{ pins = "slider" }', '{ pin = "slider" }', ["phase.guided.joints = 'pin'", "did you mean 'pins'"]),
    ('{ pins = "slider" }', '{ pins = "slide" }', ["phase.guided.joints.pins = 'slide'", "did you mean 'slider'?"]),
    ('bodies = ["upper", "lower"]', 'bodies = ["uper", "lower"]', ["joint.pins.bodies = 'uper'", "did you mean 'upper'"]),
    ('bodies = ["upper", "lower"]', 'bodies = ["upper", "upper"]', ["joint.pins.bodies", "two different bodies"]),
    ('body = "lower"', 'body = "lover"', ["motor.retro.body = 'lover'", "did you mean 'lower'"]),
    ('"us1976"', '"us76"', ["environment.atmosphere = 'us76'", "us1976, table, none"]),
    ('"inverse-square"', '"round"', ["environment.gravity = 'round'", "inverse-square, constant, none"]),
    ('"dop853"', '"rk5"', ["solver.method = 'rk5'", "dop853, rk4"]),
    ('"reduced"', '"x"', ["solver.formulation = 'x'", "reduced, full"]),
    ("altitude_km = 70.0", "altitude_km = 90.0", ["initial.altitude_m = 90000.0", "86000"]),
    ("side = { beta =", "side = { bta =", ["body.upper.aerodynamics.side.bta", "const, alpha"]),
    (LAW, '"initial.altitude_m" = { uniform = 150.0, normal = 3.0 }', ["initial.altitude_m", "exactly one", "uniform and normal"]),
    (LAW, '"initial.altitude_m" = {}', ["dispersion.initial.altitude_m", "exactly one"]),
    (LAW, '"initial.altitude_m" = { uniform = -150.0 }', ["dispersion.initial.altitude_m = -150.0", ">= 0"]),
    (LAW, '"initial.altitude_m" = { uniform = [2.0, 1.0] }', ["dispersion.initial.altitude_m", "rise from low to high"]),
    (LAW, '"initial.altitude_m" = { uniform = 17e3 }', ["dispersion.initial.altitude_m", "53000 to 87000", "86000"]),
    (LAW, '"initial.altitude_m" = { uniform = nan }', ["dispersion.initial.altitude_m.uniform = nan", "finite"]),
    (LAW, '"initial.altitude_m" = { discrete = [1.0], weights = [1.0, 2.0] }', ["dispersion.initial.altitude_m", "weights"]),
    (LAW, '"initial.altitude" = { uniform = 150.0 }', ["dispersion.initial.altitude", "unit", "altitude_m"]),
    (LAW, '"initial.altitud_m" = { uniform = 150.0 }', ["dispersion.initial.altitud_m", "did you mean 'altitude_m'"]),
    (LAW, "initial.altitude_m = { uniform = 150.0 }", ["dispersion.initial", "quotes"]),
    (LAW, LAW + '\n"initial.altitude_km" = { uniform = 0.15 }', ["dispersion.initial.altitude_km", "given twice", "'initial.altitude_m'"]),
    (LAW, '"initial.omega_deg_s" = { uniform = 1.0 }', ["dispersion.initial.omega_deg_s", "vector", ".x, .y, .z"]),
    (LAW, '"run.end_time_s" = { uniform = 0.1 }', ["dispersion.run.end_time_s", "cannot vary"]),
    (LAW, '"joint.pins.x_axis.y" = { uniform = 0.1 }', ["dispersion.joint.pins.x_axis.y", "cannot vary"]),
    ('"body.upper.mass_kg" = { uniform = 20.0 }', '"body.upper.mass_kg" = { uniform = 500.0 }', ["body.upper.mass_kg", "-42", "> 0"]),
    ("upper_roll_deg =", "uper_roll_deg =", ["reference.outcome.uper_roll_deg", "did you mean 'upper_roll_deg'"]),
    ("sigma = 0.6716", "sigma = -1.0", ["reference.outcome.upper_alpha_ref_deg.sigma = -1.0", "must be > 0"]),
    (
        'joints = { pins = "fixed" }',
        "joints = {}",
        ["phase.guided.joints.pins = 'slider'", "not named in a phase is free", "cannot take hold again"],
    ),
    ('name = "free"', 'name = "free"\njoints = { pins = "fixed" }', ["phase.free.joints.pins = 'fixed'", "it is 'slider'"]),
    ('joints = { pins = "fixed" }', 'joints = { pins = "welded" }', ["phase.locked.joints.pins = 'welded'", "free, fixed, slider, revolute"]),
    ("build_up_s =", "build_upp_s =", ["motor.retro.build_upp_s", "did you mean 'build_up_s'"]),
    (MASS, "mass_t = 1e308", ["body.upper.mass_t", "finite"]),  # overflows to inf kg and is flown
    (MASS, f"mass_g = 1{'0' * 400}", ["body.upper.mass_g"]),  # OverflowError
    (MASS, f"mass_kg = 1{'0' * 5000}", ["bad.toml", "digits"]),  # the file is not named
    ('name = "retro"', 'name = ["retro"]', ["motor", "must be text"]),  # TypeError: unhashable
    ('name = "table2"', 'name = "a/b"', ["name = 'a/b'"]),  # runs/a/b-1; with "../../a" outside of runs/
    (LAW, '"motor.retro.burn_s" = { uniform = 1.0 }', ["dispersion.motor.retro.burn_s"]),  # nominal is inf: draws nan
    (
        '"initial.yaw_deg" = { uniform = 2.0 }',
        '"initial.yaw_deg" = { uniform = 120.0 }',
        ["dispersion.initial.yaw_deg", "89"],
    ),  # range is not checked
    (LAW, '"initial.path_yaw_deg" = { uniform = [-1e308, 1.7e308] }', ["dispersion.initial.path_yaw_deg"]),  # overflows: draws inf
    (TEXT, "a = " + "[" * 9999 + "]" * 9999, ["bad.toml", "TOML"]),  # RecursionError
]


@pytest.fixture
def sepmc(tmp_path, monkeypatch):
    """The command line in an empty folder; a bad call must leave the folder as it found it."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        before = sorted(tmp_path.rglob("*"))
        result = CliRunner().invoke(main, [str(a) for a in arguments])
        assert isinstance(result.exception, SystemExit), f"a traceback, not a message: {result.exception!r}"
        assert result.exit_code == 2
        assert result.stdout == ""
        assert sorted(tmp_path.rglob("*")) == before, "something was written"
        return result.stderr

    return call


@pytest.mark.parametrize(("old", "new", "said"), BROKEN)
def test_file(sepmc, old, new, said):
    """One line starts with the file and names the place and what is allowed; no other line is longer than a line."""
    assert TEXT.count(old) >= 1, "table2.toml has changed: this test breaks nothing"
    Path("bad.toml").write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    lines = sepmc("campaign", "bad.toml", "--cases", "2", "--no-plots", "--quiet").splitlines()
    assert all(line.startswith("error: ") for line in lines)
    assert any(all(part in line for part in said) for line in lines), lines


def test_every_problem_is_told_at_once(sepmc):
    Path("bad.toml").write_text(TEXT.replace(MASS, "mass_kg = -3").replace("seed = 2019", "seed = -1"), encoding="utf-8")
    for command in ("campaign", "check", "run"):
        assert sepmc(command, "bad.toml").splitlines() == [
            "error: bad.toml: body.upper.mass_kg = -3: must be > 0",
            "error: bad.toml: run.seed = -1: must be >= 0",
        ]


@pytest.mark.parametrize("content", [b"this is = = not TOML", b"\x89PNG\r\n\x1a\n\x00\xff", b"\x00" * 9, os.urandom(64) + b"\xff", b""])
def test_no_toml(sepmc, content):
    Path("bad.toml").write_bytes(content)
    assert "error: bad.toml: " in sepmc("campaign", "bad.toml")


@pytest.mark.parametrize("file", ["nowhere.toml", "folder/nowhere.toml", ".", "", "x" * 5000])  # OSError
def test_no_such_file(sepmc, file):
    assert "no such file, nor a shipped campaign" in sepmc("campaign", file)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--cases", "0"], "--cases"),
        (["--cases", "-5"], "--cases"),
        (["--cases", "many"], "--cases"),
        (["--seed", "-1"], "--seed"),
        (["--threads", "0"], "--threads"),
        (["--threads", "4096"], "threads = 4096: must lie in 1 to "),
        (["--resume"], "--resume needs --out"),
        (["--overwrite"], "--overwrite needs --out"),
        (["--resume", "--overwrite", "--out", "x"], "exclude each other"),
        (["--set", "body.upper.mass_kg"], "must read path=value"),
        (["--set", "=3"], "must read path=value"),
        (["--set", "body.upper.mas_kg=3"], "did you mean 'mass_kg'?"),
        (["--set", "body.upper.mass_kg=heavy"], "body.upper.mass_kg = 'heavy': must be a number"),
        (["--set", "body.upper.mass_kg="], "body.upper.mass_kg = '': must be a number"),
        (["--set", "body.upper.mass_kg.x=3"], "the path ends before 'x'"),
        (["--set", "motor.retr.thrust_N=3"], "did you mean 'retro'?"),
        (["--set", "phase.guidd.until.stroke_mm=3"], "did you mean 'guided'?"),
        (["--set", "body.upper.cg_mm.w=3"], "'w' is no component; allowed: x, y, z"),
        (["--set", "run.cases=0"], "run.cases = 0: must be >= 1"),
        (["--set", "body.uper.mass_kg=3"], "did you mean 'upper'?"),  # says 'inertia_kg_m2' is missing
        (["--set", "body.upper.cg_mm.xx=3"], "xx"),  # taken for x
        (["--set", "body.upper.inertia_kg_m2.xy=3"], "xy"),  # taken for xx
        (["--set", "body.upper.mass_kg=\udcff"], "body.upper.mass_kg"),  # UnicodeEncodeError
        (["--cases", "9" * 20, "--out", "x"], "--cases"),  # writes a manifest, then numpy's message
    ],
)
def test_options(sepmc, options, said):
    assert said in sepmc("campaign", "table2", "--quiet", "--no-plots", "--cases", "2", *options)


@pytest.mark.parametrize("options", [["--case", "-1"], ["--case", "a"], ["--every-s", "0"], ["--every-s", "nan"]])
def test_options_of_run(sepmc, options):
    """nan: an empty run folder is left behind."""
    assert options[0].strip("-") in sepmc("run", "table2", "--quiet", "--no-plots", *options)


def test_folder_that_cannot_be_used(sepmc):
    """A file in the way, a place below a file, a folder of other things: even with --overwrite or --resume."""
    Path("file").write_text("mine", encoding="utf-8")
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("mine", encoding="utf-8")
    for command in ("campaign", "run"):
        flags = [[], ["--overwrite"], ["--resume"]] if command == "campaign" else [[], ["--overwrite"]]
        for flag in flags:
            assert "file: is a file" in sepmc(command, "table2", "--quiet", "--out", "file", *flag)
            assert "file/below: cannot be written" in sepmc(command, "table2", "--quiet", "--out", "file/below", *flag)
            said = sepmc(command, "table2", "--quiet", "--out", "mine", *flag)
            assert said.startswith("error: mine: ")
            assert ("exists" if not flag else "is not a run") in said
    for command in ("stats", "plot"):
        assert "mine" in sepmc(command, "mine")
        assert "nowhere" in sepmc(command, "nowhere")
