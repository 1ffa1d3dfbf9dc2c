"""Phases of a random scene: which joints hold, what ends each phase, and the load that brings that
about."""

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
    """One to five phases. Between two of them some joint lets go, unless the boundary is an idle
    one."""
    dice, tree = draft.dice, draft.tree
    count = dice.weighted({1: 0.08, 2: 0.37, 3: 0.33, 4: 0.17, 5: 0.05})
    changes: dict[str, list[bool]] = {name: [] for name in tree["joint"]}
    for _ in range(count - 1):
        idle = draft.special in ("idle", "shut") and dice.chance(0.6)
        chosen = (
            [] if idle or not changes else dice.some(list(changes), 1 if dice.chance(0.75) else 2)
        )
        for name, found in changes.items():
            found.append(
                name in chosen
                and not (draft.special == "shut" and GROUND not in tree["joint"][name]["bodies"])
            )
    kinds = {name: chain(draft, name, found) for name, found in changes.items()}
    tree["phase"] = []
    past = 0.0  # s, about when the phase begins
    for number in range(count):
        held = {
            name: found[number]
            for name, found in kinds.items()
            if found[number] != "free" or dice.chance(0.1)
        }
        phase: Tree = {"name": draft.names.new("phase"), "joints": held}
        if number < count - 1:
            span = dice.between(0.5, 1.0) * draft.span / count
            past += span
            phase["until"] = ending(draft, held, partial(_until, draft, held, span, past))
        tree["phase"].append(phase)
    add_releases(draft, partial(_until, draft))
    if dice.chance(0.3) and tree["joint"]:
        tree["output"] = {"tip_off": dice.some(list(tree["joint"]), dice.pick([1, 2]))}


def add_instants(draft: Draft) -> None:
    """Instants that are told of, in a scene that is complete but for these."""
    add_events(draft, partial(_until, draft))


def add_triggers(draft: Draft) -> None:
    """Motors that light at an instant of the flight, in a scene that is complete but for these."""
    add_ignitions(draft, partial(_until, draft))


def add_allowances(draft: Draft) -> None:
    """Releases that may not come, in a scene that is complete but for these."""
    add_options(draft, partial(_until, draft))


def _until(draft: Draft, held: dict[str, str], span: float, past: float) -> Tree:
    """A condition that is met about ``span`` s after the phase begins, ``past`` s after the start,
    if all goes well."""
    dice = draft.dice
    what = dice.weighted(_ENDS)
    if what in ("stroke", "distance"):
        movable = [name for name in draft.tree["joint"] if _slides(draft, name, held)]
        if movable:
            return _pushed(draft, dice.pick(movable), span, what)
    if what == "angle":
        turning = [name for name in draft.tree["joint"] if _turns(held.get(name, "free"))]
        if turning:
            return _turned(draft, dice.pick(turning), span)
    if what == "altitude" and draft.tree["initial"]["speed_m_s"] > 20.0:
        return _climbed(draft, past)
    if what == "burn_out":
        return _burnt(draft, past)
    times = [
        phase["until"]["time_s"]
        for phase in draft.tree["phase"]
        if "time_s" in phase.get("until", {})
    ]
    early = max([0.0, *times])
    # some are over before they begin
    time = early if dice.chance(0.04) else max(early, past * dice.between(0.3, 1.0))
    return {"time_s": rounded(min(time, 0.98 * draft.span), 6)}


def _slides(draft: Draft, name: str, held: dict[str, str]) -> bool:
    return held.get(name) != "rod" and 0 not in rows(draft, name, held.get(name, "free"))


def _turns(kind: str) -> bool:
    """Whether a load can turn a joint of a kind about its x axis."""
    return kind in (
        "revolute",
        "cylindrical",
        "spherical",
        "planar",
        "point-on-line",
        "free",
        "point-on-plane",
    )


def _pushed(draft: Draft, name: str, span: float, what: str) -> Tree:
    """A stroke or distance, and a spring that pushes the joint's bodies so far apart."""
    dice, joint = draft.dice, draft.tree["joint"][name]
    acceleration = dice.between(5.0, 60.0)
    way = max(3e-4, min(0.4, 0.5 * acceleration * span**2 * dice.between(0.3, 0.9)))
    force = draft.reduced(joint["bodies"]) * acceleration
    spring: Tree = {
        "name": draft.names.new("spring"),
        "bodies": joint["bodies"],
        "point_m": [x + (0.0 if draft.special else dice.about(0.05)) for x in joint["point_m"]],
        "axis": toward(draft, name),
        "force_N": rounded(force),
    }
    if dice.chance(0.5):
        spring["stiffness_N_per_m"] = rounded(force / way * dice.between(0.05, 0.5))
    if dice.chance(0.4):
        spring["stroke_m"] = rounded(way * dice.between(0.4, 1.5))
    draft.tree.setdefault("spring", []).append(spring)
    if what == "distance" and "second_point_m" in joint:
        way += math.dist(joint["point_m"], joint["second_point_m"])
    return {"joint": name, f"{what}_m": rounded(way)}


def _turned(draft: Draft, name: str, span: float) -> Tree:
    """An angle, and a moment about the joint's x axis that turns one of its bodies so far."""
    dice, joint = draft.dice, draft.tree["joint"][name]
    body = next(body for body in reversed(joint["bodies"]) if body != GROUND)
    axis = joint.get("x_axis", [1.0, 0.0, 0.0])
    size = math.hypot(*axis)
    acceleration = dice.between(5.0, 40.0)
    moment = acceleration * sum(draft.tree["body"][body]["inertia_kg_m2"]) / 3.0
    load = {
        "name": draft.names.new("load"),
        "body": body,
        "moment_N_m": [rounded(moment * x / size) for x in axis],
    }
    draft.tree.setdefault("load", []).append(load)
    angle = max(2e-3, min(0.7, 0.5 * acceleration * span**2 * dice.between(0.2, 0.7)))
    return {"joint": name, "angle_deg": rounded(math.degrees(angle))}


def _climbed(draft: Draft, past: float) -> Tree:
    """A height that a body passes about ``past`` s after the start, were there neither loads nor
    rates."""
    initial, dice = draft.tree["initial"], draft.dice
    body = dice.pick(draft.bodies)
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
            initial["altitude_m"] + start + rise * past * dice.between(0.5, 0.9), 8
        ),
    }


def _burnt(draft: Draft, past: float) -> Tree:
    """The burn-out of a motor about ``past`` s after the start."""
    dice = draft.dice
    body = dice.pick(draft.bodies)
    ignition = dice.weighted({0.0: 0.4, rounded(past * dice.between(0.1, 0.6)): 0.6})
    motor: Tree = {
        "name": draft.names.new("motor"),
        "body": body,
        "thrust_N": rounded(draft.mass(body) * dice.between(3.0, 20.0)),
        "station_m": draft.cg(body)[0] + 0.4,
        "ignition_s": ignition,
        "burn_s": rounded(max(1e-3, past - ignition)),
    }
    draft.tree.setdefault("motor", []).append(motor)
    return {"burn_out": motor["name"]}
