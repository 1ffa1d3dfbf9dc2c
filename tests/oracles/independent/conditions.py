"""Conditions on time and state: what they compare, and whether what was met satisfies an event."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from oracles.independent.case import Table

_ON_JOINT = ("stroke", "distance", "angle", "force", "moment")
_ON_BODY = ("altitude", "vertical_speed")
# of a threshold, or of one: a condition this close at the instant it begins to be waited for is
# met; and how far from a threshold a quantity is on a side of it
TOUCH, ASIDE = 1e-12, 4e-12


@dataclass
class Leaf:
    """One comparison: of what, with which threshold; whether it has been met.

    With a ``direction`` (rising, falling, either) the threshold must be crossed, from the ``side``:
    1 below, -1 above, 0 as long as the quantity has not been on a side of it.
    """

    what: str
    which: str | None
    threshold: float
    direction: str | None = None
    met: bool = False
    side: float = 0.0

    @property
    def on_time(self) -> bool:
        """Whether the time itself is compared, with a given one or a burn-out."""
        return self.what in ("time", "burn_out")

    @property
    def on_load(self) -> bool:
        """Whether a joint's force or moment is compared."""
        return self.what in ("force", "moment")

    @property
    def scale(self) -> float:
        """What its tolerances are shares of."""
        return max(1.0, abs(self.threshold))

    def take_side(self, excess: float) -> None:
        """Note on which side a quantity is, if on any, by how far it is beyond its threshold."""
        if abs(excess) > ASIDE * self.scale * (1.0 - 1e-3):
            self.side = -1.0 if excess > 0.0 else 1.0

    def cross(self) -> None:
        """The threshold is crossed from the side that the quantity was on."""
        wanted = {"rising": (1.0,), "falling": (-1.0,)}.get(str(self.direction), (1.0, -1.0))
        self.met, self.side = self.side in wanted, 0.0

    def judge(self, excess: float) -> None:
        """What follows for it from how far a quantity is beyond its threshold at an instant."""
        if self.direction is None:
            self.met = excess >= -TOUCH * self.scale
            return
        if self.side and self.side * excess >= -TOUCH * self.scale:
            self.cross()
        if not self.side:
            self.take_side(excess)


@dataclass
class Event:
    """The end of a phase, a release, an instant that is told of or the end of a spring's push, with
    its condition as a tree and the leaves of that."""

    name: str
    tree: Table | None
    leaves: list[Leaf] = field(default_factory=list)
    time: float = math.inf

    def satisfied(self) -> bool:
        """Whether the leaves met so far satisfy the condition; never if there is none."""
        return self.tree is not None and _satisfied(self.tree)


def make_event(
    name: str,
    until: Table | None,
    burn_out: Callable[[str], float],
    stroke: Callable[[str], float],
) -> Event:
    """An event from its condition; ``burn_out`` tells when a motor burns out, ``stroke`` where a
    spring ends."""
    leaves: list[Leaf] = []
    return Event(name, None if until is None else _tree(until, leaves, burn_out, stroke), leaves)


def spring_event(name: str, stroke: float) -> Event:
    """The end of a spring's push."""
    leaf = Leaf("spring", name, stroke)
    return Event(f"spring {name} spent", {"own": [leaf], "any": [], "all": []}, [leaf])


def _tree(
    until: Table,
    leaves: list[Leaf],
    burn_out: Callable[[str], float],
    stroke: Callable[[str], float],
) -> dict[str, Any]:
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
    """Of several keys in one table, and of ``any``, one is enough; ``all`` needs all."""
    if any(leaf.met for leaf in tree["own"]) or any(_satisfied(part) for part in tree["any"]):
        return True
    return bool(tree["all"]) and all(_satisfied(part) for part in tree["all"])
