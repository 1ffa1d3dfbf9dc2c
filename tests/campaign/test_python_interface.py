"""The Python door: load, settings, cases, runs in memory or in a folder, single flights."""

import json
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import sepmc
from sepmc.analysis.statistics import statistics
from sepmc.campaign import cases
from sepmc.campaign.execution import diagnostics
from sepmc.campaign.store.manifests import read_manifest
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.read import parse_campaign

FILE = Path(__file__).parents[2] / "campaigns" / "table2.toml"
TREE = tomllib.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml")


@pytest.fixture(scope="module")
def result(campaign):
    return campaign.run(cases=40, seed=7)


def scene(**at):
    """table2.toml with values put in place; ``__`` stands for the dot of a path."""
    return sepmc.load(FILE, {key.replace("__", "."): given for key, given in at.items()}).scene


def test_load_by_path_name_or_run_folder(campaign, tmp_path):
    folder = tmp_path / "run"
    campaign.run(cases=3, seed=5, out=folder)
    for place in (FILE, str(FILE), "table2", "table2.toml", folder):
        assert sepmc.load(place).digest == campaign.digest
    again = sepmc.load(folder)
    assert (again.scene.run.cases, again.scene.run.seed) == (3, 5)
    with pytest.raises(sepmc.SceneError, match="no such file"):
        sepmc.load(tmp_path / "nowhere.toml")


def test_result(campaign, result):
    frame = result.to_pandas()
    assert frame["case"].tolist() == list(range(40))
    assert set(frame["status"]) == {"ok"}
    assert result.status_counts == {"ok": 40}
    assert (
        frame.columns.tolist() == [column.name for column in campaign.columns] == list(result.units)
    )
    assert np.isfinite(frame.drop(columns="status").to_numpy()).all()
    assert list(result.timing) == ["text", "compile", "steps", "sample", "kernel", "write"]
    assert all(seconds >= 0.0 for seconds in result.timing.values())
    assert (result.seed, result.folder, result.notes) == (7, None, [])
    drawn = cases.sample(campaign.file.dispersions, 7, 0, 40)
    np.testing.assert_array_equal(frame.filter(like="in_").to_numpy(), drawn)


def test_statistics(campaign, result):
    expected = statistics(
        result.to_pandas(), [c.name for c in campaign.outcome_columns], campaign.reference
    )
    outcome = result.statistics()
    assert outcome.pop("error").to_dict() == result.accuracy.errors
    assert not outcome.pop("constant").any()
    assert (outcome.pop("error_size") > 0.0).all()
    pd.testing.assert_frame_equal(outcome, expected)
    assert result.statistics().loc["upper_roll_deg", "ref_sigma"] == 2.2514


def test_histories(result):
    histories = result.histories()
    assert list(histories) == ["case", "time_s", "separation_speed_m_s", "separation_distance_mm"]
    assert (histories.groupby("case").size() == 51).all()
    last = histories[histories["time_s"] > 0.4999].set_index("case")
    np.testing.assert_allclose(
        last["separation_distance_mm"], result.to_pandas()["separation_distance_mm"], rtol=1e-9
    )
    assert sepmc.load("table2", {"run.history_step_s": 0.0}).run(cases=2).histories() is None


def test_the_same_bits_whatever_the_threads_chunks_or_folder(campaign, result, tmp_path):
    for other in (
        campaign.run(cases=40, seed=7, threads=1),
        campaign.with_settings({"run.chunk": 7}).run(cases=40, seed=7),
        campaign.run(cases=40, seed=7, out=tmp_path / "run"),
        campaign.with_settings({"run.history_step_s": 0.0}).run(cases=40, seed=7),
    ):
        pd.testing.assert_frame_equal(other.to_pandas(), result.to_pandas(), check_exact=True)
    assert not (
        campaign.run(cases=40, seed=8).to_pandas()["upper_roll_deg"]
        == result.to_pandas()["upper_roll_deg"]
    ).any()


