"""Pins of a guide: what each carries, and friction in balance with it."""

from typing import TYPE_CHECKING

import numpy as np

from oracles.independent.constraints import Rows
from oracles.independent.joints import Joint, Row
from oracles.independent.loads import act
from oracles.independent.state import Array, State, cross

if TYPE_CHECKING:
    from oracles.independent.motion import Motion

_SHORTEST = 0.01  # of the engaged length: pins are never counted shorter
_ROUNDS = 60


def slides(rows: frozenset[Row]) -> bool:
    """Whether a joint is free along x but holds sideways and against tilting, so that its pins are
    engaged."""
    along = {row[1] for row in rows if row[0] == "along"}
    return along == {1, 2} and sum(row[0] == "turn" for row in rows) >= 2


def contacts(joint: Joint, s: State, force: Array, moment: Array) -> Array:
    """Lateral loads on the second body (y and z of the joint) at the mouth and at the tip of every
    pin: (2, pins, 2), from the joint's force and moment on it, ground axes."""
    guide, axes = joint.guide, s.r[joint.a] @ joint.axes.T  # columns are the joint's axes
    engaged = max(guide["engaged"] - joint.separation(s)[0], _SHORTEST * guide["engaged"])
    f, m, u = axes.T @ force, axes.T @ moment, np.array([float(joint.apart), 0.0, 0.0])
    about_middle = m - 0.5 * engaged * cross(u, f)
    couple = cross(about_middle, u)[1:] / engaged
    pins = guide["pins"]
    angle = guide["clock"] + 2.0 * np.pi * np.arange(pins) / pins
    around = m[0] / (2.0 * pins * guide["circle"]) if guide["circle"] > 0.0 else 0.0
    torsion = around * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    return np.stack([(0.5 * f[1:] + sign * couple) / pins + torsion for sign in (-1.0, 1.0)])


def total(loads: Array) -> float:
    """Sum of the sizes of contact loads (..., 2), N."""
    return float(np.sum(np.sqrt(np.sum(loads**2, axis=-1))))


def rub(joint: Joint, s: State, size: float, force: Array, moment: Array) -> None:
    """Add a force of that size on the second body toward the separation, and its opposite on the
    first along the same line."""
    along = joint.apart * (s.r[joint.a] @ joint.axes[0])
    act(s, joint.a, joint.b, joint.arm_a, joint.arm_b, joint.gap(s)[0], size * along, force, moment)


def friction(
    motion: "Motion", s: State, rows: Rows, loads: tuple[Array, Array]
) -> dict[str, float] | None:
    """Friction on the second bodies toward their separation, N, by joint: ``friction`` times the
    sum of all contact loads, against the sliding; None if no friction is in balance with the loads
    it causes.

    Contact loads are linear in all frictions, so one solution without and one for each friction
    tell them all. Each is then found as the root of a convex function, from below, by Newton's
    method, which reaches the first root or shows that there is none.
    """
    rubbing = [
        j
        for j in motion.joints.values()
        if j.guide and j.guide["friction"] > 0.0 and slides(motion.sequence.held[j.name])
    ]
    if not rubbing:
        return {}
    signs = [
        joint.separation(s)[1] / np.hypot(joint.separation(s)[1], joint.guide["slip_speed"])
        for joint in rubbing
    ]

    def carried(rubbed: Joint | None, size: float) -> list[Array]:
        force, moment = loads[0].copy(), loads[1].copy()
        if rubbed is not None:
            rub(rubbed, s, size, force, moment)
        multipliers = rows.multipliers(rows.accelerate(motion.free(s, force, moment))[1])
        return [contacts(joint, s, *rows.wrench(joint, s, multipliers)) for joint in rubbing]

    without = carried(None, 0.0)
    unit = max(1.0, *(total(each) for each in without))
    by = [
        [(b - a) / unit for a, b in zip(without, carried(joint, unit), strict=True)]
        for joint in rubbing
    ]
    found = np.zeros(len(rubbing))
    for _ in range(_ROUNDS):
        before = found.copy()
        for i, (joint, sign) in enumerate(zip(rubbing, signs, strict=True)):
            other = without[i] + sum(
                (found[k] * by[k][i] for k in range(len(rubbing)) if k != i), np.zeros(())
            )
            size = _balance(joint.guide["friction"] * abs(sign), other, -np.sign(sign) * by[i][i])
            if size is None:
                return None
            found[i] = -np.sign(sign) * size
        if np.abs(found - before).max() <= 1e-14 * max(1.0, np.abs(found).max()):
            return {joint.name: float(size) for joint, size in zip(rubbing, found, strict=True)}
    return None


def _balance(coefficient: float, without: Array, by: Array) -> float | None:
    """Least size f >= 0 with coefficient times the total of ``without + f by`` equal to f, or None
    if there is none."""
    f = 0.0
    for _ in range(_ROUNDS):
        loads = without + f * by
        sizes = np.sqrt(np.sum(loads**2, axis=-1))
        off = coefficient * float(np.sum(sizes)) - f
        slope = (
            coefficient
            * float(np.sum(np.sum(loads * by, axis=-1) / np.where(sizes > 0.0, sizes, 1.0)))
            - 1.0
        )
        if abs(off) <= 1e-15 * f or off == 0.0:
            return f
        if slope >= 0.0:
            return None
        step = -off / slope
        if step <= 1e-16 * f:
            return f
        f += step
    return f
