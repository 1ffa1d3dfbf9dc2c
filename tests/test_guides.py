"""Pins and their friction in written kernels: against the independent flight, and the balance of friction against closed forms."""

import math

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose

from sepmc.door import interpreted
from sepmc.kernels import guides
from sepmc.kernels.lanes import LANES
from sepmc.trust import independent
from sepmc.trust.written import Written

PUSH = {"name": "push", "body": "aft", "force_N": [-6.0, 1.0, -0.5], "moment_N_m": [0.2, 0.3, -0.4], "point_m": [3.2, 0.1, 0.0]}
LOPSIDED = {"body.fore.cg_m": [1.0, 0.05, -0.02], "body.aft.cg_m": [3.0, -0.04, 0.03], "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15]}
PINS = {"pins": 3, "circle_m": 0.3, "clock_deg": 25.0, "engaged_m": 0.2, "friction": 0.05, "slip_speed_m_s": 0.1}
TURNING = LOPSIDED | {"initial.omega_rad_s": [0.3, 0.2, -0.4], "load": [PUSH], "run.end_time_s": 0.4, "solver.step_s": 0.01}
RELEASE = {"joint": "pins", "stroke_mm": 50.0}


def phases(*steps):
    """Phases of (joints, until); the last has no until."""
    return [{"name": f"p{i}", "joints": joints} | ({"until": until} if until else {}) for i, (joints, until) in enumerate(steps)]


def strut(**keys):
    """A second guide beside the first."""
    return {"bodies": ["fore", "aft"], "point_m": [2.0, 0.6, 0.0], **keys}


SCENES = {
    "locked, guided, free": {
        "phase": phases(({"pins": "fixed"}, {"time_s": 0.1}), ({"pins": "slider"}, RELEASE), ({}, None)),
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
    "held to the ground": {
        "joint.pins.bodies": ["ground", "aft"],
        "initial.omega_rad_s": [0.0, 0.0, 0.0],
        "initial.speed_m_s": 0.0,
        "joint.hinge": {"bodies": ["aft", "fore"], "point_m": [1.5, 0.0, 0.0]},
        "phase": phases(({"pins": "slider", "hinge": "spherical"}, RELEASE), ({"hinge": "spherical"}, None)),
        "output": {"guide": ["pins"]},
    },
    "two guides that load each other": {
        "body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.0]},
        "joint.pins.bodies": ["fore", "mid"],
        "joint.other": {"bodies": ["mid", "aft"], "point_m": [2.4, 0.3, 0.1], "guide": PINS | {"pins": 1, "friction": 0.08}},
        "phase": phases(
            ({"pins": "slider", "other": "slider"}, {"joint": "other", "stroke_mm": 30.0}),
            ({"pins": "slider"}, {"time_s": 0.35}),
            ({}, None),
        ),
        "output": {"guide": ["other", "pins"], "loads": ["other"]},
    },
    "two guides that let go late, one after the other": {
        "joint.pins.delay_s": 0.03,
        "body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.0]},
        "joint.pins.bodies": ["fore", "mid"],
        "joint.other": {
            "bodies": ["mid", "aft"],
            "point_m": [2.4, 0.3, 0.1],
            "delay_s": 0.06,
            "guide": PINS | {"pins": 2, "friction": 0.02},
        },
        "phase": phases(({"pins": "slider", "other": "fixed"}, {"time_s": 0.1}), ({"other": "slider"}, None)),
        "output": {"guide": ["other", "pins"]},
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    """All outcomes, pin loads, time in the guide and the friction that would jam among them."""
    campaign = pair(TURNING | {"joint.pins.guide": PINS} | SCENES[name])
    with interpreted():
        written = Written(campaign)
    other = independent.fly(campaign.nominal().to_dict())
    assert written.status == other.status == "ok"
    compared = 0
    for column in campaign.outcome_columns:
        if column.name in other.outcomes and not column.name.endswith("_time_s"):
            expected = other.outcomes[column.name]
            assert_allclose(written.outcomes[column.name], expected, rtol=2e-8, atol=1e-8, err_msg=column.name)
            compared += not math.isnan(expected)
    assert compared > 20
    assert all(written.outcomes[f"{joint}_time_in_guide_s"] > 0.01 for joint in campaign.scene.output.guide)


def test_a_guide_that_jams_is_left_to_others(pair):
    """4 N along, 10 N across: 0.4 jams. A kernel does not vouch for it, one with less friction it does."""
    push = {"name": "push", "body": "aft", "force_N": [4.0, 10.0, 0.0]}
    found = {}
    for friction in (0.1, 0.6):
        pins = {"pins": 1, "engaged_m": 2.0, "friction": friction, "slip_speed_m_s": 1e-3}
        settings = {"load": [push], "joint.pins.guide": pins, "phase": phases(({"pins": "slider"}, None)), "run.end_time_s": 0.1}
        with interpreted():
            found[friction] = Written(pair(settings | {"solver.step_s": 1e-3, "output.guide": ["pins"]})).status
    assert found[0.1] == "ok"


@njit
def settled(w, ends, out):
    return guides.balance(w, 0, ends, out)


def balance(guide_ends, shares, forces):
    """Friction of guides by `guides.balance`; ``forces`` of each end are rows: y, z alone and by each guide's newton."""
    numbers = []
    for share, ends in zip(shares, forces, strict=True):
        numbers += [share, *np.ravel(ends)]
    w = np.zeros((len(numbers) + len(shares)) * LANES)
    w[: len(numbers) * LANES : LANES] = numbers
    found = settled(w, guide_ends, len(numbers) * LANES)
    return found, w[len(numbers) * LANES :: LANES]


def test_balance_of_one_end():
    """Load a + F b, all in line: F = -s (a + F b), so F = -s a / (1 + s b)."""
    found, friction = balance((1,), [-0.2], [[[10.0, 0.0, 3.0, 0.0]]])
    assert found
    assert_allclose(friction, -2.0 / 1.6, rtol=1e-14)


def test_balance_of_one_end_across():
    """Load (a, F b): F = -s sqrt(a^2 + b^2 F^2), so F = -s a / sqrt(1 - s^2 b^2)."""
    found, friction = balance((1,), [-0.2], [[[10.0, 0.0, 0.0, 3.0]]])
    assert found
    assert_allclose(friction, -2.0 / math.sqrt(1.0 - 0.36), rtol=1e-13)


def test_balance_of_two_guides():
    """Each load is its own plus half of the other's friction, in line and of one sign: two linear equations."""
    forces = [[[10.0, 0.0, 0.0, 0.0, 0.5, 0.0]], [[8.0, 0.0, 0.5, 0.0, 0.0, 0.0]]]
    found, friction = balance((1, 1), [-0.2, -0.3], forces)
    assert found
    assert_allclose(friction, np.linalg.solve([[1.0, 0.1], [0.15, 1.0]], [-2.0, -2.4]), rtol=1e-12)


@pytest.mark.parametrize("growth", [5.0, 5.5, 100.0])
def test_friction_that_feeds_itself_jams(growth):
    """Every newton of friction presses the pins by ``growth`` more, of which a fifth rubs: none is in balance from five on."""
    assert not balance((1,), [-0.2], [[[10.0, 0.0, -growth, 0.0]]])[0]
    assert balance((1,), [-0.2], [[[10.0, 0.0, -4.0, 0.0]]])[0]


def test_nothing_pressed_nothing_rubs():
    assert balance((2,), [-0.2], [[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]]]) == (True, np.zeros(1))
