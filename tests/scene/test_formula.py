"""Formulas: what is parsed, what is refused, and values."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sepmc.scene.formula import (
    FUNCTIONS,
    MAX_TEXT,
    Call,
    FormulaError,
    Name,
    Number,
    evaluate,
    may_be_undefined,
    names,
    parse,
)
from sepmc.scene.read import parse_campaign
from sepmc.scene.signals import with_sizes

VALUES = {"a": 0.7, "b": -1.3, "upper.pitch_deg": 4.0}
SAME_IN_PYTHON = [
    "1 + 2 * 3 - 4 / 5",
    "-2 ** 2",
    "2 ** 3 ** 0.5",
    "a - b - 1.5e-3",
    "-(a + b) * -a",
    "a / b / 2",
    "+a",
    ".5 + 2.",
]


@pytest.mark.parametrize("text", SAME_IN_PYTHON)
def test_arithmetic_is_that_of_python(text):
    expected = eval(text, {}, {"a": VALUES["a"], "b": VALUES["b"]})
    assert float(evaluate(parse(text), VALUES)) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("sin(a)", math.sin(0.7)),
        ("cos(pi / 3)", 0.5),
        ("tan(a)", math.tan(0.7)),
        ("atan2(b, a)", math.atan2(-1.3, 0.7)),
        ("sqrt(a)", math.sqrt(0.7)),
        ("exp(b)", math.exp(-1.3)),
        ("log(a)", math.log(0.7)),
        ("abs(b)", 1.3),
        ("sign(b) + sign(a) + sign(0)", 0.0),
        ("min(a, b, 3)", -1.3),
        ("max(a, b, 3)", 3.0),
        ("clip(b, -1, 1)", -1.0),
        ("where(a < 1 and not b > 0, 5, 6)", 5.0),
        ("where(0 < a < 0.5 or b >= 0, 5, 6)", 6.0),
        ("where(b > 0, log(b), 2)", 2.0),
        ("upper.pitch_deg * 2", 8.0),
    ],
)
def test_functions(text, value):
    assert float(evaluate(parse(text), VALUES)) == pytest.approx(value, rel=1e-15, abs=1e-15)


def test_values_of_arrays():
    a = np.array([1.0, 0.0, -1.0, np.nan])
    assert_allclose(evaluate(parse("where(a > 0, log(a), 7)"), {"a": a}), [0.0, 7.0, 7.0, np.nan])


@pytest.mark.parametrize(
    "text",
    ["1 / (a - 0.7)", "log(b)", "sqrt(b)", "b ** 0.5", "exp(2000 * a)", "0 * log(b)", "1 / log(b)"],
)
def test_undefined_is_nan(text):
    assert math.isnan(evaluate(parse(text), VALUES))
    assert may_be_undefined(parse(text))


def test_tree():
    tree = parse("-k * upper.pitch_deg + clip(k, 0, 1 + 1)")
    assert names(tree) == ["k", "upper.pitch_deg"]
    assert tree == Call(
        "+",
        (
            Call("*", (Call("-", (Name("k"),)), Name("upper.pitch_deg"))),
            Call("min", (Call("max", (Name("k"), Number(0.0))), Number(2.0))),
        ),
    )
    assert not may_be_undefined(tree)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is empty"),
        ("  ", "is empty"),
        ("a +", "is missing"),
        ("(a", "is missing"),
        ("a b", "is missing"),
        ("2a", "has '2a': put an operator"),
        ("0x10", "has '0x': put an operator"),
        ("1_000", "has '1_': put an operator"),
        ("1j", "has '1j': put an operator"),
        ("a = 1", "has '='"),
        ("a == b", "has '=='"),
        ("a != b", "has '!='"),
        ("a < b", "is a condition"),
        ("a and b", "has 'and' of a number"),
        ("(a < b) + 1", "has '+' of a condition"),
        ("where(a, 1, 2)", "without a condition"),
        ("where(a < b, a < b, 2)", "has 'where' of a condition"),
        ("sin(a, b)", "has sin of 2 numbers: it takes 1"),
        ("min(a)", "has min of 1 numbers: it takes at least 2"),
        ("clip(a, 1)", "as clip(x, low, high)"),
        ("sinh(a)", "functions are sin, cos"),
        ("a.real(1)", "must consist of"),
        ("sin(x=1)", "has '='"),
        ("[a]", "has '['"),
        ("'a'", 'has "\'"'),
        ("a // 2", "is missing"),
        ("a % 2", "has '%'"),
        ("a if a < b else b", "is missing"),
        ("lambda: a", "has ':'"),
        ("not.a and b", "has 'and' of a number"),
        ("True", None),
        ("lambda", None),
        ("__import__", None),
        ("1 / 0", "has '/' of 1, 0, which is undefined"),
        ("sqrt(-1)", "has 'sqrt' of -1"),
        ("10 ** 400", "has '**' of 10, 400"),
        ("1e999", "too large"),
        ("é", "has 'é'"),
        ("a" * (MAX_TEXT + 1), "must have at most"),
        ("(" * 60 + "a" + ")" * 60, "brackets at most"),
        ("-" * 60 + "a", "at most"),
        ("+".join("a" * 400), "must have at most 300"),
        ("sin(" * 39 + "sin(sin(a))" + ")" * 39, "deep"),
    ],
)
def test_refused(text, reason):
    if reason is None:  # a name like any other: no scene has it
        assert parse(text) == Name(text)
        return
    with pytest.raises(FormulaError) as error:
        parse(text)
    assert reason in str(error.value)


def test_functions_are_listed():
    """A text that calls an unknown function is told all that there are."""
    with pytest.raises(FormulaError) as error:
        parse("cosh(1)")
    assert all(name in str(error.value) for name in FUNCTIONS)


def test_sizes_of_driven_numbers():
    """Estimates of speeds and scales take the largest value of a signal over time."""
    tree = {
        "body": {"a": {"mass_kg": 1.0, "inertia_kg_m2": [1.0, 1.0, 1.0], "cg_m": [0.0, 0.0, 0.0]}},
        "phase": [{"name": "free"}],
        "initial": {"altitude_m": 0.0, "speed_m_s": 0.0},
        "run": {"end_time_s": 2.0},
        "signal": [
            {"name": "push", "formula": "-k * ramp + a.vx_m_s / 0.5", "k": 3.0},
            {"name": "ramp", "formula": "min(time_s, 1.5)"},
        ],
        "load": [{"name": "jet", "body": "a", "force_kN": [0.0, "push", 0.0]}],
    }
    scene = parse_campaign(tree, "sizes").scene
    assert scene.load[0].force == (0.0, 0.0, 0.0)
    assert with_sizes(scene).load[0].force == pytest.approx((0.0, 4500.0, 0.0))
