"""Where things stand in the array ``w`` of a case: starts of the blocks of a body, motor, joint, ... or constraint row."""

from sepmc.kernels import layout as at
from sepmc.kernels._jit import formula


@formula
def body_params(b):
    return at.HEAD + at.BODY_SIZE * b


@formula
def motor_params(i, m):
    return m.scene.motors_p + at.MOTOR_SIZE * i


@formula
def joint_params(j, m):
    return m.scene.joints_p + at.JOINT_SIZE * j


@formula
def spring_params(i, m):
    return m.scene.springs_p + at.SPRING_SIZE * i


@formula
def load_params(i, m):
    return m.scene.loads_p + at.LOAD_SIZE * i


@formula
def body_work(b, m):
    return m.scene.work + at.WORK_HEAD + at.BODY_WORK * b


@formula
def motor_work(i, m):
    return m.scene.motors_w + at.MOTOR_WORK * i


@formula
def joint_work(j, m):
    return m.scene.joints_w + at.JOINT_WORK * j


@formula
def spring_work(i, m):
    return m.scene.springs_w + at.SPRING_WORK * i


@formula
def load_work(i, m):
    return m.scene.loads_w + at.LOAD_WORK * i


@formula
def leaf_work(i, m):
    return m.scene.leaves_w + at.LEAF_WORK * i


@formula
def row_work(r, m):
    return m.scene.rows_w + at.ROW_WORK * r


@formula
def leaf(i, m):
    """Start of a condition in m.table: what, of which, event, place of its threshold in w."""
    return m.scene.leaves_i + at.LEAF_SIZE * i


@formula
def first_body(j, m):
    return m.table[m.scene.joint_bodies_i + 2 * j]


@formula
def second_body(j, m):
    return m.table[m.scene.joint_bodies_i + 2 * j + 1]


@formula
def kind_of(j, m, w):
    """Kind of joint j now."""
    return int(w[joint_work(j, m) + at.KIND])


@formula
def kind_rows(kind, m):
    """Start of a kind in m.table: number of rows, then their codes."""
    return m.scene.kinds_i + at.KIND_SIZE * kind


@formula
def joint_axes_x(j):
    """Start of the axes of joint j in m.numbers, ten numbers a joint."""
    return 10 * j
