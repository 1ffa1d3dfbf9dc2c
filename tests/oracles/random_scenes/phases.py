"""Phases of a random scene: active joints, the condition that ends each phase, and the load that
causes it."""

import math
from functools import partial

from oracles.random_scenes.draft import GROUND, Draft, Tree
from oracles.random_scenes.events import (
    add_events,
    add_ignitions,
    add_options,
    add_releases,
    ending,
)
from oracles.random_scenes.joints import chain, rows, toward
from oracles.random_scenes.rng import rounded

_ENDS = {
    "time": 0.32,
    "stroke": 0.26,
    "distance": 0.1,
    "angle": 0.1,
    "altitude": 0.07,
    "burn_out": 0.15,
}


def add_phases(draft: Draft) -> None:
    """Add one to five phases. Some joint is released between two phases, unless the boundary is
    idle."""
    rng, tree = draft.rng, draft.tree
    count = rng.weighted_choice({1: 0.08, 2: 0.37, 3: 0.33, 4: 0.17, 5: 0.05})
    changes: dict[str, list[bool]] = {name: [] for name in tree["joint"]}
    for _ in range(count - 1):
        idle = draft.special in ("idle", "shut") and rng.chance(0.6)
        chosen = (
            [] if idle or not changes else rng.subset(list(changes), 1 if rng.chance(0.75) else 2)
        )
        for name, flags in changes.items():
            flags.append(
                name in chosen
                and not (draft.special == "shut" and GROUND not in tree["joint"][name]["bodies"])
            )
    kinds = {name: chain(draft, name, flags) for name, flags in changes.items()}
    tree["phase"] = []
    past = 0.0  # approximate start of the phase, s
    for number in range(count):
        active = {
            name: by_phase[number]
            for name, by_phase in kinds.items()
            if by_phase[number] != "free" or rng.chance(0.1)
        }
        phase: Tree = {"name": draft.names.new("phase"), "joints": active}
        if number < count - 1:
            span = rng.uniform(0.5, 1.0) * draft.span / count
            past += span
            phase["until"] = ending(draft, active, partial(_until, draft, active, span, past))
        tree["phase"].append(phase)
    add_releases(draft, partial(_until, draft))
    if rng.chance(0.3) and tree["joint"]:
        tree["output"] = {"tip_off": rng.subset(list(tree["joint"]), rng.choice([1, 2]))}


def add_instants(draft: Draft) -> None:
    """Add observed events to a scene that is complete otherwise."""
    add_events(draft, partial(_until, draft))


def add_triggers(draft: Draft) -> None:
    """Add motors that ignite at an event to a scene that is complete otherwise."""
    add_ignitions(draft, partial(_until, draft))


def add_allowances(draft: Draft) -> None:
    """Add releases that may not occur to a scene that is complete otherwise."""
    add_options(draft, partial(_until, draft))


def _until(draft: Draft, active: dict[str, str], span: float, past: float) -> Tree:
    """Condition that is met about ``span`` s after the phase begins, ``past`` s after the start, if
    all goes well."""
    rng = draft.rng
    quantity = rng.weighted_choice(_ENDS)
    if quantity in ("stroke", "distance"):
        movable = [name for name in draft.tree["joint"] if _slides(draft, name, active)]
        if movable:
            return _stroke_condition(draft, rng.choice(movable), span, quantity)
    if quantity == "angle":
        turning = [name for name in draft.tree["joint"] if _turns(active.get(name, "free"))]
        if turning:
            return _angle_condition(draft, rng.choice(turning), span)
    if quantity == "altitude" and draft.tree["initial"]["speed_m_s"] > 20.0:
        return _altitude_condition(draft, past)
    if quantity == "burn_out":
        return _burn_out_condition(draft, past)
    times = [
        phase["until"]["time_s"]
        for phase in draft.tree["phase"]
        if "time_s" in phase.get("until", {})
    ]
    early = max([0.0, *times])
    # some phases end before they begin
    time = early if rng.chance(0.04) else max(early, past * rng.uniform(0.3, 1.0))
    return {"time_s": rounded(min(time, 0.98 * draft.span), 6)}


def _slides(draft: Draft, name: str, active: dict[str, str]) -> bool:
    """True if a joint is free along x."""
    return active.get(name) != "rod" and 0 not in rows(draft, name, active.get(name, "free"))


