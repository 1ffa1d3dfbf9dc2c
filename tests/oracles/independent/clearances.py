"""Clearances of a flight: its motion is kept, and the least distance sought at its end by
`sepmc.validation.geometry`."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from oracles.independent.case import Table
from oracles.independent.state import Array, Vehicle
from sepmc.validation.geometry import least_clearance, outline_distance, parts_of

_SAMPLES = 8  # of a step, at which distances are taken first
_COARSE = 400  # of a flight, at most


class Step(NamedTuple):
    """A step of a flight: from when to when, and its states."""

    start: float
    end: float
    dense: Callable[[float], Array]


class Clearances:
    """The motion of a flight step by step, and what is asked of it."""

    def __init__(self, asked: list[Table], bodies: dict[str, Table], vehicle: Vehicle):
        self.asked, self.vehicle = asked, vehicle
        named = {body for table in asked for body in table["bodies"]}
        self.parts = {name: parts_of(_outlined(bodies[name])) for name in named}
        self.steps: list[Step] = []

    def step(self, dense: Callable[[float], Array], start: float, end: float) -> None:
        """Keep the motion of a step between two times, s, if clearances are asked for."""
        if self.asked and end > start:
            self.steps.append(Step(start, end, dense))

    def report(self, free_from: dict[str, float]) -> dict[str, float]:
        """Outcomes under their public names but for places; ``free_from`` tells since when joints
        are free."""
        out: dict[str, float] = {}
        for table in self.asked:
            a, b = table["bodies"]
            begin = free_from.get(table["after"], math.inf) if table["after"] else 0.0
            least, when = self._least(a, b, begin)
            out |= {
                f"{table['name']}_clearance_mm": 1e3 * least,
                f"{table['name']}_clearance_time_s": when,
                f"{table['name']}_recontact": math.nan
                if math.isnan(least)
                else float(least <= 0.0),
            }
        return out

    def at(self, told: dict[str, float], free_from: dict[str, float]) -> dict[str, float]:
        """The same at events that came, whose times are ``told`` by their names."""
        out: dict[str, float] = {}
        for table in self.asked:
            a, b = table["bodies"]
            begin = free_from.get(table["after"], math.inf) if table["after"] else 0.0
            for event, when in told.items():
                found = math.nan
                if when >= begin and self.steps:
                    poses = self._motion(a, b, self.steps)(np.array([when]))
                    found = float(outline_distance(self.parts[a], self.parts[b], *poses)[0])
                out[f"{event}_{table['name']}_clearance_mm"] = (
                    1e3 * found if math.isfinite(found) else math.nan
                )
        return out

    def _least(self, a: str, b: str, begin: float) -> tuple[float, float]:
        steps = [step for step in self.steps if step.end > begin]
        if not steps:
            return math.nan, math.nan
        times = np.unique(
            np.concatenate([np.linspace(max(begin, s.start), s.end, _SAMPLES + 1) for s in steps])
        )
        motion = self._motion(a, b, steps)
        least, when = least_clearance(motion, self.parts[a], self.parts[b], times, _COARSE)
        return (least, when) if math.isfinite(least) else (math.nan, math.nan)

    def _motion(self, a: str, b: str, steps: list[Step]) -> Callable[[Array], tuple[Array, Array]]:
        """Attitudes (n, 3, 3) and places (n, 3) of body b seen from a, by times (n,)."""
        ends = np.array([s.end for s in steps])
        first, second = self.vehicle.index[a], self.vehicle.index[b]

        def motion(at: Array) -> tuple[Array, Array]:
            found = []
            for t in at:
                step = steps[min(int(np.searchsorted(ends, t)), len(steps) - 1)]
                s = self.vehicle.state(t, step.dense(t))
                found.append(
                    (s.r[first].T @ s.r[second], s.r[first].T @ (s.x[second] - s.x[first]))
                )
            return np.array([f[0] for f in found]), np.array([f[1] for f in found])

        return motion


def _outlined(body: Table) -> Any:
    """A body as `parts_of` takes it."""
    return SimpleNamespace(
        cg=body["cg"], outline=[SimpleNamespace(**part) for part in body["outline"]]
    )
