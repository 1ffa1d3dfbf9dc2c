"""Forces of springs and loads at each row of the history of a case, for the arrows of replays.

In every function ``scene`` is the scene with the inputs of that case.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from sepmc.kernel.spec.packing import PER_RATE, REST
from sepmc.report.poses import Poses
from sepmc.scene.budget import force_of_table
from sepmc.scene.model import GROUND, ForceTable, Load, Scene, Spring


def driven(history: pd.DataFrame, scene: Scene, path: str, value: float) -> np.ndarray:
    """Return the value of a parameter of the scene at each row of a history: a constant, or that of
    the signal that drives it.

    Parameters
    ----------
    history : DataFrame, n rows
        History of a case, with the columns ``signal_<name>``.
    scene : Scene
        Scene of the case.
    path : str
        TOML path of the parameter without units, such as ``load.push.force.x``.
    value : float
        Constant value, SI, which is used if no signal drives the parameter.

    Returns
    -------
    ndarray, shape (n,)
        SI.
    """
    drive = scene.driven.get(path)
    if drive is None:
        return np.full(len(history), float(value))
    return np.asarray(history[f"signal_{drive.signal}"] * drive.factor, dtype=float)


def load_forces(
    history: pd.DataFrame, scene: Scene, motion: Poses
) -> Iterator[tuple[Load, np.ndarray]]:
    """Yield each load that has a force other than 0 at any of the n rows of a history, and its
    force (n, 3), N, at these rows, in the axes of ``motion`` (see `Poses`); it is 0 before the
    start and from the end of the load on."""
    time = history["time_s"].to_numpy()
    for load in scene.load:
        components = [
            driven(history, scene, f"load.{load.name}.force.{axis}", value)
            for axis, value in zip("xyz", load.force, strict=True)
        ]
        acts = (time >= load.start) & (time < load.end)
        force = np.column_stack(components) * acts[:, None]
        axes = motion.ground if load.frame == "ground" else motion.rotations[load.body]
        if force.any():
            yield load, axes.apply(force)


def spring_forces(
    history: pd.DataFrame, scene: Scene, motion: Poses
) -> Iterator[tuple[Spring, np.ndarray]]:
    """Yield each spring between two bodies other than the ground, and its force (n, 3), N, on the
    second body at the n rows of a history, in the axes of ``motion`` (see `Poses`). It is 0 from
    the end of the stroke on, the time of which, s, is in ``history.attrs["springs"]`` by spring
    (NaN if it was not reached)."""
    time, ends = history["time_s"].to_numpy(), history.attrs["springs"]
    for spring in scene.spring:
        if GROUND in spring.bodies:
            continue
        line, length, rate = _line(history, scene, spring, motion)
        extension = length - length[0]
        path = f"spring.{spring.name}"
        force, stiffness, damping, factor = (
            driven(history, scene, f"{path}.{name}", getattr(spring, name))
            for name in ("force", "stiffness", "damping", "factor")
        )
        force = force - stiffness * extension - damping * rate
        if spring.table is not None:
            force = force + _of_table(spring.table, extension, rate)
        force = factor * force
        if spring.push_only:
            force = np.maximum(force, 0.0)
        end = ends.get(spring.name, np.nan)
        acts = np.isnan(end) | (time < end)
        yield spring, (force * acts)[:, None] * line


def _of_table(table: ForceTable, extension: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the force (n,), N, that a spring's table gives at an ``extension`` (n,), m; where its
    ``rate`` (n,), m/s, is negative by more than round-off, as the kernel takes it, times the return
    factor."""
    factor = np.where(rate < REST / PER_RATE, table.return_factor, 1.0)
    return np.asarray(force_of_table(table, extension) * factor)


def _line(
    history: pd.DataFrame, scene: Scene, spring: Spring, motion: Poses
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, for each of the n rows of a history, the unit vector (n, 3), in the axes of
    ``motion``, along which a spring pushes its second body; the length of the spring (n,), m; and
    the rate of that length (n,), m/s. The length of a spring with an axis is measured along that
    axis of its first body; without an axis, the vector is 0 where the length is 0."""
    ends, velocities, spins = [], [], []
    for body, point in zip(
        spring.bodies, (spring.point, spring.second_point or spring.point), strict=True
    ):
        rotation = motion.rotations[body]
        arm = (np.array(point) - scene.body[body].cg) * [-1.0, 1.0, 1.0]
        spin = np.radians(history[[f"{body}_omega_{a}_deg_s" for a in "xyz"]].to_numpy())
        velocity = motion.ground.apply(np.array(history[[f"{body}_v{a}_m_s" for a in "xyz"]]))
        ends.append(motion.positions[body] + rotation.apply(arm))
        velocities.append(velocity + rotation.apply(np.cross(spin, arm)))
        spins.append(rotation.apply(spin))
    gap, gap_rate = ends[1] - ends[0], velocities[1] - velocities[0]
    if spring.axis is None:
        length = np.linalg.norm(gap, axis=1)
        line = gap / np.where(length > 0.0, length, 1.0)[:, None]
        return line, length, np.einsum("ij,ij->i", gap_rate, line)
    axis = np.array(spring.axis) / np.linalg.norm(spring.axis)
    line = motion.rotations[spring.bodies[0]].apply(np.tile(axis, (len(gap), 1)))
    rate = np.einsum("ij,ij->i", gap_rate - np.cross(spins[0], gap), line)
    return line, np.einsum("ij,ij->i", gap, line), rate
