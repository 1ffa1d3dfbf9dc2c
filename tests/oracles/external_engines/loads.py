"""Loads on a body, written a second time from their published formulas, for numbers and for an
engine's expressions.

``fn`` is the module of exp, sin, cos, sqrt and atan2: `math`, or heyoka for expressions. A `Mode`
fixes what switches (motors, springs, atmosphere layers), so that every formula is smooth within a
mode.
"""

import math
import re
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from oracles.external_engines.case import GROUND, Array, Body, Case, Motion, cross

EARTH_RADIUS = 6356766.0  # m, US Standard Atmosphere 1976
GAS = 8314.32 / 28.9644  # J/(kg K), the same
LAPSE_GRAVITY = 9.80665  # m/s2, of the barometric formula
# geopotential height, m; the last is the top
BASES = (0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0)
LAPSES = (-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3)  # K/m


@dataclass
class Mode:
    """State of all switches over an interval without switches."""

    kinds: dict[str, str] = field(default_factory=dict)  # of joints
    # "off", "burn", "tail", or the row of the profile that begins the piece
    motors: dict[str, str] = field(default_factory=dict)
    springs: dict[str, bool] = field(default_factory=dict)
    loads: dict[str, bool] = field(default_factory=dict)
    layers: dict[str, int] = field(default_factory=dict)  # of the atmosphere, by body

    def key(self) -> str:
        """Equal for equal modes."""
        return repr(
            [
                sorted(part.items())
                for part in (self.kinds, self.motors, self.springs, self.loads, self.layers)
            ]
        )


def to_base(layer: int) -> tuple[float, float]:
    """Temperature (K) and pressure (Pa) at the base of a layer."""
    temperature, pressure = 288.15, 101325.0
    for base, top, lapse in zip(BASES[:layer], BASES[1:], LAPSES, strict=False):
        hotter = temperature + lapse * (top - base)
        exponent = LAPSE_GRAVITY / GAS
        pressure *= (
            (temperature / hotter) ** (exponent / lapse)
            if lapse
            else math.exp(-exponent * (top - base) / temperature)
        )
        temperature = hotter
    return temperature, pressure


def layer_at(height: float) -> int:
    """Layer of the 1976 atmosphere at a geometric height (m)."""
    geopotential = EARTH_RADIUS * height / (EARTH_RADIUS + height)
    if not BASES[0] <= geopotential <= BASES[-1]:
        raise ValueError(f"no atmosphere at {height} m")
    return max(k for k in range(7) if geopotential >= BASES[k])


def density(height: Any, layer: int, fn: Any = math) -> Any:
    """Air density, kg/m3, at a geometric height (m): US Standard Atmosphere 1976, equations 18, 23,
    33 and 42, one layer."""
    temperature, pressure = to_base(layer)
    rise = EARTH_RADIUS * height / (EARTH_RADIUS + height) - BASES[layer]
    lapse = LAPSES[layer]
    if lapse == 0.0:
        return (
            pressure / (GAS * temperature) * fn.exp(rise * (-LAPSE_GRAVITY / (GAS * temperature)))
        )
    power = -LAPSE_GRAVITY / (GAS * lapse) - 1.0
    return (
        pressure / (GAS * temperature) * fn.exp(power * fn.log(1.0 + rise * (lapse / temperature)))
    )


def height_of(case: Case, motion: Motion, t: Any) -> Any:
    """Height of a mass centre above the ground, m."""
    return case.altitude + case.velocity[1] * t + motion.x[1]


def _polynomial(terms: dict[str, float], alpha: Any, beta: Any) -> Any:
    """Sum of terms such as ``{"const": 1.0, "alpha2_beta": 3.0}``, angles in radians."""
    total: Any = 0.0
    for key, value in terms.items():
        term: Any = value
        for name, digits in re.findall(r"(alpha|beta)(\d*)", key):
            for _ in range(int(digits or 1)):
                term = term * (alpha if name == "alpha" else beta)
        total = total + term
    return total


COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")


