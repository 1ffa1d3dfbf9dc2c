"""The equations heyoka integrates, written for as few products of series as possible: a product of
two series of order p costs p^2/2.

Everything is in body axes, where the air loads need no rotation: D, the velocity of a mass centre
less the initial velocity v0 of the vehicle (m/s); U, the unit vector of v0 less the wind; e, the
upward unit vector; w, the rates (rad/s); z, the height gained (km); X, the position in the frame
that moves with v0 (m); L = 1 - exp(-t / build_up), the share of full thrust. The fixed ground
vectors U and e tell the attitude, so that no matrix is integrated. All states are of order one:
heyoka's control of the step takes the largest for their common scale.

While the joint holds, both bodies are one composite body about their common mass centre, with r the
way from the first mass centre to the second, whose x grows along the slider. Eliminating the
sliding acceleration leaves a matrix whose only mixed terms are xy and xz, solved by two divisions.
Everything dispersed is a parameter, and every product of parameters is taken beforehand.
"""

from typing import Any

import heyoka as hy
import numpy as np

from oracles.engine_race.heyoka_terms import (
    KM,
    Equations,
    body_loads,
    dot,
    kinematics,
    minus,
    plus,
    scaled,
    scaled_each,
    thrust_level,
    times,
)
from oracles.engine_race.inputs import Inputs
from oracles.engine_race.vectors import Array
from oracles.external_engines import loads


def free(inputs: Inputs) -> Equations:
    """Two bodies apart; 16 states each (tags a and b) and L."""
    eq = Equations(inputs)
    level = thrust_level(eq)
    speed = eq.par(np.linalg.norm(inputs.velocity - inputs.wind, axis=1))
    radius = eq.par(loads.EARTH_RADIUS + inputs.altitude)
    for tag, body in zip("ab", inputs.bodies, strict=True):
        D, U, e, w, X = (eq.vector(f"{name}{tag}") for name in ("D", "U", "e", "w", "X"))
        height = radius + (1.0 / KM) * hy.expression(f"z{tag}")
        accelerations, moments, gravity = body_loads(
            eq, body, plus(D, scaled(speed, U)), height, level
        )
        kinematics(eq, tag, D, w, plus(accelerations(), minus(scaled(gravity, e))))
        x, y, z = body.inertia.T
        turning = scaled_each(
            eq.pars(np.stack([(y - z) / x, (z - x) / y, (x - y) / z], axis=-1)),
            [w[1] * w[2], w[2] * w[0], w[0] * w[1]],
        )
        eq.derive(f"w{tag}", plus(moments(body.inertia), turning))
        eq.derive(f"X{tag}", plus(D, times(X, w)))
    return eq


def mated(inputs: Inputs, slides: bool) -> Equations:
    """One composite body, locked or with the joint sliding; 14 states, and rx and its rate vx if it
    slides."""
    eq = Equations(inputs)
    level = thrust_level(eq)
    first, second = inputs.bodies
    total = first.mass + second.mass
    reduced = first.mass * second.mass / total
    # of r, from the common mass centre to those of the bodies
    share = [eq.par(-second.mass / total), eq.par(first.mass / total)]
    weight = [eq.par(first.mass / total), eq.par(second.mass / total)]
    gap = first.arm - second.arm  # r while closed
    D, U, e, w = (eq.vector(name) for name in "DUew")
    r = [hy.expression("rx") if slides else eq.par(gap[:, 0]), eq.par(gap[:, 1]), eq.par(gap[:, 2])]
    swing = times(w, r)
    moving = [swing[0] + hy.expression("vx"), *swing[1:]] if slides else swing
    speed = eq.par(np.linalg.norm(inputs.velocity - inputs.wind, axis=1))
    radius = eq.par(loads.EARTH_RADIUS + inputs.altitude)
    V, up = plus(D, scaled(speed, U)), dot(e, r)
    loads_of_bodies = []
    for part, body in zip(share, inputs.bodies, strict=True):
        height = hy.sum([radius, (1.0 / KM) * hy.expression("z"), part * up])
        loads_of_bodies.append(body_loads(eq, body, plus(V, scaled(part, moving)), height, level))
    each = [plus(push(), minus(scaled(gravity, e))) for push, _, gravity in loads_of_bodies]
    kinematics(eq, "", D, w, plus(scaled(weight[0], each[0]), scaled(weight[1], each[1])))
    apart = plus(each[1], minus(each[0]))
    J = first.inertia + second.inertia
    ones = np.ones_like(J)
    moment = plus(*(moments(ones) for _, moments, _ in loads_of_bodies))
    if slides:
        _slide(eq, J, gap, reduced, r, w, moment, apart)
    else:
        arm = np.eye(3) * (gap**2).sum(axis=1)[:, None, None] - gap[:, :, None] * gap[:, None, :]
        tensor = np.eye(3) * J[:, None, :] + reduced[:, None, None] * arm
        mass_arm = eq.pars(reduced[:, None] * gap)
        momentum = [dot(eq.pars(tensor[:, i]), w) for i in range(3)]
        torque = plus(moment, times(mass_arm, apart), times(momentum, w))
        inverse = np.linalg.inv(tensor)
        eq.derive("w", [dot(eq.pars(inverse[:, i]), torque) for i in range(3)])
    return eq


