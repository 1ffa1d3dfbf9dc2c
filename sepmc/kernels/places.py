"""Where things stand in the array ``w`` of a case: starts of the blocks of a body, motor, joint or constraint row."""

from sepmc.kernels._jit import formula
from sepmc.kernels.layout import (
    BODY_SIZE,
    BODY_WORK,
    HEAD,
    JOINT_SIZE,
    JOINT_WORK,
    MOTOR_SIZE,
    MOTOR_WORK,
    PHASE_SIZE,
    ROW_WORK,
    WORK_HEAD,
)


@formula
def body_params(b):
    return HEAD + BODY_SIZE * b


@formula
def motor_params(i, m):
    return m.motors_p + MOTOR_SIZE * i


@formula
def joint_params(j, m):
    return m.joints_p + JOINT_SIZE * j


@formula
def phase_params(p, m):
    return m.phases_p + PHASE_SIZE * p


@formula
def body_work(b, m):
    return m.work + WORK_HEAD + BODY_WORK * b


@formula
def motor_work(i, m):
    return m.motors_w + MOTOR_WORK * i


@formula
def joint_work(j, m):
    return m.joints_w + JOINT_WORK * j


@formula
def row_work(r, m):
    return m.rows_w + ROW_WORK * r


@formula
def first_body(j, m):
    return m.table[m.joint_bodies_i + 2 * j]


@formula
def second_body(j, m):
    return m.table[m.joint_bodies_i + 2 * j + 1]


@formula
def phase_rows(phase, m):
    """Start in m.table of the constrained axes of a phase: 6 flags a joint."""
    return m.phase_rows_i + 6 * m.n_joints * phase
