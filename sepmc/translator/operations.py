"""Operations of translated code: arithmetic, comparisons, functions of numbers, views of arrays.

Every function here adds instructions to ``f``, a `sepmc.translator.functions.Function` in
translation, and returns the result as a value; most add none if the result is known already.
LLVM may contract floating-point operations to fused multiply-adds, but not change them otherwise:
NaN and infinities must survive to be reported.
"""

import ast
import math
from functools import partial, reduce
from typing import Any

import numpy as np

from sepmc.jit import noinline
from sepmc.physics.elementary import power_of_two
from sepmc.routines import arrays
from sepmc.routines.layout import STRUCTURE
from sepmc.translator.units import workspace
from sepmc.translator.values import (
    BOOL,
    FLOAT,
    INT,
    POINTER,
    Array,
    Number,
    Record,
    common_kind,
    constant,
)

_FLAG = "contract"
_FLOAT_OPS: dict[type, str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_INT_OPS: dict[type, str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_PYTHON: dict[type, Any] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
}
_FLOAT_TESTS: dict[type, str] = {
    ast.Lt: "olt", ast.LtE: "ole", ast.Gt: "ogt", ast.GtE: "oge", ast.Eq: "oeq", ast.NotEq: "une",
}  # fmt: skip
_INT_TESTS: dict[type, str] = {
    ast.Lt: "slt", ast.LtE: "sle", ast.Gt: "sgt", ast.GtE: "sge", ast.Eq: "eq", ast.NotEq: "ne",
}  # fmt: skip
_PYTHON_TESTS: dict[type, Any] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b,
}


def truth(f: Any, value: Any) -> Number:
    """Add to ``f`` the code that makes a number a truth value: true unless it equals 0. Returns
    the truth value."""
    if value.kind == BOOL:
        return value
    return comparison(f, ast.NotEq(), value, constant(0))


def negation(f: Any, value: Number) -> Number:
    """Add to ``f`` the code of `not value`, of a truth value; return the result. Of a value that is
    known during translation the result is a constant, and no code is added."""
    if value.constant is not None:
        return constant(not value.constant)
    return f.emit(BOOL, f"xor i1 {value.text}, true")


def minus(f: Any, value: Number) -> Number:
    """Add to ``f`` the code of `-value`; return the result, an integer for a truth value."""
    if value.constant is not None:
        return constant(-value.constant)
    if value.kind == FLOAT:
        return f.emit(FLOAT, f"fneg {_FLAG} double {value.text}")
    return f.emit(INT, f"sub i64 0, {f.converted(value, INT).text}")


def add_int(f: Any, a: Number, b: Number) -> Number:
    """Add to ``f`` the code of `a + b`, of two integers; return the result."""
    return arithmetic(f, ast.Add(), a, b)


def multiply_int(f: Any, a: Number, b: Number) -> Number:
    """Add to ``f`` the code of `a * b`, of two integers; return the result."""
    return arithmetic(f, ast.Mult(), a, b)


def arithmetic(f: Any, op: ast.operator, left: Number, right: Number) -> Number:
    """Add to ``f`` the code of a binary operation of Python on two numbers, given by its node of
    the syntax tree (``ast.Add()``); return the result. Of two constants, the result is a constant
    and no code is added, unless it divides by zero. Raises TypeError for an operation or types
    that cannot be translated."""
    special = _SPECIAL.get(type(op))
    if special is not None:
        result: Number = special(f, left, right)
        return result
    if type(op) not in _PYTHON:
        raise TypeError(
            f"no operation {type(op).__name__}: must be one of + - * / // % ** and, for truth "
            "values, & |"
        )
    kind = FLOAT if isinstance(op, ast.Div) else _numeric_kind(left, right)
    a, b = f.converted(left, kind), f.converted(right, kind)
    known = a.constant is not None and b.constant is not None
    if known and not (isinstance(op, ast.Div) and b.constant == 0):
        return constant(_PYTHON[type(op)](a.constant, b.constant))
    if kind == FLOAT:
        return f.emit(FLOAT, f"{_FLOAT_OPS[type(op)]} {_FLAG} double {a.text}, {b.text}")
    if isinstance(op, ast.Add) and 0 in (a.constant, b.constant):
        return b if a.constant == 0 else a
    return f.emit(INT, f"{_INT_OPS[type(op)]} nsw i64 {a.text}, {b.text}")


