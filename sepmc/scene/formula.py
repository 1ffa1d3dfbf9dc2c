"""Formulas of a file: text to a checked syntax tree, and the value of a tree.

A file is data from anyone: the text is bounded, parsed and translated to the three node types
below; nothing of it is run as Python. Independent of scenes and kernels.
"""

import ast
import keyword
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

MAX_TEXT, MAX_NODES, MAX_DEPTH = 1000, 300, 40
# functions and the number of their arguments; None: two or more
FUNCTIONS: dict[str, int | None] = {
    "sin": 1,
    "cos": 1,
    "tan": 1,
    "atan2": 2,
    "sqrt": 1,
    "exp": 1,
    "log": 1,
    "abs": 1,
    "sign": 1,
    "min": None,
    "max": None,
    "clip": 3,
    "where": 3,
}
CONSTANTS = {"pi": math.pi}
COMPARISONS = ("<", "<=", ">", ">=")
# functions that are not smooth where their switching function is zero
KINKS = ("abs", "sign", "min", "max", *COMPARISONS)
# functions that are undefined, or overflow, for some arguments
_PARTIAL = ("/", "**", "tan", "sqrt", "exp", "log", "sin", "cos")
_CONDITIONS = (*COMPARISONS, "and", "or", "not")
_OPERATORS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.And: "and",
    ast.Or: "or",
}
_MARK = "\u0436"  # a letter that no formula has
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?P<glued>\w?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)"
    r"|(?P<operator>\*\*|<=|>=|==|!=|[-+*/(),<>]))",
    re.ASCII,
)


class FormulaError(ValueError):
    """Raised for a text that is no formula; the message is the reason and what is allowed."""


@dataclass(frozen=True)
class Number:
    """Node of a syntax tree: a constant number."""

    value: float


@dataclass(frozen=True)
class Name:
    """Node of a syntax tree: the value of a name, such as ``upper.pitch_deg``."""

    path: str


@dataclass(frozen=True)
class Call:
    """Node of a syntax tree: a function or operator, by its name in formulas, applied to other
    nodes. ``min`` and ``max`` have two arguments here."""

    function: str
    arguments: tuple["Node", ...]


Node = Number | Name | Call


