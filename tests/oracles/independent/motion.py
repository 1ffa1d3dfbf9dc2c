"""The motion at a state: loads, what the joints hold now, accelerations, joint wrenches,
conditions."""

import numpy as np

from oracles.independent.case import GROUND, Table
from oracles.independent.conditions import Leaf
from oracles.independent.constraints import Constraints, Rows
from oracles.independent.events import Sequence
from oracles.independent.guides import friction, rub
from oracles.independent.joints import Joint
from oracles.independent.loads import Loads
from oracles.independent.state import Array, State, Vehicle, cross


class Motion:
    """A case with what its joints hold at a time. ``jammed``: no friction was in balance with the
    loads it causes."""

    def __init__(self, scene: Table, vehicle: Vehicle):
        self.vehicle = vehicle
        self.joints = {name: Joint(name, table, vehicle) for name, table in scene["joint"].items()}
        self.loads = Loads(scene, vehicle, self.joints)
        self.sequence = Sequence(scene, self.joints, self.loads)
        self.evaluations, self.jammed = 0, False
        self.hold()

    def hold(self) -> None:
        """Constraints as the joints hold now."""
        held = [(joint, self.sequence.held[name]) for name, joint in self.joints.items()]
        self.constraints = Constraints(
            [(joint, rows) for joint, rows in held if rows], self.vehicle
        )

    def pivot(self, first: dict[str, str]) -> Array:
        """About what the vehicle turns at the start, held by the kinds of its first phase: its mass
        centre, or the point of the first joint that holds the ground."""
        for name, joint in self.joints.items():
            if GROUND in joint.bodies and first.get(name, "free") != "free":
                point = joint.points[joint.bodies.index(GROUND)]
                return self.vehicle.arm(GROUND, point)
        return np.zeros(3)

    def free(self, s: State, force: Array, moment: Array) -> Array:
        """Accelerations (n, 6) without joints: forces in ground axes, moments about the mass
        centres in body axes."""
        vehicle, n, found = self.vehicle, self.vehicle.n, np.empty((self.vehicle.n, 6))
        found[:, :3] = force[:n] / vehicle.mass[:, None]
        for b in range(n):
            turning = moment[b] - cross(s.w[b], vehicle.inertia[b] @ s.w[b])
            found[b, 3:] = vehicle.unroot[b].T @ (vehicle.unroot[b] @ turning)
        return found

    def at(self, t: float, s: State) -> tuple[Array, Array, Rows | None, dict[str, float]]:
        """Accelerations (n, 6), the weighted part of the joints in them, the rows these hold and
        the friction of guides."""
        self.evaluations += 1
        force, moment = self.loads.on_bodies(t, s)
        if not self.constraints.count:
            return self.free(s, force, moment), np.zeros(6 * self.vehicle.n), None, {}
        rows = self.constraints.at(s)
        rubbing = friction(self, s, rows, (force, moment))
        self.jammed = rubbing is None
        for name, size in (rubbing or {}).items():
            rub(self.joints[name], s, size, force, moment)
        return *rows.accelerate(self.free(s, force, moment)), rows, rubbing or {}

    def derivative(self, t: float, y: Array) -> Array:
        """Rate of the state vector y at time t, s."""
        s = self.vehicle.state(t, y)
        return self.vehicle.derivative(y, s, self.at(t, s)[0])

    def wrenches(self, t: float, s: State) -> dict[str, tuple[Array, Array]]:
        """Force and moment of every joint on its second body now, ground axes."""
        _, added, rows, _ = self.at(t, s)
        return self.wrenches_of(s, added, rows)

    def wrenches_of(
        self, s: State, added: Array, rows: Rows | None
    ) -> dict[str, tuple[Array, Array]]:
        """The same of what `at` tells."""
        found = dict.fromkeys(self.joints, (np.zeros(3), np.zeros(3)))
        if rows is not None:
            multipliers = rows.multipliers(added)
            found |= {
                name: rows.wrench(j, s, multipliers)
                for name, j in self.joints.items()
                if self.sequence.held[name]
            }
        return found

    def held_along(
        self, name: str, t: float, s: State, rubbing: dict[str, float]
    ) -> tuple[float, Array, Array]:
        """Force that drives a joint apart, N: less the one that would hold it along x, if its pins
        did not rub, but others as they do. Force and moment on its second body if that one did
        hold it."""
        joint = self.joints[name]
        force, moment = self.loads.on_bodies(t, s)
        for other, size in rubbing.items():
            if other != name:
                rub(self.joints[other], s, size, force, moment)
        held = [
            (j, self.sequence.held[each] | ({("along", 0)} if each == name else set()))
            for each, j in self.joints.items()
        ]
        rows = Constraints(held, self.vehicle).at(s)
        wrench = rows.wrench(
            joint, s, rows.multipliers(rows.accelerate(self.free(s, force, moment))[1])
        )
        return max(0.0, -joint.apart * float(wrench[0] @ (s.r[joint.a] @ joint.axes[0]))), *wrench

    def value(self, leaf: Leaf, t: float, s: State) -> float:
        """How far a condition on the state is beyond its threshold."""
        what, which = leaf.what, str(leaf.which)
        if what == "altitude":
            found = self.vehicle.height(t, s, self.vehicle.index[which])
        elif what == "vertical_speed":
            found = s.v[self.vehicle.index[which], 1] + self.vehicle.velocity[1]
        elif what == "spring":
            if next(one.spent for one in self.loads.springs if one.name == which):
                return 1.0  # it stays so
            found = next(spring for spring in self.loads.springs if spring.name == which).extension(
                s
            )
        elif what == "stroke":
            found = self.joints[which].separation(s)[0]
        elif what == "distance":
            found = float(np.linalg.norm(self.joints[which].gap(s)[0]))
        elif what == "angle":
            found = self.joints[which].angle(s)
        else:
            found = float(np.linalg.norm(self.wrenches(t, s)[which][0 if what == "force" else 1]))
        return found - leaf.threshold
