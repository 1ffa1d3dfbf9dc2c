"""Simulation by heyoka: minimal coordinates, Taylor series to round-off, its own event detection.

F. Biscani and D. Izzo, "Revisiting high-order Taylor methods for astrodynamics and celestial
mechanics", MNRAS 504(2), 2021. The equations are Kane's (Kane and Levinson, "Dynamics: Theory and
Applications", 1985, ch. 6), built here as expressions for any tree of bodies: no constraint is
solved for. Bodies connected by fixed joints are one body. Joint forces follow from Newton and
Euler.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import heyoka as hy
import numpy as np

from oracles.external_engines import loads
from oracles.external_engines.case import GROUND, Array, Case, Motion, cross
from oracles.external_engines.schedule import Guard, Mode, PeerFlight, Wrench
from oracles.external_engines.schedule import fly as fly_through
from oracles.external_engines.tree import Group, Link, newton_euler, tree_of

TOLERANCE = 1e-17  # of the Taylor integrator; below round-off, so that what is left is round-off


@dataclass
class Kinematics:
    """Kinematics of a group of bodies: its motion, and its accelerations as V u' + A (ground axes)
    and W u' + B (body axes)."""

    motion: Motion
    V: Array
    A: Array
    W: Array
    B: Array


def _zeros(*shape: int) -> Array:
    return np.zeros(shape).astype(object)


def _columns(a: Array, m: Array) -> Array:
    """a x every column of m."""
    return np.column_stack([cross(a, m[:, i]) for i in range(m.shape[1])])


def _either(name: str) -> Any:
    """Function of heyoka that accepts numbers too."""
    of_numbers, of_expressions = getattr(math, name), getattr(hy, name)

    def call(*args: Any) -> Any:
        return (
            of_expressions(*args)
            if any(isinstance(x, hy.expression) for x in args)
            else of_numbers(*(float(x) for x in args))
        )

    return staticmethod(call)


class Functions:
    """Functions in the formulas of the loads, of numbers and of expressions."""

    exp, log, sqrt, atan2 = (_either(name) for name in ("exp", "log", "sqrt", "atan2"))


class States:
    """State variables of a mode, their derivatives and present values."""

    def __init__(self) -> None:
        self.variables: list[Any] = []
        self.derivatives: dict[int, Any] = {}
        self.values: list[float] = []
        self.speeds: list[Any] = []  # the generalised speeds u
        self.speed_at: list[int] = []

    def add(self, label: str, values: Array, speed: bool = False) -> Array:
        """Add variables with values; derivatives follow later, those of speeds from the equations
        of motion."""
        made = [hy.make_vars(f"{label}_{i}") for i in range(np.size(values))]
        if speed:
            self.speed_at += range(len(self.variables), len(self.variables) + len(made))
            self.speeds += made
        self.variables += made
        self.values += [float(v) for v in np.ravel(values)]
        return np.array(made, dtype=object).reshape(np.shape(values))

    def derive(self, variables: Array, rates: Any) -> None:
        """Set the derivatives of variables."""
        place = {str(v): i for i, v in enumerate(self.variables)}
        for variable, rate in zip(np.ravel(variables), np.ravel(rates), strict=True):
            self.derivatives[place[str(variable)]] = rate


def _skew(w: Any) -> Array:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]], dtype=object)