def _slide(
    eq: Equations, J: Array, gap: Array, reduced: Array, r: Any, w: Any, moment: Any, apart: Any
) -> None:
    """Rates of w, rx and vx: moment about the common mass centre and relative force balance, the
    sliding acceleration eliminated.

    With c the relative acceleration by the rates alone, f - c what is left of the forces' and m the
    reduced mass,

        T = M - w x J w + m r x (0, fy - cy, fz - cz),
        (Jx + m (ry^2 + rz^2)) wx' - m ry rx wy' - m rz rx wz' = Tx,
        (Jy + m rx^2) wy' - m ry rx wx' = Ty,     (Jz + m rx^2) wz' - m rz rx wx' = Tz,
        vx' = fx - cx - wy' rz + wz' ry.
    """
    vx, rx = hy.expression("vx"), r[0]
    along, square = dot(w, r), dot(w, w)
    turn = [w[0] * along - rx * square, w[1] * along - r[1] * square, w[2] * along - r[2] * square]
    coriolis = [None, 2.0 * (vx * w[2]), -2.0 * (vx * w[1])]
    left = [apart[0] - turn[0]] + [
        hy.sum([apart[k], -1.0 * turn[k], -1.0 * coriolis[k]]) for k in (1, 2)
    ]
    m = eq.par(reduced)
    my, mz = (eq.par(reduced * gap[:, k]) for k in (1, 2))
    gyro = [
        eq.par(J[:, 1] - J[:, 2]) * (w[1] * w[2]),
        eq.par(J[:, 2] - J[:, 0]) * (w[2] * w[0]),
        eq.par(J[:, 0] - J[:, 1]) * (w[0] * w[1]),
    ]
    torque = [
        hy.sum([moment[0], gyro[0], my * left[2], -1.0 * mz * left[1]]),
        hy.sum([moment[1], gyro[1], -1.0 * m * (rx * left[2])]),
        hy.sum([moment[2], gyro[2], m * (rx * left[1])]),
    ]
    inertia = m * (rx * rx)
    one_y, one_z = 1.0 / (eq.par(J[:, 1]) + inertia), 1.0 / (eq.par(J[:, 2]) + inertia)
    lean_y, lean_z = my * (rx * one_y), mz * (rx * one_z)  # wy' and wz' by wx'
    pivot = hy.sum(
        [
            eq.par(J[:, 0] + reduced * (gap[:, 1:] ** 2).sum(axis=1)),
            -1.0 * my * (rx * lean_y),
            -1.0 * mz * (rx * lean_z),
        ]
    )
    wx = hy.sum([torque[0], lean_y * torque[1], lean_z * torque[2]]) / pivot
    wy, wz = one_y * torque[1] + lean_y * wx, one_z * torque[2] + lean_z * wx
    eq.derive("w", [wx, wy, wz])
    eq.rates["rx"] = vx
    eq.rates["vx"] = hy.sum([left[0], -1.0 * (r[2] * wy), r[1] * wz])


def start(inputs: Inputs) -> dict[str, Array]:
    """States of the locked phase at t = 0, by name."""
    air = inputs.velocity - inputs.wind
    unit = np.einsum("nji,nj->ni", inputs.R, air / np.linalg.norm(air, axis=1)[:, None])
    zero = np.zeros(inputs.count)
    vectors = {"D": np.zeros((inputs.count, 3)), "U": unit, "e": inputs.R[:, 1], "w": inputs.omega}
    return {
        "L": zero,
        "z": zero,
        **{f"{name}{a}": v[:, i] for name, v in vectors.items() for i, a in enumerate("xyz")},
    }
