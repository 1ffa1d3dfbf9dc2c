"""Redundant constraint rows: left out of the motion, joint loads by the minimum-norm solution."""

import numpy as np
import pytest
from turning_pair import BOTH, PUSH, TURNING, agrees, alone

from sepmc.scene.redundancy import dependent_rows

HINGES = {
    "near": ("fore", "mid", [1.0, 0.0, 0.0]),
    "far": ("mid", "aft", [2.0, 0.0, 1.0]),
    "low": ("aft", "bar", [3.0, 0.0, 0.3]),
    "end": ("bar", "fore", [2.5, 0.0, -0.5]),
}
SCENES = {
    "two bolts, then two rails": (
        {
            "joint.again": {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]},
            "phase": [
                {
                    "name": "bolted",
                    "joints": {"pins": "fixed", "again": "fixed"},
                    "until": {"time_s": 0.2},
                },
                {
                    "name": "guided",
                    "joints": {"pins": "slider", "again": "slider"},
                    "until": {"joint": "pins", "stroke_mm": 30.0},
                },
                {"name": "free"},
            ],
            "output": {"loads": ["pins", "again"], "tip_off": ["pins"]},
        },
        6,
    ),
    "three ball joints, until one of them breaks": (
        {
            "joint.again": {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]},
            "joint.third": {"bodies": BOTH, "point_m": [2.1, -0.2, 0.3]},
            "load": [PUSH | {"end_s": 0.3}],
            "motor": [
                {
                    "name": "pull",
                    "body": "aft",
                    "thrust_N": 9.0,
                    "build_up_s": 0.2,
                    "station_m": 3.0,
                    "cant_deg": 180.0,
                }
            ],
            "phase": [
                {
                    "name": "held",
                    "joints": dict.fromkeys(("pins", "again", "third"), "spherical"),
                    "until": {"joint": "again", "force_N": 2.5},
                },
                {"name": "free"},
            ],
            "output": {"loads": ["pins", "again", "third"]},
        },
        3,
    ),
    "a ball joint beside a bolt, alone watched": (
        {
            "joint.again": {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]},
            "phase": [
                {
                    "name": "bolted",
                    "joints": {"pins": "fixed", "again": "spherical"},
                    "until": {"time_s": 0.2},
                },
                {"name": "hinged", "joints": {"again": "spherical"}, "until": {"time_s": 0.3}},
                {"name": "free"},
            ],
            "output": {"loads": ["again"]},
        },
        3,
    ),
    "four hinges in a plane": (
        {
            "body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.5]},
            "body.bar": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 1.5]},
            "joint": {
                name: {
                    "bodies": [a, b],
                    "point_m": point,
                    "x_axis": [0.0, 1.0, 0.0],
                    "y_axis": [1.0, 0.0, 0.0],
                }
                for name, (a, b, point) in HINGES.items()
            },
            "phase": [{"name": "linked", "joints": dict.fromkeys(HINGES, "revolute")}],
            "output": {"loads": ["near", "low"]},
        },
        3,
    ),
    "both bolted to the ground and to each other": (
        {
            "initial.omega_rad_s": [0.0, 0.0, 0.0],
            "initial.speed_m_s": 0.0,
            "joint.first": {"bodies": ["ground", "fore"], "point_m": [0.5, 0.0, 0.0]},
            "joint.second": {"bodies": ["ground", "aft"], "point_m": [3.5, 0.0, 0.0]},
            "phase": [
                {
                    "name": "bolted",
                    "joints": {"first": "fixed", "second": "fixed", "pins": "fixed"},
                    "until": {"time_s": 0.2},
                },
                {
                    "name": "cut",
                    "joints": {"first": "fixed", "pins": "fixed"},
                    "until": {"time_s": 0.3},
                },
                {"name": "free"},
            ],
            "output": {"loads": ["first", "second", "pins"]},
        },
        6,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    """Motion, release and joint loads; the audit has the number of redundant rows."""
    settings, redundant = SCENES[name]
    campaign = pair(TURNING | settings)
    at_rest = ("alpha_deg", "beta_deg") if campaign.scene.initial.speed == 0.0 else ()
    outcomes = agrees(campaign, ("force_time_s", "moment_time_s", *at_rest))
    assert outcomes["redundant_rows"] == redundant


def test_rows_that_follow_only_at_the_start(pair):
    """Two collinear rods, from one point to two points of the other body, constrain the same
    direction: to first order they allow rotation, but no motion satisfies them, and no outcome is
    reported."""
    rod = {"bodies": BOTH, "point_m": [1.5, 0.0, 0.0], "second_point_m": [2.5, 0.0, 0.0]}
    settings = {
        "joint": {"one": rod, "other": rod | {"second_point_m": [2.0, 0.0, 0.0]}},
        "phase": [{"name": "held"}],
    }
    settings["phase"][0]["joints"] = {"one": "rod", "other": "rod"}
    campaign = pair(TURNING | settings | {"load": [], "initial.omega_rad_s": [0.0, 0.0, 0.0]})
    assert len(dependent_rows(campaign.scene, [("one", 12), ("other", 12)], [])) == 1
    assert alone(campaign)[0] == "ok"  # nothing moves
    push = {"load": [PUSH | {"force_N": [0.0, 5.0, 0.0]}]}
    status, outcomes = alone(campaign.with_settings(push))
    assert status == "singular-joint"
    assert np.isnan(outcomes["fore_omega_z_deg_s"])


def test_dependent_rows_are_those_that_come_later(pair):
    """Of two joints with equal rows the first counts; a rigid group has no rotation rows."""
    scene = pair({"joint.again": {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]}}).scene
    rows = [(joint, code) for joint in ("pins", "again") for code in (0, 1, 2)]
    # two points fix all but a turn about the line through them
    assert dependent_rows(scene, rows, []) == [4]
    assert dependent_rows(scene, rows, [("fore", "aft")]) == [3, 4, 5]
    assert dependent_rows(scene, [], []) == []
