"""Simulation by Pinocchio: its articulated-body algorithm for the motion, its recursive
Newton-Euler algorithm for the joint wrenches.

J. Carpentier et al., "The Pinocchio C++ library", IEEE/SICE International Symposium on System
Integration, 2019. For the motion, bodies connected by fixed joints are one body, and the others
form a tree of Pinocchio's joints (free flyer, prismatic, revolute, spherical). For the wrenches
every joint is a free flyer that moves as the bodies do: its effort is the load that the joint
transmits. Pinocchio has no integrator; scipy's DOP853 integrates (v, omega) of every joint.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from oracles.external_engines import loads
from oracles.external_engines.case import GROUND, Array, Case, Motion, cross
from oracles.external_engines.schedule import Guard, Mode, PeerFlight, Wrench
from oracles.external_engines.schedule import fly as fly_through
from oracles.external_engines.tree import Group, Link, tree_of

TOLERANCE = 1e-13  # relative, of DOP853; the absolute one is a hundredth of it, SI


def _quaternion_rate(quaternion: Array, w: Array) -> Array:
    """q' = 1/2 q (w, 0) of a quaternion (x, y, z, w), with a term that restores unit length."""
    x, y, z, s = quaternion
    turned = [
        s * w[0] + y * w[2] - z * w[1],
        s * w[1] + z * w[0] - x * w[2],
        s * w[2] + x * w[1] - y * w[0],
        -(quaternion[:3] @ w),
    ]
    return 0.5 * np.array(turned) + (1.0 - quaternion @ quaternion) * quaternion


def _angles(turned: Array, axes: list[Array]) -> list[float]:
    """Angles about one axis, or about two perpendicular ones in sequence, that give a rotation."""
    if len(axes) == 1:
        return [float(pin.log3(turned) @ axes[0])]
    a, b = axes
    first, second = turned @ b, turned.T @ a  # the first turns b, the second a
    return [
        math.atan2(cross(a, b) @ first, b @ first),
        math.atan2(-(cross(b, a) @ second), a @ second),
    ]


