"""Schedule of a case: phases, releases, switches; and the simulation through them, the same for
every engine."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from oracles.external_engines import loads
from oracles.external_engines.case import GROUND, Array, Case, Motion
from oracles.external_engines.loads import Mode

INSTANT = 1e-12  # s: events closer together are simultaneous
# stops over a flight at which guards are looked at, so that none rises and falls unseen between two
# distant times
WATCHES = 50
TOUCH = 1e-12  # relative to a limit, or to one: tolerance at which it is reached
# force, moment on the first body; force, moment on the second; axes of the first body
Wrench = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class Guard:
    """Quantity that ends an interval when it rises through zero."""

    kind: str  # stroke, distance, angle, altitude, spring, or force or moment of a joint
    name: str  # of the joint, body or spring
    limit: float

    @property
    def on_load(self) -> bool:
        """True if the quantity is a joint's force or moment."""
        return self.kind in ("force", "moment")

    def value(
        self,
        case: Case,
        motions: dict[str, Motion],
        t: Any,
        fn: Any = math,
        wrenches: dict[str, "Wrench"] | None = None,
    ) -> Any:
        """Value at these motions; for a joint's force or moment, with these wrenches."""
        if self.on_load:
            assert wrenches is not None
            load = wrenches[self.name][2 if self.kind == "force" else 3]
            return fn.sqrt(load @ load) - self.limit
        if self.kind == "spring":
            (spring,) = (s for s in case.data["spring"] if s["name"] == self.name)
            return loads.extension(case, spring, motions, fn)[0] - self.limit
        if self.kind == "altitude":
            side = 1.0 if case.altitude < self.limit else -1.0
            return side * (loads.height_of(case, motions[self.name], t) - self.limit)
        joint = case.joints[self.name]
        a, b = motions[joint.first], motions[joint.second]
        gap = b.point(joint.arm_second) - a.point(joint.arm_first)
        if self.kind == "stroke":
            return joint.apart * (gap @ (a.R @ joint.axes[:, 0])) - self.limit
        if self.kind == "distance":
            return gap @ gap - self.limit**2
        return math.cos(self.limit) - 0.5 * (np.sum(a.R * b.R) - 1.0)  # angle: trace of R_A^T R_B


@dataclass
class Condition:
    """Comparisons (times and guards) joined by any and all; a met comparison stays met."""

    times: list[float] = field(default_factory=list)
    guards: list[Guard] = field(default_factory=list)
    parts: list["Condition"] = field(default_factory=list)
    every: bool = False  # all of the parts, rather than any of them

    def met(self, t: float, hit: set[Guard]) -> bool:
        """True if it is met at time t, s, after the guards in ``hit`` were reached."""
        own = any(t >= x - 1e-12 for x in self.times) or any(g in hit for g in self.guards)
        parts = [p.met(t, hit) for p in self.parts]
        return own or (bool(parts) and (all(parts) if self.every else any(parts)))

    def leaves(self) -> tuple[list[float], list[Guard]]:
        """Times, s, and guards of it and of all its parts."""
        times, guards = list(self.times), list(self.guards)
        for part in self.parts:
            more = part.leaves()
            times, guards = times + more[0], guards + more[1]
        return times, guards


def condition(case: Case, table: dict[str, Any]) -> Condition:
    """Condition of a table of the case."""
    here = Condition()
    if table.get("vertical_speed") is not None or table.get("direction") is not None:
        raise ValueError("other engines fly no condition with a direction or on a vertical speed")
    if table.get("time") is not None:
        here.times.append(table["time"])
    if table.get("spring") is not None:
        raise ValueError("other engines fly no phase that a spring ends")
    if table.get("burn_out") is not None:
        (motor,) = (m for m in case.data["motor"] if m["name"] == table["burn_out"])
        here.times.append(loads.burn_out(motor))
    for key in ("stroke", "distance", "angle", "force", "moment"):
        if table.get(key) is not None:
            here.guards.append(Guard(key, table["joint"], table[key]))
    if table.get("altitude") is not None:
        here.guards.append(Guard("altitude", table["body"], table["altitude"]))
    for key in ("any", "all"):
        if table.get(key):
            here.parts.append(
                Condition(parts=[condition(case, t) for t in table[key]], every=key == "all")
            )
    return here


