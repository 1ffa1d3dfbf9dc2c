"""Angles of hinges, relative attitudes and distances of mass centres, against closed forms."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import independent

from sepmc.campaign.campaign import Campaign
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

BALL = {"mass_kg": 10.0, "inertia_kg_m2": [2.0, 2.0, 2.0]}
AT_REST = {"altitude_km": 100.0, "speed_m_s": 0.0}
EMPTY = {"environment": {"atmosphere": "none", "gravity": "none"}, "initial": AT_REST}


def hinged(rate_deg_s=40.0, x_axis=(0.0, 0.0, 1.0), **more):
    """A door that turns about its mass centre, on a hinge to the ground."""
    joint = {"bodies": ["ground", "door"], "point_m": [1.0, 0.0, 0.0], "x_axis": list(x_axis)}
    joint |= {"y_axis": [1.0, 0.0, 0.0], "omega_deg_s": [rate_deg_s * x for x in x_axis]}
    tree = EMPTY | {
        "name": "door",
        "body": {"door": BALL | {"cg_m": [1.0, 0.0, 0.0]}},
        "joint": {"hinge": joint},
        "phase": [{"name": "turning", "joints": {"hinge": "revolute"}}],
        "event": [{"name": "early", "when": {"time_s": 1.0}}],
        "output": {"hinge": ["hinge"]},
        "run": {"end_time_s": 2.0, "cases": 1},
    }
    return Campaign(parse_campaign(tree | more, "door.toml"))


def free(rate_deg_s=(0.0, 0.0, 30.0), **more):
    """Two balls 3 m apart; the second spins, and leaves across the line between them."""
    joint = {"bodies": ["one", "two"], "point_m": [2.0, 0.0, 0.0], "omega_deg_s": list(rate_deg_s)}
    tree = EMPTY | {
        "name": "balls",
        "body": {
            "one": BALL | {"cg_m": [1.0, 0.0, 0.0]},
            "two": BALL | {"cg_m": [4.0, 0.0, 0.0]},
        },
        "joint": {"pin": joint},
        "phase": [{"name": "free"}],
        "event": [{"name": "early", "when": {"time_s": 1.0}}],
        "output": {"relative": [["one", "two"]]},
        "run": {"end_time_s": 2.0, "cases": 1},
    }
    return Campaign(parse_campaign(tree | more, "balls.toml"))


def simulated(campaign, step_s=0.25):
    history = campaign.simulate(campaign.nominal(), step_s=step_s)
    return history, history.attrs["outcomes"]


@pytest.mark.parametrize("x_axis", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_a_hinge_at_a_constant_rate(x_axis):
    history, outcomes = simulated(hinged(x_axis=x_axis))
    assert_allclose(outcomes["hinge_angle_deg"], 80.0, rtol=1e-11)
    assert_allclose(outcomes["early_hinge_angle_deg"], 40.0, rtol=1e-11)
    assert_allclose(outcomes["early_hinge_angle_rate_deg_s"], 40.0, rtol=1e-11)
    assert_allclose(history["hinge_angle_deg"], 40.0 * history["time_s"], rtol=0, atol=1e-8)
    assert_allclose(history["hinge_angle_rate_deg_s"], 40.0, rtol=1e-11)


def test_a_hinge_that_turns_further_than_half_a_turn():
    outcomes = simulated(hinged(rate_deg_s=-100.0))[1]
    assert_allclose(outcomes["hinge_angle_deg"], 160.0, rtol=1e-11)
    assert_allclose(outcomes["hinge_angle_rate_deg_s"], -100.0, rtol=1e-11)


def test_two_free_bodies():
    """Relative speed omega x r of the second about the joint point."""
    history, outcomes = simulated(free())
    speed = math.radians(30.0) * 2.0
    for start, time in (("", 2.0), ("early_", 1.0)):
        distance = math.hypot(3.0, speed * time)
        assert_allclose(outcomes[f"{start}two_from_one_distance_m"], distance, rtol=1e-12)
        assert_allclose(outcomes[f"{start}two_from_one_pitch_deg"], 30.0 * time, rtol=1e-11)
        for key in ("roll", "yaw"):
            assert abs(outcomes[f"{start}two_from_one_{key}_deg"]) < 1e-10
    expected = np.hypot(3.0, speed * history["time_s"])
    assert_allclose(history["two_from_one_distance_m"], expected, rtol=1e-9)


@pytest.mark.parametrize(("axis", "key"), [(0, "roll"), (1, "yaw")])
def test_relative_roll_and_yaw(axis, key):
    rate = [0.0, 0.0, 0.0]
    rate[axis] = -25.0
    outcomes = simulated(free(rate))[1]
    assert_allclose(outcomes[f"two_from_one_{key}_deg"], -50.0, rtol=1e-11)


def test_both_against_the_independent_simulation():
    """Tumbling together, then free."""
    campaign = free(
        (3.0, -20.0, 35.0),
        initial=AT_REST | {"omega_deg_s": [10.0, 12.0, -8.0]},
        output={"relative": [["one", "two"], ["two", "one"]], "hinge": ["pin"]},
    )
    expected = independent.simulate(campaign.nominal().to_dict()).outcomes
    outcomes = simulated(campaign)[1]
    names = [name for name in expected if "_from_" in name or "_angle_" in name]
    assert len(names) == 20
    for name in names:
        assert outcomes[name] == pytest.approx(expected[name], abs=1e-8)


def test_columns_stand_only_where_they_are_requested():
    assert not [name for name in simulated(hinged(output={}))[1] if "hinge_angle" in name]


@pytest.mark.slow
def test_rows_and_formulas_have_them():
    """In rows of a compiled campaign, in formulas of outcomes and in requirements."""
    campaign = hinged(
        outcome=[{"name": "left", "formula": "90 - hinge_angle_deg", "unit": "deg"}],
        requirement=[{"name": "open", "metric": "hinge_angle_deg", "at_least": 70.0}],
    )
    rows = campaign.run(cases=2).to_pandas()
    assert_allclose(rows["hinge_angle_deg"], 80.0, rtol=1e-9)
    assert_allclose(rows["left_deg"], 10.0, rtol=1e-8)


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ({"hinge": ["hing"]}, "output.hinge = 'hing': no such joint"),
        ({"hinge": ["hinge", "hinge"]}, "output.hinge .*names a joint twice"),
        ({"relative": [["door", "ground"]]}, "output.relative .*the ground has no centre of mass"),
        ({"relative": [["door", "door"]]}, "output.relative"),
        ({"relative": [["door"]]}, "output.relative"),
    ],
)
def test_wrong_requests_are_refused(output, message):
    with pytest.raises(SceneError, match=message):
        hinged(output=output)


def test_a_hinge_angle_in_a_signal():
    """A spring of a hinge, written as a moment: a pendulum that swings with its closed form."""
    k, inertia, rate = 8.0, 2.0, math.radians(40.0)
    signal = {"name": "spring", "formula": "-k * joint.hinge.angle_rad", "k": k}
    load = {"name": "torsion", "body": "door", "moment_N_m": [0.0, 0.0, "spring"]}
    history, outcomes = simulated(hinged(signal=[signal], load=[load]), step_s=0.02)
    w = math.sqrt(k / inertia)
    angle = np.degrees(rate / w * np.sin(w * history["time_s"]))
    assert_allclose(history["hinge_angle_deg"], angle, rtol=0, atol=1e-6)
    expected = math.degrees(rate * math.cos(2.0 * w))
    assert_allclose(outcomes["hinge_angle_rate_deg_s"], expected, rtol=1e-8)


def test_a_kink_at_a_hinge_angle():
    """A moment that begins at 20 deg, 0.5 s after the start, and a brake on the rate."""
    signals = [
        {"name": "late", "formula": "where(joint.hinge.angle_deg > 20, 2, 0)"},
        {"name": "fast", "formula": "where(joint.hinge.angle_rate_rad_s > 1, -1, 0)"},
    ]
    loads = [
        {"name": one["name"], "body": "door", "moment_N_m": [0.0, 0.0, one["name"]]}
        for one in signals
    ]
    outcomes = simulated(hinged(signal=signals, load=loads), step_s=0.5)[1]
    rate = math.radians(40.0)
    begun = (1.0 - rate) / 1.0  # from 0.5 s on at 1 rad/s2, until it is 1 rad/s
    expected = math.degrees(1.0 + 0.5 * (1.5 - begun))
    assert_allclose(outcomes["hinge_angle_rate_deg_s"], expected, rtol=1e-9)
