"""Checks of phases, releases and conditions: the joints that they name exist, never gain
constraints, and phases can end."""

import math

from sepmc.routines import layout as at
from sepmc.scene.kinds import KINDS, is_subset, rows_of
from sepmc.scene.limits import SMALLEST
from sepmc.scene.load_checks import SHORTEST, check_known
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import GROUND, Condition, Scene

_OF_JOINT = {
    "stroke": "stroke_m",
    "distance": "distance_m",
    "angle": "angle_deg",
    "force": "force_N",
    "moment": "moment_N_m",
}
_OF_BODY = {"altitude": "altitude_m", "vertical_speed": "vertical_speed_m_s"}


def holds_ground(scene: Scene) -> bool:
    """True if, in the first phase, a joint that is not free connects a body to the ground."""
    if not scene.phase:
        return False
    kinds = scene.phase[0].joints
    return any(
        GROUND in joint.bodies and kinds.get(name, "free") != "free"
        for name, joint in scene.joint.items()
    )


def check_phases(scene: Scene, problems: Problems) -> None:
    """Add problems of phases, releases and events: of their conditions, the kinds that they give to
    joints, phases without an end (except the last), and the ``until.time_s`` of phases, which must
    not decrease from phase to phase. If ``problems`` is still empty then, also of those of earlier
    checks, add those of joints that gain constraints, releases that remove none, and rods."""
    if not scene.phase:
        problems.add("phase", "at least one [[phase]] is needed")
    last_time = 0.0
    for number, phase in enumerate(scene.phase):
        key_path = f"phase.{phase.name}"
        for joint, kind in phase.joints.items():
            _check_kind(f"{key_path}.joints", joint, kind, scene, problems)
        is_last = number == len(scene.phase) - 1
        until = phase.until
        if until is None:
            if not is_last:
                problems.add(
                    key_path,
                    "never ends: give it until = { time_s = ... } or { joint = ..., stroke_mm = "
                    "... }",
                )
            continue
        if is_last:
            problems.add(f"{key_path}.until", "the last phase ends at run.end_time_s; remove until")
        _check_condition(f"{key_path}.until", until, scene, problems)
        _check_can_move(f"{key_path}.until", until, phase.joints, scene, problems)
        if until.time is not None:
            if until.time < last_time - SHORTEST:  # closer times are equal
                problems.add(
                    f"{key_path}.until.time_s",
                    f"must be >= {last_time:g}, the time_s of an earlier phase",
                    until.time,
                )
            if until.time >= scene.run.end_time and not is_last:
                reason = (
                    f"must be < run.end_time_s = {scene.run.end_time:g}, or it never ends the phase"
                )
                problems.add(f"{key_path}.until.time_s", reason, until.time)
            last_time = max(last_time, until.time)
    for release in scene.release:
        _check_kind(f"release.{release.name}", release.joint, release.to, scene, problems)
        _check_condition(f"release.{release.name}.when", release.when, scene, problems)
    for event in scene.event:
        _check_condition(f"event.{event.name}.when", event.when, scene, problems)
    if not problems:
        _check_only_releases(scene, problems)
        _check_rods(scene, problems)


def _check_can_move(
    key_path: str, until: Condition, kinds: dict[str, str], scene: Scene, problems: Problems
) -> None:
    """Add a problem for each key of a condition, or of those nested in it, that asks for a motion
    (stroke, distance, angle) which the joint, by ``kinds`` of the phase, cannot make, nor after any
    of its releases: this key is never met. Releases count whether they occur within the phase or
    not."""
    joint, kind = until.joint, kinds.get(until.joint or "", "free")
    possible = [kind, *(release.to for release in scene.release if release.joint == joint)]
    if joint in scene.joint and all(_known(joint, each, scene) for each in possible):
        rows = [rows_of(scene.joint[joint], each) for each in possible]
        is_constrained = {
            "stroke": all(0 in each for each in rows),
            "distance": all({0, 1, 2} <= set(each) for each in rows),
            "angle": all(sum(at.ROTATION <= row < at.ROD for row in each) == 3 for each in rows),
        }
        for key, constrained in is_constrained.items():
            if getattr(until, key) is not None and constrained:
                reason = f"is {kind!r} in this phase, which has no {key}, so that key is never met"
                problems.add(f"{key_path}.joint", reason, joint)
    for key, items in (("any", until.any), ("all", until.all)):
        for number, item in enumerate(items):
            _check_can_move(f"{key_path}.{key}.{number}", item, kinds, scene, problems)


