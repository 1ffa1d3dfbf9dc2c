"""One scene written in another way, that must fly the same: other units, names, order; joints and
springs the other way round."""

import copy
import math
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from oracles.independent import simulate
from oracles.random_scenes.draft import Tree
from oracles.random_scenes.rng import Dice
from sepmc.campaign.campaign import Campaign
from sepmc.scene.fields import fields_of, keys_of
from sepmc.scene.model import Scene
from sepmc.scene.read import parse_campaign

_TURNED = {"fixed", "slider", "revolute", "cylindrical", "spherical", "planar", "rod", "free"}
_MAY_BE_ABSENT = "s"  # the unit of times, whose zero is written in any unit


def in_units(tree: Tree, dice: Dice) -> Tree:
    """Every dimensional key in another unit."""
    return _in_units(tree, Scene, dice)


def _in_units(table: Tree, kind: type[msgspec.Struct], dice: Dice) -> Tree:
    fields = keys_of(fields_of(kind))
    result: Tree = {}
    for key, value in table.items():
        field, factor = fields.get(key, (None, 1.0))
        if field is None:
            result[key] = value
        elif field.table:
            result[key] = _in_units(value, field.table, dice)
        elif field.table_of_tables:
            result[key] = {
                name: _in_units(item, field.table_of_tables, dice) for name, item in value.items()
            }
        elif field.array_of_tables:
            result[key] = [_in_units(item, field.array_of_tables, dice) for item in value]
        elif field.units:
            other, other_factor = dice.pick(list(field.keys.items()))
            result[other] = _scaled(value, factor / other_factor)
        else:
            result[key] = value
    return result


def _scaled(value: Any, factor: float) -> Any:
    return [_scaled(x, factor) for x in value] if isinstance(value, list) else value * factor


