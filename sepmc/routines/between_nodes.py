"""Peak and integral of the magnitude of a vector between the nodes of a step, in all lanes at once:
where the values at the nodes do not give them (`peaks.update_by_nodes`).

Common arguments: ``w``, workspace; ``c``, position of the coefficients of the vector in a lane:
COUNT vectors, of the Chebyshev polynomials T_j(x), x from -1 to 1 over the step; components are
LANES apart. Other positions are those of fields, in the first lane. Checked in
`tests/routines/test_peaks.py`.
"""

import math

import numpy as np

from sepmc.jit import formula, noinline, routine
from sepmc.physics import vec3
from sepmc.routines.lanes import LANES, get3, larger, put3
from sepmc.routines.layout import PEAK_POINTS
from sepmc.routines.peaks import (
    COEFFICIENTS,
    COUNT,
    GAUSS,
    KRONROD,
    POINTS,
    ROUNDS,
    SAME,
    THETA,
    is_uneven,
    magnitude,
    put_sizes,
    rises,
    smaller,
)

# loops over them are unrolled, so that loops over lanes around them are vectorised
_NODES, _DOWNWARD = tuple(range(COUNT)), tuple(range(COUNT - 2, 0, -1))
_NOTHING = (0.0, 0.0, 0.0)
# Limits of the integral: halvings in a step (about 40 for each of up to seven corners), and the
# shortest interval as a fraction of the step
_HALVINGS, _SHORTEST = 400.0, 2.0**-24
# As in `peaks`; in intervals that double away from a corner the magnitude doubles.
_DIP = 0.45
_CLOSE = 1e-9  # of half a step: the last move in the search of a peak; then it is at round-off


@formula
def _recurred(a, x, b, previous):
    """One step of Clenshaw's recurrence, in vectors: a + 2 x b - previous."""
    return vec3.sub(vec3.add(a, vec3.scale(2.0 * x, b)), previous)


@formula
def _size_at(x, w, c):
    """Return the magnitude, at ``x`` from -1 to 1 over the step, of the vector whose Chebyshev
    coefficients are at w[c], by Clenshaw's recurrence."""
    b, previous = get3(w, c + 3 * (COUNT - 1) * LANES), _NOTHING
    for j in _DOWNWARD:
        b, previous = _recurred(get3(w, c + 3 * j * LANES), x, b, previous), b
    return magnitude(_recurred(get3(w, c), 0.5 * x, b, previous))


@formula
def _slope_at(x, w, c):
    """Return the first and the second derivative, by x, of half the square of the magnitude at
    ``x`` (`_size_at`), by Clenshaw's recurrence and its derivatives."""
    b, previous = get3(w, c + 3 * (COUNT - 1) * LANES), _NOTHING
    slope, last_slope, bend, last_bend = _NOTHING, _NOTHING, _NOTHING, _NOTHING
    for j in _DOWNWARD:
        bend, last_bend = _recurred(vec3.scale(4.0, slope), x, bend, last_bend), bend
        slope, last_slope = _recurred(vec3.scale(2.0, b), x, slope, last_slope), slope
        b, previous = _recurred(get3(w, c + 3 * j * LANES), x, b, previous), b
    bend = _recurred(vec3.scale(2.0, slope), 0.5 * x, bend, last_bend)
    slope = _recurred(b, 0.5 * x, slope, last_slope)
    value = _recurred(get3(w, c), 0.5 * x, b, previous)
    return vec3.dot(value, slope), vec3.dot(slope, slope) + vec3.dot(value, bend)


@routine
def update(w, nodes, record, rough, summit, begin, length, work):
    """Complete the update of the peak and the integral of the magnitude of a vector with a step, in
    all lanes, by what `peaks.update_by_nodes` found to be missing between the nodes.

    Parameters
    ----------
    w : array
        Workspace.
    nodes : int
        Position of the vectors at the nodes.
    record : int
        Position of three numbers that are updated: the peak, its time, s, and the integral over
        time.
    rough, summit : int
        Positions of the results ``tolerance`` and ``summits`` of `peaks.update_by_nodes`; the
        latter are counted down.
    begin, length : int
        Positions of start and length of the step, s.
    work : int
        Position of PEAK_SCRATCH scratch numbers of each lane.
    """
    noinline()
    c, work = work, work + 3 * COUNT * LANES
    for j in range(COUNT):
        for l in range(LANES):
            vector = _NOTHING
            for i in _NODES:
                at_node = get3(w, nodes + 3 * i * LANES + l)
                vector = vec3.add(vector, vec3.scale(COEFFICIENTS[j, i], at_node))
            put3(w, c + 3 * j * LANES + l, vector)
    any_rough, any_summit = False, False
    for l in range(LANES):
        any_rough = any_rough or w[rough + l] > 0.0
        any_summit = any_summit or w[summit + l] > 0.0
    if any_rough:
        _integrate(w, c, record + 2 * LANES, rough, length, work)
    if any_summit:
        _note_summits(w, c, nodes, record, summit, begin, length, work)


