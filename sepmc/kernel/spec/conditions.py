"""Conditions that end phases and let joints go, as tables a kernel reads: events, met when one of
their clauses is."""

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
    """One comparison: what, of which joint, motor, body or spring, for which event; the path of its
    threshold, if it has one; in which direction it must be crossed, "" if at or beyond it will
    do."""

    what: int
    which: str
    event: int
    path: str | None
    direction: str = ""


@dataclass
class Conditions:
    """``events`` (first clause, clauses), ``clauses`` (first leaf, leaves) and ``clause_leaves``,
    flat.

    Events: the end of each phase, each release, each instant that is told of, the stroke of each
    spring.
    """

    leaves: list[Leaf] = field(default_factory=list)
    events: list[int] = field(default_factory=list)
    clauses: list[int] = field(default_factory=list)
    clause_leaves: list[int] = field(default_factory=list)

    def add(self, until: Condition | None, path: str) -> None:
        """The next event: met when ``until`` is; never if that is None."""
        self._close(self._clauses(until, path) if until is not None else [])

    def add_stroke(self, spring: str, ends: bool) -> None:
        """The next event: the end of a spring's push; never unless it ``ends``."""
        self._close([[self._leaf(at.AT_SPRING_STROKE, spring, None)]] if ends else [])

    def _close(self, clauses: list[list[int]]) -> None:
        self.events += [len(self.clauses) // 2, len(clauses)]
        for clause in clauses:
            self.clauses += [len(self.clause_leaves), len(clause)]
            self.clause_leaves += clause

    def _leaf(self, what: int, which: str, path: str | None, direction: str = "") -> int:
        self.leaves.append(Leaf(what, which, len(self.events) // 2, path, direction))
        return len(self.leaves) - 1

    def _clauses(self, until: Condition, path: str) -> list[list[int]]:
        """Any of clauses, each all of leaves."""
        found = []
        if until.time is not None:
            found.append([self._leaf(at.AT_TIME, "", f"{path}.time")])
        if until.burn_out is not None:
            found.append([self._leaf(at.AT_BURN_OUT, until.burn_out, None)])
        if until.spring is not None:
            found.append([self._leaf(at.AT_SPRING_STROKE, until.spring, None)])
        for key, what in _ON_JOINT.items():
            if getattr(until, key) is not None and until.joint is not None:
                direction = until.direction or ""
                found.append([self._leaf(what, until.joint, f"{path}.{key}", direction)])
        for key, what in _ON_BODY.items():
            if getattr(until, key) is not None and until.body is not None:
                direction = until.direction or "either"
                found.append([self._leaf(what, until.body, f"{path}.{key}", direction)])
        for number, item in enumerate(until.any):
            found += self._clauses(item, f"{path}.any.{number}")
        if until.all:
            parts = [
                self._clauses(item, f"{path}.all.{number}") for number, item in enumerate(until.all)
            ]
            found += [list(itertools.chain(*choice)) for choice in itertools.product(*parts)]
        return found


def make_conditions(scene: Scene, dispersed: frozenset[str] = frozenset()) -> Conditions:
    """Every condition of a scene some of whose parameters, by path, are dispersed: a stroke may
    come from there alone."""
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
