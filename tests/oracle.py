"""Reference solution of a two-body separation, written for clarity and accuracy, not for speed.

Frames, signs and angle order are those of CONVENTIONS.md. Everything is SI and radians; only the names of the
outcomes carry other units. The joint connects ``bodies[0]`` (called A, forward) with ``bodies[1]`` (called B, aft).

No constraint force is ever solved for. While the bodies are mated, the motion is written in minimal coordinates:
position, attitude and rates of A, and the sliding coordinate s along the joint's x axis (s is held in a fixed joint).
With the speeds u = (v_A, omega, s') the accelerations follow from Kane's equations (Kane and Levinson, "Dynamics:
Theory and Applications", 1985, ch. 6), sum over bodies of V^T (F - m a) + W^T (M - I omega' - omega x I omega) = 0,
where V and W are the partial velocities. After release each body obeys Newton and Euler on its own. Attitudes are
integrated as rotation matrices, R' = R [omega x], and positions relative to a point that moves with the constant
initial velocity of the mass centre, so that 7e4 m never enters a difference.
"""

import re

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

EARTH_RADIUS = 6356766.0  # m, US Standard Atmosphere 1976
EX = np.array([1.0, 0.0, 0.0])
# US Standard Atmosphere 1976, table 4: geopotential base heights (m) and lapse rates (K/m); the last height is the top.
LAYER_BASE = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0])
LAYER_LAPSE = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3])


