"""Rates, attitudes and separations at an event: closed forms, runs that end there, and conditions
of events."""

import math
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate
from small_scenes import PUSH as ENDLESS
from small_scenes import REDUCED

from sepmc.scene.lint import lint_scene
from sepmc.scene.messages import SceneError

PUSH = ENDLESS | {"stroke_m": 0.1}
ASIDE = PUSH | {"name": "aside", "point_m": [2.0, 0.02, 0.01], "force_N": 6.0, "stroke_m": 0.15}
FREE = {
    "phase": [{"name": "free"}],
    "solver.step_s": 0.02,
    "initial.omega_deg_s": [20.0, -5.0, 8.0],
    "initial.pitch_deg": 30.0,
    "run.end_time_s": 0.8,
}
LET_GO = {
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.05}},
        {"name": "free"},
    ]
}


def event_values(campaign, event, case=None):
    """Outcomes at an event, by the rest of the column name."""
    outcomes = campaign.simulate(case, step_s=0.05).attrs["outcomes"]
    start = f"{event}_"
    return {name.removeprefix(start): v for name, v in outcomes.items() if name.startswith(start)}


def test_the_end_of_a_spring(pair):
    """12 N over 0.1 m on 0.75 kg: at rest first, 16 m/s2, so after sqrt(0.2 / 16) s, at sqrt(3.2)
    m/s."""
    event = {"name": "pushed", "when": {"spring": "push"}}
    result = event_values(
        pair(FREE | {"spring": [PUSH], "event": [event], "initial.omega_deg_s": [0, 0, 0]}),
        "pushed",
    )
    assert_allclose(result["time_s"], math.sqrt(0.2 / 16.0), rtol=1e-12)
    assert_allclose(
        result["separation_speed_m_s"], math.sqrt(2.0 * 12.0 * 0.1 / REDUCED), rtol=1e-11
    )
    assert_allclose(result["separation_distance_mm"], 100.0, rtol=1e-11)
    assert_allclose(
        [result["fore_pitch_deg"], result["fore_omega_z_deg_s"]], [30.0, 0.0], atol=1e-12
    )


CONDITIONS = {
    "a spring": {"spring": "aside"},
    "either spring": {"any": [{"spring": "aside"}, {"spring": "push"}]},
    "both springs": {"all": [{"spring": "aside"}, {"spring": "push"}]},
    "a time": {"time_s": 0.0731},
    "a stroke": {"joint": "pins", "stroke_mm": 60.0},
    "a distance or an angle": {"joint": "pins", "distance_m": 0.3, "angle_deg": 4.0},
    "a stroke after a spring": {"all": [{"spring": "push"}, {"joint": "pins", "stroke_mm": 60.0}]},
}


@pytest.mark.slow
@pytest.mark.parametrize("phases", [{}, LET_GO], ids=["free", "let go"])
@pytest.mark.parametrize("when", CONDITIONS.values(), ids=CONDITIONS)
def test_a_flight_that_ends_there_gives_the_same(pair, phases, when):
    """Event outcomes equal the final outcomes of a run that ends then, and those of the independent
    simulation."""
    scene = FREE | phases | {"spring": [PUSH, ASIDE], "event": [{"name": "now", "when": when}]}
    campaign = pair(scene)
    result = event_values(campaign, "now")
    shorter = pair({**scene, "event": [], "run.end_time_s": result["time_s"]})
    ended = shorter.simulate().attrs["outcomes"]
    apart = simulate(campaign.case(0).to_dict()).outcomes
    assert len(result) == 1 + 6 * 2 + 2
    for name, value in result.items():
        assert_allclose(value, apart[f"now_{name}"], rtol=1e-8, atol=1e-8)
        if name != "time_s":
            assert_allclose(value, ended[name], rtol=1e-8, atol=1e-8)


