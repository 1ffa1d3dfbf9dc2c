"""Every line of CONVENTIONS.md, each pinned by a number worked out by hand. Numbers are given to
the digits printed here."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted

from sepmc.physics import quat, springs
from sepmc.physics.aerodynamics import aero_force, aero_moment, flow_angles, reported_angles
from sepmc.physics.propulsion import thrust_arm, thrust_direction

DEG = math.pi / 180.0
# half a unit of the seventh decimal, and a little round-off: the hand-computed numbers carry seven
DIGITS = 6e-8
UP = {
    "name": "up",
    "body": "fore",
    "thrust_N": 10.0,
    "station_m": 1.0,
    "cant_deg": 90.0,
    "clock_deg": -90.0,
}
AFT = {"name": "aft", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}
UP_LOAD = {"name": "up", "body": "fore", "force_N": [10.0, 0.0, 0.0], "point_m": [1.0, 0.0, 0.0]}
SLIDER = [{"name": "guided", "joints": {"pins": "slider"}}]


def vector(row, name, unit):
    return np.array([row[f"{name}_{axis}_{unit}"] for axis in "xyz"])


def start(campaign):
    return campaign.simulate(step_s=0.1).iloc[0]


def close(actual, expected):
    assert_allclose(actual, expected, rtol=0, atol=DIGITS)


def test_layout_station_runs_aft(pair):
    """The layout point (s, y, z) lies at (-s, y, z) in body axes; height is y. Mass centre at
    station 1.5 m, y 0.5 m, z -1 m."""
    row = start(pair({"body.fore.cg_m": [1.0, 0.0, 0.0], "body.aft.cg_m": [3.0, 2.0, -4.0]}))
    close([row["fore_x_m"], row["fore_y_m"], row["fore_z_m"]], [0.5, 999.5, 1.0])
    close([row["aft_x_m"], row["aft_y_m"], row["aft_z_m"]], [-1.5, 1001.5, -3.0])


def test_attitude_matrix_and_its_angles():
    """Rz(30 deg) Ry(45 deg) Rx(60 deg), entry by entry (first column: body x axis in ground
    components), and the angles back."""
    q = quat.from_angles(30 * DEG, 45 * DEG, 60 * DEG)
    m = (
        0.6123724,
        0.2803301,
        0.7391989,
        0.3535534,
        0.7391989,
        -0.5732233,
        -0.7071068,
        0.6123724,
        0.3535534,
    )
    close(quat.matrix(q), m)
    # seven decimals of the sine, at 45 deg
    assert_allclose(np.array(quat.angles(m)) / DEG, [30.0, 45.0, 60.0], atol=1e-5)


def test_attitude_is_a_rotation_whatever_the_length_of_the_quaternion():
    """Within a step a quaternion is not quite of unit length: what joints hold along axes of unit
    length would be out of proportion."""
    q = quat.from_angles(0.4, -0.7, 1.1)
    for length in (1e-3, 1.0 - 1e-6, 1.0 + 1e-6, 1e3):
        assert_allclose(
            quat.matrix(tuple(length * x for x in q)), quat.matrix(q), rtol=0, atol=1e-15
        )


def test_quaternion_product_order():
    """q' = 1/2 q (0, omega), scalar first: pitched up 90 deg and rolling at 1 rad/s, q' = (i + k i)
    / (2 sqrt 2) = (i + j) / (2 sqrt 2)."""
    q = quat.from_angles(90 * DEG, 0.0, 0.0)
    close(q, [0.7071068, 0.0, 0.0, 0.7071068])
    close(quat.rate(q, (1.0, 0.0, 0.0)), [0.0, 0.3535534, 0.3535534, 0.0])


def test_matrix_rate_is_matrix_times_cross():
    """R' = R S(omega), omega in body axes. R |q|^2 is quadratic in q, so its central difference is
    exact, up to round-off."""
    q, (x, y, z) = np.array(quat.from_angles(0.4, -0.7, 1.1)), (0.3, -0.5, 0.7)
    half = 0.5 * np.array(quat.rate(tuple(q), (x, y, z)))
    difference = (1.0 + half @ half) * (
        np.array(quat.matrix(tuple(q + half))) - np.array(quat.matrix(tuple(q - half)))
    )
    r = np.reshape(quat.matrix(tuple(q)), (3, 3))
    assert_allclose(
        difference.reshape(3, 3), r @ [[0, -z, y], [z, 0, -x], [-y, x, 0]], rtol=0, atol=1e-14
    )


def test_angle_rates_are_equation_7():
    """Paper eq (7) at yaw 45, roll 30 deg, omega (1, 2, 3) rad/s: pitch' s sqrt 2, yaw' sqrt 3 -
    1.5, roll' 1 + s, s = 1 + 1.5 sqrt 3."""
    q, h = np.array(quat.from_angles(0.3, 45 * DEG, 30 * DEG)), 1e-6
    step = h * np.array(quat.rate(tuple(q), (1.0, 2.0, 3.0)))
    after, before = (np.array(quat.angles(quat.matrix(tuple(x)))) for x in (q + step, q - step))
    # 1e-8: third derivatives of some 1e2 times h^2, and round-off over h
    assert_allclose(
        (after - before) / (2 * h), [5.0884482, 0.2320508, 4.5980762], rtol=0, atol=1e-8 + DIGITS
    )


