"""Every load against a printed table or a closed form."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sepmc.physics.atmosphere import us1976
from sepmc.physics.gravity import inverse_square
from sepmc.physics.propulsion import building_up
from sepmc.physics.us1976_table import R0
from sepmc.physics.wind import wind
from sepmc.validation import lagrange
from sepmc.validation.classical_loads import density

FREE = {"phase": [{"name": "free"}]}
# on the axis, forward: 2 m/s2
PUSH = {"name": "push", "body": "fore", "thrust_N": 6.0, "station_m": 1.0, "cant_deg": 0.0}
# closed forms of the standard and of constant loads: round-off of some ten operations on numbers of
# this size
EXACT = 1e-13
# Sum over the terms of alpha and beta, in radians. Different in all six, so that no two can be
# exchanged unseen.
TERMS = {
    "const": 0.11,
    "alpha": 0.7,
    "alpha2": -1.3,
    "alpha3": 2.1,
    "beta": -0.5,
    "beta2": 0.9,
    "alpha_beta": 1.7,
    "alpha2_beta3": 40.0,
}
POLYNOMIALS = {
    name: {term: (1.0 + 0.2 * i) * (-1.0) ** i * value for term, value in TERMS.items()}
    for i, name in enumerate(["axial", "normal", "side", "roll", "yaw", "pitch"])
}


def geometric(geopotential):
    """Geometric height of a geopotential one, m."""
    return R0 * geopotential / (R0 - geopotential)


# NOAA-S/T 76-1562: base of each layer in geopotential height (table 4; 1 mb = 100 Pa), and the top,
# in metres', kelvin (molecular scale) and pascals. Six or more printed digits.
@pytest.mark.parametrize(
    ("h", "t", "p"),
    [
        (0.0, 288.15, 101325.0),
        (11e3, 216.65, 22632.06),
        (20e3, 216.65, 5474.889),
        (32e3, 228.65, 868.0187),
        (47e3, 270.65, 110.9063),
        (51e3, 270.65, 66.93887),
        (71e3, 214.65, 3.956420),
    ],
)
def test_atmosphere_at_the_layer_bases(h, t, p):
    """1e-6: the digits printed."""
    _, pressure, temperature = us1976(geometric(h))
    assert_allclose([temperature, pressure], [t, p], rtol=1e-6)


# The same standard, table 1: geometric height in km, kelvin, pascals, kg/m3.
@pytest.mark.parametrize(
    ("z", "t", "p", "rho"),
    [
        (0, 288.150, 1.01325e5, 1.2250),
        (5, 255.676, 5.4048e4, 7.3643e-1),
        (10, 223.252, 2.6500e4, 4.1351e-1),
        (20, 216.650, 5.5293e3, 8.8910e-2),
        (30, 226.509, 1.1970e3, 1.8410e-2),
        (40, 250.350, 2.8714e2, 3.9957e-3),
        (50, 270.650, 7.9779e1, 1.0269e-3),
        (60, 247.021, 2.1958e1, 3.0968e-4),
        (70, 219.585, 5.2209, 8.2829e-5),
        (80, 198.639, 1.0525, 1.8458e-5),
        # printed as 186.87 K, kinetic: up there the molar mass is smaller than on the ground
        (86, 186.946, 3.7338e-1, 6.958e-6),
    ],
)
def test_atmosphere_in_geometric_height(z, t, p, rho):
    """Half a unit of the last digit printed: 5 of 1e5, 0.5 of 6958, 0.5 of 186946."""
    density, pressure, temperature = us1976(1e3 * z)
    assert_allclose(pressure, p, rtol=5e-5)
    assert_allclose(density, rho, rtol=7.2e-5 if z == 86 else 5e-5)
    assert_allclose(temperature, t, rtol=2.7e-6)


def test_atmosphere_agrees_with_the_oracle():
    """A second implementation, at 200 heights of every layer."""
    heights = np.linspace(1.0, 85_990.0, 200)
    assert_allclose([us1976(z)[0] for z in heights], [density(z) for z in heights], rtol=EXACT)


@pytest.mark.parametrize("height", [-1e-6, 86_000.001, -math.inf, math.inf, math.nan])
def test_no_atmosphere_outside_its_definition(height):
    assert np.isnan(us1976(height)).all()


def test_atmosphere_reaches_both_ends():
    assert np.isfinite([us1976(0.0), us1976(86_000.0)]).all()


@pytest.mark.parametrize("h", [11e3, 20e3, 32e3, 47e3, 51e3, 71e3])
def test_atmosphere_is_continuous(h):
    """Across 0.2 um around a layer's edge, density falls by less than 1e-10: 2e-7 m over the
    smallest scale height, 5 km."""
    below, above = us1976(geometric(h) - 1e-7), us1976(geometric(h) + 1e-7)
    assert_allclose(above, below, rtol=1e-10)


def test_gravity():
    """A quarter at one radius, and 9.5942 m/s2 at 70 km (eq 17 of the standard)."""
    assert inverse_square(8.0, R0) == 2.0
    assert_allclose(inverse_square(9.80665, 70e3), 9.5942, rtol=0, atol=5e-5)


def test_free_fall(pair):
    """Height 1000 + v t - g t^2 / 2 under constant gravity, both bodies alike: a polynomial, so
    exact but for round-off."""
    last = (
        pair(FREE | {"environment.gravity": "constant", "initial.pitch_deg": 90.0})
        .simulate(step_s=0.1)
        .iloc[-1]
    )
    assert_allclose(
        [last["fore_y_m"], last["aft_y_m"]],
        np.array([1000.5, 998.5]) + 0.5 - 9.80665 / 8,
        rtol=EXACT,
    )
    assert_allclose(last["fore_vy_m_s"], 1.0 - 9.80665 / 2, rtol=EXACT)


def test_wind():
    """10 m/s towards 30 deg: 8.660254 along x, 5 along z, nothing up."""
    assert_allclose(wind(10.0, math.pi / 6), [8.6602540, 0.0, 5.0], atol=5e-8)


def test_thrust_build_up_closed_form(pair):
    """F (1 - exp(-t/tau)) gives F/m (t - tau (1 - exp(-t/tau))). A step of tau / 10 leaves DOP853
    nothing but round-off."""
    tau, end = 0.1, 0.5
    last = (
        pair(FREE | {"motor": [PUSH | {"build_up_s": tau}], "solver.step_s": tau / 10})
        .simulate(step_s=0.1)
        .iloc[-1]
    )
    assert_allclose(
        last["fore_vx_m_s"] - 1.0, 2.0 * (end - tau * (1.0 - math.exp(-end / tau))), rtol=EXACT * 10
    )
    assert building_up(6.0, 1.0 / tau, 0.0) == 0.0


@pytest.mark.parametrize(
    ("ignition", "burn"), [(0.123, 0.2), (0.0, 0.317), (0.05, 0.05), (0.4, 7.0), (0.6, 0.1)]
)
def test_ignition_and_burn_out_inside_a_step(pair, ignition, burn):
    """Speed and place of a constant thrust that starts and stops anywhere: steps end there, so both
    are exact (1e-12 of the impulse)."""
    history = pair(FREE | {"motor": [PUSH | {"ignition_s": ignition, "burn_s": burn}]}).simulate(
        step_s=0.01
    )
    on = np.clip(history["time_s"] - ignition, 0.0, burn)  # s of burning so far
    after = np.clip(history["time_s"] - ignition - burn, 0.0, None)
    assert_allclose(history["fore_vx_m_s"], 1.0 + 2.0 * on, rtol=0, atol=1e-12 * 2.0 * burn)
    assert_allclose(
        history["fore_x_m"], 0.5 + history["time_s"] + on**2 + 2.0 * on * after, rtol=0, atol=1e-12
    )


def test_two_motors_add(pair):
    """Overlapping burns of 6 N and 3 N on 3 kg: 2 x 0.25 + 1 x 0.25 m/s."""
    motors = [
        PUSH | {"burn_s": 0.25},
        PUSH | {"name": "half", "thrust_N": 3.0, "ignition_s": 0.13, "burn_s": 0.25},
    ]
    assert_allclose(
        pair(FREE | {"motor": motors}).simulate(step_s=0.1).iloc[-1]["fore_vx_m_s"],
        1.75,
        rtol=EXACT,
    )


def test_aerodynamics_in_flight_agree_with_the_oracle(table2):
    """Rich polynomials on both bodies, sideslip and wind, flown to the end (measure and bound of
    test_flight: 1e-8)."""
    rich = {
        f"body.{body}.aerodynamics.{k}": v
        for body in ("upper", "lower")
        for k, v in POLYNOMIALS.items()
    }
    campaign = table2.with_settings(
        rich
        | {"initial.yaw_deg": 3.0, "environment.wind.direction_deg": 60.0, "solver.step_s": 0.01}
    )
    outcomes, expected = (
        campaign.simulate(step_s=0.1).attrs["outcomes"],
        lagrange.simulate(campaign.nominal().to_dict()),
    )
    names = [name for name in expected if name in outcomes]
    assert len(names) == 21
    assert_allclose([outcomes[n] for n in names], [expected[n] for n in names], rtol=1e-8)


def test_no_airspeed_no_aerodynamics(table2):
    """Carried along by the wind: no force, no moment, and no NaN from the angles."""
    still = {
        "initial.speed_m_s": 70.0,
        "initial.pitch_deg": 0.0,
        "initial.alpha_deg": 0.0,
        "environment.wind.speed_m_s": 70.0,
    }
    still |= {"environment.gravity": "none", "motor.retro.thrust_N": 0.0}
    result = table2.with_settings(still).simulate(step_s=0.1)
    assert (result["upper_vx_m_s"] == 70.0).all()
    assert (result["lower_omega_z_deg_s"] == 0.0).all()


def test_moment_point(table2):
    """Coefficients about a layout point equal those about the mass centre plus arm x force, written
    out as polynomials.

    1e-12: the same flight with differently rounded coefficients.
    """
    aero = table2.scene.body["upper"].aerodynamics
    cg, point = np.array(table2.scene.body["upper"].cg), np.array([1.5, 0.03, -0.02])
    x, y, z = ((cg - point) * (1.0, -1.0, -1.0) / aero.reference_length).tolist()
    add = {
        "roll": [(-y, aero.side), (-z, aero.normal)],
        "yaw": [(z, aero.axial), (-x, aero.side)],
        "pitch": [(x, aero.normal), (y, aero.axial)],
    }
    about_cg = {}
    for name, parts in add.items():
        terms = dict(getattr(aero, name))
        for factor, polynomial in parts:
            for term, value in polynomial.items():
                terms[term] = terms.get(term, 0.0) + factor * value
        about_cg[f"body.upper.aerodynamics.{name}"] = terms
    carried = (
        table2.with_settings({"body.upper.aerodynamics.moment_point_m": point.tolist()})
        .simulate()
        .attrs["outcomes"]
    )
    written = table2.with_settings(about_cg).simulate().attrs["outcomes"]
    plain = table2.simulate().attrs["outcomes"]
    # the point matters
    assert abs(carried["upper_omega_z_deg_s"] - plain["upper_omega_z_deg_s"]) > 1.0
    names = [name for name in plain if "residual" not in name]
    assert_allclose(
        [carried[n] for n in names], [written[n] for n in names], rtol=1e-12, atol=1e-12
    )
