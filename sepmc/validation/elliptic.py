"""Jacobi's amplitude and Legendre's elliptic integrals, as functions of m1 = 1 - k^2 (modulus k),
so that no digits are lost near k = 1."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import elliprf, elliprj

Array = np.ndarray


def jacobi_amplitude(u: ArrayLike, m1: float) -> Array:
    """Jacobi's amplitude am(u), rad, of modulus k, with m1 = 1 - k^2; sn = sin am, cn = cos am. It
    is not reduced to one period, so it is continuous in u.

    By the arithmetic-geometric mean (Abramowitz and Stegun 16.4), from m1 instead of k^2, which has
    lost digits near k = 1. A value m1 <= 0 counts as k = 1.
    """
    u = np.asarray(u, float)
    if m1 <= 0.0:
        return 2.0 * np.arctan(np.tanh(0.5 * u))
    a, b = 1.0, math.sqrt(m1)
    ratios: list[float] = []
    while (a - b) > 4e-16 * a or not ratios:
        a, b, c = 0.5 * (a + b), math.sqrt(a * b), 0.5 * (a - b)
        ratios.append(c / a)
    angle = 2.0 ** len(ratios) * a * u
    for ratio in reversed(ratios):
        angle = 0.5 * (angle + np.arcsin(ratio * np.sin(angle)))
    return angle


def legendre_first(angle: ArrayLike, m1: float) -> Array:
    """Legendre's incomplete elliptic integral of the first kind F, with m1 = 1 - k^2, of an angle
    from -pi/2 to pi/2, rad. DLMF 19.25.5."""
    s, c = np.sin(angle), np.cos(angle)
    return s * elliprf(c * c, c * c + m1 * s * s, 1.0)


def legendre_third(n: float, angle: ArrayLike, m1: float) -> Array:
    """Legendre's incomplete elliptic integral of the third kind: the integral of 1 / ((1 - n sin^2
    x) sqrt(1 - k^2 sin^2 x)) over x from 0 to ``angle``, rad.

    n <= 0 and m1 = 1 - k^2. The angle may have any size; for m1 = 0 it must lie between -pi/2 and
    pi/2. DLMF 19.25.14, by Carlson's R_F and R_J.
    """
    angles = np.asarray(angle, float)
    half_turns = np.round(angles / math.pi)

    def within(angle: Array) -> Array:
        """Integral from 0 to an angle between -pi/2 and pi/2."""
        s2, c2 = np.sin(angle) ** 2, np.cos(angle) ** 2
        first, third = (
            elliprf(c2, c2 + m1 * s2, 1.0),
            elliprj(c2, c2 + m1 * s2, 1.0, c2 + (1.0 - n) * s2),
        )
        return np.sin(angle) * (first + n / 3.0 * s2 * third)

    quarter = within(np.array(0.5 * math.pi)) if np.any(half_turns) else 0.0
    return 2.0 * half_turns * quarter + within(angles - half_turns * math.pi)
