"""Classical formulations of a separation: Lagrange's (minimal coordinates) while two bodies are
joined, Newton and Euler's once free.

Frames, signs and angle order are those of CONVENTIONS.md. Everything is SI and radians; only the
names of the outcomes carry other units. The joint connects its first body (called A, which carries
the axes) with its second (called B).

No constraint force is ever solved for. While the bodies are joined the motion is written in
independent speeds: the velocity and rates of A, the free components of the gap d in the axes of A,
and the free relative rates H u. The accelerations follow from the principle of virtual power
(Lagrange's equations in quasi-coordinates; Kane and Levinson, "Dynamics: Theory and Applications",
1985, ch. 6): the sum over bodies of V^T (F - m a) + W^T (M - J w' - w x J w) vanishes, where V and
W are the partial velocities. The reaction is what is missing afterwards in Newton and Euler's
equations of B. Attitudes are integrated as rotation matrices, R' = R [w x], and positions relative
to a point that moves with the constant initial velocity of the mass centre, so that 7e4 m never
enters a difference. tests/validation/test_formulations.py derives the slider pair anew with sympy's
LagrangesMethod and KanesMethod and compares the accelerations.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sepmc.validation.classical_loads import Body, refuse_others

Array = np.ndarray
# Joint axes along which, and about which, a kind holds; the paper's section 2 and CONVENTIONS.md.
KINDS = {
    "fixed": ("xyz", "xyz"),
    "slider": ("yz", "xyz"),
    "revolute": ("xyz", "yz"),
    "cylindrical": ("yz", "yz"),
    "universal": ("xyz", "z"),
    "spherical": ("xyz", ""),
    "planar": ("x", "yz"),
    "point-on-plane": ("x", ""),
    "point-on-line": ("yz", ""),
    "rod": ("length", ""),
    "free": ("", ""),
}
# With one relative rotation held, B turns about one axis carried by A and one carried by itself,
# which stay perpendicular.
PERPENDICULAR = {"x": ("z", "y"), "y": ("z", "x"), "z": ("y", "x")}


def skew(a: Array) -> Array:
    """Matrix [a x] with ``skew(a) @ b == cross(a, b)``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True)
class Pair:
    """Two rigid bodies at a joint.

    mass : kg, of A and B; inertia : (3, 3) tensors about the mass centres, kg m2, body axes
    arm : from each mass centre to its joint point, m, body axes; axes : (3, 3), rows: joint axes in
        body axes
    """

    mass: tuple[float, float]
    inertia: tuple[Array, Array]
    arm: tuple[Array, Array]
    axes: Array


class Motion(NamedTuple):
    """Where a pair stands: place, velocity, attitude and rates of A; gap and its rate in joint
    axes; attitude and rates of B.

    Places and velocities are in ground axes, rates in body axes.
    """

    x: Array
    v: Array
    r: Array
    w: Array
    gap: Array
    gap_rate: Array
    r_b: Array
    w_b: Array


class Found(NamedTuple):
    """Accelerations of A and B (ground), w' of each (body), the gap's (joint axes), and the
    reaction on B at its joint point, ground."""

    a: Array
    w_rate: Array
    gap_acceleration: Array
    a_b: Array
    w_b_rate: Array
    force: Array
    moment: Array


def bodies(pair: Pair, motion: Motion) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """(x, v, R, w) of A and of B; places and velocities in ground axes, rates in body axes."""
    x, v, r, w, gap, gap_rate, r_b, w_b = motion
    lever = pair.arm[0] + pair.axes.T @ gap
    x_b = x + r @ lever - r_b @ pair.arm[1]
    v_b = v + r @ (np.cross(w, lever) + pair.axes.T @ gap_rate) - r_b @ np.cross(w_b, pair.arm[1])
    return (x, v, r, w), (x_b, v_b, r_b, w_b)


def _translations(held: str, motion: Motion) -> tuple[Array, Array]:
    """Directions of the free gap rates (3, n) and the part of the gap's acceleration that needs
    none; joint axes."""
    if held != "length":
        return np.eye(3)[:, [axis not in held for axis in "xyz"]], np.zeros(3)
    along = motion.gap / np.linalg.norm(motion.gap)
    across = np.linalg.svd(along[None])[2][1:].T  # any two directions square to the rod
    return across, -(motion.gap_rate @ motion.gap_rate) / (motion.gap @ motion.gap) * motion.gap


