"""Joints of a random scene: a tree that holds all bodies, now and then the ground, and loops."""

import numpy as np

from oracles.random_scenes.draft import GROUND, Draft, Tree
from sepmc.scene.kinds import KINDS, is_part, rows_of
from sepmc.scene.model import Custom, Joint

_FIRST = {  # how likely a joint begins as each kind
    **{
        "fixed": 0.34,
        "slider": 0.16,
        "revolute": 0.08,
        "cylindrical": 0.06,
        "universal": 0.06,
        "spherical": 0.1,
    },
    **{"planar": 0.04, "point-on-plane": 0.03, "point-on-line": 0.04, "rod": 0.05, "own": 0.04},
}
_IN_LOOP = {
    "rod": 0.5,
    "point-on-plane": 0.2,
    "point-on-line": 0.1,
    "spherical": 0.08,
    "fixed": 0.04,
    "own": 0.08,
}
_ON_GROUND = {
    **{
        "fixed": 0.25,
        "spherical": 0.25,
        "revolute": 0.1,
        "universal": 0.1,
        "slider": 0.1,
        "rod": 0.07,
    },
    **{"cylindrical": 0.05, "planar": 0.03, "point-on-plane": 0.02, "own": 0.03},
}
_GUIDED = {"slider": 0.8, "fixed": 0.2}


def add_joints(draft: Draft) -> None:
    """A joint to hold each body after the first, then those that close loops and that hold the
    ground."""
    dice, bodies = draft.dice, draft.bodies
    draft.tree["joint"] = {}
    if dice.chance(0.2):
        _add(draft, GROUND, bodies[0], _ON_GROUND)
    for number in range(1, len(bodies)):
        other = bodies[number - 1] if dice.chance(0.75) else dice.pick(bodies[:number])
        _add(
            draft,
            other,
            bodies[number],
            _GUIDED if number == 1 and "guide" in draft.late else _FIRST,
        )
    if dice.chance(0.3 if len(bodies) > 2 else 0.12):
        first, second = dice.some(bodies, 2)
        _add(draft, first, second, _IN_LOOP)


def _add(draft: Draft, first: str, second: str, kinds: dict[str, float]) -> None:
    """A joint between two bodies, near the middle of their mass centres; its first kind is kept in
    its tree as ``_kind``."""
    dice = draft.dice
    kind = dice.weighted(kinds)
    centres = [draft.cg(body) for body in (first, second) if body != GROUND]
    aside = 0.0 if draft.special in ("symmetric", "concentric") else 0.15
    point = [
        rounded_mean + dice.about(aside)
        for rounded_mean in np.mean(centres, axis=0).round(4).tolist()
    ]
    joint: Tree = {
        "bodies": [first, second] if dice.chance(0.6) else [second, first],
        "point_m": point,
        "_kind": kind,
    }
    if dice.chance(0.35):
        joint["x_axis"] = dice.direction()
        joint["y_axis"] = dice.direction()
    elif dice.chance(0.15):
        joint["x_axis"], joint["y_axis"] = dice.pick(
            [([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), ([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
        )
    if kind == "rod":
        joint["second_point_m"] = [x + y for x, y in zip(point, dice.direction(), strict=True)]
    if dice.chance(0.15):
        joint["apart"] = dice.pick([1, -1])
    if dice.chance(0.25):
        joint["delay_s"] = dice.between(0.002, 0.04)
    if dice.chance(0.02):
        joint["fails"] = 1.0
    for _ in range(
        2 if kind == "own" else dice.weighted({0: 0.85, 1: 0.15}) if kind != "rod" else 0
    ):
        translations = dice.some("xyz", dice.pick([0, 1, 2, 3]))
        rotations = dice.some("xyz", dice.pick([0, 1, 2, 3]))
        joint.setdefault("kind", {})[draft.names.new("kind")] = {
            "translations": translations,
            "rotations": rotations,
        }
    draft.tree["joint"][draft.names.new("joint")] = joint


def chain(draft: Draft, name: str, changes: list[bool]) -> list[str]:
    """Kinds of a joint phase by phase: at each boundary where ``changes`` says so, it lets go of
    something."""
    dice, joint = draft.dice, draft.tree["joint"][name]
    own = {kind: Custom(**held) for kind, held in joint.get("kind", {}).items()}
    model = Joint(bodies=("", ""), point=(0.0, 0.0, 0.0), kind=own)
    first = joint.pop("_kind")
    found = [dice.pick(list(own)) if first == "own" else first]
    for change in changes:
        held = rows_of(model, found[-1])
        less = [
            kind
            for kind in [*KINDS, *own]
            if kind != "rod"
            and is_part(rows_of(model, kind), held)
            and set(rows_of(model, kind)) != set(held)
        ]
        if not change or not less:
            found.append(found[-1])
        else:
            found.append("free" if dice.chance(0.5) else dice.pick(less))
    return found


def rows(draft: Draft, name: str, kind: str) -> tuple[int, ...]:
    """Codes of the rows that a kind of a joint holds: 0, 1, 2 along x, y, z, then those that hold
    rotations."""
    own = {own: Custom(**held) for own, held in draft.tree["joint"][name].get("kind", {}).items()}
    return rows_of(Joint(bodies=("", ""), point=(0.0, 0.0, 0.0), kind=own), kind)


def toward(draft: Draft, name: str) -> list[float]:
    """Body axes direction along a joint's x axis in which its second body goes apart."""
    joint = draft.tree["joint"][name]
    x = np.array(joint.get("x_axis", [1.0, 0.0, 0.0]))
    ends = [
        np.array(draft.cg(body) if body != GROUND else joint["point_m"]) for body in joint["bodies"]
    ]
    along = float((ends[1] - ends[0]) * [-1.0, 1.0, 1.0] @ x)
    sign = joint.get("apart") or (1 if along >= 0.0 else -1)
    return [sign * float(component) for component in x]
