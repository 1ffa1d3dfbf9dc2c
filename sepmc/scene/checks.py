"""Checks of values of a scene against each other: references between tables, realizable inertias,
ranges of distributions."""

import math

import numpy as np

from sepmc.scene.contents import contents
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.fields import convert
from sepmc.scene.ignition_checks import check_ignitions
from sepmc.scene.kinds import KINDS, leaves_pins_sliding, rows_of
from sepmc.scene.limits import LARGEST, SMALLEST
from sepmc.scene.load_checks import (
    check_air,
    check_known,
    check_lengths,
    check_loads,
    check_outputs,
    check_pair,
    check_series,
)
from sepmc.scene.messages import Problems
from sepmc.scene.model import Body, Joint, Motor, Scene
from sepmc.scene.parameters import item_names
from sepmc.scene.parameters import value as parameter_value
from sepmc.scene.phase_checks import check_phases, holds_ground
from sepmc.scene.redundancy import check_redundancy
from sepmc.schema import outcome_columns

ATMOSPHERE_TOP = 86_000.0  # m
MOST_ROWS = 100_000  # rows of history of a case
MOST_STEPS = 100_000_000  # steps of a case


def check_scene(scene: Scene, problems: Problems) -> None:
    """Add the problems of a scene that no single value shows: wrong references between tables,
    phases out of order, impossible inertias, redundant constraints and the like. Single values are
    checked before, by `sepmc.scene.tables.read_table`. Columns of the same name and redundant
    constraints are checked only if ``problems`` is empty by then."""
    if not scene.body:
        problems.add("body", "at least one body is needed: [body.NAME]")
    for name, body in scene.body.items():
        _check_body(name, body, problems)
    for motor in scene.motor:
        _check_motor(motor, scene, problems)
    for name, joint in scene.joint.items():
        _check_joint(name, joint, scene, problems)
    check_loads(scene, problems)
    check_outputs(scene, problems)
    check_air(scene, problems)
    check_phases(scene, problems)
    check_ignitions(scene, problems)
    _check_initial(scene, problems)
    _check_histories(scene, problems)
    if not problems:
        _check_columns(scene, problems)
        check_redundancy(scene, problems)


def tensor(xx, yy, zz, xy, xz, yz) -> np.ndarray:
    """Inertia tensor, shape (3, 3) or (3, 3, n), from moments and products of inertia, floats or
    arrays (n,). The products are positive integrals, so they enter with a minus sign."""
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def inertia_tensor(body: Body) -> np.ndarray:
    """Nominal inertia tensor (3, 3) of a body about its mass centre, kg m2, with
    ``inertia_factor``."""
    return body.inertia_factor * tensor(*body.inertia, *body.inertia_products)


def breaks_triangle(principal: np.ndarray) -> np.ndarray:
    """Mask (...), True where principal moments (..., 3), rising, violate A + B >= C, which every
    solid body satisfies (Goldstein, Classical Mechanics, ch. 5), by more than 1e-9 of C."""
    return principal[..., 0] + principal[..., 1] < principal[..., 2] * (1.0 - 1e-9)


def inertia_fault(tensor: np.ndarray) -> str | None:
    """Reason, for a message, why no solid body has the inertia tensor (3, 3), kg m2: it is not
    positive definite, or breaks the triangle inequality. None if one can have it."""
    principal = np.linalg.eigvalsh(tensor)
    if principal[0] <= 0.0:
        return (
            f"must be positive definite; its smallest principal moment is {principal[0]:.6g} kg m2"
        )
    if breaks_triangle(principal):
        return (
            f"breaks the triangle inequality: {principal[0]:.6g} + {principal[1]:.6g} < "
            f"{principal[2]:.6g} kg m2, which no solid body has"
        )
    return None


def _check_columns(scene: Scene, problems: Problems) -> None:
    """Add a problem for each column name that two outcomes share, as event ``a`` with body ``b_c``
    and event ``a_b`` with body ``c`` do."""
    names = [column.name for column in outcome_columns(contents(scene))]
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        event = next((e.name for e in scene.event if name.startswith(f"{e.name}_")), None)
        key_path = f"event.{event}" if event else "output"
        if any(name in (one.name, f"{one.name}_{one.unit}") for one in scene.outcome):
            key_path = "outcome"
        problems.add(key_path, f"there are two outcomes called {name}: choose another name", event)


def _check_body(name: str, body: Body, problems: Problems) -> None:
    """Add a problem if no solid body has the inertia tensor of this body."""
    fault = inertia_fault(inertia_tensor(body))
    if fault:
        problems.add(f"body.{name}.inertia_kg_m2", fault, list(body.inertia))


