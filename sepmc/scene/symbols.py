"""Python functions as formulas: a function is called once with symbols in place of numbers, and its
result is the syntax tree of a formula."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sepmc.scene.formula import FormulaError, Name, Node, Number, apply, is_condition
from sepmc.scene.messages import InputError, shorten

Function = Callable[["Symbol"], Any]
_UFUNCS: dict[Any, str] = {
    np.add: "+",
    np.subtract: "-",
    np.multiply: "*",
    np.divide: "/",
    np.power: "**",
    np.float_power: "**",
    np.negative: "-",
    np.sin: "sin",
    np.cos: "cos",
    np.tan: "tan",
    np.arctan2: "atan2",
    np.sqrt: "sqrt",
    np.exp: "exp",
    np.log: "log",
    np.absolute: "abs",
    np.sign: "sign",
    np.minimum: "min",
    np.maximum: "max",
    np.less: "<",
    np.less_equal: "<=",
    np.greater: ">",
    np.greater_equal: ">=",
    np.logical_and: "and",
    np.logical_or: "or",
    np.logical_not: "not",
}
_FUNCTIONS: dict[Any, str] = {np.where: "where", np.clip: "clip"}
_PRECEDENCE = {
    "or": 1, "and": 2, "not": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6,
    "negative": 7, "**": 8,
}  # fmt: skip
_ATOM = 9


class Symbol:
    """Stand-in for a number or condition that is known in flight only: operators and numpy
    functions (``np.sin``, ``np.minimum``, ``np.where``) applied to it build a syntax tree.

    ``node`` is the tree so far. It is None for the symbol that stands for no number: its attributes
    are the quantities of the scene. Each further attribute extends the name of a quantity:
    ``q.upper.pitch_deg``, also ``q["upper.pitch_deg"]``.
    """

    __slots__ = ("node",)
    __iter__ = None  # a number has no components
    node: Node | None  # None: the symbol that all names begin with

    def __init__(self, node: Node | None = None):
        object.__setattr__(self, "node", node)

    def __getattr__(self, name: str) -> "Symbol":
        if name.startswith("_") or not (self.node is None or isinstance(self.node, Name)):
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, name: str) -> "Symbol":
        if not isinstance(name, str):
            raise TypeError(
                "a number has no components: give the name of one, as q.upper.omega_x_rad_s"
            )
        path = f"{self.node.path}.{name}" if isinstance(self.node, Name) else name
        return Symbol(Name(path))

    def __setattr__(self, name: str, value: Any) -> None:
        raise TypeError(
            "a quantity cannot be set: a function given as a formula only reads quantities and "
            "returns the value of the formula"
        )

    def __bool__(self) -> bool:
        raise TypeError(
            "a condition is not known before the flight: use np.where, np.minimum or np.maximum "
            "in place of if, min and max, and & | ~ in place of and, or, not"
        )

    def __float__(self) -> float:
        raise TypeError(
            "a quantity is not known before the flight: use functions of numpy, not of math"
        )

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> "Symbol":
        if method != "__call__" or options or ufunc not in _UFUNCS:
            known = ", ".join(f"np.{one.__name__}" for one in [*_UFUNCS, *_FUNCTIONS])
            raise TypeError(
                f"np.{ufunc.__name__} is no function of formulas, or not with these options; those "
                f"are {known}"
            )
        return _applied(_UFUNCS[ufunc], *inputs)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> "Symbol":
        if options or function not in _FUNCTIONS:
            raise TypeError(
                f"np.{function.__name__} is no function of formulas, or not with these options"
            )
        return _applied(_FUNCTIONS[function], *inputs)

    def __add__(self, other: Any) -> "Symbol":
        return _applied("+", self, other)

    def __radd__(self, other: Any) -> "Symbol":
        return _applied("+", other, self)

    def __sub__(self, other: Any) -> "Symbol":
        return _applied("-", self, other)

    def __rsub__(self, other: Any) -> "Symbol":
        return _applied("-", other, self)

    def __mul__(self, other: Any) -> "Symbol":
        return _applied("*", self, other)

    def __rmul__(self, other: Any) -> "Symbol":
        return _applied("*", other, self)

    def __truediv__(self, other: Any) -> "Symbol":
        return _applied("/", self, other)

    def __rtruediv__(self, other: Any) -> "Symbol":
        return _applied("/", other, self)

    def __pow__(self, other: Any) -> "Symbol":
        return _applied("**", self, other)

    def __rpow__(self, other: Any) -> "Symbol":
        return _applied("**", other, self)

    def __neg__(self) -> "Symbol":
        return _applied("-", self)

    def __pos__(self) -> "Symbol":
        return self

    def __abs__(self) -> "Symbol":
        return _applied("abs", self)

    def __lt__(self, other: Any) -> "Symbol":
        return _applied("<", self, other)

    def __le__(self, other: Any) -> "Symbol":
        return _applied("<=", self, other)

    def __gt__(self, other: Any) -> "Symbol":
        return _applied(">", self, other)

    def __ge__(self, other: Any) -> "Symbol":
        return _applied(">=", self, other)

    def __and__(self, other: Any) -> "Symbol":
        return _applied("and", self, other)

    def __or__(self, other: Any) -> "Symbol":
        return _applied("or", self, other)

    def __invert__(self) -> "Symbol":
        return _applied("not", self)


def _applied(function: str, *inputs: Any) -> Symbol:
    """Symbol of the result of a formula function or operator (by its name in formulas) applied to
    symbols and numbers. Raises FormulaError if the function does not take this number or type of
    inputs, or the value is undefined or too large (`apply`)."""
    return Symbol(apply(function, tuple(map(_node, inputs))))


def _node(value: Any) -> Node:
    """Syntax tree of a symbol or a number. Raises TypeError for anything else, and for the symbol
    of the argument itself, which has no value."""
    if isinstance(value, Symbol):
        if value.node is None:
            raise TypeError("the argument itself is no number: name a quantity, such as q.time_s")
        return value.node
    if isinstance(value, bool | str) or not hasattr(value, "__float__"):
        raise TypeError(f"{shorten(value)} is no number; must be a number or a quantity")
    return Number(float(value))


def text(node: Node) -> str:
    """Text of a formula from its syntax tree; `sepmc.scene.formula.parse` makes the same tree from
    it."""
    return _text(node)[0]


def _text(node: Node) -> tuple[str, int]:
    """Text of a node, and the precedence of its outermost operator (`_PRECEDENCE`, or `_ATOM`)."""
    if isinstance(node, Number):
        return repr(node.value), _ATOM if node.value >= 0.0 else _PRECEDENCE["negative"]
    if isinstance(node, Name):
        return node.path, _ATOM
    function, arguments = node.function, [_text(one) for one in node.arguments]
    if function == "not" or (function == "-" and len(arguments) == 1):
        rank = _PRECEDENCE["not" if function == "not" else "negative"]
        space = " " if function == "not" else ""
        return f"{function}{space}{_in_brackets(arguments[0], rank)}", rank
    if function not in _PRECEDENCE:
        return f"{function}({', '.join(one for one, _ in arguments)})", _ATOM
    rank = _PRECEDENCE[function]
    to_the_right = function == "**"
    left = _in_brackets(arguments[0], rank + (to_the_right or function in ("<", "<=", ">", ">=")))
    right = _in_brackets(arguments[1], rank + (not to_the_right))
    return f"{left} {function} {right}", rank


def _in_brackets(part: tuple[str, int], rank: int) -> str:
    """Text of ``part``, a pair (text, precedence), in brackets if the precedence is below
    ``rank``."""
    return part[0] if part[1] >= rank else f"({part[0]})"


def trace_load(name: str, function: Function) -> dict[str, tuple[float | str, ...]]:
    """Convert a Python function that computes a load to numbers and formulas.

    Parameters
    ----------
    name : str
        of the load, for messages
    function : callable
        of one symbol, whose attributes are the quantities of the flight; returns the three
        components of the force, N, or a pair: those, and the three of the moment, N m

    Returns
    -------
    dict of str to tuple of 3
        "force" and, if the function returns it, "moment": each component a number or the text of a
        formula

    Raises
    ------
    InputError
        If the function cannot be a formula.
    """
    try:
        result = function(Symbol())
        vectors = [result] if _is_vector(result) else result
        is_valid = isinstance(vectors, tuple | list) and 0 < len(vectors) <= 2
        if not (is_valid and all(map(_is_vector, vectors))):
            shape = "three components of the force, or a pair: those and three of the moment"
            raise InputError(f"load {name}: its function must return {shape}")
        named = zip(("force", "moment"), vectors, strict=False)
        return {key: tuple(map(_component, vector)) for key, vector in named}
    except FormulaError as error:
        raise InputError(f"load {name}: its function {error}") from None
    except InputError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"load {name}: its function is no formula: {error}") from None


def with_load(tree: dict[str, Any], load: dict[str, Any], function: Function) -> dict[str, Any]:
    """TOML tree of a campaign with one more load, whose components a Python function computes;
    those that are formulas become signals ``LOAD_force_x`` and so on.

    Parameters
    ----------
    tree : dict
        TOML tree of the campaign; it is not changed.
    load : dict
        TOML table of the load (``name``, ``body``, ...) without force and moment.
    function : callable
        See `trace_load`.

    Returns
    -------
    dict
        A new tree.

    Raises
    ------
    InputError
        If the function cannot be a formula.
    """
    load, signals, name = dict(load), [], load["name"]
    for key, components in trace_load(name, function).items():
        numbers = [f"{name}_{key}_{axis}" for axis in "xyz"]
        for k, component in enumerate(components):
            if isinstance(component, str):
                signals.append({"name": numbers[k], "formula": component})
        load["force_N" if key == "force" else "moment_N_m"] = [
            number if isinstance(component, str) else component
            for number, component in zip(numbers, components, strict=True)
        ]
    result = dict(tree)
    for table, entries in (("signal", signals), ("load", [load])):
        if entries:
            result[table] = [*tree.get(table, []), *entries]
    return result


def _is_vector(value: Any) -> bool:
    """True for a tuple, list or array of three items."""
    return isinstance(value, tuple | list | np.ndarray) and len(value) == len("xyz")


def _component(value: Any) -> float | str:
    """Component of a load as a number, or as the text of a formula if it is a symbol. Raises
    TypeError for a condition or anything else."""
    node = _node(value)
    if is_condition(node):
        raise TypeError(
            "a component is a condition, not a number: use np.where(condition, number, number)"
        )
    return node.value if isinstance(node, Number) else text(node)


__all__ = ["Function", "Symbol", "text", "trace_load", "with_load"]
