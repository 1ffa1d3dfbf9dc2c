"""Axes, outlines and winds that differ from case to case: every row as the independent flight has
it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from turning_pair import LOPSIDED, TURNING, by_independent_flights

from sepmc.kernel import formulas
from sepmc.physics import joints
from sepmc.scene.kinds import joint_axes
from sepmc.scene.messages import SceneError

CASES = 6
OUTPUT = {"loads": ["pins"], "tip_off": ["pins"]}
SLIDES = [
    {
        "name": "guided",
        "joints": {"pins": "slider"},
        "until": {"joint": "pins", "stroke_mm": 20.0},
    },
    {"name": "free"},
]
SPRING = {
    "name": "pusher",
    "bodies": ["fore", "aft"],
    "point_m": [2.0, 0.2, 0.1],
    "axis": [1.0, 0.0, 0.0],
    "force_N": 40.0,
    "stroke_mm": 60.0,
}
OUTLINES = {
    "body.fore.outline": [
        {"stations_m": [0.5, 1.8], "radii_m": [0.3, 0.35]},
        {"stations_m": [1.8, 2.4], "radii_m": [0.35, 0.35], "hollow": True},
    ],
    "body.aft.outline": [
        {"stations_m": [2.2, 3.4], "radii_m": [0.2, 0.3], "offset_m": [0.0, 0.05]},
        {"points_m": [[2.1, 0.1, 0.2], [2.15, -0.2, 0.1]]},
    ],
    "clearance": [{"name": "gap", "bodies": ["fore", "aft"]}],
}
SCENES = {
    "axes of a joint": TURNING
    | {
        "phase": SLIDES,
        "output": OUTPUT,
        "dispersion": {
            "joint.pins.x_axis.y": {"normal": 0.02},
            "joint.pins.x_axis.z": {"normal": 0.02},
            "joint.pins.y_axis.x": {"uniform": 0.1},
            "joint.pins.y_axis.z": {"uniform": 0.1},
        },
    },
    "axis of a spring": LOPSIDED
    | {
        "phase": [{"name": "free"}],
        "spring": [SPRING],
        "dispersion": {
            "spring.pusher.axis.y": {"normal": 0.05},
            "spring.pusher.axis.z": {"normal": 0.05},
            "spring.pusher.point_m.y": {"uniform": 0.05},
        },
    },
    "wind over height": LOPSIDED
    | {
        "environment.atmosphere": "us1976",
        "environment.wind.speed_m_s": 3.0,
        "environment.wind.profile": {
            "altitude_m": [995.0, 1000.0, 1005.0],
            "speed_m_s": [20.0, 35.0, 50.0],
            "direction_deg": [10.0, 40.0, 20.0],
            "factor": 0.9,
            "turn_deg": -15.0,
        },
        "body.aft.aerodynamics": {
            "reference_area_m2": 0.2,
            "reference_length_m": 0.5,
            "axial": {"const": 0.05},
            "normal": {"alpha": 0.1},
            "side": {"beta": 0.1},
        },
        "initial.speed_m_s": 60.0,
        "run.end_time_s": 0.2,
        "phase": [{"name": "free"}],
        "dispersion": {
            "environment.wind.profile.factor": {"normal": 0.2},
            "environment.wind.profile.turn_deg": {"uniform": 60.0},
        },
    },
    "outlines": TURNING
    | OUTLINES
    | {
        "phase": [{"name": "free"}],
        "dispersion": {
            "body.fore.outline.0.radii_m.1": {"uniform": 0.02},
            "body.fore.outline.1.stations_mm.1": {"uniform": 10.0},
            "body.fore.outline.1.radii_mm.0": {"uniform": 20.0},
            "body.aft.outline.0.offset_m.z": {"uniform": 0.03},
            "body.aft.outline.0.radii_m.0": {"normal": 0.01},
            "body.aft.outline.1.points_m.0.y": {"uniform": 0.05},
        },
    },
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.usefixtures("plainly")
def test_every_row_is_the_independent_flight_of_its_case(pair, name):
    campaign = pair(SCENES[name] | {"solver": {"accuracy": 1e-9}})
    table = campaign.run(cases=CASES).to_pandas()
    assert (table["status"] == "ok").all()
    statuses, outcomes = by_independent_flights(campaign, CASES)
    assert set(statuses) == {"ok"}
    varied = 0
    for k, column in enumerate(campaign.outcome_columns):
        found, expected = table[column.name] / column.scale, outcomes[:, k]
        if column.name.endswith(("force_time_s", "moment_time_s", "_x_mm", "_y_mm", "_z_mm")):
            continue  # as sharp as the peak, or the face, is
        if np.isfinite(expected).all():
            size = max(1e-3, float(np.abs(expected).max()))
            assert_allclose(found, expected, rtol=0, atol=2e-7 * size, err_msg=column.name)
            varied += np.ptp(expected) > 1e-4 * size
    assert varied >= {"outlines": 1, "wind over height": 4}.get(name, 10)


def test_a_wind_that_all_cases_have_is_multiplied_and_turned(pair):
    """Nominally, as one that varies by nothing."""
    scene = {key: value for key, value in SCENES["wind over height"].items() if key != "dispersion"}
    fixed = pair(scene).simulate()
    nothing = {"environment.wind.profile.factor": {"constant": 0.9}}
    varied = pair(scene | {"dispersion": nothing})
    assert_allclose(varied.simulate(0)["aft_vz_m_s"], fixed["aft_vz_m_s"], rtol=1e-13)
    plain = pair(scene | {"environment.wind.profile.factor": 1.0}).simulate()
    assert abs(plain["aft_vz_m_s"].iloc[-1] - fixed["aft_vz_m_s"].iloc[-1]) > 0.01


def test_outlines_on_both_sides_of_a_shells_wall(pair):
    """A disc of the second body, 0.4 to 0.6 m wide, within a shell of 0.5 m: what each case has
    follows from its own radius."""
    campaign = pair(
        {
            "phase": [{"name": "free"}],
            "body.fore.outline": [
                {"stations_m": [1.0, 3.0], "radii_m": [0.5, 0.5], "hollow": True}
            ],
            "body.aft.outline": [{"stations_m": [2.5, 2.5], "radii_m": [0.45, 0.45]}],
            "clearance": [{"name": "gap", "bodies": ["fore", "aft"]}],
            "dispersion": {
                "body.aft.outline.0.radii_m.1": {"uniform": [0.4, 0.49]},
                "body.fore.outline.0.radii_mm.0": {"uniform": [490.0, 510.0]},
            },
        }
    )
    table = campaign.run(cases=16).to_pandas()
    disc = np.maximum(table["in_body_aft_outline_0_radii_1_m"], 0.45)
    wide = 1e-3 * table["in_body_fore_outline_0_radii_0_mm"]
    # of the wall, a cone between its two radii, at right angles
    at_disc = wide + (0.5 - wide) * 0.75
    across = (at_disc - disc) * np.cos(np.arctan((0.5 - wide) / 2.0))
    assert_allclose(1e-3 * table["gap_clearance_mm"], across, rtol=0, atol=1e-9)


def test_axes_of_a_joint_are_those_of_the_scene():
    for x, y in (((1.0, 0.1, -0.2), (0.3, 2.0, 0.1)), ((0.0, 0.0, 3.0), (1.0, 1.0, 1.0))):
        axes = np.concatenate(joints.axes(x, y))
        assert_allclose(axes, joint_axes(x, y), rtol=0, atol=1e-15)
    assert formulas.joints.axes is not None


@pytest.mark.parametrize(
    ("path", "law", "says"),
    [
        ("body.aft.outline.0.radii_m.0", {"uniform": [-0.1, 0.2]}, "the law reaches -0.1, but"),
        ("body.aft.outline.0.radii_m.2", {"uniform": 0.1}, "'2' is no component; allowed: 0, 1"),
        ("body.aft.outline.1.points_m", {"uniform": 0.1}, "is an array; name one of its items: .0"),
        ("body.aft.outline.1.points_m.0", {"uniform": 0.1}, "is a vector; name one component: .x"),
        ("body.fore.outline.1.stations_m.0", {"uniform": 0.7}, "the shell may have no length"),
        ("joint.pins.y_axis.x", {"uniform": [0.0, 1e9]}, "may be zero or parallel to x_axis"),
        ("spring.pusher.axis.x", {"uniform": 1.0}, "may be zero"),
    ],
)
def test_what_may_not_be_is_refused(pair, path, law, says):
    with pytest.raises(SceneError, match=says.replace("(", r"\(")):
        pair(OUTLINES | {"phase": SLIDES, "spring": [SPRING], "dispersion": {path: law}})
