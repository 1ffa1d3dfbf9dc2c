"""Simulation of one case: intervals between known switches, steps of DOP853, events located as
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
from oracles.independent.formulas import AT_ONCE, Key, Undefined
from oracles.independent.loads import GRAIN, Flow
from oracles.independent.monitor import Monitor
from oracles.independent.motion import Motion
from oracles.independent.outcomes import Follower, at_event, columns, indeterminate, report
from oracles.independent.roots import first_root
from oracles.independent.state import SIZE, Array, State, Vehicle, quaternion_rates

# m, rad, m/s, rad/s: largest violation of the first phase's joints at the start
_CONSISTENT = 1e-9
_EDGE = 1e-9  # m beyond the edge of an atmosphere layer at which the next one begins
_ON_EDGE = 1e-12  # Mach and rad beyond the edge of a table that count as on it, which is inside
_MAX_INTERVALS = 10_000
_MAX_PASSAGES = 8
_AHEAD = 1e-5  # s after which the side of a kink that is at zero is read
# factor on the tolerance where there are tables: error estimates miss a part of the knots' error
_AT_KNOTS = 0.1


@dataclass
class CaseResult:
    """Result of a case.

    ``status`` is a label of `sepmc.schema.Status`; ``outcomes`` has every public column, NaN where
    there is none; ``events`` are pairs of a time, s, and a text. ``indeterminate`` are outcomes
    decided by round-off, such as flow angles of a body that hardly moves against the air.
    ``audit``: steps and evaluations, largest constraint violation (m, rad, and per second), and
    whether roll and pitch may have jumped (yaw near 90 deg). ``reached`` are the earliest and
    latest time, s, at which a peak was reached within 1e-11, by the name of its time outcome.
    """

    status: str
    outcomes: dict[str, float]
    events: list[tuple[float, str]] = field(default_factory=list)
    audit: dict[str, float] = field(default_factory=dict)
    indeterminate: tuple[str, ...] = ()
    reached: dict[str, tuple[float, float]] = field(default_factory=dict)


Value = Callable[[float, State], float]
EventFunction = tuple[Value, Callable[[], None]]
Dense = Callable[[float], Array]


class EndOfSimulation(Exception):
    """Raised to end a simulation with a status."""


class Simulation:
    """Simulation of a case in progress."""

    def __init__(self, scene: dict[str, Any], vehicle: Vehicle, rtol: float):
        self.scene, self.vehicle, self.rtol = scene, vehicle, rtol
        self.motion = Motion(scene, vehicle)
        self.joints, self.loads, self.sequence = (
            self.motion.joints,
            self.motion.loads,
            self.motion.sequence,
        )
        self.t, self.end = 0.0, scene["run"]["end_time"]
        self.y = vehicle.start(
            self.motion.pivot(scene["phase"][0]["joints"]), _initial_swings(scene)
        )
        self.y = np.append(self.y, self.loads.formulas.start())
        self.follower = Follower(vehicle)
        # release time, s, of each joint, and angular rates of all bodies then
        self.released: dict[str, tuple[float, Array]] = {}
        # time, s, from which a joint constrains no more than a kind it is released to in part
        self.loosened: dict[tuple[str, str], float] = {}
        self.observed: dict[str, dict[str, float]] = {}  # outcomes at observed events
        self.monitor = Monitor(self.motion, scene["output"])
        self.clearances = Clearances(scene["clearance"], scene["body"], vehicle)
        self.rows = _heights_of_rows(scene["environment"])
        self.steps, self.drift, self.step = 0, 0.0, math.nan
        self.passages = 0  # of kinks that had been passed at the same instant

    def state(self, t: float, y: Array) -> State:
        """State of all bodies at time t, s, from the state vector."""
        return self.vehicle.state(t, y)

    def event_functions(self) -> list[EventFunction]:
        """Event functions, which become positive at an event, and their actions: conditions, edges
        of atmosphere layers and of tables."""
        functions: list[EventFunction] = []
        for leaf in self.sequence.armed():
            if not leaf.on_time:
                functions.append(
                    (partial(self._excess, leaf), partial(self._reach_threshold, leaf))
                )
        formulas = self.loads.formulas
        for key in formulas.modes:
            functions.append((partial(formulas.excess, key), partial(self._pass_kink, key)))
        for spring in self.loads.springs:
            functions += spring.kinks()
        functions += self.loads.slack_kinks()
        for flow in self.loads.flows:
            for side in (-1, 1):
                functions.append(
                    (
                        partial(self._beyond_layer, flow, side, flow.layer),
                        partial(self._change_layer, flow, side),
                    )
                )
            for i in range(2 * len(flow.coefficients.axes)):
                functions.append((partial(self._beyond_table, flow, i), self._leave_table))
        return functions

    def _excess(self, leaf: Leaf, t: float, s: State) -> float:
        """Excess of a comparison over its threshold, on the side it was on; or distance beyond the
        tolerance band."""
        excess = self.motion.value(leaf, t, s)
        if leaf.direction is None:
            return excess
        return leaf.side * excess if leaf.side else abs(excess) - ASIDE * leaf.scale

    def _reach_threshold(self, leaf: Leaf) -> None:
        """Action of a comparison: its threshold is reached, or a side of it is taken."""
        if leaf.direction is None:
            leaf.met = True
        elif leaf.side:
            leaf.cross()
        else:
            leaf.take_side(self.motion.value(leaf, self.t, self.state(self.t, self.y)))

    def _pass_kink(self, key: Key) -> None:
        """Action of a kink of a formula; one that was at zero takes the side it is on."""
        formulas = self.loads.formulas
        is_again = self.t - formulas.passed.get(key, -math.inf) < AT_ONCE
        # one is passed to and fro where others pass at the same instant, one after the other
        self.passages = self.passages + 1 if is_again else 0
        if self.passages > _MAX_PASSAGES:
            raise EndOfSimulation("too-many-events")
        formulas.passed[key] = self.t
        if formulas.modes[key]:
            formulas.switch(key)
        else:
            value, _ = formulas.switching(self.t, self.state(self.t, self.y))[key]
            formulas.modes[key] = int(math.copysign(1.0, value))

    def _set_modes(self) -> None:
        """Set the sides of the kinks of formulas that are not known."""
        if self.loads.formulas.used:
            self.loads.formulas.set_modes(
                self.t,
                self.state(self.t, self.y),
                lambda: self.state(self.t + _AHEAD, self._reach(self.t, self.y, self.t + _AHEAD)),
                _AHEAD,
            )

    def _edges(self) -> Array:
        """Heights, m, of the edges of the atmosphere layers."""
        return self.loads.air.edges if self.loads.air else np.zeros(0)

    def _beyond_layer(self, flow: Flow, side: int, layer: int, t: float, s: State) -> float:
        """Height, m, beyond an edge of a layer."""
        edge = self._edges()[layer + (side > 0)]
        return side * (self.vehicle.height(t, s, flow.body) - edge) - _EDGE

    def _beyond_table(self, flow: Flow, i: int, t: float, s: State) -> float:
        """Distance beyond an edge of a coefficient table."""
        _, _, mach, alpha, beta = self.loads.flow(t, s, flow)
        return flow.coefficients.beyond(mach, alpha, beta)[i] - _ON_EDGE

    def _leave_table(self) -> None:
        """End the simulation outside of a table."""
        raise EndOfSimulation("outside-table")

    def _change_layer(self, flow: Flow, by: int) -> None:
        """Enter the next layer of the atmosphere."""
        flow.layer += by
        if not 0 <= flow.layer < len(self._edges()) - 1:
            raise EndOfSimulation("outside-atmosphere")

    def _begin(self) -> None:
        """Check the initial state against the joints of the first phase, and find its atmosphere
        layers."""
        s = self.state(0.0, self.y)
        if not self.motion.constraints.residual(s) <= _CONSISTENT:
            raise EndOfSimulation("inconsistent-start")
        for spring in self.loads.springs:
            spring.begin(s)
        for flow in self.loads.flows:
            edges, height = self._edges(), self.vehicle.height(0.0, s, flow.body)
            if not edges[0] - _EDGE <= height <= edges[-1] + _EDGE:
                raise EndOfSimulation("outside-atmosphere")
            flow.layer = min(
                max(int(np.searchsorted(edges, height, side="right")) - 1, 0), len(edges) - 2
            )
            if any(
                self._beyond_table(flow, i, 0.0, s) > 0.0
                for i in range(2 * len(flow.coefficients.axes))
            ):
                raise EndOfSimulation("outside-table")

    def _project(self) -> None:
        """Project positions and attitudes, then speeds, onto the constraints, by the smallest
        change in the mass metric."""
        for what in ("position", "speed"):
            s = self.state(self.t, self.y)
            y = self.y[: self.vehicle.n * SIZE].reshape(-1, SIZE)
            rows = self.motion.constraints.at(s)
            violation = (
                self.motion.constraints.values(s)
                if what == "position"
                else rows.rows @ np.concatenate([s.v, s.w], axis=1).ravel()
            )
            change = rows.unweighted(rows.change(-violation))
            if what == "position":
                y[:, 0:3] += change[:, :3]
                y[:, 6:10] += quaternion_rates(y[:, 6:10], change[:, 3:])
                y[:, 6:10] /= np.linalg.norm(y[:, 6:10], axis=1)[:, None]
            else:
                y[:, 3:6], y[:, 10:13] = y[:, 3:6] + change[:, :3], y[:, 10:13] + change[:, 3:]

    def _process_events(self) -> None:
        """Process the events of this instant and note releases and observed events."""
        if self.motion.constraints.count:
            self._project()
        self.loads.set_interval(self.t + GRAIN)
        s = self.state(self.t, self.y)
        self.loads.formulas.sample(self.t, s)
        self._update_constraints(s)
        for name in self.joints:
            if (
                not self.sequence.active[name]
                and self.sequence.kinds[0][name]
                and name not in self.released
            ):
                self.released[name] = (self.t, s.w.copy())
        instants = self.loads.formulas.instants
        instants |= {("joint", name): time for name, (time, _) in self.released.items()}
        observed = self.sequence.observed.items()
        instants |= {("event", name): event.time for name, event in observed}
        self._set_modes()
        self.loads.set_slack(self.t, self.state(self.t, self.y))
        for pair in self.sequence.loosened():
            self.loosened.setdefault(pair, self.t)
        for name, event in self.sequence.observed.items():
            if math.isfinite(event.time) and name not in self.observed:
                self.observed[name] = at_event(self, name)

    def _update_constraints(self, s: State) -> None:
        """Process events, then update the constraints."""

        def value(leaf: Leaf) -> float:
            self.motion.update()
            return self.motion.value(leaf, self.t, s)

        self.sequence.process(self.t, value)
        self.motion.update()

    def simulate(self) -> str:
        """Simulate to the end; returns the status label."""
        try:
            self._begin()
            self._process_events()
            intervals = 0
            while self.t < self.end:
                intervals += 1
                if intervals > _MAX_INTERVALS:
                    raise EndOfSimulation("too-many-events")
                self._integrate()
                self._process_events()
        except EndOfSimulation as reason:
            return str(reason)
        except Singular:
            return "singular-joint"
        except np.linalg.LinAlgError:
            return "not-finite"
        except Undefined:
            return "undefined-formula"
        return "never-released" if self.sequence.never_released() else "ok"

    def _integrate(self) -> None:
        """Integrate to the next switch, or to the first event."""
        switches = [time for time in self.loads.switches if time > self.t + GRAIN]
        stop = min([self.end, self.sequence.next_time(self.t), *switches])
        self.loads.set_interval(0.5 * (self.t + stop))
        event_functions, solver = self.event_functions(), self._solver(self.t, self.y, stop)
        while solver.status == "running":
            solver.max_step = self._longest_step(solver)
            solver.step()
            self.steps += 1
            if solver.status == "failed" and self.motion.undefined:
                raise EndOfSimulation("undefined-formula")
            if solver.status == "failed" and self.motion.jammed:
                raise EndOfSimulation("jammed")
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise EndOfSimulation("not-finite")
            before, self.step = solver.t_old, solver.t - solver.t_old
            dense, start = (
                solver.dense_output()
                if event_functions or self.monitor.quantities() or self.clearances.requested
                else _no_dense_output,
                self.y,
            )
            first, time = self._first_event(event_functions, dense, before, solver.t)
            if first is not None:
                self.t, self.y = self._locate(first[0], dense, before, start, time)
            else:
                self.t, self.y = float(solver.t), solver.y.copy()
            s = self.state(self.t, self.y)
            self.follower.follow(s, self.step)
            self.loads.last = {"pitch": self.follower.pitch, "roll": self.follower.roll}
            self.drift = max(self.drift, self.motion.constraints.residual(s))
            self.monitor.step(dense, before, self.t)
            self.clearances.step(dense, before, self.t)
            if self.motion.at(self.t, s) and self.motion.jammed:
                raise EndOfSimulation("jammed")
            if first is not None:
                also = self._loads_at(time, dense, before)
                first[1]()
                for leaf in also:
                    if not leaf.met and (leaf.side or leaf.direction is None):
                        self._reach_threshold(leaf)
                return

    def _solver(self, t: float, y: Array, stop: float) -> DOP853:
        """DOP853 from a state, with the last step as its first."""
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

    def _longest_step(self, solver: DOP853) -> float:
        """Longest step, s, in which no body passes more than one row of a table over height: events
        inside one step are not detected otherwise."""
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

    def _first_event(
        self, event_functions: list[EventFunction], dense: Dense, before: float, after: float
    ) -> tuple[EventFunction | None, float]:
        """First event function that becomes positive in a step, and its time, s."""
        first: EventFunction | None = None
        end = after
        for each in event_functions:
            root = first_root(partial(self._value, each[0], dense), before, end)
            if root is not None:
                first, end = each, root
        return first, end

    def _loads_at(self, time: float, dense: Dense, before: float) -> list[Leaf]:
        """Joint loads that have reached their thresholds by a time of a step: all count, for they
        are compared before any joint is released."""
        loads = [
            leaf
            for leaf in self.sequence.armed()
            if leaf.on_load and (leaf.side or leaf.direction is None)
        ]
        values = [partial(self._value, partial(self._excess, leaf), dense) for leaf in loads]
        return [
            leaf
            for leaf, value in zip(loads, values, strict=True)
            if first_root(value, before, time + GRAIN) is not None
        ]

    def _value(self, value: Value, dense: Dense, t: float) -> float:
        """Value of an event function at a time of a step."""
        return value(t, self.state(t, dense(t)))

    def _locate(
        self, value: Value, dense: Dense, before: float, start: Array, time: float
    ) -> tuple[float, Array]:
        """Event time, s, refined on re-integrated states instead of the interpolant, and the state
        vector there."""
        y = self._reach(before, start, time)
        width = 1e-3 * self.step
        slope = (
            value(time + width, self.state(time + width, dense(time + width)))
            - value(time, self.state(time, dense(time)))
        ) / width
        for _ in range(4):
            violation = value(time, self.state(time, y))
            if (
                not slope > 0.0
                or not abs(violation) < slope * width
                or abs(violation) < 1e-15 * slope
            ):
                break
            time = max(before, float(time - violation / slope))
            y = self._reach(before, start, time)
        return time, y

    def _reach(self, before: float, start: Array, time: float) -> Array:
        """State vector at a time, integrated from the start of a step."""
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


def simulate(case: Mapping[str, Any], rtol: float = 1e-12) -> CaseResult:
    """Simulate one fully resolved case.

    Parameters
    ----------
    case : mapping
        Nested like the campaign file, in SI and radians, keys without unit suffix, as
        `sepmc.campaign.Case.to_dict` returns it; absent or None means the default.
    rtol : float
        Relative tolerance of DOP853; the absolute one is a hundredth of it in SI units.

    Raises
    ------
    ValueError
        If the case has an unknown key.
    """
    scene = read(case)
    vehicle, no_outcomes = Vehicle(scene), dict.fromkeys(columns(scene), math.nan)
    if vehicle.fault() or not _is_finite(scene):
        return CaseResult("invalid-input", no_outcomes)
    vehicle.prepare()
    flight = Simulation(scene, vehicle, rtol * (_AT_KNOTS if _has_tables(scene) else 1.0))
    with np.errstate(all="ignore"):  # non-finite values end in a status
        status = flight.simulate()
    audit = {
        "steps": flight.steps, "evaluations": flight.motion.evaluations, "drift": flight.drift,
        "attitude_singular": float(flight.follower.singular),
    }  # fmt: skip
    if status not in ("ok", "never-released"):
        return CaseResult(status, no_outcomes, flight.sequence.log, audit)
    try:
        outcomes = report(flight)
    except Undefined:
        return CaseResult("undefined-formula", no_outcomes, flight.sequence.log, audit)
    return CaseResult(
        status,
        no_outcomes | outcomes,
        flight.sequence.log,
        audit,
        indeterminate(flight),
        flight.monitor.reached(),
    )


def _initial_swings(scene: dict[str, Any]) -> list[tuple[Array, Any, list[str]]]:
    """Initial rates across joints (rad/s, body axes), the layout points of the joints, and the
    bodies that each turns: those connected to the joint's first body and to the ground only through
    the joint."""
    swings, kinds = [], scene["phase"][0]["joints"]
    for name, joint in scene["joint"].items():
        if not any(joint["omega"]):
            continue
        edges = [
            other["bodies"]
            for key, other in scene["joint"].items()
            if key != name and kinds.get(key, "free") != "free"
        ]
        side = {body: body == joint["bodies"][1] for body in [*scene["body"], GROUND]}
        for _ in side:  # one round for each link of the longest chain
            for a, b in edges:
                side[a] = side[b] = side[a] or side[b]
        turned = [body for body in scene["body"] if side[body]]
        swings.append((np.array(joint["omega"], float), joint["point"], turned))
    return swings


def _has_tables(scene: dict[str, Any]) -> bool:
    """True if a spline over height, Mach number, angles or distance acts."""
    environment = scene["environment"]
    profiles = environment["air"], environment["wind"]["profile"]
    return (
        any(profiles)
        or bool(scene["proximity"])
        or any((body["aerodynamics"] or {}).get("table") for body in scene["body"].values())
    )


def _heights_of_rows(environment: dict[str, Any]) -> Array:
    """Heights, m, of the rows of the air and wind tables."""
    tables = [table for table in (environment["air"], environment["wind"]["profile"]) if table]
    return np.array([height for table in tables for height in table["altitude"]])


def _no_dense_output(_: float) -> Array:
    """Dense output of a step of which none is needed."""
    raise AssertionError("no dense output in this step")


def _is_finite(node: Any) -> bool:
    """True if no number of a scene is NaN."""
    if isinstance(node, dict):
        return all(_is_finite(value) for value in node.values())
    if isinstance(node, list | tuple):
        return all(_is_finite(value) for value in node)
    return not (isinstance(node, float) and math.isnan(node))