def _check_motor(motor: Motor, scene: Scene, problems: Problems) -> None:
    """Add problems of a motor: an unknown body, or a profile with times that do not rise from 0 or
    later, or with columns of different length."""
    key_path = f"motor.{motor.name}"
    check_known(f"{key_path}.body", motor.body, scene.body, "body", problems)
    if motor.profile is not None:
        check_series(f"{key_path}.profile", "time_s", motor.profile.time, 2, problems)
        if motor.profile.time and motor.profile.time[0] < 0.0:
            reason = "must begin at 0 or later: times count from the ignition"
            problems.add(f"{key_path}.profile.time_s", reason, motor.profile.time[0])
        check_lengths(
            f"{key_path}.profile",
            {"time_s": motor.profile.time, "fraction": motor.profile.fraction},
            problems,
        )


def _check_joint(name: str, joint: Joint, scene: Scene, problems: Problems) -> None:
    """Add problems of a joint: unknown or equal bodies, axes that are zero or parallel,
    user-defined kinds named like those of `KINDS`, ``fails`` other than 0 and 1, a guide of several
    pins on a circle of radius 0, and a guide whose pins never slide (`_check_guide`)."""
    key_path = f"joint.{name}"
    check_pair(f"{key_path}.bodies", joint.bodies, scene, problems)
    x, y = np.array(joint.x_axis), np.array(joint.y_axis)
    lengths = float(np.linalg.norm(x)) * float(np.linalg.norm(y))
    if (
        min(np.abs(x).max(), np.abs(y).max()) < SMALLEST
        or float(np.linalg.norm(np.cross(x, y))) <= 1e-6 * lengths
    ):
        problems.add(
            f"{key_path}.y_axis",
            "must not be parallel to x_axis, and neither of them may be zero",
            list(joint.y_axis),
        )
    for kind in joint.kind:
        if kind in KINDS:
            reason = "is the name of a common joint kind; choose another name"
            problems.add(f"{key_path}.kind.{kind}", reason)
    if joint.fails not in (0.0, 1.0):
        problems.add(
            f"{key_path}.fails",
            "must be 0 (releases) or 1 (never does); disperse it with a discrete distribution",
            joint.fails,
        )
    if joint.guide is not None and joint.guide.pins > 1 and joint.guide.circle == 0.0:
        problems.add(f"{key_path}.guide.circle_m", "must be > 0 with more than one pin")
    if joint.guide is not None:
        _check_guide(name, joint, scene, problems)


def _check_guide(name: str, joint: Joint, scene: Scene, problems: Problems) -> None:
    """Add a problem if the guide pins of a joint never slide, in no phase and after no release, and
    so have no effect."""
    kinds = [phase.joints.get(name, "free") for phase in scene.phase]
    kinds += [release.to for release in scene.release if release.joint == name]
    known = [kind for kind in kinds if kind in KINDS or kind in joint.kind]
    if not any(leaves_pins_sliding(rows_of(joint, kind)) for kind in known):
        reason = (
            "does nothing: its pins act while the joint constrains y, z and at least two rotations "
            "but not x (slider, cylindrical, or a user-defined "
        )
        problems.add(
            f"joint.{name}.guide",
            f"{reason}kind); it is {', '.join(dict.fromkeys(kinds)) or 'free'} in the phases "
            "and after releases",
        )


def _check_histories(scene: Scene, problems: Problems) -> None:
    """Add a problem if a case would have too many rows of history, or too many steps of the length
    ``solver.step_s`` where that is given."""
    step = scene.run.history_step
    if step > 0.0 and scene.run.end_time / step > MOST_ROWS:
        problems.add(
            "run.history_step_s",
            f"gives more than {MOST_ROWS} rows of history per case up to {scene.run.end_time:g} s: "
            "give a longer step, or 0 for no histories",
            step,
        )
    if scene.solver.step is not None and scene.run.end_time / scene.solver.step > MOST_STEPS:
        problems.add(
            "solver.step_s",
            f"takes more than {MOST_STEPS} steps up to {scene.run.end_time:g} s: give a longer one",
            scene.solver.step,
        )