def skew(a):
    """Matrix [a x] with ``skew(a) @ b == cross(a, b)``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def density(y):
    """Air density (kg/m3) at geometric height y (m): US Standard Atmosphere 1976, equations 18, 23, 33 and 42."""
    height = EARTH_RADIUS * y / (EARTH_RADIUS + y)
    if height > LAYER_BASE[-1]:
        raise ValueError(f"no atmosphere above 86 km, height is {y} m")
    gas, gravity = 8314.32 / 28.9644, 9.80665  # J/(kg K), m/s2
    temperature, pressure = 288.15, 101325.0
    for base, top, lapse in zip(LAYER_BASE[:-1], LAYER_BASE[1:], LAYER_LAPSE, strict=True):
        rise = min(height, top) - base
        if lapse:
            hotter = temperature + lapse * rise
            pressure *= (temperature / hotter) ** (gravity / (gas * lapse))
            temperature = hotter
        else:
            pressure *= np.exp(-gravity * rise / (gas * temperature))
        if height <= top:
            return pressure / (gas * temperature)


def _polynomial(terms):
    """Terms such as ``{"const": 1, "alpha_beta2": 3}`` as a list of (coefficient, power of alpha, power of beta)."""
    table = []
    for key, value in (terms or {}).items():
        power = {"alpha": 0, "beta": 0}
        for part in key.split("_") if key != "const" else ():
            name, digits = re.fullmatch(r"(alpha|beta)(\d*)", part).groups()
            power[name] += int(digits or 1)
        table.append((value, power["alpha"], power["beta"]))
    return table


class Body:
    """Mass (kg), inertia (kg m2, about the mass centre) and the external loads of one body."""

    def __init__(self, name, case):
        data, self.environment = case["body"][name], case["environment"]
        self.mass, self.cg = data["mass"], np.array(data["cg"], float)
        xy, xz, yz = data.get("inertia_products", (0.0, 0.0, 0.0))
        xx, yy, zz = data["inertia"]
        self.inertia = data.get("inertia_factor", 1.0) * np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])
        self.aero = data.get("aerodynamics")
        if self.aero:
            self.coefficients = [_polynomial(self.aero.get(k)) for k in ("axial", "normal", "side", "roll", "yaw", "pitch")]
        wind = self.environment.get("wind") or {"speed": 0.0, "direction": 0.0}
        self.wind = wind["speed"] * np.array([np.cos(wind["direction"]), 0.0, np.sin(wind["direction"])])
        self.motors = [self._motor(m) for m in case.get("motor", []) if m["body"] == name]

    def from_cg(self, layout):
        """Body-axes vector (m) from the mass centre to a layout point [station, y, z]."""
        return (np.asarray(layout, float) - self.cg) * (-1.0, 1.0, 1.0)

    def _motor(self, m):
        """Motor data with its unit force and that force's moment (m) about the mass centre, both in body axes."""
        clock, b, p = m.get("clock", 0.0), m.get("deflection", 0.0), m.get("deflection_clock", 0.0)
        nozzle_to_body = Rotation.from_euler("XY", [clock, -m["cant"]]).as_matrix()
        force = nozzle_to_body @ (np.cos(b), -np.sin(b) * np.sin(p), np.sin(b) * np.cos(p))
        dy, dz = m.get("offset", (0.0, 0.0))
        radius, ignition = m.get("radius", 0.0), m.get("ignition", 0.0)
        arm = self.from_cg([m["station"], -radius * np.sin(clock) + dy, radius * np.cos(clock) + dz])
        return (
            {"build_up": 0.0}
            | m
            | {"ignition": ignition, "burnout": ignition + m.get("burn", np.inf), "force": force, "moment": np.cross(arm, force)}
        )

    def air(self, R, v):
        """Airspeed (m/s), alpha and beta (rad) for attitude R and ground velocity v (m/s)."""
        u, v, w = R.T @ (v - self.wind)
        return np.sqrt(u * u + v * v + w * w), np.arctan2(-v, u), np.arctan2(w, np.hypot(u, v))

    def loads(self, t, t_mid, height, R, v):
        """Force (N) and moment (N m) about the mass centre, body axes. Motors that burn at t_mid count as burning."""
        e = self.environment
        g = 0.0 if e["gravity"] == "none" else e["surface_gravity"]
        if e["gravity"] == "inverse-square":
            g *= (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
        force, moment = -self.mass * g * R[1], np.zeros(3)  # R[1] is the vertical in body axes
        for m in self.motors:
            if m["ignition"] <= t_mid < m["burnout"]:
                build_up = -np.expm1((m["ignition"] - t) / m["build_up"]) if m["build_up"] else 1.0
                thrust = m["thrust"] * build_up
                force, moment = force + thrust * m["force"], moment + thrust * m["moment"]
        if self.aero and e["atmosphere"] != "none":
            speed, alpha, beta = self.air(R, v)
            axial, normal, side, roll, yaw, pitch = (sum(c * alpha**i * beta**j for c, i, j in p) for p in self.coefficients)
            qs = 0.5 * density(height) * speed**2 * self.aero["reference_area"]
            force = force + qs * self.aero.get("force_factor", 1.0) * np.array([-axial, normal, -side])
            qsl = qs * self.aero["reference_length"] * self.aero.get("moment_factor", 1.0)
            moment = moment + qsl * np.array([roll, -yaw, pitch])
        return force, moment


class _Flight:
    """State and equations of one flight. Bodies are flown as (x, v, R, omega), x and v relative to the moving origin."""

    def __init__(self, case, rtol):
        ((self.joint, joint),) = case["joint"].items()
        self.names, self.rtol = joint["bodies"], rtol
        self.A, self.B = (Body(name, case) for name in self.names)
        self.point = [b.from_cg(joint["point"]) for b in (self.A, self.B)]  # mass centre to joint point, body axes
        self.mated = self.A.from_cg(self.B.cg)  # mass centre of A to that of B when closed
        i = case["initial"]
        theta, sigma = i["pitch"] - i["alpha"], i.get("path_yaw", 0.0)
        self.velocity = i["speed"] * np.array([np.cos(theta) * np.cos(sigma), np.sin(theta) * np.cos(sigma), -np.sin(sigma)])
        self.altitude = i["altitude"]
        R = Rotation.from_euler("ZYX", [i["pitch"], i["yaw"], i["roll"]]).as_matrix()
        omega = np.array(i["omega"], float)
        offset = -self.B.mass / (self.A.mass + self.B.mass) * self.mated  # of A from the common mass centre
        self.y = np.concatenate([R @ offset, R @ np.cross(omega, offset), R.ravel(), omega, [0.0, 0.0]])
        self.kind, self.t, self.t_mid = None, 0.0, 0.0

    def bodies(self, y):
        """(x, v, R, omega) of A and of B from the state vector."""
        x, v, R, w = y[:3], y[3:6], y[6:15].reshape(3, 3), y[15:18]
        if y.size > 20:
            return (x, v, R, w), (y[18:21], y[21:24], y[24:33].reshape(3, 3), y[33:36])
        rho = self.mated - y[18] * EX
        return (x, v, R, w), (x + R @ rho, v + R @ (np.cross(w, rho) - y[19] * EX), R, w)

    def loads(self, t, t_mid, y):
        """External (force, moment) of A and of B, each in its own body axes."""
        return [
            body.loads(t, t_mid, self.altitude + self.velocity[1] * t + x[1], R, self.velocity + v)
            for body, (x, v, R, _) in zip((self.A, self.B), self.bodies(y), strict=True)
        ]

    def accelerate(self, t, t_mid, y):
        """Mated accelerations a_A, omega', s'' and a_B (body axes) and the reaction (force, moment) on B at its joint point."""
        (force_a, moment_a), (force_b, moment_b) = self.loads(t, t_mid, y)
        w, rate, rho = y[15:18], y[19], self.mated - y[18] * EX
        W = np.hstack([np.zeros((3, 3)), np.eye(3), np.zeros((3, 1))])
        Va = np.hstack([np.eye(3), np.zeros((3, 4))])
        Vb = np.hstack([np.eye(3), -skew(rho), -EX[:, None]])
        bias = np.cross(w, np.cross(w, rho)) - 2.0 * rate * np.cross(w, EX)  # a_B at u' = 0
        inertia = self.A.inertia + self.B.inertia
        mass = self.A.mass * Va.T @ Va + self.B.mass * Vb.T @ Vb + W.T @ inertia @ W
        load = Va.T @ force_a + Vb.T @ (force_b - self.B.mass * bias) + W.T @ (moment_a + moment_b - np.cross(w, inertia @ w))
        n = 7 if self.kind == "slider" else 6
        du = np.zeros(7)
        du[:n] = np.linalg.solve(mass[:n, :n], load[:n])
        a_b, dw = Vb @ du + bias, du[3:6]
        force = self.B.mass * a_b - force_b
        moment = self.B.inertia @ dw + np.cross(w, self.B.inertia @ w) - moment_b - np.cross(self.point[1], force)
        return du[:3], dw, du[6], a_b, (force, moment)

    def derivative(self, t, y, t_mid):
        if self.kind != "free":
            v, R, w = y[3:6], y[6:15].reshape(3, 3), y[15:18]
            a, dw, dds = self.accelerate(t, t_mid, y)[:3]
            return np.concatenate([v, R @ a, (R @ skew(w)).ravel(), dw, [y[19], dds]])
        out = []
        for body, (_, v, R, w), (force, moment) in zip((self.A, self.B), self.bodies(y), self.loads(t, t_mid, y), strict=True):
            dw = np.linalg.solve(body.inertia, moment - np.cross(w, body.inertia @ w))
            out += [v, R @ force / body.mass, (R @ skew(w)).ravel(), dw]
        return np.concatenate(out)

    def integrate(self, t_end, event=None):
        sol = solve_ivp(
            self.derivative, (self.t, t_end), self.y, "DOP853", rtol=self.rtol, atol=self.rtol * 1e-2, events=event, args=(self.t_mid,)
        )
        if not sol.success:
            raise RuntimeError(sol.message)
        return sol.t[-1], sol.y[:, -1]

    def advance(self, t_end, stroke=np.inf):
        """Fly a stretch without switches to t_end (s), or until s reaches stroke (m); True if that ended it."""

        def event(t, y, _):
            return y[18] - stroke

        event.terminal, event.direction = True, 1.0
        self.t_mid, watch = 0.5 * (self.t + t_end), self.kind == "slider" and np.isfinite(stroke)
        t, y = self.integrate(t_end, event if watch else None)
        hit = watch and (t < t_end or y[18] >= stroke)
        for _ in range(6 if hit else 0):  # Newton on the end time, each time flown again from the start of the stretch
            t, y = self.integrate(t)
            step = (stroke - y[18]) / y[19]
            if abs(step) < 2e-16 + 1e-15 * t:
                break
            t += step
        self.t, self.y = t, y
        return hit


def fly(case, rtol=1e-13):
    """Fly a case and return its outcomes at the end time.

    Parameters
    ----------
    case : dict
        Nested like the campaign file, in SI and radians, keys without unit suffix. ``until.time`` is counted from the
        start; ``stroke`` is the separation distance along the joint's x axis. Phases go fixed, slider, free.
        ``initial.path_reference`` (rad), if given, adds ``*_alpha_ref_deg`` = pitch - path_reference.
    rtol : float
        Relative tolerance of DOP853; the absolute one is ``rtol / 100`` in SI units.

    Returns
    -------
    dict
        Outcomes under their public names, and the reaction on B at its joint point in the axes of A at the last instant
        before release, ``release_force_on_lower_N`` and ``release_moment_on_lower_N_m`` (NaN if never released).
    """
    flight, end = _Flight(case, rtol), case["run"]["end_time"]
    release, force, moment = np.nan, np.full(3, np.nan), np.full(3, np.nan)
    switches = sorted(t for b in (flight.A, flight.B) for m in b.motors for t in (m["ignition"], m["burnout"]))
    order = [None, "fixed", "slider", "free"]
    for phase in case["phase"]:
        kind = phase.get("joints", {}).get(flight.joint, "free")
        if order.index(kind) < order.index(flight.kind):
            raise ValueError(f"a joint cannot go from {flight.kind} to {kind}")
        if kind == "free" and flight.kind != "free":
            if flight.kind:
                release = flight.t
                force, moment = flight.accelerate(flight.t, flight.t_mid, flight.y)[4]
            flight.y = np.concatenate([np.ravel(part) for body in flight.bodies(flight.y) for part in body])
        flight.kind, until = kind, phase.get("until", {})
        stop, stroke = min(until.get("time", np.inf), end), until.get("stroke", np.inf)
        done = kind == "slider" and flight.y[18] >= stroke
        while flight.t < stop and not done:
            done = flight.advance(min([t for t in switches if t > flight.t] + [stop]), stroke)
        if flight.t >= end:
            break
    if flight.t < end:
        raise ValueError("the last phase stops before the end time")

    out, states, deg = {"release_time_s": release}, flight.bodies(flight.y), np.degrees
    for name, body, (_, v, R, w) in zip(flight.names, (flight.A, flight.B), states, strict=True):
        _, alpha, beta = body.air(R, flight.velocity + v)
        pitch = np.arctan2(R[1, 0], R[0, 0])
        angles = {"alpha": alpha, "beta": beta, "roll": np.arctan2(R[2, 1], R[2, 2]), "yaw": -np.arcsin(R[2, 0]), "pitch": pitch}
        if "path_reference" in case["initial"]:
            angles["alpha_ref"] = pitch - case["initial"]["path_reference"]
        out |= {f"{name}_{key}_deg": deg(value) for key, value in angles.items()}
        out |= {f"{name}_omega_{axis}_deg_s": deg(value) for axis, value in zip("xyz", w, strict=True)}
    (xa, va, Ra, wa), (xb, vb, Rb, wb) = states
    gap = xb + Rb @ flight.point[1] - xa - Ra @ flight.point[0]
    gap_rate = vb + Rb @ np.cross(wb, flight.point[1]) - va - Ra @ np.cross(wa, flight.point[0])
    out["separation_distance_mm"] = -1e3 * gap @ Ra[:, 0]
    out["separation_speed_m_s"] = -gap_rate @ Ra[:, 0] - gap @ Ra @ np.cross(wa, EX)
    return out | {"release_force_on_lower_N": force, "release_moment_on_lower_N_m": moment}
