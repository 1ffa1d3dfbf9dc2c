"""Outcomes by public name and unit."""

import math
from typing import Any, Protocol

import numpy as np

from oracles.independent.clearances import Clearances
from oracles.independent.events import Sequence
from oracles.independent.formulas import NamedValues
from oracles.independent.joints import Joint
from oracles.independent.loads import Loads, air_angles
from oracles.independent.monitor import Monitor
from oracles.independent.state import Array, State, Vehicle
from sepmc.schema import Contents, Formula, outcome_columns

_SINGULAR = math.radians(89.0)
_STILL = 1e-6  # m/s: airspeed below which it has no direction
_BEHIND = 1e-12  # of the airspeed: air comes exactly from behind
_SLOW = 1e-5  # m/s: airspeed below which round-off affects its direction


def columns(scene: dict[str, Any]) -> list[str]:
    """Names of all outcomes of a scene."""
    output = scene["output"]
    contents = Contents(
        list(scene["body"]),
        {name: tuple(joint["bodies"]) for name, joint in scene["joint"].items()},
        tuple(output["loads"]),
        {name: scene["joint"][name]["guide"]["pins"] for name in output["guide"]},
        tuple(table["name"] for table in scene["clearance"]),
        tuple(output["tip_off"]),
        tuple(table["name"] for table in scene["event"]),
        transverse=tuple(output["transverse"]),
        ignitions=tuple(m["name"] for m in scene["motor"] if isinstance(m["ignition"], dict)),
        springs=tuple(s["name"] for s in scene["spring"] if math.isfinite(s["stroke"])),
        partial_releases=tuple(dict.fromkeys(_partial_releases(scene))),
        hinges=tuple(output["hinge"]),
        relative=tuple(map(tuple, output["relative"])),
        formulas=tuple(Formula(t["name"], t["formula"], t["unit"]) for t in scene["outcome"]),
    )
    return [column.name for column in outcome_columns(contents)]


def _partial_releases(scene: dict[str, Any]) -> list[tuple[str, str]]:
    """Joint and kind of every release to another kind than free."""
    return [(table["joint"], table["to"]) for table in scene["release"] if table["to"] != "free"]


class Follower:
    """Roll and pitch of every body, rad, continuous beyond half a turn, with its yaw."""

    def __init__(self, vehicle: Vehicle):
        first = vehicle.initial
        self.roll, self.pitch = (np.full(vehicle.n, float(first[key])) for key in ("roll", "pitch"))
        self.yaw, self.singular = np.zeros(vehicle.n), False

    def follow(self, s: State, step: float) -> None:
        """Update the angles at a state, each with the number of turns nearest to the last value."""
        r = s.r[:-1]
        roll = _nearest(np.arctan2(r[:, 2, 1], r[:, 2, 2]), self.roll)
        pitch = _nearest(np.arctan2(r[:, 1, 0], r[:, 0, 0]), self.pitch)
        self.yaw = np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0]))
        turned = np.linalg.norm(s.w[:-1], axis=1) * step
        change = np.max([np.abs(roll - self.roll), np.abs(pitch - self.pitch), turned])
        self.singular = self.singular or bool(
            change > 0.5 * math.pi or np.abs(self.yaw).max() > _SINGULAR
        )
        self.roll, self.pitch = roll, pitch


def _nearest(angle: Any, last: Any) -> Any:
    """Angle plus the number of turns nearest to the last."""
    return angle + 2.0 * math.pi * np.round((last - angle) / (2.0 * math.pi))


class Progress(Protocol):
    """Simulation at its present time, as `oracles.independent.flight` has it."""

    scene: dict[str, Any]
    vehicle: Vehicle
    joints: dict[str, Joint]
    loads: Loads
    sequence: Sequence
    follower: Follower
    monitor: Monitor
    clearances: Clearances
    released: dict[str, tuple[float, Array]]
    loosened: dict[tuple[str, str], float]
    observed: dict[str, dict[str, float]]
    t: float
    y: Array

    def state(self, t: float, y: Array) -> State:
        """State of all bodies."""


