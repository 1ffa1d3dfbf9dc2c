"""Springs that only push: no force where the sum of their forces is below zero."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from support.pusher import MASSES, pusher_tree

from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign

PHASES = [
    {"name": "held", "joints": {"ring": "fixed"}, "until": {"time_s": 0.01}},
    {"name": "free"},
]
RUN = {"end_time_s": 0.4, "cases": 20, "seed": 1}
INVERSE_MASS = sum(1.0 / mass for mass in MASSES)


def campaign(spring, **more):
    """Campaign of two bodies, first held, that a spring that only pushes separates."""
    tree = pusher_tree({"push_only": True} | spring, phase=PHASES, run=RUN)
    return Campaign(parse_campaign(tree | more, "pusher.toml"))


def outcomes(one, step=0.2):
    return one.simulate(one.nominal(), step_s=step).attrs["outcomes"]


def test_a_linear_spring_gives_its_energy_and_no_more():
    """Force F0 - k x ends at F0 / k: speed by the energy F0^2 / 2k, at long steps."""
    force, stiffness = 2000.0, 40000.0
    spring = {"force_N": force, "stiffness_N_per_m": stiffness}
    one = campaign(spring)
    result = one.simulate(one.nominal(), step_s=0.2).attrs
    speed = math.sqrt(force**2 / stiffness * INVERSE_MASS)
    assert_allclose(result["outcomes"]["separation_speed_m_s"], speed, rtol=1e-10)
    assert max(result["errors"].values()) < 1e-9
    pulling = outcomes(campaign(spring | {"push_only": False}))
    assert pulling["separation_speed_m_s"] < 0.9 * speed