def _rotations(held: str, pair: Pair, motion: Motion, w: Array, w_b: Array) -> tuple[Array, Array]:
    """Axes H of the free relative rates (3, n) and H' u; ground axes, as the rates w of A and w_b
    of B."""
    of_a, of_b = (dict(zip("xyz", pair.axes @ r.T, strict=True)) for r in (motion.r, motion.r_b))
    if len(held) == 0:
        return np.eye(3), np.zeros(3)
    if len(held) == 1:
        first, second = PERPENDICULAR[held]
        p, q = of_a[first], of_b[second]
        return np.stack([p, q], axis=1), p @ (w_b - w) * np.cross(w, p) + q @ (w_b - w) * np.cross(
            w_b, q
        )
    if len(held) == 2:
        e = of_a[next(axis for axis in "xyz" if axis not in held)]
        return e[:, None], e @ (w_b - w) * np.cross(w, e)
    return np.zeros((3, 0)), np.zeros(3)


def accelerate(
    pair: Pair, held: tuple[str, str], motion: Motion, loads: list[tuple[Array, Array]]
) -> Found:
    """Accelerations and the reaction of a joined pair.

    Parameters
    ----------
    held : joint axes held in translation and in rotation: a value of `KINDS`
    loads : external (force, moment about the mass centre) on A and on B, each in its own body axes,
        N and N m
    """
    r, r_b = motion.r, motion.r_b
    w, w_b = r @ motion.w, r_b @ motion.w_b
    lever, arm_b = r @ (pair.arm[0] + pair.axes.T @ motion.gap), r_b @ pair.arm[1]
    to_ground = r @ pair.axes.T
    slide, slide_bias = _translations(held[0], motion)
    turn, turn_bias = _rotations(held[1], pair, motion, w, w_b)
    none, size = np.zeros((3, slide.shape[1])), 6 + slide.shape[1] + turn.shape[1]
    # Columns: velocity of A, rates of A, gap rates, relative rates.
    spin_a = np.hstack([np.zeros((3, 3)), np.eye(3), none, 0.0 * turn])
    spin_b = np.hstack([np.zeros((3, 3)), np.eye(3), none, turn])
    move_a = np.hstack([np.eye(3), np.zeros((3, size - 3))])
    move_b = (
        move_a
        - skew(lever) @ spin_a
        + np.hstack([np.zeros((3, 6)), to_ground @ slide, 0.0 * turn])
        + skew(arm_b) @ spin_b
    )
    gap_rate = to_ground @ motion.gap_rate
    bias_b = np.cross(w, np.cross(w, lever)) + 2.0 * np.cross(w, gap_rate) + to_ground @ slide_bias
    bias_b = bias_b - np.cross(turn_bias, arm_b) - np.cross(w_b, np.cross(w_b, arm_b))
    mass, load = np.zeros((size, size)), np.zeros(size)
    for i, (move, spin, bias, spin_bias, attitude, rate) in enumerate(
        (
            (move_a, spin_a, np.zeros(3), np.zeros(3), r, w),
            (move_b, spin_b, bias_b, turn_bias, r_b, w_b),
        )
    ):
        inertia = attitude @ pair.inertia[i] @ attitude.T
        force, moment = attitude @ loads[i][0], attitude @ loads[i][1]
        mass += pair.mass[i] * move.T @ move + spin.T @ inertia @ spin
        load += move.T @ (force - pair.mass[i] * bias) + spin.T @ (
            moment - inertia @ spin_bias - np.cross(rate, inertia @ rate)
        )
    du = np.linalg.solve(mass, load)
    w_rate, w_b_rate = spin_a @ du, spin_b @ du + turn_bias
    a_b = move_b @ du + bias_b
    inertia = r_b @ pair.inertia[1] @ r_b.T
    force = pair.mass[1] * a_b - r_b @ loads[1][0]
    moment = (
        inertia @ w_b_rate
        + np.cross(w_b, inertia @ w_b)
        - r_b @ loads[1][1]
        - np.cross(arm_b, force)
    )
    gap_acceleration = slide @ du[6 : 6 + slide.shape[1]] + slide_bias
    return Found(du[:3], r.T @ w_rate, gap_acceleration, a_b, r_b.T @ w_b_rate, force, moment)


