"""Whole flights through the public API: closed forms, conservation, the independent oracle, and what must not change the answer."""

import math

import numpy as np
import oracle
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sepmc import cases
from sepmc.campaign import Campaign, _fly
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status

LBF, FT = 4.4482216152605, 0.3048
SLIDER, FREE = {"name": "guided", "joints": {"pins": "slider"}}, {"name": "free"}
LOPSIDED = {"body.fore.cg_m": [1.0, 0.05, -0.02], "body.aft.cg_m": [3.0, -0.04, 0.03], "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15]}
RETRO = {"name": "retro", "body": "aft", "thrust_N": 2.0, "station_m": 3.0, "cant_deg": 180.0}  # 2 m/s2 on the aft body
SIGN_CHANGES = ("beta_deg", "omega_x_deg_s", "omega_y_deg_s", "roll_deg", "yaw_deg")  # of a flight seen in the mirror z -> -z


def until(stroke_mm):
    return [SLIDER | {"until": {"joint": "pins", "stroke_mm": stroke_mm}}, FREE]


def state(history, body):
    """Place, velocity, attitude, rates in body axes."""
    x, v = (np.array(history[[f"{body}_{p}{a}_{u}" for a in "xyz"]]) for p, u in (("", "m"), ("v", "m_s")))
    angles = np.array(history[[f"{body}_{a}_deg" for a in ("pitch", "yaw", "roll")]])
    omega = np.radians(np.array(history[[f"{body}_omega_{a}_deg_s" for a in "xyz"]]))
    return x, v, Rotation.from_euler("ZYX", angles, degrees=True), omega


def tensors(campaign):
    """Mass and inertia tensor of each body."""
    for body in campaign.scene.body.values():
        (xx, yy, zz), (xy, xz, yz) = body.inertia, body.inertia_products
        yield body.mass, np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


@pytest.fixture(scope="module")
def sample(table2):
    """2,000 cases of Table 2 without histories."""
    return table2.with_settings({"run.history_step_s": 0.0}).run(cases=2000)


def worst(sample, found, expected, names=None):
    """Largest |difference| / max(|expected|, sigma of the outcome over the sample), and its outcome."""
    scaled = {
        name: np.max(np.abs(found[name] - expected[name]) / np.maximum(np.abs(expected[name]), sample.table[name].std(ddof=1)))
        for name in names or sample.outcomes
    }
    assert np.isfinite(list(scaled.values())).all()
    name = max(scaled, key=scaled.get)
    print(f"worst {scaled[name]:.1e} in {name}")
    return scaled[name]


@pytest.mark.parametrize("formulation", ["reduced", "full"])
def test_nasa_two_boxes(pair, formulation):
    """Fixed joint, torque-free: NASA/TP-2016-219326 test case 1, numbers of DOMAIN.md 1.2, to the digits printed there."""
    boxes = {
        "A": {"mass_slug": 1.0, "inertia_slug_ft2": [5 / 12, 26 / 12, 29 / 12], "cg_ft": [4.5, 0.0, 0.0]},
        "B": {"mass_slug": 0.4, "inertia_slug_ft2": [1 / 6, 1 / 6, 4 / 15], "cg_ft": [1.0, 0.0, 0.0]},
    }
    scene = {"body": boxes, "joint.pins": {"bodies": ["A", "B"], "point_ft": [2.0, 0.0, 0.0]}, "run.end_time_s": 10.0}
    history = pair(scene | {"initial.omega_rad_s": [0.5, 1.0, -0.3], "solver.formulation": formulation}).simulate(step_s=1.0)
    first = history.iloc[0]
    assert_allclose([first[f"pins_force_on_B_{a}_N"] / LBF for a in "xyz"], [-1.09, 0.0754717, -0.006], rtol=0, atol=5e-8)
    assert_allclose([first[f"pins_moment_on_B_{a}_N_m"] / (LBF * FT) for a in "xyz"], [0.0, -0.003, -0.0377358], rtol=0, atol=5e-8)
    assert_allclose(state(history, "A")[3][-1], [0.43643767, 1.04653498, -0.07596399], rtol=0, atol=1e-8)


def test_locked_pair_is_one_rigid_body(pair):
    """Euler's equations of the composite by scipy: rates, attitude and places of both bodies agree to 1e-10 after 2 s."""
    campaign = pair(LOPSIDED | {"initial.omega_rad_s": [2.0, 1.0, -1.5], "initial.altitude_m": 0.0, "run.end_time_s": 2.0})
    places = np.array([[0.5, 0.0225, -0.0125 * 0 + 0.0], [-1.5, 0.0, 0.0]])
    cg = np.array([[1.0, 0.05, -0.02], [3.0, -0.04, 0.03]])
    masses = [mass for mass, _ in tensors(campaign)]
    places = (cg - np.average(cg, axis=0, weights=masses)) * (-1.0, 1.0, 1.0)
    inertia = sum(j + m * (p @ p * np.eye(3) - np.outer(p, p)) for (m, j), p in zip(tensors(campaign), places, strict=True))

    def euler(_, y):
        r, w = y[:9].reshape(3, 3), y[9:]
        return np.concatenate([np.cross(r, -w).ravel() * -1.0 if False else (r @ np.cross(np.eye(3), -w)).ravel(), np.linalg.solve(inertia, np.cross(inertia @ w, w))])

    solved = solve_ivp(euler, (0.0, 2.0), [*np.eye(3).ravel(), 2.0, 1.0, -1.5], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
