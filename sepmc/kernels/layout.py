"""Where the numbers of a case stand in its parameter vector, and the codes of what a scene contains. No numba here."""

from typing import Any, NamedTuple

# Fixed head.
SURFACE_GRAVITY, WIND_SPEED, WIND_DIRECTION = 0, 1, 2
ALTITUDE, SPEED, OMEGA, ALPHA, PITCH, YAW, ROLL, PATH_YAW, PATH_REFERENCE, END_TIME = 3, 4, 5, 8, 9, 10, 11, 12, 13, 14
HEAD = 15
# Offsets in a body's block.
MASS, INERTIA, PRODUCTS, INERTIA_FACTOR, CG = 0, 1, 4, 7, 8
AREA, LENGTH, FORCE_FACTOR, MOMENT_FACTOR, MOMENT_POINT = 11, 12, 13, 14, 15
BODY_SIZE = 18
# Offsets in a motor's block.
THRUST, BUILD_UP, IGNITION, BURN, STATION, RADIUS, CANT, CLOCK, OFFSET, DEFLECTION, DEFLECTION_CLOCK = 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11
MOTOR_SIZE = 12
JOINT_SIZE = 3  # the joint point
UNTIL_TIME, UNTIL_STROKE = 0, 1
PHASE_SIZE = 2

NO_ATMOSPHERE, US1976 = 0, 1
NO_GRAVITY, CONSTANT_GRAVITY, INVERSE_SQUARE = 0, 1, 2
REDUCED, FULL = 0, 1
AXIAL, NORMAL, SIDE, ROLLING, YAWING, PITCHING = 0, 1, 2, 3, 4, 5

STATE = 13  # per body: position 3, velocity 3, quaternion 4, angular rate 3
POSITION, VELOCITY, QUATERNION, RATE = 0, 3, 6, 10

BODY_OUTCOMES, JOINT_OUTCOMES, AUDIT = 9, 3, 4
STATE_COLUMNS = 7  # per body in a full history: position, velocity, axial acceleration
WRENCH_COLUMNS = 15  # per joint in a full history: force and moment on both bodies, gap


# Scratch of a case, behind its parameters in one array `w`. Fixed head, then blocks per body, motor, joint, constraint row.
ORIGIN, ORIGIN_VELOCITY, AIR, LEFT_AIR = 0, 3, 6, 9  # the last: set once a height was outside the atmosphere
WORK_HEAD = 10
# per body: inertia, its inverse, attitude (9 each); load: force in ground axes, moment less w x J w in body axes; acceleration:
# linear in ground axes, angular in body axes
TENSOR, INVERSE, ATTITUDE, LOAD, ACCEL = 0, 9, 18, 27, 33
BODY_WORK = 39
# per motor: unit thrust, its moment about the centre of mass (body axes), and whether it burns in this stretch of time
THRUST_LINE, THRUST_MOMENT, BURNING = 0, 3, 6
MOTOR_WORK = 7
# per joint: lever arms on A and B (body axes), joint axes carried by B (body axes), gap and its rate, force and moment on B at
# r_B and on A at r_A (ground axes)
RHO_A, RHO_B, AXES_B, GAP, GAP_RATE, FORCE_B, MOMENT_B, FORCE_A, MOMENT_A = 0, 3, 6, 15, 18, 21, 24, 27, 30
JOINT_WORK = 33
# per constraint row: direction e or 0, lever arms on A and B (body axes), n or 0 (ground axes), right-hand side, joint
ROW_E, ROW_A, ROW_B, ROW_N, ROW_GAMMA, ROW_JOINT = 0, 3, 6, 9, 12, 13
ROW_WORK = 14


class Model(NamedTuple):
    """What a scene contains, as a kernel reads it. The numbers of a case stand in ``w``: parameters first, then scratch.

    ``*_p`` are starts of parameter blocks in w, ``*_w`` of scratch blocks in w, ``*_i`` of integer tables in ``table``:
    motor_body (motors,), joint_bodies (joints, 2), phase_rows (phases, joints, 6) with 1 at constrained axes (translations
    x y z, rotations x y z), all_axes (joints, 6) of ones, phase_event (phases,) the joint whose stroke ends the phase or -1,
    terms (terms, 4) of body, coefficient, power of alpha, power of beta. ``numbers``: per joint its axes (9) and the sign
    that makes its separation positive apart.
    """

    n_bodies: int
    n_motors: int
    n_joints: int
    n_phases: int
    n_terms: int
    atmosphere: int
    gravity: int
    formulation: int
    motors_p: int
    joints_p: int
    phases_p: int
    terms_p: int
    work: int
    motors_w: int
    joints_w: int
    rows_w: int
    matrix_w: int
    rhs_w: int
    size_w: int
    motor_body_i: int
    joint_bodies_i: int
    phase_rows_i: int
    all_axes_i: int
    phase_event_i: int
    terms_i: int
    table: Any
    numbers: Any


class Tableau(NamedTuple):
    """A Runge-Kutta method (see methods.py) and the steps it takes."""

    a: Any
    b: Any
    c: Any
    dense: Any
    step: float
    history_step: float
