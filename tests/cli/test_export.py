"""Runs in the formats of other programs, their results from Python again, files as TOML."""

import tomllib

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal
from oracles.random_scenes.interpreted import run_interpreted
from scipy.io import loadmat, netcdf_file
from small_scenes import SPRUNG

import sepmc
from sepmc.cli import app
from sepmc.formats.write_table import matlab_names
from sepmc.scene.messages import InputError


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of twelve cases with histories, and its result."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "c.toml").write_text(SPRUNG)
    with run_interpreted():
        campaign = sepmc.load(folder / "c.toml", {"run.history_step_s": 0.1})
        return campaign.run(out=folder / "run"), folder / "run"


def export(*arguments):
    return CliRunner().invoke(app.main, ["export", *map(str, arguments)])


def test_csv_has_the_bits(run, tmp_path):
    result, folder = run
    done = export(folder, "--format", "csv", "--out", tmp_path / "a.csv")
    assert done.exit_code == 0, done.output
    assert "12 rows" in done.output
    again = pd.read_csv(tmp_path / "a.csv", dtype=str, keep_default_na=False)
    for name, values in result.table.items():
        texts = again[name].tolist()
        if values.dtype.kind == "f":
            texts = np.array([float(text or "nan") for text in texts])
        elif values.dtype.kind in "iu":
            texts = np.array([int(text) for text in texts])
        assert_array_equal(texts, values, err_msg=name)


def test_matlab_has_the_bits_units_and_texts(run, tmp_path):
    result, folder = run
    assert export(folder, "--format", "mat", "--out", tmp_path / "a.mat").exit_code == 0
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    for name, values in result.table.items():
        assert_array_equal(content["cases"][name], values, err_msg=name)
    assert content["units"]["separation_speed_m_s"] == "m/s"
    assert content["cases"]["status"][0] == "ok"
    assert max(map(len, content["cases"])) <= 63


def test_single_case_gives_its_history(run, tmp_path):
    """Every column of the history with its unit, to be played back by other programs."""
    _, folder = run
    with run_interpreted():
        arguments = [
            "run",
            str(folder),
            "--case",
            "3",
            "--out",
            str(tmp_path / "one"),
            "--no-plots",
        ]
        done = CliRunner().invoke(app.main, [*arguments, "--every-s", "0.1"])
    assert done.exit_code == 0, done.output
    done = export(tmp_path / "one", "--format", "mat", "--out", tmp_path / "a.mat")
    assert done.exit_code == 0, done.output
    history = pd.read_parquet(tmp_path / "one" / "history.parquet")
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert set(content["history"]) == set(history)
    for name in ("time_s", "separation_speed_m_s"):
        assert_array_equal(content["history"][name], history[name], err_msg=name)
    assert content["units"]["time_s"] == "s"
    assert content["units"]["separation_distance_mm"] == "mm"
    assert content["history"]["phase"][0] == history["phase"].iloc[0]


def test_netcdf_has_the_bits(run, tmp_path):
    result, folder = run
    assert export(folder, "--format", "netcdf", "--out", tmp_path / "a.nc").exit_code == 0
    with netcdf_file(tmp_path / "a.nc", mmap=False) as file:
        for name, values in result.table.items():
            variable = file.variables[name]
            if name == "status":
                texts = [b"".join(row).rstrip(b"\0").decode() for row in variable[:]]
                assert texts == list(values)
            elif values.dtype.kind in "fiub":
                assert_array_equal(variable[:], values, err_msg=name)
        assert file.variables["separation_speed_m_s"].units == b"m/s"


def test_histories(run, tmp_path):
    result, folder = run
    out = tmp_path / "h.csv"
    assert export(folder, "--format", "csv", "--histories", "--out", out).exit_code == 0
    again, expected = pd.read_csv(out, dtype=str), result.histories()
    assert list(again) == list(expected)
    for name in expected:
        assert_array_equal([float(text) for text in again[name]], expected[name], err_msg=name)


@pytest.mark.parametrize(("kind", "package"), [("hdf5", "h5py"), ("xlsx", "openpyxl")])
def test_formats_of_the_extra(run, tmp_path, kind, package):
    """Written where the package is, else refused with its name."""
    _, folder = run
    ending = {"hdf5": "h5", "xlsx": "xlsx"}[kind]
    done = export(folder, "--format", kind, "--out", tmp_path / f"a.{ending}")
    try:
        __import__(package)
    except ImportError:
        assert done.exit_code == 2
        assert f"needs {package}, of the extra export" in done.output
    else:
        assert done.exit_code == 0
        assert (tmp_path / f"a.{ending}").stat().st_size > 1000


