"""Guide pins and their friction against the independent simulation, and the balance of friction
against closed forms."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import independent
from support.compiled import compiled
from turning_pair import MID, PUSH, TURNING, agrees, alone

from sepmc.routines import friction
from sepmc.routines.lanes import LANES

PINS = {
    "pins": 3,
    "circle_m": 0.3,
    "clock_deg": 25.0,
    "engaged_m": 0.2,
    "friction": 0.05,
    "slip_speed_m_s": 0.1,
}
RELEASE = {"joint": "pins", "stroke_mm": 50.0}


def phases(*steps):
    """Phases of (joints, until); the last has no until."""
    return [
        {"name": f"p{i}", "joints": joints} | ({"until": until} if until else {})
        for i, (joints, until) in enumerate(steps)
    ]


SCENES = {
    "locked, guided, free": {
        "phase": phases(
            ({"pins": "fixed"}, {"time_s": 0.1}), ({"pins": "slider"}, RELEASE), ({}, None)
        ),
        "output": {"guide": ["pins"], "loads": ["pins"]},
    },
    "pins that only hold two rotations": {
        "joint.pins.kind.rail": {"translations": ["y", "z"], "rotations": ["y", "z"]},
        "phase": phases(({"pins": "rail"}, RELEASE), ({}, None)),
        "output": {"guide": ["pins"]},
    },
    "no friction, but pins are watched": {
        "joint.pins.guide.friction": 0.0,
        "phase": phases(({"pins": "slider"}, RELEASE), ({}, None)),
        "output": {"guide": ["pins"]},
    },
    "beside another pair, which turns about its guide": {
        **MID,
        "body.far": {"mass_kg": 3.0, "inertia_kg_m2": [1.1, 1.4, 1.3], "cg_m": [3.5, 0.0, 0.1]},
        "joint.other": {"bodies": ["mid", "far"], "point_m": [2.9, 0.0, 0.1], "guide": PINS},
        "phase": phases(({"pins": "slider", "other": "cylindrical"}, RELEASE), ({}, None)),
        "output": {"guide": ["pins", "other"]},
    },
    "held to the ground": {
        "joint.pins.bodies": ["ground", "aft"],
        "initial.omega_rad_s": [0.0, 0.0, 0.0],
        "initial.speed_m_s": 0.0,
        "joint.hinge": {"bodies": ["aft", "fore"], "point_m": [1.5, 0.0, 0.0]},
        "phase": phases(
            ({"pins": "slider", "hinge": "spherical"}, RELEASE), ({"hinge": "spherical"}, None)
        ),
        "output": {"guide": ["pins"]},
    },
    "the second body held to the ground": {
        "joint.stand": {"bodies": ["ground", "aft"], "point_m": [3.0, 0.1, 0.0]},
        "load": [PUSH | {"body": "fore", "force_N": [6.0, 1.0, -0.5], "point_m": [1.2, 0.1, 0.0]}],
        "initial.omega_rad_s": [0.0, 0.0, 0.0],
        "initial.speed_m_s": 0.0,
        "phase": phases(
            ({"pins": "slider", "stand": "fixed"}, RELEASE), ({"stand": "fixed"}, None)
        ),
        "output": {"guide": ["pins"], "loads": ["pins", "stand"]},
    },
    "two guides that load each other": {
        **MID,
        "joint.pins.bodies": ["fore", "mid"],
        "joint.other": {
            "bodies": ["mid", "aft"],
            "point_m": [2.4, 0.3, 0.1],
            "guide": PINS | {"pins": 1, "friction": 0.08},
        },
        "phase": phases(
            ({"pins": "slider", "other": "slider"}, {"joint": "other", "stroke_mm": 30.0}),
            ({"pins": "slider"}, {"time_s": 0.35}),
            ({}, None),
        ),
        "output": {"guide": ["other", "pins"], "loads": ["other"]},
    },
    "two guides that let go late, one after the other": {
        "joint.pins.delay_s": 0.03,
        **MID,
        "joint.pins.bodies": ["fore", "mid"],
        "joint.other": {
            "bodies": ["mid", "aft"],
            "point_m": [2.4, 0.3, 0.1],
            "delay_s": 0.06,
            "guide": PINS | {"pins": 2, "friction": 0.02},
        },
        "phase": phases(
            ({"pins": "slider", "other": "fixed"}, {"time_s": 0.1}), ({"other": "slider"}, None)
        ),
        "output": {"guide": ["other", "pins"]},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    """All outcomes, with pin loads, sliding time and the jamming friction coefficient."""
    campaign = pair(TURNING | {"joint.pins.guide": PINS} | SCENES[name])
    outcomes = agrees(campaign)
    assert all(outcomes[f"{joint}_time_in_guide_s"] > 0.01 for joint in campaign.scene.output.guide)


@pytest.mark.parametrize(("friction", "status"), [(0.05, "ok"), (0.5, "jammed")])
def test_a_guide_that_jams(pair, friction, status):
    """It slides, then a couple bends its short pins: much friction feeds itself, a little does
    not."""
    settings = {
        "body.aft.cg_m": [3.0, 0.5, 0.0],
        "joint.pins.guide": {
            "pins": 1,
            "engaged_m": 0.2,
            "friction": friction,
            "slip_speed_m_s": 0.05,
        },
        "load": [
            {
                "name": "push",
                "body": "aft",
                "force_N": [-8.0, 0.0, 0.0],
                "point_m": [3.0, 0.0, 0.0],
            },
            {"name": "bend", "body": "aft", "moment_N_m": [0.0, 0.0, 20.0], "start_s": 0.1},
        ],
        "phase": phases(({"pins": "slider"}, None)),
        "run.end_time_s": 0.12,
        "solver.step_s": 1e-3,
    }
    campaign = pair(settings)
    assert independent.simulate(campaign.nominal().to_dict()).status == status
    assert alone(campaign)[0] == status


def balance(guide_ends, shares, forces):
    """Friction of guides by `friction.balance`; rows of ``forces`` of each end: y, z without
    friction and per newton of each guide's friction."""
    numbers = []
    for share, ends in zip(shares, forces, strict=True):
        numbers += [share, *np.ravel(ends)]
    w = np.zeros((len(numbers) + len(shares)) * LANES)
    w[: len(numbers) * LANES : LANES] = numbers
    result = compiled(friction.balance)(w, 0, guide_ends, len(numbers) * LANES)
    return result, w[len(numbers) * LANES :: LANES]


