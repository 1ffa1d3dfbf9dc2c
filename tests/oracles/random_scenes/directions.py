"""Conditions of a random scene that must be crossed in a direction, some of them twice in a row,
and vertical speeds."""

import math
from collections.abc import Iterator

from oracles.random_scenes.draft import Draft, Tree
from oracles.random_scenes.rng import rounded

_QUANTITIES = (
    *("stroke_m", "distance_m", "angle_deg", "force_N", "moment_N_m"),
    *("altitude_m", "vertical_speed_m_s"),
)
_WAYS = {"rising": 0.35, "falling": 0.4, "either": 0.25}


def add_directions(draft: Draft) -> None:
    """Directions for some of the conditions there are, phases that wait for what ended the phase
    before to be crossed again, and vertical speeds."""
    dice, tree = draft.dice, draft.tree
    if "direction" not in draft.late:
        return
    for place, key in list(_places(tree)):
        if dice.chance(0.3):
            speed = _vertical_speed(draft, dice.between(0.1, 1.0) * draft.span)
            place[key] = speed if dice.chance(0.4) else {"any": [place[key], speed]}
        for condition in _tables(place[key]):
            if sum(quantity in condition for quantity in _QUANTITIES) == 1 and dice.chance(0.5):
                condition["direction"] = dice.weighted(_WAYS)
    for first, second in zip(tree["phase"], tree["phase"][1:-1], strict=False):
        if dice.chance(0.4):
            _wait_again(draft, first["until"], second)
    if dice.chance(0.6):
        when = _vertical_speed(draft, dice.between(0.05, 1.0) * draft.span)
        event = {"name": draft.names.new("event"), "when": when | _direction(draft)}
        tree.setdefault("event", []).append(event)


def _places(tree: Tree) -> Iterator[tuple[Tree, str]]:
    """Tables that hold a condition, and its key."""
    for phase in tree["phase"][:-1]:
        yield phase, "until"
    for item in (*tree.get("release", []), *tree.get("event", [])):
        yield item, "when"


def _tables(condition: Tree) -> Iterator[Tree]:
    """A condition and those inside it."""
    yield condition
    for key in ("any", "all"):
        for part in condition.get(key, []):
            yield from _tables(part)


def _direction(draft: Draft) -> Tree:
    dice = draft.dice
    return {"direction": dice.weighted(_WAYS)} if dice.chance(0.7) else {}


def _wait_again(draft: Draft, until: Tree, phase: Tree) -> None:
    """Let a phase end, too, as something that ended the one before is crossed again."""
    crossed = [one for one in _tables(until) if any(key in one for key in _QUANTITIES)]
    if crossed:
        one = draft.dice.pick(crossed)
        kept = {k: v for k, v in one.items() if k in ("joint", "body", *_QUANTITIES)}
        if sum(key in kept for key in _QUANTITIES) == 1:
            again = kept | {"direction": draft.dice.weighted(_WAYS)}
            phase["until"] = {"any": [phase["until"], again]} if draft.dice.chance(0.6) else again


def _vertical_speed(draft: Draft, past: float) -> Tree:
    """A vertical speed that a body has about ``past`` s after the start, were there neither loads
    nor rates; or none."""
    dice, initial = draft.dice, draft.tree["initial"]
    environment = draft.tree.get("environment", {})
    path = math.radians(initial.get("pitch_deg", 0.0) - initial.get("alpha_deg", 0.0))
    rise = (
        initial["speed_m_s"]
        * math.cos(math.radians(initial.get("path_yaw_deg", 0.0)))
        * math.sin(path)
    )
    falls = 0.0 if environment.get("gravity") == "none" else 9.8 * past
    speed = 0.0 if dice.chance(0.15) else rounded(rise - falls + dice.about(0.2), 6)
    return {"body": dice.pick(draft.bodies), "vertical_speed_m_s": speed}
