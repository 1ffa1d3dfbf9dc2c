"""Conditions on time and state: what they compare, and whether what was met satisfies an event."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sepmc.trust.independent.case import Table

_ON_JOINT = ("stroke", "distance", "angle", "force", "moment")
# of a threshold, or of one: a condition this close at the instant it begins to be waited for is met
TOUCH = 1e-12


@dataclass
class Leaf:
    """One comparison: of what, with which threshold; whether it has been met."""

    what: str
    which: str | None
    threshold: float
    met: bool = False
    side: float = 1.0  # from below 1, from above -1: of a height

    @property
    def on_time(self) -> bool:
        """Whether the time itself is compared, with a given one or a burn-out."""
        return self.what in ("time", "burn_out")

    @property
    def on_load(self) -> bool:
        """Whether a joint's force or moment is compared."""
        return self.what in ("force", "moment")


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
            Leaf(key, until["joint"], until[key]) for key in _ON_JOINT if until[key] is not None
        ]
    if until["body"] is not None and until["altitude"] is not None:
        own.append(Leaf("altitude", until["body"], until["altitude"]))
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
