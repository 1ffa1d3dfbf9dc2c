"""Signals of a case: formulas evaluated number by number, and their kinks as event functions."""

import ast
import keyword
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from oracles.independent.case import Table
from oracles.independent.state import State, Vehicle

# unit of a name to SI
_UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "min": 60.0,
    "deg": math.pi / 180.0,
    "rad": 1.0,
    "deg_s": math.pi / 180.0,
    "rad_s": 1.0,
    "rpm": math.pi / 30.0,
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "km": 1e3,
    "in": 0.0254,
    "ft": 0.3048,
    "m_s": 1.0,
    "km_s": 1e3,
    "km_h": 1.0 / 3.6,
    "ft_s": 0.3048,
    "Pa": 1.0,
    "kPa": 1e3,
    "psi": 4.4482216152605 / 0.0254**2,
}
AT_ONCE = 1e-8  # s between two passages of a kink that undo each other
_SAME_TIME = 2e-12  # s
_OF_RATE = -100_000  # in place of a column, for the limit of a rate
_AT_ZERO = 1e-11  # relative to the numbers compared
Key = tuple[str, int, int]  # signal, call in its text, pair of numbers
Values = dict[Key, tuple[float, float]]  # switching function and the size of its numbers


_MARK = "\u0436"  # of names that are words of Python


