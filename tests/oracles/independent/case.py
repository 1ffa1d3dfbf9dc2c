"""A case as plain tables with all defaults filled in; unknown keys are refused, so that nothing is
ignored silently."""

import math
from collections.abc import Mapping
from typing import Any

Table = dict[str, Any]
GROUND = "ground"
REQUIRED = object()
COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")
# of a table, by the rate at the end of the name
DERIVATIVES = (
    "axial_q", "normal_q", "pitch_q", "side_p", "side_r", "roll_p", "roll_r", "yaw_p", "yaw_r",
)  # fmt: skip
ZERO = (0.0, 0.0, 0.0)

ENVIRONMENT = {
    "atmosphere": "us1976", "air": None, "density_factor": 1.0, "gravity": "inverse-square",
    "surface_gravity": 9.80665, "wind": None,
}  # fmt: skip
WIND = {"speed": 0.0, "direction": 0.0, "profile": None}
WIND_PROFILE = {
    "altitude": REQUIRED, "speed": REQUIRED, "direction": REQUIRED, "factor": 1.0, "turn": 0.0,
    "interpolation": "cubic",
}  # fmt: skip
AIR = {"altitude": REQUIRED, "density": REQUIRED, "speed_of_sound": (), "interpolation": "cubic"}
BODY = {
    "mass": REQUIRED, "inertia": REQUIRED, "inertia_products": ZERO, "inertia_factor": 1.0,
    "cg": REQUIRED, "aerodynamics": None,
    "outline": (),
}  # fmt: skip
AERODYNAMICS = {
    "reference_area": REQUIRED, "reference_length": REQUIRED, "force_factor": 1.0,
    "moment_factor": 1.0, "moment_point": None,
    "table": None, **dict.fromkeys(COEFFICIENTS),
}  # fmt: skip
AERO_TABLE = {
    "mach": (), "alpha": (), "beta": (), **dict.fromkeys((*COEFFICIENTS, *DERIVATIVES), ()),
    "interpolation": "cubic",
}  # fmt: skip
MOTOR = {
    "name": REQUIRED, "body": REQUIRED, "thrust": REQUIRED, "build_up": 0.0, "ignition": 0.0,
    "delay": 0.0, "burn": math.inf,
    "tail_off": 0.0, "profile": None, "station": REQUIRED, "radius": 0.0, "cant": math.pi,
    "clock": 0.0, "offset": (0.0, 0.0),
    "deflection": 0.0, "deflection_clock": 0.0,
}  # fmt: skip
IGNITION = {"event": None, "release": None, "joint": None, "delay": 0.0}
PROFILE = {"time": REQUIRED, "fraction": REQUIRED}
SPRING = {
    "name": REQUIRED, "bodies": REQUIRED, "point": REQUIRED, "second_point": None, "axis": None,
    "force": 0.0, "stiffness": 0.0,
    "damping": 0.0, "stroke": math.inf, "factor": 1.0, "push_only": False,
    "table": None,
}  # fmt: skip
FORCE_TABLE = {
    "extension": REQUIRED, "force": REQUIRED, "return_factor": 1.0, "interpolation": "cubic",
}  # fmt: skip
LOAD = {
    "name": REQUIRED, "body": REQUIRED, "force": ZERO, "moment": ZERO, "frame": "body",
    "point": None, "start": 0.0, "end": math.inf,
}  # fmt: skip
SERVO = {"natural": REQUIRED, "damping": REQUIRED}
SIGNAL = {
    "name": REQUIRED, "formula": REQUIRED, "constants": None, "sample": None, "delay": 0.0,
    "lag": None, "rate_limit": None, "servo": None, "integral": False, "initial": 0.0,
}  # fmt: skip
PROXIMITY = {
    "name": REQUIRED,
    "body": REQUIRED,
    "joint": REQUIRED,
    "distance": (),
    "axes": None,
    "factor": 1.0,
    "interpolation": "cubic",
    **dict.fromkeys(COEFFICIENTS, ()),
}
RELATIVE_AXES = dict.fromkeys(("x", "y", "z", "pitch", "yaw", "roll"), ())
JOINT = {
    "bodies": REQUIRED, "point": REQUIRED, "second_point": None, "x_axis": (1.0, 0.0, 0.0),
    "y_axis": (0.0, 1.0, 0.0), "apart": None, "omega": ZERO,
    "kind": None, "delay": 0.0, "fails": 0.0, "guide": None,
}  # fmt: skip
GUIDE = {
    "pins": REQUIRED,
    "circle": 0.0,
    "clock": 0.0,
    "engaged": REQUIRED,
    "friction": 0.0,
    "slip_speed": 0.01,
}
CUSTOM = {"translations": (), "rotations": ()}
PART = {
    "name": None, "stations": None, "radii": None, "offset": (0.0, 0.0), "points": (),
    "hollow": False, "sector": None,
}  # fmt: skip
CLEARANCE = {"name": REQUIRED, "bodies": REQUIRED, "outlines": ((), ()), "after": None}
FORMULA_OUTCOME = {"name": REQUIRED, "formula": REQUIRED, "unit": "1"}
PHASE = {"name": REQUIRED, "joints": None, "until": None}
EVENT = {"name": REQUIRED, "when": REQUIRED}
RELEASE = {
    "name": REQUIRED, "joint": REQUIRED, "to": "free", "when": REQUIRED,
    "optional": False,
}  # fmt: skip
UNTIL = {
    "time": None, "burn_out": None, "spring": None, "joint": None, "stroke": None, "distance": None,
    "angle": None, "force": None, "moment": None,
    "body": None, "altitude": None, "vertical_speed": None, "direction": None,
    "any": (), "all": (),
}  # fmt: skip
OUTPUT = {
    "loads": (), "tip_off": (), "guide": (), "transverse": (), "hinge": (), "relative": (),
}  # fmt: skip
INITIAL = {
    "altitude": REQUIRED, "speed": REQUIRED, "omega": ZERO, "alpha": 0.0, "pitch": 0.0,
    "yaw": 0.0, "roll": 0.0, "path_yaw": 0.0,
    "path_reference": None,
}  # fmt: skip
RUN = {
    "end_time": REQUIRED,
    "cases": 0,
    "seed": 0,
    "sampler": "",
    "history_step": 0.0,
    "chunk": 0,
}  # only end_time is used
# settings of the engine; not used
SOLVER = dict.fromkeys(("formulation", "method", "accuracy", "step", "drift"))
SCENE = {
    "environment": None, "body": REQUIRED, "motor": (), "spring": (), "load": (), "proximity": (),
    "joint": None, "phase": REQUIRED,
    "release": (), "event": (), "clearance": (), "outcome": (), "output": None, "initial": REQUIRED,
    "signal": (), "driven": None,
    "run": REQUIRED, "solver": None,
}  # fmt: skip


