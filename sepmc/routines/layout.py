"""Layout of the numbers of a case: offsets in its parameter vector and in the data of routines; and
codes of the kinds of elements in a scene. This module imports no compiler."""

from typing import Any, NamedTuple

import numpy as np

LANES = 8  # cases side by side in compiled code

# Head, at fixed positions.
SURFACE_GRAVITY, WIND_SPEED, WIND_DIRECTION = 0, 1, 2
(
    ALTITUDE, SPEED, OMEGA, ALPHA, PITCH, YAW, ROLL, PATH_YAW, PATH_REFERENCE, END_TIME,
) = 3, 4, 5, 8, 9, 10, 11, 12, 13, 14  # fmt: skip
DENSITY_FACTOR = 15
HEAD = 16
# Offsets in a body's block.
MASS, INERTIA, PRODUCTS, INERTIA_FACTOR, CG = 0, 1, 4, 7, 8
AREA, LENGTH, FORCE_FACTOR, MOMENT_FACTOR, MOMENT_POINT = 11, 12, 13, 14, 15
BODY_SIZE = 18
# Offsets in a motor's block.
(
    THRUST, BUILD_UP, IGNITION, BURN, STATION, RADIUS, CANT, CLOCK, OFFSET, DEFLECTION,
    DEFLECTION_CLOCK,
) = 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11  # fmt: skip
IGNITION_DELAY, TAIL_OFF = 12, 13
MOTOR_SIZE = 14
# Offsets in a joint's block: its point on A, on B (not finite: the same), its releases, its pins.
(
    POINT, SECOND_POINT, DELAY, FAILS, CIRCLE, PIN_CLOCK, ENGAGED, FRICTION, SLIP_SPEED,
) = 0, 3, 6, 7, 8, 9, 10, 11, 12  # fmt: skip
SWING = 13  # initial rate across it
JOINT_SIZE = 16
MIN_ENGAGED = 0.01  # lower limit of the engaged length of pins, relative to that when closed
# Offsets in a spring's block; its points as in a joint's block.
SPRING_FORCE, STIFFNESS, DAMPING, STROKE, SPRING_FACTOR = 6, 7, 8, 9, 10
SPRING_SIZE = 11
# Offsets in a constant load's block.
LOAD_FORCE, LOAD_MOMENT, LOAD_POINT, LOAD_START, LOAD_END = 0, 3, 6, 9, 10
LOAD_SIZE = 11
GRAIN = 1e-12  # s: closer times are equal

AXIAL, NORMAL, SIDE, ROLLING, YAWING, PITCHING = 0, 1, 2, 3, 4, 5
TRANSIENT = 30.0  # time constants of a build-up or tail-off; the rest is 1e-13
BRIEF = 0.05  # of the end time: a step ends with a shorter transient
NO_HISTORY, SEPARATION_HISTORY, FULL_HISTORY = 0, 1, 2
AT_POINT = 3  # numbers of a curve at a point: value, rate, acceleration

# Codes of constraint rows: translation along axis k is k; "axis i of B stays perpendicular to axis
# k of A" is ROTATION + 3 i + k.
ROTATION, ROD = 3, 12
BAUMGARTE_RATE = 10.0  # 1/s: stabilisation rate of drifted constraints, critically damped
# Conditions, by the quantity that is compared with a threshold.
(
    AT_TIME, AT_BURN_OUT, AT_STROKE, AT_DISTANCE, AT_ANGLE, AT_FORCE, AT_MOMENT, AT_ALTITUDE,
    AT_SPRING_STROKE,
) = 0, 1, 2, 3, 4, 5, 6, 7, 8  # fmt: skip
AT_LAYER_TOP, AT_LAYER_BASE = 9, 10
AT_VERTICAL_SPEED, AT_KINK = 11, 12
AT_CELL_TOP, AT_CELL_BASE = 13, 14  # ends of the cell of a table of lines, along an axis
BODY_OUTCOMES, JOINT_OUTCOMES = 9, 3
FLOW_ANGLES = 2  # the first outcomes of a body: undefined in still air
LOADS_OUTCOMES, CLEARANCE_OUTCOMES = 6, 6
# Part of an outline in ``numbers``: kind (solid, hollow or sector), layout point of its start,
# length aft, radius at both ends. After a sector follow its angles: kind, first angle, two unused
# numbers, width, two unused numbers.
PART_SIZE = 7
SECTOR, SECTOR_ANGLES = 2.0, 3.0
# Status of a case that a kernel rejects because its steps are too long; other rejected cases have
# the code of the variant (`sepmc.kernel.spec.variant`) that may integrate them.
FINER_STEPS = -1

