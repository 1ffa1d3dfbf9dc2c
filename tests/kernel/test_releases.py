"""Releases independent of phases, against the independent simulation."""

import math

import pytest
from numpy.testing import assert_allclose
from oracles import independent
from turning_pair import BOTH, MID, TURNING, agrees, alone

PULL = {
    "name": "pull",
    "body": "aft",
    "thrust_N": 9.0,
    "build_up_s": 0.2,
    "station_m": 3.0,
    "cant_deg": 180.0,
}
PULLED = {"motor": [PULL]}
ONE = {
    "phase": [{"name": "held", "joints": {"pins": "fixed"}}],
    "output": {"loads": ["pins"], "tip_off": ["pins"]},
}
TWO = {
    **MID,
    "joint.pins.bodies": ["fore", "mid"],
    "joint.other": {"bodies": ["mid", "aft"], "point_m": [2.4, 0.3, 0.1]},
    "phase": [
        {"name": "held", "joints": {"pins": "fixed", "other": "fixed"}, "until": {"time_s": 0.25}},
        {"name": "guided", "joints": {"other": "slider"}},
    ],
    "output": {"loads": ["other"], "tip_off": ["other", "pins"]},
}


PUSHER = {
    "name": "pusher",
    "bodies": BOTH,
    "point_m": [2.0, 0.2, 0.0],
    "second_point_m": [2.5, 0.2, 0.0],
    "force_N": 20.0,
    "stroke_m": 0.02,
}


def until(condition, kind="fixed"):
    """Fixed until a condition, then free."""
    return {
        "phase": [{"name": "held", "joints": {"pins": kind}, "until": condition}, {"name": "free"}],
        "output": {"loads": ["pins"]},
    }


def cut(joint, when, name="cut", **more):
    return {"name": name, "joint": joint, "when": when} | more


