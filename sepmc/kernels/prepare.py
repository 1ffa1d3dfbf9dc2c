"""From a case's parameters to what a flight needs: inertias, lines of thrust, joint points, and the initial state."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import quat, vec3
from sepmc.kernels._jit import stage
from sepmc.kernels.places import body_params, body_work, first_body, joint_params, joint_work, motor_params, motor_work, second_body
from sepmc.kernels.propulsion import thrust_arm, thrust_direction
from sepmc.kernels.wind import wind


@stage
def set_inertias(m, w):
    """Inertia tensors and their inverses. Returns False if a mass or an inertia cannot be flown."""
    for b in range(m.n_bodies):
        p, work = body_params(b), body_work(b, m)
        xx, yy, zz = vec3.scale(w[p + at.INERTIA_FACTOR], vec3.get(w, p + at.INERTIA))
        xy, xz, yz = vec3.scale(w[p + at.INERTIA_FACTOR], vec3.get(w, p + at.PRODUCTS))
        tensor = (xx, -xy, -xz, -xy, yy, -yz, -xz, -yz, zz)
        if not (w[p + at.MASS] > 0.0 and vec3.is_positive_definite(tensor)):
            return False
        vec3.put_matrix(w, work + at.TENSOR, tensor)
        vec3.put_matrix(w, work + at.INVERSE, vec3.symmetric_inverse(tensor))
    return True


@stage
def set_motors(m, w):
    """Unit thrust of each motor and its moment L x F about the centre of mass of its body."""
    for i in range(m.n_motors):
        p, work = motor_params(i, m), motor_work(i, m)
        cg = vec3.get(w, body_params(m.table[m.motor_body_i + i]) + at.CG)
        line = thrust_direction(w[p + at.CANT], w[p + at.CLOCK], w[p + at.DEFLECTION], w[p + at.DEFLECTION_CLOCK])
        arm = thrust_arm(cg, w[p + at.STATION], w[p + at.RADIUS], w[p + at.CLOCK], w[p + at.OFFSET], w[p + at.OFFSET + 1])
        vec3.put(w, work + at.THRUST_LINE, line)
        vec3.put(w, work + at.THRUST_MOMENT, vec3.cross(arm, line))


@stage
def from_cg(point, b, w):
    """From the centre of mass of body b to a layout point, body axes, m: stations run aft."""
    cg = vec3.get(w, body_params(b) + at.CG)
    return (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])


@stage
def set_joints(m, w):
    """Joint points from both centres of mass, and the joint axes as carried by B, parallel to A's while mated."""
    for j in range(m.n_joints):
        point, work = vec3.get(w, joint_params(j, m)), joint_work(j, m)
        vec3.put(w, work + at.RHO_A, from_cg(point, first_body(j, m), w))
        vec3.put(w, work + at.RHO_B, from_cg(point, second_body(j, m), w))
        vec3.put_matrix(w, work + at.AXES_B, vec3.get_matrix(m.numbers, 10 * j))


@stage
def set_initial_state(y, m, w):
    """Initial state of the mated vehicle, consistent with every joint, in the frame that moves with its mass centre.

    The origin starts at (0, altitude, 0) and keeps the initial velocity, so that positions and speeds of separation are
    small numbers and lose nothing to cancellation.
    """
    theta, sigma, v = w[at.PITCH] - w[at.ALPHA], w[at.PATH_YAW], w[at.SPEED]
    vec3.put(w, m.work + at.ORIGIN, (0.0, w[at.ALTITUDE], 0.0))
    path = (math.cos(theta) * math.cos(sigma), math.sin(theta) * math.cos(sigma), -math.sin(sigma))
    vec3.put(w, m.work + at.ORIGIN_VELOCITY, vec3.scale(v, path))
    vec3.put(w, m.work + at.AIR, wind(w[at.WIND_SPEED], w[at.WIND_DIRECTION]))
    mass, weighted = 0.0, (0.0, 0.0, 0.0)
    for b in range(m.n_bodies):
        p = body_params(b)
        mass += w[p + at.MASS]
        weighted = vec3.add(weighted, vec3.scale(w[p + at.MASS], vec3.get(w, p + at.CG)))
    centre = vec3.scale(1.0 / mass, weighted)
    q = quat.from_angles(w[at.PITCH], w[at.YAW], w[at.ROLL])
    r = quat.matrix(q)
    omega = vec3.get(w, at.OMEGA)
    for b in range(m.n_bodies):
        k = b * at.STATE
        place = vec3.rotate(r, vec3.scale(-1.0, from_cg(centre, b, w)))
        vec3.put(y, k + at.POSITION, place)
        vec3.put(y, k + at.VELOCITY, vec3.cross(vec3.rotate(r, omega), place))
        vec3.put(y, k + at.RATE, omega)
        y[k + at.QUATERNION], y[k + at.QUATERNION + 1], y[k + at.QUATERNION + 2], y[k + at.QUATERNION + 3] = q
