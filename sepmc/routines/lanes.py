"""Lanes: cases side by side in one flat workspace, so that a loop over them is vectorised.

A quantity is a field of LANES numbers, one for each case. All fields of a block of cases are in one
array, at offsets that are constants when the kernel is compiled: only then does the compiler see
that lanes do not overlap (5 times the speed).
"""

import math

import numpy as np

from sepmc.jit import config, formula
from sepmc.routines import layout

# plain Python runs one lane
LANES = 1 if config.plain else layout.LANES


@formula
def get3(w, k):
    """Vector of a lane, first component at w[k]."""
    return (w[k], w[k + LANES], w[k + 2 * LANES])


@formula
def get4(w, k):
    """Four numbers of a lane, the first at w[k]: a quaternion, or the base of a layer of air."""
    return (w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES])


@formula
def get6(w, k):
    """Symmetric matrix (tuple of 9) of a lane from its six numbers xx, xy, xz, yy, yz, zz, the
    first at w[k]."""
    xx, xy, xz = get3(w, k)
    yy, yz, zz = get3(w, k + 3 * LANES)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def get9(w, k):
    """Matrix (tuple of 9 by rows) of a lane, first element at w[k]."""
    a, b, c = get3(w, k), get3(w, k + 3 * LANES), get3(w, k + 6 * LANES)
    return (a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])


@formula
def largest3(a):
    """Largest magnitude of three numbers."""
    return max(abs(a[0]), abs(a[1]), abs(a[2]))


@formula
def largest4(a):
    """Largest magnitude of four numbers."""
    return max(largest3((a[0], a[1], a[2])), abs(a[3]))


@formula
def put9(w, k, a):
    """Store a matrix (tuple of 9 by rows) of a lane, first element at w[k]."""
    put3(w, k, (a[0], a[1], a[2]))
    put3(w, k + 3 * LANES, (a[3], a[4], a[5]))
    put3(w, k + 6 * LANES, (a[6], a[7], a[8]))


@formula
def put3(w, k, a):
    """Store a vector of a lane, first component at w[k]."""
    w[k], w[k + LANES], w[k + 2 * LANES] = a


@formula
def put4(w, k, a):
    """Store four numbers of a lane, the first at w[k]."""
    w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES] = a


@formula
def put6(w, k, m):
    """Store the six numbers xx, xy, xz, yy, yz, zz of a symmetric matrix (tuple of 9) of a lane,
    the first at w[k]."""
    put3(w, k, (m[0], m[1], m[2]))
    put3(w, k + 3 * LANES, (m[4], m[5], m[8]))


@formula
def time_left(value, rate, acceleration, jerk):
    """Time until a quantity rises through zero: the root of value + rate t + acceleration t^2 / 2 +
    jerk t^3 / 6.

    The root without jerk, then three Newton iterations towards the one with it.

    Parameters
    ----------
    value : float
        Negative before the crossing, positive after it (the time is then negative).
    rate, acceleration, jerk : float
        Its time derivatives.

    Returns
    -------
    float
        s; infinite if there is no crossing.
    """
    square = rate * rate - 2.0 * value * acceleration
    speed = rate + math.sqrt(square if square > 0.0 else 0.0)
    crosses = square >= 0.0 and speed > 0.0
    wait = -2.0 * value / (speed if crosses else 1.0)
    for _ in range(3):
        slope = rate + wait * (acceleration + 0.5 * wait * jerk)
        excess = value + wait * (rate + wait * (0.5 * acceleration + wait * jerk / 6.0))
        wait = wait - excess / slope if slope > 0.0 else wait
    return wait if crosses else math.inf


@formula
def nearest_turn(angle, last):
    """Angle, rad, plus as many full turns as bring it within half a turn of the angle ``last``."""
    return angle + 2.0 * math.pi * np.floor((last - angle) / (2.0 * math.pi) + 0.5)


@formula
def larger(a, b):
    """Larger of two numbers; the second if any of them is NaN."""
    return a if a >= b else b
