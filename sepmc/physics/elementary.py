"""Elementary functions without branches or calls, so that a loop over cases is vectorised.

The compiler's own sin, exp, atan2 are calls of a library, and a loop with a call in it stays
scalar. These are accurate to about one unit in the last place over their whole range. All kernels
use them, so that all agree. Checked against mpmath in `tests/physics/test_elementary.py`.
"""

import math
import struct

import numpy as np

from sepmc.jit import formula

_LOG2_E = 1.4426950408889634
# ln(2) in two parts; the first has 32 bits, so that its multiples are exact
_LN2_HIGH, _LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10
_TAN_PI_8 = math.sqrt(2.0) - 1.0


def power_of_two(k: float) -> float:
    """Return 2^k for a whole number k from -1022 to 1023, given as a float; NaN for NaN. Compiled
    code computes it by shifting bits (`sepmc.translator.operations`)."""
    return (
        math.nan
        if math.isnan(k)
        else struct.unpack("<d", struct.pack("<q", (int(k) + 1023) << 52))[0]
    )


@formula
def exponential(x):
    """Exponential exp(x) = 2^k exp(r), |r| <= ln(2) / 2, with the Taylor series of exp(r) to r^13.

    Parameters
    ----------
    x : float

    Returns
    -------
    float
        0 below -708.4, infinite above 709, NaN for NaN; error at most one unit in the last place.
    """
    bounded = -708.4 if x < -708.4 else (709.0 if x > 709.0 else x)
    k = np.floor(bounded * _LOG2_E + 0.5)
    r = (bounded - k * _LN2_HIGH) - k * _LN2_LOW
    p = 1.0 / 479001600.0 + r / 6227020800.0
    p = 1.0 / 3628800.0 + r * (1.0 / 39916800.0 + r * p)
    p = 1.0 / 40320.0 + r * (1.0 / 362880.0 + r * p)
    p = 1.0 / 720.0 + r * (1.0 / 5040.0 + r * p)
    p = 1.0 / 24.0 + r * (1.0 / 120.0 + r * p)
    p = 0.5 + r * (1.0 / 6.0 + r * p)
    value = (1.0 + r * (1.0 + r * p)) * power_of_two(k)
    return 0.0 if x < -708.4 else (math.inf if x > 709.0 else value)


@formula
def _arctan_series(z):
    """Polynomial that approximates (arctan(u) / u - 1) / u^2, for z = u^2 from 0 to tan(pi / 8)^2;
    it interpolates at the Chebyshev points, with an error of 5e-18."""
    p = 0.03923044778479309 - z * 0.019175404711104935
    p = 0.05858140904866328 + z * (-0.050854078345894844 + z * p)
    p = 0.07692183125376892 + z * (-0.06664510525508936 + z * p)
    p = 0.11111111015187018 + z * (-0.0909090457530649 + z * p)
    p = 0.19999999999995516 + z * (-0.14285714284665682 + z * p)
    return -0.3333333333333333 + z * p


@formula
def arctan2(y, x):
    """Angle of the point (x, y), rad, -pi to pi; 0 at the origin. Error at most 2.5 units in the
    last place."""
    top, bottom, high, steep = _ratio(y, x)
    return _angle(top / bottom, high, steep, y, x)


@formula
def arctan2_of_two(y, x, v, u):
    """Angles ``arctan2(y, x)`` and ``arctan2(v, u)`` with one division; two divisions are a tenth
    of the time of the rates of two bodies in air.

    Parameters
    ----------
    y, x, v, u : float
        The distances of both points from the origin are 0 or in 1e-150 to 1e150.

    Returns
    -------
    tuple of 2 float
        rad.
    """
    top, bottom, high, steep = _ratio(y, x)
    other_top, other_bottom, other_high, other_steep = _ratio(v, u)
    inverse = 1.0 / (bottom * other_bottom)
    return (
        _angle(top * other_bottom * inverse, high, steep, y, x),
        _angle(other_top * bottom * inverse, other_high, other_steep, v, u),
    )


@formula
def _ratio(y, x):
    """Ratio of the smaller to the larger of |x|, |y|. If it exceeds tan(pi / 8), it is reduced by
    arctan(t) = pi / 4 + arctan((t - 1) / (t + 1)).

    Returns four values: the numerator and the denominator of the ratio (0 and 1 if x and y are 0);
    True if it was reduced; True if |y| is larger than |x|.
    """
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    small, large = ax if steep else ay, ay if steep else ax
    high = small > _TAN_PI_8 * large
    top = small - large if high else small
    bottom = small + large if high else large
    return top, 1.0 if bottom == 0.0 else bottom, high, steep


@formula
def _angle(u, high, steep, y, x):
    """Angle of the point (x, y), rad, -pi to pi, from the four results of ``_ratio(y, x)``: ``u``
    is its first result (numerator) divided by its second (denominator), ``high`` its third (True if
    the ratio was reduced), ``steep`` its fourth (True if |y| is larger than |x|)."""
    angle = u + u * (u * u) * _arctan_series(u * u)
    angle = 0.25 * math.pi + angle if high else angle
    angle = 0.5 * math.pi - angle if steep else angle
    angle = math.pi - angle if x < 0.0 else angle
    return math.copysign(angle, y)


# pi / 2 in three parts; the first two have 33 bits
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)


@formula
def sine_cosine(x):
    """sin(x) and cos(x) by their series about the nearest multiple of pi / 2.

    Parameters
    ----------
    x : float
        rad, |x| <= 1e5.

    Returns
    -------
    sine, cosine : float
        Absolute error at most 2e-16; NaN for NaN and infinity.
    """
    k = np.floor(x * (2.0 / math.pi) + 0.5)
    r = ((x - k * _HALF_PI[0]) - k * _HALF_PI[1]) - k * _HALF_PI[2]
    z = r * r
    s = -7.647163731819816e-13 + z * 2.8114572543455206e-15
    s = 2.7557319223985893e-06 + z * (-2.505210838544172e-08 + z * (1.6059043836821613e-10 + z * s))
    s = -1.0 / 6.0 + z * (1.0 / 120.0 + z * (-1.0 / 5040.0 + z * s))
    c = 4.779477332387385e-14 - z * 1.5619206968586225e-16
    c = -2.755731922398589e-07 + z * (2.08767569878681e-09 + z * (-1.1470745597729725e-11 + z * c))
    c = -0.5 + z * (1.0 / 24.0 + z * (-1.0 / 720.0 + z * (1.0 / 40320.0 + z * c)))
    sine, cosine = r + r * z * s, 1.0 + z * c
    quadrant = k - 4.0 * np.floor(0.25 * k)
    odd = quadrant == 1.0 or quadrant == 3.0  # noqa: PLR1714
    a, b = cosine if odd else sine, sine if odd else cosine
    return (-a if quadrant >= 2.0 else a), (-b if quadrant == 1.0 or quadrant == 2.0 else b)  # noqa: PLR1714
