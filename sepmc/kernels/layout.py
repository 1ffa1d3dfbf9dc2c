"""Where the numbers of a case stand in its parameter vector, and the codes of what a scene contains. No numba here."""

from typing import Any, NamedTuple

import numpy as np

# Fixed head.
SURFACE_GRAVITY, WIND_SPEED, WIND_DIRECTION = 0, 1, 2
ALTITUDE, SPEED, OMEGA, ALPHA, PITCH, YAW, ROLL, PATH_YAW, PATH_REFERENCE, END_TIME = 3, 4, 5, 8, 9, 10, 11, 12, 13, 14
DENSITY_FACTOR = 15
HEAD = 16
# Offsets in a body's block.
MASS, INERTIA, PRODUCTS, INERTIA_FACTOR, CG = 0, 1, 4, 7, 8
AREA, LENGTH, FORCE_FACTOR, MOMENT_FACTOR, MOMENT_POINT = 11, 12, 13, 14, 15
BODY_SIZE = 18
# Offsets in a motor's block.
THRUST, BUILD_UP, IGNITION, BURN, STATION, RADIUS, CANT, CLOCK, OFFSET, DEFLECTION, DEFLECTION_CLOCK = 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11
IGNITION_DELAY, TAIL_OFF = 12, 13
MOTOR_SIZE = 14
# Offsets in a joint's block: its point on A and on B (not finite: the same), and what its releases and its pins are like.
POINT, SECOND_POINT, DELAY, FAILS, CIRCLE, PIN_CLOCK, ENGAGED, FRICTION, SLIP_SPEED = 0, 3, 6, 7, 8, 9, 10, 11, 12
JOINT_SIZE = 13
LEAST_ENGAGED = 0.01  # of the engaged length of pins when closed: they are never counted shorter
# Offsets in a spring's block; its points as those of a joint.
SPRING_FORCE, STIFFNESS, DAMPING, STROKE = 6, 7, 8, 9
SPRING_SIZE = 10
# Offsets in a constant load's block.
LOAD_FORCE, LOAD_MOMENT, LOAD_POINT, LOAD_START, LOAD_END = 0, 3, 6, 9, 10
LOAD_SIZE = 11

GRAIN = 1e-12  # s: two times closer than this are one

NO_ATMOSPHERE, US1976, AIR_TABLE = 0, 1, 2
NO_GRAVITY, CONSTANT_GRAVITY, INVERSE_SQUARE = 0, 1, 2
REDUCED, FULL = 0, 1
NO_STABILISATION, BAUMGARTE, PROJECTION = 0, 1, 2
AXIAL, NORMAL, SIDE, ROLLING, YAWING, PITCHING = 0, 1, 2, 3, 4, 5
BODY_FRAME, GROUND_FRAME = 0, 1
TRANSIENT = 30.0  # time constants after which a thrust has built up or tailed off, to 1e-13
BRIEF = 0.05  # of a flight: a step ends with a transient that is shorter
NO_HISTORY, SEPARATION_HISTORY, FULL_HISTORY = 0, 1, 2

# Codes of constraint rows: translation along axis k is k; "axis i of B stays perpendicular to axis k of A" is ROTATION + 3 i + k.
ROTATION, ROD, NO_ROW = 3, 12, -1
KIND_SIZE = 7  # of a joint kind in the integer table: number of rows, then their codes
FREE = 0  # a kind that every scene has
# Conditions: what is compared with a threshold.
BAUMGARTE_RATE = 10.0  # 1/s: rate at which a drifted constraint is pulled back, critically damped
AT_TIME, AT_BURN_OUT, AT_STROKE, AT_DISTANCE, AT_ANGLE, AT_FORCE, AT_MOMENT, AT_ALTITUDE, AT_SPRING_STROKE = 0, 1, 2, 3, 4, 5, 6, 7, 8
AT_LAYER_TOP, AT_LAYER_BASE = 9, 10
LEAF_SIZE = (
    4  # of a condition in the integer table: what, of which joint, motor, body or spring, its event, where its threshold stands in w
)

STATE = 13  # per body: position 3, velocity 3, quaternion 4, angular rate 3; the last number of the state is the work of all loads
POSITION, VELOCITY, QUATERNION, RATE = 0, 3, 6, 10

