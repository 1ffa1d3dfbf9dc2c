"""Axes, outlines and winds that differ from case to case: every row agrees with the independent
simulation."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from turning_pair import LOPSIDED, TURNING, by_independent_flights, without_steps

from sepmc import schema
from sepmc.campaign.execution import step_selection
from sepmc.engine.dispatch import integrate_cases, interpreted, load_kernel
from sepmc.physics import joints, vec3
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


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.usefixtures("plainly")
def test_every_row_is_the_independent_flight_of_its_case(pair, name):
    campaign = pair({"solver": {"accuracy": 1e-9}} | without_steps(SCENES[name]))
    table = campaign.run(cases=CASES).to_pandas()
    assert (table["status"] == "ok").all()
    statuses, outcomes = by_independent_flights(campaign, CASES)
    assert set(statuses) == {"ok"}
    varied = 0
    for k, column in enumerate(campaign.outcome_columns):
        result, expected = table[column.name] / column.scale, outcomes[:, k]
        if column.name.endswith(("force_time_s", "moment_time_s", "_x_mm", "_y_mm", "_z_mm")):
            continue  # as sharp as the peak, or the face, is
        if np.isfinite(expected).all():
            size = max(1e-3, float(np.abs(expected).max()))
            assert_allclose(result, expected, rtol=0, atol=2e-7 * size, err_msg=column.name)
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


@pytest.mark.slow
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
    kernel, draws = (
        load_kernel(step_selection.kernel_text(campaign)),
        campaign.in_si(campaign.sample(0, 16)),
    )
    steps = np.full(1, 4), np.full(1, np.inf)
    block, _ = integrate_cases(kernel, campaign.layout, *steps, campaign.slots, draws)
    names = [column.name for column in schema.result_columns(campaign.layout.contents)]
    compiled = block.outcomes[:, names.index("gap_clearance_mm")]
    disc = np.maximum(table["in_body_aft_outline_0_radii_1_m"], 0.45)
    wide = 1e-3 * table["in_body_fore_outline_0_radii_0_mm"]
    # of the wall, a cone between its two radii, at right angles
    at_disc = wide + (0.5 - wide) * 0.75
    across = (at_disc - disc) * np.cos(np.arctan((0.5 - wide) / 2.0))
    assert_allclose(1e-3 * table["gap_clearance_mm"], across, rtol=0, atol=1e-9)
    assert_allclose(compiled, across, rtol=0, atol=1e-9)


def test_axes_of_a_joint_are_those_of_the_scene():
    for x, y in (((1.0, 0.1, -0.2), (0.3, 2.0, 0.1)), ((0.0, 0.0, 3.0), (1.0, 1.0, 1.0))):
        ahead = vec3.unit(x)
        up = joints.across(ahead, y)
        axes = np.concatenate([ahead, up, vec3.cross(ahead, up)])
        assert_allclose(axes, joint_axes(x, y), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_compiled_as_in_plain_python(pair):
    """Axes and wind in one scene, whose start is too long for one loop: compiled, and as plain
    Python."""
    names = [name for name in SCENES if name != "outlines"]
    scene = {key: value for name in names for key, value in SCENES[name].items()}
    laws = {key: law for name in names for key, law in SCENES[name]["dispersion"].items()}
    mid = {"body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.0]}}
    scene |= mid | {
        "joint.ball": {"bodies": ["fore", "mid"], "point_m": [2.0, 0.0, 0.0]},
        "phase": [
            {"name": "held", "joints": {"ball": "universal"}, "until": {"time_s": 0.1}},
            {"name": "free"},
        ],
        "dispersion": laws
        | {
            "joint.ball.x_axis.y": {"normal": 0.01},
            "joint.pins.omega_deg_s.z": {"normal": 5.0},
        },
    }
    campaign, results = pair(scene), []
    text, draws = step_selection.kernel_text(campaign), campaign.in_si(campaign.sample(0, 9))
    assert text.split("def prepare(w):")[1].count("for l in range(LANES):") > 2
    for interpreting in (False, True):
        with interpreted(interpreting):
            kernel = load_kernel(text)
        steps = np.full(kernel.n_segments, 16), np.full(kernel.n_segments, 0.1)
        block, _ = integrate_cases(kernel, campaign.layout, *steps, campaign.slots, draws)
        results.append(block)
    compiled, plain = results
    assert list(compiled.status) == list(plain.status) == [0] * 9
    for k, column in enumerate(schema.result_columns(campaign.layout.contents)):
        if not column.name.endswith(("force_time_s", "moment_time_s")):
            size = max(1e-3, float(np.nanmax(np.abs(plain.outcomes[:, k]), initial=0.0)))
            assert_allclose(
                compiled.outcomes[:, k],
                plain.outcomes[:, k],
                rtol=0,
                atol=1e-10 * size,
                err_msg=column.name,
            )


@pytest.mark.parametrize(
    "laws",
    [
        {"spring.pusher.axis.y": {"uniform": [2.0, 3.0]}},
        {"spring.pusher.axis.z": {"normal": 0.5}},
        {"spring.pusher.axis.x": {"uniform": [0.5, 20.0]}},
        {f"joint.pins.x_axis.{x}": {"uniform": [0.2, 2.0]} for x in "xyz"},
    ],
)
def test_axes_that_always_have_a_direction_are_let_through(pair, laws):
    pair({"phase": SLIDES, "spring": [SPRING], "dispersion": laws})


def test_outlines_are_set(pair):
    campaign = pair(OUTLINES | {"phase": SLIDES}).with_settings(
        {
            "body.aft.outline.0.radii_m.1": 0.25,
            "body.aft.outline.0.offset_mm.y": 10.0,
            "body.aft.outline.1.points_m.1.z": 0.3,
        }
    )
    frustum, points = campaign.scene.body["aft"].outline
    assert (frustum.radii, frustum.offset) == ((0.2, 0.25), (0.01, 0.05))
    assert points.points == ((2.1, 0.1, 0.2), (2.15, -0.2, 0.3))


@pytest.mark.parametrize(
    ("path", "law", "says"),
    [
        (
            "body.aft.outline.0.radii_m.0",
            {"uniform": [-0.1, 0.2]},
            "the distribution reaches -0.1, but",
        ),
        ("body.aft.outline.0.radii_m.2", {"uniform": 0.1}, "'2' is no component; allowed: 0, 1"),
        ("body.aft.outline.1.points_m", {"uniform": 0.1}, "is an array; name one of its items: .0"),
        ("body.aft.outline.1.points_m.0", {"uniform": 0.1}, "is a vector; name one component: .x"),
        (
            "body.fore.outline.1.stations_m.0",
            {"uniform": 0.7},
            "the shell or sector may have no length",
        ),
        ("joint.pins.y_axis.y", {"uniform": 1.0}, "may be zero or parallel to x_axis"),
        ("joint.pins.x_axis.x", {"uniform": 1.0}, "x_axis = [1.0, 0.0, 0.0]: the axis may be zero"),
        ("spring.pusher.axis.x", {"uniform": 1.0}, "may be zero"),
        ("body.aft.outline.0.points_m.0.x", {"uniform": 1.0}, "'points' is not set in this scene"),
        ("body.aft.outline.1.offset_m.y", {"uniform": 1.0}, "and this part has points"),
    ],
)
def test_what_may_not_be_is_refused(pair, path, law, says):
    with pytest.raises(SceneError, match=re.escape(says)):
        pair(OUTLINES | {"phase": SLIDES, "spring": [SPRING], "dispersion": {path: law}})