class Engine(Protocol):
    """Interface of an external engine: set a mode, advance, and report."""

    @abstractmethod
    def switch(self, mode: Mode) -> None:
        """Enter a mode."""

    @abstractmethod
    def advance(self, t_end: float, guards: list[Guard]) -> tuple[float, Guard | None]:
        """Integrate to ``t_end``, or exactly to where the first guard rises through zero. Returns
        the time and the guard."""

    @abstractmethod
    def motions(self) -> dict[str, Motion]:
        """Present motion of every body and of the ground."""

    @abstractmethod
    def wrenches(self) -> dict[str, Wrench]:
        """Present wrenches of every joint on both bodies, each at its own joint point."""


@dataclass
class PeerFlight:
    """What an engine gives of a case; rows are the times asked for, less those after which the
    flight ended.

    Attributes
    ----------
    times : ndarray, shape (n,)
    x, v, w : dict of ndarray, shape (n, 3), by body
        Position and velocity in the frame that moves with the initial velocity, ground axes; body
        rates. SI.
    R : dict of ndarray, shape (n, 3, 3)
    wrench : dict of ndarray, shape (n, 4, 3), by joint
        Force and moment on the first body, then on the second, each at its own copy of the joint
        point, axes of the first body.
    release : dict of float
        When each joint became free; NaN if never.
    at_release : dict of ndarray, shape (4, 3)
        Wrench of each joint at the last instant before it became free.
    """

    times: Array
    x: dict[str, Array]
    v: dict[str, Array]
    R: dict[str, Array]
    w: dict[str, Array]
    wrench: dict[str, Array]
    release: dict[str, float]
    at_release: dict[str, Array]


def kinds_of(case: Case, phase: int) -> dict[str, str]:
    """Kind of each joint in a phase; free if the phase does not name it."""
    return {
        name: case.data["phase"][phase].get("joints", {}).get(name, "free") for name in case.joints
    }


def mode_at(
    case: Case, t_mid: float, kinds: dict[str, str], gone: set[str], motions: dict[str, Motion]
) -> Mode:
    """Mode over the interval around ``t_mid``."""
    motors = {m["name"]: loads.motor_piece(m, t_mid) for m in case.data.get("motor", ())}
    springs = {s["name"]: s["name"] not in gone for s in case.data.get("spring", ())}
    constant = {
        c["name"]: c.get("start", 0.0) <= t_mid < c.get("end", math.inf)
        for c in case.data.get("load", ())
    }
    layers = {}
    if case.environment.get("atmosphere", "us1976") != "none":
        layers = {
            n: loads.layer_at(loads.height_of(case, motions[n], t_mid))
            for n, b in case.bodies.items()
            if b.data.get("aerodynamics")
        }
    return Mode(dict(kinds), motors, springs, constant, layers)


