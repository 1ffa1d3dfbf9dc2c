"""Releases apart from phases in written kernels, against the independent flight."""

import math

import pytest
from numpy.testing import assert_allclose

from sepmc.campaign import pilot
from sepmc.door import interpreted
from sepmc.trust import independent
from sepmc.trust.written import LEFT, Written, as_written

PUSH = {"name": "push", "body": "aft", "force_N": [-6.0, 1.0, -0.5], "moment_N_m": [0.2, 0.3, -0.4], "point_m": [3.2, 0.1, 0.0]}
LOPSIDED = {"body.fore.cg_m": [1.0, 0.05, -0.02], "body.aft.cg_m": [3.0, -0.04, 0.03], "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15]}
TURNING = LOPSIDED | {"initial.omega_rad_s": [0.3, 0.2, -0.4], "load": [PUSH], "run.end_time_s": 0.4, "solver.step_s": 0.01}
ONE = {"phase": [{"name": "held", "joints": {"pins": "fixed"}}], "output": {"loads": ["pins"], "tip_off": ["pins"]}}
TWO = {
    "body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.0]},
    "joint.pins.bodies": ["fore", "mid"],
    "joint.other": {"bodies": ["mid", "aft"], "point_m": [2.4, 0.3, 0.1]},
    "phase": [
        {"name": "held", "joints": {"pins": "fixed", "other": "fixed"}, "until": {"time_s": 0.25}},
        {"name": "guided", "joints": {"other": "slider"}},
    ],
    "output": {"loads": ["other"], "tip_off": ["other", "pins"]},
}


def cut(joint, when, name="cut"):
    return {"name": name, "joint": joint, "when": when}


SCENES = {
    "at a time": (ONE, [cut("pins", {"time_s": 0.13})], 0.13),
    "at the start": (ONE, [cut("pins", {"time_s": 0.0})], 0.0),
    "late": (ONE | {"joint.pins.delay_s": 0.05}, [cut("pins", {"time_s": 0.13})], 0.18),
    "not within the flight": (ONE, [cut("pins", {"time_s": 0.9})], math.nan),
    "of another joint than a phase's": (TWO, [cut("other", {"time_s": 0.3})], 0.3),
    "before the phase that would let go": (TWO, [cut("pins", {"time_s": 0.1})], None),
    "by the stroke of another joint": (TWO, [cut("other", {"joint": "pins", "stroke_mm": 5.0})], None),
    "by several conditions, and a second one": (
        TWO,
        [
            cut("other", {"any": [{"all": [{"time_s": 0.2}, {"joint": "pins", "distance_mm": 3.0}]}, {"time_s": 0.39}]}),
            cut("pins", {"time_s": 0.22}, "second"),
        ],
        None,
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    settings, releases, expected = SCENES[name]
    campaign = pair(TURNING | settings | {"release": releases})
    assert pilot.reasons(as_written(campaign)) == []
    with interpreted():
        written = Written(campaign)
    other = independent.fly(campaign.nominal().to_dict())
    assert written.status == other.status == "ok"
    for column in campaign.outcome_columns:
        if column.name in other.outcomes and not column.name.endswith(("force_time_s", "moment_time_s")):
            assert_allclose(written.outcomes[column.name], other.outcomes[column.name], rtol=2e-8, atol=1e-8, err_msg=column.name)
    if expected is not None:
        prefix = "" if len(campaign.scene.joint) == 1 else f"{releases[0]['joint']}_"
        assert_allclose(written.outcomes[f"{prefix}release_time_s"], expected, rtol=1e-12)


def test_a_joint_that_was_told_and_holds_at_the_end(pair):
    """Its delay ends after the flight: no kernel vouches for that, and the row says never-released."""
    campaign = pair(TURNING | ONE | {"joint.pins.delay_s": 0.5, "release": [cut("pins", {"time_s": 0.2})]})
    with interpreted():
        assert Written(campaign).status == LEFT


@pytest.mark.parametrize(
    ("settings", "when", "why"),
    [
        ({}, {"joint": "pins", "force_N": 3.0}, "release cut by a joint's load"),
        ({"joint.pins.delay_s": 0.01}, {"time_s": 0.3}, "release cut of a joint that phases let go late"),
    ],
)
def test_what_no_kernel_is_written_for(pair, settings, when, why):
    assert why in pilot.reasons(as_written(pair(TURNING | TWO | settings | {"release": [cut("pins", when)]})))
