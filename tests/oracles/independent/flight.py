"""One case from start to end: stretches between known switches, steps of DOP853, events located as
roots."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import DOP853

from oracles.independent.case import GROUND, read
from oracles.independent.clearances import Clearances
from oracles.independent.conditions import ASIDE, Leaf
from oracles.independent.constraints import Singular
from oracles.independent.loads import GRAIN, Flow
from oracles.independent.motion import Motion
from oracles.independent.outcomes import Follower, at_event, columns, report, vague
from oracles.independent.roots import first_root
from oracles.independent.state import SIZE, Array, State, Vehicle, quaternion_rates
from oracles.independent.watch import Watch

# m, rad, m/s, rad/s: what the joints of the first phase may be violated by at the start
_CONSISTENT = 1e-9
_EDGE = 1e-9  # m beyond the edge of a layer of air at which the next one begins
_ON_EDGE = 1e-12  # Mach and rad beyond the edge of a table that count as on it, which is inside
_MOST_STRETCHES = 10_000
# of the tolerance where there are tables: an estimate of error misses a part of what their knots do
_AT_KNOTS = 0.1


@dataclass
class Flown:
    """How a case ended.

    ``status`` is a label of `sepmc.schema.Status`; ``outcomes`` hold every public column, NaN where
    there is none; ``events`` are pairs of a time, s, and what happened. ``vague`` are outcomes that
    round-off decides: flow angles of a body that hardly moves against the air. ``audit``: steps and
    evaluations taken, largest violation of a constraint (m, rad, and per second), and whether roll
    and pitch may have jumped (yaw near 90 deg). ``reached`` are the earliest and latest time, s, at
    which a peak was as good as reached, by the outcome that tells its time.
    """

    status: str
    outcomes: dict[str, float]
    events: list[tuple[float, str]] = field(default_factory=list)
    audit: dict[str, float] = field(default_factory=dict)
    vague: tuple[str, ...] = ()
    reached: dict[str, tuple[float, float]] = field(default_factory=dict)


Value = Callable[[float, State], float]
Watched = tuple[Value, Callable[[], None]]
Dense = Callable[[float], Array]


class Ended(Exception):
    """The flight ends with a status."""


class IndependentFlight:
    """A case under way."""

    def __init__(self, scene: dict[str, Any], vehicle: Vehicle, rtol: float):
        self.scene, self.vehicle, self.rtol = scene, vehicle, rtol
        self.motion = Motion(scene, vehicle)
        self.joints, self.loads, self.sequence = (
            self.motion.joints,
            self.motion.loads,
            self.motion.sequence,
        )
        self.t, self.end = 0.0, scene["run"]["end_time"]
        self.y = vehicle.start(self.motion.pivot(scene["phase"][0]["joints"]), _swings(scene))
        self.follower = Follower(vehicle)
        # when a joint became free, and the rates of all bodies then
        self.released: dict[str, tuple[float, Array]] = {}
        self.told: dict[str, dict[str, float]] = {}  # outcomes at events that have come
        self.watch = Watch(self.motion, scene["output"])
        self.clearances = Clearances(scene["clearance"], scene["body"], vehicle)
        self.rows = _heights_of_rows(scene["environment"])
        self.steps, self.drift, self.step = 0, 0.0, math.nan

    def state(self, t: float, y: Array) -> State:
        """State of all bodies at time t, s, from the state vector."""
        return self.vehicle.state(t, y)

    def watched(self) -> list[Watched]:
        """Functions that become positive where something happens, and what then does: conditions,
        edges of air and of tables."""
        found: list[Watched] = []
        for leaf in self.sequence.armed():
            if not leaf.on_time:
                found.append((partial(self._excess, leaf), partial(self._reach_threshold, leaf)))
        for flow in self.loads.flows:
            for side in (-1, 1):
                found.append(
                    (
                        partial(self._beyond_layer, flow, side, flow.layer),
                        partial(self._change_layer, flow, side),
                    )
                )
            for i in range(2 * len(flow.coefficients.axes)):
                found.append((partial(self._beyond_table, flow, i), self._leave_table))
        return found

    def _excess(self, leaf: Leaf, t: float, s: State) -> float:
        """How far beyond its threshold a leaf is, from the side it was on; or aside of it."""
        excess = self.motion.value(leaf, t, s)
        if leaf.direction is None:
            return excess
        return leaf.side * excess if leaf.side else abs(excess) - ASIDE * leaf.scale

    def _reach_threshold(self, leaf: Leaf) -> None:
        """What was watched of a leaf has come: its threshold, or a side of it."""
        if leaf.direction is None:
            leaf.met = True
        elif leaf.side:
            leaf.cross()
        else:
            leaf.take_side(self.motion.value(leaf, self.t, self.state(self.t, self.y)))

    def _edges(self) -> Array:
        return self.loads.air.edges if self.loads.air else np.zeros(0)

    def _beyond_layer(self, flow: Flow, side: int, layer: int, t: float, s: State) -> float:
        edge = self._edges()[layer + (side > 0)]
        return side * (self.vehicle.height(t, s, flow.body) - edge) - _EDGE

    def _beyond_table(self, flow: Flow, i: int, t: float, s: State) -> float:
        _, _, mach, alpha, beta = self.loads.flow(t, s, flow)
        return flow.coefficients.beyond(mach, alpha, beta)[i] - _ON_EDGE

    def _leave_table(self) -> None:
        raise Ended("outside-table")

    def _change_layer(self, flow: Flow, by: int) -> None:
        flow.layer += by
        if not 0 <= flow.layer < len(self._edges()) - 1:
            raise Ended("outside-atmosphere")

    def _begin(self) -> None:
        """The joints of the first phase allow the first state, and its air is known."""
        s = self.state(0.0, self.y)
        if not self.motion.constraints.residual(s) <= _CONSISTENT:
            raise Ended("inconsistent-start")
        for flow in self.loads.flows:
            edges, height = self._edges(), self.vehicle.height(0.0, s, flow.body)
            if not edges[0] - _EDGE <= height <= edges[-1] + _EDGE:
                raise Ended("outside-atmosphere")
            flow.layer = min(
                max(int(np.searchsorted(edges, height, side="right")) - 1, 0), len(edges) - 2
            )
            if any(
                self._beyond_table(flow, i, 0.0, s) > 0.0
                for i in range(2 * len(flow.coefficients.axes))
            ):
                raise Ended("outside-table")

    def _project(self) -> None:
        """Bring positions and attitudes, then speeds, back onto the constraints: the least change
        by mass, of some round-off."""
        for what in ("position", "speed"):
            s, y = self.state(self.t, self.y), self.y.reshape(-1, SIZE)
            rows = self.motion.constraints.at(s)
            off = (
                self.motion.constraints.values(s)
                if what == "position"
                else rows.rows @ np.concatenate([s.v, s.w], axis=1).ravel()
            )
            change = rows.unweighted(rows.change(-off))
            if what == "position":
                y[:, 0:3] += change[:, :3]
                y[:, 6:10] += quaternion_rates(y[:, 6:10], change[:, 3:])
                y[:, 6:10] /= np.linalg.norm(y[:, 6:10], axis=1)[:, None]
            else:
                y[:, 3:6], y[:, 10:13] = y[:, 3:6] + change[:, :3], y[:, 10:13] + change[:, 3:]

    def _settle(self) -> None:
        """What happens at this instant, and what the joints hold from now on."""
        if self.motion.constraints.count:
            self._project()
        self.loads.set_stretch(self.t + GRAIN)
        s = self.state(self.t, self.y)
        self._settle_held(s)
        for name in self.joints:
            if (
                not self.sequence.held[name]
                and self.sequence.kinds[0][name]
                and name not in self.released
            ):
                self.released[name] = (self.t, s.w.copy())
        for name, event in self.sequence.told.items():
            if math.isfinite(event.time) and name not in self.told:
                self.told[name] = at_event(self, name)

    def _settle_held(self, s: State) -> None:
        def value(leaf: Leaf) -> float:
            self.motion.hold()
            return self.motion.value(leaf, self.t, s)

        self.sequence.settle(self.t, value)
        self.motion.hold()

    def fly(self) -> str:
        """Fly to the end; returns the status."""
        try:
            self._begin()
            self._settle()
            stretches = 0
            while self.t < self.end:
                stretches += 1
                if stretches > _MOST_STRETCHES:
                    raise Ended("too-many-events")
                self._stretch()
                self._settle()
        except Ended as reason:
            return str(reason)
        except Singular:
            return "singular-joint"
        except np.linalg.LinAlgError:
            return "not-finite"
        return "never-released" if self.sequence.never_released() else "ok"

    def _stretch(self) -> None:
        """Integrate to the next switch, or to the first event."""
        switches = [time for time in self.loads.switches if time > self.t + GRAIN]
        stop = min([self.end, self.sequence.next_time(self.t), *switches])
        self.loads.set_stretch(0.5 * (self.t + stop))
        watched, solver = self.watched(), self._solver(self.t, self.y, stop)
        while solver.status == "running":
            solver.max_step = self._seen(solver)
            solver.step()
            self.steps += 1
            if solver.status == "failed" and self.motion.jammed:
                raise Ended("jammed")
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise Ended("not-finite")
            before, self.step = solver.t_old, solver.t - solver.t_old
            dense, start = (
                solver.dense_output()
                if watched or self.watch.quantities() or self.clearances.asked
                else _nowhere,
                self.y,
            )
            first, time = self._first(watched, dense, before, solver.t)
            if first is not None:
                self.t, self.y = self._located(first[0], dense, before, start, time)
            else:
                self.t, self.y = float(solver.t), solver.y.copy()
            s = self.state(self.t, self.y)
            self.follower.follow(s, self.step)
            self.drift = max(self.drift, self.motion.constraints.residual(s))
            self.watch.step(dense, before, self.t)
            self.clearances.step(dense, before, self.t)
            if self.motion.at(self.t, s) and self.motion.jammed:
                raise Ended("jammed")
            if first is not None:
                also = self._loads_at(time, dense, before)
                first[1]()
                for leaf in also:
                    if not leaf.met and (leaf.side or leaf.direction is None):
                        self._reach_threshold(leaf)
                return

    def _solver(self, t: float, y: Array, stop: float) -> DOP853:
        first = min(self.step, stop - t) if self.step > 0.0 else None
        return DOP853(
            self.motion.derivative,
            t,
            y,
            stop,
            rtol=self.rtol,
            atol=0.01 * self.rtol,
            first_step=first,
        )

    def _seen(self, solver: DOP853) -> float:
        """The longest step in which no body flies by more than one row of a table over height: a
        step sees nothing between its stages."""
        if not len(self.rows):
            return math.inf
        step, now = solver.h_abs, self.state(solver.t, solver.y)
        while step > GRAIN:
            then = self.state(solver.t + step, solver.y + step * solver.f)
            passed = []
            for flow in self.loads.flows:
                speed = max(abs(s.v[flow.body, 1] + self.vehicle.velocity[1]) for s in (now, then))
                height = self.vehicle.height(solver.t, now, flow.body)
                passed.append(np.count_nonzero(np.abs(self.rows - height) < speed * step))
            if max(passed, default=0) <= 1:
                break
            step *= 0.5
        return step

    def _first(
        self, watched: list[Watched], dense: Dense, before: float, after: float
    ) -> tuple[Watched | None, float]:
        """The first of what is watched that happens in a step, and when."""
        first: Watched | None = None
        end = after
        for each in watched:
            root = first_root(partial(self._along, each[0], dense), before, end)
            if root is not None:
                first, end = each, root
        return first, end

    def _loads_at(self, time: float, dense: Dense, before: float) -> list[Leaf]:
        """Loads of joints that have reached their thresholds by a time of a step: all of them
        count, as they are judged before any joint lets go."""
        loads = [
            leaf
            for leaf in self.sequence.armed()
            if leaf.on_load and (leaf.side or leaf.direction is None)
        ]
        values = [partial(self._along, partial(self._excess, leaf), dense) for leaf in loads]
        return [
            leaf
            for leaf, value in zip(loads, values, strict=True)
            if first_root(value, before, time + GRAIN) is not None
        ]

    def _along(self, value: Value, dense: Dense, t: float) -> float:
        """A function of time and state on a step."""
        return value(t, self.state(t, dense(t)))

    def _located(
        self, value: Value, dense: Dense, before: float, start: Array, time: float
    ) -> tuple[float, Array]:
        """Time of a root that a step's interpolation gave, corrected on the integration itself, and
        the state there."""
        y = self._reach(before, start, time)
        width = 1e-3 * self.step
        slope = (
            value(time + width, self.state(time + width, dense(time + width)))
            - value(time, self.state(time, dense(time)))
        ) / width
        for _ in range(4):
            off = value(time, self.state(time, y))
            if not slope > 0.0 or not abs(off) < slope * width or abs(off) < 1e-15 * slope:
                break
            time = max(before, float(time - off / slope))
            y = self._reach(before, start, time)
        return time, y

    def _reach(self, before: float, start: Array, time: float) -> Array:
        """State at a time, integrated from the start of a step."""
        if time <= before:
            return start
        solver = DOP853(
            self.motion.derivative,
            before,
            start,
            time,
            rtol=self.rtol,
            atol=0.01 * self.rtol,
            first_step=time - before,
        )
        while solver.status == "running":
            solver.step()
        return solver.y.copy()


def fly(case: Mapping[str, Any], rtol: float = 1e-12) -> Flown:
    """Fly one fully resolved case.

    Parameters
    ----------
    case : mapping
        Nested like the campaign file, in SI and radians, keys without unit suffix, as
        `sepmc.campaign.Case.to_dict` gives it; what is absent or None has its default.
    rtol : float
        Relative tolerance of DOP853; the absolute one is a hundredth of it in SI units.

    Raises
    ------
    ValueError
        If the case has a key that this flight does not know.
    """
    scene = read(case)
    vehicle, nothing = Vehicle(scene), dict.fromkeys(columns(scene), math.nan)
    if vehicle.fault() or not _is_finite(scene):
        return Flown("invalid-input", nothing)
    vehicle.prepare()
    flight = IndependentFlight(scene, vehicle, rtol * (_AT_KNOTS if _has_tables(scene) else 1.0))
    with np.errstate(all="ignore"):  # what is not finite is told by the status
        status = flight.fly()
    audit = {
        "steps": flight.steps, "evaluations": flight.motion.evaluations, "drift": flight.drift,
        "attitude_singular": float(flight.follower.singular),
    }  # fmt: skip
    if status not in ("ok", "never-released"):
        return Flown(status, nothing, flight.sequence.log, audit)
    return Flown(
        status,
        nothing | report(flight),
        flight.sequence.log,
        audit,
        vague(flight),
        flight.watch.reached(),
    )


def _swings(scene: dict[str, Any]) -> list[tuple[Array, Any, list[str]]]:
    """Rates across joints at the start (rad/s, body axes), the joints' layout points, and the
    bodies that each turns: those that cannot be reached from the ground and the joint's first body
    but through the joint."""
    found, kinds = [], scene["phase"][0]["joints"]
    for name, joint in scene["joint"].items():
        if not any(joint["omega"]):
            continue
        edges = [
            other["bodies"]
            for key, other in scene["joint"].items()
            if key != name and kinds.get(key, "free") != "free"
        ]
        side = {body: body == joint["bodies"][1] for body in [*scene["body"], GROUND]}
        for _ in side:  # as many rounds as a chain can be long
            for a, b in edges:
                side[a] = side[b] = side[a] or side[b]
        turned = [body for body in scene["body"] if side[body]]
        found.append((np.array(joint["omega"], float), joint["point"], turned))
    return found


def _has_tables(scene: dict[str, Any]) -> bool:
    environment = scene["environment"]
    profiles = environment["air"], environment["wind"]["profile"]
    return (
        any(profiles)
        or bool(scene["proximity"])
        or any((body["aerodynamics"] or {}).get("table") for body in scene["body"].values())
    )


def _heights_of_rows(environment: dict[str, Any]) -> Array:
    """Heights, m, of the rows of the tables of air and wind."""
    tables = [table for table in (environment["air"], environment["wind"]["profile"]) if table]
    return np.array([height for table in tables for height in table["altitude"]])


def _nowhere(_: float) -> Array:
    raise AssertionError("nothing is watched in this step")


def _is_finite(node: Any) -> bool:
    """Whether no number of a scene is NaN."""
    if isinstance(node, dict):
        return all(_is_finite(value) for value in node.values())
    if isinstance(node, list | tuple):
        return all(_is_finite(value) for value in node)
    return not (isinstance(node, float) and math.isnan(node))
