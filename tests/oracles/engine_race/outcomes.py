"""From final states to the outcome columns of a campaign."""

from dataclasses import dataclass

import numpy as np

from oracles.engine_race.inputs import BodyRows, Inputs
from oracles.engine_race.vectors import Array, cross


@dataclass(frozen=True)
class Final:
    """Final motion of a body, a row a case: ground axes in the moving frame, rates in body axes."""

    x: Array
    v: Array
    R: Array
    w: Array


def _turn(R: Array, a: Array) -> Array:
    return np.einsum("nij,nj->ni", R, a)


def _back(R: Array, a: Array) -> Array:
    return np.einsum("nji,nj->ni", R, a)


def _body(inputs: Inputs, body: BodyRows, final: Final) -> dict[str, Array]:
    u, v, w = _back(final.R, final.v + inputs.velocity - inputs.wind).T
    R = final.R
    pitch = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    outcomes = {
        "alpha_deg": np.arctan2(-v, u),
        "beta_deg": np.arctan2(w, np.hypot(u, v)),
        "alpha_ref_deg": pitch - inputs.path_reference,
        "omega_x_deg_s": final.w[:, 0],
        "omega_y_deg_s": final.w[:, 1],
        "omega_z_deg_s": final.w[:, 2],
        "roll_deg": np.arctan2(R[:, 2, 1], R[:, 2, 2]),
        "yaw_deg": -np.arcsin(R[:, 2, 0]),
        "pitch_deg": pitch,
    }
    return {f"{body.name}_{key}": np.degrees(value) for key, value in outcomes.items()}


def outcomes(inputs: Inputs, first: Final, second: Final, release: Array) -> dict[str, Array]:
    """Outcome columns, in their units."""
    a, b = inputs.bodies
    gap = _back(first.R, second.x + _turn(second.R, b.arm) - first.x) - a.arm
    rate = (
        second.v
        + _turn(second.R, cross(second.w, b.arm))
        - first.v
        - _turn(first.R, cross(first.w, a.arm))
    )
    along = _back(first.R, rate) - cross(first.w, gap)
    return {
        **_body(inputs, a, first),
        **_body(inputs, b, second),
        "separation_speed_m_s": inputs.apart * along[:, 0],
        "separation_distance_mm": 1e3 * inputs.apart * gap[:, 0],
        "release_time_s": release,
    }
