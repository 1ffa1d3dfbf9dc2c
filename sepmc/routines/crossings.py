"""Instants of an integration step at which the magnitude of a vector reaches or crosses a
threshold, from its components at the nodes of the step.

`sepmc.routines.peaks` explains the common arguments, and the polynomials that represent the
components between the nodes. Checked in `tests/kernel/test_loads.py`.
"""

import math

from sepmc.jit import noinline, routine
from sepmc.routines.peaks import (
    COUNT,
    NEAR,
    ROUNDS,
    SLOPE,
    THETA,
    highest,
    put_sizes,
    rises,
    set_coefficients,
    size_at,
)

_TOUCH = 1e-12  # of a threshold: a magnitude this close has reached it
_NEARBY = 1e-4  # of a step: distance of two magnitudes whose difference gives a rate


@routine
def first_reached(w, nodes, stride, scratch, threshold):
    """Find where in a step the magnitude of a vector first reaches a threshold from below.

    Parameters
    ----------
    w, nodes, stride, scratch
        As in `peaks.put_sizes` and `peaks.size_at`.
    threshold : float
        In the unit of the vector.

    Returns
    -------
    theta : float
        Fraction of the step, 0 to 1, at which it is reached; 0 if it is reached already at the
        start, to round-off; 2 if it is not reached.
    rate : float
        Derivative of the magnitude by the fraction of the step there; 0 if not reached.
    """
    noinline()
    sizes, lower = scratch + 3 * COUNT, threshold - _TOUCH * max(1.0, abs(threshold))
    largest, _ = put_sizes(nodes, stride, w, sizes)
    if w[sizes] >= lower:
        return 0.0, _rate_at(sizes, w)
    if not largest > NEAR * threshold:
        return 2.0, 0.0
    set_coefficients(nodes, stride, w, scratch)
    for i in range(COUNT - 1):
        low, high = THETA[i], THETA[i + 1]
        if w[sizes + i + 1] < threshold:
            if not (rises(sizes, w, i) or rises(sizes, w, i + 1)):
                continue
            high = highest(low, high, w, scratch, 0)
            if size_at(high, w, scratch) < threshold:
                continue
        start, best, best_size = low, high, size_at(high, w, scratch)
        low_size = size_at(low, w, scratch)
        for n in range(ROUNDS):  # false position, halved every third time
            middle = (
                low + (high - low) * (threshold - low_size) / (best_size - low_size)
                if n % 3 != 2
                else 0.5 * (low + high)
            )
            size = size_at(middle, w, scratch)
            if size >= threshold:
                high, best, best_size = middle, middle, size
            else:
                low, low_size = middle, size
            if high - low <= 1e-16 or best_size - threshold <= 1e-15 * threshold:
                break
        nearby = max(start, best - _NEARBY)
        slope = (
            (size_at(best, w, scratch) - size_at(nearby, w, scratch)) / (best - nearby)
            if best > nearby
            else 0.0
        )
        return best, slope
    return 2.0, 0.0


@routine
def first_crossed(w, nodes, stride, scratch, threshold, side, rising, falling):
    """Find where in a step the magnitude of a vector first crosses a threshold in a direction that
    counts. To reach the threshold and stay at it is a crossing too.

    Parameters
    ----------
    w, nodes, stride, scratch
        As in `peaks.put_sizes` and `peaks.size_at`.
    threshold : float
        In the unit of the vector.
    side : float
        Side of the threshold just before the step: 1 below, -1 above, 0 at it or if there was no
        step before. A jump to the other side at the start of the step is a crossing.
    rising, falling : bool
        True if crossings from below, or from above, count.

    Returns
    -------
    theta : float
        Fraction of the step, 0 to 1, at which it is crossed; 2 if there is no such crossing.
    rate : float
        Size of the derivative of the magnitude by the fraction of the step there; 0 if not crossed.
    """
    noinline()
    sizes = scratch + 3 * COUNT
    put_sizes(nodes, stride, w, sizes)
    set_coefficients(nodes, stride, w, scratch)
    current = _side(w[sizes], threshold, 0.0)
    if side != current and (rising if side > 0.0 else falling and side < 0.0):
        return 0.0, abs(_rate_at(sizes, w))
    side = current
    for i in range(COUNT - 1):
        low, high = THETA[i], THETA[i + 1]
        matches = rising if side > 0.0 else falling
        # a magnitude that stays at the threshold has reached it
        next_side = _side(w[sizes + i + 1], threshold, -side if matches else side)
        if side == 0.0 or (next_side != side and not matches):
            side = next_side
            continue
        if next_side == side:  # at most there and back between two nodes
            if not (_turns(sizes, w, i, side) or _turns(sizes, w, i + 1, side)):
                continue
            extremum = (
                highest(low, high, w, scratch, 0) if side > 0.0 else _lowest(low, high, w, scratch)
            )
            if side * (size_at(extremum, w, scratch) - threshold) < 0.0:
                continue
            low, high = (low, extremum) if matches else (extremum, high)
            side = side if matches else -side
        return _crossing(low, high, w, scratch, threshold, side)
    return 2.0, 0.0


