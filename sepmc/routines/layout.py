"""Where the numbers of a case stand in its parameter vector, and the codes of what a scene
contains. No numba here."""

from typing import Any, NamedTuple

import numpy as np

LANES = 8  # cases side by side in compiled code

# Fixed head.
SURFACE_GRAVITY, WIND_SPEED, WIND_DIRECTION = 0, 1, 2
ALTITUDE, SPEED, OMEGA, ALPHA, PITCH, YAW, ROLL, PATH_YAW, PATH_REFERENCE, END_TIME = (
    3,
    4,
    5,
    8,
    9,
    10,
    11,
    12,
    13,
    14,
)
DENSITY_FACTOR = 15
HEAD = 16
# Offsets in a body's block.
MASS, INERTIA, PRODUCTS, INERTIA_FACTOR, CG = 0, 1, 4, 7, 8
AREA, LENGTH, FORCE_FACTOR, MOMENT_FACTOR, MOMENT_POINT = 11, 12, 13, 14, 15
BODY_SIZE = 18
# Offsets in a motor's block.
(
    THRUST,
    BUILD_UP,
    IGNITION,
    BURN,
    STATION,
    RADIUS,
    CANT,
    CLOCK,
    OFFSET,
    DEFLECTION,
    DEFLECTION_CLOCK,
) = 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11
IGNITION_DELAY, TAIL_OFF = 12, 13
MOTOR_SIZE = 14
# Offsets in a joint's block: its point on A and on B (not finite: the same), and what its releases
# and its pins are like.
POINT, SECOND_POINT, DELAY, FAILS, CIRCLE, PIN_CLOCK, ENGAGED, FRICTION, SLIP_SPEED = (
    0,
    3,
    6,
    7,
    8,
    9,
    10,
    11,
    12,
)
SWING = 13  # rate across it at the start
JOINT_SIZE = 16
MIN_ENGAGED = 0.01  # of the engaged length of pins when closed: they are never counted shorter
# Offsets in a spring's block; its points as those of a joint.
SPRING_FORCE, STIFFNESS, DAMPING, STROKE, SPRING_FACTOR = 6, 7, 8, 9, 10
SPRING_SIZE = 11
# Offsets in a constant load's block.
LOAD_FORCE, LOAD_MOMENT, LOAD_POINT, LOAD_START, LOAD_END = 0, 3, 6, 9, 10
LOAD_SIZE = 11

GRAIN = 1e-12  # s: two times closer than this are one

AXIAL, NORMAL, SIDE, ROLLING, YAWING, PITCHING = 0, 1, 2, 3, 4, 5
TRANSIENT = 30.0  # time constants after which a thrust has built up or tailed off, to 1e-13
BRIEF = 0.05  # of a flight: a step ends with a transient that is shorter
NO_HISTORY, SEPARATION_HISTORY, FULL_HISTORY = 0, 1, 2
AT_POINT = 3  # numbers of a curve at a point of a step: value, rate, acceleration

# Codes of constraint rows: translation along axis k is k; "axis i of B stays perpendicular to axis
# k of A" is ROTATION + 3 i + k.
ROTATION, ROD = 3, 12
# Conditions: what is compared with a threshold.
BAUMGARTE_RATE = 10.0  # 1/s: rate at which a drifted constraint is pulled back, critically damped
(
    AT_TIME,
    AT_BURN_OUT,
    AT_STROKE,
    AT_DISTANCE,
    AT_ANGLE,
    AT_FORCE,
    AT_MOMENT,
    AT_ALTITUDE,
    AT_SPRING_STROKE,
) = 0, 1, 2, 3, 4, 5, 6, 7, 8
AT_LAYER_TOP, AT_LAYER_BASE = 9, 10
AT_VERTICAL_SPEED = 11
BODY_OUTCOMES, JOINT_OUTCOMES = 9, 3
FLOW_ANGLES = 2  # the first outcomes of a body: of no value in still air
LOADS_OUTCOMES, CLEARANCE_OUTCOMES = 6, 6
# of a part of an outline in ``numbers``: hollow, layout point of its start, length aft, radius at
# both ends
PART_SIZE = 7
# Status of a case that a kernel rejects because its steps are too long; other rejected cases have
# the code of the variant (`sepmc.kernel.spec.variant`) that may integrate them.
FINER_STEPS = -1

# What a stretch of time between switches knows of loads stands behind the parameters of a case. Per
# motor: whether it burns or tails off, and the line its profile follows.
BURNING, LEVEL, SLOPE = 0, 1, 2
MOTOR_WORK = 3
OFF, ON, TAILING = 0.0, 1.0, 2.0
# Per constant load: whether it acts.
ACTS = 0
LOAD_WORK = 1


# Numbers that say where two bodies are: place of one seen from the other, attitudes of both.
PATH = 11
# Of a search for their least distance: places of a step at which their relative motion is looked
# at, and numbers of a pose, one body seen from the other; halvings of the step, one within the
# other, at most, and numbers of a node, a time within it.
POSES, POSE = 5, 12
DEPTH, NODE = 56, 15
# One behind the other: the step's start and length, powers of the path, start and number of the
# parts of both outlines, mass centres, what is found, whether the search came to an end, poses and
# nodes, and the path over the step.
JOB_TIME, JOB_LENGTH, JOB_POWERS, JOB_PARTS, JOB_CENTRES, JOB_RESULT, JOB_DONE = (
    0,
    1,
    2,
    3,
    7,
    13,
    19,
)
JOB_POSES = 20
JOB_NODES = JOB_POSES + POSES * POSE
JOB_PATH = JOB_NODES + (DEPTH + 2) * NODE
# What a lane holds of a pack of splines that it looks up, a cell: low and high end and what
# distances count from, for each axis; basis functions there, as in the pack; coefficients, the
# functions side by side.
CELL_ENDS, CELL_BASIS, CELL_COEFFICIENTS = 0, 9, 57
# of a step, for loads: a polynomial of degree seven, the order of the continuous extension of
# dop853
PEAK_NODES = 8
# scratch numbers of `peaks.update_size`: coefficients of three components, sizes at the nodes
PEAK_SCRATCH = 4 * PEAK_NODES

# What a scene contains and where its blocks start: whole numbers that a kernel reads through one
# pointer (as arguments they would be copied at every call).
STRUCTURE = np.dtype(
    (
        np.record,
        [
            (name, np.int64)
            for name in """
    ground n_motors n_loads n_terms n_proximity pivot_joint motors_p joints_p springs_p
    loads_p leaves_p proximity_p terms_p work motors_w loads_w size_w profile_i
    aero_table_i proximity_i parts_i springs_x air_x wind_x
""".split()
        ],
    )
)


class Model(NamedTuple):
    """What a scene contains, as a kernel reads it. The numbers of a case stand in ``w``: parameters
    first, then what stretches know.

    ``scene`` (STRUCTURE): numbers of things, and starts: ``*_p`` of parameter blocks in w, ``*_w``
    of blocks of stretches in w, ``*_i`` of integer tables in ``table``, ``*_x`` of numbers that all
    cases share in ``numbers``.

    Integer tables: profile (motors, 2) start in ``numbers`` and rows; aero_table (bodies,) start in
    ``numbers`` or -1; proximity (n,) start in ``numbers``; parts (bodies, 2) start in ``numbers``
    and their number.

    ``numbers``: per joint its axes (9) and the sign that makes its separation positive apart; per
        spring its axis or 0; tables.
    """

    scene: Any
    table: Any
    numbers: Any
