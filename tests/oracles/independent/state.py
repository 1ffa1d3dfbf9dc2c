"""State of all bodies: positions, velocities, attitudes and angular rates, in a frame that moves
with the vehicle's first velocity."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.independent.case import GROUND, Table

Array = Any  # ndarray; shapes are in the docstrings
SIZE = 13  # per body in the state vector: position, velocity, quaternion, angular rate


def cross(a: Array, b: Array) -> Array:
    """a x b of two vectors of three; np.cross takes ten times longer."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def skew(a: Array) -> Array:
    """Matrices (..., 3, 3) that take b to a x b."""
    a, out = np.asarray(a), np.zeros((*np.shape(a), 3), np.asarray(a).dtype)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    return out - np.swapaxes(out, -1, -2)


def _product(p: Array, q: Array) -> Array:
    """Hamilton product of two quaternions, scalar first."""
    return np.concatenate(
        [[p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])]
    )


_UNITS = np.eye(4)
_CONJUGATE = np.diag([1.0, -1.0, -1.0, -1.0])
# The attitude of q turns e_j to q e_j q*, and q' = 1/2 q (0, omega): both are sums over products of
# units.
# k, l, j, i
_TURN = np.array(
    [[[_product(_product(p, e), c)[1:] for e in _UNITS[1:]] for c in _CONJUGATE] for p in _UNITS]
)
_TURN = np.swapaxes(_TURN, 2, 3).reshape(16, 9)
_RATE = np.array([[0.5 * _product(p, e) for e in _UNITS[1:]] for p in _UNITS]).reshape(12, 4)


class State(NamedTuple):
    """All bodies, the ground last: positions and velocities (n + 1, 3) in ground axes of the moving
    frame, attitudes (n + 1, 3, 3), angular rates (n + 1, 3) in body axes."""

    x: Array
    v: Array
    r: Array
    w: Array
    z: Array = ()  # states of signals


def attitudes(q: Array) -> Array:
    """Attitude matrices (n, 3, 3) of quaternions (n, 4) of any length."""
    matrices = (q[:, :, None] * q[:, None, :]).reshape(-1, 16) @ _TURN
    return (matrices / np.sum(q * q, axis=1)[:, None]).reshape(-1, 3, 3)


def quaternion_rates(q: Array, w: Array) -> Array:
    """q' (n, 4) of quaternions (n, 4) that turn at body rates (n, 3)."""
    return (q[:, :, None] * w[:, None, :]).reshape(-1, 12) @ _RATE


class Vehicle:
    """Masses, positions and initial state of a case."""

    def __init__(self, scene: Table):
        self.names, self.initial = list(scene["body"]), scene["initial"]
        bodies = list(scene["body"].values())
        self.n = len(bodies)
        self.index = {name: i for i, name in enumerate([*self.names, GROUND])}
        self.mass = np.array([body["mass"] for body in bodies], float)
        self.inertia = np.array([_tensor(body) for body in bodies])
        self.cg = np.array([body["cg"] for body in bodies], float)
        first, pitch = self.initial, self.initial["pitch"] - self.initial["alpha"]
        level = np.cos(first["path_yaw"])
        path = np.array([np.cos(pitch) * level, np.sin(pitch) * level, -np.sin(first["path_yaw"])])
        self.velocity = first["speed"] * path  # of the frame
        self.r0 = Rotation.from_euler(
            "ZYX", [first["pitch"], first["yaw"], first["roll"]]
        ).as_matrix()

    def fault(self) -> str | None:
        """Reason why the mass properties are invalid, or None."""
        if not (np.isfinite(self.mass).all() and (self.mass > 0.0).all()):
            return "a mass is not positive"
        if not np.isfinite(self.inertia).all() or np.linalg.eigvalsh(self.inertia).min() <= 0.0:
            return "an inertia is not positive definite"
        return None

    def prepare(self) -> None:
        """Compute the mass centre and the roots of the mass matrix; `fault` must have returned
        None."""
        self.centre = self.mass @ self.cg / self.mass.sum()  # the ground's origin too
        self.root = np.sqrt(self.mass)
        self.lower = np.linalg.cholesky(self.inertia)  # J = L L^T
        self.unroot = np.linalg.inv(self.lower)

    def arm(self, body: str, point: Any) -> Array:
        """Vector from a body's mass centre (the ground's origin) to a layout point, body axes,
        m."""
        origin = self.centre if body == GROUND else self.cg[self.index[body]]
        return (np.asarray(point, float) - origin) * (-1.0, 1.0, 1.0)

    def start(self, pivot: Array, swings: list[tuple[Array, Any, list[str]]]) -> Array:
        """Initial state vector: all bodies turn with the vehicle about ``pivot``, a vector from the
        mass centre in body axes; with ``swings``, some turn about a layout point too."""
        y, omega = np.zeros((self.n, SIZE)), np.array(self.initial["omega"], float)
        for b, name in enumerate(self.names):
            offset = -self.arm(name, self.centre)
            y[b, 0:3] = self.r0 @ offset
            y[b, 3:6] = self.r0 @ np.cross(omega, offset - pivot)
            y[b, 6:10] = Rotation.from_matrix(self.r0).as_quat()[[3, 0, 1, 2]]
            y[b, 10:13] = omega
            for rate, point, turned in swings:
                if name in turned:
                    y[b, 3:6] -= self.r0 @ np.cross(rate, self.arm(name, point))
                    y[b, 10:13] += rate
        return y.ravel()

    def state(self, t: float, y: Array) -> State:
        """State of bodies and ground from a state vector."""
        z = y[self.n * SIZE :]
        y = y[: self.n * SIZE].reshape(self.n, SIZE)
        x, v, w = (np.concatenate([y[:, i : i + 3], np.zeros((1, 3))]) for i in (0, 3, 10))
        x[-1], v[-1] = -self.velocity * t, -self.velocity
        return State(x, v, np.concatenate([attitudes(y[:, 6:10]), self.r0[None]]), w, z)

    def height(self, t: float, s: State, body: int) -> float:
        """Height of a body's mass centre, m."""
        return float(s.x[body, 1] + (self.initial["altitude"] + self.velocity[1] * t))

    def derivative(self, y: Array, s: State, acceleration: Array) -> Array:
        """y' from accelerations (n, 6): of the mass centre in ground axes, angular in body axes."""
        y, out = y[: self.n * SIZE].reshape(self.n, SIZE), np.empty((self.n, SIZE))
        out[:, 0:3], out[:, 3:6], out[:, 10:13] = s.v[:-1], acceleration[:, :3], acceleration[:, 3:]
        out[:, 6:10] = quaternion_rates(y[:, 6:10], s.w[:-1])
        return out.ravel()


def _tensor(body: Table) -> Array:
    """Inertia tensor, kg m2: products are the integrals of xy, xz, yz."""
    (xx, yy, zz), (xy, xz, yz) = body["inertia"], body["inertia_products"]
    return body["inertia_factor"] * np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])
