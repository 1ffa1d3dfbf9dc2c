"""Lanes: cases side by side in one flat array, the workspace, so that loops over them are
vectorised.

Each number of a case has LANES places in a row, one for each case (lane). A vector of a lane thus
has its components LANES apart. All numbers of a block of cases are in one array, at offsets that
are constants when the kernel is compiled: only then does the compiler see that they do not overlap
(5 times the speed). In the functions here, k is the position of the first number of the lane.
"""

import math

import numpy as np

from sepmc.jit import config, formula
from sepmc.routines import layout

# plain Python runs one lane
LANES = 1 if config.plain else layout.LANES


@formula
def get3(w, k):
    """Return the vector (tuple of 3) of a lane whose components are at w[k], w[k + LANES], ..."""
    return (w[k], w[k + LANES], w[k + 2 * LANES])


@formula
def get4(w, k):
    """Return four numbers of a lane, at w[k], w[k + LANES], ...: a quaternion, or the base of a
    layer of air."""
    return (w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES])


@formula
def get6(w, k):
    """Return the symmetric matrix (tuple of 9) of a lane whose six numbers xx, xy, xz, yy, yz, zz
    are at w[k], w[k + LANES], ..."""
    xx, xy, xz = get3(w, k)
    yy, yz, zz = get3(w, k + 3 * LANES)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def get9(w, k):
    """Return the matrix (tuple of 9 by rows) of a lane whose elements are at w[k], w[k + LANES],
    ..."""
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
    """Store a matrix ``a`` (tuple of 9 by rows) of a lane at w[k], w[k + LANES], ..."""
    put3(w, k, (a[0], a[1], a[2]))
    put3(w, k + 3 * LANES, (a[3], a[4], a[5]))
    put3(w, k + 6 * LANES, (a[6], a[7], a[8]))


@formula
def put3(w, k, a):
    """Store a vector ``a`` (tuple of 3) of a lane at w[k], w[k + LANES], w[k + 2 LANES]."""
    w[k], w[k + LANES], w[k + 2 * LANES] = a


@formula
def put4(w, k, a):
    """Store four numbers ``a`` of a lane at w[k], w[k + LANES], w[k + 2 LANES], w[k + 3 LANES]."""
    w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES] = a


@formula
def put6(w, k, m):
    """Store the six numbers xx, xy, xz, yy, yz, zz of a symmetric matrix ``m`` (tuple of 9) of a
    lane at w[k], w[k + LANES], ..."""
    put3(w, k, (m[0], m[1], m[2]))
    put3(w, k + 3 * LANES, (m[4], m[5], m[8]))


@formula
def time_left(value, rate, acceleration, jerk):
    """Time until a quantity rises through zero: a root t of value + rate t + acceleration t^2 / 2 +
    jerk t^3 / 6.

    The root without jerk is found first; three Newton iterations then include the jerk.

    Parameters
    ----------
    value : float
        Negative before the crossing, positive after it (the time is then negative).
    rate, acceleration, jerk : float
        Its time derivatives.

    Returns
    -------
    float
        s, negative if the crossing is in the past; infinite if there is none without the jerk.
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
    """Return an angle, rad, plus the number of full turns, of either sign, that brings it within
    half a turn of the angle ``last``."""
    return angle + 2.0 * math.pi * np.floor((last - angle) / (2.0 * math.pi) + 0.5)


@formula
def larger(a, b):
    """Return the larger of two numbers; b if one of them is NaN."""
    return a if a >= b else b
