"""Lanes: cases side by side in one flat workspace, so that a loop over them is vectorised.

A quantity stands in a slab of LANES numbers, one for each case. All slabs of a block of cases are
parts of one array, at places that are constants when the kernel is compiled: only then does the
compiler see that lanes do not touch each other (5 times the speed).
"""

import math

import numpy as np

from sepmc.jit import config, formula
from sepmc.routines import layout

# without the compiler there is nothing to vectorise
LANES = 1 if config.DISABLE_JIT else layout.LANES


@formula
def get3(w, k):
    """Vector whose first component stands at w[k]."""
    return (w[k], w[k + LANES], w[k + 2 * LANES])


@formula
def get4(w, k):
    """Four numbers, the first at w[k]: a quaternion, the base of a layer of air."""
    return (w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES])


@formula
def get6(w, k):
    """Symmetric matrix (9-tuple) from its six numbers xx, xy, xz, yy, yz, zz, the first at w[k]."""
    xx, xy, xz = get3(w, k)
    yy, yz, zz = get3(w, k + 3 * LANES)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def get9(w, k):
    """Nine numbers, the first at w[k]."""
    a, b, c = get3(w, k), get3(w, k + 3 * LANES), get3(w, k + 6 * LANES)
    return (a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])


@formula
def largest3(a):
    """The largest size of three numbers."""
    return max(abs(a[0]), abs(a[1]), abs(a[2]))


@formula
def largest4(a):
    """The largest size of four numbers."""
    return max(largest3((a[0], a[1], a[2])), abs(a[3]))


@formula
def put9(w, k, a):
    """Store nine numbers."""
    put3(w, k, (a[0], a[1], a[2]))
    put3(w, k + 3 * LANES, (a[3], a[4], a[5]))
    put3(w, k + 6 * LANES, (a[6], a[7], a[8]))


@formula
def put3(w, k, a):
    """Store a vector."""
    w[k], w[k + LANES], w[k + 2 * LANES] = a


@formula
def put4(w, k, a):
    """Store four numbers."""
    w[k], w[k + LANES], w[k + 2 * LANES], w[k + 3 * LANES] = a


@formula
def put6(w, k, m):
    """Store the six numbers of a symmetric matrix."""
    put3(w, k, (m[0], m[1], m[2]))
    put3(w, k + 3 * LANES, (m[4], m[5], m[8]))


@formula
def time_left(value, rate, acceleration, jerk):
    """Time until a quantity that moves with this acceleration and jerk rises through zero, s;
    infinite if it does not.

    ``value`` : below zero before, above zero after, so that the time is negative if the crossing
    lies behind. The root without jerk, then three of Newton's steps towards the one with it.
    """
    square = rate * rate - 2.0 * value * acceleration
    below = rate + math.sqrt(square if square > 0.0 else 0.0)
    ahead = square >= 0.0 and below > 0.0
    wait = -2.0 * value / (below if ahead else 1.0)
    for _ in range(3):
        slope = rate + wait * (acceleration + 0.5 * wait * jerk)
        excess = value + wait * (rate + wait * (0.5 * acceleration + wait * jerk / 6.0))
        wait = wait - excess / slope if slope > 0.0 else wait
    return wait if ahead else math.inf


@formula
def nearest_turn(angle, last):
    """``angle`` with full turns added so that it lies within half a turn of ``last``, rad."""
    return angle + 2.0 * math.pi * np.floor((last - angle) / (2.0 * math.pi) + 0.5)


@formula
def larger(a, b):
    """The larger of two numbers; NaN if the second is NaN."""
    return a if a >= b else b
