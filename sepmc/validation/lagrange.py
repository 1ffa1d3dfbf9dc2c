"""Reference simulation of a separation by classical formulations: Lagrange's in minimal coordinates
while two bodies are joined, Newton's and Euler's once they are free.

Frames, signs and angle order are those of CONVENTIONS.md. All is in SI and radians; only outcome
names carry other units. The joint connects its first body (A, which carries the joint axes) with
its second (B).

No constraint force is solved for. While the bodies are joined, the unknowns are independent speeds:
the velocity and rates of A, the rates of the gap d along the free joint axes, and the relative
rates u about the free rotation axes, the columns of H. The accelerations follow from the principle
of virtual power (Lagrange's equations in quasi-coordinates; Kane and Levinson, "Dynamics: Theory
and Applications", 1985, ch. 6): the sum over bodies of V^T (F - m a) + W^T (M - J w' - w x J w)
vanishes, where V and W are the partial velocities. The reaction is the residual of Newton's and
Euler's equations of B. Attitudes are integrated as rotation matrices, R' = R [w x]. Positions are
relative to a point that moves with the constant initial velocity of the mass centre, so that 7e4 m
never enters a difference. tests/validation/test_formulations.py derives the slider pair with
sympy's LagrangesMethod and KanesMethod and compares the accelerations.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sepmc.validation.classical_loads import Body, refuse_others

Array = np.ndarray
# Constrained joint axes in translation and rotation, by kind; section 2 of the paper.
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
# With one relative rotation constrained, B turns about one axis of A and one of its own, which stay
# perpendicular.
PERPENDICULAR = {"x": ("z", "y"), "y": ("z", "x"), "z": ("y", "x")}


def skew(a: Array) -> Array:
    """Matrix (3, 3) of the cross product with ``a`` (3,): ``skew(a) @ b == cross(a, b)``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True)
class Pair:
    """Masses and geometry of two rigid bodies, A and B, connected by a joint.

    Attributes
    ----------
    mass : tuple of float
        Of A and B, kg.
    inertia : tuple of ndarray, shape (3, 3)
        Tensors of A and B about their mass centres, kg m2, body axes.
    arm : tuple of ndarray, shape (3,)
        Vectors from the mass centres of A and B to their joint points, m, body axes.
    axes : ndarray, shape (3, 3)
        Rows: joint axes, as unit vectors in the body axes of A.
    """

    mass: tuple[float, float]
    inertia: tuple[Array, Array]
    arm: tuple[Array, Array]
    axes: Array


class Motion(NamedTuple):
    """Motion of a joined pair at one instant.

    Attributes
    ----------
    x, v : ndarray, shape (3,)
        Position, m, and velocity, m/s, of the mass centre of A, ground axes.
    r, r_b : ndarray, shape (3, 3)
        Attitudes of A and B: rotation matrices from body to ground axes.
    w, w_b : ndarray, shape (3,)
        Angular rates of A and B, rad/s, each in its body axes.
    gap, gap_rate : ndarray, shape (3,)
        Vector from the joint point of A to that of B, m, in joint axes, and the rates of its
        components, m/s.
    """

    x: Array
    v: Array
    r: Array
    w: Array
    gap: Array
    gap_rate: Array
    r_b: Array
    w_b: Array


class Accelerations(NamedTuple):
    """Accelerations of a joined pair, and the reaction of its joint.

    Attributes
    ----------
    a, a_b : ndarray, shape (3,)
        Of the mass centres of A and B, m/s2, ground axes.
    w_rate, w_b_rate : ndarray, shape (3,)
        Angular accelerations of A and B, rad/s2, each in its body axes.
    gap_acceleration : ndarray, shape (3,)
        Second time derivatives of the components of the gap, m/s2, joint axes.
    force, moment : ndarray, shape (3,)
        Reaction on B at its joint point, N and N m, ground axes.
    """

    a: Array
    w_rate: Array
    gap_acceleration: Array
    a_b: Array
    w_b_rate: Array
    force: Array
    moment: Array


def bodies(pair: Pair, motion: Motion) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """(x, v, R, w) of A and of B from the motion of the pair: positions and velocities of the mass
    centres in ground axes, attitudes from body to ground, rates in body axes."""
    x, v, r, w, gap, gap_rate, r_b, w_b = motion
    lever = pair.arm[0] + pair.axes.T @ gap
    x_b = x + r @ lever - r_b @ pair.arm[1]
    v_b = v + r @ (np.cross(w, lever) + pair.axes.T @ gap_rate) - r_b @ np.cross(w_b, pair.arm[1])
    return (x, v, r, w), (x_b, v_b, r_b, w_b)