def test_a_case_alone_is_its_row(campaign, result):
    row = result.to_pandas().iloc[17]
    case = campaign.case(17, seed=7)
    assert (case.number, case.inputs) == (17, row.filter(like="in_").to_dict())
    history = campaign.simulate(case, step_s=0.1)
    assert history.attrs["status"] == "ok"
    for name in result.outcomes:  # by another kernel, so to the accuracy of each
        size = max(abs(row[name]), result.table[name].std())
        assert history.attrs["outcomes"][name] == pytest.approx(
            row[name], rel=0, abs=2e-9 * size
        ), name
    resolved = case.to_dict()
    assert resolved["body"]["upper"]["mass"] == row["in_body_upper_mass_kg"]
    assert resolved["initial"]["omega"][0] == pytest.approx(
        np.deg2rad(row["in_initial_omega_x_deg_s"]), rel=1e-15
    )
    assert resolved["motor"][0]["offset"][1] == pytest.approx(
        row["in_motor_retro_offset_z_mm"] * 1e-3, rel=1e-15
    )
    assert "inertia_products" in resolved["body"]["upper"]
    assert "until" not in resolved["phase"][2]


def test_simulate(campaign):
    """The nominal by default: a row every step, two at each phase boundary, columns and units
    named."""
    history = campaign.simulate(step_s=0.01)
    assert history["time_s"].is_monotonic_increasing
    assert (history["time_s"].iloc[0], history["time_s"].iloc[-1]) == (0.0, 0.5)
    assert history["phase"].unique().tolist() == ["locked", "guided", "free"]
    assert len(history) == 51 + 2 + 1 or len(history) == 51 + 2 + 2
    assert list(history.attrs["units"]) == list(history.columns)
    assert {"upper_alpha_deg", "lower_y_m", "pins_force_on_upper_x_N", "pins_gap_z_m"} < set(
        history.columns
    )
    assert history.attrs["outcomes"]["release_time_s"] in history["time_s"].to_numpy()


def test_nominal(campaign):
    """Without dispersion every case is the nominal."""
    still = campaign.with_settings({"dispersion": {}}).run(cases=3)
    assert not still.to_pandas().filter(like="in_").columns.size
    outcomes = campaign.simulate().attrs["outcomes"]
    assert campaign.nominal().number == -1
    for _, row in still.to_pandas().iterrows():
        for name in still.outcomes:
            assert outcomes[name] == pytest.approx(row[name], rel=2e-9, abs=1e-12), name


@pytest.mark.slow
def test_a_case_alone_at_a_given_step_is_its_row(campaign):
    """Within the error that the run tells: its first steps may be divided otherwise."""
    given = campaign.with_settings({"solver.step_s": 0.05})
    result = given.run(cases=20, seed=7)
    table = result.to_pandas()
    outcomes = given.simulate(given.case(17, seed=7), step_s=0.1).attrs["outcomes"]
    for name, error in result.accuracy.errors.items():
        size = max(abs(outcomes[name]), table[name].std(), 1e-4)
        assert outcomes[name] == pytest.approx(
            table[name][17], rel=0, abs=max(error, 1e-9) * size
        ), name


def test_progress_is_told_after_each_chunk(campaign):
    calls = []
    campaign.with_settings({"run.chunk": 4}).run(
        cases=10, progress=lambda *numbers: calls.append(numbers)
    )
    assert calls == [(0, 10, 0), (4, 10, 0), (8, 10, 0), (10, 10, 0)]


