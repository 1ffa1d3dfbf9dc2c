"""Joints: the constraints C of every kind, their rates C', and the motion they allow."""

from typing import NamedTuple

import numpy as np

from sepmc.trust.independent.case import GROUND, Table
from sepmc.trust.independent.state import Array, State, Vehicle, cross, skew

STEP = 1e-40  # of the complex step: so small that its square is nothing, and no difference is taken
_REDUNDANT = 1e-10  # singular values of the rows, each of unit length, below this share of the largest count as zero

# A row: ("along", k): d has no part along axis k of A; ("turn", i, k): axis i of B stays perpendicular to axis k of A; ("rod",).
Row = tuple
_TURNS = {"x": ("turn", 1, 2), "y": ("turn", 0, 2), "z": ("turn", 0, 1)}
_KINDS = {
    "free": ("", ""), "fixed": ("xyz", "xyz"), "slider": ("yz", "xyz"), "revolute": ("xyz", "yz"), "cylindrical": ("yz", "yz"),
    "universal": ("xyz", "z"), "spherical": ("xyz", ""), "planar": ("x", "yz"), "point-on-line": ("yz", ""), "point-on-plane": ("x", ""),
}  # fmt: skip


def rows_of(kind: str, own: Table) -> frozenset[Row]:
    """What a kind of joint holds."""
    if kind == "rod":
        return frozenset([("rod",)])
    if kind not in own and kind not in _KINDS:
        raise ValueError(f"the independent flight knows no joint kind {kind}")
    along, about = (own[kind]["translations"], own[kind]["rotations"]) if kind in own else _KINDS[kind]
    turns = {axis: _TURNS[axis] for axis in about}
    if set(about) == {"x", "z"}:
        turns["z"] = ("turn", 1, 0)  # with y of B perpendicular to z of A and to x of A, B turns about y freely
    return frozenset([("along", "xyz".index(axis)) for axis in along] + list(turns.values()))


class Joint:
    """A joint: its bodies, its points and its axes, which B carries too, parallel to A's at the start."""

    def __init__(self, name: str, table: Table, vehicle: Vehicle):
        self.name, self.bodies, self.delay, self.fails = name, tuple(table["bodies"]), table["delay"], table["fails"] >= 0.5
        self.own, self.guide = table["kind"], table["guide"]
        self.a, self.b = (vehicle.index[body] for body in self.bodies)
        self.points = [table["point"], table["second_point"] if table["second_point"] is not None else table["point"]]
        self.arm_a, self.arm_b = (vehicle.arm(body, point) for body, point in zip(self.bodies, self.points, strict=True))
        x = np.array(table["x_axis"], float) / np.linalg.norm(table["x_axis"])
        y = np.array(table["y_axis"], float) - x * (x @ np.array(table["y_axis"], float))
        y /= np.linalg.norm(y)
        self.axes = np.array([x, y, np.cross(x, y)])
        gap = (np.array(self.points[1], float) - np.array(self.points[0], float)) * (-1.0, 1.0, 1.0)
        self.length, self.start = float(np.linalg.norm(gap)), float(gap @ x)
        to_a, to_b = (table["point"] if body == GROUND else vehicle.cg[vehicle.index[body]] for body in self.bodies)
        toward = float((np.array(to_b) - np.array(to_a)) * (-1.0, 1.0, 1.0) @ x)
        self.apart = table["apart"] if table["apart"] is not None else (1 if toward >= 0.0 else -1)

    def gap(self, s: State) -> tuple[Array, Array]:
        """d = r_B - r_A and d', ground axes."""
        return pair(s, self.a, self.b, self.arm_a, self.arm_b)

    def separation(self, s: State) -> tuple[float, float]:
        """Separation distance, m, and its rate, m/s."""
        d, rate = self.gap(s)
        e, turning = s.r[self.a] @ self.axes[0], s.r[self.a] @ cross(s.w[self.a], self.axes[0])
        return float(self.apart * (d @ e - self.start)), float(self.apart * (rate @ e + d @ turning))

    def angle(self, s: State) -> float:
        """Angle by which B has turned from A, rad."""
        r = s.r[self.a].T @ s.r[self.b]
        sine = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        return float(np.arctan2(np.linalg.norm(sine), np.trace(r) - 1.0))