# Data of an interval between load switches, after the parameters of a case. Of a motor: burning,
# tailing off or off, and the line of its profile.
BURNING, LEVEL, SLOPE = 0, 1, 2
MOTOR_WORK = 3
OFF, ON, TAILING = 0.0, 1.0, 2.0
# Of a constant load: 1 if active.
ACTS = 0
LOAD_WORK = 1
# Numbers of the path of two bodies: vector between them, attitudes of both.
PATH = 11
# Search for their smallest distance: poses of a step at which the relative motion is sampled, and
# numbers of a pose (one body relative to the other); largest depth of nested halvings of the step,
# and numbers of a node (a time within it).
POSES, POSE = 5, 12
DEPTH, NODE = 56, 15
# Offsets: the step's start and length, powers of the path, start and number of the parts of both
# outlines, mass centres, result, 1 if the search was complete, direction of the last distance of
# two solids, position of the marks of pairs that may come nearer, poses, nodes, path over the step.
(
    JOB_TIME, JOB_LENGTH, JOB_POWERS, JOB_PARTS, JOB_CENTRES, JOB_RESULT, JOB_DONE, JOB_DIRECTION,
    JOB_NEAR,
) = 0, 1, 2, 3, 7, 13, 19, 20, 23  # fmt: skip
JOB_POSES = 24
JOB_NODES = JOB_POSES + POSES * POSE
JOB_PATH = JOB_NODES + (DEPTH + 2) * NODE
# Screening of a step in all lanes, components: smallest distance so far, 1 where some pair of parts
# may come nearer, 1 where the pair at hand may, mass centres, numbers of a part of either outline,
# placed part of b (start and axis) and its reach, bounds of the motion (each with a scratch
# number), path at a time, poses, path over the step.
(
    SCREEN_LIMIT, SCREEN_NEAR, SCREEN_PAIR, SCREEN_CENTRES, SCREEN_PART_A, SCREEN_PART_B,
    SCREEN_PLACED, SCREEN_REACH, SCREEN_MOVE, SCREEN_TURN, SCREEN_POINT, SCREEN_POSES,
) = 0, 1, 2, 3, 9, 16, 23, 29, 30, 32, 34, 45  # fmt: skip
SCREEN_PATH = SCREEN_POSES + POSES * POSE
# Cell of a pack of splines, loaded by a lane: for each axis low end, high end and origin of
# distances; basis functions, as in the pack; coefficients, the functions side by side.
CELL_ENDS, CELL_BASIS, CELL_COEFFICIENTS = 0, 9, 57
# nodes of a step for loads: a polynomial of degree seven, the order of the continuous extension of
# dop853
PEAK_NODES = 8
# points of a step for the mean of a magnitude; pairs of them, with the middle one as half a pair
PEAK_POINTS, PEAK_PAIRS = 15, 8
# scratch numbers of a lane: coefficients of three components, sizes at the nodes and eight more
PEAK_SCRATCH = 5 * PEAK_NODES

# Counts of the elements of a scene and positions of their data (`Model.scene`): integers that a
# kernel reads through one pointer (as arguments they would be copied at every call).
STRUCTURE = np.dtype(
    (
        np.record,
        [
            (name, np.int64)
            for name in """
    ground n_motors n_loads n_terms n_proximity pivot_joint motors_p joints_p springs_p
    loads_p leaves_p proximity_p terms_p work motors_w loads_w size_w profile_i
    aero_table_i proximity_i parts_i force_tables_i springs_x air_x wind_x
""".split()
        ],
    )
)


class Model(NamedTuple):
    """Content of a scene that is common to all cases, as a kernel reads it.

    The numbers of a case itself are in its part of the workspace ``w``: its parameters first, then
    its interval data (what motors and loads do in the current interval between load switches).

    Attributes
    ----------
    scene : record of STRUCTURE
        Counts of elements, and positions of the data of the first element of each kind. The end of
        a name says where these data are: ``_p`` parameters in w; ``_w`` interval data in w; ``_i``
        the array ``table``; ``_x`` the array ``numbers``.
    table : array of int
        Integers of five tables, one after the other: profile (motors, 2), the position in
        ``numbers`` and the number of rows; aero_table (bodies,), the position in ``numbers`` or -1;
        proximity (n,), the position in ``numbers``; parts (bodies, 2), the position in ``numbers``
        and the number of parts; force tables (springs,), the position in ``numbers`` or -1.
    numbers : array
        For each joint its axes (9) and the sign that makes its opening separation positive; for
        each spring its axis or 0; then the data of tables.
    """

    scene: Any
    table: Any
    numbers: Any
