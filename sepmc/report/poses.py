"""Motion of the bodies of a case in the axes in which replays show it."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from sepmc.scene.model import GROUND, Scene


@dataclass(frozen=True)
class Poses:
    """Positions, attitudes and constraint forces over the rows of a history.

    Axes are the body axes of the first body at the start; the origin moves with the common centre
    of mass.

    Parameters
    ----------
    positions : dict of body to ndarray, shape (n, 3)
        Centres of mass, m.
    rotations : dict of body to Rotation of n
        From body axes to these axes.
    forces : dict of joint to ndarray, shape (n, 3)
        Constraint force on the second body, N; of joints between two bodies.
    ground : Rotation
        From ground axes to these axes.
    """

    positions: dict[str, np.ndarray]
    rotations: dict[str, Rotation]
    forces: dict[str, np.ndarray]
    ground: Rotation


def poses(history: pd.DataFrame, scene: Scene) -> Poses:
    """Return the motion of a case.

    Parameters
    ----------
    history : DataFrame, shape (n, ...)
        Rows of a single flight, see `sepmc.schema.history_columns`.
    scene : Scene
        Of this case.

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
    """Return the rotations from body to ground: Rz(pitch) Ry(yaw) Rx(roll)."""
    angles = history[[f"{body}_{angle}_deg" for angle in ("pitch", "yaw", "roll")]]
    return Rotation.from_euler("ZYX", np.array(angles), degrees=True)