def _translations(constrained: str, motion: Motion) -> tuple[Array, Array]:
    """Directions (3, n), as columns, in which the gap may change, and the part (3,) of its second
    time derivative that follows from the velocities alone; joint axes. ``constrained`` has the
    letters of the constrained axes, such as "yz", or is "length" for a rod."""
    if constrained != "length":
        return np.eye(3)[:, [axis not in constrained for axis in "xyz"]], np.zeros(3)
    axial = motion.gap / np.linalg.norm(motion.gap)
    across = np.linalg.svd(axial[None])[2][1:].T  # any two directions normal to the rod
    return across, -(motion.gap_rate @ motion.gap_rate) / (motion.gap @ motion.gap) * motion.gap


def _rotations(
    constrained: str, pair: Pair, motion: Motion, w: Array, w_b: Array
) -> tuple[Array, Array]:
    """Axes H (3, n), as columns, about which B may rotate relative to A, and H' u (3,), with u the
    rates about them: the part of the relative angular acceleration that follows from the rates
    alone; ground axes.

    ``constrained`` has the letters of the constrained rotations, such as "yz"; the rates w of A and
    w_b of B, rad/s, are in ground axes too.
    """
    of_a, of_b = (dict(zip("xyz", pair.axes @ r.T, strict=True)) for r in (motion.r, motion.r_b))
    if len(constrained) == 0:
        return np.eye(3), np.zeros(3)
    if len(constrained) == 1:
        first, second = PERPENDICULAR[constrained]
        p, q = of_a[first], of_b[second]
        return np.stack([p, q], axis=1), p @ (w_b - w) * np.cross(w, p) + q @ (w_b - w) * np.cross(
            w_b, q
        )
    if len(constrained) == 2:
        e = of_a[next(axis for axis in "xyz" if axis not in constrained)]
        return e[:, None], e @ (w_b - w) * np.cross(w, e)
    return np.zeros((3, 0)), np.zeros(3)


def accelerate(
    pair: Pair, constrained: tuple[str, str], motion: Motion, loads: list[tuple[Array, Array]]
) -> Accelerations:
    """Accelerations of a joined pair and the reaction of its joint, by the principle of virtual
    power.

    Parameters
    ----------
    pair : Pair
    constrained : tuple of str
        Joint axes constrained in translation and in rotation: a value of `KINDS`.
    motion : Motion
    loads : list of (ndarray, ndarray)
        External force, N, and moment about the mass centre, N m, on A and on B, in body axes.
    """
    r, r_b = motion.r, motion.r_b
    w, w_b = r @ motion.w, r_b @ motion.w_b
    lever, arm_b = r @ (pair.arm[0] + pair.axes.T @ motion.gap), r_b @ pair.arm[1]
    to_ground = r @ pair.axes.T
    slide, slide_bias = _translations(constrained[0], motion)
    turn, turn_bias = _rotations(constrained[1], pair, motion, w, w_b)
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
    return Accelerations(
        du[:3], r.T @ w_rate, gap_acceleration, a_b, r_b.T @ w_b_rate, force, moment
    )


def newton_euler(
    mass: float, inertia: Array, w: Array, force: Array, moment: Array
) -> tuple[Array, Array]:
    """Acceleration, m/s2, and angular acceleration w', rad/s2, of a free body with rates w, rad/s:
    m a = F, J w' = M - w x J w. All vectors are in body axes; the moment is about the mass
    centre."""
    return force / mass, np.linalg.solve(inertia, moment - np.cross(w, inertia @ w))


# tables of a case that these equations include, or that do not affect the motion
_TABLES: tuple[str, ...] = ("environment", "body", "motor", "joint", "phase", "initial", "run")
_TABLES += ("solver", "output", "clearance")