# a thrust that rises and falls pulls on a spherical joint between bodies that turn
SWELL = {
    "name": "swell",
    "body": "aft",
    "thrust_N": 20.0,
    "profile": {"time_s": [0.0, 0.3, 0.6], "fraction": [0.1, 1.0, 0.1]},
    "station_m": 3.5,
    "offset_m": [0.05, 0.02],
}
HELD = {
    "motor": [SWELL],
    "phase": [{"name": "held", "joints": {"pins": "spherical"}}],
    "initial.omega_deg_s": [40.0, -25.0, 100.0],
}
AT_8_N = {"joint": "pins", "force_N": 8.0}
LOADS = {
    "a force": AT_8_N,
    "a force that falls": AT_8_N | {"direction": "falling"},
    "a force, either way": AT_8_N | {"direction": "either"},
    "a force or a time": {"any": [AT_8_N, {"time_s": 0.7}]},
    "a force and a time": {"all": [AT_8_N, {"time_s": 0.01}]},
}
BROKEN = {
    "phase": [
        {"name": "held", "joints": {"pins": "spherical"}, "until": AT_8_N},
        {"name": "free"},
    ]
}
BREAKS = [{"name": "break", "joint": "pins", "to": "free", "when": AT_8_N}]


@pytest.mark.slow
@pytest.mark.parametrize("phases", [{}, BROKEN, {"release": BREAKS}], ids=["on", "ends", "breaks"])
@pytest.mark.parametrize("when", LOADS.values(), ids=LOADS)
def test_attitudes_where_a_load_is_reached(pair, when, phases):
    """A step is cut short where a load is reached: attitudes are those of that time, then and
    afterwards."""
    campaign = pair(FREE | HELD | phases | {"event": [{"name": "now", "when": when}]})
    flown = campaign.simulate(step_s=0.05).attrs["outcomes"]
    apart = simulate(campaign.case(0).to_dict()).outcomes
    names = [name for name in flown if name.startswith("now_") or name.endswith("_deg")]
    assert len(names) == 27
    for name in names:
        assert_allclose(flown[name], apart[name], rtol=1e-8, atol=1e-8, err_msg=name)


OUTLINES = {
    "body.fore.outline": [
        {"stations_m": [0.0, 1.9], "radii_m": [0.1, 0.3]},
        {"stations_m": [1.9, 2.4], "radii_m": [0.35, 0.35], "hollow": True},
    ],
    "body.aft.outline": [{"stations_m": [2.0, 4.0], "radii_m": [0.2, 0.3]}],
}
GAPS = [
    {"name": "gap", "bodies": ["fore", "aft"]},
    {"name": "freed", "bodies": ["aft", "fore"], "after": "pins"},
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("when", "counts"),
    [({"time_s": 0.02}, False), ({"time_s": 0.05}, True), ({"spring": "aside"}, True)],
    ids=["before", "at the release", "after"],
)
def test_clearances_at_an_event(pair, when, counts):
    """Distances at the event, of the clearances measured by then, as in the independent
    simulation."""
    scene = FREE | LET_GO | OUTLINES | {"spring": [PUSH, ASIDE], "clearance": GAPS}
    campaign = pair(scene | {"event": [{"name": "now", "when": when}]})
    result, apart = event_values(campaign, "now"), simulate(campaign.case(0).to_dict()).outcomes
    names = ("gap_clearance_mm", "freed_clearance_mm")
    assert_allclose(
        [result[name] for name in names], [apart[f"now_{name}"] for name in names], atol=1e-7
    )
    assert math.isfinite(result["gap_clearance_mm"])
    assert math.isfinite(result["freed_clearance_mm"]) == counts


def test_tip_off_equals_the_outcomes_at_a_release(pair):
    """Rates when a joint becomes free, by both outputs."""
    event = {"name": "freed", "when": {"time_s": 0.05}}
    campaign = pair(
        FREE | LET_GO | {"spring": [ASIDE], "event": [event], "output.tip_off": ["pins"]}
    )
    outcomes = campaign.simulate().attrs["outcomes"]
    for body in ("fore", "aft"):
        for axis in "xyz":
            assert (
                outcomes[f"freed_{body}_omega_{axis}_deg_s"]
                == outcomes[f"pins_tip_off_{body}_{axis}_deg_s"]
            )