BODY_OUTCOMES, JOINT_OUTCOMES = 9, 3
LOADS_OUTCOMES, CLEARANCE_OUTCOMES = 6, 6
PART_SIZE = 7  # of a part of an outline in ``numbers``: hollow, layout point of its start, length aft, radius at both ends
# What a written kernel says of a case that it does not vouch for: it may at shorter steps, or another kernel has to fly it.
FINER_STEPS, ANOTHER_KERNEL = -1, -2
# Audit columns, in order.
(GAP_AUDIT, ANGLE_AUDIT, GAP_RATE_AUDIT, ANGLE_RATE_AUDIT, DRIFT_AUDIT, ENERGY_AUDIT, PIVOT_AUDIT, REDUNDANT_AUDIT, EVENT_AUDIT,
 SINGULAR_AUDIT, STEPS_AUDIT) = range(11)  # fmt: skip
AUDIT = 11
STATE_COLUMNS = 7  # per body in a full history: position, velocity, axial acceleration
WRENCH_COLUMNS = 15  # per joint in a full history: force and moment on both bodies, gap


# Scratch of a case, behind its parameters in one array `w`. Fixed head, then blocks per body, motor, ... , constraint row.
ORIGIN, ORIGIN_VELOCITY, STEADY_WIND = 0, 3, 6
LEFT_AIR, LEFT_TABLE, JAMMED = 9, 10, 11  # set once a height was outside the atmosphere, a flow outside a table, a guide jammed
PIVOT, REDUNDANT = 12, 13  # smallest pivot so far, most redundant rows so far
UNSEARCHED = 14  # set once a step was too long to be searched for a clearance
WORK_HEAD = 15
# per body: inertia, its inverse, attitude (9 each); load: force in ground axes, moment less w x J w in body axes; acceleration:
# linear in ground axes, angular in body axes; 1 / mass; pitch and roll at the last step, continuous
TENSOR, INVERSE, ATTITUDE, LOAD, ACCEL, INVERSE_MASS, LAST_PITCH, LAST_ROLL = 0, 9, 18, 27, 33, 39, 40, 41
LAYER, LAYER_TOP = 42, 46  # of the standard atmosphere that a body flies in: see `atmosphere.layer`
BODY_WORK = 47
# per motor: unit thrust, its moment about the centre of mass (body axes); whether it burns in this stretch of time or tails off,
# and the line its profile follows there
THRUST_LINE, THRUST_MOMENT, BURNING, LEVEL, SLOPE = 0, 3, 6, 7, 8
MOTOR_WORK = 9
OFF, ON, TAILING = 0.0, 1.0, 2.0
# per joint: lever arms on A and B (body axes), joint axes carried by B (body axes), gap and its rate, force and moment on B at
# r_B and on A at r_A (ground axes); its kind now; gap along x and distance at the start; friction on B, and the greatest size of it known
# to be too little and the least known to be too much, each with how far it is off
RHO_A, RHO_B, AXES_B, GAP, GAP_RATE, FORCE_B, MOMENT_B, FORCE_A, MOMENT_A = 0, 3, 6, 15, 18, 21, 24, 27, 30
KIND, GAP_START, ROD_LENGTH, FRICTION_FORCE, TOO_LITTLE, LITTLE_OFF, TOO_MUCH, MUCH_OFF = 33, 34, 35, 36, 37, 38, 39, 40
JOINT_WORK = 41
# per spring: lever arms as of a joint, extension at the start (distance or along the axis), whether it has reached its stroke
EXTENSION_START, SPENT = 6, 7
SPRING_WORK = 8
# per constant load: arm about the centre of mass (body axes), whether it acts in this stretch of time
ARM, ACTS = 0, 3
LOAD_WORK = 4
# per condition: whether it is met; the side from which a height is approached; value and rate at the start of the step
MET, FROM_SIDE, BEFORE, BEFORE_RATE = 0, 1, 2, 3
LEAF_WORK = 4
# per constraint row: direction e or 0, lever arms on A and B (body axes), n or 0 (ground axes), right-hand side, joint, C and C'
ROW_E, ROW_A, ROW_B, ROW_N, ROW_GAMMA, ROW_JOINT, ROW_VALUE, ROW_RATE = 0, 3, 6, 9, 12, 13, 14, 15
ROW_WORK = 16