def _numeric_kind(a: Number, b: Number) -> str:
    """Return the type, INT or FLOAT, of the result of arithmetic with two numbers. Raises TypeError
    for two truth values."""
    kind = common_kind(a, b)
    if kind == BOOL:
        raise TypeError("no arithmetic with truth values")
    return kind


def _bits(name: str, f: Any, left: Number, right: Number) -> Number:
    """Add to ``f`` the code of `left | right` (``name`` "or") or `left & right` ("and"), of two
    truth values, also if both are known; return the result, which counts as unknown. Raises
    TypeError for other numbers."""
    if left.kind != BOOL or right.kind != BOOL:
        raise TypeError(f"bitwise {name} is for truth values, not for numbers")
    return f.emit(BOOL, f"{name} i1 {left.text}, {right.text}")


def _power(f: Any, base: Number, exponent: Number) -> Number:
    """Add to ``f`` the code of `base**exponent`: none if both are known, multiplications if the
    exponent is a known integer above 0, else a call of LLVM's ``pow``. Returns the result."""
    if base.constant is not None and exponent.constant is not None:
        return constant(base.constant**exponent.constant)
    if exponent.kind == INT and exponent.constant is not None and exponent.constant > 0:
        result, square, n = None, base, exponent.constant
        while n:
            if n & 1:
                result = square if result is None else arithmetic(f, ast.Mult(), result, square)
            n >>= 1
            if n:
                square = arithmetic(f, ast.Mult(), square, square)
        assert result is not None
        return result
    return _intrinsic(f, "pow", base, exponent)


def _remainder(f: Any, a: Number, b: Number) -> Number:
    """Add to ``f`` the code of `a % b`; return the result, which has the sign of the divisor, as in
    Python. The running code does not check that b is not 0."""
    kind = _numeric_kind(a, b)
    a, b = f.converted(a, kind), f.converted(b, kind)
    zero = constant(0 if kind == INT else 0.0)
    rest = f.emit(kind, f"{'srem' if kind == INT else 'frem'} {kind} {a.text}, {b.text}")
    shifted = arithmetic(f, ast.Add(), rest, b)
    is_rest = comparison(f, ast.NotEq(), rest, zero)
    signs = [comparison(f, ast.Lt(), number, zero) for number in (rest, b)]
    differ = f.emit(BOOL, f"xor i1 {signs[0].text}, {signs[1].text}")
    result = select(f, connected(f, is_rest, differ, True), shifted, rest)
    if kind == INT:
        return result
    return select(f, is_rest, result, _intrinsic(f, "copysign", zero, b))


def _quotient(f: Any, a: Number, b: Number) -> Number:
    """Add to ``f`` the code of `a // b`, of two integers; return the result, rounded down as in
    Python. The running code does not check that b is not 0. Raises TypeError for floats."""
    if _numeric_kind(a, b) != INT:
        raise TypeError("// is for whole numbers, not for floats")
    a, b = f.converted(a, INT), f.converted(b, INT)
    rest = _remainder(f, a, b)
    return f.emit(INT, f"sdiv i64 {arithmetic(f, ast.Sub(), a, rest).text}, {b.text}")


def comparison(f: Any, op: ast.cmpop, left: Number, right: Number) -> Number:
    """Add to ``f`` the code of a comparison of two numbers, given by its node of the syntax tree
    (``ast.Lt()``); return the truth value. Of two constants it is a constant, without code. Raises
    TypeError for a comparison that cannot be translated, such as ``is``."""
    if type(op) not in _PYTHON_TESTS:
        raise TypeError(
            f"no comparison {type(op).__name__}: must be one of < <= > >= == != and, for items of "
            "a tuple, in"
        )
    if left.constant is not None and right.constant is not None:
        return constant(_PYTHON_TESTS[type(op)](left.constant, right.constant))
    kind = common_kind(left, right)
    if kind == BOOL and not isinstance(op, ast.Eq | ast.NotEq):
        kind = INT  # as a signed number of one bit, True is -1
    a, b = f.converted(left, kind), f.converted(right, kind)
    if kind == FLOAT:
        return f.emit(BOOL, f"fcmp {_FLOAT_TESTS[type(op)]} double {a.text}, {b.text}")
    return f.emit(BOOL, f"icmp {_INT_TESTS[type(op)]} {kind} {a.text}, {b.text}")


