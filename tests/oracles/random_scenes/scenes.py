"""Random scenes: the tree of a campaign file that follows from a seed.

What is drawn, and how often (the weights stand where they are used):

=================  =================================================================================
bodies             2 to 5; products of inertia, round, spherical and flat ones
joints             a tree, in 3 of 10 scenes with more than two bodies a loop, in 1 of 5 the ground;
                   all kinds and own ones
phases             1 to 5, ended by time, stroke, distance, angle, height or burn-out; delays,
                   failures
loads              0 to 3 motors, springs and constant loads with any of their options; polynomial
                   aerodynamics, wind
dispersions        0 to 16, over any number of the scene, by any law, in any unit
names              in 35 of 100 scenes such as a program that writes programs may trip over
special structure  in 1 of 4 scenes, see `SPECIAL`
later kinds        in 3 of 10 scenes, each of `LATE` as often as it says; or named ones in all
=================  =================================================================================
"""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from oracles.random_scenes.bodies import add_air, add_bodies, add_environment, add_start
from oracles.random_scenes.directions import add_directions
from oracles.random_scenes.dispersions import add_dispersions
from oracles.random_scenes.draft import GROUND, Draft, Tree
from oracles.random_scenes.guides import add_guides, add_outputs
from oracles.random_scenes.joints import add_joints
from oracles.random_scenes.loads import add_late_profiles, add_loads
from oracles.random_scenes.names import Names
from oracles.random_scenes.outlines import add_clearances
from oracles.random_scenes.phases import add_allowances, add_instants, add_phases, add_triggers
from oracles.random_scenes.rng import Dice
from oracles.random_scenes.tables import add_aero_tables, add_increments, add_profiles
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

SPECIAL = {
    "": 0.75,
    "symmetric": 0.07,  # all on one axis
    "concentric": 0.04,  # all mass centres and joint points at one station
    "still": 0.03,  # nothing acts and nothing moves
    "shut": 0.05,  # joints between bodies never open
    "idle": 0.06,  # phases that change nothing
}
# How often a scene that has later kinds has each of them, where it has what they belong to.
LATE = {
    "release": 0.2,  # of a joint, whatever the phase
    "any and all": 0.2,  # conditions of several parts
    "break load": 0.15,  # conditions on force or moment of a joint
    "joint loads": 0.25,  # output.loads
    "guide": 0.2,  # pins, friction, output.guide
    "wind profile": 0.15,
    "table of the air": 0.15,
    "aerodynamic table": 0.2,  # over some of Mach, alpha and beta
    "proximity": 0.2,  # increments over a distance
    "clearance": 0.15,  # outlines, and distances between them
    "event": 0.25,  # instants that are told of, ends of springs among them
    "ignition": 0.25,  # motors that light at an event or release, or as a joint becomes free
    "direction": 0.25,  # in which conditions must be crossed, and vertical speeds
    "optional": 0.15,  # releases that may be left out, and such as do not come
    "late profile": 0.15,  # thrust that begins some time after the ignition
}
_LATE_SHARE = 0.3
_TRANSVERSE = 0.15  # of the scenes tell transverse rates
_ORDER = (
    *(
        "environment",
        "body",
        "motor",
        "spring",
        "load",
        "proximity",
        "joint",
        "phase",
        "release",
        "event",
        "clearance",
        "output",
    ),
    *("initial", "run", "solver", "dispersion"),
)


def scene(seed: int, late: Iterable[str] | None = None, kinds: Iterable[str] = ()) -> Tree:
    """The tree of the campaign of a seed; the same for ever, as long as this generator is.

    ``late`` names the kinds of `LATE` it may have, where the seed is not to draw them; ``kinds``
    those that it has besides, wherever it has what they belong to.
    """
    dice = Dice(seed)
    chosen = _late(Dice(seed, 1)) if late is None else frozenset(late)
    chosen |= frozenset(kinds)
    draft = Draft(dice, Names(dice), dice.weighted(SPECIAL), dice.between(0.1, 0.6), chosen)
    draft.tree = {"body": {}, "run": {"end_time_s": draft.span}}
    add_environment(draft)
    add_bodies(draft)
    add_start(draft)
    add_profiles(draft)
    add_air(draft)
    add_aero_tables(draft)
    add_joints(draft)
    _hold(draft)
    add_phases(draft)
    add_loads(draft)
    add_increments(draft)
    add_clearances(draft)
    add_guides(draft)
    _run(draft)
    add_outputs(draft)
    draft.dice = draft.names.dice = Dice(seed, 2)  # a scene is else as it is without them
    add_instants(draft)
    across = Dice(seed, 3)
    if across.chance(_TRANSVERSE):
        bodies = across.some(list(draft.tree["body"]), 1)
        draft.tree["output"] = draft.tree.get("output", {}) | {"transverse": bodies}
    draft.dice = draft.names.dice = Dice(seed, 4)
    add_triggers(draft)
    draft.dice = draft.names.dice = Dice(seed, 5)
    add_directions(draft)
    draft.dice = draft.names.dice = Dice(seed, 6)
    add_allowances(draft)
    draft.dice = Dice(seed, 7)
    add_late_profiles(draft)
    tree = {key: draft.tree[key] for key in _ORDER if key in draft.tree}
    with suppress(SceneError):  # what is refused is refused with a message: the gate counts it
        add_dispersions(tree, parse_campaign(tree, f"seed {seed}").scene, dice)
    return tree


def _late(dice: Dice) -> frozenset[str]:
    """Later kinds that a scene may have; a stream of their own leaves the rest of a seed as it is
    without them."""
    return (
        frozenset(kind for kind, share in LATE.items() if dice.chance(share))
        if dice.chance(_LATE_SHARE)
        else frozenset()
    )


def _hold(draft: Draft) -> None:
    """What the ground holds starts at rest, or turning about the joint that holds it; now and then
    against it."""
    dice, initial = draft.dice, draft.tree["initial"]
    holding = [joint for joint in draft.tree["joint"].values() if GROUND in joint["bodies"]]
    if not holding:
        return
    initial["speed_m_s"] = 0.0
    kind = holding[0]["_kind"]
    omega = initial.pop("omega_deg_s", None)
    if omega is None or dice.chance(0.3):
        return
    axis = holding[0].get("x_axis", [1.0, 0.0, 0.0])
    if kind == "spherical" or dice.chance(0.12):
        initial["omega_deg_s"] = omega
    elif kind in ("revolute", "cylindrical", "planar"):
        initial["omega_deg_s"] = [omega[0] * x for x in axis]


def _run(draft: Draft) -> None:
    """How it is flown."""
    dice, tree = draft.dice, draft.tree
    solver: dict[str, Any] = {"accuracy": dice.weighted({1e-7: 0.7, 1e-5: 0.15, 1e-9: 0.15})}
    method = dice.weighted({"dop853": 0.75, "dopri5": 0.15, "rk4": 0.1})
    if method != "dop853":
        solver |= {"method": method, "accuracy": 1e-7 if method == "dopri5" else 1e-5}
    drift = dice.weighted({"projection": 0.86, "none": 0.1, "baumgarte": 0.04})
    if drift != "projection":
        solver["drift"] = drift
    if dice.chance(0.04):
        solver["formulation"] = "full"
    tree["solver"] = solver
    tree["run"] |= {"cases": 4, "seed": int(dice.random.integers(1000))}
    if dice.chance(0.1):
        tree["run"]["history_step_s"] = draft.span / dice.pick([7, 10, 16])
