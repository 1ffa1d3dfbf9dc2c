"""Equivalent scenes: the same scene in other units, names or order, or with the bodies of joints
and springs swapped."""

import copy
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from oracles.independent import simulate
from oracles.random_scenes.draft import Tree
from oracles.random_scenes.rng import RandomStream
from sepmc.campaign.campaign import Campaign
from sepmc.scene.fields import fields_of, keys_of
from sepmc.scene.model import Scene
from sepmc.scene.read import parse_campaign

_SYMMETRIC = {"fixed", "slider", "revolute", "cylindrical", "spherical", "planar", "rod", "free"}


def in_units(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with every dimensional key in another unit."""
    return _in_units(tree, Scene, rng)


def _in_units(table: Tree, kind: type[msgspec.Struct], rng: RandomStream) -> Tree:
    """Table with its keys in other units."""
    fields = keys_of(fields_of(kind))
    result: Tree = {}
    for key, value in table.items():
        field, factor = fields.get(key, (None, 1.0))
        if field is None:
            result[key] = value
        elif field.table:
            result[key] = _in_units(value, field.table, rng)
        elif field.table_of_tables:
            result[key] = {
                name: _in_units(item, field.table_of_tables, rng) for name, item in value.items()
            }
        elif field.array_of_tables:
            result[key] = [_in_units(item, field.array_of_tables, rng) for item in value]
        elif field.units and not _has_names(value):
            other, other_factor = rng.choice(list(field.keys.items()))
            result[other] = _scaled(value, factor / other_factor)
        else:
            result[key] = value
    return result


def _has_names(value: Any) -> bool:
    """True for the name of a signal, or a list with one."""
    return isinstance(value, str) or (isinstance(value, list) and any(map(_has_names, value)))


def _scaled(value: Any, factor: float) -> Any:
    """Number, or nested lists of numbers, times a factor."""
    return [_scaled(x, factor) for x in value] if isinstance(value, list) else value * factor


def renamed(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with other names of all bodies, joints, springs, motors, loads, phases and custom
    kinds."""
    del rng
    bodies = {name: f"{name}_1" for name in tree["body"]} | {"ground": "ground"}
    joints = {name: f"n{name}" for name in tree.get("joint", {})}
    motors = {item["name"]: f"m_{item['name']}" for item in tree.get("motor", [])}
    new = copy.deepcopy(tree)
    new["body"] = {bodies[name]: body for name, body in new["body"].items()}
    new["joint"] = {joints[name]: joint for name, joint in new.get("joint", {}).items()}
    for item in [*new["joint"].values(), *new.get("spring", [])]:
        item["bodies"] = [bodies[name] for name in item["bodies"]]
    for joint in new["joint"].values():
        joint["kind"] = {f"{kind}_k": axes for kind, axes in joint.get("kind", {}).items()}
    for key in ("motor", "load"):
        for item in new.get(key, []):
            item["body"] = bodies[item["body"]]
            item["name"] = f"m_{item['name']}" if key == "motor" else f"{item['name']}9"
            item |= {"ignition": _renamed_ignition(item, joints)} if "ignition" in item else {}
    for signal in new.get("signal", []):
        signal["formula"] = _renamed_formula(signal["formula"], bodies, joints)
    for phase in new["phase"]:
        phase["joints"] = {
            joints[name]: f"{kind}_k" if kind in tree["joint"][name].get("kind", {}) else kind
            for name, kind in phase.get("joints", {}).items()
        }
        if "until" in phase:
            phase["until"] = _renamed_in(phase["until"], bodies, joints, motors)
        phase["name"] = f"P{phase['name']}"
    for release in new.get("release", []):
        custom = tree["joint"][release["joint"]].get("kind", {})
        release |= {"name": f"R{release['name']}", "joint": joints[release["joint"]]}
        release["to"] = (
            f"{release['to']}_k" if release.get("to") in custom else release.get("to", "free")
        )
        release["when"] = _renamed_in(release["when"], bodies, joints, motors)
    for event in new.get("event", []):
        event |= {
            "name": f"E{event['name']}",
            "when": _renamed_in(event["when"], bodies, joints, motors),
        }
    for entry in new.get("proximity", []):
        entry |= {
            "name": f"N{entry['name']}",
            "body": bodies[entry["body"]],
            "joint": joints[entry["joint"]],
        }
    for clearance in new.get("clearance", []):
        clearance |= {
            "name": f"C{clearance['name']}",
            "bodies": [bodies[name] for name in clearance["bodies"]],
        }
        clearance |= {"after": joints[clearance["after"]]} if "after" in clearance else {}
    new["output"] = {
        key: [(bodies if key == "transverse" else joints)[name] for name in names]
        for key, names in new.get("output", {}).items()
    }
    return new


def _renamed_formula(text: str, bodies: dict[str, str], joints: dict[str, str]) -> str:
    """Formula with the new names of bodies and joints."""

    def new(name: re.Match[str]) -> str:
        first, *others = name[0].split(".")
        if len(others) == 2:
            names = joints if first == "joint" else {}
            return f"{first}.{names.get(others[0], others[0])}.{others[1]}"
        return ".".join([bodies[first], *others])

    return re.sub(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+", new, text)


def _renamed_ignition(motor: Tree, joints: dict[str, str]) -> Tree:
    """Ignition of a motor with the new names."""
    new = {"event": lambda name: f"E{name}", "release": lambda name: f"R{name}"}
    new |= {"joint": joints.__getitem__}
    return {
        key: new[key](value) if key in new else value for key, value in motor["ignition"].items()
    }


def _renamed_in(
    until: Tree, bodies: dict[str, str], joints: dict[str, str], motors: dict[str, str]
) -> Tree:
    """Condition, nested ones included, with the new names."""
    new = dict(until)
    for key, names in (("joint", joints), ("body", bodies), ("burn_out", motors)):
        if key in new:
            new[key] = names[new[key]]
    for key in ("any", "all"):
        if key in new:
            new[key] = [_renamed_in(part, bodies, joints, motors) for part in new[key]]
    return new


def reordered(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with its bodies in the opposite order."""
    del rng
    return {**tree, "body": dict(reversed(tree["body"].items()))}


def swapped(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with the two bodies swapped in springs along a line, and in joints whose rows are
    symmetric."""
    del rng
    new = copy.deepcopy(tree)
    ordered = _ordered_joints(tree)
    for name, joint in new.get("joint", {}).items():
        kinds = {phase.get("joints", {}).get(name, "free") for phase in tree["phase"]}
        kinds |= {
            release.get("to", "free")
            for release in tree.get("release", [])
            if release["joint"] == name
        }
        if kinds <= _SYMMETRIC and name not in ordered:
            joint["bodies"] = joint["bodies"][::-1]  # a new list: a spring may share the old one
            if "apart" in joint:
                joint["apart"] = -joint["apart"]
            if "second_point_m" in joint:
                joint["point_m"], joint["second_point_m"] = (
                    joint["second_point_m"],
                    joint["point_m"],
                )
    for spring in new.get("spring", []):
        if "axis" not in spring:
            spring["bodies"] = spring["bodies"][::-1]
            spring["point_m"], spring["second_point_m"] = (
                spring["second_point_m"],
                spring["point_m"],
            )
    return new


def _ordered_joints(tree: Tree) -> set[str]:
    """Joints where the order of the bodies matters: for conditions, pins, increments or load
    outputs."""
    waiting = [phase["until"] for phase in tree["phase"] if "until" in phase] + [
        item["when"] for key in ("release", "event") for item in tree.get(key, [])
    ]
    names = set(tree.get("output", {}).get("loads", [])) | {
        entry["joint"] for entry in tree.get("proximity", [])
    }
    names |= {name for name, joint in tree.get("joint", {}).items() if "guide" in joint}
    formulas = " ".join(signal["formula"] for signal in tree.get("signal", []))
    names |= set(re.findall(r"\bjoint\.(\w+)\.", formulas))
    while waiting:
        until = waiting.pop()
        names |= {until["joint"]} if "joint" in until else set()
        waiting += [part for key in ("any", "all") for part in until.get(key, [])]
    return names


def halved(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with every motor split in two of half the thrust."""
    del rng
    motors = []
    for motor in tree.get("motor", []):
        if isinstance(motor["thrust_N"], str):
            motors.append(motor)
            continue
        motors += [
            {**motor, "thrust_N": 0.5 * motor["thrust_N"]},
            {**motor, "name": f"{motor['name']}_2", "thrust_N": 0.5 * motor["thrust_N"]},
        ]
    return {**tree, "motor": motors}


def _first_end(tree: Tree) -> float:
    """End of the first phase, s, by the independent simulation."""
    try:
        events = simulate(
            Campaign(parse_campaign(tree, "nominal")).nominal().to_dict(), rtol=1e-8
        ).events
    except ValueError:  # not known to the independent simulation
        return math.inf
    return min((time for time, text in events if text.startswith("phase ")), default=math.inf)


def interrupted(tree: Tree, rng: RandomStream) -> Tree:
    """Scene with a phase boundary soon after the start at which nothing changes; unchanged if the
    first phase waits for a crossing that could have occurred by then."""
    if "until" in tree["phase"][0] and _is_crossed(tree["phase"][0]["until"]):
        return tree
    first, ends = tree["phase"][0], [phase.get("until", {}) for phase in tree["phase"]]
    times = [until.get("time_s", 1.0) for until in ends]
    times += [part.get("time_s", 1.0) for key in ("any", "all") for part in ends[0].get(key, [])]
    soon = min(*times, rng.uniform(0.01, 0.05) * tree["run"]["end_time_s"], _first_end(tree))
    idle = {**first, "name": "before_all", "until": {"time_s": 0.5 * soon}}
    return {**tree, "phase": [idle, *tree["phase"]]}


def _is_crossed(until: Tree) -> bool:
    """True if part of a condition is met by a crossing only, not by a value beyond a limit."""
    parts = [part for key in ("any", "all") for part in until.get(key, [])]
    crossed = "direction" in until or any(key.startswith("vertical_speed") for key in until)
    return crossed or any(map(_is_crossed, parts))


EQUIVALENTS: dict[str, Callable[[Tree, RandomStream], Tree]] = {
    "other units": in_units,
    "other names": renamed,
    "other order of bodies": reordered,
    "bodies of joints and springs swapped": swapped,
    "motors in halves": halved,
    "an idle boundary": interrupted,
}


_OF_JOINT = (
    *(
        "separation_speed_m_s",
        "separation_distance_mm",
        "release_time_s",
        "peak_force_",
        "peak_moment_",
        "force_impulse_",
    ),
    *("moment_impulse_", "time_in_guide_s", "pin", "jam_friction"),
)
_TIP_OFF = ("x_deg_s", "y_deg_s", "z_deg_s", "transverse_rate_deg_s")
_OF_CLEARANCE = (
    "clearance_mm",
    "clearance_time_s",
    "clearance_station_m",
    "clearance_y_m",
    "clearance_z_m",
    "recontact",
)


def _at_event(tree: Tree) -> Iterator[tuple[str, str]]:
    """Endings of the columns of an event, by the old and the new names."""
    yield "time_s", "time_s"
    for body in tree["body"]:
        for end in (
            *("roll_deg", "yaw_deg", "pitch_deg", "transverse_rate_deg_s"),
            *(f"omega_{x}_deg_s" for x in "xyz"),
        ):
            yield f"{body}_{end}", f"{body}_1_{end}"
    joints = list(tree.get("joint", {}))
    for joint in joints:
        for end in ("separation_speed_m_s", "separation_distance_mm"):
            yield (end, end) if len(joints) == 1 else (f"{joint}_{end}", f"n{joint}_{end}")
    for clearance in tree.get("clearance", []):
        yield f"{clearance['name']}_clearance_mm", f"C{clearance['name']}_clearance_mm"


def _partial_releases(tree: Tree) -> Iterator[tuple[str, str]]:
    """Columns of the times of partial releases, by the old and the new names."""
    for release in tree.get("release", []):
        joint, kind = release["joint"], release.get("to", "free")
        custom = kind in tree["joint"][joint].get("kind", {})
        old = f"release_to_{kind.replace('-', '_')}"
        new = f"{old}_k" if custom else old
        single = len(tree["joint"]) == 1
        yield (
            (f"{old}_time_s", f"{new}_time_s")
            if single
            else (f"{joint}_{old}_time_s", f"n{joint}_{new}_time_s")
        )


def equivalent_column(column: str, variant: str, tree: Tree) -> str | None:
    """Column of an equivalent scene that must equal ``column``; None if there is none."""
    joints, single = list(tree.get("joint", {})), len(tree.get("joint", {})) == 1
    if variant != "other names":  # separations refer to an axis of the other body
        swapped_axes = variant == "bodies of joints and springs swapped"
        return None if swapped_axes and "separation_" in column else column
    if single and column in ("separation_speed_m_s", "separation_distance_mm", "release_time_s"):
        return column
    renamed_columns = {
        f"{name}_{end}": f"C{name}_{end}"
        for name in (c["name"] for c in tree.get("clearance", []))
        for end in _OF_CLEARANCE
    }
    for motor in (m["name"] for m in tree.get("motor", [])):
        renamed_columns[f"{motor}_ignition_time_s"] = f"m_{motor}_ignition_time_s"
    for spring in (s["name"] for s in tree.get("spring", [])):  # springs keep their names
        renamed_columns[f"{spring}_stroke_end_time_s"] = f"{spring}_stroke_end_time_s"
    renamed_columns |= dict(_partial_releases(tree))
    for event in (e["name"] for e in tree.get("event", [])):
        renamed_columns |= {f"{event}_{old}": f"E{event}_{new}" for old, new in _at_event(tree)}
    if column in renamed_columns:
        return renamed_columns[column]
    for joint in sorted(joints, key=len, reverse=True):
        for body in tree["body"]:
            start = f"{joint}_tip_off_{body}_"
            if column.startswith(start) and column[len(start) :] in _TIP_OFF:
                return f"n{joint}_tip_off_{body}_1_{column[len(start) :]}"
        if column.startswith(f"{joint}_") and column[len(joint) + 1 :].startswith(_OF_JOINT):
            return f"n{column}"
    body = max((b for b in tree["body"] if column.startswith(f"{b}_")), key=len, default="")
    return f"{body}_1{column[len(body) :]}"
