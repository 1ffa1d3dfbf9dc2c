"""Joints that are released before or after any event, against the independent simulation."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from turning_pair import BOTH, MID, PUSH, TURNING, agrees, by_independent_flights, without_steps

from sepmc.campaign.execution import single_case, step_selection
from sepmc.kernel.emit.module import emit
from sepmc.kernel.spec import structure
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.kernel.spec.variant import Variant
from sepmc.schema import Status

CASES, COMPARED = 60, 12
PULL = {
    "name": "pull",
    "body": "aft",
    "thrust_N": 9.0,
    "build_up_s": 0.2,
    "station_m": 3.0,
    "cant_deg": 180.0,
}
FIXED = {"pins": "fixed", "other": "fixed"}
TWO = {
    **MID,
    "joint.pins.bodies": ["fore", "mid"],
    "joint.other": {"bodies": ["mid", "aft"], "point_m": [2.4, 0.3, 0.1]},
    "phase": [
        {"name": "held", "joints": FIXED, "until": {"time_s": 0.1}},
        {
            "name": "guided",
            "joints": {"other": "slider"},
            "until": {"joint": "other", "stroke_mm": 5.0},
        },
        {"name": "free"},
    ],
    "output": {"loads": ["pins", "other"], "tip_off": ["other", "pins"]},
}
AGAIN = {"bodies": BOTH, "point_m": [2.1, 0.2, 0.0]}
GUIDE = {"pins": 3, "circle_m": 0.3, "engaged_m": 0.5, "friction": 0.05, "slip_speed_m_s": 0.05}


def cut(joint, when, **more):
    return {"name": f"cut_{joint}", "joint": joint, "when": when, **more}


def by_load(threshold):
    """The second phase ends by a load of the remaining joint, while the first release may be
    delayed."""
    phases = [
        {"name": "held", "joints": FIXED, "until": {"time_s": 0.1}},
        {
            "name": "pulled",
            "joints": {"other": "fixed"},
            "until": {"joint": "other", "force_N": threshold},
        },
        {"name": "free"},
    ]
    return TWO | {"motor": [PULL], "phase": phases}


SCENES = {
    "late beyond the end of the next phase": TWO | {"joint.pins.delay_s": 0.25},
    "later than another that is late": TWO
    | {"joint.pins.delay_s": 0.21, "joint.other.delay_s": 0.03},
    "late twice, told twice before the first": TWO
    | {
        "joint.other.delay_s": 0.15,
        "phase": [
            *TWO["phase"][:1],
            {"name": "guided", "joints": {"other": "slider"}, "until": {"time_s": 0.12}},
            {"name": "free"},
        ],
    },
    "late, then holding what it held by other rows, which it had not in between": TWO
    | {
        "joint.other.kind": {"keyed": {"translations": ["y", "z"], "rotations": ["x", "z"]}},
        "joint.other.delay_s": 0.05,
        "joint.pins.delay_s": 0.08,
        "phase": [
            {"name": "held", "joints": FIXED, "until": {"time_s": 0.1}},
            {"name": "keyed", "joints": {"other": "keyed"}},
        ],
    },
    "late, while a load is waited for": by_load(5.0) | {"joint.pins.delay_s": 0.2},
    "late, while several conditions are waited for": TWO
    | {
        "joint.pins.delay_s": 0.15,
        "phase": [
            {"name": "held", "joints": FIXED, "until": {"time_s": 0.1}},
            {
                "name": "guided",
                "joints": {"other": "slider"},
                "until": {"any": [{"joint": "other", "stroke_mm": 5.0}, {"time_s": 0.22}]},
            },
            {"name": "free"},
        ],
    },
    "released in part": {
        "phase": [{"name": "held", "joints": {"pins": "fixed"}}],
        "release": [cut("pins", {"time_s": 0.1}, to="slider")],
        "output": {"loads": ["pins"]},
    },
    "released in part, then let go by a phase": {
        "phase": [
            {"name": "held", "joints": {"pins": "fixed"}, "until": {"time_s": 0.3}},
            {"name": "free"},
        ],
        "release": [cut("pins", {"time_s": 0.1}, to="slider")],
        "output": {"loads": ["pins"], "tip_off": ["pins"]},
    },
    "released while it is late in letting go in part": TWO
    | {"joint.other.delay_s": 0.1, "release": [cut("other", {"time_s": 0.05})]},
    "redundant, and late each by its own delay": {
        "joint.again": AGAIN | {"delay_s": 0.1},
        "joint.pins.delay_s": 0.05,
        "phase": [
            {
                "name": "held",
                "joints": {"pins": "fixed", "again": "spherical"},
                "until": {"time_s": 0.1},
            },
            {"name": "free"},
        ],
        "output": {"loads": ["pins", "again"], "tip_off": ["pins"]},
    },
    "redundant, until one breaks": {
        "motor": [PULL],
        "joint.again": AGAIN,
        "phase": [{"name": "held", "joints": {"pins": "fixed", "again": "fixed"}}],
        "release": [cut("again", {"joint": "again", "force_N": 1.5})],
        "output": {"loads": ["pins", "again"]},
    },
    "two joints break at the start, each by the load of the other": TWO
    | {
        "motor": [PULL | {"build_up_s": 0.0}],
        "phase": [{"name": "held", "joints": FIXED}],
        "release": [
            cut("pins", {"joint": "other", "force_N": 0.5}),
            cut("other", {"joint": "pins", "force_N": 0.5}),
        ],
    },
    "redundant guides": {
        "joint.pins.guide": GUIDE,
        "joint.again": AGAIN,
        "phase": [{"name": "guided", "joints": {"pins": "slider", "again": "slider"}}],
        "load": [PUSH | {"force_N": [6.0, 1.0, -0.5]}],
        "output": {"loads": ["pins", "again"], "guide": ["pins"]},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name):
    agrees(pair(TURNING | SCENES[name]))


# The same parameters vary in both, so that the same kernels fly them. Most corners of the second
# ask for the kernel that keeps no order, which then flies all of its cases.
DISPERSED = {
    "failing": (([0.6, 0.4], [0.0, 0.01], [0.0, 0.02]), True),
    "late": (([1.0, 0.0], [0.05, 0.35], [0.0, 0.2]), False),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DISPERSED)
def test_cases_that_keep_no_order_are_flown_by_a_kernel_that_asks_for_none(
    pair, name, tmp_path, monkeypatch
):
    monkeypatch.setattr(step_selection, "SAMPLE", 64)  # of any order a case takes milliseconds
    (weights, late, other_late), by_spare = DISPERSED[name]
    laws = {
        "joint.pins.fails": {"discrete": [0, 1], "weights": weights},
        "joint.pins.delay_s": {"uniform": late},
        "joint.other.delay_s": {"uniform": other_late},
    }
    campaign = pair(
        without_steps(TURNING | TWO) | {"dispersion": laws, "solver": {"accuracy": 1e-8}}
    )
    assert not make_kernel_spec(campaign.layout, campaign.dispersed).any_order
    assert (
        Variant.ANY_ORDER
        in [fallback.variant for fallback in step_selection.select_steps(campaign).fallbacks]
    ) == by_spare
    result = campaign.run(cases=CASES, out=tmp_path / "run")
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text(encoding="utf-8"))
    assert (manifest["accuracy"].get("n_fallback", 0) > 5) == by_spare
    status = result.table["status"]
    assert set(status) == {"ok", Status.NEVER_RELEASED.label}
    statuses, outcomes = by_independent_flights(campaign, COMPARED)
    assert_array_equal(status[:COMPARED], statuses)
    columns = campaign.outcome_columns
    outcome = np.column_stack([result.table[c.name] / c.scale for c in columns])[:COMPARED]
    sharp = [
        k for k, c in enumerate(columns) if not c.name.endswith(("force_time_s", "moment_time_s"))
    ]
    units = [columns[k].unit for k in sharp]
    assert step_selection.relative_error(outcome[:, sharp], outcomes[:, sharp], units).max() < 1e-6
    assert_allclose(result.accuracy.worst[1], 0.0, atol=2e-8)


def test_a_stage_is_flown_by_the_functions_of_the_next_where_that_holds_the_same(pair, monkeypatch):
    """Before two delayed releases the rows are equal: the functions of both segments are written
    once, with the results of separate ones."""
    balls = {"pins": "spherical", "other": "spherical"}
    phase = [{"name": "held", "joints": balls, "until": {"time_s": 0.1}}, {"name": "free"}]
    table = {"alpha_deg": [-180.0, -20.0, 20.0, 180.0], "normal": [-0.5, -0.5, 0.5, 0.5]}
    air = {"reference_area_m2": 1.0, "reference_length_m": 0.5, "table": table}
    late = TURNING | TWO | {"joint.pins.delay_s": 0.1, "joint.other.delay_s": 0.2, "phase": phase}
    late |= {"environment.atmosphere": "us1976", "body.aft.aerodynamics": air}
    shared = pair(late)
    kernel = step_selection.kernel_text(shared)
    assert "    rates_phase2_late(w)\n\n" in kernel
    assert "    correct_phase2_late(w)\n\n" in kernel
    assert "    look_up_phase2_late(w)\n\n" in kernel
    monkeypatch.setattr(structure, "_has_equal_rows", lambda *_: False)
    for room in (step_selection, single_case):  # kept texts know nothing of that
        monkeypatch.setattr(room, "written", emit)
    apart = pair(late)
    assert len(step_selection.kernel_text(apart)) > 1.1 * len(kernel)
    one, other = shared.simulate(), apart.simulate()
    assert one.attrs["status"] == "ok"
    assert_array_equal(one["phase"], other["phase"])
    numbers = one.select_dtypes("number").columns
    assert_allclose(one[numbers], other[numbers], rtol=1e-11, atol=1e-11)
