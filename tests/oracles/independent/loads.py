"""Loads on the bodies: gravity, air, motors, springs and constant loads."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.independent.air import Coefficients, Increments, Standard, Tabled, Wind, curve
from oracles.independent.case import COEFFICIENTS, Table
from oracles.independent.formulas import Formulas
from oracles.independent.joints import Joint, pair
from oracles.independent.state import Array, State, Vehicle, cross
from sepmc.validation.classical_loads import EARTH_RADIUS

GRAIN = 1e-12  # s: times closer than this are equal
_PAST_ROW = 1e-10  # m beyond a row of a force table, m/s beyond rest: it is passed
_PAST_ZERO = 1e-10  # of its initial force, or of 1 N, beyond zero: a spring is slack, or no longer


class Motor:
    """Motor: force and moment for unit thrust, body axes, and thrust over time."""

    def __init__(self, m: Table, vehicle: Vehicle):
        self.table, self.body = m, vehicle.index[m["body"]]
        clock, radius, (dy, dz) = m["clock"], m["radius"], m["offset"]
        self.nozzle = Rotation.from_euler("XY", [clock, -m["cant"]]).as_matrix()
        self.arm = vehicle.arm(
            m["body"], (m["station"], -radius * math.sin(clock) + dy, radius * math.cos(clock) + dz)
        )
        self.force, self.moment = self.pointing(m["deflection"], m["deflection_clock"])
        # trigger of the ignition, if any
        self.waits: Table = m["ignition"] if isinstance(m["ignition"], dict) else {}
        self.start = math.inf if self.waits else m["ignition"] + m["delay"]

    def pointing(self, b: float, p: float) -> tuple[Array, Array]:
        """Force and moment for unit thrust at a deflection and its clock angle, rad."""
        force = self.nozzle @ (
            math.cos(b),
            -math.sin(b) * math.sin(p),
            math.sin(b) * math.cos(p),
        )
        return force, cross(self.arm, force)

    def ignite(self, t: float) -> None:
        """Ignite at time t, s, plus the delays."""
        self.start = t + self.waits["delay"] + self.table["delay"]

    @property
    def end(self) -> float:
        """Burn-out time, s."""
        return self.start + self.table["burn"]

    @property
    def switches(self) -> list[float]:
        """Times, s, at which the thrust is not smooth."""
        knots = (self.table["profile"] or {"time": ()})["time"]
        return [self.start, self.end, *(self.start + knot for knot in knots)]

    def _burning(self, since: float, profile: Callable[[float], float]) -> float:
        """Thrust, N, before burn-out, at a time since ignition, s."""
        build_up = self.table["build_up"]
        return (
            self.table["thrust"]
            * profile(since)
            * (-math.expm1(-since / build_up) if build_up > 0.0 else 1.0)
        )

    def thrust(self, middle: float) -> Callable[[float], float] | None:
        """Thrust, N, as a function of time in the interval around ``middle``, which contains no
        switch; None if there is none."""
        tail = self.table["tail_off"]
        if middle < self.start or (middle >= self.end and tail <= 0.0):
            return None
        if middle < self.end:
            profile = self._profile(middle - self.start)
            return lambda t: self._burning(t - self.start, profile)
        burn = self.table["burn"]
        last = self._burning(burn, self._profile(burn - GRAIN))
        return lambda t: last * math.exp(-(t - self.end) / tail)

    def _profile(self, since: float) -> Callable[[float], float]:
        """Linear piece of the profile around a time since ignition; zero before and after its
        rows."""
        if not self.table["profile"]:
            return lambda _: 1.0
        times, fractions = self.table["profile"]["time"], self.table["profile"]["fraction"]
        if since < times[0] or since >= times[-1]:
            return lambda _: 0.0
        k = int(np.searchsorted(times, since, side="right")) - 1
        slope = (fractions[k + 1] - fractions[k]) / (times[k + 1] - times[k])
        return lambda x: fractions[k] + slope * (x - times[k])


class Spring:
    """Spring between a point of a first body and one of a second, along their line or along an axis
    of the first."""

    def __init__(self, table: Table, vehicle: Vehicle):
        self.name, self.table, self.spent = table["name"], table, False
        self.a, self.b = (vehicle.index[body] for body in table["bodies"])
        points = [
            table["point"],
            table["second_point"] if table["second_point"] is not None else table["point"],
        ]
        self.arm_a, self.arm_b = (
            vehicle.arm(body, point) for body, point in zip(table["bodies"], points, strict=True)
        )
        self.axis = (
            None
            if table["axis"] is None
            else np.array(table["axis"], float) / np.linalg.norm(table["axis"])
        )
        self.curve, self.rows, self.span = None, np.zeros(0), 0
        # of the force of the table, as the extension shrinks
        self.return_factor, self.shrinks = 1.0, False
        if table["table"]:
            known = table["table"]
            self.rows = np.array(known["extension"], float)
            self.curve = curve(self.rows, known["force"], known["interpolation"])
            self.return_factor = known["return_factor"]
        # without the force below zero of one that only pushes
        self.is_slack, self.past_zero = False, _PAST_ZERO * (1.0 + abs(table["force"]))
        gap = (np.array(points[1], float) - np.array(points[0], float)) * (-1.0, 1.0, 1.0)
        self.start = float(np.linalg.norm(gap) if self.axis is None else gap @ self.axis)

    def line(self, s: State) -> tuple[Array, float, float, Array]:
        """Direction, extension from the start, m, its rate, m/s, and d; ground axes."""
        d, rate = pair(s, self.a, self.b, self.arm_a, self.arm_b)
        if self.axis is None:
            length = float(np.sqrt(d @ d))
            return d / length, length - self.start, float(rate @ d) / length, d
        e, turning = s.r[self.a] @ self.axis, s.r[self.a] @ cross(s.w[self.a], self.axis)
        return e, float(d @ e) - self.start, float(rate @ e + d @ turning), d

    def extension(self, s: State) -> float:
        """Extension from the start, m."""
        return self.line(s)[1]

    def begin(self, s: State) -> None:
        """Set the span of the table that the spring starts in, and whether it shrinks."""
        _, extension, rate, _ = self.line(s)
        self.span = int(np.searchsorted(self.rows, extension, side="right"))
        self.shrinks = rate < -_PAST_ROW

    def kinks(self) -> list[tuple[Callable[[float, State], float], Callable[[], None]]]:
        """Functions that become positive where the force of the table is not smooth, and what
        changes there."""
        if self.curve is None:
            return []
        k, sign = self.span, 1.0 if self.shrinks else -1.0
        kinks = [(lambda _, s: sign * self.line(s)[2] - _PAST_ROW, self._turn)]
        if k < len(self.rows):
            top = self.rows[k]
            kinks.append((lambda _, s: self.extension(s) - top - _PAST_ROW, partial(self._move, 1)))
        if k > 0:
            base = self.rows[k - 1]
            kinks.append(
                (lambda _, s: base - self.extension(s) - _PAST_ROW, partial(self._move, -1))
            )
        return kinks

    def _turn(self) -> None:
        """Note that the extension begins to shrink, or ceases to."""
        self.shrinks = not self.shrinks

    def _move(self, by: int) -> None:
        """Move to the next span."""
        self.span += by

    def tabled(self, extension: float) -> float:
        """Force of the table at an extension, N; that of an end row beyond the ends."""
        if self.curve is None:
            return 0.0
        value = float(self.curve(min(max(extension, self.rows[0]), self.rows[-1])))
        return value * (self.return_factor if self.shrinks else 1.0)

    def size(self, s: State, number: Callable[[str, float], float]) -> float:
        """Force, N, below zero too where the spring only pushes; ``number`` gives the numbers that
        signals may give."""
        _, extension, rate, _ = self.line(s)
        push, stiffness, damping, factor = (
            number(f"spring.{self.name}.{key}", self.table[key])
            for key in ("force", "stiffness", "damping", "factor")
        )
        return factor * (push - stiffness * extension - damping * rate + self.tabled(extension))

    def push(
        self, s: State, force: Array, moment: Array, number: Callable[[str, float], float]
    ) -> None:
        """Add the spring's loads to forces (n + 1, 3), ground axes, and moments (n + 1, 3) about
        the mass centres, body axes; ``number`` gives those that signals may give."""
        if self.is_slack:
            return
        e, _, _, d = self.line(s)
        size = self.size(s, number)
        act(
            s,
            self.a,
            self.b,
            self.arm_a,
            self.arm_b,
            d if self.axis is not None else None,
            size * e,
            force,
            moment,
        )


def act(
    s: State,
    a: int,
    b: int,
    arm_a: Array,
    arm_b: Array,
    across: Array | None,
    on_b: Array,
    force: Array,
    moment: Array,
) -> None:
    """Add a force on body b at its point, and the opposite on body a: at its own point, or, if
    ``across`` is d, on the line through the point of b."""
    force[b] += on_b
    force[a] -= on_b
    arm = s.r[a] @ arm_a if across is None else s.r[a] @ arm_a + across
    moment[b] += s.r[b].T @ cross(s.r[b] @ arm_b, on_b)
    moment[a] -= s.r[a].T @ cross(arm, on_b)


@dataclass
class Constant:
    """Constant force and moment over an interval of time."""

    table: Table
    body: int
    arm: Array

    def acts(self, middle: float) -> bool:
        """True if the load acts in the interval around a time, s."""
        return self.table["start"] <= middle < self.table["end"]

    def wrench(self, s: State, number: Callable[[str, float], float]) -> tuple[Array, Array]:
        """Force, N, and moment about the mass centre, N m, body axes; ``number`` gives those that
        signals may give."""
        path = f"load.{self.table['name']}"
        force, moment = (
            np.array(
                [
                    number(f"{path}.{key}.{axis}", x)
                    for axis, x in zip("xyz", self.table[key], strict=True)
                ]
            )
            for key in ("force", "moment")
        )
        if self.table["frame"] == "ground":
            force, moment = s.r[self.body].T @ force, s.r[self.body].T @ moment
        return force, moment + cross(self.arm, force)


class Flow:
    """Aerodynamic state of a body: its coefficients, reference point and atmosphere layer."""

    def __init__(self, name: str, table: Table, vehicle: Vehicle, signals: list[str]):
        self.name, self.body, self.table = name, vehicle.index[name], table
        self.coefficients = Coefficients(table, signals)
        known = {term for key in COEFFICIENTS for term in table[key] or ()}
        self.signals = [name for name in signals if name in known]
        self.arm = (
            np.zeros(3)
            if table["moment_point"] is None
            else vehicle.arm(name, table["moment_point"])
        )
        self.layer = 0
        self.increments: list[tuple[Joint, Increments]] = []


class Loads:
    """All loads of a case. `set_interval` selects the loads that act between two switches;
    `on_bodies` evaluates them at a state."""

    def __init__(self, scene: Table, vehicle: Vehicle, joints: dict[str, Joint]):
        self.vehicle, self.environment = vehicle, scene["environment"]
        self.wind = Wind(self.environment["wind"])
        self.joints = joints
        # pitch and roll at the last step, rad
        self.last = {
            key: np.full(vehicle.n, float(scene["initial"][key])) for key in ("pitch", "roll")
        }
        self.formulas = Formulas(scene, vehicle, self._quantity)
        for table in scene["motor"]:  # the signal is a factor then
            if f"motor.{table['name']}.thrust" in self.formulas.driven:
                table["thrust"] = 1.0
        self.motors = [Motor(table, vehicle) for table in scene["motor"]]
        self.springs = [Spring(table, vehicle) for table in scene["spring"]]
        self.constants = [self._constant(table) for table in scene["load"]]
        self.air = None if self.environment["atmosphere"] == "none" else self._air()
        flows = {
            name: Flow(name, body["aerodynamics"], vehicle, list(self.formulas.signals))
            for name, body in scene["body"].items()
            if body["aerodynamics"]
        }
        for table in scene["proximity"]:
            if table["body"] in flows:
                flows[table["body"]].increments.append((joints[table["joint"]], Increments(table)))
        self.flows = list(flows.values()) if self.air else []
        used = [name for flow in self.flows for name in flow.signals]
        self.formulas.used = list(dict.fromkeys([*self.formulas.used, *used]))
        self.thrusts: list[tuple[Motor, Callable[[float], float]]] = []
        self.acting: list[Constant] = []

    def _constant(self, table: Table) -> Constant:
        """Constant load with its lever arm."""
        body = table["body"]
        arm = np.zeros(3) if table["point"] is None else self.vehicle.arm(body, table["point"])
        return Constant(table, self.vehicle.index[body], arm)

    def _air(self) -> Standard | Tabled:
        """Atmosphere model."""
        return (
            Standard()
            if self.environment["atmosphere"] == "us1976"
            else Tabled(self.environment["air"])
        )

    @property
    def switches(self) -> list[float]:
        """Times, s, at which a load is not smooth, as known so far."""
        switches = [t for motor in self.motors for t in motor.switches]
        switches += self.formulas.due()
        return switches + [
            t for load in self.constants for t in (load.table["start"], load.table["end"])
        ]

    def spring_force(self, spring: Spring, t: float, s: State) -> float:
        """Force of a spring, N, below zero too where it only pushes."""
        return spring.size(s, lambda path, other: self.formulas.number(path, t, s, other))

    def set_slack(self, t: float, s: State) -> None:
        """Set which springs that only push are slack, where their force is not zero."""
        for spring in self.springs:
            if spring.table["push_only"]:
                force = self.spring_force(spring, t, s)
                if abs(force) > 0.5 * spring.past_zero:
                    spring.is_slack = force < 0.0

    def slack_kinks(self) -> list[tuple[Callable[[float, State], float], Callable[[], None]]]:
        """Functions that become positive where springs that only push become slack or cease to be;
        `set_slack` changes that."""

        def beyond(spring: Spring, t: float, s: State) -> float:
            force = self.spring_force(spring, t, s)
            return (force if spring.is_slack else -force) - spring.past_zero

        springs = [one for one in self.springs if one.table["push_only"] and not one.spent]
        return [(partial(beyond, one), lambda: None) for one in springs]

    def set_interval(self, middle: float) -> None:
        """Select the loads that act in the interval around a time, s, which contains no switch."""
        thrusts = [(motor, motor.thrust(middle)) for motor in self.motors]
        self.thrusts = [(motor, thrust) for motor, thrust in thrusts if thrust is not None]
        self.acting = [load for load in self.constants if load.acts(middle)]

    def _quantity(self, items: list[str], key: str, t: float, s: State) -> float:
        """Quantity of a formula, SI."""
        if not items:
            return t
        if key.startswith("time_since"):
            return max(0.0, t - self.formulas.instants.get((items[0], items[1]), math.inf))
        if len(items) == 2:
            if items[0] == "joint":
                length, rate = self.joints[items[1]].separation(s)
            else:
                spring = next(one for one in self.springs if one.name == items[1])
                _, length, rate, _ = spring.line(s)
            return rate if key == "rate" else length
        b = self.vehicle.index[items[0]]
        r, place, speed = s.r[b], s.x[b] + self.vehicle.velocity * t, s.v[b] + self.vehicle.velocity
        airspeed, alpha, beta = air_angles(self.air_velocity(t, s, b))
        place[1] = self.vehicle.height(t, s, b)
        known = {
            "pitch": self._turns(b, "pitch", math.atan2(r[1, 0], r[0, 0])),
            "roll": self._turns(b, "roll", math.atan2(r[2, 1], r[2, 2])),
            "yaw": math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0])),
            "airspeed": airspeed,
            "alpha": alpha,
            "beta": beta,
        }
        for k, axis in enumerate("xyz"):
            known |= {f"omega_{axis}": s.w[b][k], axis: place[k], f"v{axis}": speed[k]}
        if key in ("dynamic_pressure", "mach"):
            flow = next(one for one in self.flows if one.body == b)
            _, density, mach, _, _ = self.flow(t, s, flow)
            return mach if key == "mach" else 0.5 * density * airspeed**2
        return float(known[key])

    def _turns(self, b: int, key: str, angle: float) -> float:
        """Angle plus the number of turns nearest to its last value, rad."""
        turn = 2.0 * math.pi
        return float(angle + turn * np.round((self.last[key][b] - angle) / turn))

    def air_velocity(self, t: float, s: State, body: int) -> Array:
        """Velocity of a body relative to the air, body axes, m/s."""
        return s.r[body].T @ (
            s.v[body] + self.vehicle.velocity - self.wind.at(self.vehicle.height(t, s, body))
        )

    def flow(self, t: float, s: State, flow: Flow) -> tuple[float, float, float, float, float]:
        """Airspeed, density, Mach number, alpha and beta."""
        assert self.air is not None
        density, sound_speed = self.air.at(self.vehicle.height(t, s, flow.body), flow.layer)
        speed, alpha, beta = air_angles(self.air_velocity(t, s, flow.body))
        return speed, density * self.environment["density_factor"], speed / sound_speed, alpha, beta

    def aerodynamics(self, t: float, s: State, flow: Flow) -> tuple[Array, Array]:
        """Aerodynamic force, N, and moment about the mass centre, N m, body axes."""
        speed, density, mach, alpha, beta = self.flow(t, s, flow)
        rates = self._reduced_rates(s, flow, speed)
        rates |= {name: self.formulas.value(name, t, s) for name in flow.signals}
        c = flow.coefficients.at(mach, alpha, beta, rates)
        for joint, increments in flow.increments:
            motion = {"distance": joint.separation(s)[0]}
            if "distance" not in increments.axes:
                motion = joint.relative_motion(s)
            c = c + increments.at(motion)
        qs = 0.5 * density * speed * speed * flow.table["reference_area"]
        force = qs * flow.table["force_factor"] * np.array([-c[0], c[1], -c[2]])
        moment = (
            qs
            * flow.table["reference_length"]
            * flow.table["moment_factor"]
            * np.array([c[3], -c[4], c[5]])
        )
        return force, moment + cross(flow.arm, force)

    def _reduced_rates(self, s: State, flow: Flow, speed: float) -> dict[str, float]:
        """Rates of roll (to the right), pitch (up) and yaw (to the right) times the reference
        length over twice the airspeed."""
        x, y, z = s.w[flow.body]
        scale = 0.5 * flow.table["reference_length"] / speed if speed > 1e-6 else 0.0
        return {"p": scale * x, "q": scale * z, "r": -scale * y}

    def gravity(self, height: float) -> float:
        """Acceleration downward, m/s2."""
        kind, surface = self.environment["gravity"], self.environment["surface_gravity"]
        if kind == "inverse-square":
            return surface * (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
        return surface if kind == "constant" else 0.0

    def on_bodies(self, t: float, s: State) -> tuple[Array, Array]:
        """Forces (n + 1, 3), ground axes, and moments (n + 1, 3) about the mass centres, body axes;
        the ground is the last."""
        n = self.vehicle.n

        def number(path: str, otherwise: float) -> float:
            return self.formulas.number(path, t, s, otherwise)

        inside, moment = np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
        for motor, thrust in self.thrusts:
            path = f"motor.{motor.table['name']}"
            size = thrust(t) * number(f"{path}.thrust", 1.0)
            angles = [
                number(f"{path}.{key}", motor.table[key])
                for key in ("deflection", "deflection_clock")
            ]
            force_1, moment_1 = motor.pointing(*angles)
            inside[motor.body] += size * force_1
            moment[motor.body] += size * moment_1
        for body, (force_b, moment_b) in [
            *((load.body, load.wrench(s, number)) for load in self.acting),
            *((flow.body, self.aerodynamics(t, s, flow)) for flow in self.flows),
        ]:
            inside[body] += force_b
            moment[body] += moment_b
        force = (s.r @ inside[:, :, None])[:, :, 0]
        for body in range(n):
            force[body, 1] -= self.vehicle.mass[body] * self.gravity(
                self.vehicle.height(t, s, body)
            )
        for spring in self.springs:
            if not spring.spent:
                spring.push(s, force, moment, number)
        return force, moment


def air_angles(u: Array) -> tuple[float, float, float]:
    """Airspeed, alpha and beta from the velocity relative to the air in body axes."""
    level = math.hypot(u[0], u[1])
    return math.sqrt(float(u @ u)), math.atan2(-u[1], u[0]), math.atan2(u[2], level)
