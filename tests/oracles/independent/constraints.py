"""Constraints: C of all active rows, their rates C', and the accelerations they allow."""

import numpy as np

from oracles.independent.joints import Joint, Row
from oracles.independent.state import Array, State, Vehicle, cross, skew

# complex step: its square underflows, and no difference is taken
_STEP = 1e-40
# singular values of the normalised rows below this fraction of the largest count as zero
_REDUNDANT = 1e-10
_INCONSISTENT = 1e-6  # relative residual of the accelerations above which there is no solution
_KINDS = ("along", "rod", "turn")  # order of the rows


class Singular(Exception):
    """Raised if the constraints contradict each other: no acceleration satisfies all."""


class Constraints:
    """All active rows, evaluated together.

    Parameters
    ----------
    active : list of (Joint, frozenset of Row)
        Joints and their active rows.
    """

    def __init__(self, active: list[tuple[Joint, frozenset[Row]]], vehicle: Vehicle):
        self.vehicle = vehicle
        rows = sorted(
            ((j, row) for j, all_rows in active for row in sorted(all_rows, key=str)),
            key=lambda each: _KINDS.index(each[1][0]),
        )
        self.owners, self.count = [joint.name for joint, _ in rows], len(rows)
        self.lines = sum(row[0] == "along" for _, row in rows)
        self.points = self.lines + sum(row[0] == "rod" for _, row in rows)
        points, turns = rows[: self.points], rows[self.points :]
        self.a, self.b = (np.array([getattr(j, side) for j, _ in points], int) for side in "ab")
        self.arm_a, self.arm_b = (
            _vectors([getattr(j, side) for j, _ in points]) for side in ("arm_a", "arm_b")
        )
        self.e = _vectors([j.axes[row[1]] for j, row in points[: self.lines]])
        self.length = np.array([j.length for j, _ in points[self.lines :]])
        self.turn_a, self.turn_b = (
            np.array([getattr(j, side) for j, _ in turns], int) for side in "ab"
        )
        self.axis_b = _vectors([j.axes[row[1]] for j, row in turns])
        self.axis_a = _vectors([j.axes[row[2]] for j, row in turns])
        # matrices from an angular rate to the rate of a body vector, body axes
        self.of_arm_a, self.of_arm_b, self.of_e, self.of_axis_a, self.of_axis_b = (
            -skew(vectors) for vectors in (self.arm_a, self.arm_b, self.e, self.axis_a, self.axis_b)
        )
        # rank and consistency are decided at the first state: later states, of trial steps, can
        # violate the joints
        self.rank, self.known = -1, False
        bodies = vehicle.n + 1
        self.units = np.eye(6 * bodies).reshape(bodies, 6, 6 * bodies)  # unit speeds

    def values(self, s: State) -> Array:
        """C of all rows (rows,), m and rad."""
        d, m = self._gaps(s.x, s.r), self.lines
        axial = np.sum(d[:m] * _turned(s.r, self.a[:m], self.e), axis=1)
        rods = np.sqrt(np.sum(d[m:] ** 2, axis=1)) - self.length
        turns = np.sum(
            _turned(s.r, self.turn_b, self.axis_b) * _turned(s.r, self.turn_a, self.axis_a), axis=1
        )
        return np.concatenate([axial, rods, turns])

    def _gaps(self, x: Array, r: Array) -> Array:
        """Vectors (points, 3) from the first to the second point of every joint row, ground axes,
        m."""
        return (
            x[self.b] + _turned(r, self.b, self.arm_b) - x[self.a] - _turned(r, self.a, self.arm_a)
        )

    def rates(self, x: Array, r: Array, v: Array, w: Array) -> Array:
        """C' (rows, k) at positions (n + 1, 3) and attitudes (n + 1, 3, 3) for k sets of speeds v,
        w (n + 1, 3, k); may be complex."""
        out, m = np.empty((self.count, v.shape[2]), np.result_type(x, v)), self.lines
        if self.points:
            d = self._gaps(x, r)
            rate = (
                v[self.b]
                + _swept(r, w, self.b, self.of_arm_b)
                - v[self.a]
                - _swept(r, w, self.a, self.of_arm_a)
            )
            e, e_rate = _turned(r, self.a[:m], self.e), _swept(r, w, self.a[:m], self.of_e)
            out[:m] = _dot(e, rate[:m]) + _dot(d[:m], e_rate)
            out[m : self.points] = (
                _dot(d[m:], rate[m:]) / np.sqrt(np.sum(d[m:] * d[m:], axis=1))[:, None]
            )
        if self.count > self.points:
            a, b = _turned(r, self.turn_a, self.axis_a), _turned(r, self.turn_b, self.axis_b)
            turning = _dot(a, _swept(r, w, self.turn_b, self.of_axis_b)) + _dot(
                b, _swept(r, w, self.turn_a, self.of_axis_a)
            )
            out[self.points :] = turning
        return out

    def residual(self, s: State) -> float:
        """Largest |C| and |C'| of all rows: m, rad, m/s, rad/s."""
        if not self.count:
            return 0.0
        rates = self.rates(s.x, s.r, s.v[:, :, None], s.w[:, :, None])
        return float(max(np.abs(self.values(s)).max(), np.abs(rates).max()))

    def at(self, s: State) -> "Rows":
        """The rows at a state: C' at unit speeds. Their bias, the part of C'' without
        accelerations, is C' at complex positions a tiny imaginary time ahead, exact to
        round-off."""
        speeds = np.concatenate(
            [self.units, np.concatenate([s.v, s.w], axis=1)[:, :, None]], axis=2
        )
        x, r = s.x + 1j * _STEP * s.v, s.r + 1j * _STEP * (s.r @ skew(s.w))
        rates = self.rates(x, r, speeds[:, :3], speeds[:, 3:])
        return Rows(self, rates[:, :-1].real, rates[:, -1].imag / _STEP)


