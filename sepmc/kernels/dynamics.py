"""The right-hand side: loads on every body, then the constraint force equations, then the state's derivative."""

import math

from sepmc.kernels import guides, joints, quat, vec3
from sepmc.kernels import layout as at
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.aerodynamics import aero_force, aero_moment, air_angles
from sepmc.kernels.atmosphere import density_in_layer, in_layer, sound_speed
from sepmc.kernels.cfe import attitude, joint_axes, joint_geometry, load_pair, separation, solve_motion
from sepmc.kernels.gravity import gravity
from sepmc.kernels.places import (
    body_params,
    body_work,
    first_body,
    joint_axes_x,
    joint_params,
    joint_work,
    kind_of,
    kind_rows,
    load_params,
    load_work,
    motor_params,
    motor_work,
    second_body,
)
from sepmc.kernels.propulsion import tail_off, thrust_level
from sepmc.kernels.splines import curve, grid6
from sepmc.kernels.springs import push
from sepmc.kernels.us1976_table import TOP

_FRICTION_ROUNDS = 60
_FRICTION = 1e-12  # of the friction, or of all loads, whose round-off it has: then it and the joint wrench it depends on have settled


@stage
def set_attitudes(y, m, w):
    """Attitude matrices of all bodies from the state."""
    for b in range(m.scene.n_bodies):
        q = b * at.STATE + at.QUATERNION
        vec3.put_matrix(w, body_work(b, m) + at.ATTITUDE, quat.matrix((y[q], y[q + 1], y[q + 2], y[q + 3])))


@stage
def height(t, y, b, m, w):
    """Height of the centre of mass of body b, m."""
    return y[b * at.STATE + at.POSITION + 1] + (w[m.scene.work + at.ORIGIN + 1] + w[m.scene.work + at.ORIGIN_VELOCITY + 1] * t)


@stage
def wind_at(altitude, m, w):
    """Velocity of the air in ground axes at a height, m/s: the steady wind and what the profile adds."""
    steady = vec3.get(w, m.scene.work + at.STEADY_WIND)
    if m.scene.wind_x < 0:
        return steady
    return vec3.add(steady, (curve(m.numbers, m.scene.wind_x, 0, altitude), 0.0, curve(m.numbers, m.scene.wind_x, 1, altitude)))


@stage
def air_velocity(t, y, b, m, w):
    """Air-relative velocity of body b in its body axes, m/s. Needs attitudes."""
    ground = vec3.add(vec3.get(y, b * at.STATE + at.VELOCITY), vec3.get(w, m.scene.work + at.ORIGIN_VELOCITY))
    return vec3.unrotate(attitude(b, m, w), vec3.sub(ground, wind_at(height(t, y, b, m, w), m, w)))


@stage
def air_at(altitude, b, m, w):
    """Density (kg/m3) and speed of sound (m/s) for body b at a height; notes a height at which there is none."""
    if m.scene.atmosphere == at.AIR_TABLE:
        if not m.numbers[m.scene.air_x - 2] <= altitude <= m.numbers[m.scene.air_x - 1]:
            if math.isfinite(altitude):
                w[m.scene.work + at.LEFT_AIR] = 1.0
            return math.nan, math.nan
        return math.exp(curve(m.numbers, m.scene.air_x, 0, altitude)), curve(m.numbers, m.scene.air_x, 1, altitude)
    if not 0.0 <= altitude <= TOP:
        if math.isfinite(altitude):
            w[m.scene.work + at.LEFT_AIR] = 1.0
        return math.nan, math.nan
    k = body_work(b, m) + at.LAYER
    base = (w[k], w[k + 1], w[k + 2], w[k + 3])
    return density_in_layer(altitude, base), sound_speed(in_layer(altitude, base)[1])