def newton_euler(
    mass: float, inertia: Array, w: Array, force: Array, moment: Array
) -> tuple[Array, Array]:
    """Acceleration and w' of a free body, all in body axes: m a = F, J w' = M - w x J w."""
    return force / mass, np.linalg.solve(inertia, moment - np.cross(w, inertia @ w))


# of a case, that these equations fly, or that do not move a body
_TABLES: tuple[str, ...] = ("environment", "body", "motor", "joint", "phase", "initial", "run")
_TABLES += ("solver", "output", "clearance")


class _LagrangeFlight:
    """State and equations of one flight. The free bodies are flown as (x, v, R, w) each, x and v
    relative to the moving origin."""

    def __init__(self, case: Mapping[str, Any], rtol: float):
        refuse_others(case, _TABLES, "scene")
        ((self.joint, joint),) = case["joint"].items()
        refuse_others(
            joint,
            ("bodies", "point", "second_point", "x_axis", "y_axis", "apart", "kind"),
            f"joint.{self.joint}",
        )
        self.names, self.rtol = joint["bodies"], rtol
        self.A, self.B = (Body(name, case) for name in self.names)
        self.kinds = KINDS | {
            name: ("".join(k["translations"]), "".join(k["rotations"]))
            for name, k in joint.get("kind", {}).items()
        }
        ends = joint["point"], joint.get("second_point", joint["point"])
        x_axis, y_axis = (
            np.array(joint.get(f"{axis}_axis", default), float)
            for axis, default in (("x", (1, 0, 0)), ("y", (0, 1, 0)))
        )
        x_axis /= np.linalg.norm(x_axis)
        y_axis = y_axis - y_axis @ x_axis * x_axis
        y_axis /= np.linalg.norm(y_axis)
        axes = np.stack([x_axis, y_axis, np.cross(x_axis, y_axis)])
        self.pair = Pair(
            (self.A.mass, self.B.mass),
            (self.A.inertia, self.B.inertia),
            (self.A.from_cg(ends[0]), self.B.from_cg(ends[1])),
            axes,
        )
        mated = self.A.from_cg(self.B.cg)  # mass centre of A to that of B when closed
        self.apart = joint.get("apart") or (1.0 if mated @ x_axis >= 0.0 else -1.0)
        i = case["initial"]
        theta, sigma = i["pitch"] - i["alpha"], i.get("path_yaw", 0.0)
        self.velocity = i["speed"] * np.array(
            [np.cos(theta) * np.cos(sigma), np.sin(theta) * np.cos(sigma), -np.sin(sigma)]
        )
        self.altitude = i["altitude"]
        r = Rotation.from_euler("ZYX", [i["pitch"], i["yaw"], i["roll"]]).as_matrix()
        w = np.array(i["omega"], float)
        # of A from the common mass centre
        offset = -self.B.mass / (self.A.mass + self.B.mass) * mated
        gap = axes @ (self.A.from_cg(ends[1]) - self.A.from_cg(ends[0]))
        self.start_gap = float(gap[0])  # from which a separation is counted: not zero for a rod
        start = Motion(r @ offset, r @ np.cross(w, offset), r, w, gap, np.zeros(3), r, w)
        self.y = np.concatenate([np.ravel(part) for part in start])
        self.kind, self.t, self.t_mid = "", 0.0, 0.0

    def motion(self, y: Array) -> Motion:
        """Motion of the joined pair from the state vector (36,)."""
        return Motion(
            y[:3],
            y[3:6],
            y[6:15].reshape(3, 3),
            y[15:18],
            y[18:21],
            y[21:24],
            y[24:33].reshape(3, 3),
            y[33:36],
        )

    def bodies(self, y: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """(x, v, R, w) of A and of B from the state vector."""
        if self.kind != "free":
            return bodies(self.pair, self.motion(y))
        of_a, of_b = (
            (y[i : i + 3], y[i + 3 : i + 6], y[i + 6 : i + 15].reshape(3, 3), y[i + 15 : i + 18])
            for i in (0, 18)
        )
        return of_a, of_b

    def loads(self, t: float, y: Array) -> list[tuple[Array, Array]]:
        """External (force, moment) of A and of B, each in its own body axes."""
        return [
            body.loads(
                t, self.t_mid, self.altitude + self.velocity[1] * t + x[1], r, self.velocity + v
            )
            for body, (x, v, r, _) in zip((self.A, self.B), self.bodies(y), strict=True)
        ]

    def accelerate(self, t: float, y: Array) -> Found:
        """Accelerations and the reaction of the joined pair at time t, s."""
        return accelerate(self.pair, self.kinds[self.kind], self.motion(y), self.loads(t, y))

    def reaction(self) -> tuple[Array, Array]:
        """Force and moment on B at its joint point now, in the axes of A."""
        found, r = self.accelerate(self.t, self.y), self.motion(self.y).r
        return r.T @ found.force, r.T @ found.moment

    def derivative(self, t: float, y: Array) -> Array:
        """Rate of the state vector (36,) at time t, s, of the joined pair or of two free bodies."""
        loads = self.loads(t, y)
        out: list[Array] = []
        if self.kind == "free":
            for body, (_, v, r, w), (force, moment) in zip(
                (self.A, self.B), self.bodies(y), loads, strict=True
            ):
                a, w_rate = newton_euler(body.mass, body.inertia, w, force, moment)
                out += [v, r @ a, (r @ skew(w)).ravel(), w_rate]
            return np.concatenate(out)
        m = self.motion(y)
        found = accelerate(self.pair, self.kinds[self.kind], m, loads)
        out = [
            m.v,
            found.a,
            (m.r @ skew(m.w)).ravel(),
            found.w_rate,
            m.gap_rate,
            found.gap_acceleration,
        ]
        return np.concatenate([*out, (m.r_b @ skew(m.w_b)).ravel(), found.w_b_rate])

    def integrate(self, t_end: float, event: Any = None) -> tuple[float, Array]:
        """Time, s, and state at the end of a stretch by DOP853: at t_end (s), or at a terminal
        event."""
        found = solve_ivp(
            self.derivative,
            (self.t, t_end),
            self.y,
            "DOP853",
            rtol=self.rtol,
            atol=self.rtol * 1e-2,
            events=event,
        )
        if not found.success:
            raise RuntimeError(found.message)
        return found.t[-1], found.y[:, -1]

    def advance(self, t_end: float, stroke: float = np.inf) -> bool:
        """Fly a stretch without switches to t_end (s), or until the gap reaches the stroke (m);
        True if that ended it."""

        def event(t: float, y: Array) -> float:
            return self.apart * (y[18] - self.start_gap) - stroke

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        self.t_mid, watch = (
            0.5 * (self.t + t_end),
            self.kind != "free" and bool(np.isfinite(stroke)),
        )
        t, y = self.integrate(t_end, event if watch else None)
        hit = watch and (t < t_end or event(t, y) >= 0.0)
        # Newton on the end time, each time flown again from the start of the stretch
        for _ in range(6 if hit else 0):
            t, y = self.integrate(t)
            step = -event(t, y) / (self.apart * y[21])
            if abs(step) < 2e-16 + 1e-15 * t:
                break
            t += step
        self.t, self.y = t, y
        return hit


def fly(case: Mapping[str, Any], rtol: float = 1e-13) -> dict[str, Any]:
    """Fly a case of two bodies and one joint and return its outcomes at the end time.

    Parameters
    ----------
    case : dict
        Nested like the campaign file, in SI and radians, keys without unit suffix, as
        `sepmc.campaign.definition.Case.to_dict` gives it. ``until.time`` is counted from the start;
        ``stroke`` is the separation distance along the joint's x axis, which counts from the start.
        ``initial.path_reference`` (rad), if given, adds ``*_alpha_ref_deg`` = pitch -
        path_reference.
    rtol : float
        Relative tolerance of DOP853; the absolute one is ``rtol / 100`` in SI units.

    Returns
    -------
    dict
        Outcomes under their public names, and the reaction on the second body (B) at its joint
        point in the axes of the first: ``release_force_on_B_N`` and ``release_moment_on_B_N_m`` at
        the last instant before release (NaN if never released), ``end_force_on_B_N`` and
        ``end_moment_on_B_N_m`` at the end time (zero if released).

    Raises
    ------
    ValueError
        If the case has what these formulations do not know: springs, tables, other conditions.
    """
    flight, end = _LagrangeFlight(case, rtol), case["run"]["end_time"]
    release, force, moment = np.nan, np.full(3, np.nan), np.full(3, np.nan)
    switches = sorted(
        t for b in (flight.A, flight.B) for m in b.motors for t in (m["ignition"], m["burnout"])
    )
    for phase in case["phase"]:
        kind, until = phase.get("joints", {}).get(flight.joint, "free"), phase.get("until", {})
        refuse_others(until, ("time", "joint", "stroke"), f"phase.{phase['name']}.until")
        if kind == "free" and flight.kind != "free":
            if flight.kind:
                release = flight.t
                force, moment = flight.reaction()
            flight.y = np.concatenate(
                [
                    np.ravel(part)
                    for body in bodies(flight.pair, flight.motion(flight.y))
                    for part in body
                ]
            )
        flight.kind = kind
        stop, stroke = min(until.get("time", np.inf), end), until.get("stroke", np.inf)
        done = kind != "free" and bool(flight.apart * (flight.y[18] - flight.start_gap) >= stroke)
        while flight.t < stop and not done:
            done = flight.advance(min([t for t in switches if t > flight.t] + [stop]), stroke)
        if flight.t >= end:
            break
    if flight.t < end:
        raise ValueError("the last phase stops before the end time")
    second = flight.names[1]
    last = flight.reaction() if flight.kind != "free" else (np.zeros(3), np.zeros(3))
    reactions = {f"release_force_on_{second}_N": force, f"release_moment_on_{second}_N_m": moment}
    reactions |= {f"end_force_on_{second}_N": last[0], f"end_moment_on_{second}_N_m": last[1]}
    return {
        "release_time_s": release,
        **_outcomes(flight, case["initial"].get("path_reference")),
        **reactions,
    }


def _outcomes(flight: _LagrangeFlight, path_reference: float | None) -> dict[str, Any]:
    """Angles and rates of both bodies, and the separation, under their public names."""
    out: dict[str, Any] = {}
    states = flight.bodies(flight.y)
    for name, body, (_, v, r, w) in zip(flight.names, (flight.A, flight.B), states, strict=True):
        _, alpha, beta = body.air(r, flight.velocity + v)
        pitch = np.arctan2(r[1, 0], r[0, 0])
        angles = {
            "alpha": alpha,
            "beta": beta,
            "roll": np.arctan2(r[2, 1], r[2, 2]),
            "yaw": -np.arcsin(r[2, 0]),
            "pitch": pitch,
        }
        if path_reference is not None:
            angles["alpha_ref"] = pitch - path_reference
        out |= {f"{name}_{key}_deg": np.degrees(value) for key, value in angles.items()}
        out |= {
            f"{name}_omega_{axis}_deg_s": np.degrees(value)
            for axis, value in zip("xyz", w, strict=True)
        }
    (xa, va, ra, wa), (xb, vb, rb, wb) = states
    arm_a, arm_b = flight.pair.arm
    # axes of A, in which its rate is that of the separation
    gap = ra.T @ (xb + rb @ arm_b - xa) - arm_a
    gap_rate = ra.T @ (vb + rb @ np.cross(wb, arm_b) - va) - np.cross(wa, arm_a + gap)
    out["separation_distance_mm"] = (
        1e3 * flight.apart * (gap @ flight.pair.axes[0] - flight.start_gap)
    )
    out["separation_speed_m_s"] = flight.apart * gap_rate @ flight.pair.axes[0]
    return out
