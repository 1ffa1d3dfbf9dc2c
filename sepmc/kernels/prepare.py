"""From a case's parameters to what a flight needs: inertias, lines of thrust, joint points, and the initial state."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import quat, vec3
from sepmc.kernels._jit import formula, keep_apart, stage
from sepmc.kernels.elementary import sine_cosine
from sepmc.kernels.places import (
    body_params,
    body_work,
    first_body,
    joint_axes_x,
    joint_params,
    joint_work,
    load_params,
    load_work,
    motor_params,
    motor_work,
    second_body,
    spring_params,
    spring_work,
)
from sepmc.kernels.propulsion import thrust_arm, thrust_direction
from sepmc.kernels.wind import wind


@formula
def inertia_tensor(factor, moments, products):
    """Inertia tensor, kg m2, from moments xx, yy, zz and products xy, xz, yz (integrals of x y, ...), all times a factor."""
    xx, yy, zz = vec3.scale(factor, moments)
    xy, xz, yz = vec3.scale(-factor, products)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def arm(cg, point):
    """From a centre of mass to a layout point, body axes, m: stations run aft."""
    return (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])


@formula
def flight_direction(path_angle, path_yaw):
    """Unit vector of the velocity in ground axes."""
    climb, level = sine_cosine(path_angle)
    aside, ahead = sine_cosine(path_yaw)
    return (level * ahead, climb * ahead, -aside)


@stage
def set_inertias(m, w):
    """Inertia tensors and their inverses. Returns False if a mass or an inertia cannot be flown."""
    for b in range(m.scene.n_bodies):
        if b == m.scene.ground:  # scratch is zero: nothing moves it
            continue
        p, work = body_params(b), body_work(b, m)
        tensor = inertia_tensor(w[p + at.INERTIA_FACTOR], vec3.get(w, p + at.INERTIA), vec3.get(w, p + at.PRODUCTS))
        if not (w[p + at.MASS] > 0.0 and vec3.is_positive_definite(tensor)):
            return False
        vec3.put_matrix(w, work + at.TENSOR, tensor)
        vec3.put_matrix(w, work + at.INVERSE, vec3.symmetric_inverse(tensor))
        w[work + at.INVERSE_MASS] = 1.0 / w[p + at.MASS]
    return True


@stage
def set_centre(m, w):
    """Layout point of the mass centre of all bodies, which is also where the ground's own axes start."""
    mass, weighted = 0.0, (0.0, 0.0, 0.0)
    for b in range(m.scene.n_bodies):
        if b != m.scene.ground:
            p = body_params(b)
            mass += w[p + at.MASS]
            weighted = vec3.add(weighted, vec3.scale(w[p + at.MASS], vec3.get(w, p + at.CG)))
    centre = vec3.scale(1.0 / mass, weighted)
    if m.scene.ground >= 0:
        vec3.put(w, body_params(m.scene.ground) + at.CG, centre)
    return centre


@stage
def set_motors(m, w):
    """Unit thrust of each motor and its moment L x F about the centre of mass of its body."""
    for i in range(m.scene.n_motors):
        p, work = motor_params(i, m), motor_work(i, m)
        cg = vec3.get(w, body_params(m.table[m.scene.motor_body_i + i]) + at.CG)
        line = thrust_direction(w[p + at.CANT], w[p + at.CLOCK], w[p + at.DEFLECTION], w[p + at.DEFLECTION_CLOCK])
        arm = thrust_arm(cg, w[p + at.STATION], w[p + at.RADIUS], w[p + at.CLOCK], w[p + at.OFFSET], w[p + at.OFFSET + 1])
        vec3.put(w, work + at.THRUST_LINE, line)
        vec3.put(w, work + at.THRUST_MOMENT, vec3.cross(arm, line))


@stage
def from_cg(point, b, w):
    """`arm` of body b."""
    return arm(vec3.get(w, body_params(b) + at.CG), point)


@stage
def _two_points(p, a, b, w):
    """Arms of bodies a and b to a pair of points (the second, if not finite, is the first), and the gap between them, body axes."""
    first, second = vec3.get(w, p + at.POINT), vec3.get(w, p + at.SECOND_POINT)
    if math.isnan(second[0]):
        second = first
    return from_cg(first, a, w), from_cg(second, b, w), (first[0] - second[0], second[1] - first[1], second[2] - first[2])