@lru_cache(maxsize=1024)
def parse(text: str) -> Node:
    """Parse the text of a formula to a syntax tree.

    Parameters
    ----------
    text : str
        numbers, names, ``+ - * / **``, comparisons, ``and or not``, and `FUNCTIONS`

    Returns
    -------
    Number, Name or Call
        Root of the tree; its value is a number, not a condition. Parts without names are replaced
        by their value.

    Raises
    ------
    FormulaError
        With the reason, in the words of a message for users.
    """
    python_text = _python_text(text)
    try:
        tree = ast.parse(python_text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise FormulaError("is no formula: an operator, a number or a bracket is missing") from None
    count = sum(1 for _ in ast.walk(tree))
    if count > 3 * MAX_NODES:
        raise FormulaError(f"must have at most {MAX_NODES} numbers, names and operators")
    node = _node(tree, 0)
    if is_condition(node):
        raise FormulaError("is a condition, not a number: write where(condition, a, b)")
    if sum(1 for _ in walk(node)) > MAX_NODES:
        raise FormulaError(f"must have at most {MAX_NODES} numbers, names and operators")
    return node


def _python_text(text: str) -> str:
    """Text of a formula as a Python expression, in which names that are keywords of Python have a
    mark (`_marked`). Raises FormulaError if the text is empty, too long or nested too deep, if it
    has ``==``, ``!=`` or a character that no formula has, or a number directly before a name. The
    order of operators and brackets is not checked here."""
    if len(text) > MAX_TEXT:
        raise FormulaError(f"has {len(text):,} characters: must have at most {MAX_TEXT:,}")
    if not text.strip():
        raise FormulaError("is empty: write numbers, names and + - * / **")
    position, depth, run = 0, 0, 0
    pieces: list[str] = []
    while position < len(text.rstrip()):
        token = _TOKEN.match(text, position)
        if token is None:
            shown = text[position:].lstrip()[:1]
            if shown == "=":
                raise FormulaError("has '=': a formula is one expression; compare with < or >")
            raise FormulaError(f"has {shown!r}: write numbers, names, + - * / ** < > and ( ) ,")
        if token["glued"]:
            part = f"{token['number']}{token['glued']}"
            raise FormulaError(f"has {part!r}: put an operator between a number and a name")
        operator = token["operator"] or ("not" if token["name"] == "not" else "")
        if operator in ("==", "!="):
            raise FormulaError(f"has {operator!r}, which is true at instants only: use < or >")
        depth += (operator == "(") - (operator == ")")
        run = run + 1 if operator in ("+", "-", "**", "not") else 0
        if depth > MAX_DEPTH or run > MAX_DEPTH:
            raise FormulaError(
                f"must have brackets at most {MAX_DEPTH} deep, and no more operators than that "
                "in a row"
            )
        position = token.end()
        pieces.append(_marked(token["name"]) if token["name"] else token[0].strip())
    return " ".join(pieces)


def _marked(name: str) -> str:
    """Dotted name with `_MARK` appended to each part that is a keyword of Python, so that Python
    parses it as a name. A ``name`` that is just "and", "or" or "not" is an operator and returned as
    it is; as parts of a dotted name these words get the mark too."""
    if name in ("and", "or", "not"):
        return name
    return ".".join(part + _MARK * keyword.iskeyword(part) for part in name.split("."))


def _node(tree: ast.expr, depth: int) -> Node:
    """Convert a Python expression, nested ``depth`` deep in the formula, to a node. Raises
    FormulaError if it is of a kind that formulas do not have, or nested too deep."""
    if depth > MAX_DEPTH:
        raise FormulaError(f"must be nested at most {MAX_DEPTH} deep")

    def inner(*trees: ast.expr) -> tuple[Node, ...]:
        return tuple(_node(one, depth + 1) for one in trees)

    if isinstance(tree, ast.Constant):
        return _number(tree.value)
    if isinstance(tree, ast.Name | ast.Attribute):
        path = _path(tree)
        return Number(CONSTANTS[path]) if path in CONSTANTS else Name(path)
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) and not tree.keywords:
        return _function(tree.func.id, inner(*tree.args))
    return _operator(tree, depth, inner)


def _operator(tree: ast.expr, depth: int, inner: Callable[..., tuple[Node, ...]]) -> Node:
    """Convert a Python operator or comparison to a node. ``inner`` takes operands and converts them
    one level deeper than ``depth``; the left part of a chain of sums or products, such as a + b of
    a + b + c, stays at ``depth``. Raises FormulaError for other expressions."""
    if isinstance(tree, ast.UnaryOp):
        if isinstance(tree.op, ast.UAdd):
            return _numeric("+", inner(tree.operand))[0]
        return _call("not" if isinstance(tree.op, ast.Not) else "-", inner(tree.operand))
    if isinstance(tree, ast.BinOp) and type(tree.op) in _OPERATORS:
        # a chain of sums or products is no deeper than its terms
        left = _node(tree.left, depth if isinstance(tree.left, ast.BinOp) else depth + 1)
        return _call(_OPERATORS[type(tree.op)], (left, *inner(tree.right)))
    if isinstance(tree, ast.BoolOp):
        return _joined(_OPERATORS[type(tree.op)], inner(*tree.values))
    if isinstance(tree, ast.Compare) and all(type(op) in _OPERATORS for op in tree.ops):
        values = inner(tree.left, *tree.comparators)
        pairs = zip(tree.ops, values, values[1:], strict=False)
        return _joined("and", tuple(_call(_OPERATORS[type(op)], (a, b)) for op, a, b in pairs))
    raise FormulaError(
        "must consist of numbers, names, + - * / **, < <= > >=, and, or, not and functions"
    )