@routine
def _crossing(low, high, w, scratch, threshold, side):
    """Return the fraction of the step, between ``low`` and ``high``, at which the magnitude crosses
    a threshold from a ``side`` (1: from below, -1: from above), by bisection; and the size of its
    derivative by the fraction of the step there. The coefficients of the vector are at
    w[scratch]."""
    start = low
    while high - low > 1e-16 + 2e-16 * high:
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        beyond = side * (size_at(middle, w, scratch) - threshold) >= 0.0
        low, high = (low, middle) if beyond else (middle, high)
    nearby = max(start, high - _NEARBY)
    rise = abs(size_at(high, w, scratch) - size_at(nearby, w, scratch))
    return high, rise / (high - nearby) if high > nearby else 0.0


@routine
def side_at(w, nodes, stride, scratch, threshold, theta, side):
    """Return the side of a threshold on which the magnitude of a vector is at the fraction
    ``theta`` of a step: 1 below, -1 above. If it is at the threshold, the side where it was last
    is returned; ``side`` is that before the step. Other arguments as in `first_reached`."""
    noinline()
    set_coefficients(nodes, stride, w, scratch)
    for i in range(COUNT):
        if THETA[i] < theta:
            side = _side(size_at(THETA[i], w, scratch), threshold, side)
    return _side(size_at(theta, w, scratch), threshold, side)


@routine
def _side(size, threshold, last_side):
    """Return the side of a threshold on which a magnitude, ``size``, is: 1 below, -1 above;
    ``last_side`` if it is at the threshold, to round-off."""
    tolerance = _TOUCH * max(1.0, threshold)
    return (
        1.0 if size < threshold - tolerance else -1.0 if size > threshold + tolerance else last_side
    )


@routine
def _turns(sizes, w, i, side):
    """Return True if the magnitude has a peak (``side`` 1: it is below the threshold; see
    `peaks.rises`) or a minimum (-1: above) near node ``i``. A minimum shows by a value at the node
    that exceeds neither of its neighbours; the first and the last node have one. The values at the
    nodes are stored at w[sizes]."""
    if side > 0.0:
        return rises(sizes, w, i)
    previous, current, following = (
        w[sizes + max(i - 1, 0)],
        w[sizes + i],
        w[sizes + min(i + 1, COUNT - 1)],
    )
    return current <= previous and current <= following


@routine
def _lowest(low, high, w, scratch):
    """Return the fraction of the step, between ``low`` and ``high``, at which the magnitude of the
    vector with the coefficients at w[scratch] is smallest, by golden section."""
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    for _ in range(ROUNDS):
        one, other = low + golden * (high - low), high - golden * (high - low)
        rises = size_at(one, w, scratch) < size_at(other, w, scratch)
        low, high = (low, other) if rises else (one, high)
    return 0.5 * (low + high)


@routine
def _rate_at(sizes, w):
    """Return the derivative of a magnitude by the fraction of the step, at the start of the step,
    from the magnitudes at the nodes, stored at w[sizes] and following."""
    slope = 0.0
    for n in range(COUNT):
        slope += SLOPE[n] * w[sizes + n]
    return slope