def test_with_settings(campaign):
    heavier = campaign.with_settings({"body.upper.mass_g": 470e3, "solver.formulation": "full"})
    assert (heavier.scene.body["upper"].mass, heavier.scene.solver.formulation) == (470.0, "full")
    assert campaign.scene.body["upper"].mass == 458.0
    assert heavier.digest != campaign.digest
    assert (
        campaign.with_settings({"run.cases": 3, "run.seed": 4, "run.chunk": 5, "title": "x"}).digest
        == campaign.digest
    )
    with pytest.raises(SceneError, match="did you mean 'mass_kg'"):
        campaign.with_settings({"body.upper.mas_kg": 3.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cases": 0}, "cases = 0: must be >= 1"),
        ({"seed": -1}, "seed = -1: must be >= 0"),
        ({"threads": 0}, "threads = 0: must lie in 1 to"),
        ({"threads": 4096}, "threads = 4096: must lie in 1 to"),
        ({"seed": 1.5}, "seed = 1.5"),  # flown, and written into the manifest
        ({"seed": True}, "seed = True"),
    ],
)
def test_arguments_out_of_range(campaign, arguments, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        campaign.run(**{"cases": 2, **arguments}, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ValueError, match="case = -1: must be >= 0"):
        campaign.case(-1)
    for step in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="must be > 0"):
            campaign.simulate(step_s=step)


def test_settings_reach_every_kind_of_place():
    assert scene(body__upper__cg_mm__y=7.0).body["upper"].cg == pytest.approx(
        (1.3162, 0.007, 0.0001)
    )
    assert scene(body__lower__inertia_kg_m2__zz=2000.0).body["lower"].inertia == (
        90.3,
        2035.8,
        2000.0,
    )
    assert scene(motor__retro__offset_mm__z=1.0).motor[0].offset == (0.0, 0.001)
    assert scene(motor__retro__thrust_kN=0.6).motor[0].thrust == 600.0
    assert scene(phase__guided__until__stroke_mm=30.0).phase[1].until.stroke == 0.03
    assert scene(environment__wind__speed_km_h=36.0).environment.wind.speed == 10.0
    solver = scene(solver={"method": "rk4"}).solver
    assert (solver.method, solver.accuracy, solver.step) == ("rk4", 1e-9, None)
    assert scene(solver__step_ms=20.0).solver.step == 0.02
    laws = parse_campaign(
        TREE, "t.toml", {"dispersion.body.upper.mass_g": {"uniform": 1.0}}
    ).dispersions
    assert len(laws) == len(TREE["dispersion"])
    assert next(d for d in laws if d.parameter.path == "body.upper.mass").numbers == (
        457999.0,
        458001.0,
    )


@pytest.mark.parametrize(
    ("path", "given_value", "read", "expected"),
    [
        # 'given twice': a component in another unit
        ("body.upper.cg_m.x", 1.3, lambda scene: scene.body["upper"].cg[0], 1.3),
        # a tuple is not scaled: 1000 m
        ("body.upper.cg_mm", (1000.0, 0.0, 0.0), lambda scene: scene.body["upper"].cg[0], 1.0),
        # 'got numpy.float64'
        ("body.upper.mass_g", np.float64(460e3), lambda scene: scene.body["upper"].mass, 460.0),
        ("run.cases", np.int64(7), lambda scene: scene.run.cases, 7),  # 'got numpy.int64'
    ],
)
def test_settings_from_python(campaign, path, given_value, read, expected):
    assert read(campaign.with_settings({path: given_value}).scene) == expected


def test_case_number_of_numpy(campaign):
    """OverflowError: Python int too large to convert to C long."""
    assert campaign.case(np.int64(3)).inputs == campaign.case(3).inputs


def test_case_of_a_result(result):
    """By the number that statistics tell, with the run that it was of; no other."""
    number = result.statistics().loc["separation_distance_mm", "case_min"]
    case = result.case(number)
    assert case.number == result.table["separation_distance_mm"].argmin()
    assert (case.scene.run.cases, case.scene.run.seed) == (40, 7)
    for wrong in (40, -1, 1.5):
        with pytest.raises(ValueError, match=f"case = {wrong}: must be "):
            result.case(wrong)


