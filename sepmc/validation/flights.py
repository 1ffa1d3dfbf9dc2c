"""Simulations for the checks and stresses: the nominal case of a campaign, with its history as
arrays in ground axes."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.calibration_cases import CalibrationSize
from sepmc.campaign.result import Result
from sepmc.engine.dispatch import interpreted
from sepmc.scene.messages import no_log
from sepmc.scene.model import GROUND
from sepmc.scene.read import parse_campaign

Array = np.ndarray
SCENES = Path(__file__).parent / "scenes"
# Scale by unit of scenes with lengths of about 1 m and rates of about 1 rad/s.
SIZES = {"m": 1.0, "mm": 1e3, "m/s": 1.0, "m/s2": 1.0, "deg": 57.3, "deg/s": 57.3, "s": 1.0}
_CALIBRATION = CalibrationSize(corners=3, sample=24)  # of interpreted runs


class Track(NamedTuple):
    """Motion of one body in n rows of a history.

    Attributes
    ----------
    x, v : ndarray, shape (n, 3)
        Position, m, and velocity, m/s, of its mass centre, ground axes.
    r : ndarray, shape (n, 3, 3)
        Attitude: rotation matrices from body to ground axes.
    w : ndarray, shape (n, 3)
        Angular rates, rad/s, body axes.
    """

    x: Array
    v: Array
    r: Array
    w: Array


def campaign(name: str, settings: dict[str, Any] | None = None) -> Campaign:
    """Load the campaign of the file ``scenes/NAME.toml`` beside this module; ``settings`` replaces
    values in it, by path, such as ``initial.omega_rad_s``. Files that the campaign names are not
    read. Raises FileNotFoundError if there is no such file."""
    return Campaign(
        parse_campaign(
            tomllib.loads((SCENES / f"{name}.toml").read_text(encoding="utf-8")), name, settings
        )
    )


class NominalRun:
    """Simulation of the nominal case of the campaign ``source``, made by the constructor.

    Attributes
    ----------
    scene : Scene
    history : DataFrame, n rows
        Columns by public name: a row every ``every`` seconds, and two at each phase boundary.
    t, phase : ndarray, shape (n,)
        Time, s, and name of the phase of each row.
    outcomes : dict
        Outcomes and audit columns at the end, by column name and in the unit of that name.
    status : str
        Label of the final status, such as "ok".
    """

    def __init__(self, source: Campaign, every: float = 0.01):
        self.scene = source.scene
        self.history = source.simulate(step_s=every, announce=no_log)
        self.outcomes, self.status = self.history.attrs["outcomes"], self.history.attrs["status"]
        self.t, self.phase = (
            self.history["time_s"].to_numpy(),
            self.history["phase"].to_numpy(dtype=str),
        )

    def columns(self, pattern: str) -> Array:
        """Array (n, 3) of the three history columns that ``pattern`` names if its asterisk is
        replaced by x, y and z, in their units."""
        return self.history[[pattern.replace("*", axis) for axis in "xyz"]].to_numpy(dtype=float)

    def body(self, name: str) -> Track:
        """Motion of a body, or of the ground: that has the initial attitude of the vehicle at all
        times and zero velocity and rates; its position is set to zero and is not used."""
        n = len(self.t)
        if name == GROUND:
            i = self.scene.initial
            r = Rotation.from_euler("ZYX", [i.pitch, i.yaw, i.roll]).as_matrix()
            return Track(
                np.zeros((n, 3)), np.zeros((n, 3)), np.tile(r, (n, 1, 1)), np.zeros((n, 3))
            )
        angles = self.history[
            [f"{name}_{angle}_deg" for angle in ("pitch", "yaw", "roll")]
        ].to_numpy(dtype=float)
        r = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
        return Track(*self.places(name), r, np.radians(self.columns(f"{name}_omega_*_deg_s")))

    def places(self, name: str) -> tuple[Array, Array]:
        """Position, m, and velocity, m/s, of a body's mass centre, both (n, 3), ground axes."""
        return self.columns(f"{name}_*_m"), self.columns(f"{name}_v*_m_s")

    def wrench(self, joint: str, body: str) -> tuple[Array, Array]:
        """Constraint force, N, and moment, N m, of a joint on ``body``, one of its two bodies, both
        (n, 3) in ground axes; the moment is about the joint point of that body."""
        r = self.body(self.scene.joint[joint].bodies[0]).r
        force, moment = (
            self.columns(f"{joint}_force_on_{body}_*_N"),
            self.columns(f"{joint}_moment_on_{body}_*_N_m"),
        )
        return np.einsum("nij,nj->ni", r, force), np.einsum("nij,nj->ni", r, moment)


def run_interpreted(source: Campaign, cases: int) -> Result:
    """Run the first ``cases`` cases of a campaign with its kernel as plain Python, and return the
    result. The step selection has few calibration cases (3 corners, 24 samples), as each takes as
    long as a case."""
    with interpreted():
        return source.run(cases=cases, announce=no_log, calibration=_CALIBRATION)


def to_ground(r: Array, vectors: Array) -> Array:
    """Transform vectors, (n, 3) or (3,), from body axes to ground axes, (n, 3); ``r`` has the
    attitudes (n, 3, 3), body to ground."""
    return np.einsum("nij,nj->ni", r, np.broadcast_to(vectors, (len(r), 3)))


def arm(scene: Any, body: str, layout: Any) -> Array:
    """Vector (3,), m, body axes, from the mass centre of a body, not the ground, to a layout point
    [station, y, z], m; see CONVENTIONS.md."""
    return (np.asarray(layout, float) - np.asarray(scene.body[body].cg)) * (-1.0, 1.0, 1.0)


def tensor(scene: Any, body: str) -> Array:
    """Inertia tensor (3, 3), kg m2, of a body about its mass centre, body axes, with its
    ``inertia_factor``."""
    data = scene.body[body]
    xy, xz, yz = data.inertia_products
    return data.inertia_factor * (
        np.diag(data.inertia) - np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    )
