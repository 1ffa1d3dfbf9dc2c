"""Columns of results (name, unit, meaning, factor from SI), and the statuses of a case with their
explanations."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import NamedTuple

DEG = 180.0 / math.pi
# Units of outcomes by formulas, by the end of the column's name: text, and factor from SI.
FORMULA_UNITS = {
    "1": ("1", 1.0),
    "s": ("s", 1.0),
    "m": ("m", 1.0),
    "mm": ("mm", 1e3),
    "m_s": ("m/s", 1.0),
    "deg": ("deg", DEG),
    "deg_s": ("deg/s", DEG),
    "N": ("N", 1.0),
    "N_m": ("N m", 1.0),
    "N_s": ("N s", 1.0),
    "N_m_s": ("N m s", 1.0),
}


class Status(IntEnum):
    """Final status of a case: how its simulation ended. The value is the number that kernels write,
    `label` the text in tables."""

    OK = 0
    NEVER_RELEASED = 1
    INVALID_INPUT = 2
    OUTSIDE_ATMOSPHERE = 3
    SINGULAR_JOINT = 4
    NOT_FINITE = 5
    NO_ROOT = 6
    NOT_FLOWN = 7
    UNRESOLVED = 8
    INCONSISTENT_START = 9
    OUTSIDE_TABLE = 10
    JAMMED = 11
    TOO_MANY_EVENTS = 12
    NO_CLEARANCE = 13
    UNDEFINED_FORMULA = 14

    @property
    def label(self) -> str:
        """Value of the ``status`` column: the name in lower case, with hyphens."""
        return self.name.lower().replace("_", "-")

    @property
    def meaning(self) -> str:
        """How a case with this status ended, as text for users."""
        return _MEANINGS[self][0]

    @property
    def remedy(self) -> str:
        """Advice on a case with this status, as text for users; empty for ``OK``."""
        return _MEANINGS[self][1]

    @property
    def sentence(self) -> str:
        """Meaning and remedy, joined by a colon; the meaning alone for ``OK``."""
        return ": ".join(filter(None, _MEANINGS[self]))


# values of the ``status`` column, by number of the status
STATUS_LABELS = tuple(status.label for status in Status)
NOT_OK_LABELS = STATUS_LABELS[1:]

# Meaning and remedy of each status. No kernel writes NO_ROOT, NOT_FLOWN and NO_CLEARANCE
# today; their numbers and names stay.
_MEANINGS = {
    Status.OK: ("reached the end of the run", ""),
    Status.NEVER_RELEASED: (
        "a phase had not ended, or a joint had not been released, at the end time",
        "check the condition of each [[release]] (optional = true permits that it is not met), "
        "run.end_time_s and the separation forces; a release that was sampled to fail needs no "
        "remedy. Cases with this status are not in the statistics",
    ),
    Status.INVALID_INPUT: (
        "an input is outside the range that its key allows, a mass is not positive, or an inertia "
        "tensor not positive definite",
        "narrow the distribution of that input, or truncate it if it is normal (truncate_sigma)",
    ),
    Status.OUTSIDE_ATMOSPHERE: (
        "a body left the heights where the atmosphere is defined (0 to 86 km for us1976)",
        "shorten run.end_time_s, or give environment.atmosphere a table that covers the heights",
    ),
    Status.SINGULAR_JOINT: (
        "the constraint force equations have no solution",
        "look for a rod of length zero, or for two axes of a joint that become parallel",
    ),
    Status.NOT_FINITE: (
        "the motion became NaN or infinite",
        "check the size of the loads; if solver.step_s is given, make it shorter or remove it",
    ),
    Status.NO_ROOT: ("an event could not be located in its step", "shorten solver.step_s"),
    Status.UNRESOLVED: (
        "the steps were too long: attitude or energy drifted by more than 1e-6, a body turned by "
        "more than 2 rad in a step, or an event was missed",
        "make solver.step_s shorter, or remove it, so that the steps follow from solver.accuracy",
    ),
    Status.NOT_FLOWN: ("the run ended before this case was integrated", "run the case again"),
    Status.INCONSISTENT_START: (
        "the initial state violates a joint of the first phase",
        "compare the initial attitude and rates with the joints: rods, joints to the ground, and "
        "joints with omega_deg_s",
    ),
    Status.OUTSIDE_TABLE: (
        "Mach number, alpha or beta left an aerodynamic table, which is not extrapolated",
        "add rows to the table that cover the Mach numbers and angles that the case reaches",
    ),
    Status.JAMMED: (
        "the pins of a guide jam: their friction grows faster than the force that drives the slide",
        "give the guide a friction below the outcome JOINT_jam_friction of cases that do not jam",
    ),
    Status.TOO_MANY_EVENTS: (
        "a formula switched to and fro at one instant without end",
        "make the formula smooth there: if it switches a load by the motion that the load causes, "
        "use x / sqrt(x**2 + 0.01**2) instead of sign(x)",
    ),
    Status.NO_CLEARANCE: (
        "the minimum distance of two outlines was not found in a step",
        "move stations of outlines that are flush at the start by 0.1 mm, or shorten solver.step_s",
    ),
    Status.UNDEFINED_FORMULA: (
        "the formula of a signal or outcome divided by zero, overflowed, or left the domain of a "
        "function",
        "limit the argument of the function, as in sqrt(max(x, 0)), or narrow the distributions of "
        "the constants in the formula",
    ),
}


@dataclass(frozen=True)
class Column:
    """Column of a table of results or of a history.

    Attributes
    ----------
    name : str
        Name, which ends in the unit, as ``pitch_deg``.
    unit, meaning : str
        Unit ("1" without a unit) and explanation, as text for users.
    scale : float
        Factor from SI to the unit: value in ``unit`` = ``scale`` times value in SI.
    """

    name: str
    unit: str
    meaning: str
    scale: float = 1.0


# Per body and per joint, in the order kernels write them (kernel/emit/outcomes.py).
_BODY = (
    ("alpha_deg", "deg", "angle of attack of {0}, eq (11); NaN in still air", DEG),
    ("beta_deg", "deg", "sideslip angle of {0}, eq (11); NaN in still air", DEG),
    ("alpha_ref_deg", "deg", "pitch of {0} minus the nominal path angle", DEG),
    ("omega_x_deg_s", "deg/s", "roll rate of {0} in its body axes", DEG),
    ("omega_y_deg_s", "deg/s", "yaw rate of {0} in its body axes", DEG),
    ("omega_z_deg_s", "deg/s", "pitch rate of {0} in its body axes", DEG),
    ("roll_deg", "deg", "roll angle of {0}", DEG),
    ("yaw_deg", "deg", "yaw angle of {0}", DEG),
    ("pitch_deg", "deg", "pitch angle of {0}", DEG),
)
_JOINT = (
    ("separation_speed_m_s", "m/s", "time derivative of the separation distance at {0}", 1.0),
    ("separation_distance_mm", "mm", "gap at joint {0} along its x axis, positive apart", 1000.0),
    ("release_time_s", "s", "time at which joint {0} became free; NaN if it did not", 1.0),
)
_LOADS = (
    ("peak_force_N", "N", "maximum constraint force of {0}", 1.0),
    ("peak_force_time_s", "s", "time of the maximum constraint force of {0}", 1.0),
    (
        "force_impulse_N_s",
        "N s",
        "integral of the size of the constraint force of {0} over time",
        1.0,
    ),
    (
        "peak_moment_N_m",
        "N m",
        "maximum constraint moment of {0} on its second body at its joint point",
        1.0,
    ),
    ("peak_moment_time_s", "s", "time of the maximum constraint moment of {0}", 1.0),
    (
        "moment_impulse_N_m_s",
        "N m s",
        "integral of the size of the constraint moment of {0} over time",
        1.0,
    ),
)
_CLEARANCE = (
    (
        "clearance_mm",
        "mm",
        "minimum distance of {0} over the run, solids and rims or points in shells, not "
        "positive if they met; penetration of the wall of a shell is limited to 0.1 of its radius",
        1000.0,
    ),
    ("clearance_time_s", "s", "time of the minimum distance of {0}", 1.0),
    (
        "clearance_station_m",
        "m",
        "station of the nearest point of the first body of {0} at that time",
        1.0,
    ),
    *(
        (
            f"clearance_{axis}_m",
            "m",
            f"layout {axis} of the nearest point of the first body of {{0}} at that time",
            1.0,
        )
        for axis in "yz"
    ),
    ("recontact", "1", "1 if the outlines of {0} met, else 0", 1.0),
)
# Audit columns with the bound above which a case is not valid (NaN: no bound).
_AUDIT = (
    (
        "joint_gap_residual_m",
        "m",
        "largest violation of a translation constraint at the end of a step",
        1e-9,
    ),
    (
        "joint_angle_residual_rad",
        "rad",
        "largest violation of a rotation constraint at the end of a step",
        1e-9,
    ),
    (
        "joint_gap_rate_residual_m_s",
        "m/s",
        "largest rate of violation of a translation constraint at the end of a step",
        1e-8,
    ),
    (
        "joint_angle_rate_residual_rad_s",
        "rad/s",
        "largest rate of violation of a rotation constraint at the end of a step",
        1e-8,
    ),
    (
        "attitude_drift",
        "1",
        "largest departure of a quaternion from unit length in one step, before it is normalised",
        1e-6,
    ),
    (
        "energy_residual",
        "1",
        "largest difference between kinetic energy gained and work of all loads, relative to the "
        "larger of both",
        1e-6,
    ),
    (
        "smallest_pivot",
        "1",
        "smallest relative pivot of the constraint solve; small means joints that are nearly "
        "redundant",
        math.nan,
    ),
    (
        "redundant_rows",
        "1",
        "constraint rows that follow from the others; joint forces are then those of minimum sum "
        "of squares",
        math.nan,
    ),
    ("event_residual_s", "s", "largest uncertainty of the time of an event", 1e-9),
    (
        "attitude_singular",
        "1",
        "1 if roll and pitch may have jumped: yaw near 90 deg, or more than a quarter turn in a "
        "step",
        math.nan,
    ),
    ("steps", "1", "integration steps taken", math.nan),
    (
        "error",
        "1",
        "estimate of the numerical error: the largest of the errors of its outcomes, relative to "
        "their size or sigma; recontact and times and positions of extremes are left out",
        math.nan,
    ),
)
AUDIT_BOUNDS = {name: bound for name, _, _, bound in _AUDIT if not math.isnan(bound)}
_STATE = (
    ("x_m", "m", "centre of mass of {0}, ground x", 1.0),
    ("y_m", "m", "centre of mass of {0}, ground y: height", 1.0),
    ("z_m", "m", "centre of mass of {0}, ground z", 1.0),
    ("vx_m_s", "m/s", "velocity of {0}, ground x", 1.0),
    ("vy_m_s", "m/s", "velocity of {0}, ground y", 1.0),
    ("vz_m_s", "m/s", "velocity of {0}, ground z", 1.0),
    (
        "axial_acceleration_m_s2",
        "m/s2",
        "acceleration of the centre of mass of {0} along its body x axis",
        1.0,
    ),
)


# Per joint with a hinge angle, and per pair of bodies, in the order of kernel/emit/relative.py.
_HINGE = (
    ("angle_deg", "deg", "angle of {0} about its x axis: of y in its second body from y", DEG),
    (
        "angle_rate_deg_s",
        "deg/s",
        "component about the x axis of {0} of the rate of its second body relative to the first",
        DEG,
    ),
)
_RELATIVE = (
    ("distance_m", "m", "distance of the centres of mass of {0}", 1.0),
    *((f"{key}_deg", "deg", f"{key} angle of {{0}}", DEG) for key in ("roll", "yaw", "pitch")),
)


def _columns(rows, prefix: str, name: str) -> list[Column]:
    return [
        Column(prefix + stem, unit, meaning.format(name), scale)
        for stem, unit, meaning, scale in rows
    ]


class Formula(NamedTuple):
    """Outcome that a campaign file defines by a formula of other outcomes: its name, the formula
    (``text``), which may name only columns before it, and its unit, a key of `FORMULA_UNITS`."""

    name: str
    text: str
    unit: str


@dataclass(frozen=True)
class Contents:
    """Names of the bodies, joints and other items of a scene for which there are columns.

    Attributes
    ----------
    bodies : list of str
        Moving bodies.
    joints : dict of str to (str, str)
        First and second body of each joint, by joint.
    loads, tip_off, hinges : tuple of str
        Joints with peaks and integrals of their loads; joints with the rates of their bodies at
        release; joints with a hinge angle.
    guides, pins : dict of str to int
        Number of pins by joint: ``guides`` for the guides with outcomes, ``pins`` for all guides.
    clearances, events, signals : tuple of str
        All clearances, events and signals (signals have columns in histories only).
    transverse : tuple of str
        Bodies with transverse rates.
    ignitions : tuple of str
        Motors whose ignition has a trigger (an event, a release or a joint), not a given time.
    springs : tuple of str
        Springs with a stroke.
    partial_releases : tuple of (str, str)
        Joint and kind of each ``[[release]]`` that leaves the joint with a kind other than free.
    formulas : tuple of Formula
        Outcomes by formulas.
    relative : tuple of (str, str)
        Pairs (first, second) of bodies with columns for their distance and for the attitude of the
        second relative to the first.
    """

    bodies: list[str]
    joints: dict[str, tuple[str, str]]
    loads: tuple[str, ...] = ()
    guides: dict[str, int] = field(default_factory=dict)
    clearances: tuple[str, ...] = ()
    tip_off: tuple[str, ...] = ()
    events: tuple[str, ...] = ()
    pins: dict[str, int] = field(default_factory=dict)
    transverse: tuple[str, ...] = ()
    ignitions: tuple[str, ...] = ()
    springs: tuple[str, ...] = ()
    partial_releases: tuple[tuple[str, str], ...] = ()
    formulas: tuple[Formula, ...] = ()
    signals: tuple[str, ...] = ()
    hinges: tuple[str, ...] = ()
    relative: tuple[tuple[str, str], ...] = ()


def is_yes_or_no(outcome: str) -> bool:
    """Return True if an outcome, given by the name of its column, is a recontact, which is 1 or 0
    in every case. Statistics give the fraction of ones of such an outcome, but no sigma or
    density."""
    return outcome.endswith("_recontact")


def outcome_columns(contents: Contents) -> list[Column]:
    """Return the columns of the outcomes of a case, in the order in which kernels write them; those
    by formulas, which kernels do not write, come last.

    Names of columns of separation and release begin with the name of their joint only if the scene
    has several joints.
    """
    columns = [column for body in contents.bodies for column in _columns(_BODY, f"{body}_", body)]
    for joint in contents.joints:
        columns += _columns(_JOINT, _joint_prefix(contents, joint), joint)
    for joint in contents.loads:
        columns += _columns(_LOADS, f"{joint}_", joint)
    for joint, pins in contents.guides.items():
        columns.append(
            Column(f"{joint}_time_in_guide_s", "s", f"time for which the pins of {joint} slid")
        )
        for pin in range(1, pins + 1):
            columns.append(
                Column(
                    f"{joint}_pin{pin}_peak_load_N",
                    "N",
                    f"maximum lateral load of pin {pin} of {joint} at hole entry or tip",
                )
            )
        meaning = (
            f"minimum coefficient of friction at which the pins of {joint} would not have slid "
            "under the loads that drive them"
        )
        columns.append(Column(f"{joint}_jam_friction", "1", meaning))
    for name in contents.clearances:
        columns += _columns(_CLEARANCE, f"{name}_", name)
    for joint in contents.tip_off:
        for body in contents.joints[joint]:
            if body in contents.bodies:
                for axis, about in (("x", "roll"), ("y", "yaw"), ("z", "pitch")):
                    meaning = f"{about} rate of {body} when {joint} became free"
                    columns.append(
                        Column(f"{joint}_tip_off_{body}_{axis}_deg_s", "deg/s", meaning, DEG)
                    )
    for event in contents.events:
        columns += _event_columns(contents, event)
    for motor in contents.ignitions:
        meaning = f"time at which motor {motor} lit; NaN if it did not"
        columns.append(Column(f"{motor}_ignition_time_s", "s", meaning))
    for spring, name in stroke_columns(contents).items():
        meaning = f"time at which spring {spring} reached the end of its stroke; NaN if it did not"
        columns.append(Column(name, "s", meaning))
    for (joint, kind), name in partial_release_columns(contents).items():
        meaning = (
            f"time from which joint {joint} constrained no more than {kind}, whatever released it; "
            "NaN if it constrained more to the end"
        )
        columns.append(Column(name, "s", meaning))
    columns += relative_columns(contents)
    for event in contents.events:
        columns += relative_columns(contents, event)
    meaning = "rate of {0} across its x axis, of yaw and pitch together{1}"
    columns += [
        Column(f"{stem}transverse_rate_deg_s", "deg/s", meaning.format(body, when), DEG)
        for stem, _, body, when in _transverse_rates(contents)
    ]
    for formula in contents.formulas:
        unit, scale = FORMULA_UNITS.get(formula.unit, (formula.unit, 1.0))
        name = formula.name if formula.unit == "1" else f"{formula.name}_{formula.unit}"
        columns.append(Column(name, unit, formula.text, scale))
    return columns


def relative_columns(contents: Contents, event: str = "") -> list[Column]:
    """Return the columns of hinge angles, and of distances and relative attitudes of pairs of
    bodies, at the end of a case; if ``event`` is the name of an event, at that event, with names
    that begin with ``EVENT_``."""
    start, when = (f"{event}_", f", at {event}") if event else ("", "")
    columns = [x for joint in contents.hinges for x in _columns(_HINGE, f"{joint}_", joint)]
    for first, body in contents.relative:
        columns += _columns(_RELATIVE, f"{body}_from_{first}_", f"{body} from {first}")
    return [
        replace(one, name=f"{start}{one.name}", meaning=f"{one.meaning}{when}") for one in columns
    ]


def _joint_prefix(contents: Contents, joint: str) -> str:
    """Return the prefix of the columns of separation and release of a joint: its name and an
    underscore, or nothing if the scene has a single joint."""
    return "" if len(contents.joints) == 1 else f"{joint}_"


def release_columns(contents: Contents) -> dict[str, str]:
    """Return the name of the column of the time at which each joint becomes free, by joint, also of
    joints that never do: ``JOINT_release_time_s``, with a single joint ``release_time_s``."""
    return {joint: f"{_joint_prefix(contents, joint)}release_time_s" for joint in contents.joints}


def event_columns(contents: Contents) -> dict[str, str]:
    """Return the name of the column of the time of each event, by event."""
    return {event: f"{event}_time_s" for event in contents.events}


def ignition_columns(contents: Contents) -> dict[str, str]:
    """Return the name of the column of the ignition time, by motor, for the motors whose ignition
    has a trigger (``Contents.ignitions``)."""
    return {motor: f"{motor}_ignition_time_s" for motor in contents.ignitions}


def stroke_columns(contents: Contents) -> dict[str, str]:
    """Return the name of the column of the time at which the stroke of a spring ends, by spring,
    for the springs with a stroke."""
    return {spring: f"{spring}_stroke_end_time_s" for spring in contents.springs}


def partial_release_columns(contents: Contents) -> dict[tuple[str, str], str]:
    """Return the name of the column of the time from which a joint constrains no more than a kind
    that a partial release leaves it with, by (joint, kind): ``JOINT_release_to_KIND_time_s``, with
    a single joint without ``JOINT_``; hyphens of the kind become underscores."""
    return {
        (joint, kind): f"{_joint_prefix(contents, joint)}release_to_{kind.replace('-', '_')}_time_s"
        for joint, kind in contents.partial_releases
    }


def _transverse_rates(contents: Contents) -> Iterator[tuple[str, str, str, str]]:
    """Yield, for each transverse rate (of yaw and pitch together), four texts: prefix of its
    column, prefix of the columns of its components, body, and phrase for its time (empty: the end
    of the case)."""
    for body in contents.transverse:
        yield f"{body}_", f"{body}_omega_", body, ""
        for joint in contents.tip_off:
            if body in contents.joints[joint]:
                start = f"{joint}_tip_off_{body}_"
                yield start, start, body, f", when {joint} became free"
        for event in contents.events:
            start = f"{event}_{body}_"
            yield start, f"{start}omega_", body, f", at {event}"


def transverse_components(contents: Contents) -> list[tuple[int, int]]:
    """Return, for each transverse rate in the order of `outcome_columns`, the indices there of the
    yaw rate and the pitch rate that it is computed from."""
    names = {column.name: k for k, column in enumerate(outcome_columns(contents))}
    return [
        (names[f"{start}y_deg_s"], names[f"{start}z_deg_s"])
        for _, start, _, _ in _transverse_rates(contents)
    ]


def _event_columns(contents: Contents, event: str) -> list[Column]:
    """Return the columns of an event: its time, and the rates, attitudes, separations and
    clearances at that time. Those of `relative_columns` and transverse rates are not included."""
    columns = [Column(f"{event}_time_s", "s", f"time of {event}")]
    for body in contents.bodies:
        for column in _columns(_BODY[3:], f"{event}_{body}_", body):
            columns.append(replace(column, meaning=f"{column.meaning}, at {event}"))
    for joint in contents.joints:
        prefix = f"{event}_{_joint_prefix(contents, joint)}"
        for column in _columns(_JOINT[:2], prefix, joint):
            columns.append(replace(column, meaning=f"{column.meaning}, at {event}"))
    for column in _distance_columns(contents):
        meaning = f"{column.meaning}, at {event}"
        columns.append(replace(column, name=f"{event}_{column.name}", meaning=meaning))
    return columns


def _distance_columns(contents: Contents) -> list[Column]:
    """Return a column ``NAME_clearance_mm`` for each clearance: the distance of its outlines at a
    time. Histories have these columns as they are; those of an event have the event's name before
    theirs."""
    meaning = "distance of {0}; NaN before it counts, or while no rim is within a shell"
    return [
        Column(f"{name}_clearance_mm", "mm", meaning.format(name), 1000.0)
        for name in contents.clearances
    ]


def audit_columns() -> list[Column]:
    """Return the audit columns of a case, which follow its outcomes and say how well it was
    integrated; kernels write all but the last, ``error``."""
    return [Column(name, unit, meaning) for name, unit, meaning, _ in _AUDIT]


def result_columns(contents: Contents) -> list[Column]:
    """Return the columns of a case: its outcomes, then the audit columns. Kernels write all but the
    outcomes by formulas and the last, ``error``."""
    return [*outcome_columns(contents), *audit_columns()]


def separation_columns(joints: list[str]) -> list[Column]:
    """Return the columns that follow ``case`` and ``time_s`` in stored histories: separation speed
    and distance of each of the ``joints``, given by name; of several joints, the names of columns
    begin with that of the joint."""
    columns = []
    for joint in joints:
        columns += _columns(_JOINT[:2], "" if len(joints) == 1 else f"{joint}_", joint)
    return columns


def history_columns(contents: Contents) -> list[Column]:
    """Return the columns that follow ``time_s`` and ``phase`` in the full history of one case, in
    the order in which kernels write them."""
    bodies, joints = contents.bodies, contents.joints
    columns = [column for body in bodies for column in _columns(_BODY, f"{body}_", body)]
    columns += separation_columns(list(joints))
    for body in bodies:
        columns += _columns(_STATE, f"{body}_", body)
    for joint, pair in joints.items():
        first = pair[0]
        for body in pair:
            for what, unit, suffix in (("force", "N", "N"), ("moment", "N m", "N_m")):
                for axis in "xyz":
                    meaning = (
                        f"constraint {what} of joint {joint} on {body} at its own copy of "
                        f"the joint point, {axis} axis of {first}"
                    )
                    columns.append(
                        Column(f"{joint}_{what}_on_{body}_{axis}_{suffix}", unit, meaning)
                    )
        for axis in "xyz":
            columns.append(
                Column(
                    f"{joint}_gap_{axis}_m",
                    "m",
                    f"gap r_{pair[1]} - r_{first} at joint {joint}, {axis} axis of {first}",
                )
            )
    for joint, pins in contents.pins.items():
        for pin in range(1, pins + 1):
            for end, place in (("mouth", "the hole entry"), ("tip", "its tip")):
                meaning = f"lateral load of pin {pin} of {joint} at {place}, while it may slide"
                columns.append(Column(f"{joint}_pin{pin}_{end}_load_N", "N", meaning))
    for signal in contents.signals:
        meaning = f"signal {signal}, in the unit of the keys that name it"
        columns.append(Column(f"signal_{signal}", "1", meaning))
    return columns + relative_columns(contents) + _distance_columns(contents)