SCENES = {
    "at a time": (ONE, [cut("pins", {"time_s": 0.13})], 0.13),
    "at the start": (ONE, [cut("pins", {"time_s": 0.0})], 0.0),
    "late": (ONE | {"joint.pins.delay_s": 0.05}, [cut("pins", {"time_s": 0.13})], 0.18),
    "not within the flight, as it may": (
        ONE,
        [cut("pins", {"time_s": 0.9}, optional=True)],
        math.nan,
    ),
    "of another joint than a phase's": (TWO, [cut("other", {"time_s": 0.3})], 0.3),
    "before the phase that would let go": (TWO, [cut("pins", {"time_s": 0.1})], None),
    "by the stroke of another joint": (
        TWO,
        [cut("other", {"joint": "pins", "stroke_mm": 5.0}, optional=True)],
        None,
    ),
    "by several conditions, and a second one": (
        TWO,
        [
            cut(
                "other",
                {
                    "any": [
                        {"all": [{"time_s": 0.2}, {"joint": "pins", "distance_mm": 3.0}]},
                        {"time_s": 0.39},
                    ]
                },
            ),
            cut("pins", {"time_s": 0.22}, "second"),
        ],
        None,
    ),
    "of a joint that its phase lets go late, before that": (
        TWO | {"joint.pins.delay_s": 0.08},
        [cut("pins", {"time_s": 0.2})],
        0.28,
    ),
    "of a joint that its phase lets go late, after that": (
        TWO | {"joint.pins.delay_s": 0.05},
        [cut("pins", {"time_s": 0.27})],
        0.3,
    ),
    "of one of two joints that let go late": (
        TWO
        | {
            "joint.pins.delay_s": 0.08,
            "joint.other.delay_s": 0.04,
            "phase": [
                {
                    "name": "held",
                    "joints": {"pins": "fixed", "other": "fixed"},
                    "until": {"joint": "other", "force_N": 2.0},
                },
                {"name": "free"},
            ],
            "motor": [PULL],
        },
        [cut("pins", {"time_s": 0.01})],
        None,
    ),
    "by a load": (ONE | PULLED, [cut("pins", {"joint": "pins", "force_N": 9.0})], None),
    "by a load, late": (
        ONE | PULLED | {"joint.pins.delay_s": 0.03},
        [cut("pins", {"joint": "pins", "force_N": 9.0})],
        None,
    ),
    "by a load, or before it": (
        ONE | PULLED,
        [cut("pins", {"joint": "pins", "force_N": 9.0, "time_s": 0.05})],
        0.05,
    ),
    "of a joint that breaks before another ends the phase": (
        TWO
        | PULLED
        | {
            "phase": [
                {
                    "name": "held",
                    "joints": {"pins": "fixed", "other": "fixed"},
                    "until": {"joint": "other", "force_N": 6.0},
                },
                {"name": "rest", "joints": {"pins": "slider"}},
            ]
        },
        [cut("pins", {"joint": "pins", "moment_N_m": 4.0}, optional=True)],
        None,
    ),
    "none, but a phase ends by a load after a pusher is spent": (
        PULLED | {"spring": [PUSHER]} | until({"joint": "pins", "force_N": 1.05}, "slider"),
        [],
        None,
    ),
    "none, but a phase ends by a load or a stroke": (
        PULLED
        | until(
            {"any": [{"joint": "pins", "moment_N_m": 90.0}, {"joint": "pins", "stroke_mm": 60.0}]},
            "slider",
        ),
        [],
        None,
    ),
    "none, but a phase ends by a load and a time": (
        PULLED | until({"all": [{"joint": "pins", "force_N": 8.0}, {"time_s": 0.2}]}),
        [],
        None,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    settings, releases, expected = SCENES[name]
    campaign = pair(TURNING | settings | {"release": releases})
    outcomes = agrees(campaign)
    if expected is not None:
        prefix = "" if len(campaign.scene.joint) == 1 else f"{releases[0]['joint']}_"
        assert_allclose(outcomes[f"{prefix}release_time_s"], expected, rtol=1e-12)


def test_a_joint_that_was_told_and_holds_at_the_end(pair):
    """Its delay ends after the run."""
    campaign = pair(
        TURNING | ONE | {"joint.pins.delay_s": 0.5, "release": [cut("pins", {"time_s": 0.2})]}
    )
    assert (
        alone(campaign)[0]
        == independent.simulate(campaign.nominal().to_dict()).status
        == "never-released"
    )


LATE_TIME, NEVER = {"time_s": 0.9}, {"joint": "pins", "force_N": 1e4}
HINGED = {
    "phase": [{"name": "held", "joints": {"pins": "revolute"}}],
    "joint.pins.y_axis": [0, 0, 1],
}
# what may not come, and how the case ends: of a joint that holds on, or does not
UNMET = {
    "a time beyond the end": (ONE, [cut("pins", LATE_TIME)], "never-released"),
    "a time beyond the end, optional": (ONE, [cut("pins", LATE_TIME, optional=True)], "ok"),
    "an angle of a hinge": (
        HINGED,
        [cut("pins", {"joint": "pins", "angle_deg": 60.0})],
        "never-released",
    ),
    "a break load": (ONE | PULLED, [cut("pins", NEVER)], "never-released"),
    "a break load, optional": (ONE | PULLED, [cut("pins", NEVER, optional=True)], "ok"),
    "a release of a part": (ONE, [cut("pins", LATE_TIME, to="slider")], "never-released"),
    "a release of a part, optional": (
        ONE,
        [cut("pins", LATE_TIME, to="slider", optional=True)],
        "ok",
    ),
    "the second of two": (
        ONE,
        [cut("pins", {"time_s": 0.1}, to="slider"), cut("pins", LATE_TIME, "go")],
        "never-released",
    ),
    "the second of two, optional": (
        ONE,
        [cut("pins", {"time_s": 0.1}, to="slider"), cut("pins", LATE_TIME, "go", optional=True)],
        "ok",
    ),
    "one of two that would do the same": (
        ONE | PULLED,
        [cut("pins", NEVER), cut("pins", {"time_s": 0.1}, "clock")],
        "ok",
    ),
    "a part, of a joint that is let go altogether": (
        ONE,
        [cut("pins", LATE_TIME, to="slider"), cut("pins", {"time_s": 0.1}, "go")],
        "ok",
    ),
    "a release of a joint that a later phase frees": (TWO, [cut("pins", LATE_TIME)], "ok"),
    "the load of another joint": (
        TWO,
        [cut("other", {"joint": "pins", "force_N": 1e4})],
        "never-released",
    ),
    "an event inside all": (
        ONE,
        [cut("pins", {"all": [{"time_s": 0.1}, {"any": [LATE_TIME, NEVER]}]})],
        "never-released",
    ),
    "an event inside any": (ONE, [cut("pins", {"any": [{"time_s": 0.1}, NEVER]})], "ok"),
    "the end of a spring's stroke": (
        ONE | {"spring": [PUSHER]},
        [cut("pins", {"spring": "pusher"})],
        "never-released",
    ),
    "nothing, but its delay ends later": (
        ONE | {"joint.pins.delay_s": 0.5},
        [cut("pins", {"time_s": 0.2}, optional=True)],
        "never-released",
    ),
    "nothing, but the joint fails": (
        ONE | {"joint.pins.fails": 1},
        [cut("pins", {"time_s": 0.2}, optional=True)],
        "never-released",
    ),
    "nothing that must, and the joint would fail": (
        ONE | {"joint.pins.fails": 1},
        [cut("pins", LATE_TIME, optional=True)],
        "ok",
    ),
    "a load that would end a phase": (PULLED | until(NEVER), [], "never-released"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", UNMET)
def test_a_release_that_does_not_come(pair, name):
    """A joint that is still constrained although it should have been released; alone and as the
    independent simulation."""
    settings, releases, expected = UNMET[name]
    campaign = pair(TURNING | settings | {"release": releases})
    other = independent.simulate(campaign.nominal().to_dict())
    assert (alone(campaign)[0], other.status) == (expected, expected)
