"""Friction of guides whose pin loads depend on the friction itself: equilibrium of all guides."""

import math

from sepmc.jit import noinline, routine
from sepmc.routines.lanes import LANES

_CONVERGED = 1e-13  # relative change of a friction force in an iteration
_ROUNDS, _TURNS = 40, 100  # Newton iterations of a guide; turns of all guides


@routine
def balance(w, system, ends, out):
    """Solve for the friction forces of all guides of a lane, N, in equilibrium with the pin loads
    that they cause.

    Each guide is solved in turn with the friction of the others fixed, until nothing changes. Loads
    are convex in a friction force, so Newton's method from zero converges to the smallest solution.

    Parameters
    ----------
    w : array
        Workspace.
    system : int
        Position of the data of the lane, LANES apart. For each guide: its friction per newton of
        load, of either sign; then, for each end of its pins, the force (y, z) without friction, N,
        and the force (y, z) per newton of the friction of each guide.
    ends : tuple of int
        Number of pin ends of each guide: two for each pin.
    out : int
        Position of the solution, LANES apart: the friction force of each guide, N.

    Returns
    -------
    bool
        False if a guide jams, so that there is no solution, or the turns do not converge.
    """
    noinline()
    count = len(ends)
    for j in range(count):
        w[out + j * LANES] = 0.0
    for _ in range(_TURNS):
        converged, guide = True, system
        for j in range(count):
            previous = w[out + j * LANES]
            load = _solve_guide(w, guide, ends[j], j, count, out)
            if load < 0.0:
                return False
            converged = (
                converged
                and not abs(w[out + j * LANES] - previous) > _CONVERGED * abs(w[guide]) * load
            )
            guide += (1 + ends[j] * (2 + 2 * count)) * LANES
        if converged:
            return True
    return False


@routine
def _solve_guide(w, guide, ends, j, count, out):
    """Solve for the friction force of guide ``j`` of ``count``, whose data begin at w[guide], with
    the friction of the others, stored from w[out] on, fixed. The result is stored there, too.
    Returns the sum of the loads of its ``ends`` pin ends, N; -1 if it jams."""
    noinline()
    coefficient, friction = w[guide], out + j * LANES
    for _ in range(_ROUNDS):
        load, slope = 0.0, 0.0
        for end in range(ends):
            k = guide + (1 + end * (2 + 2 * count)) * LANES
            y, z = w[k], w[k + LANES]
            for i in range(count):
                y += w[out + i * LANES] * w[k + (2 + 2 * i) * LANES]
                z += w[out + i * LANES] * w[k + (3 + 2 * i) * LANES]
            size = math.sqrt(y * y + z * z)
            load += size
            if size > 0.0:
                slope += (y * w[k + (2 + 2 * j) * LANES] + z * w[k + (3 + 2 * j) * LANES]) / size
        if not 1.0 - coefficient * slope > 0.0:
            return -1.0
        change = (coefficient * load - w[friction]) / (1.0 - coefficient * slope)
        w[friction] += change
        if not abs(change) > _CONVERGED * abs(coefficient) * load:
            return load
    return -1.0
