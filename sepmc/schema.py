"""Columns of a result (name, unit, meaning) and the status of a case with the sentence that explains it."""

import math
from dataclasses import dataclass
from enum import IntEnum

DEG = 180.0 / math.pi


class Status(IntEnum):
    """How a case ended. ``label`` is what the ``status`` column holds, ``sentence`` what a person reads."""

    OK = 0
    NEVER_RELEASED = 1
    INVALID_INPUT = 2
    OUTSIDE_ATMOSPHERE = 3
    SINGULAR_JOINT = 4
    NOT_FINITE = 5
    NO_ROOT = 6
    NOT_FLOWN = 7
    UNRESOLVED = 8

    @property
    def label(self) -> str:
        return self.name.lower().replace("_", "-")

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.OK: "flown to the end",
    Status.NEVER_RELEASED: "a joint was still guiding at the end time: lengthen run.end_time_s or look at the separation force",
    Status.INVALID_INPUT: "a mass is not positive or an inertia not positive definite: narrow the dispersion",
    Status.OUTSIDE_ATMOSPHERE: "a body left 0 to 86 km, where the 1976 atmosphere is defined",
    Status.SINGULAR_JOINT: "the constraint force equations are singular: are constraints redundant, or axes parallel?",
    Status.NOT_FINITE: "the motion became NaN or infinite: shorten solver.step_s and check the loads",
    Status.NO_ROOT: "the release could not be located in its step: shorten solver.step_s",
    Status.UNRESOLVED: "the attitude drifted off unit length in a step, so the step is too long for this motion: shorten solver.step_s",
    Status.NOT_FLOWN: "the kernel did not reach this case",
}


@dataclass(frozen=True)
class Column:
    """One column of the case table: its name ends in ``unit``; ``scale`` takes the kernel's SI value to that unit."""

    name: str
    unit: str
    meaning: str
    scale: float = 1.0


# Per body and per joint, in the order the kernel writes them (kernels/observe.py).
_BODY = (
    ("alpha_deg", "deg", "angle of attack of {0} relative to the air, eq (11)", DEG),
    ("beta_deg", "deg", "sideslip angle of {0} relative to the air, eq (11)", DEG),
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
_AUDIT = (
    ("joint_gap_residual_m", "m", "largest violation of a translation constraint over the constrained phases", 1.0),
    ("joint_angle_residual_rad", "rad", "largest violation of a rotation constraint over the constrained phases", 1.0),
    ("attitude_drift", "1", "largest departure of a quaternion from unit length in one step, before it is normalised", 1.0),
    ("steps", "1", "integration steps taken", 1.0),
)
_STATE = (
    ("x_m", "m", "centre of mass of {0}, ground x", 1.0),
    ("y_m", "m", "centre of mass of {0}, ground y: height", 1.0),
    ("z_m", "m", "centre of mass of {0}, ground z", 1.0),
    ("vx_m_s", "m/s", "velocity of {0}, ground x", 1.0),
    ("vy_m_s", "m/s", "velocity of {0}, ground y", 1.0),
    ("vz_m_s", "m/s", "velocity of {0}, ground z", 1.0),
    ("axial_acceleration_m_s2", "m/s2", "acceleration of the centre of mass of {0} along its body x axis", 1.0),
)


def _fill(rows, prefix: str, name: str) -> list[Column]:
    return [Column(prefix + stem, unit, meaning.format(name), scale) for stem, unit, meaning, scale in rows]


def outcome_columns(bodies: list[str], joints: list[str]) -> list[Column]:
    """Outcomes of a case, in kernel order. With a single joint its columns carry no joint name."""
    columns = [column for body in bodies for column in _fill(_BODY, f"{body}_", body)]
    for joint in joints:
        columns += _fill(_JOINT, "" if len(joints) == 1 else f"{joint}_", joint)
    return columns


def audit_columns() -> list[Column]:
    """Numbers that say how well a case was integrated, in kernel order."""
    return _fill(_AUDIT, "", "")


def result_columns(bodies: list[str], joints: list[str]) -> list[Column]:
    """All that the kernel writes of a case, in its order: outcomes, then audit columns."""
    return [*outcome_columns(bodies, joints), *audit_columns()]


def separation_columns(joints: list[str]) -> list[Column]:
    """Columns of the stored histories after ``case`` and ``time_s``: speed and distance of every joint."""
    columns = []
    for joint in joints:
        columns += _fill(_JOINT[:2], "" if len(joints) == 1 else f"{joint}_", joint)
    return columns


def history_columns(bodies: list[str], joints: dict[str, tuple[str, str]]) -> list[Column]:
    """Columns of the time history of one case after ``time_s`` and ``phase``, in kernel order."""
    names = list(joints)
    columns = [c for c in outcome_columns(bodies, names) if not c.name.endswith("release_time_s")]
    for body in bodies:
        columns += _fill(_STATE, f"{body}_", body)
    for joint, pair in joints.items():
        first = pair[0]
        for body in pair:
            for what, unit, suffix in (("force", "N", "N"), ("moment", "N m", "N_m")):
                for axis in "xyz":
                    meaning = f"constraint {what} of joint {joint} on {body} at its own copy of the joint point, {axis} axis of {first}"
                    columns.append(Column(f"{joint}_{what}_on_{body}_{axis}_{suffix}", unit, meaning))
        for axis in "xyz":
            columns.append(Column(f"{joint}_gap_{axis}_m", "m", f"gap r_{pair[1]} - r_{first} at joint {joint}, {axis} axis of {first}"))
    return columns