@stage
def _polynomials(b, alpha, beta, m, w):
    """Aerodynamic coefficients C_A, C_N, C_Y, C_l, C_n, C_m of body b, sums of polynomial terms."""
    ca, cn, cy, cl, cyaw, cm = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(m.scene.n_terms):
        term = m.scene.terms_i + 4 * k
        if m.table[term] != b:
            continue
        value = w[m.scene.terms_p + k]
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
    return ca, cn, cy, cl, cyaw, cm


@stage
def _coefficients(y, b, mach, alpha, beta, m, w):
    """Coefficients of body b: polynomials, table over (Mach, alpha, beta), increments over the distance of separation."""
    keep_apart()
    total = _polynomials(b, alpha, beta, m, w)
    table = m.table[m.scene.aero_table_i + b]
    if table >= 0:
        found = grid6(m.numbers, table, mach, alpha, beta)
        if math.isnan(found[0]) and math.isfinite(alpha):
            w[m.scene.work + at.LEFT_TABLE] = 1.0
        total = _sum6(total, 1.0, found)
    for i in range(m.scene.n_proximity):
        entry = m.scene.proximity_i + 3 * i
        if m.table[entry] == b:
            x, start = separation(y, m.table[entry + 1], m, w)[0], m.table[entry + 2]
            found = (
                curve(m.numbers, start, 0, x), curve(m.numbers, start, 1, x), curve(m.numbers, start, 2, x),
                curve(m.numbers, start, 3, x), curve(m.numbers, start, 4, x), curve(m.numbers, start, 5, x),
            )  # fmt: skip
            total = _sum6(total, w[m.scene.proximity_p + i], found)
    return (total[0], total[1], total[2]), (total[3], total[4], total[5])


@stage
def _sum6(a, factor, b):
    return (
        a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2],
        a[3] + factor * b[3], a[4] + factor * b[4], a[5] + factor * b[5],
    )  # fmt: skip


@stage
def aerodynamics(t, y, b, m, w):
    """Aerodynamic force and moment about the centre of mass of body b, body axes, N and N m."""
    keep_apart()
    p = body_params(b)
    speed, alpha, beta = air_angles(air_velocity(t, y, b, m, w))
    density, sound = air_at(height(t, y, b, m, w), b, m, w)
    force_c, moment_c = _coefficients(y, b, speed / sound, alpha, beta, m, w)
    qs = 0.5 * (w[at.DENSITY_FACTOR] * density) * speed * speed * w[p + at.AREA]
    force = aero_force(qs * w[p + at.FORCE_FACTOR], force_c)
    moment = aero_moment(qs * w[p + at.LENGTH] * w[p + at.MOMENT_FACTOR], moment_c)
    if not math.isnan(w[p + at.MOMENT_POINT]):  # coefficients about a fixed point: carry them to the centre of mass
        cg, point = vec3.get(w, p + at.CG), vec3.get(w, p + at.MOMENT_POINT)
        arm = (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])
        moment = vec3.add(moment, vec3.cross(arm, force))
    return force, moment


@stage
def thrust(t, i, m, w):
    """Thrust of motor i, N, in the stretch of time for which `flight.set_stretch` prepared it."""
    p, work = motor_params(i, m), motor_work(i, m)
    since = t - (w[p + at.IGNITION] + w[p + at.IGNITION_DELAY])
    if w[work + at.BURNING] == at.TAILING:
        burn = w[p + at.BURN]
        return thrust_level(w[p + at.THRUST], w[p + at.BUILD_UP], burn) * w[work + at.LEVEL] * tail_off(since - burn, w[p + at.TAIL_OFF])
    return thrust_level(w[p + at.THRUST], w[p + at.BUILD_UP], since) * (w[work + at.LEVEL] + w[work + at.SLOPE] * since)


