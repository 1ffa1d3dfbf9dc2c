"""Ends of phases and releases: every kind of condition against a closed form, order, combinations,
delayed and failed releases."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.random_scenes.interpreted import run_interpreted
from scipy.optimize import brentq
from support.event_scenes import EXACT, FIXED, FREE, SLIDER, changes, flown
from support.output_scenes import RETRO, phases

# level, and climbing
UP = {"initial.alpha_deg": -90.0, "initial.speed_m_s": 10.0, "environment.gravity": "constant"}
G = 9.80665


def ends(pair, until, joints, settings, after=None):
    """End time of the first of two phases, s."""
    history, _ = flown(pair(settings | {"phase": phases((joints, until), (after or {}, None))}))
    ((time, before, then),) = changes(history)
    assert (before, then) == ("p0", "p1")
    return time


def test_at_a_time(pair):
    assert ends(pair, {"time_s": 0.123}, FIXED, {}) == 0.123


def test_at_burn_out(pair):
    """Ignition 0.05 s, 0.02 s late, 0.1 s of burning."""
    motor = RETRO | {"ignition_s": 0.05, "delay_s": 0.02, "burn_s": 0.1}
    assert_allclose(
        ends(pair, {"burn_out": "retro"}, FIXED, {"motor": [motor]}), 0.17, rtol=0, atol=EXACT
    )


def test_at_the_end_of_a_profile(pair):
    """A motor without burn time burns as long as its profile."""
    motor = RETRO | {
        "ignition_s": 0.05,
        "profile": {"time_s": [0.0, 0.1, 0.3], "fraction": [0.0, 1.0, 0.0]},
    }
    assert_allclose(
        ends(pair, {"burn_out": "retro"}, FIXED, {"motor": [motor]}), 0.35, rtol=0, atol=EXACT
    )


@pytest.mark.parametrize("key", ["stroke_mm", "distance_mm"])
def test_at_a_stroke(pair, key):
    """s = t^2: 90 mm at 0.3 s; the distance of the points of a slider is its stroke."""
    assert_allclose(
        ends(pair, {"joint": "pins", key: 90.0}, SLIDER, {"motor": [RETRO]}),
        0.3,
        rtol=0,
        atol=EXACT,
    )


def test_at_a_distance(pair):
    """Free from the start, spinning at w about z: |d| = D sqrt((1 - cos wt)^2 + (wt - sin wt)^2), D
    the distance of both mass centres."""
    w, far = 3.0, 0.5
    turned = brentq(
        lambda x: 2.0 * math.hypot(1.0 - math.cos(x), x - math.sin(x)) - far, 0.0, 3.0, xtol=1e-15
    )
    time = ends(
        pair, {"joint": "pins", "distance_m": far}, FREE, {"initial.omega_rad_s": [0.0, 0.0, w]}
    )
    assert_allclose(time, turned / w, rtol=0, atol=EXACT)


@pytest.mark.parametrize("angle", [0.01, 40.0, 90.0, 170.0])
def test_at_an_angle(pair, angle):
    """1 N m on the aft body's 1 kg m2, about the axis of a hinge without friction: angle = t^2 /
    2."""
    load = {"name": "turn", "body": "aft", "moment_N_m": [1.0, 0.0, 0.0]}
    settings = {"load": [load], "run.end_time_s": 3.0}
    time = ends(pair, {"joint": "pins", "angle_deg": angle}, {"pins": "revolute"}, settings)
    assert_allclose(time, math.sqrt(2.0 * math.radians(angle)), rtol=0, atol=EXACT)


def test_angle_about_an_axis_across(pair):
    """Hinged about z: 3 N m on the aft body, and both turn about the hinge between them. The
    relative angle is quadratic while small."""
    load = {"name": "turn", "body": "aft", "moment_N_m": [0.0, 0.0, 3.0]}
    settings = {
        "load": [load],
        "joint.pins.x_axis": [0.0, 0.0, 1.0],
        "joint.pins.y_axis": [0.0, 1.0, 0.0],
    }
    history = pair(
        settings
        | {
            "phase": phases(
                ({"pins": "revolute"}, {"joint": "pins", "angle_deg": 7.0}), (FREE, None)
            )
        }
    ).simulate(step_s=0.01)
    (time, _, _), *_ = changes(history)
    at = history[history["time_s"] == time].iloc[0]
    assert_allclose(at["aft_pitch_deg"] - at["fore_pitch_deg"], 7.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["fixed", "slider"])
def test_at_a_break_load(pair, kind):
    """2 N (1 - exp(-t / 0.1)) along a locked pair of 3 kg and 1 kg: the joint carries three
    quarters of it, a slider nothing along x."""
    motor = RETRO | {
        "build_up_s": 0.1,
        "cant_deg": 180.0 if kind == "fixed" else 90.0,
        "station_m": 3.0,
    }
    settings = {
        "motor": [motor],
        "joint.pins.point_m": [3.0, 0.0, 0.0] if kind == "slider" else [2.0, 0.0, 0.0],
    }
    if kind == "fixed":
        time = ends(pair, {"joint": "pins", "force_N": 1.2}, FIXED, settings)
        assert_allclose(time, -0.1 * math.log(1.0 - 1.2 / 1.5), rtol=0, atol=EXACT)
    else:
        history, _ = flown(
            pair(
                settings
                | {"phase": phases((SLIDER, {"joint": "pins", "force_N": 0.5}), (FREE, None))}
            )
        )
        ((time, _, _),) = changes(history)
        before, after = (history[history["time_s"] == time].iloc[i] for i in (0, 1))
        assert_allclose(
            np.linalg.norm([before[f"pins_force_on_aft_{a}_N"] for a in "xyz"]),
            0.5,
            rtol=0,
            atol=1e-10,
        )
        assert not np.any([after[f"pins_force_on_aft_{a}_N"] for a in "xyz"])


@pytest.mark.parametrize(("key", "arm"), [("force_N", 1.0), ("moment_N_m", 0.5)])
@pytest.mark.parametrize("step", [0.5, 0.05])
def test_load_of_a_ramp(pair, key, arm, step):
    """Held to the ground by the fore body; 10 N/s across the aft, half a metre behind the joint: 10
    t N and 5 t N m, broken at 1.3."""
    motor = RETRO | {
        "thrust_N": 10.0,
        "cant_deg": 90.0,
        "station_m": 2.5,
        "profile": {"time_s": [0.0, 1.0], "fraction": [0.0, 1.0]},
    }
    held = {"hold": "fixed", "pins": "fixed"}
    settings = {
        "motor": [motor],
        "joint.hold": {"bodies": ["ground", "fore"], "point_m": [0.0, 0.0, 0.0]},
        "initial.speed_m_s": 0.0,
    }
    settings |= {"solver.step_s": step}
    time = ends(pair, {"joint": "pins", key: 1.3}, held, settings, {"hold": "fixed"})
    assert_allclose(time, 0.13 / arm, rtol=0, atol=EXACT)


def test_load_that_jumps(pair):
    """A motor at full thrust at once breaks the joint when it ignites."""
    settings = {"motor": [RETRO | {"ignition_s": 0.123}]}
    assert_allclose(
        ends(pair, {"joint": "pins", "force_N": 1.2}, FIXED, settings), 0.123, rtol=0, atol=EXACT
    )


def test_load_that_rises_and_falls_within_a_step(pair):
    """1.5 N for 40 ms, a triangular profile: breaks at 1.2 N on its way up, although a step of 0.5
    s begins and ends without load."""
    profile = {"time_s": [0.0, 0.02, 0.04], "fraction": [0.0, 1.0, 0.0]}
    settings = {"motor": [RETRO | {"ignition_s": 0.2, "profile": profile}], "solver.step_s": 0.5}
    assert_allclose(
        ends(pair, {"joint": "pins", "force_N": 1.2}, FIXED, settings), 0.216, rtol=0, atol=EXACT
    )


@pytest.mark.parametrize("step", [0.01, 0.05, 0.6])
def test_at_a_height_rising(pair, step):
    """1000 + 10 t - g t^2 / 2 = 1001, on the way up."""
    time = ends(pair, {"body": "fore", "altitude_m": 1001.0}, FIXED, UP | {"solver.step_s": step})
    assert_allclose(time, (10.0 - math.sqrt(100.0 - 2.0 * G)) / G, rtol=0, atol=EXACT)


@pytest.mark.parametrize("step", [0.05, 0.6])
def test_at_a_height_falling(pair, step):
    """From 1000 m up to 1005.1 m, and down through 998 m."""
    time = ends(
        pair,
        {"body": "aft", "altitude_m": 998.0},
        FIXED,
        UP | {"run.end_time_s": 3.0, "solver.step_s": step},
    )
    assert_allclose(time, (10.0 + math.sqrt(100.0 + 4.0 * G)) / G, rtol=0, atol=EXACT)


def test_height_grazed_within_a_step(pair):
    """Up and down past 1005 m in one step of 1.5 s: met on the way up."""
    time = ends(
        pair,
        {"body": "fore", "altitude_m": 1005.0},
        FIXED,
        UP | {"run.end_time_s": 3.0, "solver.step_s": 1.5},
    )
    assert_allclose(time, (10.0 - math.sqrt(100.0 - 10.0 * G)) / G, rtol=0, atol=EXACT)


def test_never_that_high(pair):
    """The top is 1005.1 m."""
    never = {"phase": phases((FIXED, {"body": "fore", "altitude_m": 1005.2}), (FREE, None))}
    result = pair(UP | never | {"run.end_time_s": 3.0}).simulate(step_s=0.1)
    assert result.attrs["status"] == "never-released"
    assert changes(result) == []


@pytest.mark.parametrize(
    ("until", "expected"),
    [
        # several keys: whichever comes first
        ({"time_s": 0.2, "joint": "pins", "stroke_mm": 10.0}, 0.1),
        ({"time_s": 0.05, "joint": "pins", "stroke_mm": 10.0}, 0.05),
        ({"any": [{"time_s": 0.2}, {"joint": "pins", "stroke_mm": 10.0}]}, 0.1),
        ({"all": [{"time_s": 0.2}, {"joint": "pins", "stroke_mm": 10.0}]}, 0.2),
        ({"all": [{"time_s": 0.05}, {"joint": "pins", "stroke_mm": 10.0}]}, 0.1),
        (
            {
                "all": [
                    {"time_s": 0.05},
                    {"any": [{"time_s": 0.4}, {"joint": "pins", "stroke_mm": 90.0}]},
                ]
            },
            0.3,
        ),
        (
            {
                "any": [
                    {"time_s": 0.4},
                    {"all": [{"time_s": 0.15}, {"joint": "pins", "distance_mm": 10.0}]},
                ]
            },
            0.15,
        ),
        (
            {
                "all": [
                    {"any": [{"time_s": 0.3}, {"time_s": 0.1}]},
                    {"any": [{"time_s": 0.25}, {"burn_out": "brief"}]},
                ]
            },
            0.2,
        ),
        (
            {
                "time_s": 0.35,
                "all": [
                    {"time_s": 0.1},
                    {"all": [{"time_s": 0.2}, {"joint": "pins", "stroke_mm": 62.5}]},
                ],
            },
            0.25,
        ),
    ],
)
def test_any_and_all(pair, until, expected):
    """s = t^2, and a motor without thrust that burns out at 0.2 s."""
    motors = [
        RETRO,
        {"name": "brief", "body": "fore", "thrust_N": 0.0, "burn_s": 0.2, "station_m": 0.0},
    ]
    assert_allclose(ends(pair, until, SLIDER, {"motor": motors}), expected, rtol=0, atol=EXACT)


def test_what_was_met_stays_met(pair):
    """Above 1005 m from 0.86 s to 1.18 s: at 1.5 s all conditions are met, although the vehicle has
    come down again."""
    until = {"all": [{"body": "fore", "altitude_m": 1005.0}, {"time_s": 1.5}]}
    assert ends(pair, until, FIXED, UP | {"run.end_time_s": 2.0}) == 1.5


@pytest.mark.parametrize("step", [0.5, 0.05])
def test_several_in_one_step(pair, step):
    """Four phases that end within milliseconds of each other, in order, each at its own time: s =
    t^2."""
    strokes = [1.0, 1.2, 1.21, 90.0]
    steps = [(SLIDER, {"joint": "pins", "stroke_mm": stroke}) for stroke in strokes]
    history, outcomes = flown(
        pair({"motor": [RETRO], "phase": phases(*steps, (FREE, None)), "solver.step_s": step})
    )
    result = changes(history)
    assert [(before, then) for _, before, then in result] == [
        ("p0", "p1"),
        ("p1", "p2"),
        ("p2", "p3"),
        ("p3", "p4"),
    ]
    assert_allclose(
        [time for time, _, _ in result], np.sqrt(np.array(strokes) / 1e3), rtol=0, atol=EXACT
    )
    assert_allclose(outcomes["release_time_s"], 0.3, rtol=0, atol=EXACT)


def test_met_when_the_phase_begins(pair):
    """The second phase ends at a stroke that is already exceeded: its duration is zero."""
    steps = [
        (SLIDER, {"joint": "pins", "stroke_mm": 10.0}),
        (SLIDER, {"joint": "pins", "stroke_mm": 5.0}),
        (FREE, None),
    ]
    history, outcomes = flown(pair({"motor": [RETRO], "phase": phases(*steps)}))
    assert_allclose(outcomes["release_time_s"], 0.1, rtol=0, atol=EXACT)
    ((time, before, then),) = changes(history)
    assert (before, then) == ("p0", "p2")
    assert time == outcomes["release_time_s"]


@pytest.mark.parametrize(
    "until",
    [{"time_s": 0.0}, {"joint": "pins", "stroke_mm": 0.0}],
)
def test_met_at_the_start(pair, until):
    """Free from the start."""
    history, outcomes = flown(
        pair({"motor": [RETRO], "phase": phases((SLIDER, until), (FREE, None))})
    )
    assert outcomes["release_time_s"] == 0.0
    assert set(history["phase"]) == {"p1"}
    assert_allclose(outcomes["separation_distance_mm"], 250.0, rtol=1e-12)


@pytest.mark.slow
def test_dispersed(pair, plainly):
    """Strokes within any and all, delays and failures, sampled per case: each release at the time
    of its own parameters."""
    until = {
        "any": [
            {"joint": "pins", "stroke_mm": 10.0},
            {"all": [{"time_s": 0.3}, {"joint": "pins", "stroke_mm": 1.0}]},
        ]
    }
    campaign = pair(
        {
            "motor": [RETRO],
            "phase": phases((SLIDER, until), (FREE, None)),
            "dispersion.phase.p0.until.any.0.stroke_mm": {"discrete": [10.0, 40.0, 160.0]},
            "dispersion.phase.p0.until.any.1.all.0.time_s": {"uniform": [0.3, 0.35]},
            "dispersion.joint.pins.delay_s": {"uniform": [0.0, 0.05]},
            "dispersion.joint.pins.fails": {"discrete": [0, 1], "weights": [0.8, 0.2]},
        }
    )
    table = campaign.run(cases=100).to_pandas()
    stroke, time = (
        table["in_phase_p0_until_any_0_stroke_mm"],
        table["in_phase_p0_until_any_1_all_0_time_s"],
    )
    assert set(stroke) == {10.0, 40.0, 160.0}
    failed = table["in_joint_pins_fails"] == 1.0
    assert 10 <= failed.sum() <= 30
    assert (table["status"] == np.where(failed, "never-released", "ok")).all()
    expected = np.minimum(np.sqrt(stroke / 1e3), time) + table["in_joint_pins_delay_s"]
    assert_allclose(table["release_time_s"][~failed], expected[~failed], rtol=0, atol=EXACT)
    assert table["release_time_s"][failed].isna().all()
    assert np.isfinite(table["separation_distance_mm"]).all()
    row = campaign.simulate(campaign.case(7)).attrs["outcomes"]
    assert_allclose(row["separation_distance_mm"], table["separation_distance_mm"][7], rtol=1e-13)


def swinging(stroke_m, force):
    """The pair on a slider, driven by an undamped spring: the joint opens by f / k (1 - cos w t), w
    = 30 rad/s for 1/(1/3 + 1/1) kg and 675 N/m, and closes again, until a stroke is reached."""
    return {
        "phase": phases((SLIDER, {"joint": "pins", "stroke_m": stroke_m}), (FREE, None)),
        "spring": [
            {
                "name": "s",
                "bodies": ["fore", "aft"],
                "point_m": [2.0, 0.0, 0.0],
                "axis": [-1.0, 0.0, 0.0],
                "force_N": force,
                "stiffness_N_per_m": 675.0,
            }
        ],
        "run.end_time_s": 1.0,
        "run.cases": 6,
        "solver": {"accuracy": 1e-9},
    }


@pytest.mark.slow
@pytest.mark.parametrize("stroke", [0.0195, 0.019998, 0.01999999, 0.0203])
def test_a_stroke_near_the_turning_point(pair, stroke):
    """2 f / k = 20 mm: just reached, although it was predicted much earlier; or never."""
    result = pair(swinging(stroke, 6.75)).simulate(step_s=0.5).attrs
    if stroke > 0.02:
        assert result["status"] == "never-released"
        return
    assert result["status"] == "ok"
    release = math.acos(1.0 - stroke / 0.01) / 30.0
    # known as well as round-off of the stroke lets it be
    assert_allclose(
        result["outcomes"]["release_time_s"], release, rtol=0, atol=1e-12 + 1e-18 / (0.02 - stroke)
    )


@pytest.mark.slow
def test_strokes_near_the_turning_point(pair):
    """Cases that reach it and cases that do not, all with the status and time of the closed form;
    none is rejected."""
    laws = {"spring.s.force_N": {"uniform": [6.4, 6.8]}}
    campaign = pair(swinging(0.0195, 6.6) | {"dispersion": laws, "solver.accuracy": 1e-6})
    with run_interpreted():
        table = campaign.run(cases=4).to_pandas()
    size = table["in_spring_s_force_N"].to_numpy() / 675.0
    reached = 2.0 * size > 0.0195
    assert 0 < reached.sum() < 4
    assert list(table["status"]) == list(np.where(reached, "ok", "never-released"))
    assert_allclose(
        table["release_time_s"][reached],
        np.arccos(1.0 - 0.0195 / size[reached]) / 30.0,
        rtol=0,
        atol=1e-7,
    )