def _number(value: object) -> Number:
    """Convert a Python constant to a node. Raises FormulaError if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FormulaError(f"has {value!r}, which is no number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise FormulaError("has a number that is too large: must be at most 1.8e308")
    return Number(number)


def _path(tree: ast.expr) -> str:
    """Dotted name, without marks, of a Python name or attribute. Raises FormulaError for anything
    else, such as an attribute of a call."""
    parts: list[str] = []
    while isinstance(tree, ast.Attribute):
        parts.insert(0, tree.attr)
        tree = tree.value
    if not isinstance(tree, ast.Name):
        raise FormulaError(
            "must consist of numbers, names, + - * / **, < <= > >=, and, or, not and functions"
        )
    return ".".join([tree.id, *parts]).replace(_MARK, "")


def _function(name: str, arguments: tuple[Node, ...]) -> Node:
    """Node of the function ``name`` applied to arguments. ``clip``, and ``min`` and ``max`` of more
    than two arguments, become nested calls. Raises FormulaError for an unknown function, a wrong
    number or type of arguments, or a value that is undefined."""
    if name not in FUNCTIONS:
        raise FormulaError(f"has {name}(...): functions are {', '.join(FUNCTIONS)}")
    count = FUNCTIONS[name]
    if (len(arguments) < 2) if count is None else (len(arguments) != count):
        wanted = "at least 2" if count is None else str(count)
        raise FormulaError(
            f"has {name} of {len(arguments)} numbers: it takes {wanted}"
            + (", as clip(x, low, high)" if name == "clip" else "")
        )
    if name == "clip":
        x, low, high = arguments
        return _call("min", (_call("max", (x, low)), high))
    result, *others = arguments
    if count is None:
        for other in others:
            result = _call(name, (result, other))
        return result
    return _call(name, arguments)


def _joined(function: str, conditions: tuple[Node, ...]) -> Node:
    """Node that joins two or more conditions by "and" or "or" (``function``), as nested calls from
    left to right; a single condition is returned as it is. Raises FormulaError if one of several is
    a number, not a condition."""
    result, *others = conditions
    for other in others:
        result = _call(function, (result, other))
    return result


def _numeric(function: str, arguments: tuple[Node, ...]) -> tuple[Node, ...]:
    """Return the arguments unchanged. Raises FormulaError, which names ``function``, if one of them
    is a condition."""
    if any(map(is_condition, arguments)):
        raise FormulaError(f"has {function!r} of a condition, which is no number: use where")
    return arguments


def _call(function: str, arguments: tuple[Node, ...]) -> Node:
    """Node of a function or operator applied to arguments; if these are constants and the result is
    a number, the node is its value. Raises FormulaError for a condition in place of a number or the
    reverse, and for a value that is undefined."""
    numbers = arguments
    if function == "where":
        numbers = arguments[1:]
        if not is_condition(arguments[0]):
            raise FormulaError("has where(...) without a condition: where(a < b, one, other)")
    elif function in ("and", "or", "not"):
        numbers = ()
        if not all(map(is_condition, arguments)):
            raise FormulaError(f"has {function!r} of a number: it joins conditions such as a < b")
    _numeric(function, numbers)
    node = Call(function, arguments)
    if function in _CONDITIONS or not all(isinstance(one, Number) for one in arguments):
        return node
    value = float(evaluate(node, {}))
    if not math.isfinite(value):
        shown = ", ".join(f"{one.value:g}" for one in arguments if isinstance(one, Number))
        raise FormulaError(f"has {function!r} of {shown}, which is undefined or too large")
    return Number(value)


def apply(function: str, arguments: tuple[Node, ...]) -> Node:
    """Node of a function or operator, by its name in formulas, applied to nodes; if these are
    constants and the result is a number, the node of that number. Raises FormulaError if it does
    not take this number or type of arguments, or the value is undefined or too large. The name is
    not checked."""
    if function in FUNCTIONS:
        return _function(function, arguments)
    return _call(function, arguments)


def is_condition(node: Node) -> bool:
    """True if the value of a node is a condition (true or false), not a number."""
    return isinstance(node, Call) and node.function in _CONDITIONS


def walk(node: Node) -> Iterator[Node]:
    """Yield all nodes of a syntax tree, arguments before the calls that use them."""
    if isinstance(node, Call):
        for argument in node.arguments:
            yield from walk(argument)
    yield node


def names(node: Node) -> list[str]:
    """Names of the quantities in a syntax tree, in order of appearance and without repetition."""
    return list(dict.fromkeys(one.path for one in walk(node) if isinstance(one, Name)))


def may_be_undefined(node: Node) -> bool:
    """True if a syntax tree has a function or operator of `_PARTIAL`, which is undefined, or
    overflows, for some arguments, such as ``/``, ``**`` or ``sqrt``; also ``sin`` and ``cos``,
    which are NaN for huge ones. Overflow of ``+``, ``-`` and ``*`` does not count."""
    return any(isinstance(one, Call) and one.function in _PARTIAL for one in walk(node))


_DEFINED: dict[str, Callable[..., Any]] = {
    "/": lambda a, b: b != 0.0,
    "sqrt": lambda a: a >= 0.0,
    "log": lambda a: a > 0.0,
    "**": lambda a, b: (a > 0.0) | ((a == 0.0) & (b >= 0.0)) | ((a < 0.0) & (b == np.floor(b))),
}
_VALUES: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "atan2": np.arctan2,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "abs": np.abs,
    "sign": np.sign,
    "min": np.minimum,
    "max": np.maximum,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
}


def evaluate(node: Node, values: Mapping[str, Any]) -> Any:
    """Compute the value of a formula from its syntax tree.

    Parameters
    ----------
    node : Number, Name or Call
    values : mapping of str to float or ndarray, shape (n,)
        Value of each name in the tree (`names`), in the unit of the name.

    Returns
    -------
    ndarray, shape () or (n,)
        NaN where the formula is undefined: a quotient by zero, a root or logarithm of a negative
        number, a result that is too large, or a value that is not finite. Of the branches of a
        ``where`` only the chosen one counts.
    """
    with np.errstate(all="ignore"):
        result, undefined = _value(node, values)
        return np.where(undefined | ~np.isfinite(result), np.nan, result)


def _value(node: Node, values: Mapping[str, Any]) -> tuple[Any, Any]:
    """Value of a node, float or (n,), and a mask of the same shape that is true where the value is
    undefined: not finite, outside the domain of a function, or computed from such a value. Of the
    branches of ``where`` only the chosen one counts, and its condition."""
    if isinstance(node, Number):
        return node.value, np.False_
    if isinstance(node, Name):
        value = np.asarray(values[node.path], dtype=float)
        return value, ~np.isfinite(value)
    parts = [_value(one, values) for one in node.arguments]
    arguments = [value for value, _ in parts]
    if node.function == "where":
        (condition, unknown), (one, of_one), (other, of_other) = parts
        return np.where(condition, one, other), unknown | np.where(condition, of_one, of_other)
    undefined: Any = np.False_
    for _, flag in parts:
        undefined = undefined | flag
    if node.function == "-":
        return -arguments[0] if len(arguments) == 1 else arguments[0] - arguments[1], undefined
    if node.function in _DEFINED:
        undefined = undefined | ~np.asarray(_DEFINED[node.function](*arguments))
    result = _VALUES[node.function](*arguments)
    if not is_condition(node):
        undefined = undefined | ~np.isfinite(result)
    return result, undefined


__all__ = [
    "COMPARISONS",
    "FUNCTIONS",
    "KINKS",
    "Call",
    "FormulaError",
    "Name",
    "Node",
    "Number",
    "apply",
    "evaluate",
    "is_condition",
    "may_be_undefined",
    "names",
    "parse",
    "walk",
]