class _Simulation:
    """State and equations of one simulation of a case.

    The state vector ``y`` (36,) has the fields of `Motion` one after the other while the bodies are
    joined, and (x, v, R, w) of A and then of B once they are free. Positions and velocities are
    relative to an origin that moves with the initial velocity of the mass centre.

    ``t`` is the time reached, s; ``t_mid`` the middle of the interval that is integrated, s;
    ``kind`` the kind of the joint in the present phase (empty before the first). ``names`` are the
    names of the bodies ``A`` and ``B``, and ``start_gap`` is the gap along the joint's x axis at
    the start, m.
    """

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
        self.separation_sign = joint.get("apart") or (1.0 if mated @ x_axis >= 0.0 else -1.0)
        i = case["initial"]
        theta, sigma = i["pitch"] - i["alpha"], i.get("path_yaw", 0.0)
        self.velocity = i["speed"] * np.array(
            [np.cos(theta) * np.cos(sigma), np.sin(theta) * np.cos(sigma), -np.sin(sigma)]
        )
        self.altitude = i["altitude"]
        r = Rotation.from_euler("ZYX", [i["pitch"], i["yaw"], i["roll"]]).as_matrix()
        w = np.array(i["omega"], float)
        # position of A from the common mass centre
        offset = -self.B.mass / (self.A.mass + self.B.mass) * mated
        gap = axes @ (self.A.from_cg(ends[1]) - self.A.from_cg(ends[0]))
        self.start_gap = float(gap[0])  # reference of the separation: not zero for a rod
        start = Motion(r @ offset, r @ np.cross(w, offset), r, w, gap, np.zeros(3), r, w)
        self.y = np.concatenate([np.ravel(part) for part in start])
        self.kind, self.t, self.t_mid = "", 0.0, 0.0

    def motion(self, y: Array) -> Motion:
        """Split the state vector (36,) of the joined pair into a `Motion`."""
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
        """(x, v, R, w) of A and of B, each as the function `bodies` returns it, from the state
        vector (36,), of joined or of free bodies."""
        if self.kind != "free":
            return bodies(self.pair, self.motion(y))
        of_a, of_b = (
            (y[i : i + 3], y[i + 3 : i + 6], y[i + 6 : i + 15].reshape(3, 3), y[i + 15 : i + 18])
            for i in (0, 18)
        )
        return of_a, of_b

    def loads(self, t: float, y: Array) -> list[tuple[Array, Array]]:
        """External force, N, and moment about the mass centre, N m, of gravity, motors and air on A
        and on B, each in its body axes, at time t, s, and the state vector ``y`` (36,), of joined
        or of free bodies."""
        return [
            body.loads(
                t, self.t_mid, self.altitude + self.velocity[1] * t + x[1], r, self.velocity + v
            )
            for body, (x, v, r, _) in zip((self.A, self.B), self.bodies(y), strict=True)
        ]

    def accelerate(self, t: float, y: Array) -> Accelerations:
        """Accelerations of the joined pair and the reaction of its joint, at time t, s, and the
        state vector ``y`` (36,), which has the fields of `Motion`."""
        return accelerate(self.pair, self.kinds[self.kind], self.motion(y), self.loads(t, y))

    def reaction(self) -> tuple[Array, Array]:
        """Force, N, and moment, N m, of the joint on B at its joint point, in the body axes of A,
        at the time that the simulation has reached; only while the bodies are joined."""
        accelerations, r = self.accelerate(self.t, self.y), self.motion(self.y).r
        return r.T @ accelerations.force, r.T @ accelerations.moment

    def derivative(self, t: float, y: Array) -> Array:
        """Time derivative (36,) of the state vector ``y`` (36,) at time t, s: of the fields of
        `Motion` while the bodies are joined; of (x, v, R, w) of A, then of B, once ``kind`` is
        "free"."""
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
        accelerations = accelerate(self.pair, self.kinds[self.kind], m, loads)
        out = [
            m.v,
            accelerations.a,
            (m.r @ skew(m.w)).ravel(),
            accelerations.w_rate,
            m.gap_rate,
            accelerations.gap_acceleration,
        ]
        return np.concatenate([*out, (m.r_b @ skew(m.w_b)).ravel(), accelerations.w_b_rate])

    def integrate(self, t_end: float, event: Any = None) -> tuple[float, Array]:
        """Integrate from the present time and state to t_end, s, by DOP853, or to a zero of
        ``event``, a terminal event of `solve_ivp`. Return the time, s, and the state vector
        reached, and leave the present ones as they are. Raises RuntimeError if the integration
        fails."""
        solution = solve_ivp(
            self.derivative,
            (self.t, t_end),
            self.y,
            "DOP853",
            rtol=self.rtol,
            atol=self.rtol * 1e-2,
            events=event,
        )
        if not solution.success:
            raise RuntimeError(solution.message)
        return solution.t[-1], solution.y[:, -1]

    def advance(self, t_end: float, stroke: float = np.inf) -> bool:
        """Integrate to t_end, s, or until the separation distance reaches the stroke, m (infinite
        for none), and store the time and state reached. Return True if the stroke ended the
        interval; once the bodies are free the stroke is ignored, and the result is False. No motor
        may ignite or burn out within the interval."""

        def event(t: float, y: Array) -> float:
            """Separation distance minus the stroke, m."""
            return self.separation_sign * (y[18] - self.start_gap) - stroke

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        self.t_mid, monitored = (
            0.5 * (self.t + t_end),
            self.kind != "free" and bool(np.isfinite(stroke)),
        )
        t, y = self.integrate(t_end, event if monitored else None)
        reached = monitored and (t < t_end or event(t, y) >= 0.0)
        # Newton's method on the end time, integrated from the start of the interval each time
        for _ in range(6 if reached else 0):
            t, y = self.integrate(t)
            step = -event(t, y) / (self.separation_sign * y[21])
            if abs(step) < 2e-16 + 1e-15 * t:
                break
            t += step
        self.t, self.y = t, y
        return reached