@cache
def _cardinal(points: tuple[float, ...], ends: str) -> CubicSpline:
    """Cubic splines that are one at one point and zero at the others; a parabola or a line through
    fewer than four points."""
    return CubicSpline(points, np.eye(len(points)), bc_type=ends)


def _weights(points: Any, x: float, ends: str = "not-a-knot") -> Array:
    """Weights of the values at the points in the value at x; a single point means a constant."""
    return np.ones(1) if len(points) == 1 else _cardinal(tuple(points), ends)(x)


def tabulated(table: dict[str, Any], mach: float, alpha: float, beta: float) -> Array:
    """Six coefficients by a cubic spline (not-a-knot) on the grid of the given axes, in the order
    Mach, alpha, beta."""
    out = np.zeros(6)
    axes = [
        (table[name], x)
        for name, x in (("mach", mach), ("alpha", alpha), ("beta", beta))
        if table.get(name)
    ]
    for points, x in axes:
        if len(points) > 1 and not points[0] <= x <= points[-1]:
            raise ValueError(f"{x} is outside its table, {points[0]} to {points[-1]}")
    for k, name in enumerate(COEFFICIENTS):
        if table.get(name):
            value = np.array(table[name], float)
            for points, x in axes:
                value = np.tensordot(_weights(points, x), value, 1)
            out[k] = value
    return out


def _increments(case: Case, body: Body, motions: dict[str, Motion]) -> Array:
    """Increments of six coefficients over the separation distance of a joint: cubic splines with
    zero slope at the ends, constant beyond."""
    out = np.zeros(6)
    for near in case.data.get("proximity", ()):
        if near["body"] != body.name:
            continue
        joint, points = case.joints[near["joint"]], near["distance"]
        a, b = motions[joint.first], motions[joint.second]
        along = joint.apart * (
            (b.point(joint.arm_second) - a.point(joint.arm_first)) @ (a.R @ joint.axes[:, 0])
        )
        weights = _weights(points, min(max(along, points[0]), points[-1]), "clamped")
        for k, name in enumerate(COEFFICIENTS):
            if near.get(name):
                out[k] += near.get("factor", 1.0) * (weights @ np.array(near[name]))
    return out


def sound_speed(height: float, layer: int) -> float:
    """Speed of sound, m/s: sqrt(1.4 R T / M), equation 50 of the standard."""
    geopotential = EARTH_RADIUS * height / (EARTH_RADIUS + height)
    return math.sqrt(
        1.4 * GAS * (to_base(layer)[0] + LAPSES[layer] * (geopotential - BASES[layer]))
    )


def aerodynamics(
    case: Case, body: Body, motions: dict[str, Motion], t: Any, mode: Mode, fn: Any
) -> tuple[Array, Array]:
    """Aerodynamic force (N) and moment (N m) about the mass centre, body axes: q S (-C_A, C_N,
    -C_Y), q S L (C_l, -C_n, C_m)."""
    table, motion = body.data["aerodynamics"], motions[body.name]
    wind = case.environment.get("wind") or {}
    speed, direction = wind.get("speed", 0.0), wind.get("direction", 0.0)
    moves = np.array([speed * math.cos(direction), 0.0, speed * math.sin(direction)])
    u, v, w = motion.R.T @ (motion.v + (case.velocity - moves))
    squared = u * u + v * v + w * w
    alpha, beta = fn.atan2(-v, u), fn.atan2(w, fn.sqrt(u * u + v * v))
    height = height_of(case, motion, t)
    layer = mode.layers[body.name] if mode.layers else layer_at(height)
    air = density(height, layer, fn) * case.environment.get("density_factor", 1.0)
    c = np.array([_polynomial(table.get(k) or {}, alpha, beta) for k in COEFFICIENTS])
    near = any(p["body"] == body.name for p in case.data.get("proximity", ()))
    if (table.get("table") or near) and fn is not math:
        raise NotImplementedError(
            "aerodynamic tables are flown with numbers only, not with expressions"
        )
    if table.get("table"):
        c = c + tabulated(
            table["table"], math.sqrt(squared) / sound_speed(height, layer), alpha, beta
        )
    if near:
        c = c + _increments(case, body, motions)
    ca, cn, cy, cl, cyaw, cm = c
    qs = 0.5 * air * squared * table["reference_area"]
    force = qs * table.get("force_factor", 1.0) * np.array([-ca, cn, -cy])
    moment = (
        qs * table["reference_length"] * table.get("moment_factor", 1.0) * np.array([cl, -cyaw, cm])
    )
    if table.get("moment_point") is not None:
        moment = moment + cross(body.arm(table["moment_point"]), force)
    return force, moment