def test_balance_of_one_end():
    """Load a + F b, all in line: F = -s (a + F b), so F = -s a / (1 + s b)."""
    result, friction = balance((1,), [-0.2], [[[10.0, 0.0, 3.0, 0.0]]])
    assert result
    assert_allclose(friction, -2.0 / 1.6, rtol=1e-14)


def test_balance_of_one_end_across():
    """Load (a, F b): F = -s sqrt(a^2 + b^2 F^2), so F = -s a / sqrt(1 - s^2 b^2)."""
    result, friction = balance((1,), [-0.2], [[[10.0, 0.0, 0.0, 3.0]]])
    assert result
    assert_allclose(friction, -2.0 / math.sqrt(1.0 - 0.36), rtol=1e-13)


def test_balance_of_two_guides():
    """Each load is its own plus half of the other's friction, in line and of one sign: two linear
    equations."""
    forces = [[[10.0, 0.0, 0.0, 0.0, 0.5, 0.0]], [[8.0, 0.0, 0.5, 0.0, 0.0, 0.0]]]
    result, friction = balance((1, 1), [-0.2, -0.3], forces)
    assert result
    assert_allclose(friction, np.linalg.solve([[1.0, 0.1], [0.15, 1.0]], [-2.0, -2.4]), rtol=1e-12)


@pytest.mark.parametrize("growth", [5.0, 5.5, 100.0])
def test_friction_that_feeds_itself_jams(growth):
    """Every newton of friction increases the pin load by ``growth``, of which a fifth is friction:
    from 5 on there is no balance."""
    assert not balance((1,), [-0.2], [[[10.0, 0.0, -growth, 0.0]]])[0]
    assert balance((1,), [-0.2], [[[10.0, 0.0, -4.0, 0.0]]])[0]


def test_nothing_pressed_nothing_rubs():
    assert balance((2,), [-0.2], [[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]]]) == (
        True,
        np.zeros(1),
    )