def is_in(f: Any, value: Number, items: tuple[Number, ...]) -> Number:
    """Add to ``f`` the code of `value in items`, of a tuple of at least one number; return the
    truth value."""
    tests = [comparison(f, ast.Eq(), value, item) for item in items]
    return reduce(lambda a, b: connected(f, a, b, False), tests)


def connected(f: Any, a: Number, b: Number, both: bool) -> Number:
    """Add to ``f`` the code of `a and b` if ``both`` is true, else of `a or b`, of two truth values
    that have both been evaluated; return the result. No code is added if ``a`` is known during
    translation, or ``b`` is and makes no difference."""
    if a.constant is not None:
        return b if a.constant == both else a
    if b.constant is not None and b.constant == both:
        return a
    yes, no = (b.text, "false") if both else ("true", b.text)
    return f.emit(BOOL, f"select i1 {a.text}, i1 {yes}, i1 {no}")


def select(f: Any, test: Number, yes: Number, no: Number) -> Number:
    """Add to ``f`` the code of `yes if test else no`, of two numbers of the same type that have
    both been evaluated; return the result. If both are the same number, that is returned and no
    code is added; whether ``test`` is known during translation makes no difference."""
    if yes.text == no.text:
        return yes
    text = f"select i1 {test.text}, {yes.kind} {yes.text}, {no.kind} {no.text}"
    return f.emit(yes.kind, text)


# Functions that translated code can call


def _intrinsic(f: Any, name: str, *numbers: Number) -> Number:
    """Add to ``f`` a call of LLVM's function ``llvm.NAME.f64`` with numbers, converted to floats;
    return the result."""
    operands = ", ".join(f"double {f.converted(number, FLOAT).text}" for number in numbers)
    f.module.declare(f"declare double @llvm.{name}.f64({', '.join(['double'] * len(numbers))})")
    return f.emit(FLOAT, f"call {_FLAG} double @llvm.{name}.f64({operands})")


def _hypot(f: Any, x: Number, y: Number) -> Number:
    f.module.declare("declare double @hypot(double, double) memory(none)")
    a, b = f.converted(x, FLOAT), f.converted(y, FLOAT)
    return f.emit(FLOAT, f"call {_FLAG} double @hypot(double {a.text}, double {b.text})")


def _abs(f: Any, x: Number) -> Number:
    if x.constant is not None:
        return constant(abs(x.constant))
    if x.kind == FLOAT:
        return _intrinsic(f, "fabs", x)
    f.module.declare("declare i64 @llvm.abs.i64(i64, i1)")
    return f.emit(INT, f"call i64 @llvm.abs.i64(i64 {f.converted(x, INT).text}, i1 false)")


def _extreme(op: ast.cmpop, f: Any, *numbers: Number) -> Number:
    """Add to ``f`` the code of `max(...)` if ``op`` is ``ast.Gt()``, of `min(...)` if ``ast.Lt()``;
    return the result. As in Python, it is the first of equal numbers, and a NaN replaces no number
    before it. Raises TypeError for fewer than two numbers."""

    if len(numbers) < 2:
        raise TypeError("min and max take two or more numbers, not one number or a tuple")

    def better(best: Number, other: Number) -> Number:
        kind = common_kind(best, other)
        best, other = f.converted(best, kind), f.converted(other, kind)
        test = comparison(f, op, other, best)
        if test.constant is not None:
            return other if test.constant else best
        return select(f, test, other, best)

    return reduce(better, numbers)


def _int(f: Any, x: Number) -> Number:
    if x.kind != FLOAT:
        return f.converted(x, INT)
    if x.constant is not None:
        return constant(int(x.constant))
    number = f.emit(INT, f"fptosi double {x.text} to i64")
    return f.emit(INT, f"freeze i64 {number.text}")  # any number for NaN, not poison