class Tree:
    """Pinocchio model of one mode. Frames of the groups are at their mass centres; a child's joint
    frame is at its joint point."""

    def __init__(self, case: Case, mode: Mode):
        self.case = case
        self.groups, self.links = tree_of(case, mode.kinds)
        self.model = pin.Model()
        self.model.gravity.setZero()
        self.ids: list[int] = []  # of the joint of each group
        # from the joint frame to the mass centre of the group, axes of the group
        self.origin: list[Array] = []
        for group, link in zip(self.groups, self.links, strict=True):
            self._add(group, link)
        self.data = self.model.createData()

    def _add(self, group: Group, link: Link | None) -> None:
        if group.grounded:
            self.ids.append(0)
            self.origin.append(np.zeros(3))
            return
        if link is None:
            parent, place, kind, to = 0, pin.SE3.Identity(), pin.JointModelFreeFlyer(), np.zeros(3)
        else:
            parent = self.ids[link.parent_group]
            if self.groups[link.parent_group].grounded:
                still = self.case.initial()[GROUND]
                place = pin.SE3(still.R, still.x + still.R @ link.from_parent)
            else:
                place = pin.SE3(np.eye(3), self.origin[link.parent_group] + link.from_parent)
            chain = [pin.JointModelPrismaticUnaligned(e) for e in link.slides]
            chain += [pin.JointModelRevoluteUnaligned(e) for e in link.axes]
            chain += [pin.JointModelSpherical()] if link.turns else []
            *before, kind = chain
            for k, step in enumerate(before):
                parent, place = (
                    self.model.addJoint(parent, step, place, f"{group.lead} {k}"),
                    pin.SE3.Identity(),
                )
            to = link.to_child
        index = self.model.addJoint(parent, kind, place, group.lead)
        self.model.appendBodyToJoint(
            index, pin.Inertia(group.mass, to, group.inertia), pin.SE3.Identity()
        )
        self.ids.append(index)
        self.origin.append(to)

    def state(self, now: dict[str, Motion]) -> tuple[Array, Array]:
        """q and v of these motions."""
        q, v = pin.neutral(self.model), np.zeros(self.model.nv)
        for group, link, index in zip(self.groups, self.links, self.ids, strict=True):
            if group.grounded:
                continue
            m = now[group.lead]
            if link is None:
                joint = self.model.joints[index]
                q[joint.idx_q : joint.idx_q + 7] = pin.SE3ToXYZQUAT(
                    pin.SE3(m.R, m.point(group.centre))
                )
                v[joint.idx_v : joint.idx_v + 6] = [*(m.R.T @ m.point_velocity(group.centre)), *m.w]
                continue
            a, b = now[link.parent], now[link.child]
            gap = a.R.T @ (b.point(link.arm_child) - a.point(link.arm_parent))
            rate = a.R.T @ (
                b.point_velocity(link.arm_child) - a.point_velocity(link.arm_parent)
            ) - cross(a.w, gap)
            relative, turn = a.R.T @ b.R, b.w - b.R.T @ a.R @ a.w
            values = [np.array([gap @ e]) for e in link.slides]
            speeds = [np.array([rate @ e]) for e in link.slides]
            if link.axes:
                # axes of the child; at right angles if there are two
                about = [relative.T @ link.axes[0], *link.axes[1:]]
                values = [*values, *(np.array([x]) for x in _angles(relative, link.axes))]
                speeds = [*speeds, *(np.array([turn @ e]) for e in about)]
            elif link.turns:
                values, speeds = [*values, pin.Quaternion(relative).coeffs()], [*speeds, turn]
            first = index - len(values) + 1  # a link is a chain of joints, one after the other
            for k, (value, speed) in enumerate(zip(values, speeds, strict=True)):
                joint = self.model.joints[first + k]
                (
                    q[joint.idx_q : joint.idx_q + value.size],
                    v[joint.idx_v : joint.idx_v + speed.size],
                ) = value, speed
        return q, v

    def q_rate(self, q: Array, v: Array) -> Array:
        """Rate of the coordinates q (nq,) at the speeds v (nv,)."""
        out = np.zeros_like(q)
        for joint in list(self.model.joints)[1:]:
            iq, iv = joint.idx_q, joint.idx_v
            if joint.nq == 7:
                turn = q[iq + 3 : iq + 7]
                out[iq : iq + 3] = pin.Quaternion(turn).matrix() @ v[iv : iv + 3]
                out[iq + 3 : iq + 7] = _quaternion_rate(turn, v[iv + 3 : iv + 6])
            elif joint.nq == 4:
                out[iq : iq + 4] = _quaternion_rate(q[iq : iq + 4], v[iv : iv + 3])
            else:
                out[iq] = v[iv]
        return out

    def motions(self, q: Array, v: Array, t: float) -> dict[str, Motion]:
        """Motion of every body; leaves the kinematics in ``data``."""
        pin.forwardKinematics(self.model, self.data, q, v)
        out: dict[str, Motion] = {GROUND: self.case.ground_motion(t)}
        for group, index, to in zip(self.groups, self.ids, self.origin, strict=True):
            if group.grounded:
                still = out[GROUND]
                out |= {
                    n: Motion(still.point(r), still.v, still.R, still.w)
                    for n, r in group.arms.items()
                    if n != GROUND
                }
            else:
                place, speed = self.data.oMi[index], self.data.v[index]
                R, w = place.rotation.copy(), speed.angular.copy()
                for name, arm in group.arms.items():
                    r = to + arm
                    out[name] = Motion(
                        place.translation + R @ r, R @ (speed.linear + cross(w, r)), R, w
                    )
        return out

    def accelerations(
        self,
        q: Array,
        v: Array,
        external: dict[str, tuple[Array, Array]],
        motions: dict[str, Motion],
    ) -> Array:
        """Rates (nv,) of the speeds v by the articulated-body algorithm, under external loads:
        force in ground axes, moment about the mass centre in body axes."""
        forces = pin.StdVec_Force()
        for _ in range(self.model.njoints):
            forces.append(pin.Force.Zero())
        for group, index, to in zip(self.groups, self.ids, self.origin, strict=True):
            if group.grounded:
                continue
            force, moment = np.zeros(3), np.zeros(3)
            for name, arm in group.arms.items():
                f = motions[name].R.T @ external[name][0]
                force, moment = force + f, moment + external[name][1] + cross(to + arm, f)
            forces[index] = pin.Force(force, moment)
        return pin.aba(self.model, self.data, q, v, np.zeros(self.model.nv), forces)

    def body_accelerations(self, q: Array, v: Array, a: Array) -> dict[str, tuple[Array, Array]]:
        """Accelerations of every mass centre (ground axes) and angular ones (body axes)."""
        pin.forwardKinematics(self.model, self.data, q, v, a)
        out: dict[str, tuple[Array, Array]] = {}
        for group, index, to in zip(self.groups, self.ids, self.origin, strict=True):
            if group.grounded:
                out |= {name: (np.zeros(3), np.zeros(3)) for name in group.arms}
                continue
            place, speed, spatial = self.data.oMi[index], self.data.v[index], self.data.a[index]
            w, alpha = speed.angular, spatial.angular
            linear = spatial.linear + cross(w, speed.linear)
            for name, arm in group.arms.items():
                r = to + arm
                out[name] = (
                    place.rotation @ (linear + cross(alpha, r) + cross(w, cross(w, r))),
                    alpha.copy(),
                )
        return out


