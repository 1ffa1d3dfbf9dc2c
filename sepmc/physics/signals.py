"""Mathematical functions that formulas of a campaign file can call. Where a function is undefined
or its argument too large, it gives NaN, so that no case is valid by a number without meaning."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import exponential, sine_cosine

_LARGEST_EXPONENT = 709.0  # of exp
_LARGEST_ANGLE = 1e5  # rad, of `sepmc.physics.elementary.sine_cosine`


@formula
def quotient(a, b):
    """Quotient a / b.

    Parameters
    ----------
    a, b : float

    Returns
    -------
    float
        NaN if b is 0.
    """
    return a / (b if b != 0.0 else math.nan)


@formula
def root(x):
    """Square root of x.

    Parameters
    ----------
    x : float

    Returns
    -------
    float
        NaN if x is negative.
    """
    return math.sqrt(x if x >= 0.0 else math.nan)


@formula
def logarithm(x):
    """Natural logarithm of x.

    Parameters
    ----------
    x : float

    Returns
    -------
    float
        NaN if x is 0, negative or NaN; infinity if x is infinite.
    """
    positive = x > 0.0
    value = math.log(x if positive else 1.0)
    return value if positive else math.nan


@formula
def growth(x):
    """Exponential exp(x).

    Parameters
    ----------
    x : float

    Returns
    -------
    float
        NaN above 709, where it overflows.
    """
    return exponential(x if x <= _LARGEST_EXPONENT else math.nan)


@formula
def power(x, y):
    """Power x^y of a base that is not negative; 0^0 is 1.

    Parameters
    ----------
    x, y : float

    Returns
    -------
    float
        NaN if x is negative, if x is 0 and y is negative, or if the power overflows.
    """
    is_zero = x == 0.0 and y >= 0.0
    exponent = y * math.log(x if x > 0.0 else 1.0)
    defined = x > 0.0 and exponent <= _LARGEST_EXPONENT
    value = (x if defined else 1.0) ** (y if defined else 1.0)
    at_zero = 1.0 if y == 0.0 else 0.0
    return value if defined else (at_zero if is_zero else math.nan)


@formula
def sine(x):
    """sin(x).

    Parameters
    ----------
    x : float
        rad.

    Returns
    -------
    float
        NaN beyond 1e5 rad.
    """
    return sine_cosine(x if abs(x) <= _LARGEST_ANGLE else math.nan)[0]


@formula
def cosine(x):
    """cos(x).

    Parameters
    ----------
    x : float
        rad.

    Returns
    -------
    float
        NaN beyond 1e5 rad.
    """
    return sine_cosine(x if abs(x) <= _LARGEST_ANGLE else math.nan)[1]