def line_of_thrust(body: Body, motor: dict[str, Any]) -> tuple[Array, Array]:
    """Unit thrust in body axes, and its moment (m) about the mass centre."""
    cant, clock = motor.get("cant", math.pi), motor.get("clock", 0.0)
    b, p = motor.get("deflection", 0.0), motor.get("deflection_clock", 0.0)
    x_f = np.array(
        [math.cos(cant), -math.sin(clock) * math.sin(cant), math.cos(clock) * math.sin(cant)]
    )
    y_f = np.array([0.0, math.cos(clock), math.sin(clock)])
    z_f = cross(x_f, y_f)
    line = math.cos(b) * x_f - math.sin(b) * math.sin(p) * y_f + math.sin(b) * math.cos(p) * z_f
    radius, (dy, dz) = motor.get("radius", 0.0), motor.get("offset", (0.0, 0.0))
    arm = body.arm((motor["station"], dy - radius * math.sin(clock), dz + radius * math.cos(clock)))
    return line, cross(arm, line)


def ignition(motor: dict[str, Any]) -> float:
    """Ignition time of a motor, s, delay included."""
    return motor.get("ignition", 0.0) + motor.get("delay", 0.0)


def burn_out(motor: dict[str, Any]) -> float:
    """Burn-out time of a motor, s; infinite without a burn time."""
    return ignition(motor) + motor.get("burn", math.inf)


def motor_switches(motor: dict[str, Any]) -> list[float]:
    """Times, s, at which the formula of a motor's thrust changes."""
    rows = motor["profile"]["time"] if motor.get("profile") else ()
    return [ignition(motor), burn_out(motor), *(ignition(motor) + t for t in rows)]


def motor_piece(motor: dict[str, Any], t: float) -> str:
    """Formula of the thrust at a time between two switches."""
    if t < ignition(motor):
        return "off"
    if t >= burn_out(motor):
        return "tail" if motor.get("tail_off", 0.0) > 0.0 else "off"
    if not motor.get("profile"):
        return "burn"
    rows = motor["profile"]["time"]
    since = t - ignition(motor)
    return "off" if since < rows[0] else str(max(k for k, row in enumerate(rows) if row <= since))


def thrust(motor: dict[str, Any], piece: str, t: Any, fn: Any) -> Any:
    """Thrust, N: F (1 - exp(-t / build_up)) since ignition, times the profile, if any. After
    burn-out F (1 - exp(-burn / build_up)) exp(-t / tail_off), with t since then."""
    if piece == "off":
        return 0.0
    build_up = motor.get("build_up", 0.0)
    if piece == "tail":
        last = (
            motor["thrust"] * (1.0 - math.exp(-motor["burn"] / build_up))
            if build_up > 0.0
            else motor["thrust"]
        )
        return last * fn.exp((burn_out(motor) - t) / motor["tail_off"])
    since = t - ignition(motor)
    level = (
        motor["thrust"] * (1.0 - fn.exp(since / -build_up)) if build_up > 0.0 else motor["thrust"]
    )
    if not motor.get("profile"):
        return level
    times, fractions = motor["profile"]["time"], motor["profile"]["fraction"]
    k = int(piece)
    if k == len(times) - 1:
        return level * 0.0
    slope = (fractions[k + 1] - fractions[k]) / (times[k + 1] - times[k])
    return level * (fractions[k] + slope * (since - times[k]))


