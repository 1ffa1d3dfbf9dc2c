"""Case as the external engines read it, from `Case.to_dict`: bodies, joints and the initial
state."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

GROUND = "ground"
# tables of a case that the engines simulate, or that do not affect the motion
_TABLES = {"body", "joint", "motor", "spring", "load", "proximity", "phase", "release", "clearance"}
_TABLES |= {"environment", "initial", "run", "solver", "output", "event"}
Array = np.ndarray


def cross(a: Any, b: Any) -> Array:
    """a x b, of numbers or of expressions."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@dataclass(frozen=True)
class Motion:
    """Motion of a body, in numbers or in expressions of an engine.

    Attributes
    ----------
    x, v : ndarray, shape (3,)
        Position (m) and velocity (m/s) of the mass centre, ground axes, in the frame that moves
        with the initial velocity.
    R : ndarray, shape (3, 3)
        Body components to ground components.
    w : ndarray, shape (3,)
        Angular velocity in body axes, rad/s.
    """

    x: Array
    v: Array
    R: Array
    w: Array

    def point(self, arm: Array) -> Array:
        """Position of a point given from the mass centre in body axes."""
        return self.x + self.R @ arm

    def point_velocity(self, arm: Array) -> Array:
        """Velocity of a point given from the mass centre in body axes."""
        return self.v + self.R @ cross(self.w, arm)


@dataclass(frozen=True)
class Body:
    """Body: its table ``data`` of the case, ``inertia`` (kg m2) about the mass centre, and the
    layout point ``cg`` of that."""

    name: str
    mass: float
    inertia: Array
    cg: Array
    data: dict[str, Any]

    def arm(self, point: Any) -> Array:
        """From the mass centre to a layout point [station aft, y, z], body axes, m."""
        return np.array([self.cg[0] - point[0], point[1] - self.cg[1], point[2] - self.cg[2]])


@dataclass(frozen=True)
class Joint:
    """Joint with its axes as the columns of ``axes``, fixed in the first body and, parallel while
    mated, in the second.

    ``held`` gives the constrained motions of each custom kind: x y z, then rotations about x y z.
    """

    name: str
    first: str
    second: str
    axes: Array
    arm_first: Array
    arm_second: Array
    apart: float
    delay: float
    fails: bool
    held: dict[str, tuple[bool, ...]] = field(default_factory=dict)
    length: float = 0.0  # of a rod, m


KINDS = {
    "fixed": (True,) * 6,
    "slider": (False, True, True, True, True, True),
    "revolute": (True, True, True, False, True, True),
    "cylindrical": (False, True, True, False, True, True),
    "universal": (True, True, True, False, False, True),
    "spherical": (True, True, True, False, False, False),
    "planar": (True, False, False, False, True, True),
    "point-on-plane": (True, False, False, False, False, False),
    "point-on-line": (False, True, True, False, False, False),
    "rod": (True, False, False, False, False, False),
    "free": (False,) * 6,
}


def attitude(pitch: float, yaw: float, roll: float) -> Array:
    """R = Rz(pitch) Ry(yaw) Rx(roll)."""
    cz, sz, cy, sy, cx, sx = (f(a) for a in (pitch, yaw, roll) for f in (math.cos, math.sin))
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return about_z @ about_y @ about_x


def _body(name: str, data: dict[str, Any]) -> Body:
    """Body of a table."""
    xx, yy, zz = data["inertia"]
    xy, xz, yz = data.get("inertia_products", (0.0, 0.0, 0.0))
    tensor = data.get("inertia_factor", 1.0) * np.array(
        [[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]]
    )
    return Body(name, data["mass"], tensor, np.array(data["cg"], float), data)


