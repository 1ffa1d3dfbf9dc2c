"""Values with their first and second derivative in time: formulas are evaluated on them where their
motion matters, to predict when they reach a kink."""

from typing import Any, NamedTuple

from sepmc.kernel.tracer.formulas import scalar, signals
from sepmc.kernel.tracer.tracer import NUMBER, Expr, trace, where
from sepmc.scene.formula import Call, Number, evaluate


class Jet(NamedTuple):
    """Value, rate and acceleration of a number; the acceleration is None if it is not known, and
    both are 0 where only the value is asked for."""

    value: Any
    rate: Any = 0.0
    second: Any = 0.0


def _known(*terms: Any) -> Any:
    """Sum of the products in terms; None if any factor that counts is unknown."""
    result: Any = 0.0
    for factors in terms:
        if any(not isinstance(x, Expr) and x == 0.0 for x in factors if x is not None):
            continue
        if any(x is None for x in factors):
            return None
        product = factors[0]
        for x in factors[1:]:
            product = product * x
        result = result + product
    return result


def add(a: Jet, b: Jet) -> Jet:
    """Sum."""
    return Jet(a.value + b.value, a.rate + b.rate, _known((a.second,), (b.second,)))


def negative(a: Jet) -> Jet:
    """Opposite number."""
    return Jet(-a.value, -a.rate, None if a.second is None else -a.second)


def multiply(a: Jet, b: Jet) -> Jet:
    """Product."""
    return Jet(
        _product(a.value, b.value),
        _known((a.rate, b.value), (a.value, b.rate)),
        _known((a.second, b.value), (2.0, a.rate, b.rate), (a.value, b.second)),
    )


def _product(a: Any, b: Any) -> Any:
    """Product of two numbers; that of 0 and a number that is undefined is undefined."""
    if isinstance(a, Expr) or isinstance(b, Expr):
        return trace("*", (a, b), NUMBER)
    return a * b


def divide(a: Jet, b: Jet) -> Jet:
    """Quotient."""
    value = _of("/", a.value, b.value)
    if _is_still(a) and _is_still(b):
        return Jet(value)
    inverse = _of("/", 1.0, b.value)
    rate = _known((a.rate, inverse), (-1.0, value, b.rate, inverse))
    second = _known(
        (a.second, inverse), (-2.0, rate, b.rate, inverse), (-1.0, value, b.second, inverse)
    )
    return Jet(value, rate, second)


def apply(function: str, x: Jet) -> Jet:
    """Function of one number: sin, cos, tan, exp, log or sqrt."""
    value = _of(function, x.value)
    if _is_still(x):
        return Jet(value)
    slope, bend = _derivatives(function, x.value, value)
    return chain(value, slope, bend, x)


def chain(value: Any, slope: Any, bend: Any, x: Jet) -> Jet:
    """Function of a number from its value and its two derivatives."""
    return Jet(value, _known((slope, x.rate)), _known((bend, x.rate, x.rate), (slope, x.second)))


def power(x: Jet, y: Jet) -> Jet:
    """Power x^y; a base that may be negative has a whole number as exponent."""
    if not isinstance(y.value, Expr) and _is_still(y) and float(y.value).is_integer():
        n = int(y.value)
        if 0 < n <= _MAX_PRODUCT:
            result = x
            for _ in range(n - 1):
                result = multiply(result, x)
            return result
        if -_MAX_PRODUCT <= n < 0:
            return divide(Jet(1.0), power(x, Jet(-y.value)))
        if n == 0:
            return Jet(1.0)
    value = _of("**", x.value, y.value)
    if _is_still(x) and _is_still(y):
        return Jet(value)
    # d(x^y) / x^y = y' log x + y x' / x
    logarithm = apply("log", x)
    exponent = multiply(y, logarithm)
    return chain(value, value, value, exponent)


_MAX_PRODUCT = 16  # largest power that is a product


def angle(y: Jet, x: Jet) -> Jet:
    """Angle of the point (x, y), rad."""
    value = _of("atan2", y.value, x.value)
    if _is_still(y) and _is_still(x):
        return Jet(value)
    # rate w = (x y' - y x') / r2; w' = (x y'' - y x'') / r2 - 2 w (x x' + y y') / r2
    inverse = _of("/", 1.0, x.value * x.value + y.value * y.value)
    rate = _known((x.value, y.rate, inverse), (-1.0, y.value, x.rate, inverse))
    along = _known((x.value, x.rate), (y.value, y.rate))
    second = _known(
        (x.value, y.second, inverse),
        (-1.0, y.value, x.second, inverse),
        (-2.0, rate, along, inverse),
    )
    return Jet(value, rate, second)


def select(condition: Any, one: Jet, other: Jet) -> Jet:
    """Jet ``one`` where a condition is satisfied, ``other`` elsewhere."""
    if isinstance(condition, bool):
        return one if condition else other
    is_known = one.second is not None and other.second is not None
    return Jet(
        _selected(condition, one.value, other.value),
        _selected(condition, one.rate, other.rate),
        _selected(condition, one.second, other.second) if is_known else None,
    )


def _selected(condition: Any, one: Any, other: Any) -> Any:
    """`where`, or the number itself if both are the same known number."""
    if not isinstance(one, Expr) and not isinstance(other, Expr) and one == other:
        return one
    return where(condition, one, other)


def _is_still(x: Jet) -> bool:
    """True if a value is known not to change."""
    return not isinstance(x.rate, Expr) and x.rate == 0.0 and x.second is not None


def _of(function: str, *values: Any) -> Any:
    """Function of values; computed at once if they are all known."""
    if not any(isinstance(x, Expr) for x in values):
        return float(evaluate(Call(function, tuple(Number(float(x)) for x in values)), {}))
    return _FUNCTIONS[function](*values)


_FUNCTIONS: dict[str, Any] = {
    "/": signals.quotient,
    "**": signals.power,
    "atan2": scalar.arctan2,
    "sin": signals.sine,
    "cos": signals.cosine,
    "tan": lambda x: signals.quotient(signals.sine(x), signals.cosine(x)),
    "exp": signals.growth,
    "log": signals.logarithm,
    "sqrt": signals.root,
}


def _derivatives(function: str, x: Any, value: Any) -> tuple[Any, Any]:
    """First and second derivative of a function of one number."""
    if function == "sin":
        return _of("cos", x), -value
    if function == "cos":
        return -_of("sin", x), -value
    if function == "tan":
        slope = 1.0 + value * value
        return slope, 2.0 * value * slope
    if function == "exp":
        return value, value
    if function == "log":
        inverse = _of("/", 1.0, x)
        return inverse, -inverse * inverse
    slope = _of("/", 0.5, value)
    return slope, -_of("/", slope, 2.0 * x)