def _check_initial(scene: Scene, problems: Problems) -> None:
    """Add problems of the initial state: yaw beyond +-89 deg, a speed other than 0 although a joint
    of the first phase connects to the ground, and an altitude outside the 1976 atmosphere if that
    is used."""
    initial = scene.initial
    if abs(initial.yaw) > math.radians(89.0):
        problems.add(
            "initial.yaw_deg",
            "must lie within +-89 deg (the attitude angles are singular at 90)",
            float(f"{math.degrees(initial.yaw):.12g}"),
        )
    if holds_ground(scene) and initial.speed != 0.0:
        problems.add(
            "initial.speed_m_s",
            "must be 0 if a joint of the first phase connects to the ground",
            initial.speed,
        )
    if scene.environment.atmosphere == "us1976" and not 0.0 <= initial.altitude <= ATMOSPHERE_TOP:
        problems.add(
            "initial.altitude_m",
            "must lie in 0 to 86000 m, where the 1976 atmosphere is defined",
            initial.altitude,
        )


def _check_parameter(dispersion: Dispersion, scene: Scene, problems: Problems) -> None:
    """Add a problem if the parameter of a dispersion is one of three that vary only under a
    condition which is not met: ``fails`` only as discrete or constant 0 and 1, ``friction`` only if
    its nominal value is not 0, ``offset_m`` of a part of an outline only if the part is a frustum.
    All other parameters pass."""
    parameter = dispersion.parameter
    key_path, parts = f"dispersion.{parameter.key}", parameter.path.split(".")
    if parts[-1] == "fails" and not (
        dispersion.distribution in ("discrete", "constant")
        and set(dispersion.numbers) <= {0.0, 1.0}
    ):
        problems.add(key_path, "must be discrete, of 0 (releases) and 1 (never does)")
    if parts[-1] == "friction" and parameter_value(scene, parameter.path) == 0.0:
        problems.add(
            key_path, "can vary only if its nominal is > 0: friction that is 0 is not computed"
        )
    outline = scene.body[parts[1]].outline if parts[2:3] == ["outline"] else ()
    if (
        outline
        and parts[4] == "offset"
        and outline[item_names(outline).index(parts[3])].stations is None
    ):
        reason = "belongs to a frustum's axis, and this part has points: disperse points_m"
        problems.add(key_path, reason)


def check_dispersion(dispersion: Dispersion, scene: Scene, problems: Problems) -> None:
    """Add problems of a dispersion: of its parameter and kind of distribution (`_check_parameter`),
    and of values that are not finite or outside the bounds of the parameter, among them those of
    the initial yaw, of an altitude in the 1976 atmosphere, and of a time that ends a phase.

    A normal distribution without truncation is not checked against the bounds, as its tails have no
    end: a case sampled beyond a bound gets the status invalid-input.
    """
    parameter = dispersion.parameter
    key_path, numbers = f"dispersion.{parameter.key}", list(dispersion.numbers)
    tail = dispersion.distribution == "normal" and math.isinf(dispersion.numbers[2])
    finite = numbers[:2] if dispersion.distribution == "normal" else numbers
    if not all(math.isfinite(x * parameter.factor) for x in finite):
        problems.add(key_path, "the distribution and its nominal must be finite", numbers)
        return
    _check_parameter(dispersion, scene, problems)
    if tail:
        return
    low, high = (bound * parameter.factor for bound in dispersion.support)
    if not (
        math.isfinite(high - low) and math.isfinite(dispersion.support[1] - dispersion.support[0])
    ):
        problems.add(key_path, "the range of the distribution must be finite", numbers)
        return
    if max(-low, high) > LARGEST:
        problems.add(key_path, f"must reach no value above {LARGEST:g} in size, in SI", numbers)
        return
    for bound, shown in dict.fromkeys(zip((low, high), dispersion.support, strict=True)):
        _, allowed = (
            convert(bound, parameter.field.type) if parameter.field is not None else (None, None)
        )
        if allowed:
            problems.add(key_path, f"the distribution reaches {shown:g}, but the value {allowed}")
    if (
        parameter.path == "initial.altitude"
        and scene.environment.atmosphere == "us1976"
        and (low < 0.0 or high > ATMOSPHERE_TOP)
    ):
        problems.add(
            key_path,
            f"reaches {low:g} to {high:g} m; the 1976 atmosphere is defined from 0 to 86000 m",
        )
    if parameter.path == "initial.yaw" and max(-low, high) > math.radians(89.0):
        problems.add(
            key_path,
            f"reaches {math.degrees(low):g} to {math.degrees(high):g} deg; yaw must stay within "
            "+-89 deg",
        )
    if (
        parameter.path.startswith("phase.")
        and parameter.path.endswith(".until.time")
        and high >= scene.run.end_time
    ):
        problems.add(
            key_path,
            f"reaches {high:g} s; a phase must end before run.end_time_s = {scene.run.end_time:g}",
        )
