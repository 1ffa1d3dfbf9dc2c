"""Data in other conventions against the same data in ours, and by hand."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import sepmc
from sepmc.cli import app
from sepmc.physics.atmosphere import geopotential, sound_speed, us1976
from sepmc.scene.checks import inertia_tensor
from sepmc.scene.messages import SceneError
from sepmc.scene.model import COEFFICIENTS

AERO = {"reference_area_m2": 1.0, "reference_length_m": 2.0}


def aerodynamics(pair, **more):
    return pair({"body.aft.aerodynamics": AERO | more}).scene.body["aft"].aerodynamics


def problem(pair, settings):
    with pytest.raises(SceneError) as caught:
        pair(settings)
    return str(caught.value)


# -- inertia -------------------------------------------------------------------------------------

# three points of 1 kg: forward, up, right
POINTS = np.array([[1.0, 0.2, -0.4], [-0.5, 0.7, 0.1], [-0.5, -0.9, 0.3]])


def tensor_of(points):
    return float((points**2).sum()) * np.eye(3) - points.T @ points


AXES = {
    "forward-up-right": lambda p: p,
    "forward-right-down": lambda p: np.column_stack([p[:, 0], p[:, 2], -p[:, 1]]),
    "aft-right-up": lambda p: np.column_stack([-p[:, 0], p[:, 2], p[:, 1]]),
    "right-forward-up": lambda p: np.column_stack([p[:, 2], p[:, 0], p[:, 1]]),
    "up-left-aft": lambda p: np.column_stack([p[:, 1], -p[:, 2], -p[:, 0]]),
}


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("as_tensor", [True, False])
def test_inertia_in_other_axes(pair, axes, as_tensor):
    """Three points in the named axes: their tensor there becomes that of the points in ours."""
    there = tensor_of(AXES[axes](POINTS))
    body = {"mass_kg": 3.0, "cg_m": [1.0, 0.0, 0.0], "inertia_axes": axes}
    if as_tensor:
        body["inertia_tensor_kg_m2"] = there.tolist()
    else:
        body["inertia_kg_m2"] = np.diag(there).tolist()
        body["inertia_products_kg_m2"] = [-there[0, 1], -there[0, 2], -there[1, 2]]
    aft = {"mass_kg": 1.0, "inertia_kg_m2": [1.0, 2.0, 2.0], "cg_m": [3.0, 0.0, 0.0]}
    campaign = pair({"body": {"fore": body, "aft": aft}})
    assert_allclose(inertia_tensor(campaign.scene.body["fore"]), tensor_of(POINTS), rtol=1e-14)
    assert "inertia_axes" not in campaign.file.tree["body"]["fore"]
    said = " ".join(campaign.file.understood)
    assert (f"inertia in axes {axes}" in said) == (axes != "forward-up-right")


def test_the_map_is_said(pair):
    settings = {"body.fore.inertia_axes": "forward-right-down"}
    (said,) = pair(settings).file.understood
    assert said == (
        "body.fore: inertia in axes forward-right-down, where xx, zz, yy become Ixx, Iyy, Izz and "
        "-xz, xy, -yz become xy, xz, yz"
    )


def test_units_of_inertia(pair):
    """A pound at an inch: 2.926e-4 kg m2; and a component in a table."""
    settings = {"body.fore.inertia_lb_in2": [4000.0, 5000.0, 6000.0]}
    inertia = pair(settings).scene.body["fore"].inertia
    assert_allclose(inertia, np.array([4000.0, 5000.0, 6000.0]) * 0.45359237 * 0.0254**2)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"inertia_tensor_kg_m2": [[1, 0, 0], [0, 1, 0]]}, "must be three rows of three numbers"),
        ({"inertia_tensor_kg_m2": [[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]]}, "must be symmetric"),
        ({"inertia_tensor": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "the unit is missing"),
        ({"inertia_axes": "forward-down"}, 'such as "forward-right-down"'),
        ({"inertia_axes": "forward-aft-up"}, 'such as "forward-right-down"'),
        ({"inertia_axes": 3}, 'such as "forward-right-down"'),
        (
            {"inertia_tensor_kg_m2": [[True, 0, 0], [0, 1, 0], [0, 0, 1]]},
            "must be three rows of three numbers",
        ),
        (
            {"inertia_tensor_kg_m2": [["1", 0, 0], [0, 1, 0], [0, 0, 1]]},
            "must be three rows of three numbers",
        ),
        (
            {"inertia_axes": "forward-right-down", "inertia_kg_m2": [True, 1.0, 1.0]},
            "needs the inertia that it belongs to",
        ),
    ],
)
def test_inertia_that_cannot_be_read(pair, keys, message):
    body = {"mass_kg": 3.0, "cg_m": [1.0, 0.0, 0.0]}
    if "inertia_axes" in keys:
        body["inertia_kg_m2"] = [3.0, 4.0, 5.0]
    text = problem(pair, {"body.fore": body | keys})
    assert "body.fore.inertia" in text
    assert message in text


def test_a_tensor_beside_moments(pair):
    text = problem(pair, {"body.fore.inertia_tensor_kg_m2": np.eye(3).tolist()})
    assert "body.fore.inertia_kg_m2: is given by inertia_tensor_kg_m2 too" in text


# -- aerodynamics --------------------------------------------------------------------------------


def test_the_side_force_of_datcom(pair):
    """CYB < 0 of a stable body: the force points left at a sideslip to the right, and damps it."""
    aero = {"convention": "datcom", "side": {"beta": -3.0}, "yaw": {"beta": 0.1}}
    settings = {
        "environment": {
            "atmosphere": "table",
            "gravity": "none",
            "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]},
        },
        "body.aft.aerodynamics": AERO | aero,
        "phase": [{"name": "free"}],
        "initial.speed_m_s": 10.0,
        "initial.yaw_deg": 5.0,
        "run.end_time_s": 0.001,
        "solver.step_s": 0.001,
    }
    campaign = pair(settings)
    first = campaign.simulate(step_s=0.001).iloc[-1]
    assert campaign.scene.body["aft"].aerodynamics.side == {"beta": 3.0}
    assert campaign.scene.body["aft"].aerodynamics.yaw == {"beta": 0.1}
    assert any("C_Y taken as DATCOM's" in one for one in campaign.file.understood)
    assert first["aft_beta_deg"] > 0.0
    assert first["aft_vz_m_s"] < 0.0  # to the left: against the sideslip to the right


def test_slopes_per_degree(pair):
    """0.05 per degree is 2.865 per rad; a square by the square of that, constants as they are."""
    terms = {"const": 0.3, "alpha": 0.05, "alpha2_beta": 0.001, "q": 0.2}
    result = aerodynamics(pair, per="deg", normal=terms).normal
    degree = 180.0 / math.pi
    assert_allclose(
        [result[key] for key in terms], [0.3, 0.05 * degree, 0.001 * degree**3, 0.2 * degree]
    )


def test_rates_of_a_table_per_degree(pair):
    table = {"mach": [1.0, 2.0], "normal": [1.0, 2.0], "pitch_q": [-0.1, -0.2]}
    result = aerodynamics(pair, per="deg", table=table).table
    assert_allclose(result.pitch_q, np.array([-0.1, -0.2]) * 180.0 / math.pi)
    assert result.normal == [1.0, 2.0]


def test_a_lateral_length(pair):
    """C_n by a span of 6 m is three times as much by 2 m; by the rate r also three times."""
    table = {"mach": [1.0, 2.0], "yaw_r": [-0.1, -0.2], "side_r": [0.1, 0.1], "pitch_q": [1, 1]}
    result = aerodynamics(
        pair, lateral_length_m=6.0, yaw={"beta": 0.1, "r": -0.3}, side={"beta": 1.0}, table=table
    )
    assert_allclose([result.yaw["beta"], result.yaw["r"]], [0.3, -2.7])
    assert result.side == {"beta": 1.0}
    assert_allclose(result.table.yaw_r, [-0.9, -1.8])
    assert_allclose(result.table.side_r, [0.3, 0.3])
    assert result.table.pitch_q == [1, 1]


def test_one_row_of_an_axis(pair):
    """A deck of one Mach number is used at all; no speed of sound is needed for it."""
    table = {"mach": [0.8], "alpha_deg": [-5.0, 5.0], "normal": [[-0.2, 0.2]]}
    aero = AERO | {"table": table}
    settings = {
        "environment": {
            "atmosphere": "table",
            "gravity": "none",
            "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]},
        },
        "phase": [{"name": "free"}],
        "initial.speed_m_s": 100.0,
        "initial.alpha_deg": 2.5,
        "run.end_time_s": 1e-6,
        "solver.step_s": 1e-6,
    }
    campaign = pair(settings | {"body.aft.aerodynamics": aero})
    assert any("one row of mach (0.8): used at all mach" in x for x in campaign.file.understood)
    speed = campaign.simulate(step_s=1e-6).iloc[-1]
    # C_N = 0.1: 1000 m/s2 for 1e-6 s, up and normal to the body
    assert_allclose(speed["aft_vy_m_s"] - 100.0 * math.sin(math.radians(-2.5)), 1e-3, rtol=1e-3)


HALF = {
    "mach": [1.0, 2.0],
    "alpha_deg": [0.0, 4.0, 10.0],
    "axial": [[0.3, 0.31, 0.4], [0.2, 0.21, 0.3]],
    "normal": [[0.0, 0.2, 0.6], [0.0, 0.1, 0.5]],
    "pitch_q": [[-1.0, -2.0, -3.0], [-1.5, -2.5, -3.5]],
}


def test_a_table_mirrored_in_alpha(pair):
    result = aerodynamics(pair, table=HALF | {"mirror": "alpha"}).table
    assert_allclose(np.degrees(result.alpha), [-10.0, -4.0, 0.0, 4.0, 10.0])
    assert result.axial[0] == [0.4, 0.31, 0.3, 0.31, 0.4]
    assert result.normal[1] == [-0.5, -0.1, 0.0, 0.1, 0.5]
    # a moment over a rate that both change their signs
    assert result.pitch_q[0] == [-3.0, -2.0, -1.0, -2.0, -3.0]


def test_mirrored_flows_have_mirrored_loads(pair):
    """Of random values at rows from zero, all six: the reflection of force (a vector) and moment (a
    pseudovector) in the plane of each angle."""
    random = np.random.default_rng(4)
    for angle, axis in (("alpha", 1), ("beta", 2)):
        flipped = np.ones(3)
        flipped[axis] = -1.0
        table = {f"{angle}_deg": [0.0, 5.0, 9.0], "mirror": angle}
        for name in COEFFICIENTS:
            table[name] = [0.0, *random.uniform(-1.0, 1.0, 2)]
        result = aerodynamics(pair, table=table).table
        for low, high in ((0, 4), (1, 3)):
            force, moment = (
                [
                    np.array(
                        [signs[k] * getattr(result, name)[row] for k, name in enumerate(names)]
                    )
                    for row in (low, high)
                ]
                for names, signs in (
                    (("axial", "normal", "side"), (-1, 1, -1)),
                    (("roll", "yaw", "pitch"), (1, -1, 1)),
                )
            )
            assert_allclose(force[0], flipped * force[1])
            assert_allclose(moment[0], -flipped * moment[1])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (HALF | {"mirror": "beta"}, "needs the axis beta_deg"),
        (HALF | {"mirror": "alpha", "alpha_deg": [False, True, 10.0]}, "a list of numbers"),
        (HALF | {"mirror": "alpha", "axial": [[True, True, True]] * 2}, "table.axial"),
        (HALF | {"mirror": "gamma"}, 'must be "alpha" or "beta"'),
        (HALF | {"mirror": "alpha", "alpha_deg": [1.0, 4.0, 10.0]}, "must begin at 0"),
        (
            HALF | {"mirror": "alpha", "normal": [[0.1, 0.2, 0.6], [0.0, 0.1, 0.5]]},
            "is not 0 at alpha = 0",
        ),
    ],
)
def test_tables_that_cannot_be_mirrored(pair, table, message):
    assert message in problem(pair, {"body.aft.aerodynamics": AERO | {"table": table}})


@pytest.mark.parametrize(("key", "value"), [("convention", "nasa"), ("per", "grad")])
def test_unknown_conventions(pair, key, value):
    text = problem(pair, {"body.aft.aerodynamics": AERO | {key: value}})
    assert f"body.aft.aerodynamics.{key} = '{value}': must be one of" in text


# -- air and wind --------------------------------------------------------------------------------


def air(pair, **keys):
    environment = {"atmosphere": "table", "gravity": "none", "air": keys}
    return pair({"environment": environment})


def test_pressure_and_temperature(pair):
    """Those of the standard give its density and speed of sound."""
    heights = [0.0, 5000.0, 12000.0, 30000.0]
    states = [us1976(h) for h in heights]
    result = air(
        pair,
        altitude_m=heights,
        pressure_hPa=[s[1] / 100.0 for s in states],
        temperature_degC=[s[2] - 273.15 for s in states],
    ).scene.environment.air
    assert_allclose(result.density, [s[0] for s in states], rtol=1e-12)
    assert_allclose(result.speed_of_sound, [sound_speed(s[2]) for s in states], rtol=1e-12)


def test_geopotential_heights(pair):
    heights = [0.0, 5000.0, 30000.0]
    result = air(
        pair,
        geopotential_km=[geopotential(h) / 1e3 for h in heights],
        density_kg_per_m3=[1.2, 0.7, 0.02],
    ).scene.environment.air
    assert_allclose(result.altitude, heights, rtol=1e-12, atol=1e-9)


def test_the_standard_above(pair):
    """A sounding to 20 km goes on as the standard; the flight reaches it."""
    campaign = air(
        pair,
        altitude_m=[0.0, 10000.0, 20000.0],
        density_kg_per_m3=[1.3, 0.42, 0.09],
        speed_of_sound_m_s=[340.0, 300.0, 295.0],
        above="us1976",
    )
    result = campaign.scene.environment.air
    assert result.altitude[2:5] == (20000.0, 20500.0, 21000.0)
    assert result.altitude[-1] == 86000.0
    assert result.density[:3] == (1.3, 0.42, 0.09)
    assert_allclose(result.density[3:], [us1976(h)[0] for h in result.altitude[3:]])
    assert "132 rows of the standard atmosphere above 20000 m" in campaign.file.understood[0]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"pressure_Pa": [1e5, 1e4]}, "needs pressure_Pa and temperature_K together"),
        (
            {"pressure_Pa": [1e5, 1e4], "temperature_K": [288.0]},
            "temperature and pressure must be lists of equally many numbers",
        ),
        (
            {"pressure_Pa": [1e5, 1e4], "temperature_K": [15.0, -56.0]},
            "must be temperatures of 100 to 10000 K",
        ),
        (
            {"pressure": [1e5, 1e4], "temperature_K": [288.0, 220.0]},
            "must end in a unit; allowed: pressure_Pa",
        ),
        (
            {"pressure_Pa": [1e5, 1e4], "temperature_deg": [15.0, -10.0]},
            "temperature_deg: must end in a unit; allowed: temperature_K",
        ),
        ({"density_kg_per_m3": [1.2, 1.0], "above": "isa"}, 'must be "us1976"'),
    ],
)
def test_air_that_cannot_be_read(pair, keys, message):
    environment = {"atmosphere": "table", "air": {"altitude_m": [0.0, 9000.0]} | keys}
    assert message in problem(pair, {"environment": environment})


def test_the_direction_that_a_wind_comes_from(pair):
    """Launched to the east (90): a wind from the west blows along x, one from the north to the
    right, along z."""
    profile = {"altitude_m": [0.0, 9000.0], "speed_kn": [10.0, 20.0], "from_deg": [270.0, 0.0]}
    wind = {"speed_kn": 10.0, "from_deg": 180.0, "azimuth_deg": 90.0, "profile": profile}
    result = pair({"environment.wind": wind}).scene.environment.wind
    assert_allclose(np.cos(result.profile.direction), [1.0, 0.0], atol=1e-15)
    assert_allclose(np.sin(result.profile.direction[1]), 1.0)
    assert_allclose(np.sin(result.direction), -1.0)  # from the south: to the left
    assert_allclose(result.speed, 10.0 * 1852.0 / 3600.0)


@pytest.mark.parametrize(
    ("wind", "message"),
    [
        ({"speed_m_s": 3.0, "from_deg": 10.0}, "needs environment.wind.azimuth_deg"),
        ({"speed_m_s": 3.0, "azimuth_deg": 10.0}, "belongs to from_deg"),
        (
            {"speed_m_s": 3.0, "from_deg": 10.0, "azimuth_deg": math.nan},
            "needs environment.wind.azimuth_deg",
        ),
        (
            {"speed_m_s": 3.0, "from_deg": math.inf, "azimuth_deg": 10.0},
            "from_deg = inf: must be a number or a list of numbers",
        ),
        (
            {"speed_m_s": 3.0, "direction_deg": 1.0, "from_deg": 10.0, "azimuth_deg": 10.0},
            "stands beside direction_deg",
        ),
    ],
)
def test_winds_that_cannot_be_read(pair, wind, message):
    assert message in problem(pair, {"environment.wind": wind})


# -- the resolved campaign -----------------------------------------------------------------------


def test_a_run_stores_what_was_understood(tmp_path):
    """The resolved campaign has the keys of the model, and reads to the same scene and digest."""
    settings = {
        "body.upper.aerodynamics.convention": "datcom",
        "body.upper.aerodynamics.per": "deg",
        "body.lower.inertia_axes": "forward-right-down",
    }
    campaign = sepmc.load("table2.toml", settings)
    (tmp_path / "again.toml").write_text(campaign.file.toml)
    again = sepmc.load(tmp_path / "again.toml")
    assert again.scene == campaign.scene
    assert again.digest == campaign.digest
    assert again.file.understood == ()
    assert campaign.digest != sepmc.load("table2.toml").digest


def test_check_says_it():
    result = CliRunner().invoke(
        app.main,
        ["check", "table2.toml", "--no-flight", "--set",
         "body.upper.aerodynamics.convention=datcom"],
    )  # fmt: skip
    assert "understood   body.upper.aerodynamics: C_Y taken as DATCOM's" in result.output
