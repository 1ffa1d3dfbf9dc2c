"""Formulas: texts by a grammar and changed ones, parsed and compared with another evaluation."""

import math
import sys

from oracles.independent.case import SIGNAL
from oracles.independent.formulas import Evaluation, Formulas, Undefined

from fuzz.watch import Wrong, turns
from sepmc.scene.formula import FUNCTIONS, FormulaError, evaluate, names, parse
from sepmc.scene.messages import InputError
from sepmc.scene.read import parse_campaign

_NAMES = (
    "a",
    "b",
    "c",
    "time_s",
    "upper.pitch_deg",
    "joint.pins.stroke_m",
    "lambda.x_m",
    "not.x_m",
)
_NUMBERS = ("0", "1", "2", "0.5", "1e-3", "3.", ".25", "7e2", "1e300", "1e-300", "16", "-1")
_COMPARISONS = ("<", "<=", ">", ">=")
_PIECES = (
    *_NAMES, *_NUMBERS, *FUNCTIONS, *_COMPARISONS, "+", "-", "*", "/", "**", "//", "%", "@", "==",
    "!=", "=", ":=", "and", "or", "not", "if", "else", "lambda", "for", "in", "is", "True", "None",
    "(", ")", "[", "]", "{", "}", ",", ".", "..", ":", ";", "'", '"', "\\", "#", "\n", "\t", " ",
    "__import__('os').system('true')", "().__class__", "0x1f", "1j", "1_0", "1e", "1e999", "inf",
    "nan", "9" * 400, "(" * 200, "-" * 300, "not " * 100, "é", "\u202e", "\0", "f'{a}'", "a.b.c.d",
    "exec(1)", "open('x')", "await a", "yield", "*a", "**a", "x=1",
)  # fmt: skip
# events of the interpreter that a text must never cause
_FORBIDDEN = ("exec", "import", "open", "os.system", "subprocess.Popen", "socket.connect")
_SCENE = {
    "environment": {"atmosphere": "none", "gravity": "none"},
    "body": {"upper": {"mass_kg": 3.0, "inertia_kg_m2": [1.0, 2.0, 2.5], "cg_m": [1.0, 0.0, 0.0]}},
    "phase": [{"name": "free"}],
    "initial": {"altitude_m": 100.0, "speed_m_s": 30.0},
    "run": {"end_time_s": 0.4},
}
_CLOSE = 1e-9
_seen: list[str] = []
_watching = [False]


def _audit(event, _):
    """Note forbidden events while a text is parsed."""
    if _watching[0] and event in _FORBIDDEN:
        _seen.append(event)


def formulas(rng, count, until, tried):
    """Texts by the grammar, each also changed."""
    sys.addaudithook(_audit)
    _read("sin(a) + min(a, 1)", {"a": 1.0})  # what is imported at the first use
    for number in turns(count, until, tried):
        text = _number(rng, rng.randrange(1, 6))
        if rng.random() < 0.7:
            text = _changed(rng, text)
        values = {name: _value(rng) for name in _NAMES}
        tried.look(text, lambda text=text, values=values: _read(text, values))
        if number % 20 == 0:
            tried.look(text, lambda text=text: _in_a_scene(text))


def _read(text, values):
    """Parse a text and compare its value with another one; a refusal is an InputError."""
    _watching[0] = True
    try:
        tree = parse(text)
    except FormulaError as error:
        if not str(error) or not str(error).isprintable():
            raise Wrong("a sentence that cannot be read") from None
        raise InputError(str(error)) from None
    finally:
        _watching[0] = False
        if _seen:
            raise Wrong(f"a text causes {_seen.pop()}")
    known = {name: values[name] for name in names(tree) if name in values}
    if len(known) == len(names(tree)):
        _compare(text, tree, known)
    return tree


