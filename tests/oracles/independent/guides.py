"""Pins of a guide: contact loads, and friction in balance with them."""

from collections.abc import Callable

import numpy as np

from oracles.independent.constraints import Rows
from oracles.independent.joints import Joint, Row
from oracles.independent.loads import act
from oracles.independent.state import Array, State, cross

_MIN_ENGAGED = 0.01  # minimum of the engaged length, relative to its initial value
_ROUNDS = 60


def slides(rows: frozenset[Row]) -> bool:
    """True if a joint is free along x but constrained sideways and against tilting, so that its
    pins are engaged."""
    along = {row[1] for row in rows if row[0] == "along"}
    return along == {1, 2} and sum(row[0] == "turn" for row in rows) >= 2


def contacts(joint: Joint, s: State, force: Array, moment: Array) -> Array:
    """Lateral loads (2, pins, 2), N, on the second body (y and z of the joint) at the entry and the
    tip of every pin, from the joint's force and moment on it, ground axes."""
    guide, axes = joint.guide, s.r[joint.a] @ joint.axes.T  # columns are the joint's axes
    engaged = max(guide["engaged"] - joint.separation(s)[0], _MIN_ENGAGED * guide["engaged"])
    f, m, u = axes.T @ force, axes.T @ moment, np.array([float(joint.separation_sign), 0.0, 0.0])
    about_middle = m - 0.5 * engaged * cross(u, f)
    couple = cross(about_middle, u)[1:] / engaged
    pins = guide["pins"]
    angle = guide["clock"] + 2.0 * np.pi * np.arange(pins) / pins
    around = m[0] / (2.0 * pins * guide["circle"]) if guide["circle"] > 0.0 else 0.0
    torsion = around * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return np.stack([(0.5 * f[1:] + sign * couple) / pins + torsion for sign in (-1.0, 1.0)])


def total(loads: Array) -> float:
    """Sum of the magnitudes of contact loads (..., 2), N."""
    return float(np.sum(np.sqrt(np.sum(loads**2, axis=-1))))


def add_friction(joint: Joint, s: State, size: float, force: Array, moment: Array) -> None:
    """Add a friction force of a size, N, on the second body toward the separation, and its opposite
    on the first along the same line."""
    along = joint.separation_sign * (s.r[joint.a] @ joint.axes[0])
    act(s, joint.a, joint.b, joint.arm_a, joint.arm_b, joint.gap(s)[0], size * along, force, moment)


def friction(
    sliding: list[Joint],
    free: Callable[[Array, Array], Array],
    s: State,
    rows: Rows,
    loads: tuple[Array, Array],
) -> dict[str, float] | None:
    """Friction on the second bodies toward their separation, N, by joint: ``friction`` times the
    sum of all contact loads, against the sliding. None if no friction balances the loads that it
    causes.

    Contact loads are linear in all frictions, so they follow from one solution without friction and
    one for each. Each friction is the root of a convex function, approached from below by Newton's
    method, which reaches the first root or shows that there is none.

    Parameters
    ----------
    sliding : list of Joint
        Joints with friction whose pins are engaged.
    free : callable
        Unconstrained accelerations (n, 6) of forces and moments, at this state.
    s : State
    rows : Rows
        Constraint rows at this state.
    loads : tuple of ndarray, shape (n + 1, 3)
        Forces and moments on the bodies, without friction.
    """
    if not sliding:
        return {}
    signs = [
        joint.separation(s)[1] / np.hypot(joint.separation(s)[1], joint.guide["slip_speed"])
        for joint in sliding
    ]

    def contact_loads(rubbing_joint: Joint | None, size: float) -> list[Array]:
        """Contact loads of all joints with a friction of one of them."""
        force, moment = loads[0].copy(), loads[1].copy()
        if rubbing_joint is not None:
            add_friction(rubbing_joint, s, size, force, moment)
        multipliers = rows.multipliers(rows.accelerate(free(force, moment))[1])
        return [contacts(joint, s, *rows.wrench(joint, s, multipliers)) for joint in sliding]

    without = contact_loads(None, 0.0)
    unit = max(1.0, *(total(each) for each in without))
    per_newton = [
        [(b - a) / unit for a, b in zip(without, contact_loads(joint, unit), strict=True)]
        for joint in sliding
    ]
    forces = np.zeros(len(sliding))
    for _ in range(_ROUNDS):
        before = forces.copy()
        for i, (joint, sign) in enumerate(zip(sliding, signs, strict=True)):
            other = without[i] + sum(
                (forces[k] * per_newton[k][i] for k in range(len(sliding)) if k != i), np.zeros(())
            )
            size = _balance(
                joint.guide["friction"] * abs(sign), other, -np.sign(sign) * per_newton[i][i]
            )
            if size is None:
                return None
            forces[i] = -np.sign(sign) * size
        if np.abs(forces - before).max() <= 1e-14 * max(1.0, np.abs(forces).max()):
            return {joint.name: float(size) for joint, size in zip(sliding, forces, strict=True)}
    return None


def _balance(coefficient: float, without: Array, per_newton: Array) -> float | None:
    """Smallest f >= 0 with coefficient times the total of ``without + f per_newton`` equal to f, or
    None."""
    f = 0.0
    for _ in range(_ROUNDS):
        loads = without + f * per_newton
        sizes = np.sqrt(np.sum(loads**2, axis=-1))
        excess = coefficient * float(np.sum(sizes)) - f
        slope = (
            coefficient
            * float(np.sum(np.sum(loads * per_newton, axis=-1) / np.where(sizes > 0.0, sizes, 1.0)))
            - 1.0
        )
        if abs(excess) <= 1e-15 * f or excess == 0.0:
            return f
        if slope >= 0.0:
            return None
        step = -excess / slope
        if step <= 1e-16 * f:
            return f
        f += step
    return f