# Numbers that say where two bodies are: place of one seen from the other, attitudes of both. Of a search for their least distance, one
# behind the other: the step's start and length, powers of the path, start and number of the parts of both outlines, mass centres, what
# is found, whether the search came to an end, and the path over the step.
PATH = 11
JOB_TIME, JOB_LENGTH, JOB_POWERS, JOB_PARTS, JOB_CENTRES, JOB_FOUND, JOB_DONE, JOB_PATH = 0, 1, 2, 3, 7, 13, 19, 20
# What a lane holds of a pack of splines that it looks up, a cell: low and high end and what distances count from, for
# each axis; basis functions there, as in the pack, and their values; a weight; coefficients, the functions side by side.
CELL_ENDS, CELL_BASIS, CELL_VALUES, CELL_WEIGHT, CELL_COEFFICIENTS = 0, 9, 57, 69, 70
PEAK_NODES = 8  # of a step, for loads: a polynomial of degree seven, the order of the continuous extension of dop853
PEAK_SCRATCH = 4 * PEAK_NODES  # numbers that `peaks.note_size` works in: coefficients of three components, and sizes at the nodes

# What a scene contains and where its blocks start: whole numbers that a kernel reads through one pointer (as arguments they
# would be copied at every call).
STRUCTURE = np.dtype(
    (
        np.record,
        [
            (name, np.int64)
            for name in """
    n_bodies ground n_motors n_joints n_springs n_loads n_phases n_releases n_leaves n_events n_terms n_proximity n_load_outputs n_tip_off
    n_guides n_clearances friction pivot_joint atmosphere gravity formulation drift motors_p joints_p springs_p loads_p leaves_p
    proximity_p terms_p work motors_w joints_w springs_w loads_w leaves_w events_w rows_w matrix_w rhs_w size_w motor_body_i profile_i
    joint_bodies_i kinds_i held_along_i phase_kinds_i spring_bodies_i load_i leaves_i events_i clauses_i clause_leaves_i releases_i terms_i
    aero_table_i proximity_i load_outputs_i tip_off_i guides_i pins_i clearances_i parts_i springs_x air_x wind_x
""".split()
        ],
    )
)


class Model(NamedTuple):
    """What a scene contains, as a kernel reads it. The numbers of a case stand in ``w``: parameters first, then scratch.

    ``scene`` (STRUCTURE): numbers of things, codes, and starts: ``*_p`` of parameter blocks in w, ``*_w`` of scratch blocks in w,
    ``*_i`` of integer tables in ``table``, ``*_x`` of numbers that all cases share in ``numbers``.

    Integer tables: motor_body (motors,); profile (motors, 2) start in ``numbers`` and rows; joint_bodies (joints, 2); kinds of
    KIND_SIZE; held_along (kinds,) the kind that holds x too; phase_kinds (phases, joints); spring_bodies (springs, 2); load
    (loads, 2) body and frame; leaves of LEAF_SIZE;
    events (events, 2) first clause and their number, an event being met when one of its clauses is: first the ends of the phases,
    then the releases, then the strokes of springs; clauses (clauses, 2) first condition and their number, all of which must be met,
    in clause_leaves; releases (releases, 2) joint and kind; terms (terms, 4) of body, coefficient, power of alpha, power of beta;
    aero_table (bodies,) start in ``numbers`` or -1; proximity (n, 3) body, joint, start in ``numbers``; loads, tip_off, guides:
    joints of those outputs; pins (joints,); clearances (n, 3) of two bodies and a joint or -1; parts (bodies, 2) start in
    ``numbers`` and their number.

    ``numbers``: per joint its axes (9) and the sign that makes its separation positive apart; per spring its axis or 0; tables.
    """

    scene: Any
    table: Any
    numbers: Any


class Tableau(NamedTuple):
    """A Runge-Kutta method (see methods.py) and the steps it takes."""

    a: Any
    b: Any
    c: Any
    dense: Any
    doubt: Any
    step: float
    history_step: float