@stage
def set_joints(m, w):
    """Joint points from both centres of mass, and the joint axes as carried by B, parallel to A's while mated."""
    keep_apart()
    for j in range(m.scene.n_joints):
        work, axes = joint_work(j, m), vec3.get_matrix(m.numbers, joint_axes_x(j))
        rho_a, rho_b, gap = _two_points(joint_params(j, m), first_body(j, m), second_body(j, m), w)
        vec3.put(w, work + at.RHO_A, rho_a)
        vec3.put(w, work + at.RHO_B, rho_b)
        vec3.put_matrix(w, work + at.AXES_B, axes)
        w[work + at.GAP_START] = vec3.dot(gap, (axes[0], axes[1], axes[2]))
        w[work + at.ROD_LENGTH] = math.sqrt(vec3.dot(gap, gap))


@stage
def set_springs(m, w):
    """Points of the springs and their extension at the start; arms of constant loads."""
    keep_apart()
    for i in range(m.scene.n_springs):
        work, axis = spring_work(i, m), vec3.get(m.numbers, m.scene.springs_x + 3 * i)
        a, b = m.table[m.scene.spring_bodies_i + 2 * i], m.table[m.scene.spring_bodies_i + 2 * i + 1]
        rho_a, rho_b, gap = _two_points(spring_params(i, m), a, b, w)
        vec3.put(w, work + at.RHO_A, rho_a)
        vec3.put(w, work + at.RHO_B, rho_b)
        along = vec3.dot(axis, axis) > 0.0
        w[work + at.EXTENSION_START] = vec3.dot(gap, axis) if along else math.sqrt(vec3.dot(gap, gap))
    for i in range(m.scene.n_loads):
        point = vec3.get(w, load_params(i, m) + at.LOAD_POINT)
        if not math.isnan(point[0]):
            vec3.put(w, load_work(i, m) + at.ARM, from_cg(point, m.table[m.scene.load_i + 2 * i], w))


@stage
def set_initial_state(y, m, w):
    """Initial state of the mated vehicle, consistent with every joint, in the frame that moves with its mass centre.

    The origin starts at (0, altitude, 0) and keeps the initial velocity, so that positions and speeds of separation are
    small numbers and lose nothing to cancellation. A vehicle held to the ground turns about the joint that holds it.
    """
    keep_apart()
    v, path = w[at.SPEED], flight_direction(w[at.PITCH] - w[at.ALPHA], w[at.PATH_YAW])
    vec3.put(w, m.scene.work + at.ORIGIN, (0.0, w[at.ALTITUDE], 0.0))
    vec3.put(w, m.scene.work + at.ORIGIN_VELOCITY, vec3.scale(v, path))
    vec3.put(w, m.scene.work + at.STEADY_WIND, wind(w[at.WIND_SPEED], w[at.WIND_DIRECTION]))
    centre = set_centre(m, w)
    pivot = (0.0, 0.0, 0.0)
    if m.scene.pivot_joint >= 0:
        p = joint_params(m.scene.pivot_joint, m)
        point = vec3.get(w, p + (at.POINT if first_body(m.scene.pivot_joint, m) == m.scene.ground else at.SECOND_POINT))
        point = vec3.get(w, p + at.POINT) if math.isnan(point[0]) else point
        pivot = arm(centre, point)
    q = quat.from_angles(w[at.PITCH], w[at.YAW], w[at.ROLL])
    r = quat.matrix(q)
    omega = vec3.get(w, at.OMEGA)
    for b in range(m.scene.n_bodies):
        k, moves = b * at.STATE, b != m.scene.ground
        offset = vec3.scale(-1.0, from_cg(centre, b, w))
        vec3.put(y, k + at.POSITION, vec3.rotate(r, offset))
        turning = vec3.rotate(r, vec3.cross(omega, vec3.sub(offset, pivot)))
        vec3.put(y, k + at.VELOCITY, turning if moves else vec3.scale(-v, path))
        vec3.put(y, k + at.RATE, omega if moves else (0.0, 0.0, 0.0))
        y[k + at.QUATERNION], y[k + at.QUATERNION + 1], y[k + at.QUATERNION + 2], y[k + at.QUATERNION + 3] = q
        w[body_work(b, m) + at.LAST_PITCH], w[body_work(b, m) + at.LAST_ROLL] = w[at.PITCH], w[at.ROLL]
    y[m.scene.n_bodies * at.STATE] = 0.0


@stage
def prepare(nominal, slots, draws, w, y, m):
    """Put the draws in place and set up the flight. Returns False if the case cannot be flown."""
    keep_apart()
    for k in range(nominal.shape[0]):  # a slice would compile the text of its error messages, a second
        w[k] = nominal[k]
    for i in range(slots.shape[0]):
        if not math.isfinite(draws[i]):
            return False
        w[slots[i]] = draws[i]
    if not set_inertias(m, w):
        return False
    set_centre(m, w)
    set_motors(m, w)
    set_joints(m, w)
    set_springs(m, w)
    set_initial_state(y, m, w)
    return True