def _known(joint: str, kind: str, scene: Scene) -> bool:
    """True if a joint exists and ``kind`` is one of `KINDS` or of the joint's own kinds."""
    return joint in scene.joint and (kind in KINDS or kind in scene.joint[joint].kind)


def _check_kind(key_path: str, joint: str, kind: str, scene: Scene, problems: Problems) -> None:
    """Add a problem if a joint does not exist, or if ``kind``, which the table at ``key_path``
    gives it, is not a kind that it can have."""
    check_known(key_path, joint, scene.joint, "joint", problems)
    if joint in scene.joint and not _known(joint, kind, scene):
        kinds = [*KINDS, *scene.joint[joint].kind]
        problems.add(f"{key_path}.{joint}", f"no such joint kind; {nearest(kind, kinds)}", kind)


def _check_condition(key_path: str, until: Condition, scene: Scene, problems: Problems) -> None:
    """Add problems of a condition and of those nested in it: nothing to wait for, a joint, body,
    motor or spring that does not exist, a motor that never burns out, keys that need others, or a
    direction that does not belong to exactly one quantity."""
    on_joint = [key for key in _OF_JOINT if getattr(until, key) is not None]
    of_body = [key for key in _OF_BODY if getattr(until, key) is not None]
    if (
        until.time is None
        and until.burn_out is None
        and until.spring is None
        and not on_joint
        and not of_body
        and not until.any
        and not until.all
    ):
        missing = (
            "with joint a stroke_m, distance_m, angle_deg, force_N or moment_N_m"
            if until.joint
            else "joint and stroke_m, ..."
        )
        problems.add(
            key_path,
            f"is never met: give time_s, burn_out, spring, {missing}, body and altitude_m or "
            "vertical_speed_m_s, any or all",
        )
        return
    if until.joint is not None:
        check_known(f"{key_path}.joint", until.joint, scene.joint, "joint", problems)
        if not on_joint:
            problems.add(
                f"{key_path}.joint",
                f"needs at least one of {', '.join(_OF_JOINT.values())}",
                until.joint,
            )
    elif on_joint:
        reason = "needs joint = NAME in the same table"
        problems.add(f"{key_path}.{_OF_JOINT[on_joint[0]]}", reason)
    if until.burn_out is not None:
        motors = {motor.name: motor for motor in scene.motor}
        check_known(f"{key_path}.burn_out", until.burn_out, motors, "motor", problems)
        if (
            until.burn_out in motors
            and math.isinf(motors[until.burn_out].burn)
            and motors[until.burn_out].profile is None
        ):
            problems.add(
                f"{key_path}.burn_out",
                "names a motor that burns for ever: give that motor burn_s or a profile",
                until.burn_out,
            )
    if until.spring is not None:
        springs = [spring.name for spring in scene.spring]
        check_known(f"{key_path}.spring", until.spring, springs, "spring", problems)
    if (until.body is None) != (not of_body):
        reason = "body needs altitude_m or vertical_speed_m_s, and these need body: give both"
        problems.add(key_path, reason)
    if until.direction is not None and len(on_joint + of_body) != 1:
        _refuse_direction(key_path, until, [*on_joint, *of_body], problems)
    if until.body is not None:
        check_known(f"{key_path}.body", until.body, scene.body, "body", problems)
    for key, items in (("any", until.any), ("all", until.all)):
        for number, item in enumerate(items):
            _check_condition(f"{key_path}.{key}.{number}", item, scene, problems)


