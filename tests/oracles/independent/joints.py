"""Joints: rows of every kind, and the relative position of the bodies."""

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.independent.case import GROUND, Table
from oracles.independent.state import Array, State, Vehicle, cross

# A row: ("along", k): no component of d along axis k of A; ("turn", i, k): axis i of B stays
# perpendicular to axis k of A; ("rod",): constant length of d.
Row = tuple
_TURNS = {"x": ("turn", 1, 2), "y": ("turn", 0, 2), "z": ("turn", 0, 1)}
_KINDS = {
    "free": ("", ""), "fixed": ("xyz", "xyz"), "slider": ("yz", "xyz"), "revolute": ("xyz", "yz"),
    "cylindrical": ("yz", "yz"),
    "universal": ("xyz", "z"), "spherical": ("xyz", ""), "planar": ("x", "yz"),
    "point-on-line": ("yz", ""), "point-on-plane": ("x", ""),
}  # fmt: skip


def rows_of(kind: str, custom_kinds: Table) -> frozenset[Row]:
    """Rows that a kind of joint constrains."""
    if kind == "rod":
        return frozenset([("rod",)])
    if kind not in custom_kinds and kind not in _KINDS:
        raise ValueError(f"unknown joint kind {kind}")
    axial, about = (
        (custom_kinds[kind]["translations"], custom_kinds[kind]["rotations"])
        if kind in custom_kinds
        else _KINDS[kind]
    )
    turns = {axis: _TURNS[axis] for axis in about}
    if set(about) == {"x", "z"}:
        turns["z"] = (
            "turn",
            1,
            0,
        )  # with y of B perpendicular to z of A and to x of A, B turns about y freely
    return frozenset([("along", "xyz".index(axis)) for axis in axial] + list(turns.values()))


class Joint:
    """Joint: its bodies, points and axes; body B carries the same axes, parallel to A's at the
    start."""

    def __init__(self, name: str, table: Table, vehicle: Vehicle):
        self.name, self.bodies, self.delay, self.fails = (
            name,
            tuple(table["bodies"]),
            table["delay"],
            table["fails"] >= 0.5,
        )
        self.custom_kinds, self.guide = table["kind"], table["guide"]
        self.a, self.b = (vehicle.index[body] for body in self.bodies)
        self.points = [
            table["point"],
            table["second_point"] if table["second_point"] is not None else table["point"],
        ]
        self.arm_a, self.arm_b = (
            vehicle.arm(body, point) for body, point in zip(self.bodies, self.points, strict=True)
        )
        x = np.array(table["x_axis"], float) / np.linalg.norm(table["x_axis"])
        y = np.array(table["y_axis"], float) - x * (x @ np.array(table["y_axis"], float))
        y /= np.linalg.norm(y)
        self.axes = np.array([x, y, np.cross(x, y)])
        gap = (np.array(self.points[1], float) - np.array(self.points[0], float)) * (-1.0, 1.0, 1.0)
        self.length, self.start = float(np.linalg.norm(gap)), float(gap @ x)
        to_a, to_b = (
            table["point"] if body == GROUND else vehicle.cg[vehicle.index[body]]
            for body in self.bodies
        )
        toward = float((np.array(to_b) - np.array(to_a)) * (-1.0, 1.0, 1.0) @ x)
        self.separation_sign = (
            table["apart"]
            if table["apart"] is not None
            else (1 if toward >= -1e-12 * max(1.0, *np.abs(to_a), *np.abs(to_b)) else -1)
        )

    def gap(self, s: State) -> tuple[Array, Array]:
        """d = r_B - r_A and d', ground axes."""
        return pair(s, self.a, self.b, self.arm_a, self.arm_b)

    def separation(self, s: State) -> tuple[float, float]:
        """Separation distance, m, and its rate, m/s."""
        d, rate = self.gap(s)
        e, turning = s.r[self.a] @ self.axes[0], s.r[self.a] @ cross(s.w[self.a], self.axes[0])
        return float(self.separation_sign * (d @ e - self.start)), float(
            self.separation_sign * (rate @ e + d @ turning)
        )

    def relative_motion(self, s: State) -> dict[str, float]:
        """Displacement of B's point from the start, m, and pitch, yaw and roll of B against A, rad,
        in A's axes of the joint."""
        gap = (np.array(self.points[1], float) - np.array(self.points[0], float)) * (-1.0, 1.0, 1.0)
        d = self.axes @ (s.r[self.a].T @ self.gap(s)[0] - gap)
        turned = Rotation.from_matrix(self.axes @ s.r[self.a].T @ s.r[self.b] @ self.axes.T)
        pitch, yaw, roll = turned.as_euler("ZYX")
        return dict(
            zip(("x", "y", "z", "pitch", "yaw", "roll"), (*d, pitch, yaw, roll), strict=True)
        )

    def angle(self, s: State) -> float:
        """Angle between A and B, rad."""
        r = s.r[self.a].T @ s.r[self.b]
        sine = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        return float(np.arctan2(np.linalg.norm(sine), np.trace(r) - 1.0))


def pair(s: State, a: int, b: int, arm_a: Array, arm_b: Array) -> tuple[Array, Array]:
    """Vector from a point of body a to one of body b, ground axes, m, and its rate, m/s."""
    d = s.x[b] + s.r[b] @ arm_b - s.x[a] - s.r[a] @ arm_a
    rate = s.v[b] + s.r[b] @ cross(s.w[b], arm_b) - s.v[a] - s.r[a] @ cross(s.w[a], arm_a)
    return d, rate