def fly(engine: Engine, case: Case, times: Sequence[float]) -> PeerFlight:
    """Simulate a case with an engine in its initial state, with outputs at ``times`` (s,
    ascending). At a release the outputs are those before it."""
    kinds, phase, t = kinds_of(case, 0), 0, 0.0
    hit: set[Guard] = set()
    gone: set[str] = set()
    letting_go: list[tuple[float, str, str]] = []  # time, joint, kind it goes to
    release = {name: math.nan for name in case.joints}
    at_release = {name: np.full((4, 3), math.nan) for name in case.joints}
    untils = [
        condition(case, p["until"]) if p.get("until") else Condition() for p in case.data["phase"]
    ]
    events = [
        (r["joint"], r.get("to", "free"), condition(case, r["when"]))
        for r in case.data.get("release", ())
    ]
    fixed = [s for m in case.data.get("motor", ()) for s in loads.motor_switches(m)]
    fixed += [
        s for c in case.data.get("load", ()) for s in (c.get("start", 0.0), c.get("end", math.inf))
    ]
    for c in [*untils, *(e[2] for e in events)]:
        fixed += c.leaves()[0]
    watch = [case.end_time * k / WATCHES for k in range(WATCHES + 1)]
    stops = sorted({x for x in [*fixed, *times, *watch] if 0.0 < x <= case.end_time})
    rows: list[tuple[float, dict[str, Motion], dict[str, Wrench]]] = []
    ask = list(times)
    fresh = False  # True if the mode must be set again
    # wrenches before the events of an instant
    arrival: tuple[float, dict[str, Wrench]] = (-1.0, {})
    engine.switch(_next_mode(case, t, stops, kinds, gone, engine.motions()))
    while True:
        while ask and t >= ask[0] - 1e-13:
            if fresh:
                engine.switch(_next_mode(case, t, stops, kinds, gone, engine.motions()))
                fresh = False
            rows.append((ask.pop(0), engine.motions(), engine.wrenches()))
        if t >= case.end_time - 1e-13:
            break
        if t > arrival[0] + INSTANT:
            arrival = (t, engine.wrenches())
        # events that have occurred
        going = [item for item in letting_go if item[0] <= t]
        letting_go = [item for item in letting_go if item[0] > t]
        while phase < len(untils) - 1 and untils[phase].met(t, hit):
            phase += 1
            going += _changes(case, kinds, kinds_of(case, phase), t, letting_go)
        for item in [e for e in events if e[2].met(t, hit)]:
            events.remove(item)
            going += _changes(case, kinds, {**kinds, item[0]: item[1]}, t, letting_go)
        for _, name, kind in going:
            if kind == "free" and kinds[name] != "free":
                release[name], at_release[name] = t, np.array(arrival[1][name])
        for _, name, kind in going:
            kinds[name], fresh = kind, True
        # fly on
        mode = _next_mode(case, t, stops, kinds, gone, engine.motions())
        engine.switch(mode)
        fresh = False
        guards = untils[phase].leaves()[1] + [g for e in events for g in e[2].leaves()[1]]
        for s in case.data.get("spring", ()):
            if mode.springs[s["name"]] and s.get("stroke", math.inf) < math.inf:
                guards.append(Guard("spring", s["name"], s["stroke"]))
        guards = [g for g in dict.fromkeys(guards) if g not in hit]
        already = [
            g
            for g in guards
            if g.value(case, engine.motions(), t, wrenches=engine.wrenches())
            >= -TOUCH * max(1.0, g.limit)
        ]
        if already:
            hit.update(already)
            gone.update(g.name for g in already if g.kind == "spring")
            continue
        t_next = min([x for x in stops if x > t + INSTANT] + [item[0] for item in letting_go])
        t, crossed = engine.advance(t_next, guards)
        if crossed is not None:
            hit.add(crossed)
            if crossed.kind == "spring":
                gone.add(crossed.name)
        fresh = crossed is not None and crossed.kind == "spring"
    return _collect(rows, release, at_release)


def _next_mode(
    case: Case,
    t: float,
    stops: list[float],
    kinds: dict[str, str],
    gone: set[str],
    motions: dict[str, Motion],
) -> Mode:
    after = [x for x in stops if x > t + INSTANT] or [case.end_time + 1.0]
    return mode_at(case, 0.5 * (t + after[0]), kinds, gone, motions)


def _changes(
    case: Case,
    old: dict[str, str],
    new: dict[str, str],
    t: float,
    later: list[tuple[float, str, str]],
) -> list[tuple[float, str, str]]:
    """Joints that are released now; those with a delay go to ``later``, those that fail nowhere."""
    now: list[tuple[float, str, str]] = []
    for name, kind in new.items():
        joint = case.joints[name]
        if sum(case.held(name, kind)) < sum(case.held(name, old[name])) and not joint.fails:
            later[:] = [item for item in later if item[1] != name]
            (later if joint.delay > 0.0 else now).append((t + joint.delay, name, kind))
    return now


def _collect(
    rows: list[tuple[float, dict[str, Motion], dict[str, Wrench]]],
    release: dict[str, float],
    at_release: dict[str, Array],
) -> PeerFlight:
    bodies = [n for n in rows[0][1] if n != GROUND]

    def column(part: str) -> dict[str, Array]:
        return {n: np.array([getattr(row[1][n], part) for row in rows]) for n in bodies}

    wrench = {n: np.array([row[2][n] for row in rows]) for n in release}
    return PeerFlight(
        np.array([r[0] for r in rows]),
        column("x"),
        column("v"),
        column("R"),
        column("w"),
        wrench,
        release,
        at_release,
    )