@routine
def _integrate(w, c, integral, rough, length, work):
    """Add the mean magnitude over the step times its length to the number at ``integral``, in lanes
    whose tolerance of that mean, at ``rough``, is above 0.

    The rule of Gauss and Kronrod is applied to an interval that is halved until the magnitude in it
    is even (`peaks.is_uneven`) or too small to matter; then to the next interval, which is twice as
    long where it may be. ``c`` is the position of the coefficients of the vector, ``work`` that of
    7 scratch numbers of each lane; other arguments as in `update`.
    """
    low, width, halvings, fine, coarse, smallest, largest = (
        work,
        work + LANES,
        work + 2 * LANES,
        work + 3 * LANES,
        work + 4 * LANES,
        work + 5 * LANES,
        work + 6 * LANES,
    )
    for l in range(LANES):
        w[low + l] = 0.0 if w[rough + l] > 0.0 else 1.0
        w[width + l], w[halvings + l] = 0.5, 0.0
    going = True
    while going:
        for l in range(LANES):
            w[fine + l], w[coarse + l] = 0.0, 0.0
            w[smallest + l], w[largest + l] = math.inf, 0.0
        for j in range(PEAK_POINTS):
            for l in range(LANES):
                theta = w[low + l] + POINTS[j] * w[width + l]
                size = _size_at(2.0 * theta - 1.0, w, c + l)
                w[fine + l] += KRONROD[j] * size
                w[coarse + l] += GAUSS[j] * size
                w[smallest + l] = smaller(size, w[smallest + l])
                w[largest + l] = larger(size, w[largest + l])
        for l in range(LANES):
            start, span = w[low + l], w[width + l]
            halve = is_uneven(w[fine + l], w[coarse + l], w[smallest + l], w[largest + l], _DIP)
            halve = halve if w[largest + l] * span > w[rough + l] else 0.0
            halve = halve if span > _SHORTEST else 0.0
            halve = halve if w[halvings + l] < _HALVINGS else 0.0
            w[halvings + l] += halve
            moves = 1.0 - halve if start < 1.0 else 0.0
            w[integral + l] += span * w[fine + l] * w[length + l] if moves > 0.0 else 0.0
            end = start + span * moves
            doubled = end / (2.0 * span)
            grows = moves if doubled == np.floor(doubled) else 0.0
            w[low + l] = end
            w[width + l] = 0.5 * span if halve > 0.0 else 2.0 * span if grows > 0.0 else span
        going = False
        for l in range(LANES):
            going = going or w[low + l] < 1.0


@routine
def _note_summits(w, c, nodes, record, summit, begin, length, work):
    """Search the peaks between the nodes; the field ``summit`` has their number. A peak that is
    larger by more than round-off replaces the peak so far and its time. ``c`` is the position of
    the coefficients of the vector, ``work`` that of scratch numbers after them; other arguments as
    in `update`."""
    node, low, high, x, move, sizes = (
        work,
        work + LANES,
        work + 2 * LANES,
        work + 3 * LANES,
        work + 4 * LANES,
        work + 5 * LANES,
    )
    for l in range(LANES):
        w[node + l] = -1.0 if w[summit + l] > 0.0 else COUNT
        w[low + l], w[high + l], w[x + l] = 0.0, 0.0, 0.0
    going = True
    while going:
        for l in range(LANES):  # lanes go on to their next peaks
            if w[summit + l] > 0.0:
                i = _next_summit(w[node + l], w, nodes + l, sizes)
                w[node + l] = i
                if i < COUNT:
                    w[x + l] = 2.0 * THETA[i] - 1.0
                    w[low + l] = 2.0 * THETA[max(i - 1, 0)] - 1.0
                    w[high + l] = 2.0 * THETA[min(i + 1, COUNT - 1)] - 1.0
        for _ in range(ROUNDS):
            _approach(w, c, low, high, x, move)
            moves = False
            for l in range(LANES):
                moves = moves or (w[node + l] < COUNT and w[move + l] > _CLOSE)
            if not moves:
                break
        for l in range(LANES):
            size = _size_at(w[x + l], w, c + l)
            higher = size if w[node + l] < COUNT else 0.0
            time = w[begin + l] + 0.5 * (1.0 + w[x + l]) * w[length + l]
            is_higher = higher > SAME * w[record + l]
            w[record + l] = higher if is_higher else w[record + l]
            w[record + LANES + l] = time if is_higher else w[record + LANES + l]
            w[summit + l] -= 1.0
        going = False
        for l in range(LANES):
            going = going or (w[summit + l] > 0.0 and w[node + l] < COUNT)


@routine
def _next_summit(after, w, nodes, sizes):
    """Return the number of the next node, after the number ``after``, with a peak of the magnitude
    next to it (`peaks.rises`); COUNT if there is none. ``nodes`` is the position of the vectors of
    one lane, ``sizes`` that of COUNT scratch numbers."""
    put_sizes(nodes, 3 * LANES, w, sizes)
    for i in range(COUNT):
        if i > after and rises(sizes, w, i):
            return i
    return COUNT


@routine
def _approach(w, c, low, high, x, move):
    """Make one step of Newton's method from x towards the peak between ``low`` and ``high``, in all
    lanes, or halve that interval if the step would leave it; store its size in ``move``. One of
    ``low`` and ``high`` becomes the old x. The arguments are positions in ``w``, ``c`` that of the
    coefficients; x, ``low`` and ``high`` go from -1 to 1 over the integration step."""
    for l in range(LANES):
        guess = w[x + l]
        slope, bend = _slope_at(guess, w, c + l)
        start = guess if slope > 0.0 else w[low + l]
        end = w[high + l] if slope > 0.0 else guess
        better = guess - slope / bend if bend < 0.0 else math.inf
        better = better if start <= better <= end else 0.5 * (start + end)
        w[low + l], w[high + l], w[x + l] = start, end, better
        w[move + l] = abs(better - guess)