def renamed(tree: Tree, dice: Dice) -> Tree:
    """Every body, joint, spring, motor, load, phase and own kind with another name, made of the old
    one."""
    del dice
    bodies = {name: f"{name}_1" for name in tree["body"]} | {"ground": "ground"}
    joints = {name: f"n{name}" for name in tree.get("joint", {})}
    motors = {item["name"]: f"m_{item['name']}" for item in tree.get("motor", [])}
    new = copy.deepcopy(tree)
    new["body"] = {bodies[name]: body for name, body in new["body"].items()}
    new["joint"] = {joints[name]: joint for name, joint in new.get("joint", {}).items()}
    for item in [*new["joint"].values(), *new.get("spring", [])]:
        item["bodies"] = [bodies[name] for name in item["bodies"]]
    for joint in new["joint"].values():
        joint["kind"] = {f"{kind}_k": held for kind, held in joint.get("kind", {}).items()}
    for key in ("motor", "load"):
        for item in new.get(key, []):
            item["body"] = bodies[item["body"]]
            item["name"] = f"m_{item['name']}" if key == "motor" else f"{item['name']}9"
            item |= {"ignition": _waiting(item, joints)} if "ignition" in item else {}
    for phase in new["phase"]:
        phase["joints"] = {
            joints[name]: f"{kind}_k" if kind in tree["joint"][name].get("kind", {}) else kind
            for name, kind in phase.get("joints", {}).items()
        }
        if "until" in phase:
            phase["until"] = _renamed_in(phase["until"], bodies, joints, motors)
        phase["name"] = f"P{phase['name']}"
    for release in new.get("release", []):
        own = tree["joint"][release["joint"]].get("kind", {})
        release |= {"name": f"R{release['name']}", "joint": joints[release["joint"]]}
        release["to"] = (
            f"{release['to']}_k" if release.get("to") in own else release.get("to", "free")
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


def _waiting(motor: Tree, joints: dict[str, str]) -> Tree:
    """What a motor waits for, with the new names."""
    new = {"event": lambda name: f"E{name}", "release": lambda name: f"R{name}"}
    new |= {"joint": joints.__getitem__}
    return {key: new[key](it) if key in new else it for key, it in motor["ignition"].items()}


def _renamed_in(
    until: Tree, bodies: dict[str, str], joints: dict[str, str], motors: dict[str, str]
) -> Tree:
    """A condition, and those inside it, with the new names."""
    new = dict(until)
    for key, names in (("joint", joints), ("body", bodies), ("burn_out", motors)):
        if key in new:
            new[key] = names[new[key]]
    for key in ("any", "all"):
        if key in new:
            new[key] = [_renamed_in(part, bodies, joints, motors) for part in new[key]]
    return new


def reordered(tree: Tree, dice: Dice) -> Tree:
    """Bodies in the opposite order."""
    del dice
    return {**tree, "body": dict(reversed(tree["body"].items()))}


def turned(tree: Tree, dice: Dice) -> Tree:
    """Springs along a line, and joints that hold the same seen from either body, the other way
    round."""
    del dice
    new = copy.deepcopy(tree)
    one_way = _with_direction(tree)
    for name, joint in new.get("joint", {}).items():
        kinds = {phase.get("joints", {}).get(name, "free") for phase in tree["phase"]}
        kinds |= {
            release.get("to", "free")
            for release in tree.get("release", [])
            if release["joint"] == name
        }
        if kinds <= _TURNED and name not in one_way:
            joint["bodies"] = joint["bodies"][::-1]  # a spring may hold the same list
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


def _with_direction(tree: Tree) -> set[str]:
    """Joints of which something depends on which body is the first: conditions, pins, increments,
    outputs of loads."""
    waiting = [phase["until"] for phase in tree["phase"] if "until" in phase] + [
        one["when"] for key in ("release", "event") for one in tree.get(key, [])
    ]
    found = set(tree.get("output", {}).get("loads", [])) | {
        entry["joint"] for entry in tree.get("proximity", [])
    }
    found |= {name for name, joint in tree.get("joint", {}).items() if "guide" in joint}
    while waiting:
        until = waiting.pop()
        found |= {until["joint"]} if "joint" in until else set()
        waiting += [part for key in ("any", "all") for part in until.get(key, [])]
    return found


def halved(tree: Tree, dice: Dice) -> Tree:
    """Every motor as two of half the thrust."""
    del dice
    motors = []
    for motor in tree.get("motor", []):
        motors += [
            {**motor, "thrust_N": 0.5 * motor["thrust_N"]},
            {**motor, "name": f"{motor['name']}_2", "thrust_N": 0.5 * motor["thrust_N"]},
        ]
    return {**tree, "motor": motors}


def _first_end(tree: Tree) -> float:
    """When the first phase ends, s, by the independent flight."""
    try:
        events = simulate(
            Campaign(parse_campaign(tree, "nominal")).nominal().to_dict(), rtol=1e-8
        ).events
    except ValueError:  # what it does not know
        return math.inf
    return min((time for time, what in events if what.startswith("phase ")), default=math.inf)


def interrupted(tree: Tree, dice: Dice) -> Tree:
    """A boundary soon after the start at which nothing changes; where what the first phase waits
    for may have been crossed by then, none."""
    if "until" in tree["phase"][0] and _is_crossed(tree["phase"][0]["until"]):
        return tree
    first, ends = tree["phase"][0], [phase.get("until", {}) for phase in tree["phase"]]
    times = [until.get("time_s", 1.0) for until in ends]
    times += [part.get("time_s", 1.0) for key in ("any", "all") for part in ends[0].get(key, [])]
    soon = min(*times, dice.between(0.01, 0.05) * tree["run"]["end_time_s"], _first_end(tree))
    idle = {**first, "name": "before_all", "until": {"time_s": 0.5 * soon}}
    return {**tree, "phase": [idle, *tree["phase"]]}


def _is_crossed(until: Tree) -> bool:
    """Whether part of a condition is met by a crossing, not by what lies at or beyond a limit."""
    parts = [part for key in ("any", "all") for part in until.get(key, [])]
    crossed = "direction" in until or any(key.startswith("vertical_speed") for key in until)
    return crossed or any(map(_is_crossed, parts))


SPELLINGS: dict[str, Callable[[Tree, Dice], Tree]] = {
    "other units": in_units,
    "other names": renamed,
    "other order of bodies": reordered,
    "joints and springs the other way round": turned,
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
    """What is told at an event, by the old names and by the new ones."""
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


def spelt(column: str, spelling: str, tree: Tree) -> str | None:
    """The column of another spelling that must hold the same as ``column``; None if there is
    none."""
    joints, one = list(tree.get("joint", {})), len(tree.get("joint", {})) == 1
    if spelling != "other names":  # separations are along an axis of the other body
        turned_round = spelling == "joints and springs the other way round"
        return None if turned_round and "separation_" in column else column
    if one and column in ("separation_speed_m_s", "separation_distance_mm", "release_time_s"):
        return column
    moved = {
        f"{name}_{end}": f"C{name}_{end}"
        for name in (c["name"] for c in tree.get("clearance", []))
        for end in _OF_CLEARANCE
    }
    for motor in (m["name"] for m in tree.get("motor", [])):
        moved[f"{motor}_ignition_time_s"] = f"m_{motor}_ignition_time_s"
    for event in (e["name"] for e in tree.get("event", [])):
        moved |= {f"{event}_{told}": f"E{event}_{new}" for told, new in _at_event(tree)}
    if column in moved:
        return moved[column]
    for joint in sorted(joints, key=len, reverse=True):
        for body in tree["body"]:
            start = f"{joint}_tip_off_{body}_"
            if column.startswith(start) and column[len(start) :] in _TIP_OFF:
                return f"n{joint}_tip_off_{body}_1_{column[len(start) :]}"
        if column.startswith(f"{joint}_") and column[len(joint) + 1 :].startswith(_OF_JOINT):
            return f"n{column}"
    body = max((b for b in tree["body"] if column.startswith(f"{b}_")), key=len, default="")
    return f"{body}_1{column[len(body) :]}"
