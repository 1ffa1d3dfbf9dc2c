"""Conditions on time and state: comparisons with thresholds, combined to the condition of an
event."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from oracles.independent.case import Table

_ON_JOINT = ("stroke", "distance", "angle", "force", "moment")
_ON_BODY = ("altitude", "vertical_speed")
# relative to the threshold, or to 1: a condition this close when it is armed counts as met;
# distance from a threshold at which a quantity is clearly on one side
TOUCH, ASIDE = 1e-12, 4e-12


@dataclass
class Leaf:
    """Comparison of a quantity with a threshold, and whether it has been met.

    With a ``direction`` (rising, falling, either) the threshold must be crossed from ``side``: 1
    below, -1 above, 0 until the quantity has been clearly on one side.
    """

    quantity: str
    name: str | None
    threshold: float
    direction: str | None = None
    met: bool = False
    side: float = 0.0

    @property
    def on_time(self) -> bool:
        """True if time is compared, with a given value or a burn-out."""
        return self.quantity in ("time", "burn_out")

    @property
    def on_load(self) -> bool:
        """True if a joint's force or moment is compared."""
        return self.quantity in ("force", "moment")

    @property
    def scale(self) -> float:
        """Scale of the tolerances of the comparison."""
        return max(1.0, abs(self.threshold))

    def take_side(self, excess: float) -> None:
        """Set the side of the threshold on which the quantity is, if it is clearly on one."""
        if abs(excess) > ASIDE * self.scale * (1.0 - 1e-3):
            self.side = -1.0 if excess > 0.0 else 1.0

    def cross(self) -> None:
        """Cross the threshold from the present side."""
        wanted = {"rising": (1.0,), "falling": (-1.0,)}.get(str(self.direction), (1.0, -1.0))
        self.met, self.side = self.side in wanted, 0.0

    def judge(self, excess: float) -> None:
        """Update the comparison from the excess of the quantity over its threshold at an
        instant."""
        if self.direction is None:
            self.met = excess >= -TOUCH * self.scale
            return
        if self.side and self.side * excess >= -TOUCH * self.scale:
            self.cross()
        if not self.side:
            self.take_side(excess)


@dataclass
class Event:
    """Condition of a phase end, a release, an observed event or the end of a spring's push, as a
    tree with its comparisons."""

    name: str
    tree: Table | None
    leaves: list[Leaf] = field(default_factory=list)
    time: float = math.inf

    def satisfied(self) -> bool:
        """True if the comparisons met so far satisfy the condition; never without a condition."""
        return self.tree is not None and _satisfied(self.tree)


def make_event(
    name: str,
    until: Table | None,
    burn_out: Callable[[str], float],
    stroke: Callable[[str], float],
) -> Event:
    """Event from its condition.

    Parameters
    ----------
    until : dict or None
        Condition, as `case.condition` returns it.
    burn_out : callable
        Burn-out time, s, by motor.
    stroke : callable
        End of the stroke, m, by spring.
    """
    leaves: list[Leaf] = []
    return Event(name, None if until is None else _tree(until, leaves, burn_out, stroke), leaves)


def spring_event(name: str, stroke: float) -> Event:
    """Event at which a spring has reached the end of its stroke."""
    leaf = Leaf("spring", name, stroke)
    return Event(f"spring {name} spent", {"own": [leaf], "any": [], "all": []}, [leaf])


def _tree(
    until: Table,
    leaves: list[Leaf],
    burn_out: Callable[[str], float],
    stroke: Callable[[str], float],
) -> dict[str, Any]:
    """Condition as nested dicts; appends its comparisons to ``leaves``."""
    own = [Leaf("time", None, until["time"])] if until["time"] is not None else []
    if until["burn_out"] is not None:
        own.append(Leaf("burn_out", until["burn_out"], burn_out(until["burn_out"])))
    if until["spring"] is not None:
        own.append(Leaf("spring", until["spring"], stroke(until["spring"])))
    if until["joint"] is not None:
        own += [
            Leaf(key, until["joint"], until[key], until["direction"])
            for key in _ON_JOINT
            if until[key] is not None
        ]
    if until["body"] is not None:
        own += [
            Leaf(key, until["body"], until[key], until["direction"] or "either")
            for key in _ON_BODY
            if until[key] is not None
        ]
    leaves += own
    return {
        "own": own,
        **{
            key: [_tree(part, leaves, burn_out, stroke) for part in until[key]]
            for key in ("any", "all")
        },
    }


def _satisfied(tree: dict[str, Any]) -> bool:
    """Several keys in one table, and ``any``, need one met; ``all`` needs all."""
    if any(leaf.met for leaf in tree["own"]) or any(_satisfied(part) for part in tree["any"]):
        return True
    return bool(tree["all"]) and all(_satisfied(part) for part in tree["all"])