def filled(table: Mapping[str, Any] | None, known: Mapping[str, Any], where: str) -> Table:
    """Table with its defaults.

    Raises
    ------
    ValueError
        If a key is unknown or missing.
    """
    present = {key: value for key, value in (table or {}).items() if value is not None}
    for key in present:
        if key not in known:
            raise ValueError(f"unknown key {where}.{key}")
    for key, default in known.items():
        if default is REQUIRED and key not in present:
            raise ValueError(f"{where}.{key} is missing")
    return {**known, **present}


def _inner(table: Table, key: str, known: Mapping[str, Any], where: str) -> None:
    """Fill in the defaults of the table at ``key``, if there is one."""
    if table[key] is not None:
        table[key] = filled(table[key], known, f"{where}.{key}")


def _list(tables: Any, known: Mapping[str, Any], where: str) -> list[Table]:
    """Tables with their defaults."""
    return [filled(table, known, f"{where}.{table.get('name')}") for table in tables]


def condition(table: Mapping[str, Any], where: str) -> Table:
    """Condition with its defaults, nested conditions included."""
    result = filled(table, UNTIL, where)
    for key in ("any", "all"):
        result[key] = [condition(part, f"{where}.{key}") for part in result[key]]
    return result


def read(case: Mapping[str, Any]) -> Table:
    """Case with all defaults.

    Parameters
    ----------
    case : mapping
        SI and radians, as `sepmc.campaign.definition.Case.to_dict` returns it.
    """
    scene = filled(case, SCENE, "scene")
    scene["environment"] = filled(scene["environment"], ENVIRONMENT, "environment")
    wind = scene["environment"]["wind"] = filled(
        scene["environment"]["wind"], WIND, "environment.wind"
    )
    _inner(wind, "profile", WIND_PROFILE, "environment.wind")
    _inner(scene["environment"], "air", AIR, "environment")
    scene["body"] = {
        name: filled(table, BODY, f"body.{name}") for name, table in scene["body"].items()
    }
    for name, body in scene["body"].items():
        body["outline"] = [filled(part, PART, f"body.{name}.outline") for part in body["outline"]]
        _inner(body, "aerodynamics", AERODYNAMICS, f"body.{name}")
        if body["aerodynamics"]:
            _inner(body["aerodynamics"], "table", AERO_TABLE, f"body.{name}.aerodynamics")
    scene["motor"] = _list(scene["motor"], MOTOR, "motor")
    for motor in scene["motor"]:
        _inner(motor, "profile", PROFILE, f"motor.{motor['name']}")
        if isinstance(motor["ignition"], Mapping):
            _inner(motor, "ignition", IGNITION, f"motor.{motor['name']}")
        if motor["profile"] and math.isinf(motor["burn"]):
            motor["burn"] = motor["profile"]["time"][-1]  # no thrust after the last row
    scene["spring"] = _list(scene["spring"], SPRING, "spring")
    for spring in scene["spring"]:
        _inner(spring, "table", FORCE_TABLE, f"spring.{spring['name']}")
        if spring["table"] and math.isinf(spring["stroke"]):
            spring["stroke"] = spring["table"]["extension"][-1]
    scene["load"] = _list(scene["load"], LOAD, "load")
    scene["outcome"] = _list(scene["outcome"], FORMULA_OUTCOME, "outcome")
    scene["signal"] = _list(scene["signal"], SIGNAL, "signal")
    for signal in scene["signal"]:
        signal["constants"] = signal["constants"] or {}
        _inner(signal, "servo", SERVO, f"signal.{signal['name']}")
    scene["driven"] = scene["driven"] or {}
    scene["clearance"] = _list(scene["clearance"], CLEARANCE, "clearance")
    scene["proximity"] = _list(scene["proximity"], PROXIMITY, "proximity")
    for near in scene["proximity"]:
        _inner(near, "axes", RELATIVE_AXES, f"proximity.{near['name']}")
    scene["joint"] = {
        name: filled(table, JOINT, f"joint.{name}")
        for name, table in (scene["joint"] or {}).items()
    }
    for name, joint in scene["joint"].items():
        _inner(joint, "guide", GUIDE, f"joint.{name}")
        joint["kind"] = {
            kind: filled(table, CUSTOM, f"joint.{name}.kind.{kind}")
            for kind, table in (joint["kind"] or {}).items()
        }
    scene["phase"] = _list(scene["phase"], PHASE, "phase")
    for phase in scene["phase"]:
        phase["joints"] = phase["joints"] or {}
        phase["until"] = (
            condition(phase["until"], f"phase.{phase['name']}.until")
            if phase["until"] is not None
            else None
        )
    scene["release"] = _list(scene["release"], RELEASE, "release")
    for release in scene["release"]:
        release["when"] = condition(release["when"], f"release.{release['name']}.when")
    scene["event"] = _list(scene["event"], EVENT, "event")
    for event in scene["event"]:
        event["when"] = condition(event["when"], f"event.{event['name']}.when")
    scene["output"] = filled(scene["output"], OUTPUT, "output")
    scene["initial"] = filled(scene["initial"], INITIAL, "initial")
    scene["run"] = filled(scene["run"], RUN, "run")
    scene["solver"] = filled(scene["solver"], SOLVER, "solver")
    return scene
