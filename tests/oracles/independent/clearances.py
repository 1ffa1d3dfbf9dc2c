"""Minimum distances of a simulation: its motion is stored, and minima are searched at the end by
`oracles.geometry`."""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from oracles.geometry import min_clearance, outline_distance, parts_of
from oracles.independent.case import Table
from oracles.independent.state import Array, Vehicle

_SAMPLES = 8  # distances per step, before refinement
_COARSE = 400  # distances per simulation, at most


class Step(NamedTuple):
    """Integration step: start and end time, s, and its dense output."""

    start: float
    end: float
    dense: Callable[[float], Array]


class Clearances:
    """Stored motion of a simulation and the clearances requested of it."""

    def __init__(self, requested: list[Table], bodies: dict[str, Table], vehicle: Vehicle):
        self.requested, self.vehicle = requested, vehicle
        self.parts = {table["name"]: _parts(table, bodies) for table in requested}
        self.steps: list[Step] = []

    def step(self, dense: Callable[[float], Array], start: float, end: float) -> None:
        """Store the motion of a step between two times, s, if clearances are requested."""
        if self.requested and end > start:
            self.steps.append(Step(start, end, dense))

    def report(self, free_from: dict[str, float]) -> dict[str, float]:
        """Clearance outcomes by public name, locations left out.

        Parameters
        ----------
        free_from : dict
            Release time, s, by joint.
        """
        out: dict[str, float] = {}
        for table in self.requested:
            a, b = table["bodies"]
            begin = free_from.get(table["after"], math.inf) if table["after"] else 0.0
            minimum, time = self._minimum(table["name"], a, b, begin)
            out |= {
                f"{table['name']}_clearance_mm": 1e3 * minimum,
                f"{table['name']}_clearance_time_s": time,
                f"{table['name']}_recontact": math.nan
                if math.isnan(minimum)
                else float(minimum <= 0.0),
            }
        return out

    def at(self, event_times: dict[str, float], free_from: dict[str, float]) -> dict[str, float]:
        """Clearance outcomes at observed events.

        Parameters
        ----------
        event_times : dict
            Time, s, by event.
        free_from : dict
            Release time, s, by joint.
        """
        out: dict[str, float] = {}
        for table in self.requested:
            a, b = table["bodies"]
            begin = free_from.get(table["after"], math.inf) if table["after"] else 0.0
            for event, time in event_times.items():
                distance = math.nan
                if time >= begin and self.steps:
                    poses = self._motion(a, b, self.steps)(np.array([time]))
                    distance = float(outline_distance(*self.parts[table["name"]], *poses)[0])
                out[f"{event}_{table['name']}_clearance_mm"] = (
                    1e3 * distance if math.isfinite(distance) else math.nan
                )
        return out

    def _minimum(self, name: str, a: str, b: str, begin: float) -> tuple[float, float]:
        """Minimum distance, m, of two bodies from a time on, and its time, s."""
        steps = [step for step in self.steps if step.end > begin]
        if not steps:
            return math.nan, math.nan
        times = np.unique(
            np.concatenate([np.linspace(max(begin, s.start), s.end, _SAMPLES + 1) for s in steps])
        )
        motion = self._motion(a, b, steps)
        minimum, time = min_clearance(motion, *self.parts[name], times, _COARSE)
        return (minimum, time) if math.isfinite(minimum) else (math.nan, math.nan)

    def _motion(self, a: str, b: str, steps: list[Step]) -> Callable[[Array], tuple[Array, Array]]:
        """Relative attitudes (n, 3, 3) and positions (n, 3), m, of body b in axes of body a, as a
        function of times (n,)."""
        ends = np.array([s.end for s in steps])
        first, second = self.vehicle.index[a], self.vehicle.index[b]

        def motion(at: Array) -> tuple[Array, Array]:
            poses = []
            for t in at:
                step = steps[min(int(np.searchsorted(ends, t)), len(steps) - 1)]
                s = self.vehicle.state(t, step.dense(t))
                poses.append(
                    (s.r[first].T @ s.r[second], s.r[first].T @ (s.x[second] - s.x[first]))
                )
            return np.array([pose[0] for pose in poses]), np.array([pose[1] for pose in poses])

        return motion


def _parts(table: Table, bodies: dict[str, Table]) -> tuple[list, list]:
    """Parts of both bodies between which a clearance is measured."""
    (a, b), (of_a, of_b) = table["bodies"], table["outlines"]
    return parts_of(_outlined(bodies[a], of_a)), parts_of(_outlined(bodies[b], of_b))


def _outlined(body: Table, names: Sequence[str]) -> Any:
    """Body with the named parts of its outline (all without names), as `parts_of` takes it."""
    parts = {part["name"] or str(number): part for number, part in enumerate(body["outline"])}
    chosen = [part for name, part in parts.items() if not names or name in names]
    return SimpleNamespace(cg=body["cg"], outline=[SimpleNamespace(**part) for part in chosen])
