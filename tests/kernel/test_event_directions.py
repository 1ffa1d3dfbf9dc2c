"""Conditions with a crossing direction, and quantities at their threshold at the start of a
phase."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate

G = 9.80665
EXACT = 1e-11  # s
# level, and climbing at 10 m/s from 1000 m: the top is 1005.099 m at 1.0197 s
UP = {
    "initial.alpha_deg": -90.0,
    "initial.speed_m_s": 10.0,
    "environment.gravity": "constant",
    "run.end_time_s": 3.0,
}
# 2 N on each end of 3 kg and 1 kg by a spring without end: pins open as (1 - cos(wt)) / 10 m
SWINGING = {
    "spring": [
        {
            "name": "bungee",
            "bodies": ["fore", "aft"],
            "point_m": [2.0, 0.0, 0.0],
            "axis": [-1.0, 0.0, 0.0],
            "force_N": 2.0,
            "stiffness_N_per_m": 20.0,
        }
    ],
    "run.end_time_s": 2.0,
}
RATE = math.sqrt(20.0 / 0.75)


def at_height(height, sign):
    """Time at which the vehicle of `UP` passes a height, m, rising (-1) or falling (+1)."""
    return (10.0 + sign * math.sqrt(100.0 - 2.0 * G * (height - 1000.0))) / G


def phases(*untils, kind="fixed"):
    """Phases p0, p1, ... in which the pins are of a kind, and a last one without them."""
    results = [
        {"name": f"p{i}", "joints": {"pins": kind}, "until": until}
        for i, until in enumerate(untils)
    ]
    return [*results, {"name": "apart"}]


def ends(campaign, step_s=0.1):
    """End times of phases, s, by the kernel and by the independent simulation."""
    history = campaign.simulate(step_s=step_s)
    time, phase = history["time_s"].to_numpy(), history["phase"].to_numpy()
    results = [time[i] for i in np.flatnonzero(phase[1:] != phase[:-1])]
    other = simulate(campaign.nominal().to_dict())
    assert history.attrs["status"] == other.status
    reported = [time for time, what in other.events if what.endswith("ended")]
    if reported:  # phases that end at one instant are one change of phase in a history
        assert_allclose(
            np.unique(np.round(results, 9)), np.unique(np.round(reported, 9)), atol=2e-9
        )
    return results, history.attrs


HEIGHT = {"body": "fore", "altitude_m": 1003.0}
RISING, FALLING, EITHER = ({"direction": way} for way in ("rising", "falling", "either"))


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.02, 0.7])
@pytest.mark.parametrize(
    ("first", "second"),
    [
        (HEIGHT, HEIGHT),
        (HEIGHT | RISING, HEIGHT | FALLING),
        (HEIGHT | EITHER, HEIGHT | EITHER),
        (HEIGHT, {"any": [HEIGHT, {"time_s": 2.9}]}),
        ({"all": [HEIGHT, {"time_s": 0.1}]}, HEIGHT | FALLING),
    ],
)
def test_the_same_height_twice(pair, first, second, step):
    """The crossing that ends the first phase does not end the second, which ends on the way
    down."""
    settings = UP | {"phase": phases(first, second), "solver.step_s": step}
    result, _ = ends(pair(settings))
    assert_allclose(result, [at_height(1003.0, -1.0), at_height(1003.0, 1.0)], rtol=0, atol=EXACT)


def retro(**keys):
    """2 N on the aft body, rising and falling within 0.4 s as a triangle; the joint carries three
    quarters."""
    profile = {"time_s": [0.0, 0.2, 0.4], "fraction": [0.0, 1.0, 0.0]}
    motor = {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}
    return {"motor": [motor | {"profile": profile} | keys], "run.end_time_s": 0.5}


def turning():
    """1 N m about the hinge of the aft body, 1 kg m2, for 1 s, and then against it: 0.6 rad on the
    way there, and back."""
    loads = [
        {"name": name, "body": "aft", "moment_N_m": [moment, 0.0, 0.0]} | times
        for name, moment, times in (
            ("there", 1.0, {"end_s": 1.0}),
            ("back", -2.0, {"start_s": 1.0}),
        )
    ]
    return {"load": loads, "run.end_time_s": 2.4}


# a scene, what its pins are, a condition, and when it is crossed upward and downward
CROSSED = {
    "altitude": (UP, "fixed", HEIGHT, at_height(1003.0, -1.0), at_height(1003.0, 1.0)),
    "stroke": (
        SWINGING,
        "slider",
        {"joint": "pins", "stroke_m": 0.1},
        0.5 * math.pi / RATE,
        1.5 * math.pi / RATE,
    ),
    "distance": (
        SWINGING,
        "slider",
        {"joint": "pins", "distance_m": 0.15},
        (math.pi - math.acos(0.5)) / RATE,
        (math.pi + math.acos(0.5)) / RATE,
    ),
    "angle": (
        turning(),
        "revolute",
        {"joint": "pins", "angle_rad": 0.6},
        1.5 - math.sqrt(0.15),
        1.5 + math.sqrt(0.15),
    ),
    "force": (retro(), "fixed", {"joint": "pins", "force_N": 1.2}, 0.16, 0.24),
    # across, a third of a metre: what turns the fore body with the aft one
    "moment": (retro(cant_deg=90.0), "fixed", {"joint": "pins", "moment_N_m": 0.2}, 0.12, 0.28),
}


@pytest.fixture(params=CROSSED)
def crossed(request, pair):
    """Maker of campaigns whose phases end by such conditions, the condition and its times."""
    settings, kind, condition, up, down = CROSSED[request.param]

    def make(*untils):
        return pair(settings | {"phase": phases(*untils, kind=kind)})

    return make, condition, up, down


@pytest.mark.slow
def test_a_direction_counts(crossed):
    make, condition, up, down = crossed
    for way, time in (({}, up), (RISING, up), (EITHER, up), (FALLING, down)):
        assert_allclose(ends(make(condition | way))[0], [time], rtol=0, atol=EXACT)


@pytest.mark.slow
def test_standing_at_the_threshold_is_no_crossing(crossed):
    """The first phase ends at the threshold; the second waits for the next crossing."""
    make, condition, up, down = crossed
    for then in (FALLING, EITHER):
        result = ends(make(condition | RISING, condition | then))[0]
        assert_allclose(result, [up, down], rtol=0, atol=EXACT)


@pytest.mark.slow
def test_on_the_other_side_as_it_is_armed(crossed):
    """Beyond the threshold when the phase begins: a rising crossing must still come, a falling one
    does."""
    make, condition, up, down = crossed
    middle = {"time_s": 0.5 * (up + down)}
    assert_allclose(ends(make(middle, condition | FALLING))[0][1], down, rtol=0, atol=EXACT)
    assert_allclose(ends(make(middle, condition | EITHER))[0][1], down, rtol=0, atol=EXACT)
    result, reported = ends(make(middle, condition | RISING))
    again = up + 2.0 * math.pi / RATE  # of what swings
    if "stroke_m" in condition or "distance_m" in condition:
        assert_allclose(result[1], again, rtol=0, atol=EXACT)
    else:
        assert reported["status"] == "never-released"


@pytest.mark.slow
def test_a_limit_is_met_beyond_it_and_at_it(crossed):
    """Without a direction, a quantity at or beyond the threshold meets it at once; a height, which
    must be crossed, does not."""
    make, condition, up, down = crossed
    middle = 0.5 * (up + down)
    at_once = "altitude_m" not in condition
    result, reported = ends(make(condition, condition))
    assert_allclose(result, [up] if at_once else [up, down], rtol=0, atol=EXACT)
    result, reported = ends(make({"time_s": middle}, condition))
    assert_allclose(result, [middle] if at_once else [middle, down], rtol=0, atol=EXACT)
    assert reported["outcomes"]["release_time_s"] == (pytest.approx(middle if at_once else down))


APEX = {"body": "fore", "vertical_speed_m_s": 0.0}
FALL = {**UP, "initial.speed_m_s": 0.0}


@pytest.mark.parametrize("step", [0.05, 0.9])
@pytest.mark.parametrize("way", [{}, FALLING, EITHER])
def test_release_at_the_apex(pair, way, step):
    settings = UP | {"phase": phases(APEX | way), "solver.step_s": step}
    result, reported = ends(pair(settings))
    assert_allclose(result, [10.0 / G], rtol=0, atol=EXACT)
    assert_allclose(reported["outcomes"]["release_time_s"], 10.0 / G, rtol=0, atol=EXACT)


@pytest.mark.parametrize("speed", [4.0, -4.0])
def test_a_vertical_speed_up_is_positive(pair, speed):
    settings = UP | {"phase": phases({"body": "aft", "vertical_speed_m_s": speed})}
    assert_allclose(ends(pair(settings))[0], [(10.0 - speed) / G], rtol=0, atol=EXACT)


def test_no_apex_of_what_only_falls(pair):
    """Dropped from rest: the vertical speed is 0 at the start and decreases."""
    for way in ({}, FALLING, RISING):
        _, reported = ends(pair(FALL | {"phase": phases(APEX | way)}))
        assert reported["status"] == "never-released"


def test_apex_after_a_rise_from_rest(pair):
    """From rest, 3 g up for 0.2 s: a vertical speed of 0 at the start meets no condition, nor does
    leaving 0; returning to 0 does."""
    push = {
        "name": "push",
        "body": "fore",
        "point_m": [1.5, 0.0, 0.0],
        "force_N": [0.0, 4.0 * 4.0 * G, 0.0],
        "frame": "ground",
        "end_s": 0.2,
    }
    for way in ({}, FALLING):
        settings = FALL | {"load": [push], "phase": phases(APEX | way), "run.end_time_s": 1.5}
        assert_allclose(ends(pair(settings))[0], [0.8], rtol=0, atol=EXACT)


def test_what_stood_long_at_its_threshold(pair):
    """Fixed to the ground at a height for 0.3 s, then dropped: it has not crossed that height; it
    crosses one 0.1 m below."""
    settings = {
        "environment.gravity": "constant",
        "initial.pitch_deg": 90.0,
        "initial.speed_m_s": 0.0,
        "run.end_time_s": 0.6,
        "joint.pad": {"bodies": ["ground", "aft"], "point_m": [4.0, 0.0, 0.0]},
        "phase": [
            {"name": "p0", "joints": {"pins": "fixed", "pad": "fixed"}, "until": {"time_s": 0.3}},
            {"name": "p1", "joints": {"pins": "fixed"}},
        ],
    }
    start = 998.5  # 1.5 m below the mass centre of both
    events = [
        {"name": name, "when": {"body": "aft", "altitude_m": start - drop} | way}
        for name, drop, way in (
            ("here", 0.0, {}),
            ("down", 0.0, FALLING),
            ("lower", 0.1, {}),
            ("raised", 0.1, RISING),
        )
    ]
    campaign = pair(settings | {"event": events})
    result = campaign.simulate(step_s=0.1).attrs["outcomes"]
    other = simulate(campaign.nominal().to_dict()).outcomes
    for name in ("here", "down", "raised"):
        assert math.isnan(result[f"{name}_time_s"])
        assert math.isnan(other[f"{name}_time_s"])
    for reported in (result, other):
        assert_allclose(reported["lower_time_s"], 0.3 + math.sqrt(0.2 / G), rtol=0, atol=EXACT)