class Rows:
    """Constraint rows (m, 6 (n + 1)) on all speeds at a state, and their bias (m,)."""

    def __init__(self, constraints: Constraints, rows: Array, bias: Array):
        self.constraints, self.vehicle, self.rows, self.bias = (
            constraints,
            constraints.vehicle,
            rows,
            bias,
        )
        n, parts = self.vehicle.n, rows.reshape(len(rows), -1, 6)[:, :-1]
        turn = (parts[:, :, None, 3:] @ np.swapaxes(self.vehicle.unroot, 1, 2))[:, :, 0]
        # on speeds scaled by the root of the inertia: kinetic energy is half the sum of squares
        self.weighted = np.concatenate(
            [parts[:, :, :3] / self.vehicle.root[:, None], turn], axis=2
        ).reshape(len(rows), 6 * n)
        self.scale = 1.0 / np.sqrt(np.sum(self.weighted**2, axis=1))
        self.scaled = self.scale[:, None] * self.weighted
        if not np.isfinite(self.scaled).all():
            raise np.linalg.LinAlgError
        self.u, self.sizes, self.vt = np.linalg.svd(self.scaled)
        if constraints.rank < 0:
            constraints.rank = int(
                np.count_nonzero(self.sizes > _REDUNDANT * self.sizes.max(initial=0.0))
            )

    def change(self, wanted: Array) -> Array:
        """Minimum-norm change (6 n,) of the weighted speeds, or accelerations, that changes the
        constraint rates by ``wanted`` (m,)."""
        rank = self.constraints.rank
        change = self.vt[:rank].T @ (
            (self.u[:, :rank].T @ (self.scale * wanted)) / self.sizes[:rank]
        )
        residual = self.scaled @ change - self.scale * wanted
        known, self.constraints.known = self.constraints.known, True
        if not known and not np.abs(residual).max() <= _INCONSISTENT * max(
            1.0, np.abs(self.scale * wanted).max()
        ):
            raise Singular
        return change

    def accelerate(self, free: Array) -> tuple[Array, Array]:
        """Accelerations (n, 6) nearest to the unconstrained ones that satisfy the rows, by Gauss's
        principle of least constraint, and the weighted change (6 n,)."""
        added = self.change(-self.bias - self.rows[:, :-6] @ free.ravel())
        return free + self.unweighted(added), added

    def unweighted(self, change: Array) -> Array:
        """Change of speeds or accelerations (n, 6)."""
        change = change.reshape(-1, 6)
        turn = (change[:, None, 3:] @ self.vehicle.unroot)[:, 0]
        return np.concatenate([change[:, :3] / self.vehicle.root[:, None], turn], axis=1)

    def multipliers(self, added: Array) -> Array:
        """Minimum-norm multipliers of the rows, N and N m, that cause a weighted change of
        accelerations."""
        u, rank = self.u, self.constraints.rank
        multipliers = self.scale * (u[:, :rank] @ ((self.vt[:rank] @ added) / self.sizes[:rank]))
        if rank == len(self.rows):
            return multipliers
        idle = self.scale[:, None] * u[:, rank:]  # multipliers without effect on the motion
        return multipliers - idle @ np.linalg.lstsq(idle, multipliers, None)[0]

    def wrench(self, joint: Joint, s: State, multipliers: Array) -> tuple[Array, Array]:
        """Force, N, and moment, N m, of a joint on its second body at that body's joint point,
        ground axes, by virtual power of its rows."""
        mine = np.array([owner == joint.name for owner in self.constraints.owners])
        on_b = self.rows[mine].reshape(-1, self.vehicle.n + 1, 6)[:, joint.b]
        force, moment = (on_b.T @ multipliers[mine]).reshape(2, 3)
        # a pure force: no round-off as a moment
        if not mine[self.constraints.points :].any():
            return force, np.zeros(3)
        r = s.r[joint.b]
        return force, r @ moment - cross(r @ joint.arm_b, force)


def _vectors(rows: list[Array]) -> Array:
    """Vectors as an array (m, 3), also for m = 0."""
    return np.array(rows, float).reshape(-1, 3)


def _dot(a: Array, b: Array) -> Array:
    """Products (m, k) of vectors (m, 3) and k sets of vectors (m, 3, k)."""
    return (a[:, None, :] @ b)[:, 0]


def _turned(r: Array, bodies: Array, vectors: Array) -> Array:
    """Vectors (m, 3) given in body axes, in ground axes."""
    return (r[bodies] @ vectors[:, :, None])[:, :, 0]


def _swept(r: Array, w: Array, bodies: Array, of: Array) -> Array:
    """Rates (m, 3, k) of `_turned` for angular rates (n + 1, 3, k): R (w x vector), ``of`` being
    the matrices (m, 3, 3) that take w to that product."""
    return r[bodies] @ of @ w[bodies]
