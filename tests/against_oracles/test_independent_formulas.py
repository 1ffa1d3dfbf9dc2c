"""Formulas of the independent simulation against those of the engine, and their odd names."""

import math

import pytest
from numpy.testing import assert_allclose
from oracles.independent.case import SIGNAL
from oracles.independent.formulas import Evaluation, Formulas, NamedValues, Undefined
from oracles.random_scenes.equivalent_scenes import renamed
from oracles.random_scenes.names import _HOSTILE

from sepmc.scene.formula import FUNCTIONS, MAX_DEPTH, evaluate, names, parse

VALUES = (0.7, -1.3, 2.0)
MANY = " - ".join(["a", "0.5 * b"] * 49)
ONE_OF_EACH = {
    **{name: f"{name}(a)" for name, count in FUNCTIONS.items() if count == 1},
    "atan2": "atan2(b, -a)",
    "min": "min(a, b, -2.5, c)",
    "max": "max(-a, b, c, 0.1)",
    "clip": "clip(b, -1, c) + clip(a, -1, 0.5) + clip(c, 3, 2)",
    "where": "where(a < 1 <= c and not b > 0 or c < 0, a, b) + where(not (a < b), 1, 2)",
}


def in_the_flight(text, values):
    """Value of a formula by the independent simulation; NaN if it is undefined."""

    def read(items, key, t, s):
        return values[".".join([*items, key])]

    signal = {**SIGNAL, "name": "f", "formula": text, "constants": {}}
    formulas = Formulas({"signal": [signal], "driven": {}}, None, read)
    try:
        return Evaluation(formulas, 0.0, None).signal("f")
    except Undefined:
        return math.nan


def check(text):
    tree = parse(text)
    values = dict(zip(names(tree), VALUES * 20, strict=False))
    expected = float(evaluate(tree, values))
    of_units = {name.removesuffix("_rad_s"): value for name, value in values.items()}
    assert_allclose(in_the_flight(text, of_units), expected, rtol=1e-13)


def test_functions():
    assert set(ONE_OF_EACH) == set(FUNCTIONS)
    for text in ONE_OF_EACH.values():
        check(text)


@pytest.mark.parametrize("name", sorted({*_HOSTILE, "and", "or"}))
def test_names(name):
    """A body or a joint of any name, beside operators with the letters of its name."""
    if name not in FUNCTIONS and name not in ("and", "or", "not", "pi"):
        check(f"sin({name}) - 1")
    check(f"where(not {name}.omega_y_rad_s < 1 and joint.{name}.angle_rate_rad_s > 2, 1, 2)")
    check(f"-{name}.omega_y_rad_s*{name}.omega_x_rad_s")


@pytest.mark.parametrize(
    "text",
    [
        "-a ** 2 - -b",
        "2 ** -a - (-8) ** 3 * +b",
        "(-c) ** 0.5 + a",
        "a / (c - 2)",
        "a\r\n +\t b\n",
        "  a - 3.e0*b-.5 ** 2",
        "(" * MAX_DEPTH + "a" + ")" * MAX_DEPTH,
        "sin(" * (MAX_DEPTH - 1) + "a" + ")" * (MAX_DEPTH - 1),
        "-" * MAX_DEPTH + "a",
        MANY,
    ],
)
def test_texts(text):
    check(text)


def test_signals_of_many_terms_over_each_other():
    """Neither the terms of a formula nor signals in it use up the depth of calls."""
    size = 8
    signals = [
        {**SIGNAL, "name": f"s{k}", "formula": f"s{k + 1} + {MANY}", "constants": {"a": 1, "b": 2}}
        for k in range(size)
    ]
    signals[-1]["formula"] = MANY
    formulas = Formulas({"signal": signals, "driven": {}}, None, None)
    value = Evaluation(formulas, 0.0, None).signal("s0")
    assert value == size * (1.0 - 97.0)


def test_outcomes_by_formulas():
    """Conditions, words of Python and names of functions in outcomes of outcomes."""
    values = {"in": 3.0, "rate_deg_s": -2.0, "never_s": math.nan, "min": 5.0}
    expected = {
        "clip(in, 0, 1) + where(rate_deg_s < 0 and not in < 0, 10, 20)": 11.0,
        "min(min, abs(rate_deg_s), pi)": 2.0,
        "where(never_s < 1, 1, 2)": math.nan,
    }
    for text, value in expected.items():
        assert_allclose(NamedValues(values).formula(text), value)
    with pytest.raises(Undefined):
        NamedValues(values).formula("sqrt(rate_deg_s)")


def test_a_spring_keeps_its_name_beside_a_renamed_joint():
    tree = {
        "body": {"a": {}, "b": {}},
        "joint": {"bolt": {"bodies": ["a", "b"]}},
        "spring": [{"name": "bolt", "bodies": ["a", "b"]}],
        "signal": [{"formula": "spring.bolt.extension_m + joint.bolt.stroke_m * a.x_m"}],
        "phase": [{"name": "free"}],
    }
    new = renamed(tree, None)
    assert new["signal"][0]["formula"] == (
        "spring.bolt.extension_m + joint.nbolt.stroke_m * a_1.x_m"
    )
