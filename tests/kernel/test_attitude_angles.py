"""Pitch and roll with full turns, close to the vertical, where a step alone does not determine on
which side of it the x axis passed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from support.compiled import compiled

from sepmc.physics import quat

END, CASES = 2.0, 3000
RATES = 0.8  # rad/s
ROUND = {"inertia_kg_m2": [2.0, 2.0, 2.0]}
TUMBLING = {
    "body.aft.inertia_kg_m2": [2.0, 2.0, 2.0],
    "phase": [{"name": "free"}],
    "initial": {
        "altitude_m": 0.0,
        "speed_m_s": 1.0,
        "omega_rad_s": [0.0, 0.0, 0.0],
        "yaw_deg": 60.0,
    },
    "run.end_time_s": END,
    "solver": {"accuracy": 1e-6},
    "dispersion": {f"initial.omega_rad_s.{axis}": {"uniform": RATES} for axis in "xyz"},
}


def followed(omega, count=20_001):
    """Pitch and roll, deg, of a round body, and the sine of the minimum angle from the vertical: it
    rotates evenly about an axis fixed in body and space."""
    turns = Rotation.from_euler("ZYX", [0.0, np.radians(60.0), 0.0]) * Rotation.from_rotvec(
        np.outer(np.linspace(0.0, END, count), omega)
    )
    m = turns.as_matrix()
    results = [
        np.degrees(np.unwrap(np.arctan2(y, x)))[-1]
        for y, x in ((m[:, 1, 0], m[:, 0, 0]), (m[:, 2, 1], m[:, 2, 2]))
    ]
    return *results, np.hypot(m[:, 0, 0], m[:, 1, 0]).min()


@pytest.mark.slow
def test_pitch_and_roll_are_followed_past_the_vertical(pair):
    """Bodies that rotate evenly, some within 0.1 deg of the vertical: pitch and roll as those of
    20,000 samples."""
    campaign = pair(TUMBLING)
    table = campaign.run(cases=CASES, seed=3).to_pandas()
    omegas = table[[f"in_initial_omega_{axis}_rad_s" for axis in "xyz"]].to_numpy()
    assert (table["status"] == "ok").all()
    close = np.flatnonzero([followed(omega, 101)[2] < np.radians(2.0) for omega in omegas])
    expected = np.array([followed(omega) for omega in omegas[close]])
    assert len(close) > 20
    for k, name in enumerate(("pitch", "roll")):
        assert_allclose(
            table[f"aft_{name}_deg"][close], expected[:, k], rtol=0, atol=2e-3, err_msg=name
        )
    nearest = int(np.argmin(expected[:, 2]))
    alone = campaign.simulate(campaign.case(int(close[nearest]), seed=3), step_s=0.1).attrs[
        "outcomes"
    ]
    assert_allclose(
        [alone["aft_pitch_deg"], alone["aft_roll_deg"]], expected[nearest, :2], rtol=0, atol=2e-3
    )


winds = compiled(quat.may_wind)


def test_which_paths_may_pass_the_origin_on_either_side():
    """By how close the straight line comes to it, ends included; a path of no length that is not
    bent is not in doubt, nor is one through the origin, as of a body that only yaws."""
    assert winds((1.0, 0.1), (-1.0, 0.1), 0.11)
    assert not winds((1.0, 0.1), (-1.0, 0.1), 0.09)
    assert not winds((1.0, 0.0), (2.0, 0.0), 0.9)
    assert winds((1.0, 0.0), (2.0, 0.0), 1.1)
    assert not winds((0.3, 0.4), (0.3, 0.4), 0.0)
    assert not winds((1.0, 1e-15), (-1.0, -1e-15), 0.5)