class System:
    """Equations of motion of a case in one mode, from the motions at its beginning."""

    def __init__(self, case: Case, mode: Mode, now: dict[str, Motion]):
        self.case, self.mode = case, mode
        self.groups, self.links = tree_of(case, mode.kinds)
        self.states = States()
        speeds = self._declare(now)
        size = len(self.states.speeds)
        kin = self._kinematics(now, speeds, size)
        self.motions = self._body_motions(kin, now)
        mass, force = self._equations(kin, size)
        self.accelerations = _solve(mass, force)
        for at, value in zip(self.states.speed_at, self.accelerations, strict=True):
            self.states.derivatives[at] = value
        self.kin = kin
        # everything stands still on the ground: a clock, so that there is something to integrate
        if not self.states.variables:
            self.states.derive(self.states.add("clock", np.zeros(1)), np.ones(1))

    def _declare(self, now: dict[str, Motion]) -> list[Any]:
        """State variables of every group."""
        out = []
        for i, (group, link) in enumerate(zip(self.groups, self.links, strict=True)):
            has: dict[str, Any] = {}
            lead = now[group.lead]
            centre = Motion(
                lead.point(group.centre), lead.point_velocity(group.centre), lead.R, lead.w
            )
            if group.grounded:
                out.append(has)
                continue
            if link is None or link.turns or link.axes:
                has["R"] = self.states.add(f"R{i}", lead.R)
            if link is None:
                has["x"], has["v"] = (
                    self.states.add(f"x{i}", centre.x),
                    self.states.add(f"v{i}", centre.v, speed=True),
                )
                has["w"] = self.states.add(f"w{i}", centre.w, speed=True)
            else:
                a, b = now[link.parent], now[link.child]
                gap = a.R.T @ (b.point(link.arm_child) - a.point(link.arm_parent))
                if link.slides:
                    rate = a.R.T @ (
                        b.point_velocity(link.arm_child) - a.point_velocity(link.arm_parent)
                    ) - cross(a.w, gap)
                    E = np.array(link.slides)
                    has["s"], has["ds"] = (
                        self.states.add(f"s{i}", E @ gap),
                        self.states.add(f"ds{i}", E @ rate, speed=True),
                    )
                if link.axes:
                    turn, about = (
                        b.w - b.R.T @ a.R @ a.w,
                        np.array([b.R.T @ a.R @ link.axes[0], *link.axes[1:]]),
                    )
                    # the axes are at right angles
                    has["q"] = self.states.add(f"q{i}", about @ turn, speed=True)
                if link.turns:
                    has["w"] = self.states.add(f"w{i}", b.w, speed=True)
            out.append(has)
        return out

    def _kinematics(self, now: dict[str, Motion], has: list[Any], size: int) -> list[Kinematics]:
        """Motion and partial velocities of every group, parents before children."""
        column = {str(u): k for k, u in enumerate(self.states.speeds)}

        def unit(variables: Array) -> Array:
            m = _zeros(3, size)
            for i, u in enumerate(variables):
                m[i, column[str(u)]] = 1.0
            return m

        out: list[Kinematics] = []
        for group, link, own in zip(self.groups, self.links, has, strict=True):
            none, still = _zeros(3, size), _zeros(3)
            if group.grounded:
                ground = now[GROUND]
                velocity = -self.case.velocity.astype(object)
                out.append(
                    Kinematics(
                        Motion(ground.x.astype(object), velocity, ground.R.astype(object), still),
                        none,
                        still,
                        none,
                        still,
                    )
                )
                continue
            if link is None:
                self.states.derive(own["x"], own["v"])
                motion = Motion(own["x"], own["v"], own["R"], own["w"])
                out.append(Kinematics(motion, unit(own["v"]), still, unit(own["w"]), still))
                self.states.derive(own["R"], own["R"] @ _skew(own["w"]))
                continue
            out.append(self._child(out[link.parent_group], group, link, own, unit))
        return out

    def _child(
        self, p: Kinematics, group: Group, link: Link, own: dict[str, Any], unit: Any
    ) -> Kinematics:
        """Kinematics of a group connected to its parent by a joint."""
        R_p, w_p = p.motion.R, p.motion.w
        # gap at the joint, its rate in the parent, and that by the speeds
        s, ds, D = _zeros(3), _zeros(3), p.V * 0.0
        if "s" in own:
            E = np.array(link.slides).T
            s, ds, D = E @ own["s"], E @ own["ds"], E @ unit(own["ds"])[: len(own["ds"])]
            self.states.derive(own["s"], own["ds"])
        # rotation
        if link.turns:
            R, w, W, B = own["R"], own["w"], unit(own["w"]), p.B * 0.0
        elif not link.axes:
            R, w, W, B = R_p, w_p, p.W, p.B
        else:
            R, q = own["R"], own["q"]
            Q = R.T @ R_p
            first = Q @ link.axes[0]
            about = np.column_stack([first, *link.axes[1:]])
            turn = about @ q
            w, W = Q @ w_p + turn, Q @ p.W + about @ unit(q)[: len(q)]
            B = Q @ p.B - cross(turn, Q @ w_p + first * q[0])
        if "R" in own:
            self.states.derive(R, R @ _skew(w))
        # translation
        # from the parent's centre to the child's joint point, axes of the parent
        r = link.from_parent + s
        arm = link.to_child  # from the joint point to the child's centre, axes of the child
        x = p.motion.x + R_p @ r + R @ arm
        v = p.motion.v + R_p @ (cross(w_p, r) + ds) + R @ cross(w, arm)
        V = p.V + R_p @ (D - _columns(r, p.W)) - R @ _columns(arm, W)
        A = (
            p.A
            + R_p @ (cross(p.B, r) + cross(w_p, cross(w_p, r)) + 2.0 * cross(w_p, ds))
            + R @ (cross(B, arm) + cross(w, cross(w, arm)))
        )
        return Kinematics(Motion(x, v, R, w), V, A, W, B)

    def _body_motions(self, kin: list[Kinematics], now: dict[str, Motion]) -> dict[str, Motion]:
        out = {GROUND: self.case.ground_motion(hy.time)}
        for group, k in zip(self.groups, kin, strict=True):
            for name, arm in group.arms.items():
                if name != GROUND:
                    out[name] = Motion(
                        k.motion.point(arm), k.motion.point_velocity(arm), k.motion.R, k.motion.w
                    )
        return out

    def wrenches(self) -> dict[str, Wrench]:
        """Wrenches of every joint, as expressions."""
        moving = body_accelerations(
            self.groups, [(k.V, k.A, k.W, k.B) for k in self.kin], self.accelerations, self.motions
        )
        external = loads.body_loads(self.case, self.motions, hy.time, self.mode, Functions)
        return newton_euler(self.case, self.mode, self.motions, moving, external)

    def _equations(self, kin: list[Kinematics], size: int) -> tuple[Array, Array]:
        """Mass matrix and right-hand side of Kane's equations."""
        on_bodies = loads.body_loads(self.case, self.motions, hy.time, self.mode, Functions)
        mass, rhs = _zeros(size, size), _zeros(size)
        for group, k in zip(self.groups, kin, strict=True):
            if group.grounded:
                continue
            force, moment = _zeros(3), _zeros(3)
            for name, arm in group.arms.items():
                f, m = on_bodies[name]
                force, moment = force + f, moment + m + cross(arm, k.motion.R.T @ f)
            w, inertia = k.motion.w, group.inertia
            mass = mass + group.mass * (k.V.T @ k.V) + k.W.T @ (inertia @ k.W)
            rhs = (
                rhs
                + k.V.T @ (force - group.mass * k.A)
                + k.W.T @ (moment - inertia @ k.B - cross(w, inertia @ w))
            )
        return mass, rhs


