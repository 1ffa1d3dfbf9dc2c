"""What motors must obey that light at an instant of the flight: it exists, and may come before
they light."""

from collections.abc import Iterator

from sepmc.scene.kinds import rows_of
from sepmc.scene.load_checks import check_known
from sepmc.scene.messages import Problems
from sepmc.scene.model import Condition, Ignition, Scene

_INSTANTS = ("event", "release", "joint")


def check_ignitions(scene: Scene, problems: Problems) -> None:
    """Events, releases and joints that motors wait for."""
    for motor in scene.motor:
        if motor.trigger is not None:
            _check_instant(f"motor.{motor.name}.ignition", motor.trigger, scene, problems)
    if not problems:
        lighting = _may_light(scene)
        for motor in scene.motor:
            if motor.name not in lighting:
                problems.add(
                    f"motor.{motor.name}.ignition",
                    "never comes: it waits for a burn-out, its own or that of another motor, that "
                    "itself waits for this ignition",
                )


def _check_instant(place: str, trigger: Ignition, scene: Scene, problems: Problems) -> None:
    given = [key for key in _INSTANTS if getattr(trigger, key) is not None]
    if len(given) != 1:
        said = f", not {' and '.join(given)}" if given else ""
        problems.add(place, f"give one of {', '.join(_INSTANTS)}{said}")
        return
    known = {
        "event": [event.name for event in scene.event],
        "release": [release.name for release in scene.release],
        "joint": list(scene.joint),
    }
    key, name = given[0], getattr(trigger, given[0])
    check_known(f"{place}.{key}", name, known[key], key, problems)
    if trigger.joint not in scene.joint or problems:
        return
    if _is_free(scene, name, scene.phase[0].joints.get(name, "free")):
        said = "is free from the start; a motor that lights at a given time has ignition_s"
        problems.add(f"{place}.joint", said, name)
    elif not any(_is_free(scene, name, kind) for kind in _later_kinds(scene, name)):
        problems.add(f"{place}.joint", "is never free: no phase or [[release]] frees it", name)


def _is_free(scene: Scene, joint: str, kind: str) -> bool:
    return not rows_of(scene.joint[joint], kind)


def _later_kinds(scene: Scene, joint: str) -> Iterator[str]:
    """Kinds that a joint may have after the first phase begins."""
    for phase in scene.phase[1:]:
        yield phase.joints.get(joint, "free")
    for release in scene.release:
        if release.joint == joint:
            yield release.to


def _may_light(scene: Scene) -> set[str]:
    """Motors that may light, those first that wait for no burn-out, then those that wait for what
    they bring about."""
    lighting = {motor.name for motor in scene.motor if motor.trigger is None}
    while True:
        comes = _may_come(scene, lighting)
        more = lighting | {
            motor.name
            for motor in scene.motor
            if motor.trigger is not None
            and any((key, getattr(motor.trigger, key)) in comes for key in _INSTANTS)
        }
        if more == lighting:
            return lighting
        lighting = more


def _may_come(scene: Scene, lighting: set[str]) -> set[tuple[str, str]]:
    """Events and releases that may come, and joints that may become free, where only these motors
    may light."""
    found = {("event", one.name) for one in scene.event if _may_be_met(one.when, lighting)}
    releases = [one for one in scene.release if _may_be_met(one.when, lighting)]
    found |= {("release", one.name) for one in releases}
    kinds = [(one.joint, one.to) for one in releases]
    for before, phase in zip(scene.phase, scene.phase[1:], strict=False):
        if before.until is None or not _may_be_met(before.until, lighting):
            break
        kinds += [(joint, phase.joints.get(joint, "free")) for joint in scene.joint]
    return found | {("joint", joint) for joint, kind in kinds if _is_free(scene, joint, kind)}


def _may_be_met(until: Condition, lighting: set[str]) -> bool:
    """Whether a condition may be met where only these motors may light: all others but burn-outs
    may."""
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
        or until.burn_out in lighting
        or any(_may_be_met(part, lighting) for part in until.any)
        or (bool(until.all) and all(_may_be_met(part, lighting) for part in until.all))
    )