def test_simulate_takes_a_case_or_its_number(campaign):
    one, other = campaign.simulate(3, 0.1), campaign.simulate(campaign.case(3), 0.1)
    assert one.attrs["outcomes"] == other.attrs["outcomes"]
    for wrong in (-1, 1.5, "3"):
        with pytest.raises(ValueError, match=f"case = {wrong!r}: must be |case = -1: must be "):
            campaign.simulate(wrong)


def test_reference_of_an_unknown_outcome(campaign):
    """Only `load` looks at the names of the reference."""
    with pytest.raises(SceneError, match="did you mean 'upper_roll_deg'"):
        campaign.with_settings({"reference.outcome.uper_roll_deg.mean": 0.0})


# -- what deserves a look
# --------------------------------------------------------------------------------------------------

PUSHED = {
    "spring": [
        {
            "name": "push",
            "bodies": ["fore", "aft"],
            "point_m": [2.0, 0.0, 0.0],
            "axis": [1.0, 0.0, 0.0],
            "force_N": 40.0,
        }
    ]
}
APART = {
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "free"},
    ]
}


@pytest.mark.parametrize(
    ("dispersion", "case"),
    [
        ({}, "the nominal case"),
        ({"body.aft.mass_kg": {"uniform": [5.0, 90.0]}}, "the case of median inputs"),
    ],
)
def test_the_case_that_goes_together_is_named(pair, dispersion, case):
    """Medians of dispersed inputs are not the values of the file."""
    campaign = pair(PUSHED | APART | {"dispersion": dispersion})
    outcomes = np.full(len(campaign.outcome_columns), -5.0)
    *_, note = diagnostics.scene_notes(campaign, SimpleNamespace(of_medians=outcomes))
    assert f"joint pins: {case} ends with a separation distance of -5 m" in note


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [{}, {"joint.pins.apart": 1}, {"spring": [PUSHED["spring"][0] | {"axis": [-1.0, 0.0, 0.0]}]}],
)
def test_a_nominal_case_that_goes_together(pair, tmp_path, settings):
    """A spring or joint the other way round: rows are ok, and the run says what it looks like,
    wherever it is told."""
    campaign = pair(PUSHED | APART | {"run.cases": 3} | settings)
    result = campaign.run(out=tmp_path / "run")
    distance = 1e-3 * result.table["separation_distance_mm"][0]
    assert result.status_counts == {"ok": 3}
    if distance > 0.0:
        assert result.notes == []
        assert campaign.simulate().attrs["notes"] == []
        return
    *slips, note = result.notes  # the file alone can tell, too
    assert all("is it the other way round?" in slip for slip in slips)
    for part in (
        "joint pins",
        "the nominal case",
        "fore",
        "aft",
        f"{distance:.3g} m",
        "the other way round",
        "joint.pins.apart",
    ):
        assert part in note
    assert (
        json.loads((tmp_path / "run" / "manifest.json").read_text(encoding="utf-8"))["notes"]
        == result.notes
    )
    with pytest.warns(sepmc.RunWarning) as caught:
        assert campaign.simulate().attrs["notes"] == [note]
    assert [str(each.message) for each in caught] == [note]
    assert all(each.filename == __file__ for each in caught)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sepmc.RunWarning)  # who listens is not told twice
        campaign.simulate(announce=lambda _: None)
    assert "case 2" in campaign.simulate(campaign.case(2)).attrs["notes"][0]


@pytest.mark.parametrize(
    ("kind", "notes"), [("fixed", 1), ("slider", 1), ("revolute", 0), ("spherical", 0)]
)
def test_a_hinge_does_not_separate_along_its_axis(pair, kind, notes):
    """Bodies that part from a joint at which they turned may end on either side of its x axis:
    nothing is said."""
    phases = [
        {"name": "held", "joints": {"pins": kind}, "until": {"time_s": 0.1}},
        {"name": "free"},
    ]
    outcome = (
        pair(PUSHED | {"phase": phases, "solver": {"accuracy": 1e-6}}).simulate(step_s=0.5).attrs
    )
    assert outcome["outcomes"]["separation_distance_mm"] < -100.0
    assert len(outcome["notes"]) == notes


