"""Proximity increments on grids over relative position and attitude."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.independent import simulate
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sepmc.scene.messages import SceneError

AXES = {
    "x_mm": [-900.0, -300.0, 20.0, 400.0],
    "z_m": [-0.2, 0.01, 0.05, 0.3],
    "pitch_deg": [-40.0, -8.0, 5.0, 60.0],
}
SI = {"x_mm": 1e-3, "z_m": 1.0, "pitch_deg": np.pi / 180.0}
AREA, SPEED = 0.01, 100.0


def grid(axes, seed=1, size=1.0):
    """Random numbers on axes."""
    return size * np.random.default_rng(seed).random([len(AXES[key]) for key in axes])


def scene(axes, interpolation, step_s=5e-3):
    """Two bodies that drift and turn against each other; the aft one, 1 kg, is in the air."""
    near = {key: AXES[key] for key in axes}
    return {
        "environment": {
            "atmosphere": "table",
            "gravity": "none",
            "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]},
        },
        "body.aft.aerodynamics": {"reference_area_m2": AREA, "reference_length_m": 0.5},
        "proximity": [
            {
                "name": "near",
                "body": "aft",
                "joint": "pins",
                "axes": near,
                "axial": grid(axes).tolist(),
                "normal": grid(axes, 2, 0.1).tolist(),
                "pitch": grid(axes, 3, 0.02).tolist(),
                "factor": 1.5,
                "interpolation": interpolation,
            }
        ],
        "load": [
            {"name": "side", "body": "fore", "force_N": [1.0, 0.5, 3.0], "point_m": [2.0, 0.0, 0.0]}
        ],
        "joint.pins.omega_deg_s": [3.0, 5.0, 80.0],
        "joint.pins.x_axis": [0.8, 0.6, 0.0],
        "joint.pins.y_axis": [-0.6, 0.8, 0.0],
        "initial.speed_m_s": SPEED,
        "phase": [{"name": "free"}],
        "run.end_time_s": 0.4,
        "solver.step_s": step_s,
    }


def line(points, rows, x):
    """Values along the first axis at a point: lines."""
    k = min(max(int(np.searchsorted(points, x)) - 1, 0), len(points) - 2)
    part = (x - points[k]) / (points[k + 1] - points[k])
    return (1.0 - part) * rows[k] + part * rows[k + 1]


def spline(points, rows, x):
    """Values along the first axis at a point: a spline with zero slope at its ends."""
    return CubicSpline(points, rows, bc_type="clamped")(x)


@pytest.mark.parametrize("axes", [("x_mm", "z_m", "pitch_deg"), ("z_m", "pitch_deg"), ("z_m",)])
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_values_along_a_flight(pair, axes, interpolation):
    """The axial acceleration at all rows of a history against interpolants of scipy at the
    relative position and attitude of that row; partly beyond the ends."""
    campaign = pair(scene(axes, interpolation))
    history = campaign.simulate(step_s=0.05)
    assert history.attrs["status"] == "ok"
    joint = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    at_least_one_beyond, value = False, {"linear": line, "cubic": spline}[interpolation]
    cg = {name: np.array(body.cg) for name, body in campaign.scene.body.items()}
    for _, row in history.iterrows():
        r, x, arm = {}, {}, {}
        for name in ("fore", "aft"):
            angles = [row[f"{name}_{key}_deg"] for key in ("pitch", "yaw", "roll")]
            r[name] = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
            x[name] = row[[f"{name}_{key}_m" for key in "xyz"]].to_numpy(float)
            arm[name] = (np.array([2.0, 0.0, 0.0]) - cg[name]) * [-1.0, 1.0, 1.0]
        between = x["aft"] + r["aft"] @ arm["aft"] - x["fore"] - r["fore"] @ arm["fore"]
        turned = joint @ r["fore"].T @ r["aft"] @ joint.T
        shift = joint @ r["fore"].T @ between
        motion = {"x_mm": shift[0], "z_m": shift[2]}
        motion["pitch_deg"] = np.arctan2(turned[1, 0], turned[0, 0])
        rows = grid(axes)
        for key in axes:
            points = SI[key] * np.array(AXES[key])
            rows = value(points, rows, np.clip(motion[key], points[0], points[-1]))
            at_least_one_beyond |= not points[0] < motion[key] < points[-1]
        flow = r["aft"].T @ row[[f"aft_v{key}_m_s" for key in "xyz"]].to_numpy(float)
        pressure = 0.5 * 2.0 * flow @ flow * AREA
        mass = campaign.scene.body["aft"].mass
        expected = -1.5 * rows * pressure / mass
        assert_allclose(row["aft_axial_acceleration_m_s2"], expected, rtol=1e-9)
    assert at_least_one_beyond or len(axes) < 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interpolation", "step_s"), [("linear", 5e-3), ("cubic", 5e-4), ("monotone", 5e-4)]
)
def test_against_the_independent_flight(pair, interpolation, step_s):
    """Every outcome to 1e-9 over three axes; with lines at long steps, as they end at kinks."""
    campaign = pair(scene(AXES, interpolation, step_s))
    result = campaign.simulate(step_s=0.4).attrs
    expected = simulate(campaign.nominal().to_dict())
    assert result["status"] == expected.status == "ok"
    for name, value in expected.outcomes.items():
        assert_allclose(result["outcomes"][name], value, rtol=1e-9, atol=1e-9, err_msg=name)
    if interpolation == "linear":
        assert max(result["errors"].values()) < 1e-9


def test_a_joint_that_holds_is_at_zero(pair):
    """While the pair is fixed the increments are those at zero: load and drag accelerate both
    bodies."""
    phases = [{"name": "locked", "joints": {"pins": "fixed"}}]
    settings = scene(AXES, "linear") | {"phase": phases, "joint.pins.omega_deg_s": [0.0, 0.0, 0.0]}
    history = pair(settings).simulate(step_s=0.4)
    assert history.attrs["status"] == "ok"
    rows = grid(AXES)
    for key, points in AXES.items():
        rows = line(SI[key] * np.array(points), rows, 0.0)
    drag = 1.5 * rows * 0.5 * 2.0 * SPEED**2 * AREA
    first = history["aft_axial_acceleration_m_s2"].iloc[0]
    assert_allclose(first, (1.0 - drag) / (1.0 + 3.0), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distance_m": [0.0, 1.0]}, r"distance_m.*not both"),
        ({"axes": {}}, r"axes: needs one to three of x, y, z, pitch, yaw, roll"),
        ({"axes": {"x_m": [0.0]}}, r"axes\.x_m = \[0\.0\]: needs at least 2"),
        ({"axes": {"x_m": [0.0, 1.0], "yaw_deg": [0.0, 1.0]}}, "but the axes ask for 2"),
        ({"axes": {"pitch": [0.0, 1.0]}}, "the unit is missing"),
    ],
)
def test_wrong_axes_are_refused(pair, change, message):
    settings = scene(("x_mm", "z_m"), "cubic")
    settings["proximity"][0] |= change
    with pytest.raises(SceneError, match=message):
        pair(settings)
