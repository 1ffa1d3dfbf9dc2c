"""Random scenes: the tree of a campaign file as a function of a seed.

Contents and frequencies (the weights stand where they are used):

=================  =================================================================================
bodies             2 to 5; products of inertia, round, spherical and flat ones
joints             a tree, in 3 of 10 scenes with more than two bodies a loop, in 1 of 5 the ground;
                   all kinds and custom ones
phases             1 to 5, ended by time, stroke, distance, angle, height or burn-out; delays,
                   failures
loads              0 to 3 motors, springs and constant loads with any of their options; polynomial
                   aerodynamics, wind
dispersions        0 to 16, over any number of the scene, any distribution, in any unit
names              in 35 of 100 scenes names that a generator of programs could trip over
special structure  in 1 of 4 scenes, see `SPECIAL`
later kinds        in 3 of 10 scenes, with the probabilities of `LATE`; or given ones in all
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
from oracles.random_scenes.loads import (
    add_force_tables,
    add_late_profiles,
    add_loads,
    cut_pulls,
)
from oracles.random_scenes.names import Names
from oracles.random_scenes.outlines import add_clearances, add_sectors, name_parts
from oracles.random_scenes.phases import add_allowances, add_instants, add_phases, add_triggers
from oracles.random_scenes.rng import RandomStream
from oracles.random_scenes.signals import add_control_terms, add_signals
from oracles.random_scenes.tables import add_aero_tables, add_increments, add_profiles, vary_tables
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

SPECIAL = {
    "": 0.75,
    "symmetric": 0.07,  # all on one axis
    "concentric": 0.04,  # all mass centres and joint points at one station
    "still": 0.03,  # no loads and no motion
    "shut": 0.05,  # joints between bodies never open
    "idle": 0.06,  # phases that change nothing
}
# Probability of each later kind in a scene with later kinds, where it applies.
LATE = {
    "release": 0.2,  # release of a joint, independent of phases
    "any and all": 0.2,  # combined conditions
    "break load": 0.15,  # conditions on force or moment of a joint
    "joint loads": 0.25,  # output.loads
    "guide": 0.2,  # pins, friction, output.guide
    "wind profile": 0.15,
    "table of the air": 0.15,
    "aerodynamic table": 0.2,  # over some of Mach, alpha and beta
    "proximity": 0.2,  # increments over a distance
    "clearance": 0.15,  # outlines, and distances between them
    "event": 0.25,  # observed events, ends of springs among them
    "ignition": 0.25,  # motors that ignite at an event or release, or when a joint becomes free
    "direction": 0.25,  # crossing directions of conditions, and vertical speeds
    "optional": 0.15,  # optional releases, and releases that do not occur
    "late profile": 0.15,  # thrust that begins some time after ignition
    "signal": 0.2,  # loads, motors and springs by formulas
    # by name only, so that old scenes stay
    "sector": 0.0,  # sectors of frustums as outlines
    "table variant": 0.0,  # interpolations, corners, return factors, axes of relative motion
    "control derivative": 0.0,  # coefficients by signals
    "push only": 0.0,  # springs that never pull
}
_LATE_PROBABILITY = 0.3
_TRANSVERSE = 0.15  # probability of transverse rates as outputs
_ORDER = (
    *(
        "environment",
        "body",
        "motor",
        "spring",
        "load",
        "signal",
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
    """Tree of the campaign of a seed.

    Parameters
    ----------
    seed : int
    late : iterable of str, optional
        Kinds of `LATE` that the scene may have, instead of random ones.
    kinds : iterable of str
        Kinds of `LATE` in addition, wherever the scene has what they apply to.
    """
    rng = RandomStream(seed)
    chosen = _late(RandomStream(seed, 1)) if late is None else frozenset(late)
    chosen |= frozenset(kinds)
    draft = Draft(rng, Names(rng), rng.weighted_choice(SPECIAL), rng.uniform(0.1, 0.6), chosen)
    draft.tree = {"body": {}, "run": {"end_time_s": draft.span}}
    add_environment(draft)
    add_bodies(draft)
    add_start(draft)
    add_profiles(draft)
    add_air(draft)
    add_aero_tables(draft)
    add_joints(draft)
    _initial_state(draft)
    add_phases(draft)
    add_loads(draft)
    add_increments(draft)
    add_clearances(draft)
    add_guides(draft)
    _run(draft)
    add_outputs(draft)
    draft.rng = draft.names.rng = RandomStream(
        seed, 2
    )  # the rest of a scene is the same without them
    add_instants(draft)
    transverse = RandomStream(seed, 3)
    if transverse.chance(_TRANSVERSE):
        bodies = transverse.subset(list(draft.tree["body"]), 1)
        draft.tree["output"] = draft.tree.get("output", {}) | {"transverse": bodies}
    draft.rng = draft.names.rng = RandomStream(seed, 4)
    add_triggers(draft)
    draft.rng = draft.names.rng = RandomStream(seed, 5)
    add_directions(draft)
    draft.rng = draft.names.rng = RandomStream(seed, 6)
    add_allowances(draft)
    draft.rng = RandomStream(seed, 7)
    add_late_profiles(draft)
    draft.rng = RandomStream(seed, 22)
    add_sectors(draft)
    draft.rng = RandomStream(seed, 20)
    name_parts(draft)
    draft.rng = RandomStream(seed, 21)
    add_force_tables(draft)
    draft.rng = RandomStream(seed, 8)
    add_signals(draft)
    draft.rng = RandomStream(seed, 22)
    vary_tables(draft)
    draft.rng = RandomStream(seed, 23)
    add_control_terms(draft)
    draft.rng = RandomStream(seed, 24)
    cut_pulls(draft)
    tree = {key: draft.tree[key] for key in _ORDER if key in draft.tree}
    with suppress(SceneError):  # refused scenes are counted
        add_dispersions(tree, parse_campaign(tree, f"seed {seed}").scene, rng)
    return tree


def _late(rng: RandomStream) -> frozenset[str]:
    """Random later kinds; a random stream of their own leaves the rest of a scene unchanged."""
    return (
        frozenset(kind for kind, probability in LATE.items() if rng.chance(probability))
        if rng.chance(_LATE_PROBABILITY)
        else frozenset()
    )


def _initial_state(draft: Draft) -> None:
    """Initial state of a vehicle on the ground: at rest, or turning about the joint with the
    ground; sometimes in conflict with it."""
    rng, initial = draft.rng, draft.tree["initial"]
    holding = [joint for joint in draft.tree["joint"].values() if GROUND in joint["bodies"]]
    if not holding:
        return
    initial["speed_m_s"] = 0.0
    kind = holding[0]["_kind"]
    omega = initial.pop("omega_deg_s", None)
    if omega is None or rng.chance(0.3):
        return
    axis = holding[0].get("x_axis", [1.0, 0.0, 0.0])
    if kind == "spherical" or rng.chance(0.12):
        initial["omega_deg_s"] = omega
    elif kind in ("revolute", "cylindrical", "planar"):
        initial["omega_deg_s"] = [omega[0] * x for x in axis]


def _run(draft: Draft) -> None:
    """Settings of the solver and the run."""
    rng, tree = draft.rng, draft.tree
    solver: dict[str, Any] = {"accuracy": rng.weighted_choice({1e-7: 0.7, 1e-5: 0.15, 1e-9: 0.15})}
    method = rng.weighted_choice({"dop853": 0.75, "dopri5": 0.15, "rk4": 0.1})
    if method != "dop853":
        solver |= {"method": method, "accuracy": 1e-7 if method == "dopri5" else 1e-5}
    drift = rng.weighted_choice({"projection": 0.86, "none": 0.1, "baumgarte": 0.04})
    if drift != "projection":
        solver["drift"] = drift
    if rng.chance(0.04):
        solver["formulation"] = "full"
    tree["solver"] = solver
    tree["run"] |= {"cases": 4, "seed": int(rng.generator.integers(1000))}
    if rng.chance(0.1):
        tree["run"]["history_step_s"] = draft.span / rng.choice([7, 10, 16])
