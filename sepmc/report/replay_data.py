"""Data of the three-dimensional replays of cases in a report, which `replay.js` draws.

In every function ``scene`` is the scene with the inputs of the case whose ``history`` it gets.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from sepmc.report.drawing import nozzle_point
from sepmc.report.load_arrows import driven, load_forces, spring_forces
from sepmc.report.nearest import MovingOutline, PlacedPart, nearest_lines, placed_part
from sepmc.report.poses import Poses, poses
from sepmc.report.style import EDGES, TINTS
from sepmc.scene.model import GROUND, Body, Motor, Scene
from sepmc.scene.outline_parts import selected_numbers

# decimals of positions in m, of distances in mm, and of quaternions
_METRES, _MILLIMETRES, _UNIT = 5, 2, 6
_DIGITS = 4  # significant digits of forces


def replay_data(
    history: pd.DataFrame, scene: Scene, title: str, number: int | None = None
) -> dict[str, Any]:
    """Return the data of the replay of one case, ready for JSON.

    Parameters
    ----------
    history : DataFrame
        From `Campaign.simulate`, with its ``attrs``; of rows with equal time the last is used, so n
        rows remain.
    scene : Scene
        Scene with the inputs of this case.
    title : str
    number : int, optional
        Case number; None for the nominal case.

    Returns
    -------
    dict
        ``number`` and ``title``; ``time`` (n), s; ``phases``, the names, and ``phase`` (n), the
        index of the name. ``bodies``, each with its name, colours, ``parts`` in body axes from the
        centre of mass, m, ``at`` (3 n), position, m, and ``turn`` (4 n), scalar-first quaternions
        from body axes to the view axes of `sepmc.report.poses.Poses`. ``arrows``, the forces of
        joints, motors, springs and loads: ``force`` (3 n), N, in view axes, at the point ``at`` of
        the body with the index ``body``, until time ``until``, s. ``distances``, one per clearance:
        ``value`` (n), mm, and ``line`` (6 n), its two nearest points, m. Arrays are flat lists;
        numbers that are not finite are None.
    """
    history = history[~history["time_s"].duplicated(keep="last")]
    motion = poses(history, scene)
    phases = list(dict.fromkeys(history["phase"]))
    return {
        "number": number,
        "title": title,
        "time": _rounded(history["time_s"], 6),
        "phases": phases,
        "phase": [phases.index(phase) for phase in history["phase"]],
        "bodies": [_body(name, number, scene, motion) for number, name in enumerate(scene.body)],
        "arrows": [
            *_joint_arrows(history, scene, motion),
            *_motor_arrows(history, scene, motion),
            *_load_arrows(history, scene, motion),
        ],
        "distances": _distances(history, scene, motion),
    }


def _rounded(values: Any, decimals: int) -> list[float | None]:
    """Return an array of numbers as a flat list, rounded to some ``decimals``; None where they are
    not finite."""
    flat = np.asarray(values, dtype=float).ravel()
    return [
        value + 0.0 if finite else None
        for value, finite in zip(np.round(flat, decimals).tolist(), np.isfinite(flat), strict=True)
    ]


def _significant(values: Any) -> list[float | None]:
    """Return an array of numbers as a flat list, rounded to the decimals that show the largest with
    four significant digits; None where they are not finite."""
    flat = np.asarray(values, dtype=float).ravel()
    largest = np.abs(flat[np.isfinite(flat)]).max(initial=0.0)
    return _rounded(flat, _DIGITS - int(np.ceil(np.log10(largest))) if largest > 0.0 else 0)


def _arm(point: Sequence[float], body: Body) -> list[float]:
    """Return a layout point of a body (station measured aft, y, z, m) in body axes from its centre
    of mass, m, rounded."""
    arm = (np.array(point) - body.cg) * [-1.0, 1.0, 1.0]
    return [float(x) for x in np.round(arm, _METRES)]


def _body(name: str, number: int, scene: Scene, motion: Poses) -> dict[str, Any]:
    """Return the element of ``bodies`` in the result of `replay_data` for the body ``name``, the
    ``number``-th of the scene from 0. ``spokes`` are the ends of lines from the centre of mass to
    joints, motors and springs, which a body without an outline has instead of parts."""
    body = scene.body[name]
    points = [joint.point for joint in scene.joint.values() if name in joint.bodies]
    points += [nozzle_point(motor) for motor in scene.motor if motor.body == name]
    for spring in scene.spring:
        ends = zip(spring.bodies, (spring.point, spring.second_point or spring.point), strict=True)
        points += [point for body, point in ends if body == name]
    return {
        "name": name,
        "tint": TINTS[number % len(TINTS)],
        "edge": EDGES[number % len(EDGES)],
        "parts": [_part(placed_part(part, body.cg)) for part in body.outline],
        "spokes": [] if body.outline else [_arm(point, body) for point in points],
        "at": _rounded(motion.positions[name], _METRES),
        "turn": _rounded(motion.rotations[name].as_quat(scalar_first=True), _UNIT),
    }


def _part(part: PlacedPart) -> dict[str, Any]:
    """Return a part of an outline as a dict: centres and radii of the two ends, whether it is a
    wall, and the two angles of a sector, rad, or None; for a part of points only the points.
    Lengths are in m and points in body axes from the centre of mass, as in ``part``."""
    if len(part.points):
        return {"points": np.round(part.points, _METRES).tolist()}
    return {
        "start": [round(x, _METRES) for x in part.start],
        "end": [round(x, _METRES) for x in part.end],
        "radii": list(part.radii),
        "wall": part.is_wall,
        "sector": None if part.sector is None else list(part.sector),
    }


def _joint_arrows(history: pd.DataFrame, scene: Scene, motion: Poses) -> list[dict[str, Any]]:
    """Return the arrows (`replay_data`) of the constraint forces, one for each joint between two
    bodies: its force on the second body; ``until`` is the time at which the joint became free, s,
    or None if it did not."""
    arrows, bodies = [], list(scene.body)
    releases = history.attrs["releases"]
    for name, force in motion.forces.items():
        joint = scene.joint[name]
        second, release = joint.bodies[1], releases.get(name, np.nan)
        arrows.append(
            {
                "name": name,
                "kind": "constraint",
                "body": bodies.index(second),
                "at": _arm(joint.second_point or joint.point, scene.body[second]),
                "force": _significant(force),
                "until": None if np.isnan(release) else float(release),
            }
        )
    return arrows


def _motor_arrows(history: pd.DataFrame, scene: Scene, motion: Poses) -> list[dict[str, Any]]:
    """Return the arrows (`replay_data`) of the thrust of motors, at their nozzles, one for each
    motor that is not on the ground; ``until`` is None."""
    arrows, bodies = [], list(scene.body)
    for motor in scene.motor:
        if motor.body == GROUND:
            continue
        line = thrust_lines(motor, _driven(history, scene, motor, "deflection"),
                            _driven(history, scene, motor, "deflection_clock"))  # fmt: skip
        force = thrust(history, scene, motor)[:, None] * line
        arrows.append(
            {
                "name": motor.name,
                "kind": "thrust",
                "body": bodies.index(motor.body),
                "at": _arm(nozzle_point(motor), scene.body[motor.body]),
                "force": _significant(motion.rotations[motor.body].apply(force)),
                "until": None,
            }
        )
    return arrows


def _driven(history: pd.DataFrame, scene: Scene, motor: Motor, field: str) -> np.ndarray:
    """Return the value (n,), SI, of the parameter ``field`` of a motor at each of the n rows of the
    history of a case: a constant, or the history's column of the signal that drives it (`driven`).
    ``scene`` and ``motor`` have the inputs of that case."""
    return driven(history, scene, f"motor.{motor.name}.{field}", getattr(motor, field))


def _load_arrows(history: pd.DataFrame, scene: Scene, motion: Poses) -> list[dict[str, Any]]:
    """Return the arrows (`replay_data`) of the forces of springs between two bodies, on the second
    body, and of loads with a force; ``until`` is the time at which each stops acting, s, or None if
    it acts to the end."""
    arrows, bodies, ends = [], list(scene.body), history.attrs["springs"]
    for spring, force in spring_forces(history, scene, motion):
        second, end = spring.bodies[1], ends.get(spring.name, np.nan)
        point = spring.second_point or spring.point
        arrows.append((spring.name, "spring", second, point, force, end))
    for load, force in load_forces(history, scene, motion):
        point = load.point or scene.body[load.body].cg
        arrows.append((load.name, "load", load.body, point, force, load.end))
    return [
        {
            "name": name,
            "kind": kind,
            "body": bodies.index(body),
            "at": _arm(point, scene.body[body]),
            "force": _significant(force),
            "until": float(end) if np.isfinite(end) else None,
        }
        for name, kind, body, point, force, end in arrows
    ]


def thrust(history: pd.DataFrame, scene: Scene, motor: Motor) -> np.ndarray:
    """Return the thrust of a motor (n,), N, at each of the n rows of the history of a case; 0 if it
    does not ignite. ``scene`` and ``motor`` have the inputs of that case."""
    ignition = motor.ignition + motor.delay if isinstance(motor.ignition, float) else np.nan
    ignition = history.attrs["outcomes"].get(f"{motor.name}_ignition_time_s", ignition)
    if np.isnan(ignition):
        return np.zeros(len(history))
    since = history["time_s"].to_numpy() - ignition
    burning = np.clip(since, 0.0, motor.burn)  # s of burning so far
    force = _driven(history, scene, motor, "thrust") * (since >= 0.0)
    if motor.build_up > 0.0:
        force = force * -np.expm1(-burning / motor.build_up)
    if motor.profile is not None:
        force = force * np.interp(
            burning, motor.profile.time, motor.profile.fraction, left=0.0, right=0.0
        )
    after = np.maximum(since - motor.burn, 0.0)
    if motor.tail_off > 0.0:
        return np.asarray(force * np.exp(-after / motor.tail_off))
    return np.where(after > 0.0, 0.0, force)


def thrust_lines(motor: Motor, deflection: np.ndarray, clock: np.ndarray) -> np.ndarray:
    """Return the unit vectors (n, 3), body axes, along the thrust of a motor for ``deflection``
    angles (n,) of the thrust line and their ``clock`` angles (n,), rad; eqs (1) to (3) of Wang, Li,
    Liu, Journal of System Simulation 31(4), 2019."""
    fx = np.cos(deflection)
    fy, fz = -np.sin(deflection) * np.sin(clock), np.sin(deflection) * np.cos(clock)
    sx, cx = np.sin(motor.cant), np.cos(motor.cant)
    sg, cg = np.sin(motor.clock), np.cos(motor.clock)
    return np.column_stack(
        [
            cx * fx - sx * fz,
            -sg * sx * fx + cg * fy - sg * cx * fz,
            cg * sx * fx + sg * fy + cg * cx * fz,
        ]
    )


def _distances(history: pd.DataFrame, scene: Scene, motion: Poses) -> list[dict[str, Any]]:
    """Return the elements of ``distances`` in the result of `replay_data`: for each clearance
    between two bodies its distance over time, mm, and its nearest points, m, in the axes of the
    poses ``motion``. Clearances from the ground, and those without a column in the history, are
    left out."""
    result: list[dict[str, Any]] = []
    for clearance in scene.clearance:
        column = f"{clearance.name}_clearance_mm"
        if column not in history or GROUND in clearance.bodies:
            continue
        one, two = (
            MovingOutline(
                [
                    placed_part(scene.body[body].outline[k], scene.body[body].cg)
                    for k in selected_numbers(scene, clearance, side)
                ],
                motion.positions[body],
                motion.rotations[body],
            )
            for side, body in enumerate(clearance.bodies)
        )
        distances = history[column].to_numpy()
        result.append(
            {
                "name": clearance.name,
                "value": _rounded(distances, _MILLIMETRES),
                "line": _rounded(nearest_lines(one, two, 1e-3 * distances), _METRES),
            }
        )
    return result