def indeterminate(flight: Progress) -> tuple[str, ...]:
    """Outcomes decided by round-off: alpha and beta without airspeed, alpha in pure crosswind or
    with air from behind, times of flat peaks. Also locations and times of minimum clearances, which
    this simulation does not compute."""
    s, names = flight.state(flight.t, flight.y), []
    for b, name in enumerate(flight.vehicle.names):
        u = flight.loads.air_velocity(flight.t, s, b)
        nearly_behind = 0.1 * _BEHIND < abs(u[1] / u[0]) < 1e3 * _BEHIND if u[0] < 0.0 else False
        if nearly_behind or 0.1 * _STILL < math.hypot(u[0], u[1]) < _SLOW:
            names.append(f"{name}_alpha_deg")
        if 0.1 * _STILL < np.linalg.norm(u) < _SLOW:
            names.append(f"{name}_beta_deg")
    for table in flight.scene["clearance"]:
        name = f"{table['name']}_clearance"
        names += [f"{name}_station_m", f"{name}_y_m", f"{name}_z_m", f"{name}_time_s"]
    return (*names, *flight.monitor.flat_peaks())


def at_event(flight: Progress, event: str) -> dict[str, float]:
    """Outcomes at an observed event: its time, angular rates and attitudes of all bodies,
    separations."""
    s, follower = flight.state(flight.t, flight.y), flight.follower
    follower.follow(s, 0.0)
    out = {f"{event}_time_s": flight.t}
    for b, name in enumerate(flight.vehicle.names):
        angles = {"roll": follower.roll[b], "yaw": follower.yaw[b], "pitch": follower.pitch[b]}
        out |= {f"{event}_{name}_{key}_deg": math.degrees(value) for key, value in angles.items()}
        out |= {
            f"{event}_{name}_omega_{axis}_deg_s": math.degrees(rate)
            for axis, rate in zip("xyz", s.w[b], strict=True)
        }
    for name, joint in flight.joints.items():
        prefix = f"{event}_" if len(flight.joints) == 1 else f"{event}_{name}_"
        distance, speed = joint.separation(s)
        out |= {
            f"{prefix}separation_speed_m_s": speed,
            f"{prefix}separation_distance_mm": 1e3 * distance,
        }
    return out | _relative(flight, s, f"{event}_")


def report(flight: Progress) -> dict[str, float]:
    """Outcomes at the end of a simulation."""
    vehicle = flight.vehicle
    out: dict[str, float] = {}
    s, first = flight.state(flight.t, flight.y), flight.vehicle.initial
    reference = (
        first["path_reference"]
        if first["path_reference"] is not None
        else first["pitch"] - first["alpha"]
    )
    follower = flight.follower
    follower.follow(s, 0.0)
    for b, name in enumerate(vehicle.names):
        u = flight.loads.air_velocity(flight.t, s, b)
        speed, alpha, beta = air_angles(u)
        if abs(u[1]) < -_BEHIND * u[0]:
            alpha = math.pi
        angles = {
            "alpha": alpha if math.hypot(u[0], u[1]) >= _STILL else math.nan,
            "beta": beta if speed >= _STILL else math.nan,
            "alpha_ref": follower.pitch[b] - reference,
        }
        angles |= {"roll": follower.roll[b], "yaw": follower.yaw[b], "pitch": follower.pitch[b]}
        out |= {f"{name}_{key}_deg": math.degrees(value) for key, value in angles.items()}
        out |= {
            f"{name}_omega_{axis}_deg_s": math.degrees(rate)
            for axis, rate in zip("xyz", s.w[b], strict=True)
        }
    for name, joint in flight.joints.items():
        prefix = "" if len(flight.joints) == 1 else f"{name}_"
        distance, speed = joint.separation(s)
        released = flight.released.get(name, (math.nan, None))[0]
        out |= {
            f"{prefix}separation_speed_m_s": speed,
            f"{prefix}separation_distance_mm": 1e3 * distance,
        }
        out[f"{prefix}release_time_s"] = released
    out |= _relative(flight, s)
    for name in flight.scene["output"]["tip_off"]:
        if name in flight.released:
            for body in flight.joints[name].bodies:
                if body in vehicle.names:
                    for axis, rate in zip(
                        "xyz", flight.released[name][1][vehicle.index[body]], strict=True
                    ):
                        out[f"{name}_tip_off_{body}_{axis}_deg_s"] = math.degrees(rate)
    for name in flight.observed:
        out |= flight.observed[name]
    for motor in flight.loads.motors:
        if motor.waits and motor.start <= flight.t:
            out[f"{motor.table['name']}_ignition_time_s"] = motor.start
    for event in flight.sequence.springs:
        out[f"{event.leaves[0].name}_stroke_end_time_s"] = (
            event.time if math.isfinite(event.time) else math.nan
        )
    for (name, kind), time in flight.loosened.items():
        prefix = "" if len(flight.joints) == 1 else f"{name}_"
        out[f"{prefix}release_to_{kind.replace('-', '_')}_time_s"] = time
    free = {name: 0.0 for name, rows in flight.sequence.kinds[0].items() if not rows}
    free |= {name: time for name, (time, _) in flight.released.items()}
    times = {name: values[f"{name}_time_s"] for name, values in flight.observed.items()}
    distances = flight.clearances.report(free) | flight.clearances.at(times, free)
    out |= flight.monitor.report() | distances | _transverse_rates(flight, out)
    return out | _by_formulas(flight.scene["outcome"], out)