class Case:
    """Case, read once for all engines.

    Parameters
    ----------
    data : dict
        ``campaign.case(i).to_dict()``: nested like the campaign file, SI and radians.
    """

    def __init__(self, data: dict[str, Any]):
        self.data = data
        self.end_time: float = data["run"]["end_time"]
        self.environment: dict[str, Any] = data["environment"]
        self.bodies = {name: _body(name, table) for name, table in data["body"].items()}
        total = sum(b.mass for b in self.bodies.values())
        # of the mated vehicle, layout
        centre = sum(b.mass * b.cg for b in self.bodies.values()) / total
        self.ground = Body(GROUND, math.inf, np.eye(3), np.asarray(centre), {})
        self.joints = {
            name: self._joint(name, table) for name, table in data.get("joint", {}).items()
        }
        initial = data["initial"]
        theta, sigma = initial["pitch"] - initial["alpha"], initial.get("path_yaw", 0.0)
        path = np.array(
            [math.cos(theta) * math.cos(sigma), math.sin(theta) * math.cos(sigma), -math.sin(sigma)]
        )
        self.altitude: float = initial["altitude"]
        self.velocity: Array = initial["speed"] * path  # of the moving frame
        self.R0 = attitude(initial["pitch"], initial.get("yaw", 0.0), initial.get("roll", 0.0))
        self._refuse()

    def _refuse(self) -> None:
        """Refuse features that no external engine simulates."""
        lost = [f"[{key}]" for key, table in self.data.items() if table and key not in _TABLES]
        lost += [f"the table of {s['name']}" for s in self.data.get("spring", ()) if s.get("table")]
        lost += [f"slack of {s['name']}" for s in self.data.get("spring", ()) if s.get("push_only")]
        lost += [f"axes of {p['name']}" for p in self.data.get("proximity", ()) if p.get("axes")]
        lost += [
            f"friction of {n}"
            for n, j in self.data.get("joint", {}).items()
            if (j.get("guide") or {}).get("friction")
        ]
        lost += [
            f"a rate across {n} at the start"
            for n, j in self.data.get("joint", {}).items()
            if any(j.get("omega", ()))
        ]
        lost += [
            f"the ignition of {motor['name']} at an instant of the flight"
            for motor in self.data.get("motor", [])
            if isinstance(motor.get("ignition"), dict)
        ]
        if self.environment.get("atmosphere") == "table" or (
            self.environment.get("wind") or {}
        ).get("profile"):
            lost.append("tables of air and wind")
        if lost:
            raise NotImplementedError(f"no peer flies: {', '.join(lost)}")

    def body(self, name: str) -> Body:
        """Body by name, or the ground."""
        return self.ground if name == GROUND else self.bodies[name]

    def _joint(self, name: str, table: dict[str, Any]) -> Joint:
        first, second = table["bodies"]
        ex = np.array(table.get("x_axis", (1.0, 0.0, 0.0)), float)
        ex /= np.linalg.norm(ex)
        ey = np.array(table.get("y_axis", (0.0, 1.0, 0.0)), float)
        ey -= ex * (ex @ ey)
        ey /= np.linalg.norm(ey)
        own = {}
        for kind, holds in (table.get("kind") or {}).items():
            own[kind] = (
                *(a in holds.get("translations", ()) for a in "xyz"),
                *(a in holds.get("rotations", ()) for a in "xyz"),
            )
        far = table.get("second_point") or table["point"]
        arm_first, arm_second = self.body(first).arm(table["point"]), self.body(second).arm(far)
        length = float(np.linalg.norm(self.ground.arm(far) - self.ground.arm(table["point"])))
        apart = table.get("apart") or 1.0
        axes = np.column_stack([ex, ey, cross(ex, ey)])
        delay, fails = table.get("delay", 0.0), bool(table.get("fails", 0.0))
        return Joint(
            name, first, second, axes, arm_first, arm_second, apart, delay, fails, own, length
        )

    def held(self, joint: str, kind: str) -> tuple[bool, ...]:
        """Constrained motions (6,) of a kind of a joint; of a rod one, along itself."""
        own = self.joints[joint].held
        return own[kind] if kind in own else KINDS[kind]

    def initial(self) -> dict[str, Motion]:
        """Motion of every body and of the ground at t = 0: one rigid vehicle that turns about its
        mass centre, or, if a joint of the first phase constrains it to the ground, about the point
        of that joint."""
        omega = np.array(self.data["initial"].get("omega", (0.0, 0.0, 0.0)), float)
        pivot = np.zeros(3)
        for name in self.data["phase"][0].get("joints", {}):
            joint = self.joints[name]
            if GROUND in (joint.first, joint.second):
                pivot = joint.arm_first if joint.first == GROUND else joint.arm_second
        motions = {GROUND: Motion(np.zeros(3), np.zeros(3) - self.velocity, self.R0, np.zeros(3))}
        for name, body in self.bodies.items():
            place = self.ground.arm(body.cg)
            motions[name] = Motion(
                self.R0 @ place, self.R0 @ cross(omega, place - pivot), self.R0, omega.copy()
            )
        return motions

    def ground_motion(self, t: Any) -> Motion:
        """Ground at time t, s, in the moving frame."""
        still = self.initial()[GROUND]
        return replace(still, x=still.x - self.velocity * t)