def simulate(case: Mapping[str, Any], rtol: float = 1e-13) -> dict[str, Any]:
    """Simulate a case of two bodies and one joint, and return its outcomes at the end time.

    Parameters
    ----------
    case : dict
        Nested like the campaign file, in SI and radians, keys without unit suffix, as
        `sepmc.campaign.definition.Case.to_dict` returns it. ``until.time`` counts from the start of
        the case; ``stroke`` is the separation distance along the joint's x axis, zero at the start.
        ``initial.path_reference`` (rad), if given, adds ``BODY_alpha_ref_deg`` = pitch -
        path_reference.
    rtol : float
        Relative tolerance of DOP853; the absolute one is ``rtol / 100`` in SI units.

    Returns
    -------
    dict
        Outcomes by public name, and the reaction on the second body at its joint point in the body
        axes of the first; for a second body named B: ``release_force_on_B_N`` and
        ``release_moment_on_B_N_m`` at the last instant before release (NaN if never released),
        ``end_force_on_B_N`` and ``end_moment_on_B_N_m`` at the end time (zero if released).

    Raises
    ------
    ValueError
        If the case has features outside of these formulations (springs, tables, other conditions),
        or its last phase ends before the end time.
    """
    simulation, end = _Simulation(case, rtol), case["run"]["end_time"]
    release, force, moment = np.nan, np.full(3, np.nan), np.full(3, np.nan)
    switches = sorted(
        t
        for b in (simulation.A, simulation.B)
        for m in b.motors
        for t in (m["ignition"], m["burnout"])
    )
    for phase in case["phase"]:
        kind, until = phase.get("joints", {}).get(simulation.joint, "free"), phase.get("until", {})
        refuse_others(until, ("time", "joint", "stroke"), f"phase.{phase['name']}.until")
        if kind == "free" and simulation.kind != "free":
            if simulation.kind:
                release = simulation.t
                force, moment = simulation.reaction()
            simulation.y = np.concatenate(
                [
                    np.ravel(part)
                    for body in bodies(simulation.pair, simulation.motion(simulation.y))
                    for part in body
                ]
            )
        simulation.kind = kind
        stop, stroke = min(until.get("time", np.inf), end), until.get("stroke", np.inf)
        done = kind != "free" and bool(
            simulation.separation_sign * (simulation.y[18] - simulation.start_gap) >= stroke
        )
        while simulation.t < stop and not done:
            done = simulation.advance(
                min([t for t in switches if t > simulation.t] + [stop]), stroke
            )
        if simulation.t >= end:
            break
    if simulation.t < end:
        raise ValueError(
            "phase: the last one ends before run.end_time; it must have no until, or a later one"
        )
    second = simulation.names[1]
    last = simulation.reaction() if simulation.kind != "free" else (np.zeros(3), np.zeros(3))
    reactions = {f"release_force_on_{second}_N": force, f"release_moment_on_{second}_N_m": moment}
    reactions |= {f"end_force_on_{second}_N": last[0], f"end_moment_on_{second}_N_m": last[1]}
    return {
        "release_time_s": release,
        **_outcomes(simulation, case["initial"].get("path_reference")),
        **reactions,
    }


def _outcomes(simulation: _Simulation, path_reference: float | None) -> dict[str, Any]:
    """Angles, deg, and rates, deg/s, of both bodies, separation distance, mm, and speed, m/s, at
    the time that the simulation has reached, by public name. With a ``path_reference``, rad, also
    ``BODY_alpha_ref_deg``."""
    out: dict[str, Any] = {}
    states = simulation.bodies(simulation.y)
    for name, body, (_, v, r, w) in zip(
        simulation.names, (simulation.A, simulation.B), states, strict=True
    ):
        _, alpha, beta = body.air(r, simulation.velocity + v)
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
    arm_a, arm_b = simulation.pair.arm
    # axes of A, in which its rate is that of the separation
    gap = ra.T @ (xb + rb @ arm_b - xa) - arm_a
    gap_rate = ra.T @ (vb + rb @ np.cross(wb, arm_b) - va) - np.cross(wa, arm_a + gap)
    out["separation_distance_mm"] = (
        1e3 * simulation.separation_sign * (gap @ simulation.pair.axes[0] - simulation.start_gap)
    )
    out["separation_speed_m_s"] = simulation.separation_sign * gap_rate @ simulation.pair.axes[0]
    return out