def test_path_velocity_and_initial_alpha(pair):
    """theta = pitch - alpha = 30, sigma = 30 deg, V = 100: V (cos cos, sin cos, -sin) = (75,
    43.3013, -50)."""
    row = start(
        pair(
            {
                "initial.speed_m_s": 100.0,
                "initial.pitch_deg": 40.0,
                "initial.alpha_deg": 10.0,
                "initial.path_yaw_deg": 30.0,
            }
        )
    )
    close([row["fore_vx_m_s"], row["fore_vy_m_s"], row["fore_vz_m_s"]], [75.0, 43.3012702, -50.0])


def test_altitude_and_speed_belong_to_the_mass_centre_and_omega_to_the_whole(pair):
    """Nose up 90 deg, pitching at 2 rad/s about the common mass centre: 0.5 m above it v = -1 m/s
    along x, 1.5 m below it +3."""
    row = start(
        pair(
            {
                "initial.pitch_deg": 90.0,
                "initial.alpha_deg": 90.0,
                "initial.omega_rad_s": [0.0, 0.0, 2.0],
            }
        )
    )
    close([row["fore_y_m"], row["aft_y_m"]], [1000.5, 998.5])
    close([row["fore_vx_m_s"], row["aft_vx_m_s"]], [1.0 - 1.0, 1.0 + 3.0])
    close([row["fore_omega_z_deg_s"], row["aft_omega_z_deg_s"]], 114.5915590)


def test_wind_moves_to_its_direction(pair):
    """Flying at 100 m/s along x, wind 10 m/s at 90 deg, to ground z: the air comes from the left,
    beta = -atan 0.1."""
    row = start(
        pair(
            {
                "initial.speed_m_s": 100.0,
                "environment.wind": {"speed_m_s": 10.0, "direction_deg": 90.0},
            }
        )
    )
    close(row["fore_beta_deg"], -5.7105931)
    # direction 0 is along ground x: 86.6 - 36.6 = 50 m/s of air from ahead, and 50 from the right
    tail = start(
        pair(
            {
                "initial.speed_m_s": 100.0,
                "initial.path_yaw_deg": -30.0,
                "environment.wind": {"speed_m_s": 36.6025404},
            }
        )
    )
    close(tail["fore_beta_deg"], 45.0)


def test_alpha_and_beta():
    """alpha = atan2(-v, u), beta = asin(w / V)."""
    close(flow_angles((3.0, -4.0, 0.0)), [53.1301024 * DEG, 0.0])
    close(flow_angles((4.0, 0.0, 3.0)), [0.0, 36.8698976 * DEG])


def test_still_air_has_no_direction(pair):
    """A body held still by the ground, without wind: its angles are no numbers, its case is ok. Air
    along the z axis has a sideslip, but no angle of attack."""
    assert_allclose(reported_angles((9e-7, 0.0, 2e-6), (1.0, 2.0)), [math.nan, 2.0])
    assert_allclose(reported_angles((9e-7, 0.0, 1e-7), (1.0, 2.0)), [math.nan, math.nan])
    campaign = pair(
        {
            "joint.stand": {"bodies": ["ground", "aft"], "point_m": [3.0, 0.1, 0.0]},
            "load": [UP_LOAD],
            "initial.speed_m_s": 0.0,
            "phase": [{"name": "held", "joints": {"stand": "fixed", "pins": "slider"}}],
            "dispersion.load.up.force_N.x": {"uniform": [1.0, 2.0]},
        }
    )
    with run_interpreted():
        result = campaign.run(cases=8, seed=1)
    frame = result.to_pandas()
    assert (frame["status"] == "ok").all()
    assert frame[["aft_alpha_deg", "aft_beta_deg"]].isna().all(axis=None)
    assert frame[["fore_alpha_deg", "fore_beta_deg", "aft_pitch_deg"]].notna().all(axis=None)
    assert result.accuracy.met
    single = campaign.simulate(campaign.case(3)).attrs["outcomes"]
    assert math.isnan(single["aft_alpha_deg"])
    assert single["fore_alpha_deg"] == pytest.approx(frame["fore_alpha_deg"][3], rel=1e-8)


