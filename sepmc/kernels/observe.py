"""What is reported of a state: outcomes, and rows of histories (order of schema.py)."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import quat, vec3
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.aerodynamics import air_angles
from sepmc.kernels.cfe import attitude, separation
from sepmc.kernels.dynamics import air_velocity, motion, set_attitudes
from sepmc.kernels.lanes import nearest_turn
from sepmc.kernels.places import body_work, first_body, joint_work


@stage
def reported_bodies(m):
    """Number of bodies that have outcomes: all but the ground, which comes last."""
    return m.scene.n_bodies - (1 if m.scene.ground >= 0 else 0)


@stage
def joint_outcomes_at(j, m):
    """Start of the outcomes of joint j: speed, distance, release time."""
    return reported_bodies(m) * at.BODY_OUTCOMES + j * at.JOINT_OUTCOMES


@stage
def body_angles(b, m, w):
    """Pitch, yaw, roll of body b, rad; pitch and roll go on from their last values, beyond half a turn too. Needs attitudes."""
    pitch, yaw, roll = quat.angles(attitude(b, m, w))
    work = body_work(b, m)
    return nearest_turn(pitch, w[work + at.LAST_PITCH]), yaw, nearest_turn(roll, w[work + at.LAST_ROLL])


@stage
def follow_angles(y, h, m, w):
    """Let pitch and roll follow the motion at the end of a step of length h. Needs attitudes.

    Returns whether one of them cannot be followed (near yaw = +-90 deg, where they are singular, or where one changes or the body
    turns by more than a quarter in the step), and the largest angle by which a body turned in the step, rad.
    """
    keep_apart()
    lost, largest = False, 0.0
    for b in range(reported_bodies(m)):
        pitch, yaw, roll = body_angles(b, m, w)
        work, omega = body_work(b, m), vec3.get(y, b * at.STATE + at.RATE)
        turned = math.sqrt(vec3.dot(omega, omega)) * h
        change = max(abs(pitch - w[work + at.LAST_PITCH]), abs(roll - w[work + at.LAST_ROLL]), turned)
        lost = lost or abs(yaw) > SINGULAR_YAW or change > 0.5 * math.pi
        largest = max(largest, turned)
        w[work + at.LAST_PITCH], w[work + at.LAST_ROLL] = pitch, roll
    return lost, largest


SINGULAR_YAW = math.radians(89.0)
SINE_SINGULAR = math.sin(SINGULAR_YAW)


@stage
def body_outcomes(t, y, b, out, k, m, w):
    """alpha, beta, alpha_ref, omega x y z, roll, yaw, pitch of body b from out[k] on, rad and rad/s. Needs attitudes."""
    keep_apart()
    _, alpha, beta = air_angles(air_velocity(t, y, b, m, w))
    pitch, yaw, roll = body_angles(b, m, w)
    vec3.put(out, k, (alpha, beta, pitch - w[at.PATH_REFERENCE]))
    vec3.put(out, k + 3, vec3.get(y, b * at.STATE + at.RATE))
    vec3.put(out, k + 6, (roll, yaw, pitch))


@stage
def report(t, y, outcomes, m, w):
    """Outcomes of a state: of every body, and speed and distance of every joint."""
    set_attitudes(y, m, w)
    for b in range(reported_bodies(m)):
        body_outcomes(t, y, b, outcomes, b * at.BODY_OUTCOMES, m, w)
    for j in range(m.scene.n_joints):
        distance, speed = separation(y, j, m, w)
        outcomes[joint_outcomes_at(j, m)], outcomes[joint_outcomes_at(j, m) + 1] = speed, distance


@stage
def separation_row(y, row, m, w):
    """Speed and distance of every joint into ``row``."""
    keep_apart()
    set_attitudes(y, m, w)
    for j in range(m.scene.n_joints):
        distance, speed = separation(y, j, m, w)
        row[2 * j] = speed
        row[2 * j + 1] = distance


@stage
def full_row(t, y, row, m, w):
    """Everything of a state into ``row``: outcomes, separation, ground motion, joint wrenches on both bodies, gap."""
    keep_apart()
    motion(t, y, m, w)
    k = 0
    for b in range(reported_bodies(m)):
        body_outcomes(t, y, b, row, k, m, w)
        k += at.BODY_OUTCOMES
    for j in range(m.scene.n_joints):
        distance, speed = separation(y, j, m, w)
        row[k], row[k + 1] = speed, distance
        k += 2
    origin, velocity = vec3.get(w, m.scene.work + at.ORIGIN), vec3.get(w, m.scene.work + at.ORIGIN_VELOCITY)
    for b in range(reported_bodies(m)):
        s = b * at.STATE
        vec3.put(row, k, vec3.add(vec3.get(y, s + at.POSITION), vec3.add(origin, vec3.scale(t, velocity))))
        vec3.put(row, k + 3, vec3.add(vec3.get(y, s + at.VELOCITY), velocity))
        row[k + 6] = vec3.unrotate(attitude(b, m, w), vec3.get(w, body_work(b, m) + at.ACCEL))[0]
        k += at.STATE_COLUMNS
    for j in range(m.scene.n_joints):
        ra, work = attitude(first_body(j, m), m, w), joint_work(j, m)
        order = (at.FORCE_A, at.MOMENT_A, at.FORCE_B, at.MOMENT_B, at.GAP)
        for i in range(5):
            vec3.put(row, k + 3 * i, vec3.unrotate(ra, vec3.get(w, work + order[i])))
        k += at.WRENCH_COLUMNS
