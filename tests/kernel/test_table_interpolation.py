"""Interpolation of tables: splines, lines and monotone cubics, against the independent flight and
by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles.independent import simulate
from scipy.interpolate import PchipInterpolator

import sepmc
from sepmc.engine import blocks

HEIGHTS = [0.0, 700.0, 1010.0, 2000.0]
MACH, ALPHA = [0.5, 1.8, 2.0, 2.5, 3.0], [-20.0, -5.0, -3.0, -1.0, 0.0, 1.0, 5.0, 20.0]


def grid(seed, size, middle=0.0):
    """Numbers on the axes, as lists."""
    random = np.random.default_rng(seed)
    return (size * (random.random((len(MACH), len(ALPHA))) - middle)).tolist()


def scene(interpolation, step_s):
    """A body that climbs through all tables of a scene, rotating, from Mach 2.2 to 2."""
    air = {
        "altitude_m": HEIGHTS,
        "density_kg_per_m3": [2.0, 1.9, 1.6, 1.5],
        "speed_of_sound_m_s": [50.0, 49.0, 45.0, 44.0],
    }
    wind = {
        "altitude_m": [900.0, 1000.5, 1001.0, 1010.0, 1100.0],
        "speed_m_s": [0.0, 3.0, 1.0, 5.0, 9.0],
        "direction_deg": [0.0, 30.0, 60.0, 70.0, 20.0],
    }
    table = {
        "mach": MACH,
        "alpha_deg": ALPHA,
        "axial": grid(1, 0.01),
        "normal": grid(3, 0.01),
        "pitch": grid(2, 1e-4, 0.5),
    }
    near = {"distance_mm": [0.0, 5.0, 20.0, 60.0], "axial": [-0.002, -0.001, 0.0, 0.001]}
    how = {"interpolation": interpolation}
    return {
        "environment": {
            "atmosphere": "table",
            "gravity": "none",
            "air": air | how,
            "wind": {"profile": wind | how},
        },
        "body.aft.aerodynamics": {
            "reference_area_m2": 1.0,
            "reference_length_m": 0.5,
            "table": table | how,
        },
        "proximity": [{"name": "near", "body": "aft", "joint": "pins"} | near | how],
        "initial.speed_m_s": 100.0,
        "initial.pitch_deg": 10.0,
        "phase": [{"name": "free"}],
        "run.end_time_s": 0.05,
        "solver.step_s": step_s,
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interpolation", "step_s"), [("cubic", 2e-4), ("linear", 5e-3), ("monotone", 1e-4)]
)
def test_against_the_independent_flight(pair, interpolation, step_s):
    """Every outcome to 1e-9: at short steps, or at long ones that end at the kinks of lines over
    Mach number, alpha, height and distance."""
    campaign = pair(scene(interpolation, step_s))
    result = campaign.simulate(step_s=0.05).attrs
    expected = simulate(campaign.nominal().to_dict())
    assert result["status"] == expected.status == "ok"
    for name, value in expected.outcomes.items():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)
    if interpolation == "linear":
        assert max(result["errors"].values()) < 1e-9


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_what_memory_holds_before_changes_nothing(pair, monkeypatch, interpolation):
    """Air and wind are lines: the Mach number and alpha at the start need their values, also for
    the table of a body that is none of lines."""
    settings = scene("linear", 5e-3) | {"run.end_time_s": 0.005}
    settings["body.aft.aerodynamics"]["table"]["interpolation"] = interpolation
    results = []
    for number in (np.nan, 0.0, 1.0):
        monkeypatch.setattr(blocks, "math", SimpleNamespace(nan=number))
        results.append(pair(settings).simulate(step_s=0.005).attrs)
    assert results[0]["status"] == "ok"
    for other in results[1:]:
        assert other["status"] == "ok"
        assert_array_equal([*other["outcomes"].values()], [*results[0]["outcomes"].values()])


def test_a_sample_at_the_start_reads_air_of_lines(pair):
    signal = {"name": "push", "formula": "aft.mach - 2", "sample_s": 0.1}
    settings = scene("linear", 5e-3) | {
        "run.end_time_s": 0.005,
        "signal": [signal],
        "load": [{"name": "jet", "body": "aft", "force_N": ["push", 0.0, 0.0]}],
    }
    campaign = pair(settings)
    expected = simulate(campaign.nominal().to_dict())
    result = campaign.simulate(step_s=0.005).attrs
    assert result["status"] == expected.status == "ok"
    for name, value in expected.outcomes.items():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("table", ["wind", "air"])
def test_beyond_tables_of_lines_over_height(pair, table):
    """Climbing out of its rows, wind is constant and air ends the case; a body that climbs through
    two rows and dives back is what the independent flight says."""
    settings = scene("linear", 5e-3)
    del settings["proximity"]
    del settings["body.aft.aerodynamics"]["table"]
    settings["body.aft.aerodynamics"]["axial"] = {"const": 0.001}
    settings |= {"initial.pitch_deg": 80.0, "initial.speed_m_s": 20.0, "run.end_time_s": 4.0}
    settings["environment"]["gravity"] = "constant"
    settings["solver.step_s"] = 0.05
    if table == "air":
        settings["environment"]["air"]["altitude_m"] = [0.0, 700.0, 1010.0, 1015.0]
    else:
        profile = settings["environment"]["wind"]["profile"]
        profile["altitude_m"] = [900.0, 1000.5, 1001.0, 1010.0, 1012.0]
    campaign = pair(settings)
    result, expected = campaign.simulate(step_s=4.0).attrs, simulate(campaign.nominal().to_dict())
    assert (
        result["status"] == expected.status == ("ok" if table == "wind" else "outside-atmosphere")
    )
    for name, value in expected.outcomes.items() if table == "wind" else ():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
def test_a_wind_is_turned_as_a_whole(pair, plainly, interpolation):
    """The components of a wind without overshoot are others in other axes: it is interpolated as in
    the file, then turned; alike whether the turn is in the file or dispersed."""
    settings = scene(interpolation, 2e-4)
    del settings["proximity"], settings["body.aft.aerodynamics"]
    settings["environment"] = {"atmosphere": "none", "gravity": "none"} | {
        "wind": settings["environment"]["wind"]
    }
    settings["initial.speed_m_s"] = 1.0
    settings["environment"]["wind"]["profile"]["speed_m_s"] = [0.0, 3.0, -4.0, 5.0, 9.0]
    settings["initial.altitude_m"] = 1000.8
    turned = "environment.wind.profile.turn_deg"
    expected = simulate(pair(settings | {turned: 40.0}).nominal().to_dict()).outcomes
    alone = pair(settings | {turned: 40.0}).simulate(step_s=0.05).attrs["outcomes"]
    assert_allclose(alone["aft_alpha_deg"], expected["aft_alpha_deg"], rtol=1e-9)
    dispersed = pair(settings | {"dispersion": {turned: {"constant": 40.0}}})
    rows = dispersed.run(cases=2).to_pandas()
    assert_allclose(rows["aft_alpha_deg"], expected["aft_alpha_deg"], rtol=1e-9)


def test_leaving_a_table_of_lines(pair):
    """It rotates out of the table, whose cells change at ends of steps only: it ends there."""
    table = {"alpha_deg": [-5.0, 0.0, 5.0], "roll": [0.0, 0.0, 0.0], "interpolation": "linear"}
    settings = scene("cubic", 5e-3)
    del settings["proximity"]
    settings["body.aft.aerodynamics"]["table"] = table
    settings |= {"initial.omega_deg_s": [0.0, 0.0, 50.0], "run.end_time_s": 0.3}
    history = pair(settings).simulate(step_s=0.01)
    assert history.attrs["status"] == "outside-table"
    assert 0.06 <= history["time_s"].iloc[-1] <= 0.12
    beyond = settings | {"initial.alpha_deg": 5.1}
    assert pair(beyond).simulate(step_s=0.01).attrs["status"] == "outside-table"


def test_outside_a_table_of_lines_at_the_start(pair):
    """No phase begins: a status, and a history without rows."""
    settings = scene("linear", 5e-3)
    settings["environment"]["air"]["altitude_m"] = [1001.0, 1200.0, 1300.0, 2000.0]
    settings["phase"] = [{"name": "first", "until": {"time_s": 0.01}}, {"name": "second"}]
    history = pair(settings).simulate(step_s=0.01)
    assert history.attrs["status"] == "outside-atmosphere"
    assert history.empty


@pytest.mark.slow
def test_dispersed_cases_against_the_independent_flight(plainly):
    """Table 2 with its aerodynamics as lines over Mach number and alpha: rows to 1e-9, at the
    accuracy that is asked by default."""
    mach, alpha = [15.0, 20.0, 22.5, 23.0, 30.0], np.linspace(-14.0, 14.0, 8)
    settings = {}
    for name in ("upper", "lower"):
        sign = -1.0 if name == "upper" else -0.3
        grids = {
            "axial": 0.05 + 0.3 * np.radians(alpha) ** 2,
            "normal": 0.4 * np.radians(alpha) + 0.5 * np.radians(alpha) ** 3,
            "pitch": sign * (0.02 * np.radians(alpha) + 0.3 * np.radians(alpha) ** 3),
        }
        table = {
            key: (np.linspace(0.9, 1.2, len(mach))[:, None] * row).tolist()
            for key, row in grids.items()
        }
        settings[f"body.{name}.aerodynamics.table"] = table | {
            "mach": mach, "alpha_deg": alpha.tolist(), "interpolation": "linear"
        }  # fmt: skip
        settings |= {f"body.{name}.aerodynamics.{key}": {} for key in grids}
    campaign = sepmc.load("table2.toml", settings)
    rows = campaign.run(cases=3).to_pandas()
    for number in range(3):
        expected = simulate(campaign.case(number).to_dict())
        assert rows["status"][number] == expected.status == "ok"
        for name, value in expected.outcomes.items():
            assert_allclose(rows[name][number], value, rtol=1e-9, atol=1e-8, err_msg=name)


@pytest.mark.parametrize("interpolation", ["linear", "monotone"])
def test_transonic_drag_between_its_rows(pair, interpolation):
    """The axial coefficient over Mach number of a table that splines overshoot, scipy's value
    between the rows."""
    mach, axial = [0.5, 0.9, 1.2, 2.0, 4.0], [0.30, 0.32, 0.62, 0.43, 0.28]
    air = {
        "altitude_m": [0.0, 2000.0],
        "density_kg_per_m3": [2.0, 2.0],
        "speed_of_sound_m_s": [40.0, 40.0],
    }
    table = {"mach": mach, "axial": axial, "interpolation": interpolation}
    settings = {
        "environment": {"atmosphere": "table", "gravity": "none", "air": air},
        "body.aft.aerodynamics": {"reference_area_m2": 0.01, "reference_length_m": 0.5},
        "body.aft.aerodynamics.table": table,
        "phase": [{"name": "free"}],
        "run.end_time_s": 1e-6,
        "solver.step_s": 1e-6,
    }
    expected = (
        (lambda x: np.interp(x, mach, axial))
        if interpolation == "linear"
        else PchipInterpolator(mach, axial)
    )
    for number in (0.6, 0.9, 1.0, 1.7, 2.0, 3.2):  # on rows and between them
        history = pair(settings | {"initial.speed_m_s": 40.0 * number}).simulate(step_s=1e-6)
        first = history["aft_axial_acceleration_m_s2"].iloc[0]
        assert_allclose(-first / (0.01 * (40.0 * number) ** 2), expected(number), rtol=1e-12)


@pytest.mark.parametrize("before_s", [0.0, 1e-7, 1e-5, 4e-4, 9e-3])
def test_kinks_soon_after_the_start(pair, before_s):
    """On a row, and shortly before one, as it turns through four rows in a fifth of a second."""
    table = {
        "alpha_deg": [-20.0, -5.0, -2.0, 0.0, 3.0, 20.0],
        "normal": [-0.1, -0.05, -0.01, 0.0, 0.02, 0.2],
        "interpolation": "linear",
    }
    settings = scene("cubic", 0.01)
    del settings["proximity"], settings["environment"]["wind"]
    settings["body.aft.aerodynamics"]["table"] = table
    settings |= {"initial.omega_deg_s": [0.0, 0.0, 60.0], "run.end_time_s": 0.1}
    campaign = pair(settings | {"initial.alpha_deg": -2.0 - 60.0 * before_s})
    result, expected = campaign.simulate(step_s=0.1).attrs, simulate(campaign.nominal().to_dict())
    assert result["status"] == expected.status == "ok"
    for name, value in expected.outcomes.items():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)
