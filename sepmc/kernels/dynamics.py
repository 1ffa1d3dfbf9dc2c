"""The right-hand side: loads on every body, then the constraint force equations, then the state's derivative."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import quat, vec3
from sepmc.kernels._jit import stage
from sepmc.kernels.aerodynamics import aero_force, aero_moment, air_angles
from sepmc.kernels.atmosphere import us1976
from sepmc.kernels.cfe import attitude, solve_motion
from sepmc.kernels.gravity import gravity
from sepmc.kernels.places import body_params, body_work, motor_params, motor_work, phase_rows
from sepmc.kernels.propulsion import thrust_level


@stage
def set_attitudes(y, m, w):
    """Attitude matrices of all bodies from the state."""
    for b in range(m.n_bodies):
        q = b * at.STATE + at.QUATERNION
        vec3.put_matrix(w, body_work(b, m) + at.ATTITUDE, quat.matrix((y[q], y[q + 1], y[q + 2], y[q + 3])))


@stage
def height(t, y, b, m, w):
    """Height of the centre of mass of body b, m."""
    return y[b * at.STATE + at.POSITION + 1] + (w[m.work + at.ORIGIN + 1] + w[m.work + at.ORIGIN_VELOCITY + 1] * t)


@stage
def air_velocity(y, b, m, w):
    """Air-relative velocity of body b in its body axes, m/s. Needs attitudes."""
    ground = vec3.add(vec3.get(y, b * at.STATE + at.VELOCITY), vec3.get(w, m.work + at.ORIGIN_VELOCITY))
    return vec3.unrotate(attitude(b, m, w), vec3.sub(ground, vec3.get(w, m.work + at.AIR)))


@stage
def _coefficients(b, alpha, beta, m, w):
    """Aerodynamic coefficients C_A, C_N, C_Y and C_l, C_n, C_m of body b, sums of polynomial terms."""
    ca, cn, cy, cl, cyaw, cm = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(m.n_terms):
        term = m.terms_i + 4 * k
        if m.table[term] != b:
            continue
        value = w[m.terms_p + k]
        for _ in range(m.table[term + 2]):
            value *= alpha
        for _ in range(m.table[term + 3]):
            value *= beta
        which = m.table[term + 1]
        if which == at.AXIAL:
            ca += value
        elif which == at.NORMAL:
            cn += value
        elif which == at.SIDE:
            cy += value
        elif which == at.ROLLING:
            cl += value
        elif which == at.YAWING:
            cyaw += value
        else:
            cm += value
    return (ca, cn, cy), (cl, cyaw, cm)


@stage
def aerodynamics(t, y, b, m, w):
    """Aerodynamic force and moment about the centre of mass of body b, body axes, N and N m."""
    p = body_params(b)
    speed, alpha, beta = air_angles(air_velocity(y, b, m, w))
    altitude = height(t, y, b, m, w)
    density, _, _ = us1976(altitude)
    if math.isnan(density) and math.isfinite(altitude):
        w[m.work + at.LEFT_AIR] = 1.0
    force_c, moment_c = _coefficients(b, alpha, beta, m, w)
    qs = 0.5 * density * speed * speed * w[p + at.AREA]
    force = aero_force(qs * w[p + at.FORCE_FACTOR], force_c)
    moment = aero_moment(qs * w[p + at.LENGTH] * w[p + at.MOMENT_FACTOR], moment_c)
    if not math.isnan(w[p + at.MOMENT_POINT]):  # coefficients about a fixed point: carry them to the centre of mass
        cg, point = vec3.get(w, p + at.CG), vec3.get(w, p + at.MOMENT_POINT)
        arm = (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])
        moment = vec3.add(moment, vec3.cross(arm, force))
    return force, moment


@stage
def set_loads(t, y, m, w):
    """External loads of every body: force in ground axes; moment less w x J w in body axes. Needs attitudes."""
    for b in range(m.n_bodies):
        p, work = body_params(b), body_work(b, m)
        force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if m.atmosphere != at.NO_ATMOSPHERE and w[p + at.AREA] > 0.0:
            force, moment = aerodynamics(t, y, b, m, w)
        for i in range(m.n_motors):
            line = motor_work(i, m)
            if m.table[m.motor_body_i + i] == b and w[line + at.BURNING] != 0.0:
                motor = motor_params(i, m)
                level = thrust_level(w[motor + at.THRUST], w[motor + at.BUILD_UP], t - w[motor + at.IGNITION])
                force = vec3.add(force, vec3.scale(level, vec3.get(w, line + at.THRUST_LINE)))
                moment = vec3.add(moment, vec3.scale(level, vec3.get(w, line + at.THRUST_MOMENT)))
        omega = vec3.get(y, b * at.STATE + at.RATE)
        moment = vec3.sub(moment, vec3.cross(omega, vec3.rotate(vec3.get_matrix(w, work + at.TENSOR), omega)))
        vec3.put(w, work + at.LOAD, vec3.rotate(attitude(b, m, w), force))
        vec3.put(w, work + at.LOAD + 3, moment)
        w[work + at.LOAD + 1] -= w[p + at.MASS] * gravity(m.gravity, w[at.SURFACE_GRAVITY], height(t, y, b, m, w))


@stage
def motion(t, y, phase, m, w):
    """Accelerations and joint wrenches at a state, left in w. Returns the smallest pivot."""
    set_attitudes(y, m, w)
    set_loads(t, y, m, w)
    return solve_motion(y, phase_rows(phase, m), m, w)


@stage
def derivative(t, y, out, phase, m, w):
    """dy/dt into ``out``. Returns the smallest pivot of the constraint solve."""
    pivot = motion(t, y, phase, m, w)
    for b in range(m.n_bodies):
        k, work = b * at.STATE, body_work(b, m)
        q = k + at.QUATERNION
        vec3.put(out, k + at.POSITION, vec3.get(y, k + at.VELOCITY))
        vec3.put(out, k + at.VELOCITY, vec3.get(w, work + at.ACCEL))
        vec3.put(out, k + at.RATE, vec3.get(w, work + at.ACCEL + 3))
        out[q], out[q + 1], out[q + 2], out[q + 3] = quat.rate((y[q], y[q + 1], y[q + 2], y[q + 3]), vec3.get(y, k + at.RATE))
    return pivot