def joint_wrenches(
    case: Case,
    mode: Mode,
    now: dict[str, Motion],
    rates: dict[str, tuple[Array, Array]],
    external: dict[str, tuple[Array, Array]],
) -> dict[str, Wrench]:
    """Recursive Newton-Euler on a tree in which every constrained joint is a free flyer that moves
    as it does."""
    model = pin.Model()
    model.gravity.setZero()
    place: dict[str, int] = {GROUND: 0}
    q_parts, v_parts, a_parts, forces = [], [], [], pin.StdVec_Force()
    forces.append(pin.Force.Zero())
    active = [j for j in case.joints.values() if mode.kinds[j.name] != "free"]
    # joint -> the body it carries, and +1 if that is its second body
    above: dict[str, tuple[str, float]] = {}
    waiting = list(case.bodies)
    order: list[tuple[str, str]] = []
    while waiting:
        connections = [
            (n, j)
            for n in waiting
            for j in active
            if n in (j.first, j.second) and ({j.first, j.second} - {n}).pop() in place
        ]
        body, joint = connections[0] if connections else (waiting[0], None)
        waiting.remove(body)
        if joint is None:
            order.append((GROUND, body))
        else:
            active.remove(joint)
            above[joint.name] = (body, 1.0 if body == joint.second else -1.0)
            order.append((joint.first if body == joint.second else joint.second, body))
        place[body] = model.addJoint(
            place[order[-1][0]], pin.JointModelFreeFlyer(), pin.SE3.Identity(), body
        )
        data = case.bodies[body]
        model.appendBodyToJoint(
            place[body], pin.Inertia(data.mass, np.zeros(3), data.inertia), pin.SE3.Identity()
        )
    still = (np.zeros(3), np.zeros(3))
    frame = Motion(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3))  # the moving frame is the root
    for parent, body in order:
        p, m = (frame if parent == GROUND else now[parent]), now[body]
        (ap, bp), (am, bm) = (still if parent == GROUND else rates[parent]), rates[body]
        Mp, Mb = pin.SE3(p.R, p.x), pin.SE3(m.R, m.x)
        relative = Mp.actInv(Mb)
        vp, vm = (pin.Motion(k.R.T @ k.v, k.w) for k in (p, m))
        spatial_p = pin.Motion(p.R.T @ ap - cross(p.w, p.R.T @ p.v), bp)
        spatial_m = pin.Motion(m.R.T @ am - cross(m.w, m.R.T @ m.v), bm)
        v = vm - relative.actInv(vp)
        a = spatial_m - relative.actInv(spatial_p) - vm.cross(v)
        q_parts.append(pin.SE3ToXYZQUAT(relative))
        v_parts.append(v.vector)
        a_parts.append(a.vector)
        forces.append(pin.Force(m.R.T @ external[body][0], external[body][1]))
    work = model.createData()
    pin.rnea(
        model,
        work,
        np.concatenate(q_parts),
        np.concatenate(v_parts),
        np.concatenate(a_parts),
        forces,
    )
    out = {}
    for joint in case.joints.values():
        a, b = now[joint.first], now[joint.second]
        at_b = b.point(joint.arm_second)
        gap = a.R.T @ (at_b - a.point(joint.arm_first))
        force, moment = np.zeros(3), np.zeros(3)
        if joint.name in above:
            body, sign = above[joint.name]
            f = work.f[place[body]]
            carried = now[body]
            force = sign * (carried.R @ f.linear)
            moment = sign * (carried.R @ f.angular) + cross(carried.x - at_b, force)
        force, moment = a.R.T @ force, a.R.T @ moment
        out[joint.name] = (-force, -moment - cross(gap, force), force, moment)
    return out


