"""Values with their first and second derivative in time: formulas are evaluated on them where their
motion matters, to predict when they reach a kink."""

from typing import Any, NamedTuple

from sepmc.kernel.tracer.formulas import scalar, signals
from sepmc.kernel.tracer.tracer import NUMBER, Expr, trace, where
from sepmc.scene.formula import Call, Number, evaluate


class Jet(NamedTuple):
    """Value of a number, its rate and its ``second`` derivative in time; the latter is None if it
    is not known. Both are 0 where only the value is needed."""

    value: Any
    rate: Any = 0.0
    second: Any = 0.0


def _known(*terms: Any) -> Any:
    """Sum of products, each given by a tuple of its factors. A product with a known factor 0 is
    left out; None if any other product has an unknown factor (None)."""
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
    """Jet of the sum a + b."""
    return Jet(a.value + b.value, a.rate + b.rate, _known((a.second,), (b.second,)))


def negative(a: Jet) -> Jet:
    """Jet of -a."""
    return Jet(-a.value, -a.rate, None if a.second is None else -a.second)


def multiply(a: Jet, b: Jet) -> Jet:
    """Jet of the product a b."""
    return Jet(
        _product(a.value, b.value),
        _known((a.rate, b.value), (a.value, b.rate)),
        _known((a.second, b.value), (2.0, a.rate, b.rate), (a.value, b.second)),
    )


def _product(a: Any, b: Any) -> Any:
    """Product of two numbers. A known 0 does not remove the other factor: where that is NaN, the
    product is NaN."""
    if isinstance(a, Expr) or isinstance(b, Expr):
        return trace("*", (a, b), NUMBER)
    return a * b


def divide(a: Jet, b: Jet) -> Jet:
    """Jet of the quotient a / b; the value is NaN where b is 0."""
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
    """Jet of a function of one number, by its name: sin, cos, tan, exp, log or sqrt."""
    value = _of(function, x.value)
    if _is_still(x):
        return Jet(value)
    slope, bend = _derivatives(function, x.value, value)
    return chain(value, slope, bend, x)


def chain(value: Any, slope: Any, bend: Any, x: Jet) -> Jet:
    """Jet of a function of ``x``, from the value of the function and its first and second
    derivative by x (``slope``, ``bend``)."""
    return Jet(value, _known((slope, x.rate)), _known((bend, x.rate, x.rate), (slope, x.second)))


def power(x: Jet, y: Jet) -> Jet:
    """Jet of the power x^y; a base that may be negative must have a known whole number as
    exponent."""
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
    """Jet of the angle of the point (x, y), rad: atan2(y, x)."""
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
    """Value of a function of a formula, by its name; computed at once if all arguments are known
    numbers."""
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
    """First and second derivative, at ``x``, of a function of one number (`apply`) that has
    ``value`` there."""
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
