"""Conditions that end phases and trigger releases, as flat tables in disjunctive normal form: an
event occurs when all leaves of any of its clauses are met."""

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

    ``quantity`` is its code (AT_TIME, ... of `sepmc.routines.layout`), ``item`` the joint, motor,
    body or spring, ``event`` the number of the event in `Conditions` that it belongs to, ``path``
    the parameter path of the threshold if it has one. ``direction`` is that of the crossing that
    counts (rising, falling, either), "" if the quantity may also start beyond the threshold.
    """

    quantity: int
    item: str
    event: int
    path: str | None
    direction: str = ""


@dataclass
class Conditions:
    """Conditions of a scene as flat lists.

    ``events`` stores (first clause, number of clauses) of each event, ``clauses`` (first leaf,
    number of leaves) of each clause, ``clause_leaves`` the leaf numbers.

    Events: the end of each phase, each release, each observation event, the stroke end of each
    spring.
    """

    leaves: list[Leaf] = field(default_factory=list)
    events: list[int] = field(default_factory=list)
    clauses: list[int] = field(default_factory=list)
    clause_leaves: list[int] = field(default_factory=list)

    def add(self, until: Condition | None, path: str) -> None:
        """Append an event with the condition ``until``, whose parameters begin with ``path``; with
        None it never occurs."""
        self._close(self._clauses(until, path) if until is not None else [])

    def add_stroke(self, spring: str, ends: bool) -> None:
        """Append the stroke end of a spring as an event; it never occurs unless the stroke
        ``ends``."""
        self._close([[self._leaf(at.AT_SPRING_STROKE, spring, None)]] if ends else [])

    def _close(self, clauses: list[list[int]]) -> None:
        self.events += [len(self.clauses) // 2, len(clauses)]
        for clause in clauses:
            self.clauses += [len(self.clause_leaves), len(clause)]
            self.clause_leaves += clause

    def _leaf(self, quantity: int, item: str, path: str | None, direction: str = "") -> int:
        self.leaves.append(Leaf(quantity, item, len(self.events) // 2, path, direction))
        return len(self.leaves) - 1

    def _clauses(self, until: Condition, path: str) -> list[list[int]]:
        """Clauses of a condition, each a list of leaf numbers."""
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
    """Collect the conditions of a scene.

    Parameters
    ----------
    scene : Scene
    dispersed : frozenset of str
        paths of dispersed parameters; a stroke may be finite in dispersed cases only

    Returns
    -------
    Conditions
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