def test_air_from_right_behind(pair):
    """A body pushed back in still air has an angle of attack of 180 deg, never of -180 as the sign
    of a round-off has it: that would be an error of a turn."""
    assert_allclose(reported_angles((-1.0, 1e-13, 0.0), (-math.pi, 0.0)), [math.pi, 0.0])
    assert_allclose(reported_angles((-1.0, 1e-11, 0.0), (-math.pi, 0.0)), [-math.pi, 0.0])
    assert_allclose(reported_angles((1.0, 1e-13, 0.0), (-1e-13, 0.0)), [-1e-13, 0.0])
    campaign = pair(
        {
            "initial.speed_m_s": 0.0,
            "load": [UP_LOAD | {"body": "aft", "force_N": [-10.0, 0.0, 0.0]}],
            "phase": [{"name": "free"}],
            "dispersion": {
                "initial.pitch_deg": {"uniform": [0.0, 80.0]},
                "initial.yaw_deg": {"uniform": [0.0, 80.0]},
            },
        }
    )
    with run_interpreted():
        result = campaign.run(cases=16, seed=1)
    frame = result.to_pandas()
    assert_allclose(frame["aft_alpha_deg"], 180.0, rtol=1e-15)
    assert result.accuracy.met


def test_a_spring_pushes_its_second_body_along_its_axis(pair):
    """12 N at rest, less 6 N/m times 0.5 m of extension and 2 N s/m times 1 m/s: 7 N. They drive
    1 kg aft, along -x of the layout's axis (-1, 0, 0), and 3 kg forward: at the start 12 m/s2 and
    4 m/s2, so that 0.01 s later they part at 0.16 m/s but for what the extension takes."""
    assert springs.spring_force(12.0, 6.0, 2.0, 0.5, 1.0) == 7.0
    spring = {
        "name": "push", "bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0],
        "axis": [-1, 0, 0], "force_N": 12.0,
    }  # fmt: skip
    settings = {"spring": [spring], "phase": [{"name": "guided", "joints": {"pins": "slider"}}]}
    outcomes = pair(settings | {"run.end_time_s": 0.01}).simulate().attrs["outcomes"]
    close(outcomes["separation_speed_m_s"], 0.16)
    softer = [spring | {"stiffness_N_per_m": 100.0, "damping_N_s_per_m": 50.0}]
    slower = pair(settings | {"spring": softer, "run.end_time_s": 0.01})
    assert slower.simulate().attrs["outcomes"]["separation_speed_m_s"] < 0.13


def test_a_spring_that_only_pushes_ends_where_its_force_does(pair):
    """12 N less 600 N/m part 3 kg and 1 kg: 0.12 J up to 20 mm, v^2 = 2 x 0.12 x 4 / 3."""
    spring = {
        "name": "push", "bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0],
        "axis": [-1, 0, 0], "force_N": 12.0, "stiffness_N_per_m": 600.0, "push_only": True,
    }  # fmt: skip
    settings = {"spring": [spring], "phase": [{"name": "guided", "joints": {"pins": "slider"}}]}
    settings |= {"run.end_time_s": 0.2, "solver.step_s": 0.01}
    outcomes = pair(settings).simulate().attrs["outcomes"]
    close(outcomes["separation_speed_m_s"], math.sqrt(0.32))


def test_a_stroke_ends_at_its_extension(pair):
    """12 N part 3 kg and 1 kg at 16 m/s2: 20 mm take 0.05 s, 600 mm more than the 0.2 s there are.
    The joint leaves its slider at 0.1 s for a cylindrical one, whose rotation it frees too."""
    spring = {
        "name": "push", "bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0],
        "axis": [-1, 0, 0], "force_N": 12.0, "stroke_m": 0.02,
    }  # fmt: skip
    failed = spring | {"name": "failed", "force_N": 0.0, "stroke_m": 0.6}
    release = {"name": "roll", "joint": "pins", "to": "cylindrical", "when": {"time_s": 0.1}}
    phase = [{"name": "guided", "joints": {"pins": "slider"}}]
    settings = {"spring": [spring, failed], "phase": phase, "release": [release]}
    outcomes = pair(settings | {"run.end_time_s": 0.2}).simulate().attrs["outcomes"]
    close(outcomes["push_stroke_end_time_s"], 0.05)
    assert math.isnan(outcomes["failed_stroke_end_time_s"])
    close(outcomes["release_to_cylindrical_time_s"], 0.1)
    assert math.isnan(outcomes["release_time_s"])