def extension(
    case: Case, spring: dict[str, Any], motions: dict[str, Motion], fn: Any
) -> tuple[Any, Any, Array, Array, Array]:
    """Extension (m) and its rate of a spring, its line (unit vector, ground axes) and its points on
    both bodies."""
    first, second = spring["bodies"]
    a, b = case.body(first), case.body(second)
    far = spring.get("second_point") or spring["point"]
    arm_a, arm_b = a.arm(spring["point"]), b.arm(far)
    A, B = motions[first], motions[second]
    gap = B.point(arm_b) - A.point(arm_a)
    rate = B.point_velocity(arm_b) - A.point_velocity(arm_a)
    start = a.arm(far) - a.arm(spring["point"])  # both bodies share the layout at t = 0
    if spring.get("axis") is not None:
        axis = np.array(spring["axis"], float) / float(np.linalg.norm(spring["axis"]))
        line = A.R @ axis
        turn = A.R @ cross(A.w, axis)
        return (
            gap @ line - start @ axis,
            rate @ line + gap @ turn,
            line,
            B.point(arm_b),
            B.point(arm_b),
        )
    length = fn.sqrt(gap @ gap)
    line = gap / length
    return length - float(np.linalg.norm(start)), rate @ line, line, A.point(arm_a), B.point(arm_b)


def spring_force(
    case: Case, spring: dict[str, Any], motions: dict[str, Motion], fn: Any
) -> tuple[Array, Array, Array]:
    """Force of a spring on its second body, N, ground axes, and the points where it, and its
    opposite on the first body, act."""
    x, rate, line, at_a, at_b = extension(case, spring, motions, fn)
    push = (
        spring.get("force", 0.0)
        - spring.get("stiffness", 0.0) * x
        - spring.get("damping", 0.0) * rate
    )
    return push * line, at_a, at_b


def gravity(case: Case, height: Any) -> Any:
    """Acceleration downward, m/s2."""
    kind, surface = case.environment["gravity"], case.environment.get("surface_gravity", 9.80665)
    if kind == "none":
        return 0.0
    ratio = EARTH_RADIUS / (EARTH_RADIUS + height)
    return surface * ratio * ratio if kind == "inverse-square" else surface


def body_loads(
    case: Case, motions: dict[str, Motion], t: Any, mode: Mode, fn: Any = math
) -> dict[str, tuple[Array, Array]]:
    """External force (N, ground axes) on every body and its moment (N m, body axes) about the mass
    centre."""
    loads: dict[str, tuple[Array, Array]] = {}
    for name, body in case.bodies.items():
        motion = motions[name]
        force, moment = np.zeros(3), np.zeros(3)
        if body.data.get("aerodynamics") and case.environment.get("atmosphere", "us1976") != "none":
            force, moment = aerodynamics(case, body, motions, t, mode, fn)
        for motor in case.data.get("motor", ()):
            piece = mode.motors.get(motor["name"], "off")
            if motor["body"] == name and piece != "off":
                line, arm = line_of_thrust(body, motor)
                level = thrust(motor, piece, t, fn)
                force, moment = force + level * line, moment + level * arm
        force = motion.R @ force
        for load in case.data.get("load", ()):
            if load["body"] == name and mode.loads.get(load["name"], False):
                own, turn = (
                    np.array(load.get("force", (0.0,) * 3), float),
                    np.array(load.get("moment", (0.0,) * 3), float),
                )
                arm = body.arm(load["point"]) if load.get("point") is not None else np.zeros(3)
                in_body = motion.R.T if load.get("frame", "body") == "ground" else np.eye(3)
                own, turn = in_body @ own, in_body @ turn
                force, moment = force + motion.R @ own, moment + turn + cross(arm, own)
        weight = body.mass * gravity(case, height_of(case, motion, t))
        loads[name] = (force - np.array([0.0, 1.0, 0.0]) * weight, moment)
    for spring in case.data.get("spring", ()):
        if not mode.springs.get(spring["name"], False):
            continue
        push, at_a, at_b = spring_force(case, spring, motions, fn)
        for name, sign, place in (
            (spring["bodies"][0], -1.0, at_a),
            (spring["bodies"][1], 1.0, at_b),
        ):
            if name != GROUND:
                force, moment = loads[name]
                m = motions[name]
                loads[name] = (
                    force + sign * push,
                    moment + sign * (m.R.T @ cross(place - m.x, push)),
                )
    return loads