def test_turns_are_counted_on(pair):
    """A roll of 720 deg/s about the axis: 360 deg after half a second, not 0."""
    event = {"name": "turned", "when": {"time_s": 0.5}}
    campaign = pair(FREE | {"event": [event], "initial.omega_deg_s": [720.0, 0.0, 0.0]})
    assert_allclose(event_values(campaign, "turned")["aft_roll_deg"], 360.0, rtol=1e-10)


def test_what_never_comes_has_no_value_and_ends_no_case(pair):
    """NaN outcomes, and the case is ok."""
    event = {"name": "far", "when": {"joint": "pins", "distance_m": 1e3}}
    history = pair(FREE | {"spring": [PUSH], "event": [event]}).simulate()
    assert history.attrs["status"] == "ok"
    assert all(
        math.isnan(value)
        for name, value in history.attrs["outcomes"].items()
        if name.startswith("far_")
    )


def test_an_event_at_the_start(pair):
    """A condition met at the start has the outcomes of the start."""
    event = {"name": "first", "when": {"time_s": 0.0}}
    result = event_values(pair(FREE | {"spring": [PUSH], "event": [event]}), "first")
    assert result["time_s"] == 0.0
    assert_allclose(result["aft_omega_x_deg_s"], 20.0, rtol=1e-14)


def test_a_phase_ends_with_a_spring(pair):
    """The condition holds for phases too."""
    phases = [
        {"name": "guided", "joints": {"pins": "slider"}, "until": {"spring": "push"}},
        {"name": "free"},
    ]
    outcomes = pair(FREE | {"phase": phases, "spring": [PUSH]}).simulate().attrs["outcomes"]
    speed, distance = outcomes["separation_speed_m_s"], outcomes["separation_distance_mm"]
    assert 0.0 < outcomes["release_time_s"] < 0.2
    assert speed > 1.0
    assert distance > 100.0


def test_a_threshold_may_vary(pair, plainly):
    """Each case has its own event time, alone as in the campaign."""
    event = {"name": "now", "when": {"time_s": 0.2}}
    campaign = pair(
        FREE
        | {
            "spring": [PUSH],
            "event": [event],
            "dispersion": {"event.now.when.time_s": {"uniform": 0.1}},
        }
    )
    rows = campaign.run(cases=4).to_pandas()
    (drawn,) = (name for name in rows if name.startswith("in_"))
    assert_allclose(rows["now_time_s"], rows[drawn], rtol=1e-15)
    assert np.ptp(rows["now_separation_distance_mm"]) > 1.0
    for name, value in event_values(campaign, "now", 2).items():
        assert_allclose(value, rows[f"now_{name}"][2], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"event": [{"name": "now"}]}, "event.now: table [when] is missing"),
        ({"event": [{"name": "now", "when": {}}]}, "event.now.when: is never met: give time_s"),
        (
            {"event": [{"name": "now", "when": {"spring": "psuh"}}]},
            "event.now.when.spring = 'psuh'",
        ),
        (
            {
                "event": [
                    {"name": "a", "when": {"time_s": 0.1}},
                    {"name": "a", "when": {"time_s": 0.2}},
                ]
            },
            "the name is used twice",
        ),
        (
            {
                "event": [{"name": "a", "when": {"time_s": 0.1}}],
                **{
                    f"joint.{name}": {"bodies": ["fore", "aft"], "point_m": [2.0, 0.0, 0.0]}
                    for name in ("b", "a_b")
                },
            },
            "event.a = 'a': there are two outcomes called a_b_separation_speed_m_s",
        ),
    ],
)
def test_what_is_refused(pair, settings, message):
    """The message has the place and the allowed values."""
    with pytest.raises(SceneError, match=re.escape(message)):
        pair(FREE | {"spring": [PUSH]} | settings)


def test_a_spring_without_an_end_is_a_slip(pair):
    """It never ends, so the event never occurs, unless its stroke is dispersed."""
    event = {"name": "pushed", "when": {"any": [{"spring": "push"}]}}
    campaign = pair(FREE | {"spring": [ENDLESS], "event": [event]})
    assert any(
        "spring push has no stroke_m" in message for message in lint_scene(campaign.scene, ())
    )