class Pinocchio:
    """One run."""

    def __init__(self, case: Case, tolerance: float = TOLERANCE):
        self.case, self.tolerance, self.t = case, tolerance, 0.0
        self.now, self.mode, self.tree = (
            case.initial(),
            Mode(),
            Tree(case, Mode(kinds={n: "free" for n in case.joints})),
        )
        self.q, self.v = self.tree.state(self.now)

    def switch(self, mode: Mode) -> None:
        """Enter a mode; a new tree if joints have other kinds."""
        if mode.kinds != self.mode.kinds:
            self.tree = Tree(self.case, mode)
            self.q, self.v = self.tree.state(self.now)
        self.mode = mode

    def _acceleration(self, t: float, q: Array, v: Array) -> Array:
        motions = self.tree.motions(q, v, t)
        return self.tree.accelerations(
            q, v, loads.body_loads(self.case, motions, t, self.mode), motions
        )

    def _derivative(self, t: float, y: Array) -> Array:
        q, v = y[: self.q.size].copy(), y[self.q.size :].copy()
        rate = self.tree.q_rate(q, v)
        return np.concatenate([rate, self._acceleration(t, self._unit(q), v)])

    def _unit(self, q: Array) -> Array:
        """Quaternions of unit length."""
        return pin.normalize(self.tree.model, q)

    def advance(self, t_end: float, guards: list[Guard]) -> tuple[float, Guard | None]:
        """Integrate to ``t_end`` (s), or to where the first guard rises through zero; returns the
        time and the guard."""
        start, y0, n = self.t, np.concatenate([self.q, self.v]), self.q.size

        def flown(t: float) -> Array:
            if t == start or y0.size == 0:
                return y0
            s = solve_ivp(
                self._derivative,
                (start, t),
                y0,
                "DOP853",
                rtol=self.tolerance,
                atol=1e-2 * self.tolerance,
            )
            if not s.success:
                raise RuntimeError(s.message)
            return s.y[:, -1]

        def value(t: float, guard: Guard, y: Array | None = None) -> float:
            y = flown(t) if y is None else y
            self.t, self.q, self.v = t, self._unit(y[:n]), y[n:]
            self.now = self.tree.motions(self.q, self.v, t)
            return guard.value(
                self.case, self.now, t, wrenches=self.wrenches() if guard.on_load else None
            )

        y, stop, crossed = flown(t_end), t_end, None
        passed = [g for g in guards if value(t_end, g, y) >= 0.0]
        if passed:
            roots = [
                (brentq(value, start, t_end, args=(g,), xtol=1e-15, rtol=1e-15), i)
                for i, g in enumerate(passed)
            ]
            stop, first = min(roots)
            y, crossed = flown(stop), passed[first]
        self.t, self.q, self.v = stop, self._unit(y[:n]), y[n:]
        self.now = self.tree.motions(self.q, self.v, self.t)
        return stop, crossed

    def motions(self) -> dict[str, Motion]:
        """Present motion of every body and of the ground."""
        return self.now

    def wrenches(self) -> dict[str, Wrench]:
        """Present wrenches of every joint on both bodies, each at its own joint point."""
        external = loads.body_loads(self.case, self.now, self.t, self.mode)
        a = self.tree.accelerations(self.q, self.v, external, self.now)
        return joint_wrenches(
            self.case,
            self.mode,
            self.now,
            self.tree.body_accelerations(self.q, self.v, a),
            external,
        )


def fly(data: dict[str, Any], times: Sequence[float], tolerance: float = TOLERANCE) -> PeerFlight:
    """Simulate a case.

    Parameters
    ----------
    data : dict
        `Case.to_dict` of a case: SI, radians.
    times : sequence of float
        Output times, s, ascending.
    tolerance : float
        Relative, of DOP853.
    """
    case = Case(data)
    return fly_through(Pinocchio(case, tolerance), case, times)
