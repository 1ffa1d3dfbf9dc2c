"""Loads by Python functions: they become formulas of the campaign."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sepmc
from sepmc.scene.formula import parse
from sepmc.scene.messages import InputError, SceneError
from sepmc.scene.symbols import Symbol, text, trace_load

STILL = {
    "phase": [{"name": "free"}],
    "initial.speed_m_s": 0.0,
    "initial.altitude_m": 0.0,
    "run.end_time_s": 1.0,
    "solver.step_s": 0.01,
}
TEXTS = [
    "a + b - (c - d)",
    "a - (b + c)",
    "a / (b * c) / d",
    "a * (b / c)",
    "(-a) ** 2 - -b ** 2",
    "(a ** b) ** c",
    "a ** b ** c",
    "a ** -b",
    "-(a + b)",
    "-(-2.5) * a",
    "a - -1e-07",
    "where(a < b and not (c <= d or a > 1.0), sin(a), -cos(b))",
    "where((a < b) and (b < c), 1.0, 2.0)",
    "max(min(a, b), upper.pitch_deg)",
    "atan2(a, b) + sqrt(abs(a)) * sign(b)",
]


@pytest.mark.parametrize("formula", TEXTS)
def test_text_of_a_tree_is_read_back(formula):
    tree = parse(formula)
    assert parse(text(tree)) == tree


def test_functions_of_numpy():
    q = Symbol()
    values = {
        "np": np.where((q.a < 1) & ~(q.b > 2) | (q.a >= 3), np.clip(q.a, -1, 1), abs(q.b) ** 2),
        "sum": 2 - q.upper.pitch_deg / 4 + np.float64(3) * q["upper.yaw_deg"] - (-q.a),
        "functions": np.sin(q.a) + np.arctan2(q.a, 2.0) + np.maximum(q.a, q.b) * np.sqrt(q.a),
    }
    texts = {key: text(value.node) for key, value in values.items()}
    assert texts == {
        "np": "where(a < 1.0 and not b > 2.0 or a >= 3.0, min(max(a, -1.0), 1.0), abs(b) ** 2.0)",
        "sum": "2.0 - upper.pitch_deg / 4.0 + 3.0 * upper.yaw_deg - -a",
        "functions": "sin(a) + atan2(a, 2.0) + max(a, b) * sqrt(a)",
    }


def plume(q):
    """Force and moment of a plume that fades."""
    fades = np.exp(-q.time_s / 0.2)
    return (6.0 * fades, 0.0, 0), (0.0, 0.0, -0.5 * q.fore.omega_z_rad_s)


def test_flight(pair):
    campaign = pair(STILL | {"initial.omega_deg_s": [0.0, 0.0, 10.0]})
    history = campaign.with_load("plume", plume, "fore", frame="ground").simulate(step_s=0.05)
    t = history["time_s"]
    assert_allclose(history["fore_omega_z_deg_s"], 10.0 * np.exp(-0.1 * t), rtol=0, atol=1e-10)
    assert_allclose(history["signal_plume_force_x"], 6.0 * np.exp(-t / 0.2), rtol=1e-13)
    assert "signal_plume_force_y" not in history


def test_run_folder_has_the_load(pair, plainly, tmp_path):
    """A run folder holds the formulas: it is replayed without the function, and has its digest."""
    settings = STILL | {"dispersion": {"body.fore.mass_kg": {"uniform": 0.5}}}
    del settings["solver.step_s"]
    campaign = pair(settings).with_load("plume", plume, "fore")
    other = pair(settings).with_load("plume", lambda q: (5.0 * q.time_s, 0, 0), "fore")
    assert len({campaign.digest, other.digest, pair(settings).digest}) == 3
    result = campaign.run(cases=2, out=tmp_path / "run")
    again = sepmc.load(tmp_path / "run")
    assert again.digest == campaign.digest
    assert again.file.tree["signal"][0]["formula"] == "6.0 * exp(-time_s / 0.2)"
    row = result.to_pandas().loc[1]
    assert again.simulate(1).attrs["outcomes"]["separation_speed_m_s"] == pytest.approx(
        row["separation_speed_m_s"], rel=1e-8
    )


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda q: (math.sin(q.time_s), 0, 0), "use functions of numpy, not of math"),
        (lambda q: (1.0 if q.time_s > 0.1 else 0.0, 0, 0), "use np.where"),
        (lambda q: (max(q.time_s, 0.1), 0, 0), "use np.where"),
        (lambda q: (np.sinh(q.time_s), 0, 0), "np.sinh is no function of formulas"),
        (lambda q: (np.interp(q.time_s, [0, 1], [0, 1]), 0, 0), "is no formula"),
        (lambda q: (q.time_s, 0), "must return three components"),
        (lambda q: q.time_s, "must return three components"),
        (lambda q: (q.time_s > 1, 0, 0), "is a condition, not a number"),
        (lambda q: ("1", 0, 0), "'1' is no number"),
        (lambda q: (q, 0, 0), "name a quantity, such as q.time_s"),
        (lambda q: (np.exp(Symbol(parse("2000"))), 0, 0), "undefined or too large"),
        (lambda q: ((q.time_s, 0, 0), (0, 0)), "must return three components"),
        (lambda q: None, "must return three components"),
    ],
)
def test_what_is_no_formula(function, message):
    with pytest.raises(InputError) as error:
        trace_load("plume", function)
    assert message in str(error.value)
    assert str(error.value).startswith("load plume: its function")


def test_unknown_quantity(pair):
    with pytest.raises(SceneError, match=r"signal.plume_force_x.formula.*no such body"):
        pair(STILL).with_load("plume", lambda q: (q.upper.pitch_deg, 0, 0), "fore")
