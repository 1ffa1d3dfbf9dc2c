"""Conditions that end phases, trigger releases or are only observed, and ends of spring strokes, as
flat lists in disjunctive normal form.

A leaf is one comparison of a quantity with a threshold, a clause is a list of leaves, an event is a
list of clauses: it occurs when all leaves of at least one of its clauses are met.
"""

import itertools
import math
from dataclasses import dataclass, field

from sepmc.routines import layout as at
from sepmc.scene.model import Condition, Scene

_ON_JOINT = {
    "stroke": at.AT_STROKE,
    "distance": at.AT_DISTANCE,
    "angle": at.AT_ANGLE,
    "force": at.AT_FORCE,
    "moment": at.AT_MOMENT,
}
_ON_BODY = {"altitude": at.AT_ALTITUDE, "vertical_speed": at.AT_VERTICAL_SPEED}


@dataclass(frozen=True)
class Leaf:
    """One comparison of a quantity with a threshold.

    ``quantity`` is the code of the quantity (AT_TIME, ... of `sepmc.routines.layout`), ``item`` the
    name of the joint, motor, body or spring that has it ("" for a time), ``event`` the number in
    `Conditions` of the event that the leaf belongs to. ``path`` is the parameter path of the
    threshold (``phase.locked.until.time``); None for a burn-out and a spring's end of stroke.
    ``direction`` says which crossing of the threshold counts: "rising", "falling" or "either"; with
    "" the leaf is met also if the quantity starts beyond the threshold.
    """

    quantity: int
    item: str
    event: int
    path: str | None
    direction: str = ""


@dataclass
class Conditions:
    """Conditions of a scene as flat lists of numbers, all counted from 0.

    ``events`` has two numbers for each event, one after the other: its first clause and its number
    of clauses. ``clauses`` has two for each clause: its first position in ``clause_leaves`` and its
    number of leaves. ``clause_leaves`` has the numbers of the leaves, which are indices of
    ``leaves``.

    The events, in this order: the end of each phase, each release, each observation event, the end
    of the stroke of each spring. An event without clauses never occurs.
    """

    leaves: list[Leaf] = field(default_factory=list)
    events: list[int] = field(default_factory=list)
    clauses: list[int] = field(default_factory=list)
    clause_leaves: list[int] = field(default_factory=list)

    def add(self, until: Condition | None, path: str) -> None:
        """Append an event that occurs when the condition ``until`` is met (None: never).

        ``path`` is the parameter path of the condition, such as ``phase.locked.until``: those of
        its thresholds begin with it.
        """
        self._close(self._clauses(until, path) if until is not None else [])

    def add_stroke(self, spring: str, ends: bool) -> None:
        """Append the event that a spring reaches the end of its stroke; unless the stroke ``ends``
        (is finite), the event has no clause and never occurs."""
        self._close([[self._leaf(at.AT_SPRING_STROKE, spring, None)]] if ends else [])

    def _close(self, clauses: list[list[int]]) -> None:
        """Append an event with these clauses, each a list of leaf numbers; no clauses: the event
        never occurs."""
        self.events += [len(self.clauses) // 2, len(clauses)]
        for clause in clauses:
            self.clauses += [len(self.clause_leaves), len(clause)]
            self.clause_leaves += clause

    def _leaf(self, quantity: int, item: str, path: str | None, direction: str = "") -> int:
        """Append a leaf (arguments as in `Leaf`) of the event that is appended next; return the
        index of the leaf in `leaves`."""
        self.leaves.append(Leaf(quantity, item, len(self.events) // 2, path, direction))
        return len(self.leaves) - 1

    def _clauses(self, until: Condition, path: str) -> list[list[int]]:
        """Return the clauses of the condition ``until``, each a list of leaf numbers; it is met
        when all leaves of at least one clause are. Its leaves are appended to ``leaves``; ``path``
        is its parameter path."""
        clauses = []
        if until.time is not None:
            clauses.append([self._leaf(at.AT_TIME, "", f"{path}.time")])
        if until.burn_out is not None:
            clauses.append([self._leaf(at.AT_BURN_OUT, until.burn_out, None)])
        if until.spring is not None:
            clauses.append([self._leaf(at.AT_SPRING_STROKE, until.spring, None)])
        for key, quantity in _ON_JOINT.items():
            if getattr(until, key) is not None and until.joint is not None:
                direction = until.direction or ""
                clauses.append([self._leaf(quantity, until.joint, f"{path}.{key}", direction)])
        for key, quantity in _ON_BODY.items():
            if getattr(until, key) is not None and until.body is not None:
                direction = until.direction or "either"
                clauses.append([self._leaf(quantity, until.body, f"{path}.{key}", direction)])
        for number, item in enumerate(until.any):
            clauses += self._clauses(item, f"{path}.any.{number}")
        if until.all:
            alternatives = [
                self._clauses(item, f"{path}.all.{number}") for number, item in enumerate(until.all)
            ]
            clauses += [
                list(itertools.chain(*choice)) for choice in itertools.product(*alternatives)
            ]
        return clauses


def make_conditions(scene: Scene, dispersed: frozenset[str] = frozenset()) -> Conditions:
    """Collect the conditions of a scene, of its springs too.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        paths of dispersed parameters: a spring has an end of stroke if its nominal stroke is finite
        or dispersed

    Returns
    -------
    Conditions
        events in the order of the scene: phases, releases, observation events, springs
    """
    conditions = Conditions()
    for phase in scene.phase:
        conditions.add(phase.until, f"phase.{phase.name}.until")
    for release in scene.release:
        conditions.add(release.when, f"release.{release.name}.when")
    for event in scene.event:
        conditions.add(event.when, f"event.{event.name}.when")
    for spring in scene.spring:
        conditions.add_stroke(
            spring.name, math.isfinite(spring.stroke) or f"spring.{spring.name}.stroke" in dispersed
        )
    return conditions
