"""Crossing directions of conditions of a random scene, some of them twice in a row, and vertical
speeds."""

import math
from collections.abc import Iterator

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded

_QUANTITIES = (
    *("stroke_m", "distance_m", "angle_deg", "force_N", "moment_N_m"),
    *("altitude_m", "vertical_speed_m_s"),
)
_DIRECTIONS = {"rising": 0.35, "falling": 0.4, "either": 0.25}


def add_directions(draft: Draft) -> None:
    """Add directions to some conditions, phases that wait for a repeated crossing, and vertical
    speeds."""
    rng, tree = draft.rng, draft.tree
    if "direction" not in draft.late:
        return
    for table, key in list(_condition_places(tree)):
        if rng.chance(0.3):
            speed = _vertical_speed(draft, rng.uniform(0.1, 1.0) * draft.span)
            table[key] = speed if rng.chance(0.4) else {"any": [table[key], speed]}
        for condition in _tables(table[key]):
            if sum(quantity in condition for quantity in _QUANTITIES) == 1 and rng.chance(0.5):
                condition["direction"] = rng.weighted_choice(_DIRECTIONS)
    for first, second in zip(tree["phase"], tree["phase"][1:-1], strict=False):
        if rng.chance(0.4):
            _wait_again(draft, first["until"], second)
    if rng.chance(0.6):
        when = _vertical_speed(draft, rng.uniform(0.05, 1.0) * draft.span)
        event = {"name": draft.names.new("event"), "when": when | _direction(draft)}
        tree.setdefault("event", []).append(event)


def _condition_places(tree: Tree) -> Iterator[tuple[Tree, str]]:
    """Tables with a condition, and its key."""
    for phase in tree["phase"][:-1]:
        yield phase, "until"
    for item in (*tree.get("release", []), *tree.get("event", [])):
        yield item, "when"


def _tables(condition: Tree) -> Iterator[Tree]:
    """Condition and all nested ones."""
    yield condition
    for key in ("any", "all"):
        for part in condition.get(key, []):
            yield from _tables(part)


def _direction(draft: Draft) -> Tree:
    """Direction, or nothing."""
    rng = draft.rng
    return {"direction": rng.weighted_choice(_DIRECTIONS)} if rng.chance(0.7) else {}


def _wait_again(draft: Draft, until: Tree, phase: Tree) -> None:
    """Also end a phase when a quantity of the condition before is crossed again."""
    crossed = [table for table in _tables(until) if any(key in table for key in _QUANTITIES)]
    if crossed:
        condition = draft.rng.choice(crossed)
        repeated = {k: v for k, v in condition.items() if k in ("joint", "body", *_QUANTITIES)}
        if sum(key in repeated for key in _QUANTITIES) == 1:
            crossing = repeated | {"direction": draft.rng.weighted_choice(_DIRECTIONS)}
            phase["until"] = (
                {"any": [phase["until"], crossing]} if draft.rng.chance(0.6) else crossing
            )


def _vertical_speed(draft: Draft, past: float) -> Tree:
    """Condition on the vertical speed of a body about ``past`` s after the start without loads and
    rates, or on zero."""
    rng, initial = draft.rng, draft.tree["initial"]
    environment = draft.tree.get("environment", {})
    path = math.radians(initial.get("pitch_deg", 0.0) - initial.get("alpha_deg", 0.0))
    rise = (
        initial["speed_m_s"]
        * math.cos(math.radians(initial.get("path_yaw_deg", 0.0)))
        * math.sin(path)
    )
    falls = 0.0 if environment.get("gravity") == "none" else 9.8 * past
    speed = 0.0 if rng.chance(0.15) else rounded(rise - falls + rng.symmetric(0.2), 6)
    return {"body": rng.choice(draft.bodies), "vertical_speed_m_s": speed}