def _solve(mass: Array, rhs: Array) -> Array:
    """Solution of a symmetric positive definite system of expressions: L D L^T, written out."""
    n = len(rhs)
    L, D = np.eye(n).astype(object), _zeros(n)
    for j in range(n):
        D[j] = mass[j, j] - sum((L[j, k] * L[j, k] * D[k] for k in range(j)), 0.0)
        for i in range(j + 1, n):
            L[i, j] = (mass[i, j] - sum((L[i, k] * L[j, k] * D[k] for k in range(j)), 0.0)) / D[j]
    y = _zeros(n)
    for i in range(n):
        y[i] = rhs[i] - sum((L[i, k] * y[k] for k in range(i)), 0.0)
    x = _zeros(n)
    for i in reversed(range(n)):
        x[i] = y[i] / D[i] - sum((L[k, i] * x[k] for k in range(i + 1, n)), 0.0)
    return x


class Heyoka:
    """One run."""

    def __init__(self, case: Case, tolerance: float = TOLERANCE):
        self.case, self.tolerance, self.t = case, tolerance, 0.0
        self.now = case.initial()
        self.key = ""
        self.system: System | None = None

    def switch(self, mode: Mode) -> None:
        """Enter a mode; its equations are built if it is a new one."""
        if mode.key() != self.key:
            self.key, self.mode = mode.key(), mode
            self.system = System(self.case, mode, self.now)
            self.integrators: dict[tuple[Guard, ...], Any] = {}
            self.y = np.array(self.system.states.values)
            flat = []
            for name in self.case.bodies:
                m = self.system.motions[name]
                flat += [*m.x, *m.v, *m.R.ravel(), *m.w]
            self.tell = hy.cfunc(
                _expressions(flat), self.system.states.variables, compact_mode=True
            )
            self.rates = hy.cfunc(
                _expressions([*self.system.accelerations, 0.0]),
                self.system.states.variables,
                compact_mode=True,
            )
            self.partials = hy.cfunc(
                _expressions(self._partials()), self.system.states.variables, compact_mode=True
            )

    def _partials(self) -> list[Any]:
        assert self.system is not None
        return [x for k in self.system.kin for part in (k.V, k.A, k.W, k.B) for x in part.ravel()]

    def _integrator(self, guards: tuple[Guard, ...]) -> Any:
        if guards not in self.integrators:
            assert self.system is not None
            s = self.system.states
            equations = [(v, _expression(s.derivatives[i])) for i, v in enumerate(s.variables)]
            events = [
                hy.t_event(
                    _expression(
                        g.value(
                            self.case,
                            self.system.motions,
                            hy.time,
                            Functions,
                            self.system.wrenches() if g.on_load else None,
                        )
                    ),
                    direction=hy.event_direction.positive,
                )
                for g in guards
            ]
            self.integrators[guards] = hy.taylor_adaptive(
                equations, self.y, t_events=events, tol=self.tolerance, compact_mode=True
            )
        return self.integrators[guards]

    def advance(self, t_end: float, guards: list[Guard]) -> tuple[float, Guard | None]:
        """Integrate to ``t_end`` (s) or to the first guard, by heyoka's event detection; returns
        the time and the guard."""
        ta = self._integrator(tuple(guards))
        ta.time, ta.state[:] = self.t, self.y
        if guards:
            ta.reset_cooldowns()
        outcome = ta.propagate_until(t_end)[0]
        self.t, self.y = ta.time, ta.state.copy()
        self.now = self.motions()
        if outcome == hy.taylor_outcome.time_limit:
            return self.t, None
        index = -int(outcome) - 1
        if not 0 <= index < len(guards):
            raise RuntimeError(f"heyoka: {outcome} at {self.t} s")
        return self.t, guards[index]

    def motions(self) -> dict[str, Motion]:
        """Present motion of every body and of the ground."""
        out = {GROUND: self.case.ground_motion(self.t)}
        if self.system is None:
            return self.case.initial()
        told = self.tell(self.y, time=self.t).reshape(-1, 18)
        for name, row in zip(self.case.bodies, told, strict=True):
            out[name] = Motion(row[:3], row[3:6], row[6:15].reshape(3, 3), row[15:])
        return out

    def wrenches(self) -> dict[str, Wrench]:
        """Newton and Euler on the bodies beyond each joint."""
        assert self.system is not None
        speeds = self.rates(self.y, time=self.t)[:-1]
        told, at, size = self.partials(self.y, time=self.t), 0, len(speeds)
        motions, partials = self.motions(), []
        for _ in self.system.groups:
            V, A, W, B = (told[at + i : at + j].reshape(3, -1) for i, j in _spans(size))
            partials.append((V, A[:, 0], W, B[:, 0]))
            at += 6 * size + 6
        moving = body_accelerations(self.system.groups, partials, speeds, motions)
        return newton_euler(
            self.case,
            self.mode,
            motions,
            moving,
            loads.body_loads(self.case, motions, self.t, self.mode),
        )


