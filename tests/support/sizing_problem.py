"""Sizing problem of known risk: two bodies that a constant force of normal factor separates."""

from statistics import NormalDist

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.sizing import Variable
from sepmc.scene.read import parse_campaign
from support.pusher import MASSES, pusher_tree

STROKE, SIGMA = 0.1, 0.1
END_S = 0.073  # the stroke ends later in some cases
SPEED = {
    "name": "fast",
    "metric": "separation_speed_m_s",
    "at_least": 2.0,
    "probability": 0.95,
    "confidence": 0.9,
}
FORCE = Variable("push", "spring.pusher.force_N", 1000.0, 6000.0)


def campaign(*requirements):
    """Two bodies in vacuum, parted by a constant force of normal factor: the speed is known."""
    tree = pusher_tree(
        {"force_N": 3000.0, "stroke_m": STROKE},
        run={"end_time_s": 1.0, "cases": 100, "seed": 1},
        dispersion={"spring.pusher.factor": {"normal": SIGMA, "truncate_sigma": 8}},
        requirement=list(requirements or [SPEED]),
    )
    return Campaign(parse_campaign(tree, "pusher.toml"))


def risk(force, spread=1.0, masses=MASSES):
    """Probability that the speed is below the bound, v^2 = 2 F s factor (1/m1 + 1/m2), with the
    spread of the factor multiplied."""
    inverse = sum(1.0 / mass for mass in masses)
    factor = SPEED["at_least"] ** 2 / (2.0 * force * STROKE * inverse)
    return NormalDist(1.0, spread * SIGMA).cdf(factor)