def _rounded(name: str, f: Any, x: Number) -> Number:
    """Add to ``f`` the code of `math.floor(x)` or `math.ceil(x)` (``name`` "floor", "ceil"); return
    the result, an integer. Of a NaN it is any integer; no error is raised."""
    return _int(f, _intrinsic(f, name, x))


def _isnan(f: Any, x: Number) -> Number:
    return f.emit(BOOL, f"fcmp uno double {f.converted(x, FLOAT).text}, 0x0000000000000000")


def _isfinite(f: Any, x: Number) -> Number:
    infinity = constant(math.inf).text
    return f.emit(BOOL, f"fcmp olt double {_intrinsic(f, 'fabs', x).text}, {infinity}")


def _power_of_two(f: Any, k: Number) -> Number:
    """Add to ``f`` the code of 2 to the power of ``k``, a whole number given as a float, from -1022
    to 1023 (not checked), which sets the bits of the exponent; return the result."""
    shifted = f.emit(FLOAT, f"fadd double {k.text}, {constant(1023.0).text}")
    bits = f.emit(INT, f"shl i64 {_int(f, shifted).text}, 52")
    return f.emit(FLOAT, f"bitcast i64 {bits.text} to double")


def _len(f: Any, items: Any) -> Number:
    return constant(len(items)) if isinstance(items, tuple) else items.shape[0]


def _noinline(f: Any) -> tuple[()]:
    f.noinline = True
    return ()


def _field(f: Any, a: Array, k: Number, n: int) -> Number:
    """Add to ``f`` the code that loads one of the four integers that describe array ``k`` among the
    arguments ``a`` of a kernel; return it. It is the address of the array (``n`` = 0) or the size
    of its axis ``n`` - 1."""
    position = add_int(f, multiply_int(f, constant(4), k), constant(n))
    pointer = f.emit(POINTER, f"getelementptr i64, ptr {a.data.text}, i64 {position.text}")
    return f.emit(INT, f"load i64, ptr {pointer.text}")


def _data(f: Any, a: Array, k: Number) -> Number:
    return f.emit(POINTER, f"inttoptr i64 {_field(f, a, k, 0).text} to ptr")


def _view(element: str, axes: int, f: Any, a: Array, k: Number) -> Array:
    """Add to ``f`` the code that loads the address and sizes of array ``k`` among the arguments
    ``a`` of a kernel; return its view with ``axes`` axes and elements of the type ``element``."""
    shape = tuple(_field(f, a, k, 1 + axis) for axis in range(axes))
    return Array(element, _data(f, a, k), shape)


def _record(f: Any, a: Array, k: Number) -> Record:
    return Record(_data(f, a, k), STRUCTURE.names or ())


_SPECIAL: dict[type, Any] = {
    ast.Pow: _power,
    ast.Mod: _remainder,
    ast.FloorDiv: _quotient,
    ast.BitOr: partial(_bits, "or"),
    ast.BitAnd: partial(_bits, "and"),
}
CALLS: dict[Any, Any] = {
    abs: _abs,
    min: partial(_extreme, ast.Lt()),
    max: partial(_extreme, ast.Gt()),
    int: _int,
    float: lambda f, x: f.converted(x, FLOAT),
    len: _len,
    math.sqrt: lambda f, x: _intrinsic(f, "sqrt", x),
    math.log: lambda f, x: _intrinsic(f, "log", x),
    math.copysign: lambda f, x, y: _intrinsic(f, "copysign", x, y),
    math.floor: partial(_rounded, "floor"),
    math.ceil: partial(_rounded, "ceil"),
    math.hypot: _hypot,
    math.isnan: _isnan,
    math.isfinite: _isfinite,
    np.floor: lambda f, x: _intrinsic(f, "floor", x),
    np.ceil: lambda f, x: _intrinsic(f, "ceil", x),
    power_of_two: _power_of_two,
    noinline: _noinline,
    workspace: lambda f, address: address,
    arrays.vector: partial(_view, FLOAT, 1),
    arrays.indices: partial(_view, INT, 1),
    arrays.table: partial(_view, FLOAT, 2),
    arrays.block: partial(_view, FLOAT, 3),
    arrays.record: _record,
}
