"""Friction of guides whose pins carry more for it: the balance of all of them."""

import math

from sepmc.jit import noinline, routine
from sepmc.routines.lanes import LANES

_SETTLED = 1e-13  # of a friction force: what another round may change
_ROUNDS, _TURNS = 40, 100  # of Newton's method for a guide; of all guides in turn


@routine
def balance(w, place, ends, out):
    """Friction of guides, N, that is in balance with the loads of pins it changes itself, into
    ``out``. Returns whether there is any: if not, a guide jams.

    place : where lanes hold, of guide after guide, its friction per newton of load, and of each of
        its ``ends`` of pins the force there without friction and what each guide's friction, 1 N of
        it, adds: pairs (y, z)
    Loads are convex in a friction force, so that Newton's method from none on comes to the smallest
    balance; guides take turns.
    """
    noinline()
    count = len(ends)
    for j in range(count):
        w[out + j * LANES] = 0.0
    for _ in range(_TURNS):
        settled, start = True, place
        for j in range(count):
            before = w[out + j * LANES]
            load = _settle_one(w, start, ends[j], j, count, out)
            if load < 0.0:
                return False
            settled = (
                settled and not abs(w[out + j * LANES] - before) > _SETTLED * abs(w[start]) * load
            )
            start += (1 + ends[j] * (2 + 2 * count)) * LANES
        if settled:
            return True
    return False


@routine
def _settle_one(w, start, ends, j, count, out):
    """Friction of guide ``j`` while that of the others stays. Returns the load of its pins, N; -1
    if it jams."""
    noinline()
    share, now = w[start], out + j * LANES
    for _ in range(_ROUNDS):
        load, slope = 0.0, 0.0
        for end in range(ends):
            k = start + (1 + end * (2 + 2 * count)) * LANES
            y, z = w[k], w[k + LANES]
            for i in range(count):
                y += w[out + i * LANES] * w[k + (2 + 2 * i) * LANES]
                z += w[out + i * LANES] * w[k + (3 + 2 * i) * LANES]
            size = math.sqrt(y * y + z * z)
            load += size
            if size > 0.0:
                slope += (y * w[k + (2 + 2 * j) * LANES] + z * w[k + (3 + 2 * j) * LANES]) / size
        if not 1.0 - share * slope > 0.0:
            return -1.0
        change = (share * load - w[now]) / (1.0 - share * slope)
        w[now] += change
        if not abs(change) > _SETTLED * abs(share) * load:
            return load
    return -1.0
