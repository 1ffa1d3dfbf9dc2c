"""Springs, pushers and pistons between two points, as rows with a known force."""

import math

from sepmc.kernels import joints, vec3
from sepmc.kernels import layout as at
from sepmc.kernels._jit import formula, keep_apart, stage
from sepmc.kernels.cfe import attitude, load_pair, pair_geometry
from sepmc.kernels.places import spring_params, spring_work


@formula
def spring_force(force, stiffness, damping, extension, rate):
    """Force apart, N: ``force`` at the start, falling with the extension (m) and its rate (m/s)."""
    return force - stiffness * extension - damping * rate


@stage
def spring_line(y, i, m, w):
    """Line of action of spring i: its direction, lever arms on both bodies (ground axes), length along it and rate of that."""
    keep_apart()
    a, b, work = m.table[m.scene.spring_bodies_i + 2 * i], m.table[m.scene.spring_bodies_i + 2 * i + 1], spring_work(i, m)
    rho_a, rho_b, omega_a, omega_b, d, d_rate = pair_geometry(y, a, b, vec3.get(w, work + at.RHO_A), vec3.get(w, work + at.RHO_B), m, w)
    axis = vec3.get(m.numbers, m.scene.springs_x + 3 * i)
    if vec3.dot(axis, axis) == 0.0:
        e, arm_a, arm_b, _ = joints.rod(d, d_rate, rho_a, rho_b, omega_a, omega_b)
        return e, arm_a, arm_b, math.sqrt(vec3.dot(d, d)), vec3.dot(d_rate, e)
    e = vec3.rotate(attitude(a, m, w), axis)
    arm_a, arm_b, _ = joints.translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b)
    return e, arm_a, arm_b, vec3.dot(d, e), joints.translation_rate(d, d_rate, e, omega_a)


@stage
def push(y, m, w):
    """Add the forces of all springs that have not reached their stroke to the loads of their bodies. Needs attitudes."""
    keep_apart()
    for i in range(m.scene.n_springs):
        p, work = spring_params(i, m), spring_work(i, m)
        if w[work + at.SPENT] != 0.0:
            continue
        e, arm_a, arm_b, length, rate = spring_line(y, i, m, w)
        extension = length - w[work + at.EXTENSION_START]
        force = spring_force(w[p + at.SPRING_FORCE], w[p + at.STIFFNESS], w[p + at.DAMPING], extension, rate)
        load_pair(m.table[m.scene.spring_bodies_i + 2 * i], m.table[m.scene.spring_bodies_i + 2 * i + 1], force, e, arm_a, arm_b, m, w)
