"""How cases end, against the independent flight."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from turning_pair import by_independent_flights

from sepmc.campaign.execution import step_selection
from sepmc.campaign.execution.accuracy import scene_scales
from sepmc.scene.model import GROUND
from sepmc.schema import Status

CASES, COMPARED = 60, 10
PINS = {"pins": 1, "engaged_m": 0.2, "slip_speed_m_s": 0.05}
BENT = {
    "body.aft.cg_m": [3.0, 0.5, 0.0],
    "joint.pins.guide": PINS | {"friction": 0.1},
    "load": [
        {"name": "push", "body": "aft", "force_N": [-8.0, 0.0, 0.0], "point_m": [3.0, 0.0, 0.0]},
        {"name": "bend", "body": "aft", "moment_N_m": [0.0, 0.0, 20.0], "start_s": 0.1},
    ],
    "phase": [{"name": "guided", "joints": {"pins": "slider"}}],
    "run.end_time_s": 0.12,
    "dispersion": {"joint.pins.guide.friction": {"uniform": [0.0, 0.6]}},
}
HELD = {
    "joint.pins.bodies": [GROUND, "aft"],
    "joint.hinge": {"bodies": ["aft", "fore"], "point_m": [1.5, 0.0, 0.0]},
    "phase": [{"name": "held", "joints": {"pins": "revolute", "hinge": "spherical"}}],
    "initial.speed_m_s": 0.0,
    "dispersion": {"initial.omega_rad_s.y": {"discrete": [0.0, 0.1], "weights": [0.5, 0.5]}},
}


TUNNEL = {
    "environment": {
        "atmosphere": "table",
        "gravity": "none",
        "air": {"altitude_m": [0.0, 2000.0], "density_kg_per_m3": [2.0, 2.0]},
    },
    "phase": [{"name": "free"}],
    "initial.speed_m_s": 100.0,
    "body.aft.aerodynamics": {
        "reference_area_m2": 1.0,
        "reference_length_m": 0.5,
        "table": {"alpha_deg": [-5.0, 5.0], "roll": [0.0, 0.0]},
    },
    "dispersion": {"initial.omega_deg_s.z": {"uniform": [0.0, 20.0]}},
}
LATE = {
    "joint.pins.delay_ms": 50.0,
    "phase": [
        {"name": "locked", "joints": {"pins": "fixed"}, "until": {"time_s": 0.3}},
        {"name": "free"},
    ],
    "dispersion": {"joint.pins.delay_ms": {"uniform": [0.0, 400.0]}},
}
SCENES = {
    "pins that jam": (BENT, Status.JAMMED),
    "out of a table": (TUNNEL, Status.OUTSIDE_TABLE),
    "above the air": (
        TUNNEL
        | {
            "initial.pitch_deg": 90.0,
            "initial.altitude_m": 1900.0,
            "dispersion": {"initial.speed_m_s": {"uniform": [100.0, 300.0]}},
        },
        Status.OUTSIDE_ATMOSPHERE,
    ),
    "late beyond the end": (LATE, Status.NEVER_RELEASED),
    "a mass below zero": (
        {"dispersion": {"body.aft.mass_kg": {"normal": 1.0}}},
        Status.INVALID_INPUT,
    ),
    "a start that a hinge does not allow": (HELD, Status.INCONSISTENT_START),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_as_the_independent_flight(pair, name, monkeypatch):
    """It says the same of every case, and has the same outcomes of those that have any."""
    monkeypatch.setattr(
        step_selection, "SAMPLE", 64
    )  # how well trial cases tell the error is not tested
    settings, expected = SCENES[name]
    campaign = pair({"run.end_time_s": 0.5} | settings | {"solver": {"accuracy": 1e-8}})
    result = campaign.run(cases=CASES)
    status = result.table["status"]
    assert 5 < np.count_nonzero(status == expected.label) < CASES - 5
    assert set(status) == {"ok", expected.label}
    columns = campaign.outcome_columns
    outcome = np.column_stack([result.table[c.name] / c.scale for c in columns])
    failed = status == expected.label
    assert np.isnan(outcome[failed]).all() == (expected != Status.NEVER_RELEASED)
    has_outcomes = ~failed | (expected == Status.NEVER_RELEASED)
    assert_array_equal(np.isfinite(result.table["error"]), has_outcomes)
    if expected != Status.INVALID_INPUT:  # the independent flight knows no limits of parameters
        statuses, outcomes = by_independent_flights(campaign, COMPARED)
        assert_array_equal(status[:COMPARED], statuses)
        there = has_outcomes[:COMPARED]
        units = [c.unit for c in columns]
        scale = scene_scales(campaign.scene, units)  # some outcomes are zero but for round-off
        assert (
            step_selection.relative_error(
                outcome[:COMPARED][there], outcomes[there], units, scale
            ).max()
            < 1e-6
        )
