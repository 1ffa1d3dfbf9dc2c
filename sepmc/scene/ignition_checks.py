"""Checks of motors that an event, a release or a joint ignites: this trigger must exist and be able
to occur."""

from collections.abc import Iterator

from sepmc.scene.kinds import rows_of
from sepmc.scene.load_checks import check_known
from sepmc.scene.messages import Problems
from sepmc.scene.model import Condition, Ignition, Scene

_TRIGGERS = ("event", "release", "joint")


def check_ignitions(scene: Scene, problems: Problems) -> None:
    """Add a problem for each motor whose trigger is not valid, or can never occur because it waits
    for a burn-out that in turn needs this motor. The latter is checked only if ``problems`` is
    empty by then."""
    for motor in scene.motor:
        if motor.trigger is not None:
            _check_trigger(f"motor.{motor.name}.ignition", motor.trigger, scene, problems)
    if not problems:
        igniting = _motors_that_may_light(scene)
        for motor in scene.motor:
            if motor.name not in igniting:
                problems.add(
                    f"motor.{motor.name}.ignition",
                    "never comes: it waits for a burn-out, its own or that of another motor, that "
                    "itself waits for this ignition",
                )


def _check_trigger(key_path: str, trigger: Ignition, scene: Scene, problems: Problems) -> None:
    """Add a problem, at ``key_path``, unless a trigger names exactly one event, release or joint,
    which exists; a joint must be constrained in the first phase and become free later. Whether a
    joint is so is checked only if ``problems`` is still empty."""
    keys = [key for key in _TRIGGERS if getattr(trigger, key) is not None]
    if len(keys) != 1:
        others = f", not {' and '.join(keys)}" if keys else ""
        problems.add(key_path, f"give exactly one of {', '.join(_TRIGGERS)}{others}")
        return
    known = {
        "event": [event.name for event in scene.event],
        "release": [release.name for release in scene.release],
        "joint": list(scene.joint),
    }
    key, name = keys[0], getattr(trigger, keys[0])
    check_known(f"{key_path}.{key}", name, known[key], key, problems)
    if trigger.joint not in scene.joint or problems:
        return
    if _is_free(scene, name, scene.phase[0].joints.get(name, "free")):
        reason = "is free from the start; a motor that ignites at a given time has ignition_s"
        problems.add(f"{key_path}.joint", reason, name)
    elif not any(_is_free(scene, name, kind) for kind in _later_kinds(scene, name)):
        problems.add(f"{key_path}.joint", "is never free: no phase or [[release]] frees it", name)


def _is_free(scene: Scene, joint: str, kind: str) -> bool:
    """True if a kind of a joint has no constraint rows."""
    return not rows_of(scene.joint[joint], kind)


def _later_kinds(scene: Scene, joint: str) -> Iterator[str]:
    """Yield the kinds of a joint in all phases but the first, and those that releases give it."""
    for phase in scene.phase[1:]:
        yield phase.joints.get(joint, "free")
    for release in scene.release:
        if release.joint == joint:
            yield release.to


def _motors_that_may_light(scene: Scene) -> set[str]:
    """Names of the motors that can ignite: those without a trigger, and, until no more are added,
    those whose trigger can occur if the motors found so far burn."""
    motors = {motor.name for motor in scene.motor if motor.trigger is None}
    while True:
        triggers = _triggers_that_may_occur(scene, motors)
        more = motors | {
            motor.name
            for motor in scene.motor
            if motor.trigger is not None
            and any((key, getattr(motor.trigger, key)) in triggers for key in _TRIGGERS)
        }
        if more == motors:
            return motors
        motors = more


def _triggers_that_may_occur(scene: Scene, motors: set[str]) -> set[tuple[str, str]]:
    """Events and releases that can occur, and joints that can become free, if only ``motors`` can
    ignite: pairs such as ("event", name), ("release", name), ("joint", name). Motors that these
    would ignite in turn are not followed; `_motors_that_may_light` repeats the call for that."""
    triggers = {("event", one.name) for one in scene.event if _may_be_met(one.when, motors)}
    releases = [one for one in scene.release if _may_be_met(one.when, motors)]
    triggers |= {("release", one.name) for one in releases}
    kinds = [(one.joint, one.to) for one in releases]
    for before, phase in zip(scene.phase, scene.phase[1:], strict=False):
        if before.until is None or not _may_be_met(before.until, motors):
            break
        kinds += [(joint, phase.joints.get(joint, "free")) for joint in scene.joint]
    return triggers | {("joint", joint) for joint, kind in kinds if _is_free(scene, joint, kind)}


def _may_be_met(until: Condition, motors: set[str]) -> bool:
    """True if a condition can be met when only ``motors`` can ignite. Conditions on anything but a
    burn-out are taken to be possible."""
    keys = (
        "time",
        "spring",
        "stroke",
        "distance",
        "angle",
        "force",
        "moment",
        "altitude",
        "vertical_speed",
    )
    return (
        any(getattr(until, key) is not None for key in keys)
        or until.burn_out in motors
        or any(_may_be_met(part, motors) for part in until.any)
        or (bool(until.all) and all(_may_be_met(part, motors) for part in until.all))
    )
