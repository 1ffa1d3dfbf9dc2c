"""Joints of a random scene: a tree that connects all bodies, sometimes the ground, and loops."""

import numpy as np

from oracles.random_scenes.draft import GROUND, Draft, Tree
from sepmc.scene.kinds import KINDS, is_subset, rows_of
from sepmc.scene.model import Custom, Joint

_FIRST = {  # probability of the first kind of a joint
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
    """Add a joint from each body after the first to one before, then joints that close loops or
    connect the ground."""
    rng, bodies = draft.rng, draft.bodies
    draft.tree["joint"] = {}
    if rng.chance(0.2):
        _add(draft, GROUND, bodies[0], _ON_GROUND)
    for number in range(1, len(bodies)):
        other = bodies[number - 1] if rng.chance(0.75) else rng.choice(bodies[:number])
        _add(
            draft,
            other,
            bodies[number],
            _GUIDED if number == 1 and "guide" in draft.late else _FIRST,
        )
    if rng.chance(0.3 if len(bodies) > 2 else 0.12):
        first, second = rng.subset(bodies, 2)
        _add(draft, first, second, _IN_LOOP)


def _add(draft: Draft, first: str, second: str, kinds: dict[str, float]) -> None:
    """Add a joint between two bodies, near the middle of their mass centres; its first kind is
    stored in its tree as ``_kind``."""
    rng = draft.rng
    kind = rng.weighted_choice(kinds)
    centres = [draft.cg(body) for body in (first, second) if body != GROUND]
    aside = 0.0 if draft.special in ("symmetric", "concentric") else 0.15
    point = [
        rounded_mean + rng.symmetric(aside)
        for rounded_mean in np.mean(centres, axis=0).round(4).tolist()
    ]
    joint: Tree = {
        "bodies": [first, second] if rng.chance(0.6) else [second, first],
        "point_m": point,
        "_kind": kind,
    }
    if rng.chance(0.35):
        joint["x_axis"] = rng.direction()
        joint["y_axis"] = rng.direction()
    elif rng.chance(0.15):
        joint["x_axis"], joint["y_axis"] = rng.choice(
            [([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), ([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
        )
    if kind == "rod":
        joint["second_point_m"] = [x + y for x, y in zip(point, rng.direction(), strict=True)]
    if rng.chance(0.15):
        joint["apart"] = rng.choice([1, -1])
    if rng.chance(0.25):
        joint["delay_s"] = rng.uniform(0.002, 0.04)
    if rng.chance(0.02):
        joint["fails"] = 1.0
    for _ in range(
        2 if kind == "own" else rng.weighted_choice({0: 0.85, 1: 0.15}) if kind != "rod" else 0
    ):
        translations = rng.subset("xyz", rng.choice([0, 1, 2, 3]))
        rotations = rng.subset("xyz", rng.choice([0, 1, 2, 3]))
        joint.setdefault("kind", {})[draft.names.new("kind")] = {
            "translations": translations,
            "rotations": rotations,
        }
    draft.tree["joint"][draft.names.new("joint")] = joint


def chain(draft: Draft, name: str, changes: list[bool]) -> list[str]:
    """Kinds of a joint by phase: at each boundary with ``changes`` it releases some rows."""
    rng, joint = draft.rng, draft.tree["joint"][name]
    custom = {kind: Custom(**axes) for kind, axes in joint.get("kind", {}).items()}
    model = Joint(bodies=("", ""), point=(0.0, 0.0, 0.0), kind=custom)
    first = joint.pop("_kind")
    kinds = [rng.choice(list(custom)) if first == "own" else first]
    for change in changes:
        active = rows_of(model, kinds[-1])
        fewer = [
            kind
            for kind in [*KINDS, *custom]
            if kind != "rod"
            and is_subset(rows_of(model, kind), active)
            and set(rows_of(model, kind)) != set(active)
        ]
        if not change or not fewer:
            kinds.append(kinds[-1])
        else:
            kinds.append("free" if rng.chance(0.5) else rng.choice(fewer))
    return kinds


def rows(draft: Draft, name: str, kind: str) -> tuple[int, ...]:
    """Codes of the rows of a kind of a joint: 0, 1, 2 along x, y, z, then rotations."""
    custom = {
        key: Custom(**axes) for key, axes in draft.tree["joint"][name].get("kind", {}).items()
    }
    return rows_of(Joint(bodies=("", ""), point=(0.0, 0.0, 0.0), kind=custom), kind)


def toward(draft: Draft, name: str) -> list[float]:
    """Body-axes direction along a joint's x axis in which its second body separates."""
    joint = draft.tree["joint"][name]
    x = np.array(joint.get("x_axis", [1.0, 0.0, 0.0]))
    ends = [
        np.array(draft.cg(body) if body != GROUND else joint["point_m"]) for body in joint["bodies"]
    ]
    distance = float((ends[1] - ends[0]) * [-1.0, 1.0, 1.0] @ x)
    sign = joint.get("apart") or (1 if distance >= 0.0 else -1)
    return [sign * float(component) for component in x]