def pair(s: State, a: int, b: int, arm_a: Array, arm_b: Array) -> tuple[Array, Array]:
    """From a point of body a to one of body b, ground axes, m, and its rate."""
    d = s.x[b] + s.r[b] @ arm_b - s.x[a] - s.r[a] @ arm_a
    rate = s.v[b] + s.r[b] @ cross(s.w[b], arm_b) - s.v[a] - s.r[a] @ cross(s.w[a], arm_a)
    return d, rate


class Pull(NamedTuple):
    """How the constraints change the motion: rows on all speeds (rows, 6 (n + 1)), accelerations (n, 6), and what they add to the
    weighted acceleration (6 n): M^(1/2) times the change."""

    rows: Array
    acceleration: Array
    added: Array


class Constraints:
    """All rows held at a time, evaluated together. ``held`` are pairs of a joint and what it holds."""

    def __init__(self, held: list[tuple[Joint, frozenset[Row]]], vehicle: Vehicle):
        self.vehicle = vehicle
        rows = [(joint, row) for joint, rows in held for row in sorted(rows, key=str)]
        order = {"along": 0, "rod": 1, "turn": 2}
        rows.sort(key=lambda pair: order[pair[1][0]])  # stable: a joint's own rows keep their order
        self.owners = [joint.name for joint, _ in rows]
        self.count = len(rows)
        self.lines = sum(row[0] == "along" for _, row in rows)
        self.pulls = self.lines + sum(row[0] == "rod" for _, row in rows)
        points, turns = rows[: self.pulls], rows[self.pulls :]
        self.a, self.b = (np.array([getattr(j, side) for j, _ in points], int) for side in "ab")
        self.arm_a, self.arm_b = (np.array([getattr(j, side) for j, _ in points]).reshape(-1, 3) for side in ("arm_a", "arm_b"))
        self.e = np.array([j.axes[row[1]] for j, row in points[: self.lines]]).reshape(-1, 3)
        self.length = np.array([j.length for j, _ in points[self.lines :]])
        self.turn_a, self.turn_b = (np.array([getattr(j, side) for j, _ in turns], int) for side in "ab")
        self.axis_b = np.array([j.axes[row[1]] for j, row in turns]).reshape(-1, 3)
        self.axis_a = np.array([j.axes[row[2]] for j, row in turns]).reshape(-1, 3)
        bodies = vehicle.n + 1
        self.units = np.eye(6 * bodies).reshape(6 * bodies, bodies, 6)  # a speed of one for each of all

    def values(self, s: State) -> Array:
        """C of all rows, m and rad."""
        d, a = _turned(s.r, self.b, self.arm_b) + s.x[self.b] - _turned(s.r, self.a, self.arm_a) - s.x[self.a], self.lines
        along = np.sum(d[:a] * _turned(s.r, self.a[:a], self.e), axis=1)
        rods = np.sqrt(np.sum(d[a:] ** 2, axis=1)) - self.length
        return np.concatenate([along, rods, np.sum(_turned(s.r, self.turn_b, self.axis_b) * _turned(s.r, self.turn_a, self.axis_a), axis=1)])

    def rates(self, x: Array, r: Array, v: Array, w: Array) -> Array:
        """C' (k, rows) at positions (n + 1, 3) and attitudes (n + 1, 3, 3) for k sets of speeds v, w (k, n + 1, 3); may be complex."""
        out, m = np.empty((len(v), self.count), np.result_type(x, v)), self.lines
        if self.pulls:
            d = x[self.b] + _turned(r, self.b, self.arm_b) - x[self.a] - _turned(r, self.a, self.arm_a)
            rate = v[:, self.b] + _swept(r, w, self.b, self.arm_b) - v[:, self.a] - _swept(r, w, self.a, self.arm_a)
            e, e_rate = _turned(r, self.a[:m], self.e), _swept(r, w, self.a[:m], self.e)
            out[:, :m] = np.sum(rate[:, :m] * e, axis=2) + np.sum(d[:m] * e_rate, axis=2)
            if self.pulls > m:
                length = np.sqrt(np.sum(d[m:] * d[m:], axis=1))
                out[:, m : self.pulls] = np.sum(rate[:, m:] * d[m:], axis=2) / length
        if self.count > self.pulls:
            a, b = _turned(r, self.turn_a, self.axis_a), _turned(r, self.turn_b, self.axis_b)
            a_rate, b_rate = _swept(r, w, self.turn_a, self.axis_a), _swept(r, w, self.turn_b, self.axis_b)
            out[:, self.pulls :] = np.sum(b_rate * a, axis=2) + np.sum(b * a_rate, axis=2)
        return out

    def residual(self, s: State) -> float:
        """Largest |C| and |C'| of all rows: m, rad, m/s, rad/s."""
        if not self.count:
            return 0.0
        return float(max(np.abs(self.values(s)).max(), np.abs(self.rates(s.x, s.r, s.v[None], s.w[None])).max()))

    def accelerate(self, s: State, free: Array) -> Pull:
        """The motion nearest to the free one (n, 6) that all rows allow: Gauss's principle of least constraint.

        The rows are C' at unit speeds; their bias, the part of C'' without accelerations, is C' at complex positions a tiny imaginary
        time ahead, exact to round-off.
        """
        n, vehicle = self.vehicle.n, self.vehicle
        if not self.count:
            return Pull(np.zeros((0, 6 * (n + 1))), free, np.zeros(6 * n))
        speeds = np.concatenate([self.units, np.concatenate([s.v, s.w], axis=1)[None]])
        ahead = s.x + 1j * STEP * s.v, s.r + 1j * STEP * (s.r @ skew(s.w))
        found = self.rates(*ahead, speeds[:, :, :3], speeds[:, :, 3:])
        rows, bias = found[:-1].real.T, found[-1].imag / STEP
        weighted = self.weighted(rows)
        scale = 1.0 / np.sqrt(np.sum(weighted**2, axis=1))
        start = np.concatenate([vehicle.root[:, None] * free[:, :3], np.einsum("bji,bj->bi", vehicle.lower, free[:, 3:])], axis=1).ravel()
        scaled = scale[:, None] * weighted
        added = np.linalg.lstsq(scaled, scale * -bias - scaled @ start, _REDUNDANT)[0]
        change = added.reshape(n, 6)
        turn = np.einsum("bji,bj->bi", vehicle.unroot, change[:, 3:])
        return Pull(rows, free + np.concatenate([change[:, :3] / vehicle.root[:, None], turn], axis=1), added)

    def weighted(self, rows: Array) -> Array:
        """Rows (m, 6 (n + 1)) on the speeds of the moving bodies, each measured by the root of its inertia: (m, 6 n)."""
        n, parts = self.vehicle.n, rows.reshape(len(rows), -1, 6)[:, : self.vehicle.n]
        turn = np.einsum("mbi,bji->mbj", parts[:, :, 3:], self.vehicle.unroot)
        return np.concatenate([parts[:, :, :3] / self.vehicle.root[:, None], turn], axis=2).reshape(len(rows), 6 * n)

    def multipliers(self, pull: Pull) -> Array:
        """Multipliers of the rows, N and N m, of least sum of squares."""
        weighted = self.weighted(pull.rows)
        scale = 1.0 / np.sqrt(np.sum(weighted**2, axis=1))
        u, sizes, vt = np.linalg.svd(scale[:, None] * weighted)
        rank = int(np.count_nonzero(sizes > _REDUNDANT * sizes[0]))
        found = scale * (u[:, :rank] @ ((vt[:rank] @ pull.added) / sizes[:rank]))
        idle = scale[:, None] * u[:, rank:]  # multipliers that move nothing
        return found - idle @ np.linalg.lstsq(idle, found, None)[0] if rank < self.count else found

    def wrench(self, joint: Joint, s: State, pull: Pull, multipliers: Array) -> tuple[Array, Array]:
        """Force and moment of a joint on its second body at that body's copy of the point, ground axes: virtual power of its rows."""
        mine = np.array([owner == joint.name for owner in self.owners])
        force, moment = (pull.rows[mine].reshape(-1, self.vehicle.n + 1, 6)[:, joint.b].T @ multipliers[mine]).reshape(2, 3)
        r = s.r[joint.b]
        return force, r @ moment - cross(r @ joint.arm_b, force)


def _turned(r: Array, bodies: Array, vectors: Array) -> Array:
    """Vectors (m, 3) of bodies in ground axes."""
    return (r[bodies] @ vectors[:, :, None])[:, :, 0]


def _swept(r: Array, w: Array, bodies: Array, vectors: Array) -> Array:
    """Rates (k, m, 3) of `_turned` for angular rates (k, n + 1, 3): R (w x vector)."""
    return np.einsum("mij,kmj->kmi", r[bodies] @ -skew(vectors), w[:, bodies])