def _python_text(formula: str) -> str:
    """Formula as a Python expression on one line: parts of names that are words of Python are
    marked; ``and``, ``or`` and ``not`` alone are operators."""

    def marked(name: re.Match[str]) -> str:
        if name[0] in ("and", "or", "not"):
            return name[0]
        return ".".join(part + _MARK * keyword.iskeyword(part) for part in name[0].split("."))

    return re.sub(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", marked, " ".join(formula.split()))


def _tree(formula: str) -> Any:
    """Syntax tree of a formula."""
    return ast.parse(_python_text(formula), mode="eval").body


class Undefined(Exception):
    """A formula has no value."""


@dataclass
class Formulas:
    """Signals of a case.

    ``read`` gives a quantity in SI by the parts of its name without unit. ``modes`` are the signs
    of the switching functions in the present interval.
    """

    scene: Table
    vehicle: Vehicle
    read: Callable[[list[str], str, float, State], float]
    modes: dict[Key, int] = field(default_factory=dict)
    # times, s, of releases of joints and of observed events: ("joint", name), ("event", name)
    instants: dict[tuple[str, str], float] = field(default_factory=dict)
    passed: dict[Key, float] = field(default_factory=dict)  # time, s, of the last passage
    latest: "Evaluation | None" = None  # until a side or a sample changes

    def __post_init__(self) -> None:
        self.signals = {table["name"]: table for table in self.scene["signal"]}
        self.trees = {name: _tree(table["formula"]) for name, table in self.signals.items()}
        self.driven = {
            path: (signal, factor) for path, (signal, factor) in self.scene["driven"].items()
        }
        self.responses = [Response(table) for table in self.scene["signal"]]
        first = 0
        for response in self.responses:
            response.first, first = first, first + len(response.start)
        self.states = {one.name: one for one in self.responses if one.start}
        self.samplers = {one.name: one for one in self.responses if one.interval}
        self.used = list(dict.fromkeys(signal for signal, _ in self.driven.values()))

    def start(self) -> list[float]:
        """States of the signals at the start."""
        return [x for response in self.responses for x in response.start]

    def rates(self, t: float, s: State) -> list[float]:
        """Rates of the states of the signals."""
        evaluation = Evaluation(self, t, s)
        return [x for name in self.states for x in evaluation.rates(name)]

    def due(self) -> list[float]:
        """Times, s, at which signals are sampled or samples begin to be used."""
        return [t for one in self.samplers.values() for t in (one.next_time, one.use_time)]

    def sample(self, t: float, s: State) -> None:
        """Take the samples that are due, in the order of the file, and use those that are."""
        taken, self.latest = False, None
        for name, one in self.samplers.items():
            if one.use_time <= t + _SAME_TIME:
                one.held, one.use_time, taken = one.waiting, math.inf, True
            if one.next_time <= t + _SAME_TIME:
                one.take(Evaluation(self, t, s).formula(name))
                taken = True
        if taken:  # switching functions of samples may have changed their sign
            for key, (value, size) in self.switching(t, s).items():
                mode = self.modes.get(key)
                if mode and -mode * value > _AT_ZERO * max(1.0, size):
                    self.modes[key] = -mode

    def number(self, path: str, t: float, s: State, otherwise: float) -> float:
        """Number of a parameter: of its signal, or ``otherwise``."""
        if path not in self.driven:
            return otherwise
        signal, factor = self.driven[path]
        return self.value(signal, t, s) * factor

    def value(self, signal: str, t: float, s: State) -> float:
        """Value of a signal at a state, by the branches of the present interval."""
        if self.latest is None or self.latest.s is not s or self.latest.t != t:
            self.latest = Evaluation(self, t, s)
        return self.latest.signal(signal)

    def switching(self, t: float, s: State) -> Values:
        """Switching functions of all kinks of the signals in use at a state."""
        evaluation = Evaluation(self, t, s)
        for signal in self.used:
            evaluation.signal(signal)
        for name in self.states:
            evaluation.rates(name)
        return evaluation.switching

    def set_modes(self, t: float, s: State, later: Callable[[], State], wait: float) -> None:
        """Set the modes that are not known, of switching functions at zero by the state a little
        ``later``."""
        self.latest = None
        unknown = [key for key, mode in self.modes.items() if mode == 0]
        for key in unknown:
            del self.modes[key]
        for key, (value, size) in self.switching(t, s).items():
            if key not in self.modes:
                self.modes[key] = int(math.copysign(1.0, value)) if _is_off(value, size) else 0
        if any(mode == 0 for mode in self.modes.values()):
            for key, (value, size) in self.switching(t + wait, later()).items():
                if self.modes.get(key) == 0 and abs(value) > 0.3 * _AT_ZERO * max(1.0, size):
                    self.modes[key] = int(math.copysign(1.0, value))

    def excess(self, key: Key, t: float, s: State) -> float:
        """Switching function of a kink beyond its present side; positive from the kink on."""
        value, size = self.switching(t, s)[key]
        mode = self.modes[key]
        if t - self.passed.get(key, -math.inf) < AT_ONCE and not _is_off(value, size):
            return -_AT_ZERO  # it has just been passed: round-off
        return -mode * value if mode else abs(value) - 10.0 * _AT_ZERO * max(1.0, size)

    def switch(self, key: Key) -> None:
        """Pass a kink."""
        self.latest = None
        self.modes[key] = -self.modes[key]


@dataclass
class Response:
    """Response of a signal to its formula: states, and the sample that it holds."""

    table: Table
    first: int = 0  # of its states
    count: int = 0  # samples taken
    use_time: float = math.inf
    waiting: float = 0.0

    def __post_init__(self) -> None:
        self.name, self.interval = self.table["name"], self.table["sample"]
        self.servo, self.lag, self.limit = (
            self.table[key] for key in ("servo", "lag", "rate_limit")
        )
        self.held = initial = self.table["initial"]
        has_one = self.lag or self.table["integral"]
        self.start = [initial, 0.0] if self.servo else [initial] if has_one else []

    @property
    def next_time(self) -> float:
        """Time of the next sample, s."""
        return float(self.count * self.interval)

    def take(self, value: float) -> None:
        """Take a sample."""
        if self.table["delay"] > _SAME_TIME:
            self.waiting, self.use_time = value, self.next_time + self.table["delay"]
        else:
            self.held = value
        self.count += 1


def _is_off(value: float, size: float) -> bool:
    """True if a switching function is not zero."""
    return abs(value) > _AT_ZERO * max(1.0, size)


_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


class Evaluation:
    """Values at one state."""

    def __init__(self, formulas: Formulas, t: float, s: State):
        self.formulas, self.t, self.s = formulas, t, s
        self.values: dict[str, float] = {}
        self.switching: Values = {}

    def signal(self, name: str) -> float:
        """Value of a signal; raises `Undefined`."""
        if name in self.formulas.states:
            return float(self.s.z[self.formulas.states[name].first])
        if name in self.formulas.samplers:
            return self.formulas.samplers[name].held
        if name not in self.values:
            value = self.formula(name)
            if not math.isfinite(value):
                raise Undefined(name)
            self.values[name] = value
        return self.values[name]

    def formula(self, name: str) -> float:
        """Value of the formula of a signal."""
        return self._number(name, self.formulas.trees[name])

    def rates(self, name: str) -> list[float]:
        """Rates of the states of a signal."""
        response, samplers = self.formulas.states[name], self.formulas.samplers
        u = samplers[name].held if name in samplers else self.formula(name)
        y, *rate = self.s.z[response.first : response.first + len(response.start)]
        if response.servo:
            n, z = 2.0 * math.pi * response.servo["natural"], response.servo["damping"]
            return [rate[0], n * n * (u - y) - 2.0 * z * n * rate[0]]
        if response.lag is None:
            return [u]
        wanted = (u - y) / response.lag
        if response.limit is None:
            return [wanted]
        for pair, bound in enumerate((-response.limit, response.limit)):
            self._note((name, _OF_RATE, pair), wanted - bound, [wanted, bound])
        return [min(max(wanted, -response.limit), response.limit)]

    def _number(self, signal: str, node: Any) -> float:
        """Value of a number."""
        try:
            value = self._raw(signal, node)
        except (ValueError, OverflowError, ZeroDivisionError) as error:
            raise Undefined(signal) from error
        if isinstance(value, complex) or not math.isfinite(value):
            raise Undefined(signal)
        return value

    def _raw(self, signal: str, node: Any) -> float:
        if isinstance(node, ast.Constant):
            assert isinstance(node.value, int | float)
            return float(node.value)
        if isinstance(node, ast.Name | ast.Attribute):
            return self._name(signal, ast.unparse(node).replace(_MARK, ""))
        if isinstance(node, ast.Call):
            assert isinstance(node.func, ast.Name)
            is_where = node.func.id == "where"
            return self._where(signal, node) if is_where else self._call(signal, node, node.func.id)
        if isinstance(node, ast.UnaryOp):
            return float(_OPERATIONS[type(node.op)](self._number(signal, node.operand)))
        return self._chain(signal, node)

    def _chain(self, signal: str, node: Any) -> float:
        """Value of a sum, product or power, its terms from left to right: hundreds of them are no
        deeper than one."""
        operations = []
        while isinstance(node, ast.BinOp):
            operations.append(node)
            node = node.left
        value = self._number(signal, node)
        for one in reversed(operations):
            value = _OPERATIONS[type(one.op)](value, self._number(signal, one.right))
            if isinstance(value, complex) or not math.isfinite(value):
                raise Undefined(signal)
        return value

    def _call(self, signal: str, node: ast.Call, function: str) -> float:
        """Value of a function of numbers."""
        key = (signal, node.col_offset)
        numbers = [self._number(signal, one) for one in node.args]
        if function == "abs":
            self._note((*key, 0), numbers[0], numbers)
            return abs(numbers[0])
        if function == "sign":
            return float(self._side((*key, 0), numbers[0], numbers))
        if function not in ("clip", "min", "max"):
            return float(getattr(math, function)(*numbers))
        choices = {"min": [min] * len(numbers), "max": [max] * len(numbers), "clip": [max, min]}
        result = numbers[0]
        for pair, (other, choose) in enumerate(zip(numbers[1:], choices[function], strict=False)):
            self._note((*key, pair), result - other, [result, other])
            result = choose(result, other)
        return result

    def _where(self, signal: str, node: ast.Call) -> float:
        """Value of the branch of the present interval; of the other one where that is undefined
        and the step has passed the kink."""
        by_mode = self._condition(signal, node.args[0], by_mode=True)
        try:
            return self._number(signal, node.args[1 if by_mode else 2])
        except Undefined:
            now = self._condition(signal, node.args[0], by_mode=False)
            if now == by_mode:
                raise
            return self._number(signal, node.args[1 if now else 2])

    def _condition(self, signal: str, node: Any, by_mode: bool) -> bool:
        if isinstance(node, ast.UnaryOp):
            return not self._condition(signal, node.operand, by_mode)
        if isinstance(node, ast.BoolOp):
            values = [self._condition(signal, one, by_mode) for one in node.values]
            return all(values) if isinstance(node.op, ast.And) else any(values)
        assert isinstance(node, ast.Compare)
        numbers = [self._number(signal, one) for one in (node.left, *node.comparators)]
        result = True
        for pair, (op, a, b) in enumerate(zip(node.ops, numbers, numbers[1:], strict=False)):
            # a call and a comparison in it may begin at the same column
            key = (signal, -1 - node.col_offset, pair)
            side = self._side(key, a - b, [a, b]) if by_mode else (a > b) - (a < b)
            holds = {
                ast.Lt: side < 0,
                ast.LtE: side <= 0,
                ast.Gt: side > 0,
                ast.GtE: side >= 0,
            }
            result = result and holds[type(op)]
        return result

    def _note(self, key: Key, value: float, numbers: list[float]) -> None:
        self.switching[key] = value, max(map(abs, numbers))

    def _side(self, key: Key, value: float, numbers: list[float]) -> int:
        """Side of a kink in the present interval."""
        value = float(value)
        self._note(key, value, numbers)
        return self.formulas.modes.get(key, (value > 0.0) - (value < 0.0))

    def _name(self, signal: str, name: str) -> float:
        """Value of a name: a constant, a signal or a quantity in its unit."""
        formulas = self.formulas
        if name in formulas.signals[signal]["constants"]:
            return float(formulas.signals[signal]["constants"][name])
        if name in formulas.signals:
            return self.signal(name)
        if name == "pi":
            return math.pi
        *items, last = name.split(".")
        key, unit = next(_split(last), (last, ""))
        return formulas.read(items, key, self.t, self.s) / _UNITS.get(unit, 1.0)


class NamedValues(Evaluation):
    """Evaluation of formulas of numbers by name, without a flight."""

    def __init__(self, values: Mapping[str, float]):
        self.named, self.switching = values, {}

    def formula(self, name: str) -> float:
        """Value of a formula by its text: NaN if a number that it names is NaN; raises
        `Undefined`."""
        tree = _tree(name)
        functions = {id(one.func) for one in ast.walk(tree) if isinstance(one, ast.Call)}
        named = [
            self.named[one.id.replace(_MARK, "")]
            for one in ast.walk(tree)
            if isinstance(one, ast.Name) and id(one) not in functions and one.id != "pi"
        ]
        return math.nan if any(map(math.isnan, named)) else self._number(name, tree)

    def _side(self, key: Key, value: float, numbers: list[float]) -> int:
        return (value > 0.0) - (value < 0.0)

    def _name(self, signal: str, name: str) -> float:
        return math.pi if name == "pi" else self.named[name]


def _split(name: str) -> Iterator[tuple[str, str]]:
    """Quantity and unit of a name, the longest unit first."""
    for unit in sorted(_UNITS, key=len, reverse=True):
        if name.endswith(f"_{unit}"):
            yield name[: -len(unit) - 1], unit
