"""Jets: values with their first and second derivative in time.

Formulas of signals are evaluated on jets where their rate of change is needed, to predict when they
reach a kink. A number in a jet is an expression, or a number known while the kernel is written.
"""

from typing import Any, NamedTuple

from sepmc.kernel.tracer.formulas import scalar, signals
from sepmc.kernel.tracer.tracer import NUMBER, Expr, trace, where
from sepmc.scene.formula import Call, Number, evaluate


class Jet(NamedTuple):
    """Value of a quantity, its ``rate`` and its ``second`` derivative in time; ``second`` is None
    if it is not known. Both derivatives are 0 where only the value is needed."""

    value: Any
    rate: Any = 0.0
    second: Any = 0.0


def _known(*terms: Any) -> Any:
    """Sum of products; each of the ``terms`` is the tuple of the factors of one product. A product
    with a factor that is known to be 0 is left out. The result is None if a factor of any other
    product is None (not known)."""
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
    """Jet of the sum a + b; its second derivative is None if that of a or of b is."""
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
    """Product of two numbers or expressions. Unlike ``a * b``, a factor that is known to be 0 does
    not make the product 0 while it is written: it is NaN where the other factor is NaN."""
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
    """Jet of a function of one argument ``x``; ``function`` is its name: sin, cos, tan, exp, log or
    sqrt."""
    value = _of(function, x.value)
    if _is_still(x):
        return Jet(value)
    slope, bend = _derivatives(function, x.value, value)
    return chain(value, slope, bend, x)


def chain(value: Any, slope: Any, bend: Any, x: Jet) -> Jet:
    """Jet of a function f(x) by the chain rule, from the jet ``x``, the ``value`` of f and its
    first and second derivative by x, ``slope`` and ``bend``."""
    return Jet(value, _known((slope, x.rate)), _known((bend, x.rate, x.rate), (slope, x.second)))


def power(x: Jet, y: Jet) -> Jet:
    """Jet of the power x^y. Rates of a negative base are right only for an exponent that is known
    to be an integer of magnitude up to 16; otherwise they follow from the logarithm of x."""
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


_MAX_PRODUCT = 16  # largest integer power that is written as a product


def angle(y: Jet, x: Jet) -> Jet:
    """Jet of the angle atan2(y, x), rad."""
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
    """Jet that equals ``one`` where a condition is satisfied, else ``other``. If the condition is a
    known bool, it is that jet itself; with a symbolic condition its second derivative is known only
    if it is known of both."""
    if isinstance(condition, bool):
        return one if condition else other
    is_known = one.second is not None and other.second is not None
    return Jet(
        _selected(condition, one.value, other.value),
        _selected(condition, one.rate, other.rate),
        _selected(condition, one.second, other.second) if is_known else None,
    )


def _selected(condition: Any, one: Any, other: Any) -> Any:
    """Number that equals ``one`` where a condition is satisfied, else ``other``, without a new node
    if both are the same known number."""
    if not isinstance(one, Expr) and not isinstance(other, Expr) and one == other:
        return one
    return where(condition, one, other)


def _is_still(x: Jet) -> bool:
    """True if, while the kernel is written, the rate of a jet is the number 0 and its second
    derivative is not None (unknown): the value is constant, or only the value is needed, since both
    derivatives of such jets are 0 too."""
    return not isinstance(x.rate, Expr) and x.rate == 0.0 and x.second is not None


def _of(function: str, *values: Any) -> Any:
    """Value of the operator or function of a formula with the name ``function`` at these arguments:
    a number if all arguments are known numbers, else an expression."""
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
    """First and second derivative at ``x`` of sin, cos, tan, exp, log or sqrt, by its name (any
    other name counts as sqrt); ``value`` is that of the function at x."""
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