def _turns(kind: str) -> bool:
    """True if a load can turn a joint of a kind about its x axis."""
    return kind in (
        "revolute",
        "cylindrical",
        "spherical",
        "planar",
        "point-on-line",
        "free",
        "point-on-plane",
    )


def _stroke_condition(draft: Draft, name: str, span: float, quantity: str) -> Tree:
    """Condition on stroke or distance, with a spring that pushes the joint's bodies apart by so
    much."""
    rng, joint = draft.rng, draft.tree["joint"][name]
    acceleration = rng.uniform(5.0, 60.0)
    travel = max(3e-4, min(0.4, 0.5 * acceleration * span**2 * rng.uniform(0.3, 0.9)))
    force = draft.reduced(joint["bodies"]) * acceleration
    spring: Tree = {
        "name": draft.names.new("spring"),
        "bodies": joint["bodies"],
        "point_m": [x + (0.0 if draft.special else rng.symmetric(0.05)) for x in joint["point_m"]],
        "axis": toward(draft, name),
        "force_N": rounded(force),
    }
    if rng.chance(0.5):
        spring["stiffness_N_per_m"] = rounded(force / travel * rng.uniform(0.05, 0.5))
    if rng.chance(0.4):
        spring["stroke_m"] = rounded(travel * rng.uniform(0.4, 1.5))
    draft.tree.setdefault("spring", []).append(spring)
    if quantity == "distance" and "second_point_m" in joint:
        travel += math.dist(joint["point_m"], joint["second_point_m"])
    return {"joint": name, f"{quantity}_m": rounded(travel)}


def _angle_condition(draft: Draft, name: str, span: float) -> Tree:
    """Condition on an angle, with a moment about the joint's x axis that turns one of its bodies by
    so much."""
    rng, joint = draft.rng, draft.tree["joint"][name]
    body = next(body for body in reversed(joint["bodies"]) if body != GROUND)
    axis = joint.get("x_axis", [1.0, 0.0, 0.0])
    size = math.hypot(*axis)
    acceleration = rng.uniform(5.0, 40.0)
    moment = acceleration * sum(draft.tree["body"][body]["inertia_kg_m2"]) / 3.0
    load = {
        "name": draft.names.new("load"),
        "body": body,
        "moment_N_m": [rounded(moment * x / size) for x in axis],
    }
    draft.tree.setdefault("load", []).append(load)
    angle = max(2e-3, min(0.7, 0.5 * acceleration * span**2 * rng.uniform(0.2, 0.7)))
    return {"joint": name, "angle_deg": rounded(math.degrees(angle))}


def _altitude_condition(draft: Draft, past: float) -> Tree:
    """Condition on the altitude of a body about ``past`` s after the start without loads and
    rates."""
    initial, rng = draft.tree["initial"], draft.rng
    body = rng.choice(draft.bodies)
    path = math.radians(initial.get("pitch_deg", 0.0) - initial.get("alpha_deg", 0.0))
    rise = (
        initial["speed_m_s"]
        * math.cos(math.radians(initial.get("path_yaw_deg", 0.0)))
        * math.sin(path)
    )
    masses = [draft.mass(name) for name in draft.bodies]
    centre = sum(m * draft.cg(name)[0] for m, name in zip(masses, draft.bodies, strict=True)) / sum(
        masses
    )
    start = (centre - draft.cg(body)[0]) * math.sin(math.radians(initial.get("pitch_deg", 0.0)))
    return {
        "body": body,
        "altitude_m": rounded(
            initial["altitude_m"] + start + rise * past * rng.uniform(0.5, 0.9), 8
        ),
    }


def _burn_out_condition(draft: Draft, past: float) -> Tree:
    """Condition on the burn-out of a motor about ``past`` s after the start."""
    rng = draft.rng
    body = rng.choice(draft.bodies)
    ignition = rng.weighted_choice({0.0: 0.4, rounded(past * rng.uniform(0.1, 0.6)): 0.6})
    motor: Tree = {
        "name": draft.names.new("motor"),
        "body": body,
        "thrust_N": rounded(draft.mass(body) * rng.uniform(3.0, 20.0)),
        "station_m": draft.cg(body)[0] + 0.4,
        "ignition_s": ignition,
        "burn_s": rounded(max(1e-3, past - ignition)),
    }
    draft.tree.setdefault("motor", []).append(motor)
    return {"burn_out": motor["name"]}
