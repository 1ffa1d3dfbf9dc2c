"""Motion of the bodies of a case in the axes in which replays and animations show it."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from sepmc.scene.model import GROUND, Scene


@dataclass(frozen=True)
class Poses:
    """Positions, attitudes and constraint forces of a case at the n rows of its history.

    All vectors are in view axes: they have the fixed directions that the body axes of the first
    body have at the start; the origin moves with the common centre of mass.

    Parameters
    ----------
    positions : dict of body to ndarray, shape (n, 3)
        Centre of mass of each body, m.
    rotations : dict of body to Rotation of n
        Rotations from the axes of each body to view axes.
    forces : dict of joint to ndarray, shape (n, 3)
        Constraint force of each joint on its second body, N; joints to the ground are left out.
    ground : Rotation
        Rotation from ground axes to view axes.
    """

    positions: dict[str, np.ndarray]
    rotations: dict[str, Rotation]
    forces: dict[str, np.ndarray]
    ground: Rotation


def poses(history: pd.DataFrame, scene: Scene) -> Poses:
    """Compute the motion of a case in the axes in which it is shown: the body axes of the first
    body at the start, about the common centre of mass, with which they move but do not turn.

    Parameters
    ----------
    history : DataFrame, n rows
        History of the case, with the columns of `sepmc.schema.history_columns`.
    scene : Scene
        Scene with the inputs of this case.

    Returns
    -------
    Poses
    """
    first, *_ = scene.body
    to_view = _attitudes(history.iloc[:1], first)[0].inv()
    masses = np.array([body.mass for body in scene.body.values()])
    from_origin = np.array(
        [history[[f"{body}_{axis}_m" for axis in "xyz"]].to_numpy() for body in scene.body]
    )
    centre = np.tensordot(masses, from_origin, 1) / masses.sum()
    rotations = {body: to_view * _attitudes(history, body) for body in scene.body}
    return Poses(
        {
            body: to_view.apply(position - centre)
            for body, position in zip(scene.body, from_origin, strict=True)
        },
        rotations,
        {
            name: rotations[joint.bodies[0]].apply(
                np.array(history[[f"{name}_force_on_{joint.bodies[1]}_{a}_N" for a in "xyz"]])
            )
            for name, joint in scene.joint.items()
            if GROUND not in joint.bodies
        },
        to_view,
    )


def _attitudes(history: pd.DataFrame, body: str) -> Rotation:
    """Return the rotations Rz(pitch) Ry(yaw) Rx(roll) from the axes of a body to ground axes, one
    for each row of a history."""
    angles = history[[f"{body}_{angle}_deg" for angle in ("pitch", "yaw", "roll")]]
    return Rotation.from_euler("ZYX", np.array(angles), degrees=True)
