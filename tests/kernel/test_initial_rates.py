"""Initial angular rates across a joint."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from turning_pair import MID, TURNING, agrees, by_independent_flights, without_steps

from sepmc.scene.messages import SceneError

CHAIN = {
    **MID,
    "joint.pins.bodies": ["fore", "mid"],
    "joint.other": {"bodies": ["mid", "aft"], "point_m": [2.4, 0.3, 0.1]},
}


def held(**kinds):
    """One phase after another: the joints are of these kinds, then free."""
    return [{"name": "held", "joints": kinds, "until": {"time_s": 0.2}}, {"name": "free"}]


SCENES = {
    "a hinge": {"phase": held(pins="revolute"), "joint.pins.omega_deg_s": [40.0, 0.0, 0.0]},
    "a ball joint": {
        "phase": held(pins="spherical"),
        "joint.pins.omega_deg_s": [40.0, -20.0, 30.0],
        "output": {"loads": ["pins"], "tip_off": ["pins"]},
    },
    "a joint that holds nothing": {
        **CHAIN,
        "phase": held(other="spherical"),
        "joint.pins.omega_deg_s": [40.0, -20.0, 30.0],
    },
    "a chain of two": {
        **CHAIN,
        "phase": held(pins="spherical", other="spherical"),
        "joint.pins.omega_deg_s": [0.0, 25.0, -10.0],
        "joint.other.omega_deg_s": [15.0, 0.0, 40.0],
    },
    "two that turn as one": {
        **CHAIN,
        "phase": held(pins="spherical", other="fixed"),
        "joint.pins.omega_deg_s": [5.0, 25.0, -10.0],
    },
    "one of a held vehicle": {
        "joint.post": {"bodies": ["ground", "fore"], "point_m": [0.5, 0.0, 0.0]},
        "phase": held(post="fixed", pins="universal"),
        "initial.speed_m_s": 0.0,
        "initial.omega_rad_s": [0.0, 0.0, 0.0],
        "joint.pins.omega_deg_s": [30.0, 20.0, 0.0],
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    agrees(pair(TURNING | SCENES[name]))


def test_a_stage_on_a_hinge_turns_about_its_point(pair):
    """Only the hinge acts: the second body, 1 kg, 1 m behind it, rotates about it at 90 deg/s; a
    first body of 1e9 kg does not move."""
    history = pair(
        {
            "body.fore.mass_kg": 1e9,
            "body.fore.inertia_kg_m2": [1e9, 1e9, 1e9],
            "joint.pins.omega_deg_s": [0.0, 0.0, 90.0],
            "joint.pins.x_axis": [0.0, 0.0, 1.0],
            "phase": [{"name": "hinged", "joints": {"pins": "revolute"}}],
            "initial.pitch_deg": 30.0,
        }
    ).simulate(step_s=0.05)
    turned = np.radians(30.0 + 90.0 * history["time_s"])
    across = history["aft_x_m"] - history["fore_x_m"], history["aft_y_m"] - history["fore_y_m"]
    start = np.radians(30.0)  # to the hinge, 1 m behind the first body
    assert_allclose(across[0], -np.cos(start) - np.cos(turned), atol=1e-8)
    assert_allclose(across[1], -np.sin(start) - np.sin(turned), atol=1e-8)
    assert_allclose(history["aft_omega_z_deg_s"], 90.0, rtol=1e-8)
    assert_allclose(history["fore_omega_z_deg_s"], 0.0, atol=1e-6)


@pytest.mark.usefixtures("plainly")
def test_it_varies_from_case_to_case(pair):
    """Zero nominally; a rate about another axis than that of the hinge is an inconsistent start."""
    laws = {"joint.pins.omega_deg_s.x": {"normal": 20.0}}
    campaign = pair(
        without_steps(TURNING)
        | {"phase": held(pins="revolute"), "dispersion": laws, "solver": {"accuracy": 1e-9}}
    )
    table = campaign.run(cases=5).to_pandas()
    statuses, outcomes = by_independent_flights(campaign, 5)
    assert list(table["status"]) == statuses == ["ok"] * 5
    for k, column in enumerate(campaign.outcome_columns):
        if "omega" in column.name or "separation" in column.name:
            size = max(1e-3, float(np.abs(outcomes[:, k]).max()))
            assert_allclose(
                table[column.name] / column.scale, outcomes[:, k], rtol=0, atol=1e-7 * size
            )
    skew = laws | {"joint.pins.x_axis.y": {"normal": 0.1}}
    jammed = campaign.with_settings({"dispersion": skew}).run(cases=3).to_pandas()
    assert list(jammed["status"]) == ["inconsistent-start"] * 3


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ({"phase": held(pins="fixed")}, "must be 0 about an axis that 'fixed', its kind in the"),
        ({"phase": held(pins="revolute")}, "must be 0 about an axis that 'revolute'"),
        (
            {
                "phase": held(pins="revolute"),
                "joint.pins.omega_deg_s": [1.0, 0.0, 0.0],
                "dispersion": {"joint.pins.omega_deg_s.y": {"uniform": 1.0}},
            },
            "omega_deg_s.y: would vary about an axis that 'revolute'",
        ),
        (
            {
                "joint.again": {"bodies": ["fore", "aft"], "point_m": [2.0, 0.5, 0.0]},
                "phase": held(pins="spherical", again="spherical"),
            },
            "fore is connected to the second body by other joints too",
        ),
        (
            {
                "joint.post": {"bodies": ["ground", "aft"], "point_m": [2.5, 0.0, 0.0]},
                "phase": held(post="spherical", pins="spherical"),
                "initial.speed_m_s": 0.0,
            },
            "would turn the ground",
        ),
    ],
)
def test_what_joints_do_not_allow_is_refused(pair, scene, says):
    with pytest.raises(SceneError, match=says):
        pair({"joint.pins.omega_deg_s": [0.0, 5.0, 10.0]} | scene)


def test_a_rate_about_an_oblique_hinge_varies_by_its_components_together(pair, plainly):
    """Sampled together, rates along the hinge are valid, others are an inconsistent start."""
    laws = {f"joint.pins.omega_deg_s.{x}": {"discrete": [10.0, 20.0]} for x in "xy"}
    campaign = pair(
        TURNING
        | {
            "joint.pins.x_axis": [1.0, 1.0, 0.0],
            "joint.pins.y_axis": [0.0, 0.0, 1.0],
            "phase": held(pins="revolute"),
            "dispersion": laws,
        }
    )
    table = campaign.run(cases=8).to_pandas()
    x, y = (table[f"in_joint_pins_omega_{axis}_deg_s"] for axis in "xy")
    assert list(table["status"] == "ok") == list(x == y)
    assert 0 < (x == y).sum() < 8