def test_what_cannot_be_written(run, tmp_path):
    _, folder = run
    (tmp_path / "a.csv").write_text("")
    assert "exists" in export(folder, "--format", "csv", "--out", tmp_path / "a.csv").output
    assert "must end in .mat" in export(folder, "--format", "mat", "--out", "a.csv").output


def test_names_of_matlab():
    """Cut to 63 letters, and told apart by a number."""
    names = ["short", "x" * 63, "x" * 70, "x" * 71]
    result = matlab_names(names)
    assert result["short"] == "short"
    assert len(set(result.values())) == 4
    assert max(map(len, result.values())) == 63


# -- results again -------------------------------------------------------------------------------


def test_open_gives_the_result(run):
    """Rows, statistics, verdicts, histories and cases as the run returned them."""
    result, folder = run
    again = sepmc.open(folder)
    for name, values in result.table.items():
        assert_array_equal(again.table[name], values, err_msg=name)
    pd.testing.assert_frame_equal(again.statistics(), result.statistics())
    pd.testing.assert_frame_equal(again.histories(), result.histories())
    assert again.status_counts == result.status_counts
    assert again.seed == result.seed
    assert again.case(3).inputs == result.case(3).inputs
    assert again.units == result.units
    assert "12 ok" in repr(again)
    with pytest.raises(InputError, match="must be one of those run"):
        again.case(12)


def test_open_knows_which_errors_do_not_count(tmp_path):
    """Those of the times of peaks."""
    result = sepmc.load("nasa-fixed-joint").run(cases=8, out=tmp_path / "run")
    again = sepmc.open(tmp_path / "run")
    assert "joint_peak_force_time_s" in result.accuracy.positions
    assert again.accuracy.positions == result.accuracy.positions
    assert again.accuracy.worst == result.accuracy.worst


def test_open_refuses_other_folders(tmp_path):
    with pytest.raises(sepmc.StoreError, match="is no folder of a run"):
        sepmc.open(tmp_path)


# -- files as TOML -------------------------------------------------------------------------------


def test_import_prints_what_a_file_stands_for(tmp_path):
    """A curve, scaled, and the same campaign with the table as with the file."""
    (tmp_path / "c6.eng").write_text("C6 18 70 0 0.0108 0.0231 E\n0.1 10\n0.3 14\n1.0 0\n")
    done = CliRunner().invoke(
        app.main,
        ["import", str(tmp_path / "c6.eng"), "--as", "motor", "--set", "total_impulse_N_s=20"],
    )
    assert done.exit_code == 0, done.output
    (motor,) = tomllib.loads(done.stdout)["motor"]
    times, fractions = (motor["profile"][key] for key in ("time_s", "fraction"))
    assert_allclose(motor["thrust_N"] * np.trapezoid(fractions, times), 20.0)
    assert "# motor.motor.profile: " in done.stderr


def test_import_says_which_way_the_side_force_points(tmp_path):
    (tmp_path / "d.csv").write_text("beta_deg,CY\n-10,0.2\n10,-0.2\n")
    command = ["import", str(tmp_path / "d.csv"), "--as", "aero"]
    done = CliRunner().invoke(app.main, command)
    assert "C_Y taken as it stands, positive to the LEFT; if it points right" in done.stderr
    assert tomllib.loads(done.stdout)["body"]["body"]["aerodynamics"]["table"]["side"][0] == 0.2
    done = CliRunner().invoke(app.main, [*command, "--set", "convention=datcom"])
    assert "C_Y taken as DATCOM's" in done.stderr
    assert "LEFT" not in done.stderr
    aero = tomllib.loads(done.stdout)["body"]["body"]["aerodynamics"]
    assert aero["table"]["side"][0] == -0.2
    assert "convention" not in aero["table"]


def test_import_refuses_with_the_reason(tmp_path):
    (tmp_path / "d.csv").write_text("mach,cn\n1,0.2\n2,0.3\n")
    done = CliRunner().invoke(app.main, ["import", str(tmp_path / "d.csv"), "--as", "aero"])
    assert done.exit_code == 2
    assert "write CN (normal) or Cn (yaw)" in done.output