def test_a_joint_released_to_a_hinge_does_not_separate_along_its_axis(pair):
    """Released from fixed to revolute, it is a hinge as if a phase made it one."""
    phases = [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.1}},
        {"name": "free"},
    ]
    release = [{"name": "hinged", "joint": "pins", "to": "revolute", "when": {"time_s": 0.01}}]
    settings = {"phase": phases, "release": release, "solver": {"accuracy": 1e-6}}
    outcome = pair(PUSHED | settings).simulate(step_s=0.5).attrs
    assert outcome["outcomes"]["separation_distance_mm"] < -100.0
    assert outcome["notes"] == []


@pytest.mark.parametrize("law", [{"normal": 0.3}, {"uniform": [0.5, 0.9]}])
def test_a_coefficient_of_a_polynomial_varies(law):
    """What bounds a polynomial bounds none of its coefficients: a case replays, and a law with ends
    is taken."""
    campaign = sepmc.load(
        "table2.toml", {"dispersion": {"body.upper.aerodynamics.normal.alpha": law}}
    )
    outcome = campaign.simulate(campaign.case(3), step_s=0.25).attrs
    assert (outcome["status"], outcome["notes"]) == ("ok", [])


def test_a_spread_relative_to_a_negative_nominal():
    """Sigma is a share of its size."""
    law = {"body.lower.cg_mm.y": {"normal": [1.0, 0.05], "relative": True}}
    campaign = sepmc.load(
        "table2.toml", {"body.lower.cg_mm": [3000.0, -2.0, 0.0], "dispersion": law}
    )
    assert campaign.file.dispersions[0].numbers[:2] == pytest.approx((-2.0, 0.1))


@pytest.mark.parametrize("seed", [2**63, 10**30])
def test_a_seed_that_readers_do_not_take_is_refused(pair, tmp_path, seed):
    """What a run folder says can be read again: its seed has 64 bits."""
    with pytest.raises(InputError, match=r"seed = \d+: must be >= 0 and <= 9223372036854775807"):
        pair().run(1, seed=seed, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match=r"run.seed"):
        pair({"run.seed": seed})


def test_the_largest_seed_is_read_again(pair, tmp_path):
    """A folder of the largest seed is a run like any other."""
    campaign = pair()
    result = campaign.run(2, seed=2**63 - 1, out=tmp_path / "run")
    assert read_manifest(tmp_path / "run")["seed"] == 2**63 - 1
    assert len(result.to_pandas()) == 2


@pytest.mark.parametrize("number", [10**9, 2**63])
def test_a_case_beyond_all_campaigns_is_refused(pair, number):
    """No campaign has such a case, so none is drawn or flown."""
    for ask in (pair().case, pair().simulate):
        with pytest.raises(InputError, match=r"case = \d+: must be >= 0 and <= 999999999"):
            ask(number)


def test_public_names_are_imported_at_first_use():
    code = (
        "import sys, sepmc; heavy = {'numpy', 'numba', 'pandas', 'msgspec'} & set(sys.modules);"
        "names = [getattr(sepmc, name) for name in sepmc.__all__]; sys.exit(bool(heavy))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_campaign_is_loaded_without_compilers():
    code = (
        "import sys, sepmc; sepmc.load('table2');"
        "sys.exit(bool({'numba', 'llvmlite'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_run_options_are_an_object_or_keywords(tmp_path):
    campaign = sepmc.load("table2.toml", {"solver.step_s": 0.1, "run.history_step_s": 0.0})
    options = sepmc.RunOptions(stats_only=True)
    assert campaign.run(2, options=options).kept.rows is None
    assert campaign.run(2, stats_only=True).kept.rows is None
    assert campaign.run(2, options=options, stats_only=False).kept.rows is not None
    with pytest.raises(TypeError, match="stats_onli"):
        campaign.run(2, stats_onli=True)