def _compare(text, tree, values):
    """Raise Wrong if two evaluations differ by more than round-off."""
    value, other = float(evaluate(tree, values)), _otherwise(text, values)
    if math.isnan(value) and math.isnan(other):
        return
    if abs(value - other) <= _CLOSE * max(1.0, abs(other)):
        return
    # numbers of which the last bits decide: differences of large ones, sides of a comparison
    for nudge in (1.0 + 4e-16, 1.0 - 4e-16):
        near = {name: x * nudge for name, x in values.items()}
        moved = _otherwise(text, near, nudge)
        if not abs(moved - other) <= 1e-3 * abs(value - other):
            return
    raise Wrong(f"{value!r} and not {other!r}")


class _Nudged(Evaluation):
    """Evaluation with all results of functions multiplied by a number."""

    nudge = 1.0

    def _call(self, *arguments):
        return super()._call(*arguments) * self.nudge


def _otherwise(text, values, nudge=1.0):
    """Value by the evaluation of the independent flight; NaN if it is undefined."""
    table = {**SIGNAL, "name": "f", "formula": text, "constants": values}
    evaluation = _Nudged(Formulas({"signal": [table], "driven": {}}, None, None), 0.0, None)
    evaluation.nudge = nudge
    try:
        return evaluation.signal("f")
    except (Undefined, RecursionError):
        return math.nan


def _in_a_scene(text):
    """Read a campaign with a formula."""
    signal = {"name": "push", "formula": text, "a": 1.0, "b": 2.0, "c": 3.0}
    load = {"name": "jet", "body": "upper", "force_N": ["push", 0.0, 0.0]}
    return parse_campaign({**_SCENE, "signal": [signal], "load": [load]}, "fuzz.toml")


def _value(rng):
    """A number, often a special one."""
    if rng.random() < 0.3:
        return float(rng.choice((0.0, 1.0, -1.0, 0.5, 2.0, -2.0, 1e-9, 1e9, 700.0, -0.0)))
    return rng.uniform(-3.0, 3.0)


def _number(rng, depth):
    """Text of a number by the grammar."""
    if depth <= 0 or rng.random() < 0.15:
        return rng.choice(_NAMES if rng.random() < 0.6 else _NUMBERS)
    kind = rng.randrange(5)
    if kind == 0:
        return f"({_number(rng, depth - 1)})"
    if kind == 1:
        return f"{rng.choice('+-')}{_number(rng, depth - 1)}"
    if kind == 2:
        operator = rng.choice(("+", "-", "*", "/", "**"))
        space = rng.choice(("", " "))
        return f"{_number(rng, depth - 1)}{space}{operator}{space}{_number(rng, depth - 1)}"
    function = rng.choice(tuple(FUNCTIONS))
    if function == "where":
        arguments = [_condition(rng, depth - 1), *(_number(rng, depth - 1) for _ in range(2))]
    else:
        wanted = FUNCTIONS[function] or rng.randrange(2, 5)
        arguments = [_number(rng, depth - 1) for _ in range(wanted)]
    return f"{function}({', '.join(arguments)})"


def _condition(rng, depth):
    """Text of a condition by the grammar."""
    kind = rng.randrange(5) if depth > 0 else 0
    if kind == 3:
        return f"not {_condition(rng, depth - 1)}"
    if kind == 4:
        joined = rng.choice(("and", "or"))
        return f"({_condition(rng, depth - 1)} {joined} {_condition(rng, depth - 1)})"
    text = f"{_number(rng, depth - 1)} {rng.choice(_COMPARISONS)} {_number(rng, depth - 1)}"
    return f"{text} {rng.choice(_COMPARISONS)} {_number(rng, 0)}" if kind == 2 else text


def _changed(rng, text):
    """Text with one to four pieces removed, doubled, exchanged or added."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        at, to = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        to = min(to, at + rng.randrange(8))
        piece = rng.choice((rng.choice(_PIECES), "", text[at:to] * 2, rng.choice(text or " ")))
        text = text[:at] + piece + text[to:]
    return text