def _relative(flight: Progress, s: State, prefix: str = "") -> dict[str, float]:
    """Hinge angles, distances and relative attitudes at a state."""
    out, index = {}, flight.vehicle.index
    for name in flight.scene["output"]["hinge"]:
        table = flight.scene["joint"][name]
        turns = [s.r[index[body]] if body in index else np.eye(3) for body in table["bodies"]]
        spins = [
            s.r[index[body]] @ s.w[index[body]] if body in index else np.zeros(3)
            for body in table["bodies"]
        ]
        x = np.array(table["x_axis"]) / np.linalg.norm(table["x_axis"])
        y = np.array(table["y_axis"]) - x * (x @ np.array(table["y_axis"]))
        y /= np.linalg.norm(y)
        turned = turns[0].T @ turns[1] @ y
        angle = math.atan2(turned @ np.cross(x, y), turned @ y)
        out[f"{prefix}{name}_angle_deg"] = math.degrees(angle)
        rate = (turns[0] @ x) @ (spins[1] - spins[0])
        out[f"{prefix}{name}_angle_rate_deg_s"] = math.degrees(rate)
    for first, second in flight.scene["output"]["relative"]:
        a, b = index[first], index[second]
        stem, m = f"{prefix}{second}_from_{first}_", s.r[a].T @ s.r[b]
        out[f"{stem}distance_m"] = float(np.linalg.norm(s.x[b] - s.x[a]))
        out[f"{stem}roll_deg"] = math.degrees(math.atan2(m[2, 1], m[2, 2]))
        out[f"{stem}yaw_deg"] = math.degrees(math.atan2(-m[2, 0], math.hypot(m[0, 0], m[1, 0])))
        out[f"{stem}pitch_deg"] = math.degrees(math.atan2(m[1, 0], m[0, 0]))
    return out


def _by_formulas(tables: list[dict[str, Any]], out: dict[str, float]) -> dict[str, float]:
    """Outcomes by formulas of those before them; raises `Undefined`."""
    result: dict[str, float] = {}
    for table in tables:
        name = table["name"] + ("" if table["unit"] == "1" else f"_{table['unit']}")
        result[name] = NamedValues(out | result).formula(table["formula"])
    return result


def _transverse_rates(flight: Progress, out: dict[str, float]) -> dict[str, float]:
    """Transverse rates, wherever the rates of a body are outcomes."""
    output, events = flight.scene["output"], [table["name"] for table in flight.scene["event"]]
    rates = {}
    for body in output["transverse"]:
        starts = {f"{body}_": "omega_"} | {f"{event}_{body}_": "omega_" for event in events}
        starts |= {f"{joint}_tip_off_{body}_": "" for joint in output["tip_off"]}
        for start, of_rate in starts.items():
            y, z = (out.get(f"{start}{of_rate}{axis}_deg_s") for axis in "yz")
            if y is not None and z is not None:
                rates[f"{start}transverse_rate_deg_s"] = float(np.hypot(y, z))
    return rates