@stage
def _body_load(t, y, b, m, w):
    """Force and moment about the centre of mass of body b from air, motors and loads fixed to it, body axes."""
    keep_apart()
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if m.scene.atmosphere != at.NO_ATMOSPHERE and w[body_params(b) + at.AREA] > 0.0:
        force, moment = aerodynamics(t, y, b, m, w)
    for i in range(m.scene.n_motors):
        work = motor_work(i, m)
        if m.table[m.scene.motor_body_i + i] == b and w[work + at.BURNING] != at.OFF:
            level = thrust(t, i, m, w)
            force = vec3.add(force, vec3.scale(level, vec3.get(w, work + at.THRUST_LINE)))
            moment = vec3.add(moment, vec3.scale(level, vec3.get(w, work + at.THRUST_MOMENT)))
    for i in range(m.scene.n_loads):
        p, work = load_params(i, m), load_work(i, m)
        if m.table[m.scene.load_i + 2 * i] == b and w[work + at.ACTS] != 0.0:
            push_in, turn = vec3.get(w, p + at.LOAD_FORCE), vec3.get(w, p + at.LOAD_MOMENT)
            if m.table[m.scene.load_i + 2 * i + 1] == at.GROUND_FRAME:
                r = attitude(b, m, w)
                push_in, turn = vec3.unrotate(r, push_in), vec3.unrotate(r, turn)
            force = vec3.add(force, push_in)
            moment = vec3.add(moment, vec3.add(turn, vec3.cross(vec3.get(w, work + at.ARM), push_in)))
    return force, moment


@stage
def set_loads(t, y, m, w):
    """External loads of every body: force in ground axes; moment less w x J w in body axes. Needs attitudes."""
    keep_apart()
    for b in range(m.scene.n_bodies):
        work = body_work(b, m)
        if b == m.scene.ground:
            vec3.put(w, work + at.LOAD, (0.0, 0.0, 0.0))
            vec3.put(w, work + at.LOAD + 3, (0.0, 0.0, 0.0))
            continue
        force, moment = _body_load(t, y, b, m, w)
        omega = vec3.get(y, b * at.STATE + at.RATE)
        moment = vec3.sub(moment, vec3.cross(omega, vec3.rotate(vec3.get_matrix(w, work + at.TENSOR), omega)))
        vec3.put(w, work + at.LOAD, vec3.rotate(attitude(b, m, w), force))
        vec3.put(w, work + at.LOAD + 3, moment)
        w[work + at.LOAD + 1] -= w[body_params(b) + at.MASS] * gravity(m.scene.gravity, w[at.SURFACE_GRAVITY], height(t, y, b, m, w))
    push(y, m, w)


@stage
def guide_wrench(j, m, w):
    """Force and moment of joint j on its second body, in the joint's axes."""
    ax, ay, az, _, _ = joint_axes(j, m, w)
    force, moment = vec3.get(w, joint_work(j, m) + at.FORCE_B), vec3.get(w, joint_work(j, m) + at.MOMENT_B)
    return (
        (vec3.dot(force, ax), vec3.dot(force, ay), vec3.dot(force, az)),
        (vec3.dot(moment, ax), vec3.dot(moment, ay), vec3.dot(moment, az)),
    )


@stage
def guide_bearing(y, j, m, w):
    """What the pins of joint j carry: forces at mouth and tip (y, z), torsion, and the sum of all pin loads, N and N m."""
    keep_apart()
    p = joint_params(j, m)
    engaged = max(w[p + at.ENGAGED] - separation(y, j, m, w)[0], at.LEAST_ENGAGED * w[p + at.ENGAGED])
    force, moment = guide_wrench(j, m, w)
    mouth, tip = guides.bearing_forces(force, moment, engaged, m.numbers[joint_axes_x(j) + 9])
    total = guides.total_load(mouth, tip, moment[0], m.table[m.scene.pins_i + j], w[p + at.CIRCLE], w[p + at.PIN_CLOCK])
    return mouth, tip, moment[0], total


@stage
def _rub(y, j, force, m, w):
    """Add a friction force, N, on B along the direction of separation of joint j to the loads."""
    rho_a, rho_b, omega_a, omega_b, d, d_rate = joint_geometry(y, j, m, w)
    e = vec3.scale(m.numbers[joint_axes_x(j) + 9], joint_axes(j, m, w)[0])
    arm_a, arm_b, _ = joints.translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b)
    load_pair(first_body(j, m), second_body(j, m), force, e, arm_a, arm_b, m, w)