def body_accelerations(
    groups: list[Group], partials: list[Any], rates: Any, motions: dict[str, Motion]
) -> dict[str, tuple[Array, Array]]:
    """Accelerations of every mass centre (m/s2, ground axes), and angular ones (rad/s2, body axes),
    from the rates of the speeds."""
    out = {}
    for group, (V, A, W, B) in zip(groups, partials, strict=True):
        a, alpha = V @ rates + A, W @ rates + B
        for name, arm in group.arms.items():
            if name != GROUND:
                m = motions[name]
                out[name] = (a + m.R @ (cross(alpha, arm) + cross(m.w, cross(m.w, arm))), alpha)
    return out


def _spans(size: int) -> list[tuple[int, int]]:
    return [
        (0, 3 * size),
        (3 * size, 3 * size + 3),
        (3 * size + 3, 6 * size + 3),
        (6 * size + 3, 6 * size + 6),
    ]


def _expression(x: Any) -> Any:
    return x if isinstance(x, hy.expression) else hy.expression(float(x))


def _expressions(xs: Any) -> list[Any]:
    return [_expression(x) for x in xs]


def fly(data: dict[str, Any], times: Sequence[float], tolerance: float = TOLERANCE) -> PeerFlight:
    """Simulate a case.

    Parameters
    ----------
    data : dict
        `Case.to_dict` of a case: SI, radians.
    times : sequence of float
        Output times, s, ascending.
    tolerance : float
        Of the Taylor integrator.
    """
    case = Case(data)
    return fly_through(Heyoka(case, tolerance), case, times)