def test_a_load_carried_for_no_time(pair):
    """1 kg held by 3 kg: 12 N on these are 3 N at the joint, 240 N more from 0.1 s on 63 N. It
    breaks at 50 N, so at once, and its peak is what it carried until then."""
    loads = [
        UP_LOAD | {"force_N": [12.0, 0.0, 0.0]},
        UP_LOAD | {"name": "jerk", "force_N": [240.0, 0.0, 0.0], "start_s": 0.1},
    ]
    held = {"name": "held", "joints": {"pins": "fixed"}}
    held["until"] = {"joint": "pins", "force_N": 50.0}
    campaign = pair(
        {"load": loads, "phase": [held, {"name": "free"}], "output": {"loads": ["pins"]}}
    )
    outcomes = campaign.simulate().attrs["outcomes"]
    close(outcomes["release_time_s"], 0.1)
    close(outcomes["pins_peak_force_N"], 3.0)


def test_aerodynamic_signs():
    """q S (-C_A, C_N, -C_Y) and q S L (C_l, -C_n, C_m)."""
    assert aero_force(10.0, (0.1, 0.2, 0.3)) == (-1.0, 2.0, -3.0)
    assert aero_moment(10.0, (0.1, 0.2, 0.3)) == (1.0, -2.0, 3.0)


def test_nozzle_frame():
    """Eq (1) at cant 60, clock 30 deg, column by column; cant 180 deg pushes aft; eq (2) at
    deflection 30, its clock 60 deg."""
    cant, clock = 60 * DEG, 30 * DEG
    close(thrust_direction(cant, clock, 0.0, 0.0), [0.5, -0.4330127, 0.75])
    close(thrust_direction(cant, clock, 90 * DEG, -90 * DEG), [0.0, 0.8660254, 0.5])
    close(thrust_direction(cant, clock, 90 * DEG, 0.0), [-0.8660254, -0.25, 0.4330127])
    close(thrust_direction(180 * DEG, 0.0, 0.0, 0.0), [-1.0, 0.0, 0.0])
    close(thrust_direction(0.0, 0.0, 30 * DEG, 60 * DEG), [0.8660254, -0.4330127, 0.25])


def test_thrust_arm():
    """Eq (4) at clock 30 deg: (2 - 4.5, -0.25 - 0.1 + 0.01, 0.4330127 + 0.2 + 0.02)."""
    close(thrust_arm((2.0, 0.1, -0.2), 4.5, 0.5, 30 * DEG, 0.01, 0.02), [-2.5, -0.34, 0.6530127])


def test_moment_is_arm_cross_force(pair):
    """10 N forward, 0.1 m above the axis, pushes the nose down: -1 N m / 10 kg m2 (5 + 2 + 3 x
    0.5^2 + 1 x 1.5^2) for 0.5 s."""
    forward = {
        "name": "forward",
        "body": "fore",
        "thrust_N": 10.0,
        "station_m": 1.0,
        "cant_deg": 0.0,
        "offset_m": [0.1, 0.0],
    }
    last = pair({"motor": [forward]}).simulate(step_s=0.1).iloc[-1]
    close(last["fore_omega_z_deg_s"] * DEG, -0.05)


def test_wrench_on_the_second_body(pair):
    """10 N up at the forward mass centre, 0.1 m to its right, 0.5 m ahead of the common one: a_aft
    = 10/4 - 1.5 x 0.5 = 1.75 m/s2.

    Pitch: 5 N m / 10 kg m2 = 0.5 rad/s2, and 2 x 0.5 = M_z + (1 m ahead) x 1.75 N, so M_z = -0.75.
    Roll: -1 N m, one quarter of it through the joint. Forces and moments on the forward body are
    the opposite, as the two points coincide.
    """
    row = start(pair({"motor": [UP | {"offset_m": [0.0, 0.1]}]}))
    close(vector(row, "pins_force_on_aft", "N"), [0.0, 1.75, 0.0])
    close(vector(row, "pins_moment_on_aft", "N_m"), [-0.25, 0.0, -0.75])
    close(vector(row, "pins_force_on_fore", "N"), [0.0, -1.75, 0.0])
    close(vector(row, "pins_moment_on_fore", "N_m"), [0.25, 0.0, 0.75])