@stage
def slides(j, m, w):
    """Whether joint j is free along x but holds sideways and against tilting: its pins are engaged and can rub."""
    kind = kind_rows(kind_of(j, m, w), m)
    sideways, turning, along = 0, 0, False
    for k in range(m.table[kind]):
        code = m.table[kind + 1 + k]
        along = along or code == 0
        sideways += 1 if code in (1, 2) else 0
        turning += 1 if at.ROTATION <= code < at.ROD else 0
    return sideways == 2 and turning >= 2 and not along


@stage
def _next_friction(trial, size, off, work, w):
    """Size of a friction force to try after one that is ``off`` by so much: false position within a bracket; until there is one, the
    secant of the last two, which were both too little."""
    if off < 0.0:
        w[work + at.TOO_MUCH], w[work + at.MUCH_OFF] = size, off
    else:
        last, last_off = w[work + at.TOO_LITTLE], w[work + at.LITTLE_OFF]
        w[work + at.TOO_LITTLE], w[work + at.LITTLE_OFF] = size, off
        if math.isinf(w[work + at.TOO_MUCH]):
            if trial == 0:  # a small probe: further out there can be a second balance, with the pins pressed the other way
                return 1e-3 * off
            slope = (off - last_off) / (size - last)
            return size - off / slope if slope < 0.0 else size + 2.0 * off
    low, high = w[work + at.TOO_LITTLE], w[work + at.TOO_MUCH]
    if trial % 3 == 2:
        return 0.5 * (low + high)
    return low + (high - low) * w[work + at.LITTLE_OFF] / (w[work + at.LITTLE_OFF] - w[work + at.MUCH_OFF])


@stage
def _size(w, k, length):
    """Size of a force, and of the moment behind it over a length, N."""
    force, moment = vec3.get(w, k), vec3.get(w, k + 3)
    return math.sqrt(vec3.dot(force, force)) + math.sqrt(vec3.dot(moment, moment)) / length


@stage
def _size_of_loads(length, m, w):
    """Sum of the sizes of all loads and joint forces, N, moments over a length, m."""
    keep_apart()
    total = 0.0
    for b in range(m.scene.n_bodies):
        total += _size(w, body_work(b, m) + at.LOAD, length)
    for j in range(m.scene.n_joints):
        total += _size(w, joint_work(j, m) + at.FORCE_B, length)
    return total


@stage
def _solve_with_friction(y, m, w):
    """Accelerations with guide friction. Friction follows from the joint wrench and the wrench from friction: both, by trial.

    Returns the smallest pivot, or -1 where a guide jams: no friction is in balance with what it causes.
    """
    keep_apart()
    pivot = 0.0
    for j in range(m.scene.n_joints):
        work = joint_work(j, m)
        w[work + at.FRICTION_FORCE], w[work + at.TOO_LITTLE], w[work + at.TOO_MUCH] = 0.0, 0.0, math.inf
    for trial in range(_FRICTION_ROUNDS):
        pivot = solve_motion(y, m, w)
        settled = True
        for j in range(m.scene.n_joints):
            p, work = joint_params(j, m), joint_work(j, m)
            if not (w[p + at.FRICTION] > 0.0 and slides(j, m, w)):
                continue
            total, speed = guide_bearing(y, j, m, w)[3], separation(y, j, m, w)[1]
            wanted = guides.friction_force(w[p + at.FRICTION], total, speed, w[p + at.SLIP_SPEED])
            now = w[work + at.FRICTION_FORCE]
            off = abs(wanted) - abs(now)
            if abs(off) <= _FRICTION * max(abs(now), _size_of_loads(w[p + at.ENGAGED], m, w)):
                continue
            settled = False
            force = math.copysign(_next_friction(trial, abs(now), off, work, w), wanted)
            w[work + at.FRICTION_FORCE] = force
            _rub(y, j, force - now, m, w)
        if settled:
            return pivot
    w[m.scene.work + at.JAMMED] = 1.0
    return -1.0


