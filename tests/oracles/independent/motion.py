"""Motion at a state: loads, active constraints, accelerations, joint wrenches, condition values."""

import math
from functools import partial

import numpy as np

from oracles.independent.case import GROUND, Table
from oracles.independent.conditions import Leaf
from oracles.independent.constraints import Constraints, Rows
from oracles.independent.events import Sequence
from oracles.independent.formulas import Undefined
from oracles.independent.guides import add_friction, friction, slides
from oracles.independent.joints import Joint
from oracles.independent.loads import Loads
from oracles.independent.state import Array, State, Vehicle, cross


class Motion:
    """Case with its active constraints. ``jammed``: no friction was in balance with the loads that
    it causes."""

    def __init__(self, scene: Table, vehicle: Vehicle):
        self.vehicle = vehicle
        self.joints = {name: Joint(name, table, vehicle) for name, table in scene["joint"].items()}
        self.loads = Loads(scene, vehicle, self.joints)
        self.sequence = Sequence(scene, self.joints, self.loads)
        self.evaluations, self.jammed, self.undefined = 0, False, False
        self.update()

    def update(self) -> None:
        """Update the constraints to the active rows."""
        active = [(joint, self.sequence.active[name]) for name, joint in self.joints.items()]
        self.constraints = Constraints(
            [(joint, rows) for joint, rows in active if rows], self.vehicle
        )

    def pivot(self, first: dict[str, str]) -> Array:
        """Point about which the vehicle turns at the start, from its mass centre: zero, or the
        point of the first joint with the ground that the first phase constrains."""
        for name, joint in self.joints.items():
            if GROUND in joint.bodies and first.get(name, "free") != "free":
                point = joint.points[joint.bodies.index(GROUND)]
                return self.vehicle.arm(GROUND, point)
        return np.zeros(3)

    def free(self, s: State, force: Array, moment: Array) -> Array:
        """Unconstrained accelerations (n, 6) from forces in ground axes and moments about the mass
        centres in body axes."""
        vehicle, n, free = self.vehicle, self.vehicle.n, np.empty((self.vehicle.n, 6))
        free[:, :3] = force[:n] / vehicle.mass[:, None]
        for b in range(n):
            turning = moment[b] - cross(s.w[b], vehicle.inertia[b] @ s.w[b])
            free[b, 3:] = vehicle.unroot[b].T @ (vehicle.unroot[b] @ turning)
        return free

    def at(self, t: float, s: State) -> tuple[Array, Array, Rows | None, dict[str, float]]:
        """Accelerations (n, 6), the weighted change (6 n,) by the joints, the constraint rows, and
        the friction, N, of guides by joint."""
        self.evaluations += 1
        force, moment = self.loads.on_bodies(t, s)
        if not self.constraints.count:
            return self.free(s, force, moment), np.zeros(6 * self.vehicle.n), None, {}
        rows = self.constraints.at(s)
        frictions = friction(self._sliding(), partial(self.free, s), s, rows, (force, moment))
        self.jammed = frictions is None
        for name, size in (frictions or {}).items():
            add_friction(self.joints[name], s, size, force, moment)
        return *rows.accelerate(self.free(s, force, moment)), rows, frictions or {}

    def _sliding(self) -> list[Joint]:
        """Joints with friction whose pins are engaged."""
        return [
            joint
            for name, joint in self.joints.items()
            if joint.guide and joint.guide["friction"] > 0.0 and slides(self.sequence.active[name])
        ]

    def derivative(self, t: float, y: Array) -> Array:
        """Rate of the state vector y at time t, s."""
        s = self.vehicle.state(t, y)
        self.undefined = False
        try:
            of_bodies = self.vehicle.derivative(y, s, self.at(t, s)[0])
            return np.append(of_bodies, self.loads.formulas.rates(t, s))
        except Undefined:  # the step is repeated with half of its length
            self.undefined = True
            return np.full(y.shape, math.nan)

    def wrenches(self, t: float, s: State) -> dict[str, tuple[Array, Array]]:
        """Force, N, and moment, N m, of every joint on its second body, ground axes."""
        _, added, rows, _ = self.at(t, s)
        return self.wrenches_of(s, added, rows)

    def wrenches_of(
        self, s: State, added: Array, rows: Rows | None
    ) -> dict[str, tuple[Array, Array]]:
        """Joint wrenches from the results of `at`."""
        wrenches = dict.fromkeys(self.joints, (np.zeros(3), np.zeros(3)))
        if rows is not None:
            multipliers = rows.multipliers(added)
            wrenches |= {
                name: rows.wrench(j, s, multipliers)
                for name, j in self.joints.items()
                if self.sequence.active[name]
            }
        return wrenches

    def driving_force(
        self, name: str, t: float, s: State, frictions: dict[str, float]
    ) -> tuple[float, Array, Array]:
        """Force, N, that drives a joint apart: the opposite of the axial force that would lock it,
        without its own friction but with that of others. Also the joint's force and moment on its
        second body if it were locked."""
        joint = self.joints[name]
        force, moment = self.loads.on_bodies(t, s)
        for other, size in frictions.items():
            if other != name:
                add_friction(self.joints[other], s, size, force, moment)
        active = [
            (j, self.sequence.active[each] | ({("along", 0)} if each == name else set()))
            for each, j in self.joints.items()
        ]
        rows = Constraints(active, self.vehicle).at(s)
        wrench = rows.wrench(
            joint, s, rows.multipliers(rows.accelerate(self.free(s, force, moment))[1])
        )
        return max(
            0.0, -joint.separation_sign * float(wrench[0] @ (s.r[joint.a] @ joint.axes[0]))
        ), *wrench

    def value(self, leaf: Leaf, t: float, s: State) -> float:
        """Excess of a quantity on the state over its threshold."""
        quantity, name = leaf.quantity, str(leaf.name)
        if quantity == "altitude":
            value = self.vehicle.height(t, s, self.vehicle.index[name])
        elif quantity == "vertical_speed":
            value = s.v[self.vehicle.index[name], 1] + self.vehicle.velocity[1]
        elif quantity == "spring":
            if next(one.spent for one in self.loads.springs if one.name == name):
                return 1.0  # stays spent
            value = next(spring for spring in self.loads.springs if spring.name == name).extension(
                s
            )
        elif quantity == "stroke":
            value = self.joints[name].separation(s)[0]
        elif quantity == "distance":
            value = float(np.linalg.norm(self.joints[name].gap(s)[0]))
        elif quantity == "angle":
            value = self.joints[name].angle(s)
        else:
            value = float(
                np.linalg.norm(self.wrenches(t, s)[name][0 if quantity == "force" else 1])
            )
        return value - leaf.threshold
