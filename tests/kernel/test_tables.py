"""Tables of air, wind and aerodynamic coefficients, and proximity increments, against polynomials
and scipy splines."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

import sepmc
from sepmc.campaign.execution.table_overshoot import overshooting
from sepmc.physics.atmosphere import sound_speed, us1976

COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")
NUMBERS = 1e-9  # of a number, or of its unit: the same flight with differently rounded coefficients
# Thin air of 2 kg/m3 everywhere, through which the aft body, 1 kg, flies at 100 m/s ahead of 1 m2
# of drag: q S = 10,000 N.
AIR = {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]}
TUNNEL = {
    "environment": {"atmosphere": "table", "gravity": "none", "air": AIR},
    "body.aft.aerodynamics": {"reference_area_m2": 1.0, "reference_length_m": 0.5},
    "initial.speed_m_s": 100.0,
    "phase": [{"name": "free"}],
    "run.end_time_s": 0.2,
    "solver.step_s": 0.01,
}


def flown(campaign, step_s=0.01, case=None):
    history = campaign.simulate(case, step_s=step_s)
    assert history.attrs["status"] == "ok"
    return history


def value(polynomial, alpha, beta):
    """Sum of the terms of a coefficient, angles in radians."""
    total = 0.0 * alpha * beta
    for term, number in polynomial.items():
        product = number + 0.0 * alpha * beta
        for factor in term.split("_"):
            for angle, x in (("alpha", alpha), ("beta", beta)):
                if factor.startswith(angle):
                    product = product * x ** int(factor.removeprefix(angle) or 1)
        total = total + product
    return total


def tables(campaign, axes, share=1.0):
    """Settings that replace a fraction of every polynomial of the bodies by tables; axes in degrees
    by key."""
    settings = {}
    shape = [len(axis) for axis in axes.values()]
    alpha, beta = (np.radians(axes.get(f"{name}_deg", [0.0])) for name in ("alpha", "beta"))
    for name, body in campaign.scene.body.items():
        table = {key: list(axis) for key, axis in axes.items()}
        for coefficient in COEFFICIENTS:
            polynomial = getattr(body.aerodynamics, coefficient)
            grid = value(polynomial, alpha[:, None], beta[None, :])
            table[coefficient] = (
                np.broadcast_to(share * grid, [len(axes.get("mach", [0.0])), *grid.shape])
                .reshape(shape)
                .tolist()
            )
            settings[f"body.{name}.aerodynamics.{coefficient}"] = {
                term: (1.0 - share) * number for term, number in polynomial.items()
            }
        settings[f"body.{name}.aerodynamics.table"] = table
    return settings


ALPHA, BETA = np.linspace(-12.0, 12.0, 9).tolist(), [-15.0, -6.0, -1.0, 2.0, 9.0, 15.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axes", "share"),
    [
        ({"alpha_deg": ALPHA, "beta_deg": BETA}, 1.0),
        ({"mach": [20.0, 23.0, 26.0, 30.0], "alpha_deg": ALPHA, "beta_deg": BETA}, 1.0),
        ({"alpha_deg": ALPHA, "beta_deg": BETA}, 0.4),  # tables are added to polynomials
    ],
    ids=["alpha, beta", "mach, alpha, beta", "in part"],
)
def test_polynomials_as_tables(table2, axes, share):
    """Splines reproduce cubics, so dispersed cases of Table 2 come out the same to 1e-9."""
    plain = table2.with_settings({"run.history_step_s": 0.0, "solver.step_s": 0.05})
    tabulated = plain.with_settings(tables(plain, axes, share))
    for number in range(3):
        expected, result = (
            flown(campaign, 1.0, campaign.case(number)).attrs["outcomes"]
            for campaign in (plain, tabulated)
        )
        for name, value in expected.items():
            assert_allclose(result[name], value, rtol=NUMBERS, atol=NUMBERS, err_msg=name)


@pytest.mark.parametrize("axis", ["alpha", "beta"])
def test_a_table_over_one_axis(table2, axis):
    """Terms of one angle alone, tabulated over that angle alone."""
    still = {"run.history_step_s": 0.0, "solver.step_s": 0.05, "initial.yaw_deg": 2.0}
    still |= {
        f"body.{body}.aerodynamics.{coefficient}": {
            k: v
            for k, v in getattr(table2.scene.body[body].aerodynamics, coefficient).items()
            if axis in k
        }
        for body in ("upper", "lower")
        for coefficient in COEFFICIENTS
    }
    plain = table2.with_settings(still)
    result = flown(plain.with_settings(tables(plain, {f"{axis}_deg": ALPHA}))).attrs["outcomes"]
    expected = flown(plain).attrs["outcomes"]
    names = [column.name for column in plain.outcome_columns]
    assert_allclose(
        [result[n] for n in names], [expected[n] for n in names], rtol=NUMBERS, atol=NUMBERS
    )


def test_table_over_mach(pair):
    """C_A at Mach numbers that are no grid points, speed of sound 40 m/s: a cubic through the grid,
    by hand -q S C_A / m."""
    mach, axial = [0.5, 1.5, 2.0, 3.0], [0.01, 0.02, 0.05, 0.03]
    air = AIR | {"speed_of_sound_m_s": [40.0, 40.0]}
    history = flown(
        pair(
            TUNNEL
            | {
                "environment.air": air,
                "body.aft.aerodynamics.table": {"mach": mach, "axial": axial},
            }
        )
    )
    v = history["aft_vx_m_s"].to_numpy()
    cubic = np.polynomial.Polynomial.fit(mach, axial, 3)
    assert np.ptp(v) > 5.0
    assert_allclose(history["aft_axial_acceleration_m_s2"], -(v**2) * cubic(v / 40.0), rtol=1e-11)


def test_order_of_the_axes(pair):
    """Rows Mach, columns alpha: two rows, three columns, each number where it was put; alpha is 4
    deg at the start."""
    table = {
        "mach": [1.0, 3.0],
        "alpha_deg": [0.0, 4.0, 10.0],
        "axial": [[0.0, 0.01, 0.0], [0.0, 0.05, 0.0]],
    }
    air = AIR | {"speed_of_sound_m_s": [50.0, 50.0]}
    settings = {
        "environment.air": air,
        "body.aft.aerodynamics.table": table,
        "initial.alpha_deg": 4.0,
        "run.end_time_s": 0.001,
    }
    first = flown(pair(TUNNEL | settings), 0.001).iloc[0]
    assert_allclose(first["aft_axial_acceleration_m_s2"], -1e4 * 0.03, rtol=1e-12)


@pytest.mark.parametrize(
    ("key", "angle"), [("alpha_deg", "initial.alpha_deg"), ("beta_deg", "initial.yaw_deg")]
)
@pytest.mark.parametrize(
    ("given", "status"),
    [(9.999, "ok"), (10.0, "ok"), (10.001, "outside-table"), (-10.001, "outside-table")],
)
def test_outside_a_table(pair, key, angle, given, status):
    """An edge is inside; beyond it the outcome is NaN with a status."""
    table = {
        "body.aft.aerodynamics.table": {key: [-10.0, 10.0], "roll": [0.1, 0.1]},
        "run.end_time_s": 1e-6,
        "solver.step_s": 1e-6,
    }
    result = pair(TUNNEL | table | {angle: given}).simulate(step_s=1e-6).attrs
    if given == 10.0 and status == "ok":  # the angle that is flown may be the next number above
        assert result["status"] in ("ok", "outside-table")
        return
    assert result["status"] == status
    assert math.isnan(result["outcomes"]["aft_omega_x_deg_s"]) == (status != "ok")


def test_leaving_a_table_in_flight(pair):
    """It rotates out of the table after 0.1 s; its history ends there."""
    table = {
        "body.aft.aerodynamics.table": {"alpha_deg": [-5.0, 5.0], "roll": [0.0, 0.0]},
        "initial.omega_deg_s": [0.0, 0.0, 50.0],
    }
    history = pair(TUNNEL | table).simulate(step_s=0.01)
    assert history.attrs["status"] == "outside-table"
    assert 0.08 <= history["time_s"].iloc[-1] <= 0.101
    assert np.isfinite(history["aft_alpha_deg"]).all()


def test_slower_than_a_table(pair):
    """A Mach number below the first row is outside."""
    air = AIR | {"speed_of_sound_m_s": [300.0, 300.0]}
    table = {"mach": [0.5, 1.0], "axial": [0.1, 0.1]}
    result = (
        pair(TUNNEL | {"environment.air": air, "body.aft.aerodynamics.table": table})
        .simulate(step_s=0.1)
        .attrs
    )
    assert result["status"] == "outside-table"


@pytest.mark.slow
def test_air_sampled_from_the_standard(table2, plainly):
    """Every 100 m from 68.5 to 71.5 km: a spline of the logarithm, flown by 30 cases to 1e-9."""
    plain = table2.with_settings(
        {"run.history_step_s": 0.0, "run.end_time_s": 0.3, "solver.step_s": 0.05}
    )
    heights = np.arange(68_500.0, 71_501.0, 100.0)
    rows = [us1976(height) for height in heights]
    air = {
        "altitude_m": heights.tolist(),
        "density_kg_per_m3": [row[0] for row in rows],
        "speed_of_sound_m_s": [sound_speed(row[2]) for row in rows],
    }
    expected, result = (
        campaign.run(cases=30).to_pandas()
        for campaign in (
            plain,
            plain.with_settings({"environment.atmosphere": "table", "environment.air": air}),
        )
    )
    for name in [column.name for column in plain.outcome_columns]:
        assert_allclose(result[name], expected[name], rtol=NUMBERS, atol=NUMBERS, err_msg=name)


def test_air_between_its_rows(pair):
    """The density is the exponential of scipy's spline through its logarithm, rows of any distance;
    drag shows it on the way down."""
    height, density = (
        np.array([0.0, 300.0, 700.0, 900.0, 1500.0]),
        np.array([3.0, 2.0, 1.8, 1.0, 0.2]),
    )
    air = {"altitude_m": height.tolist(), "density_kg_per_m3": density.tolist()}
    dive = {
        "environment.air": air,
        "initial.pitch_deg": -90.0,
        "body.aft.aerodynamics.axial": {"const": 0.001},
        "run.end_time_s": 5.0,
    }
    history = flown(pair(TUNNEL | dive))
    result = 2.0 * -history["aft_axial_acceleration_m_s2"] / (0.001 * history["aft_vy_m_s"] ** 2)
    assert_allclose(
        result, np.exp(CubicSpline(height, np.log(density))(history["aft_y_m"])), rtol=1e-11
    )
    assert np.ptp(result) > 0.5


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_outside_the_table_of_air(pair, pitch):
    """Nothing is extrapolated: the status is that of leaving the atmosphere."""
    air = {"altitude_m": [990.0, 1010.0], "density_kg_per_m3": [2.0, 2.0]}
    history = pair(TUNNEL | {"environment.air": air, "initial.pitch_deg": pitch}).simulate(
        step_s=0.01
    )
    assert history.attrs["status"] == "outside-atmosphere"
    assert history["time_s"].iloc[-1] <= 0.12


def test_density_factor(pair, plainly):
    """Twice the density gives twice the drag, none gives none, each case its own."""
    drag = TUNNEL | {"body.aft.aerodynamics.axial": {"const": 0.001}, "run.end_time_s": 1.0}
    double = drag | {"environment.air": AIR | {"density_kg_per_m3": [4.0, 4.0]}}
    result, expected = (
        flown(pair(s)).iloc[-1]["aft_vx_m_s"]
        for s in (drag | {"environment.density_factor": 2.0}, double)
    )
    assert_allclose(result, expected, rtol=1e-14)
    assert flown(pair(drag | {"environment.density_factor": 0.0})).iloc[-1]["aft_vx_m_s"] == 100.0
    table = (
        pair(
            drag
            | {"dispersion.environment.density_factor": {"normal": [1.0, 0.2], "truncate_sigma": 3}}
            | {"solver.step_s": 0.05}
        )
        .run(cases=50)
        .to_pandas()
    )
    # v' = -k v^2 with k = rho S C_A / (2 m): v = v0 / (1 + v0 k t)
    speed = 100.0 / (1.0 + 100.0 * 0.001 * table["in_environment_density_factor"])
    assert_allclose(table["separation_speed_m_s"], 100.0 - speed, rtol=1e-11)


def test_steady_profile_is_the_steady_wind(table2):
    """The same wind at every height; half as a profile and half steady adds up."""
    plain = table2.with_settings({"environment.wind.direction_deg": 40.0})
    profile = {"altitude_m": [60_000.0, 80_000.0], "direction_deg": [40.0, 40.0]}
    expected = flown(plain).attrs["outcomes"]
    names = [column.name for column in plain.outcome_columns]
    for steady, rows in ((0.0, 15.675), (7.675, 8.0)):
        wind = {
            "environment.wind.speed_m_s": steady,
            "environment.wind.profile": profile | {"speed_m_s": [rows, rows]},
        }
        result = flown(plain.with_settings(wind)).attrs["outcomes"]
        assert_allclose(
            [result[n] for n in names], [expected[n] for n in names], rtol=1e-11, atol=1e-11
        )


def test_wind_over_height(pair):
    """Diving through it: sideslip and incidence as the components of the wind say, splines of zero
    end slope by scipy, constant beyond."""
    height, speed, direction = (
        np.array([850.0, 900.0, 930.0, 980.0]),
        np.array([30.0, 5.0, 20.0, 10.0]),
        np.array([0.0, 60.0, 200.0, 90.0]),
    )
    profile = {
        "altitude_m": height.tolist(),
        "speed_m_s": speed.tolist(),
        "direction_deg": direction.tolist(),
    }
    dive = {
        "environment.wind": {"profile": profile},
        "initial.pitch_deg": -89.0,
        "run.end_time_s": 2.0,
    }
    history = flown(pair(TUNNEL | dive))
    turned, toward = math.radians(-89.0), np.radians(direction)
    along, across = (
        CubicSpline(height, speed * part(toward), bc_type="clamped")(
            np.clip(history["aft_y_m"], 850.0, 980.0)
        )
        for part in (np.cos, np.sin)
    )
    vx, vy, vz = (history[f"aft_v{axis}_m_s"] for axis in "xyz")
    u = (vx - along) * math.cos(turned) + vy * math.sin(turned)
    v = -(vx - along) * math.sin(turned) + vy * math.cos(turned)
    w = vz - across
    assert history["aft_y_m"].max() > 980.0
    assert history["aft_y_m"].min() < 850.0
    assert_allclose(np.radians(history["aft_alpha_deg"]), np.arctan2(-v, u), rtol=0, atol=1e-12)
    assert_allclose(
        np.radians(history["aft_beta_deg"]),
        np.arcsin(w / np.sqrt(u * u + v * v + w * w)),
        rtol=0,
        atol=1e-12,
    )


def test_proximity(pair):
    """C_A grows from shielded to open over 60 mm of separation; in between scipy's spline of zero
    end slope, beyond constant."""
    distance, axial = [0.0, 20.0, 35.0, 60.0], np.array([-0.02, -0.012, -0.003, 0.0])
    near = {
        "name": "near",
        "body": "aft",
        "joint": "pins",
        "distance_mm": distance,
        "axial": axial.tolist(),
        "factor": 1.5,
    }
    history = flown(
        pair(
            TUNNEL
            | {
                "proximity": [near],
                "body.aft.aerodynamics.axial": {"const": 0.05},
                "run.end_time_s": 0.05,
            }
        ),
        0.001,
    )
    gap, v = history["separation_distance_mm"], history["aft_vx_m_s"]
    expected = 0.05 + 1.5 * CubicSpline(distance, axial, bc_type="clamped")(np.clip(gap, 0.0, 60.0))
    assert gap.max() > 80.0
    assert_allclose(history["aft_axial_acceleration_m_s2"], -(v**2) * expected, rtol=1e-11)


def test_proximity_is_held_beyond_its_ends(pair):
    """From 5 mm to 10 mm by table: 0.004 before, 0.001 after, so the drag is constant at both
    ends."""
    near = {
        "name": "near",
        "body": "aft",
        "joint": "pins",
        "distance_mm": [5.0, 10.0],
        "axial": [0.004, 0.001],
    }
    history = flown(
        pair(TUNNEL | {"proximity": [near], "run.end_time_s": 0.05, "solver.step_s": 0.001}), 0.001
    )
    gap = history["separation_distance_mm"]
    coefficient = -history["aft_axial_acceleration_m_s2"] / history["aft_vx_m_s"] ** 2
    assert_allclose(coefficient[gap < 5.0], 0.004, rtol=1e-12)
    assert_allclose(coefficient[gap > 10.0], 0.001, rtol=1e-12)
    assert (gap < 5.0).sum() > 2
    assert (gap > 10.0).sum() > 2


def test_proximity_in_all_six(pair):
    """Increments that do not change with distance equal polynomials that are constant."""
    numbers = dict(zip(COEFFICIENTS, [0.01, 0.02, -0.015, 0.003, -0.002, 0.004], strict=True))
    near = {"name": "near", "body": "aft", "joint": "pins", "distance_m": [0.0, 1.0]} | {
        key: [x, x] for key, x in numbers.items()
    }
    known = {f"body.aft.aerodynamics.{key}": {"const": x} for key, x in numbers.items()}
    result, expected = (
        flown(pair(TUNNEL | settings)).attrs["outcomes"]
        for settings in ({"proximity": [near]}, known)
    )
    assert abs(expected["aft_omega_z_deg_s"]) > 10.0
    names = [name for name in result if "residual" not in name]
    assert_allclose(
        [result[n] for n in names], [expected[n] for n in names], rtol=NUMBERS, atol=NUMBERS
    )


@pytest.mark.slow
def test_two_proximity_entries_add_and_vary(pair, plainly):
    """0.01 and 0.02 of C_A times factors of their own: v = v0 / (1 + v0 k t)."""
    entries = [
        {"name": n, "body": "aft", "joint": "pins", "distance_m": [0.0, 1.0], "axial": [x, x]}
        for n, x in (("one", 0.001), ("two", 0.002))
    ]
    laws = {
        f"dispersion.proximity.{name}.factor": {"normal": [1.0, 0.3]} for name in ("one", "two")
    }
    table = pair(TUNNEL | laws | {"proximity": entries}).run(cases=50).to_pandas()
    axial = 0.001 * table["in_proximity_one_factor"] + 0.002 * table["in_proximity_two_factor"]
    assert_allclose(
        table["separation_speed_m_s"], 100.0 - 100.0 / (1.0 + 100.0 * axial * 0.2), rtol=1e-9
    )


def test_a_wind_profile_that_overshoots_is_said():
    """Through 0, 80 and 0 m/s at uneven heights a smooth curve overshoots; through even rows of a
    gust it does not."""
    uneven = wind([0.0, 1000.0, 1030.0, 1060.0, 5000.0], [0.0, 0.0, 80.0, 0.0, 0.0])
    (message,) = overshooting(sepmc.load("table2.toml", {"environment.wind.profile": uneven}).scene)
    assert "environment.wind.profile" in message
    assert "80 m/s at most" in message
    gust = [0.0, 0.0, 5.0, 20.0, 40.0, 20.0, 5.0, 0.0, 0.0]
    assert (
        overshooting(
            sepmc.load(
                "table2.toml", {"environment.wind.profile": wind(list(np.arange(9.0)), gust)}
            ).scene
        )
        == []
    )
    assert overshooting(sepmc.load("table2.toml").scene) == []


def test_a_table_that_overshoots_is_said(pair):
    """Two rows 1e-6 apart in Mach number with different values make the spline oscillate; even rows
    do not."""
    drag = {"reference_area_m2": 1.0, "reference_length_m": 0.5}

    def said(mach, axial, interpolation="cubic"):
        table = {"table": {"mach": mach, "axial": axial, "interpolation": interpolation}}
        return overshooting(
            pair({"environment.atmosphere": "us1976", "body.aft.aerodynamics": drag | table}).scene
        )

    (sentence,) = said([0.1, 0.3, 0.300001, 0.6, 0.9], [0.2, 0.3, 0.301, 0.4, 0.5])
    assert "body.aft.aerodynamics.table.axial" in sentence
    assert "the rows only 0.2 to 0.5" in sentence
    assert said([0.1, 0.3, 0.5, 0.7, 0.9], [0.2, 0.25, 0.4, 0.5, 0.55]) == []
    (sentence,) = said([0.1, 0.3, 0.5, 0.7, 0.9], [0.2, 0.3, 0.6, 0.5, 0.4])
    assert "reaches 0.1584 between the rows mach = 0.1 and 0.3, whose values are 0.2" in sentence
    assert 'interpolation = "linear"' in sentence
    assert said([0.1, 0.3, 0.5, 0.7, 0.9], [0.2, 0.3, 0.6, 0.5, 0.4], "linear") == []
    assert said([0.1, 0.3, 0.5], [0.2, 0.2, 0.2]) == []
    near = {"name": "near", "body": "aft", "joint": "pins", "axial": [0.0, 0.5, 0.5, 0.5]}
    (sentence,) = overshooting(
        pair(
            {"environment.atmosphere": "us1976", "body.aft.aerodynamics": drag | {"axial": {}}}
            | {"proximity": [near | {"distance_m": [0.0, 0.01, 0.5, 1.0]}]}
        ).scene
    )
    assert "proximity.near.axial: the smooth function" in sentence
    thin = {
        "altitude_m": [0.0, 500.0, 500.001, 1000.0, 2000.0],
        "density_kg_per_m3": [1.2, 1.0, 0.9, 0.8, 0.7],
    }
    thin["speed_of_sound_m_s"] = [340.0] * 5
    (sentence,) = overshooting(
        pair(
            TUNNEL | {"environment": {"atmosphere": "table", "gravity": "none", "air": thin}}
        ).scene
    )
    assert "environment.air.density" in sentence


def wind(altitudes, speeds):
    return {"altitude_m": altitudes, "speed_m_s": speeds, "direction_deg": [90.0] * len(speeds)}