@stage
def motion(t, y, m, w):
    """Accelerations and joint wrenches at a state, left in w. Returns the smallest pivot."""
    keep_apart()
    set_attitudes(y, m, w)
    set_loads(t, y, m, w)
    if m.scene.friction != 0:
        pivot = _solve_with_friction(y, m, w)
        if pivot >= 0.0:
            return pivot
        set_loads(t, y, m, w)  # go on without friction: the case ends as jammed
    return solve_motion(y, m, w)


@stage
def mean_velocity(y, m, w):
    """Velocity of the mass centre of all bodies, m/s; zero where there is a ground, which can take momentum."""
    total, mass = (0.0, 0.0, 0.0), 0.0
    if m.scene.ground >= 0:
        return total
    for b in range(m.scene.n_bodies):
        each = w[body_params(b) + at.MASS]
        total, mass = vec3.add(total, vec3.scale(each, vec3.get(y, b * at.STATE + at.VELOCITY))), mass + each
    return vec3.scale(1.0 / mass, total)


@stage
def power(y, m, w):
    """Power of all loads about the mass centre of all bodies, W: the rate of `kinetic_energy` if joints do no work.

    About the mass centre, because a common fall or drag would hide what is lost of the motion apart.
    """
    total, mean = 0.0, mean_velocity(y, m, w)
    for b in range(m.scene.n_bodies):
        if b != m.scene.ground:
            k, work = b * at.STATE, body_work(b, m)
            total += vec3.dot(vec3.get(w, work + at.LOAD), vec3.sub(vec3.get(y, k + at.VELOCITY), mean))
            total += vec3.dot(vec3.get(w, work + at.LOAD + 3), vec3.get(y, k + at.RATE))
    return total


@stage
def kinetic_energy(y, m, w):
    """Kinetic energy of all bodies about their mass centre, J."""
    total, mean = 0.0, mean_velocity(y, m, w)
    for b in range(m.scene.n_bodies):
        if b != m.scene.ground:
            v, omega = vec3.sub(vec3.get(y, b * at.STATE + at.VELOCITY), mean), vec3.get(y, b * at.STATE + at.RATE)
            momentum = vec3.rotate(vec3.get_matrix(w, body_work(b, m) + at.TENSOR), omega)
            total += 0.5 * (w[body_params(b) + at.MASS] * vec3.dot(v, v) + vec3.dot(omega, momentum))
    return total


@stage
def rest_energy(y, m, w):
    """Kinetic energy about the mass centre, J, below which the bodies count as at rest: all of them at 0.1 mm/s, or at 1e-4 of their
    speed in the frame of the moving origin, of which round-off is a share."""
    total = 0.0
    for b in range(m.scene.n_bodies):
        if b != m.scene.ground:
            v = vec3.get(y, b * at.STATE + at.VELOCITY)
            total += 0.5e-8 * w[body_params(b) + at.MASS] * (1.0 + vec3.dot(v, v))
    return total


@stage
def derivative(t, y, out, m, w):
    """dy/dt into ``out``. Returns the smallest pivot of the constraint solve."""
    keep_apart()
    pivot = motion(t, y, m, w)
    for b in range(m.scene.n_bodies):
        k, work = b * at.STATE, body_work(b, m)
        q = k + at.QUATERNION
        vec3.put(out, k + at.POSITION, vec3.get(y, k + at.VELOCITY))
        vec3.put(out, k + at.VELOCITY, vec3.get(w, work + at.ACCEL))
        vec3.put(out, k + at.RATE, vec3.get(w, work + at.ACCEL + 3))
        out[q], out[q + 1], out[q + 2], out[q + 3] = quat.rate((y[q], y[q + 1], y[q + 2], y[q + 3]), vec3.get(y, k + at.RATE))
    out[m.scene.n_bodies * at.STATE] = power(y, m, w)
    return pivot
