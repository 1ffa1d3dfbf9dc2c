"""Peak and integral of the magnitude of a vector (the force or moment of a joint) over an
integration step, from its components at the nodes: PEAK_NODES fixed fractions of the step, THETA.

Components are smooth where their magnitude has a corner, so each is represented by a polynomial:
sum of c_j T_j(x), x from -1 to 1 over the step (Chebyshev; Trefethen, Approximation Theory and
Approximation Practice, 2013, ch. 3 and 19). The truncation error decreases with the step, as the
error of the motion does.

Common arguments: ``w``, workspace; ``nodes``, position of the first component at the first node,
with the other components LANES apart and the next node ``stride`` apart; ``scratch``, position of
PEAK_SCRATCH scratch numbers (coefficients of the three components, then magnitudes at the nodes);
``sizes``, position of these magnitudes. A "fraction" is one of the step, from 0 to 1. Checked in
`tests/routines/test_peaks.py`.
"""

import math

import numpy as np

from sepmc.jit import formula, noinline, routine
from sepmc.physics import vec3
from sepmc.routines.lanes import LANES, get3, larger, largest3
from sepmc.routines.layout import GRAIN, PEAK_NODES, PEAK_PAIRS

COUNT = PEAK_NODES
# loops over them are unrolled, so that they may run over a tuple
_NODES, _HALF_NODES = tuple(range(COUNT)), tuple(range(COUNT // 2))
# nodes at both ends and between, denser towards the ends
_X = -np.cos(np.arange(COUNT) * math.pi / (COUNT - 1))
THETA = 0.5 * (1.0 + _X)  # the same as fractions of the step
_HALF = np.array([0.5, *(COUNT - 2) * [1.0], 0.5])
# Weights of the values at the nodes: for the coefficients of the polynomial; for its slope at the
# start and, in reverse order, at the end (into the step both times).
COEFFICIENTS = (
    2.0 / (COUNT - 1) * np.outer(_HALF, _HALF) * np.cos(np.outer(np.arange(COUNT), np.arccos(_X)))
)
SLOPE = 2.0 * (np.arange(COUNT) ** 2.0 * (-1.0) ** np.arange(1, COUNT + 1)) @ COEFFICIENTS
# Weights of the last coefficient and of slopes, for formulas that loops over lanes inline
_THETA, _LAST = tuple(THETA.tolist()), tuple(COEFFICIENTS[-1].tolist())
_START_SLOPE, _END_SLOPE = tuple(SLOPE.tolist()), tuple(SLOPE[::-1].tolist())
# Rule of Gauss and Kronrod for a mean over a step: 15 points from the middle outwards, of which
# every second one is a point of Gauss's rule (Kronrod 1965; Piessens et al., QUADPACK, 1983)
_RIGHT_POINTS = (
    0.0, 0.20778495500789847, 0.4058451513773972, 0.5860872354676911,
    0.7415311855993945, 0.8648644233597691, 0.9491079123427585, 0.9914553711208126,
)  # fmt: skip
_KRONROD = (
    0.20948214108472783, 0.2044329400752989, 0.19035057806478542, 0.1690047266392679,
    0.14065325971552592, 0.10479001032225018, 0.06309209262997855, 0.022935322010529224,
)  # fmt: skip
_GAUSS = (
    0.4179591836734694, 0.0, 0.3818300505051189, 0.0, 0.27970539148927664, 0.0,
    0.1294849661688697, 0.0,
)  # fmt: skip


def _on_both_sides(values, sign=1.0):
    """Return the numbers at all points of a symmetric rule, from left to right. ``values`` has
    those from the middle point to the right end; their mirror images get the factor ``sign``."""
    return np.array([*(sign * x for x in values[:0:-1]), *values])


POINTS = 0.5 + 0.5 * _on_both_sides(_RIGHT_POINTS, -1.0)  # fractions of the step
KRONROD, GAUSS = 0.5 * _on_both_sides(_KRONROD), 0.5 * _on_both_sides(_GAUSS)
# weights of the sum of the values at a point and at its mirror image, up to the middle point
_ONCE = np.array([*(PEAK_PAIRS - 1) * [1.0], 0.5])
KRONROD_PAIRS, GAUSS_PAIRS = _ONCE * KRONROD[:PEAK_PAIRS], _ONCE * GAUSS[:PEAK_PAIRS]
# Weights of the values at the nodes for the value at each point; and, up to the middle point, of
# sums and differences of the values at a node and at its mirror image.
BETWEEN = np.cos(np.outer(np.arccos(2.0 * POINTS - 1.0), np.arange(COUNT))) @ COEFFICIENTS
_LEFT, _RIGHT = BETWEEN[:PEAK_PAIRS, : COUNT // 2], BETWEEN[:PEAK_PAIRS, : COUNT // 2 - 1 : -1]
EVEN, ODD = 0.5 * (_LEFT + _RIGHT), 0.5 * (_LEFT - _RIGHT)
# Difference of the rules of Kronrod and Gauss, relative to the largest magnitude, above which a
# step is halved; and ratio of the smallest to the largest magnitude at the nodes, below which it is
# halved anyway: near a corner both rules may err alike. Otherwise Kronrod's rule was within 1e-12
# for 17,000 random vectors.
_ROUGH, _DIP = 1e-8, 0.6
# Tolerances of the integral: relative to the peak so far and, for round-off, to the larger of force
# and moment (N, N m).
_AGREE, _NOISE = 1e-12, 1e-13
NEAR = 0.9  # of the peak so far: a lower magnitude at the nodes cannot reach it between them
# Slope at an end, relative to the magnitude, per step: a lower one gains less than a tenth of it,
# and may be round-off.
_STEEP = 1e-10
ROUNDS = 40
SAME = 1.0 + 1e-13  # ratio of equal magnitudes: a constant load has its peak at its first time
_CLOSE = 1e-9  # of a step: tolerance of a peak's time; its value is then accurate to round-off


@routine
def _at(x, w, scratch):
    """Return the vector (tuple of 3) at ``x``, which goes from -1 to 1 over the step, by Clenshaw's
    recurrence. From w[``scratch``] on are the COUNT Chebyshev coefficients of the first component,
    then those of the second and of the third."""
    a, a_previous, b, b_previous, c, c_previous = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(COUNT - 1):
        j = scratch + COUNT - 1 - k
        a, a_previous = w[j] + 2.0 * x * a - a_previous, a
        b, b_previous = w[j + COUNT] + 2.0 * x * b - b_previous, b
        c, c_previous = w[j + 2 * COUNT] + 2.0 * x * c - c_previous, c
    return (
        w[scratch] + x * a - a_previous,
        w[scratch + COUNT] + x * b - b_previous,
        w[scratch + 2 * COUNT] + x * c - c_previous,
    )


@routine
def size_at(theta, w, scratch):
    """Return the magnitude, at the fraction ``theta`` of the step, of the vector whose coefficients
    are at w[scratch]."""
    return magnitude(_at(2.0 * theta - 1.0, w, scratch))


@routine
def _height(theta, w, scratch, ends):
    """Return the quantity that `highest` maximises, at the fraction ``theta`` of a step, from the
    coefficients at w[scratch].

    If ``ends`` is 0, it is the magnitude of the vector. Otherwise the coefficients are those of
    `update_min_drive_ratio`, and it is -max(F, 0) / P, with the separating force F of the guide and
    the sum P of the loads of its ``ends`` pin ends; minus infinity where P is 0.
    """
    if ends == 0:
        return size_at(theta, w, scratch)
    load = 0.0
    for end in range(1, ends + 1):
        load += size_at(theta, w, scratch + 3 * COUNT * end)
    push = _at(2.0 * theta - 1.0, w, scratch)[0]
    return -max(push, 0.0) / load if load > 0.0 else -math.inf


@routine
def highest(low, high, w, scratch, ends):
    """Return the fraction of the step, between ``low`` and ``high``, at which `_height` has its
    maximum; the other arguments are those of `_height`. Brent's method: parabolas with golden
    section as a fallback (1973, ch. 5)."""
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    best = low + golden * (high - low)
    second = third = best
    f_best = _height(best, w, scratch, ends)
    f_second = f_third = f_best
    move, last_move = 0.0, 0.0
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        if abs(best - middle) <= 2.0 * _CLOSE - 0.5 * (high - low):
            break
        p, q = 0.0, 0.0
        if abs(last_move) > _CLOSE:
            r = (best - second) * (f_third - f_best)
            q = (best - third) * (f_second - f_best)
            p = (best - third) * q - (best - second) * r
            q = 2.0 * (q - r)
            p, q = (-p, q) if q > 0.0 else (p, -q)
        if abs(p) < abs(0.5 * q * last_move) and q * (low - best) < p < q * (high - best):
            last_move, move = move, p / q
        else:
            last_move = (high if best < middle else low) - best
            move = golden * last_move
        guess = best + (move if abs(move) >= _CLOSE else math.copysign(_CLOSE, move))
        f = _height(guess, w, scratch, ends)
        if f >= f_best:
            low, high = (best, high) if guess >= best else (low, best)
            second, third, best = best, second, guess
            f_second, f_third, f_best = f_best, f_second, f
        else:
            low, high = (guess, high) if guess < best else (low, guess)
            if f >= f_second or second == best:
                second, third, f_second, f_third = guess, second, f, f_second
            elif f >= f_third or third in (best, second):
                third, f_third = guess, f
    return best


@routine
def put_sizes(nodes, stride, w, sizes):
    """Compute the magnitudes of a vector at the nodes and store them from w[sizes] on. Returns the
    largest magnitude, and the number, from 0, of the first node that has it, to round-off.
    ``nodes`` is the position of the first component at the first node (the other components LANES
    apart), ``stride`` the distance from one node to the next."""
    largest, node = 0.0, 0
    for i in range(COUNT):
        k = nodes + i * stride
        w[sizes + i] = magnitude(get3(w, k))
        largest, node = _higher(largest, node, w[sizes + i], i)
    return largest, node


@formula
def magnitude(a):
    """Magnitude of a vector (tuple of 3)."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@formula
def _combined(weights, nodes):
    """Return the weighted sum of the vectors at the nodes: ``weights`` is a tuple of COUNT numbers,
    ``nodes`` one of COUNT vectors (tuples of 3)."""
    x, y, z = 0.0, 0.0, 0.0
    for i in _NODES:
        x += weights[i] * nodes[i][0]
        y += weights[i] * nodes[i][1]
        z += weights[i] * nodes[i][2]
    return x, y, z


@formula
def sizes_between(point, nodes):
    """Return the sum of the magnitudes of the vector at a point (number 0 to 7) of the rule of
    Gauss and Kronrod and at its mirror image, interpolated from the vectors at the nodes (COUNT
    tuples of 3)."""
    even, odd = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in _HALF_NODES:
        one, other = nodes[i], nodes[COUNT - 1 - i]
        even = vec3.add(even, vec3.scale(EVEN[point, i], vec3.add(one, other)))
        odd = vec3.add(odd, vec3.scale(ODD[point, i], vec3.sub(one, other)))
    return magnitude(vec3.add(even, odd)) + magnitude(vec3.sub(even, odd))


@formula
def truncation(nodes):
    """Return the largest magnitude of the coefficients of the highest degree (one for each of the
    three components), a measure of the truncation error, from the vectors at the nodes (COUNT
    tuples of 3)."""
    return largest3(_combined(_LAST, nodes))


@formula
def smaller(a, b):
    """Return the smaller of two numbers; b if one of them is NaN."""
    return a if a < b else b


@formula
def _higher(largest, theta, size, node):
    """Include one more magnitude, ``size`` at ``node``, in the largest magnitude so far, which is
    at ``theta``. Returns the largest magnitude and where it is; the earlier one stays unless the
    new one is larger by more than round-off (`SAME`). Both places are given as fractions of the
    step, or both as numbers of nodes."""
    is_larger = size > SAME * largest
    return size if is_larger else largest, node if is_larger else theta


@formula
def _is_inner_summit(previous, current, following):
    """Return 1.0 if the magnitude at a node is higher than at the node before and not lower than at
    the node after, and exceeds the lower of the two by more than round-off (`SAME`); else 0.0."""
    rises = 1.0 if current > previous else 0.0
    rises = rises if current >= following else 0.0
    return rises if current > SAME * smaller(previous, following) else 0.0


@formula
def _is_end_summit(end, inner, slope):
    """Return 1.0 if the magnitude has a peak between an end of the step and the next node, else
    0.0: it rises from the end into the step, but is not higher at the next node. ``end`` is its
    value at the end, ``inner`` that at the node, ``slope`` its slope at the end, into the step (of
    the polynomial through all nodes)."""
    rises = 0.0 if end < inner else 1.0
    return rises if slope > _STEEP * end else 0.0


@formula
def is_uneven(fine, coarse, smallest, largest, dip):
    """Return 1.0 if the mean magnitude over an interval by Kronrod's rule, ``fine``, may be less
    accurate than round-off: by that of Gauss's rule, ``coarse``, or since the magnitude comes near
    a corner: the ratio of ``smallest`` to ``largest``, magnitudes in the interval, is below
    ``dip``; else 0.0."""
    uneven = 0.0 if abs(fine - coarse) <= _ROUGH * largest else 1.0
    return 1.0 if smallest < dip * largest else uneven


@formula
def update_by_nodes(nodes, fine, coarse, record, related, t, h):
    """Update the peak and the integral over time of a magnitude with a step, as far as the values
    at the nodes allow it. It has no branches, so that loops over lanes are vectorised.

    Parameters
    ----------
    nodes : tuple of COUNT tuples of 3 floats
        Vectors at the nodes.
    fine, coarse : float
        Mean magnitude over the step by the rules of Kronrod and Gauss.
    record : tuple of 3 floats
        Peak, its time, s, and integral over time, before the step.
    related : float
        Peak so far of the related quantity with the same kind of round-off: of the force for a
        moment, and vice versa.
    t, h : float
        Start and length of the step, s. A step of no length changes nothing.

    Returns
    -------
    record : tuple of 3 floats
        Peak, its time and integral after the step.
    tolerance : float
        Above 0 if the integral still lacks this step, since the magnitude may have a corner in it:
        `between_nodes.update` must add the step, with its mean magnitude to this tolerance, in the
        unit of the magnitude. Else 0.
    summits : float
        Number of peaks that may be between the nodes: `between_nodes.update` must search for them.
    """
    first, second = magnitude(nodes[0]), magnitude(nodes[1])
    before, last = first, second
    smallest, largest, theta = smaller(first, second), 0.0, 0.0
    start_slope, end_slope, summits = 0.0, 0.0, 0.0
    for i in _NODES:
        size = magnitude(nodes[i])
        largest, theta = _higher(largest, theta, size, _THETA[i])
        start_slope += _START_SLOPE[i] * size
        end_slope += _END_SLOPE[i] * size
        if i > 1:
            smallest = smaller(smallest, size)
            summits += _is_inner_summit(before, last, size)
            before, last = last, size
    summits += _is_end_summit(first, second, start_slope) + _is_end_summit(last, before, end_slope)
    peak, peak_time, integral = record
    active = 1.0 if h > GRAIN else 0.0
    is_higher = active if largest > SAME * peak else 0.0
    peak = largest if is_higher > 0.0 else peak
    peak_time = t + theta * h if is_higher > 0.0 else peak_time
    tolerance = _AGREE * peak + _NOISE * larger(peak, related)
    is_rough = active * is_uneven(fine, coarse, smallest, largest, _DIP)
    is_rough = is_rough if largest > 1e3 * tolerance else 0.0
    smooth = active if is_rough == 0.0 else 0.0
    summits = summits if largest > NEAR * peak else 0.0
    return (
        (peak, peak_time, integral + h * fine if smooth > 0.0 else integral),
        tolerance if is_rough > 0.0 else 0.0,
        summits if active > 0.0 else 0.0,
    )


@routine
def update_peak(w, nodes, stride, scratch, out, t, h):
    """Update the peak of the magnitude of a vector, and its time, with a step, in one lane: at the
    nodes and between them, but without the integral. ``out`` is the position of both, LANES apart;
    t and h are start and length of the step, s; the others are common arguments."""
    noinline()
    sizes = scratch + 3 * COUNT
    largest, node = put_sizes(nodes, stride, w, sizes)
    if not largest <= SAME * w[out]:
        w[out], w[out + LANES] = largest, t + THETA[node] * h
    if largest > NEAR * w[out] and _any_rises(sizes, w):
        set_coefficients(nodes, stride, w, scratch)
        _note_summits(sizes, w, scratch, out, t, h)


@routine
def update_min_drive_ratio(w, nodes, stride, ends, scratch, out):
    """Update with a step, in one lane, the minimum of a ratio of a guide: the force that drives it
    apart, over the sum of the loads that its pins have if friction balances that force. The ratio
    is 0 where the force is not positive (it does not separate), and infinite where no pin has a
    load.

    Parameters
    ----------
    w : array
        Workspace.
    nodes, stride : int
        As in `put_sizes`. A node has 1 + ``ends`` vectors: the separating force and two zeros, then
        (0, y, z), the load of each pin end.
    ends : int
        Number of pin ends: two for each pin.
    scratch : int
        Position of scratch numbers: the coefficients of all vectors, and a number for each node.
    out : int
        Position of the minimum so far, which is updated.
    """
    noinline()
    ratios = scratch + 3 * COUNT * (1 + ends)
    for i in range(COUNT):
        k, load = nodes + i * stride, 0.0
        for end in range(1, ends + 1):
            y, z = w[k + (3 * end + 1) * LANES], w[k + (3 * end + 2) * LANES]
            load += math.sqrt(y * y + z * z)
        w[ratios + i] = max(w[k], 0.0) / load if load > 0.0 else math.inf
        w[out] = min(w[out], w[ratios + i])
    for end in range(ends + 1):
        set_coefficients(nodes + 3 * end * LANES, stride, w, scratch + 3 * COUNT * end)
    for i in range(COUNT):
        low, high = max(i - 1, 0), min(i + 1, COUNT - 1)
        if (
            w[ratios + i] <= min(w[ratios + low], w[ratios + high])
            and 0.0 < w[ratios + i] < math.inf
        ):
            theta = highest(THETA[low], THETA[high], w, scratch, ends)
            w[out] = min(w[out], -_height(theta, w, scratch, ends))


@routine
def set_coefficients(nodes, stride, w, scratch):
    """Compute the Chebyshev coefficients of the three components of a vector from their values at
    the nodes, and store them from w[scratch] on, component by component. ``nodes`` is the position
    of the first component at the first node (the other components LANES apart), ``stride`` the
    distance from one node to the next."""
    noinline()
    for component in range(3):
        for j in range(COUNT):
            total = 0.0
            for i in range(COUNT):
                total += COEFFICIENTS[j, i] * w[nodes + i * stride + component * LANES]
            w[scratch + component * COUNT + j] = total


@routine
def rises(sizes, w, i):
    """Return True if the magnitude has a peak next to node ``i``, from its values at the nodes at
    w[sizes]: at an inner node it is higher than at the node before and not lower than at the node
    after; at the first and the last node (the ends of the step) the slope of the polynomial through
    all nodes rises into the step, but the next node is not higher."""
    if 0 < i < COUNT - 1:
        return _is_inner_summit(w[sizes + i - 1], w[sizes + i], w[sizes + i + 1]) > 0.0
    first, step, slope = (sizes, 1, 0.0) if i == 0 else (sizes + COUNT - 1, -1, 0.0)
    for n in range(COUNT):
        slope += SLOPE[n] * w[first + step * n]
    return _is_end_summit(w[first], w[first + step], slope) > 0.0


@routine
def _any_rises(sizes, w):
    """Return True if the magnitude has a peak next to any node (`rises`); its values at the nodes
    are at w[sizes]."""
    for i in range(COUNT):
        if rises(sizes, w, i):
            return True
    return False


@routine
def _note_summits(sizes, w, scratch, out, t, h):
    """Search the peaks of the magnitude between the nodes of a step, from t to t + h, s.

    A peak that is larger by more than round-off replaces the peak so far and its time, at w[out]
    and w[out + LANES]. Magnitudes at the nodes are at w[sizes], the coefficients at w[scratch].
    """
    noinline()
    for i in range(COUNT):
        if rises(sizes, w, i):
            theta = highest(THETA[max(i - 1, 0)], THETA[min(i + 1, COUNT - 1)], w, scratch, 0)
            size = size_at(theta, w, scratch)
            if size > SAME * w[out]:
                w[out], w[out + LANES] = size, t + theta * h