def test_moment_on_the_first_body_includes_the_gap(pair):
    """M_A = -M_B - d x F_B. After 0.5 s of 2 N on 1 kg, d = (-0.25, 0, 0): the moments differ by
    0.25 m of the lateral force."""
    row = pair({"phase": SLIDER, "motor": [AFT, UP]}).simulate(step_s=0.1).iloc[-1]
    gap, force = vector(row, "pins_gap", "m"), vector(row, "pins_force_on_aft", "N")
    assert gap[0] < -0.2
    assert abs(force[1]) > 0.1
    moments = vector(row, "pins_moment_on_fore", "N_m") + vector(row, "pins_moment_on_aft", "N_m")
    close(moments, [0.0, 0.0, -gap[0] * force[1]])


@pytest.mark.parametrize("x_axis", [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
@pytest.mark.parametrize("bodies", [["fore", "aft"], ["aft", "fore"]])
def test_separation_is_positive_apart(pair, bodies, x_axis):
    """2 N aft on 1 kg for 0.5 s: 250 mm apart at 1 m/s, whichever body is named first and whichever
    way the axis points."""
    campaign = pair(
        {"phase": SLIDER, "motor": [AFT], "joint.pins.bodies": bodies, "joint.pins.x_axis": x_axis}
    )
    row = campaign.simulate(step_s=0.1).iloc[-1]
    close([row["separation_distance_mm"], row["separation_speed_m_s"]], [250.0, 1.0])
    # d = r_B - r_A, in the axes of A
    close(row["pins_gap_x_m"], -0.25 if bodies[0] == "fore" else 0.25)


def test_separation_speed_is_the_derivative_of_the_distance(pair):
    """Tumbling free, where the axis itself turns. 1e-6 m/s: third derivatives of up to 5 m/s3 times
    (1 ms)^2 / 6."""
    history = pair(
        {"phase": [{"name": "free"}], "motor": [AFT], "initial.omega_rad_s": [0.1, 0.2, 0.3]}
    ).simulate(step_s=0.001)
    distance, speed = (
        history[name].to_numpy() for name in ("separation_distance_mm", "separation_speed_m_s")
    )
    assert_allclose((distance[2:] - distance[:-2]) / 2.0, speed[1:-1], rtol=0, atol=1e-6)


def test_products_of_inertia_are_positive_integrals(pair):
    """J = [[3, -1, 0], [-1, 2, 0], [0, 0, 4]]: a couple of -2 N m in roll gives omega' = J^-1 M =
    -2/5 (2, 1, 0) rad/s2.

    1e-6: after 1 ms the gyroscopic moment, some 1e-6 N m, has changed it by less.
    """
    tensor = {
        "body.fore.inertia_kg_m2": [3.0, 2.0, 4.0],
        "body.fore.inertia_products_kg_m2": [1.0, 0.0, 0.0],
    }
    couple = [
        UP | {"offset_m": [0.0, 0.1]},
        UP | {"name": "down", "clock_deg": 90.0, "offset_m": [0.0, -0.1]},
    ]
    free = {"phase": [{"name": "free"}], "motor": couple, "run.end_time_s": 0.001}
    last = pair(tensor | free).simulate(step_s=0.001).iloc[-1]
    assert_allclose(last["fore_omega_x_deg_s"] * DEG, -2e-3 * 2 / 5, rtol=1e-6)
    assert_allclose(last["fore_omega_y_deg_s"] * DEG, -2e-3 * 1 / 5, rtol=1e-6)


def test_paths_and_columns(table2):
    """`body.upper.cg_mm.x` has the column `in_body_upper_cg_x_mm`, in mm; inside it is in m."""
    case = table2.case(3)
    assert case.scene.body["upper"].cg[0] == case.inputs["in_body_upper_cg_x_mm"] * 1e-3
    assert case.scene.initial.roll == case.inputs["in_initial_roll_deg"] * DEG


def test_nan_is_never_replaced():
    """The clamp against round-off in the angles lets NaN through."""
    assert math.isnan(quat.angles((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, math.nan, 0.0, 1.0))[1])
    assert quat.angles((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0 + 1e-15, 0.0, 0.0))[1] == -90 * DEG


def test_status_of_a_failed_case(pair):
    """A joint that still guides at the end: not `ok`, and the time that does not exist is NaN."""
    result = (
        pair(
            {
                "phase": [
                    SLIDER[0] | {"until": {"joint": "pins", "stroke_mm": 1.0}},
                    {"name": "free"},
                ]
            }
        )
        .simulate()
        .attrs
    )
    assert result["status"] == "never-released"
    assert math.isnan(result["outcomes"]["release_time_s"])