def _refuse_direction(
    key_path: str, until: Condition, quantities: list[str], problems: Problems
) -> None:
    """Add the problem of a condition that has a ``direction`` but not exactly one quantity with a
    threshold, which the caller has found; ``quantities`` are the keys of those that it has: none,
    or several."""
    keys = _OF_JOINT | _OF_BODY
    reason = (
        "belongs to one quantity: give each its own table, in any = [...]; here are "
        + " and ".join(keys[key] for key in quantities)
        if quantities
        else f"belongs to a quantity with a threshold: one of {', '.join(keys.values())}; "
        "a time, a burn-out and the end of a spring come once"
    )
    problems.add(f"{key_path}.direction", reason, until.direction)


def _check_only_releases(scene: Scene, problems: Problems) -> None:
    """Add a problem for each joint that gains constraints from one phase to the next (contact and
    capture are not modelled), for each release that removes no constraint in any phase, and, if
    there is no problem so far, those of `_check_comparable`."""
    for name, joint in scene.joint.items():
        kinds = [phase.joints.get(name, "free") for phase in scene.phase]
        for before, after, first, then in zip(
            scene.phase, scene.phase[1:], kinds, kinds[1:], strict=False
        ):
            if not is_subset(rows_of(joint, then), rows_of(joint, first)):
                unnamed = "" if name in before.joints else " (a joint not named in a phase is free)"
                reason = (
                    f"in phase {before.name!r} it is {first!r}{unnamed}; a joint cannot gain "
                    "constraints"
                )
                problems.add(f"phase.{after.name}.joints.{name}", reason, then)
        for release in scene.release:
            if release.joint == name and not any(
                is_subset(rows_of(joint, release.to), rows_of(joint, kind))
                and rows_of(joint, release.to) != rows_of(joint, kind)
                for kind in kinds
            ):
                reason = (
                    f"releases nothing: {name} is {', '.join(dict.fromkeys(kinds))} in the phases; "
                    "must be a kind that constrains less than one of these"
                )
                problems.add(f"release.{release.name}.to", reason, release.to)
        if not problems:
            _check_comparable(name, kinds, scene, problems)


def _check_comparable(name: str, kinds: list[str], scene: Scene, problems: Problems) -> None:
    """Add a problem for each release of a joint to a kind that neither implies nor is implied by a
    kind that the joint can have by then. A release may come in any phase and after any other one,
    so of each two kinds the constraints of one must include those of the other. ``kinds`` are those
    of the joint in the phases."""
    joint, possible = scene.joint[name], dict.fromkeys(kinds)
    for release in scene.release:
        if release.joint != name:
            continue
        for kind in possible:
            pair = rows_of(joint, release.to), rows_of(joint, kind)
            if not is_subset(*pair) and not is_subset(pair[1], pair[0]):
                reason = (
                    f"{name} may be {kind!r} by then, which does not constrain all that "
                    f"{release.to!r} does; a joint cannot gain constraints"
                )
                problems.add(f"release.{release.name}.to", reason, release.to)
                break
        possible[release.to] = None


def _check_rods(scene: Scene, problems: Problems) -> None:
    """Add a problem for each rod that lacks a second point or whose two points do not differ, and
    for each joint of another kind (except free) whose two points do."""
    for name, joint in scene.joint.items():
        kinds = [phase.joints[name] for phase in scene.phase if name in phase.joints]
        second = joint.second_point
        has_length = second is not None and math.dist(joint.point, second) > SMALLEST
        if "rod" in kinds and not has_length:
            problems.add(
                f"joint.{name}.second_point_m",
                "is needed by a rod: its end on the second body, which must differ from point_m",
            )
        for kind in kinds:
            if has_length and kind not in ("rod", "free"):
                problems.add(
                    f"joint.{name}.second_point_m",
                    f"must not differ from point_m where the joint is {kind!r}",
                )
