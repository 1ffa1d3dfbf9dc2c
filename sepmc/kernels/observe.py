"""What is reported of a state: outcomes, separation, joint residuals, and full rows of a history (order of schema.py)."""

from sepmc.kernels import joints, quat, vec3
from sepmc.kernels import layout as at
from sepmc.kernels._jit import stage
from sepmc.kernels.aerodynamics import air_angles
from sepmc.kernels.cfe import attitude, joint_axes, joint_geometry
from sepmc.kernels.dynamics import air_velocity, motion, set_attitudes
from sepmc.kernels.places import body_work, first_body, joint_work


@stage
def separation(y, j, m, w):
    """Separation distance of joint j along its x axis, positive apart, m, and its time derivative, m/s. Needs attitudes."""
    _, _, omega_a, _, d, d_rate = joint_geometry(y, j, m, w)
    e = vec3.rotate(attitude(first_body(j, m), m, w), vec3.get(m.numbers, 10 * j))
    sign = m.numbers[10 * j + 9]
    return sign * vec3.dot(d, e), sign * (vec3.dot(d_rate, e) + vec3.dot(d, vec3.cross(omega_a, e)))


@stage
def body_outcomes(y, b, out, k, m, w):
    """alpha, beta, alpha_ref, omega x y z, roll, yaw, pitch of body b from out[k] on, rad and rad/s. Needs attitudes."""
    _, alpha, beta = air_angles(air_velocity(y, b, m, w))
    pitch, yaw, roll = quat.angles(attitude(b, m, w))
    vec3.put(out, k, (alpha, beta, pitch - w[at.PATH_REFERENCE]))
    vec3.put(out, k + 3, vec3.get(y, b * at.STATE + at.RATE))
    vec3.put(out, k + 6, (roll, yaw, pitch))


@stage
def joint_residual(y, wanted, m, w):
    """Largest violation of the constraints flagged from m.table[wanted] on: translations, m, rotations, rad. Needs attitudes."""
    gap, angle = 0.0, 0.0
    for j in range(m.n_joints):
        _, _, _, _, d, _ = joint_geometry(y, j, m, w)
        ax, ay, az, bx, by = joint_axes(j, m, w)
        for k in range(3):
            e = ax if k == 0 else (ay if k == 1 else az)
            if m.table[wanted + 6 * j + k] != 0:
                gap = max(gap, abs(vec3.dot(d, e)))
            if m.table[wanted + 6 * j + 3 + k] != 0:
                va, vb = joints.rotation_pair(k, ax, ay, az, bx, by)
                angle = max(angle, abs(vec3.dot(va, vb)))
    return gap, angle


@stage
def separation_row(y, row, m, w):
    """Speed and distance of every joint into ``row``."""
    set_attitudes(y, m, w)
    for j in range(m.n_joints):
        distance, speed = separation(y, j, m, w)
        row[2 * j] = speed
        row[2 * j + 1] = distance


@stage
def full_row(t, y, phase, row, m, w):
    """Everything of a state into ``row``: outcomes, separation, ground motion, joint wrenches on both bodies, gap."""
    motion(t, y, phase, m, w)
    k = 0
    for b in range(m.n_bodies):
        body_outcomes(y, b, row, k, m, w)
        k += at.BODY_OUTCOMES
    for j in range(m.n_joints):
        distance, speed = separation(y, j, m, w)
        row[k], row[k + 1] = speed, distance
        k += 2
    origin, velocity = vec3.get(w, m.work + at.ORIGIN), vec3.get(w, m.work + at.ORIGIN_VELOCITY)
    for b in range(m.n_bodies):
        s = b * at.STATE
        vec3.put(row, k, vec3.add(vec3.get(y, s + at.POSITION), vec3.add(origin, vec3.scale(t, velocity))))
        vec3.put(row, k + 3, vec3.add(vec3.get(y, s + at.VELOCITY), velocity))
        row[k + 6] = vec3.unrotate(attitude(b, m, w), vec3.get(w, body_work(b, m) + at.ACCEL))[0]
        k += at.STATE_COLUMNS
    for j in range(m.n_joints):
        ra, work = attitude(first_body(j, m), m, w), joint_work(j, m)
        order = (at.FORCE_A, at.MOMENT_A, at.FORCE_B, at.MOMENT_B, at.GAP)
        for i in range(5):
            vec3.put(row, k + 3 * i, vec3.unrotate(ra, vec3.get(w, work + order[i])))
        k += at.WRENCH_COLUMNS
