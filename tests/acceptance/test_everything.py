"""One scene with every table there is: it checks, it flies, and its run folder is that scene again,
to the last bit of every case."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

import sepmc
from sepmc.campaign.execution import step_selection
from sepmc.cli.app import main
from sepmc.schema import AUDIT_BOUNDS

pytestmark = pytest.mark.slow  # one of the largest kernels of all

FILE = Path(__file__).parents[1] / "data" / "everything.toml"


@pytest.fixture(scope="module", autouse=True)
def few_trials():
    """A case takes tens of milliseconds here, and how well trial cases tell the error is tested
    elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step_selection, "SAMPLE", 16)
        yield


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load(FILE)


@pytest.fixture(scope="module")
def result(campaign, tmp_path_factory):
    return campaign.run(out=tmp_path_factory.mktemp("runs") / "run")


def test_check_says_what_is_in_it():
    """A line for every kind of thing, with the names."""
    called = CliRunner().invoke(main, ["check", str(FILE), "--no-flight"])
    assert called.exit_code == 0, called.output
    for message in (
        "3: upper, lower, half (and the ground)",
        "pins (upper - lower)",
        "pad (ground - lower)",
        "retro (pushes lower aft), main (pushes lower forward), kick (pushes half aft)",
        "kick: 0.005 s later than at event clear",
        "pins becomes free when upper at -50 m/s upward (falling), which need not occur",
        "level: when upper at 3022 m height (rising)",
        "pusher, strut",
        "plume, tug",
        "shed",
        "stages, shroud",
        "1 tables, 2 increments",
        "elevator = clip(gain_s * upper.omega_z_rad_s, -0.3, 0.3), with a lag of 0.05 s",
        "gives body.upper.aerodynamics.pitch.elevator",
        "locked: 12 constraint rows",
        "guided: 10 constraint rows",
        "apart: 5 constraint rows",
        "open: 4 constraint rows",
        "burn-out of main or force of tie 50000 N",
        "(0.15 s and pins at 40 mm)",
        "hinge turned by 3 deg or upper at 2990 m height or pins 1500 mm away",
        "hinge becomes free when hinge turned by 12 deg or moment of hinge 1e+06 N m",
    ):
        assert any(message in line for line in called.output.splitlines()), message


# places and times of least distances and peaks
AS_SHARP_AS_A_ROOT = ("_time_s", "_station_m", "_y_m", "_z_m")


def test_it_flies(result):
    """Every case ends well or, if its pins fail, without release; the audit is within its
    bounds."""
    table = result.to_pandas()
    failed = table["in_joint_pins_fails"] == 1.0
    assert 0 < failed.sum() < len(table)
    assert (table["status"][~failed] == "ok").all()
    assert (table["status"][failed] == "never-released").all()
    for name, bound in AUDIT_BOUNDS.items():
        assert table[name].max() <= bound, name
    assert np.isfinite(table["stages_clearance_mm"][~failed]).all()
    assert (table["pins_pin3_peak_load_N"][~failed] > 0.0).all()
    after = table["kick_ignition_time_s"] - table["clear_time_s"]
    assert_allclose(after, table["in_motor_kick_ignition_delay_ms"] / 1000.0, atol=1e-12)
    assert (table["level_time_s"] > 0.4).all()


def test_columns_have_units_and_stand_in_their_order(campaign, result):
    assert list(result.table) == [column.name for column in campaign.columns]
    assert all(
        column.name.endswith(column.unit.replace("/", "_").replace(" ", "_"))
        for column in campaign.outcome_columns
        if column.unit not in ("1",)
    )


def test_run_folder_is_the_campaign_again(campaign, result):
    """The resolved file reads to the same scene, dispersions and reference; cases replay to the
    last bit in a batch."""
    again = sepmc.load(result.folder)
    assert again.scene == campaign.scene
    assert again.file.dispersions == campaign.file.dispersions
    assert again.reference == campaign.reference
    assert again.digest == campaign.digest
    flown = again.run().table
    for name, values in result.table.items():
        assert_array_equal(flown[name], values, err_msg=name)


def assert_row(status, outcomes, errors, result, number):
    """A single flight is a row of the run, but for the errors that both tell."""
    assert status == result.table["status"][number]
    for name in result.outcomes:
        # round bodies are as near in many places
        if name.endswith(AS_SHARP_AS_A_ROOT) and not name.endswith("release_time_s"):
            continue
        reported = errors.get(name, 0.0) + result.accuracy.errors.get(name, 0.0)
        assert_allclose(
            outcomes[name],
            result.table[name][number],
            rtol=0,
            atol=(1e-9 + reported) * np.nanmax(np.abs(result.table[name]), initial=1e-6),
            err_msg=name,
        )


def test_full_gives_the_same(campaign, result):
    """Both formulations on everything there is."""
    full = campaign.with_settings({"solver.formulation": "full"})
    outcome = full.simulate(full.case(0), step_s=0.05).attrs
    assert_row(outcome["status"], outcome["outcomes"], outcome["errors"], result, 0)


def test_replayed_by_the_command(result, tmp_path):
    """``sepmc run FOLDER --case 19`` prints and writes the outcomes of the row, within the errors
    told."""
    arguments = ["run", result.folder, "--case", 19, "--every-s", 0.05, "--no-plots"]
    called = CliRunner().invoke(main, [*map(str, arguments), "--out", str(tmp_path / "one")])
    assert called.exit_code == 0, called.output
    assert f"{result.table['upper_omega_z_deg_s'][19]:.9g}" in called.output
    written = json.loads((tmp_path / "one" / "manifest.json").read_text(encoding="utf-8"))
    outcomes = {k: np.nan if v is None else v for k, v in written["outcomes"].items()}
    assert_row(written["status"], outcomes, written["errors"], result, 19)
