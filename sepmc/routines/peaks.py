"""Peak and integral of the size of a vector over a step, from its components at the nodes of the
step.

Components are smooth where their size has a corner, so a polynomial stands for each of them: sum of
c_j T_j(x), x from -1 to 1 over the step (Chebyshev; Trefethen, Approximation Theory and
Approximation Practice, 2013, ch. 3 and 19). What it leaves out shrinks with the step, as the error
of the motion does.
"""

import math

import numpy as np

from sepmc.jit import noinline, routine
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import PEAK_NODES

COUNT = PEAK_NODES
# at both ends and between, denser towards them
_X = -np.cos(np.arange(COUNT) * math.pi / (COUNT - 1))
THETA = 0.5 * (1.0 + _X)  # the same as shares of the step
_HALF = np.array([0.5, *(COUNT - 2) * [1.0], 0.5])
# By node: the coefficients of a polynomial from its values there; its mean over the step, its slope
# at the start and, the other way round, at the end (into the step both times), and its coefficient
# of T_4.
_COEFFICIENTS = (
    2.0 / (COUNT - 1) * np.outer(_HALF, _HALF) * np.cos(np.outer(np.arange(COUNT), np.arccos(_X)))
)
_MEAN = np.array([1.0 / (1.0 - j * j) if j % 2 == 0 else 0.0 for j in range(COUNT)]) @ _COEFFICIENTS
_SLOPE = 2.0 * (np.arange(COUNT) ** 2.0 * (-1.0) ** np.arange(1, COUNT + 1)) @ _COEFFICIENTS
_FOURTH, _LAST = np.ascontiguousarray(_COEFFICIENTS[4]), np.ascontiguousarray(_COEFFICIENTS[-1])
# Gauss-Lobatto rule of five nodes on 0 to 1 (Abramowitz and Stegun, 25.4.32).
_NODE = (0.0, 0.5 - 0.5 * math.sqrt(3.0 / 7.0), 0.5, 0.5 + 0.5 * math.sqrt(3.0 / 7.0), 1.0)
_WEIGHT = (0.05, 49.0 / 180.0, 16.0 / 45.0, 49.0 / 180.0, 0.05)
_DIP = 0.7  # least over greatest size at the nodes: below, it may turn sharply between them
# What halving an interval may change of an integral: of the peak so far, and, for round-off, of the
# greater of force and moment (N, N m).
_AGREE, _NOISE, _HALVINGS = 1e-12, 1e-13, 80
_NEAR = 0.9  # of the peak so far: below, what rises between two nodes does not reach it
# of the size at an end, over a step: what rises less gains less than a tenth of that, and may be
# round-off
_STEEP = 1e-10
_ROUNDS = 40
_SAME = 1.0 + 1e-13  # of two sizes: a load that does not change has its peak where it is first seen
_TOUCH = 1e-12  # of a threshold: a size this close has reached it
_BESIDE = 1e-4  # of a step: how far apart two sizes are whose difference is a rate
_CLOSE = 1e-9  # of a step: a peak's place, whose value is then good to round-off


@routine
def _at(x, w, scratch):
    """The vector at a place of the step."""
    a, a_before, b, b_before, c, c_before = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(COUNT - 1):  # Clenshaw's recurrence
        j = scratch + COUNT - 1 - k
        a, a_before = w[j] + 2.0 * x * a - a_before, a
        b, b_before = w[j + COUNT] + 2.0 * x * b - b_before, b
        c, c_before = w[j + 2 * COUNT] + 2.0 * x * c - c_before, c
    return (
        w[scratch] + x * a - a_before,
        w[scratch + COUNT] + x * b - b_before,
        w[scratch + 2 * COUNT] + x * c - c_before,
    )


@routine
def _size(theta, w, scratch):
    a, b, c = _at(2.0 * theta - 1.0, w, scratch)
    return math.sqrt(a * a + b * b + c * c)


@routine
def _height(theta, w, scratch, ends):
    """What is highest at a peak: the size of a vector; or, of a guide with pins, how little drives
    them apart for what they carry."""
    if ends == 0:
        return _size(theta, w, scratch)
    load = 0.0
    for end in range(1, ends + 1):
        load += _size(theta, w, scratch + 3 * COUNT * end)
    drive = _at(2.0 * theta - 1.0, w, scratch)[0]
    return -max(drive, 0.0) / load if load > 0.0 else -math.inf


@routine
def _highest(low, high, w, scratch, ends):
    """Where between two shares of the step `_height` is greatest: Brent's search, by parabolas
    within a golden section (1973, ch. 5)."""
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    best = low + golden * (high - low)
    second = third = best
    f_best = _height(best, w, scratch, ends)
    f_second = f_third = f_best
    move, last_move = 0.0, 0.0
    for _ in range(_ROUNDS):
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
        trial = best + (move if abs(move) >= _CLOSE else math.copysign(_CLOSE, move))
        f = _height(trial, w, scratch, ends)
        if f >= f_best:
            low, high = (best, high) if trial >= best else (low, best)
            second, third, best = best, second, trial
            f_second, f_third, f_best = f_best, f_second, f
        else:
            low, high = (trial, high) if trial < best else (low, trial)
            if f >= f_second or second == best:
                second, third, f_second, f_third = trial, second, f, f_second
            elif f >= f_third or third in (best, second):
                third, f_third = trial, f
    return best


@routine
def _mean(low, high, w, scratch):
    """Mean of the size between two shares of the step."""
    total = 0.0
    for i in range(5):
        total += _WEIGHT[i] * _size(low + _NODE[i] * (high - low), w, scratch)
    return total


@routine
def _halved(floor, w, scratch):
    """Mean of the size over the step: each interval is halved until its halves agree with it to
    ``floor``. A corner takes some twenty halvings; there are _HALVINGS at most."""
    noinline()
    total, low, width, left = 0.0, 0.0, 1.0, _HALVINGS
    before = _mean(0.0, 1.0, w, scratch)
    while low < 1.0:
        first = _mean(low, low + 0.5 * width, w, scratch)
        second = _mean(low + 0.5 * width, low + width, w, scratch)
        if (
            left > 0
            and width > 2.0**-24
            and not abs(0.5 * (first + second) - before) * width <= floor
        ):
            width, before, left = 0.5 * width, first, left - 1
            continue
        total += 0.5 * width * (first + second)
        low += width
        while width < 1.0 and low % (2.0 * width) == 0.0:
            width *= 2.0
        if low < 1.0:
            before = _mean(low, low + width, w, scratch)
    return total


@routine
def _put_sizes(nodes, apart, w, sizes):
    """Sizes of a vector at the nodes. Returns the greatest, and its node."""
    greatest, highest = 0.0, 0
    for i in range(COUNT):
        k = nodes + i * apart
        size = math.sqrt(
            w[k] * w[k] + w[k + LANES] * w[k + LANES] + w[k + 2 * LANES] * w[k + 2 * LANES]
        )
        w[sizes + i] = size
        greatest, highest = (size, i) if size > _SAME * greatest else (greatest, highest)
    return greatest, highest


@routine
def update_size(w, nodes, apart, scratch, out, other, guard, t, h):
    """Follow the size of a vector over a step of length h from t: its peak, the time of it and the
    integral, at ``out`` and two further.

    nodes : where the first component at the first node stands; the others are LANES further, those
        at the next node ``apart``
    scratch : where PEAK_SCRATCH numbers may be put
    other : where the peak of what has the same sort of round-off stands: of the force for a moment,
        and the other way round
    guard : where the largest of the last coefficients, times h, stands: how much of the integral
        polynomials may leave out
    """
    noinline()
    for part in range(3):
        last = 0.0
        for i in range(COUNT):
            last += _LAST[i] * w[nodes + i * apart + part * LANES]
        w[guard] = max(w[guard], abs(last * h))
    sizes = scratch + 3 * COUNT
    greatest, highest = _put_sizes(nodes, apart, w, sizes)
    least, fourth, mean = math.inf, 0.0, 0.0
    for i in range(COUNT):
        size = w[sizes + i]
        least = min(least, size)
        mean += _MEAN[i] * size
        fourth += _FOURTH[i] * size
    if not greatest <= _SAME * w[out]:
        w[out], w[out + LANES] = greatest, t + THETA[highest] * h
    floor = _AGREE * w[out] + _NOISE * max(w[out], w[other])
    is_rough = greatest > 1e3 * floor and (
        least < _DIP * greatest or fourth * fourth > floor * greatest
    )
    may_peak = greatest > _NEAR * w[out] and _has_summit(sizes, w)
    if is_rough or may_peak:
        _set_coefficients(nodes, apart, w, scratch)
    if may_peak:
        _note_summits(sizes, w, scratch, out, t, h)
    if is_rough:
        mean = _halved(floor, w, scratch)
    w[out + 2 * LANES] += h * mean


@routine
def update_peak(w, nodes, apart, scratch, out, t, h):
    """`update_size` without the integral."""
    noinline()
    sizes = scratch + 3 * COUNT
    greatest, highest = _put_sizes(nodes, apart, w, sizes)
    if not greatest <= _SAME * w[out]:
        w[out], w[out + LANES] = greatest, t + THETA[highest] * h
    if greatest > _NEAR * w[out] and _has_summit(sizes, w):
        _set_coefficients(nodes, apart, w, scratch)
        _note_summits(sizes, w, scratch, out, t, h)


@routine
def update_min_drive_ratio(w, nodes, apart, ends, scratch, out):
    """Follow the least of what drives a guide apart over the sum of what its pins would carry at
    their ``ends`` if friction balanced that, into ``out``.

    Of a node the vectors at ``nodes`` are: the drive and two zeros, then a force for each end.
    ``scratch`` has room for the coefficients of all these, and for a number at each node.
    """
    noinline()
    shares = scratch + 3 * COUNT * (1 + ends)
    for i in range(COUNT):
        k, load = nodes + i * apart, 0.0
        for end in range(1, ends + 1):
            y, z = w[k + (3 * end + 1) * LANES], w[k + (3 * end + 2) * LANES]
            load += math.sqrt(y * y + z * z)
        w[shares + i] = max(w[k], 0.0) / load if load > 0.0 else math.inf
        w[out] = min(w[out], w[shares + i])
    for end in range(ends + 1):
        _set_coefficients(nodes + 3 * end * LANES, apart, w, scratch + 3 * COUNT * end)
    for i in range(COUNT):
        low, high = max(i - 1, 0), min(i + 1, COUNT - 1)
        if (
            w[shares + i] <= min(w[shares + low], w[shares + high])
            and 0.0 < w[shares + i] < math.inf
        ):
            place = _highest(THETA[low], THETA[high], w, scratch, ends)
            w[out] = min(w[out], -_height(place, w, scratch, ends))


@routine
def _set_coefficients(nodes, apart, w, scratch):
    """Coefficients of the components from their values at the nodes."""
    noinline()
    for part in range(3):
        for j in range(COUNT):
            total = 0.0
            for i in range(COUNT):
                total += _COEFFICIENTS[j, i] * w[nodes + i * apart + part * LANES]
            w[scratch + part * COUNT + j] = total


@routine
def _rises(sizes, w, i):
    """Whether a peak lies beside node ``i``: it is higher than its neighbours, and from an end the
    size rises into the step."""
    if 0 < i < COUNT - 1:
        before, now, after = w[sizes + i - 1], w[sizes + i], w[sizes + i + 1]
        return now > before and now >= after and now > _SAME * min(before, after)
    first, way, slope = (sizes, 1, 0.0) if i == 0 else (sizes + COUNT - 1, -1, 0.0)
    if w[first] < w[first + way]:
        return False
    for n in range(COUNT):
        slope += _SLOPE[n] * w[first + way * n]
    return slope > _STEEP * w[first]


@routine
def _has_summit(sizes, w):
    """Whether there is a peak beside any node."""
    for i in range(COUNT):
        if _rises(sizes, w, i):
            return True
    return False


@routine
def _note_summits(sizes, w, scratch, out, t, h):
    """Peaks between nodes."""
    noinline()
    for i in range(COUNT):
        if _rises(sizes, w, i):
            place = _highest(THETA[max(i - 1, 0)], THETA[min(i + 1, COUNT - 1)], w, scratch, 0)
            size = _size(place, w, scratch)
            if size > _SAME * w[out]:
                w[out], w[out + LANES] = size, t + place * h


@routine
def first_reached(w, nodes, apart, scratch, threshold):
    """Where in a step, as a share of it, the size of a vector first reaches a threshold, and its
    rate there by the share; 2 if nowhere.

    The arguments are those of `update_size`. A size that is there at the start, but for round-off,
    is so at 0.
    """
    noinline()
    sizes, touch = scratch + 3 * COUNT, threshold - _TOUCH * max(1.0, abs(threshold))
    greatest, _ = _put_sizes(nodes, apart, w, sizes)
    if w[sizes] >= touch:
        return 0.0, _rate_at(sizes, w)
    if not greatest > _NEAR * threshold:
        return 2.0, 0.0
    _set_coefficients(nodes, apart, w, scratch)
    for i in range(COUNT - 1):
        low, high = THETA[i], THETA[i + 1]
        if w[sizes + i + 1] < threshold:
            if not (_rises(sizes, w, i) or _rises(sizes, w, i + 1)):
                continue
            high = _highest(low, high, w, scratch, 0)
            if _size(high, w, scratch) < threshold:
                continue
        start, best, best_size = low, high, _size(high, w, scratch)
        low_size = _size(low, w, scratch)
        for n in range(_ROUNDS):  # false position, halved every third time
            middle = (
                low + (high - low) * (threshold - low_size) / (best_size - low_size)
                if n % 3 != 2
                else 0.5 * (low + high)
            )
            size = _size(middle, w, scratch)
            if size >= threshold:
                high, best, best_size = middle, middle, size
            else:
                low, low_size = middle, size
            if high - low <= 1e-16 or best_size - threshold <= 1e-15 * threshold:
                break
        beside = max(start, best - _BESIDE)
        slope = (
            (_size(best, w, scratch) - _size(beside, w, scratch)) / (best - beside)
            if best > beside
            else 0.0
        )
        return best, slope
    return 2.0, 0.0


@routine
def first_crossed(w, nodes, apart, scratch, threshold, side, rising, falling):
    """Where in a step, as a share of it, the size of a vector first crosses a threshold in a
    direction that counts, and how fast there by the share; 2 if nowhere.

    nodes, apart, scratch : those of `update_size`
    side : 1 below the threshold before the step, -1 above, 0 if it stood at it or there was no step
        before: what jumps to the other side as the step begins has crossed it there
    rising, falling : whether a crossing from below counts, and one from above
    """
    noinline()
    sizes = scratch + 3 * COUNT
    _put_sizes(nodes, apart, w, sizes)
    _set_coefficients(nodes, apart, w, scratch)
    now = _side(w[sizes], threshold, 0.0)
    if side != now and (rising if side > 0.0 else falling and side < 0.0):
        return 0.0, abs(_rate_at(sizes, w))
    side = now
    for i in range(COUNT - 1):
        low, high = THETA[i], THETA[i + 1]
        counts = rising if side > 0.0 else falling
        # what comes to stand at the threshold has reached it, as a limit is reached there
        then = _side(w[sizes + i + 1], threshold, -side if counts else side)
        if side == 0.0 or (then != side and not counts):
            side = then
            continue
        if then == side:  # there and back between two nodes, if at all
            if not (_turns(sizes, w, i, side) or _turns(sizes, w, i + 1, side)):
                continue
            turn = (
                _highest(low, high, w, scratch, 0) if side > 0.0 else _lowest(low, high, w, scratch)
            )
            if side * (_size(turn, w, scratch) - threshold) < 0.0:
                continue
            low, high = (low, turn) if counts else (turn, high)
            side = side if counts else -side
        return _crossing(low, high, w, scratch, threshold, side)
    return 2.0, 0.0


@routine
def _crossing(low, high, w, scratch, threshold, side):
    """Where between two shares of the step the size crosses a threshold from a ``side``, and how
    fast, by halving."""
    start = low
    while high - low > 1e-16 + 2e-16 * high:
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        beyond = side * (_size(middle, w, scratch) - threshold) >= 0.0
        low, high = (low, middle) if beyond else (middle, high)
    beside = max(start, high - _BESIDE)
    rise = abs(_size(high, w, scratch) - _size(beside, w, scratch))
    return high, rise / (high - beside) if high > beside else 0.0


@routine
def side_at(w, nodes, apart, scratch, threshold, theta, side):
    """On which side of a threshold the size of a vector is at a share of the step; where it stands
    at it, that on which it was last, or ``side`` before the step."""
    noinline()
    _set_coefficients(nodes, apart, w, scratch)
    for i in range(COUNT):
        if THETA[i] < theta:
            side = _side(_size(THETA[i], w, scratch), threshold, side)
    return _side(_size(theta, w, scratch), threshold, side)


@routine
def _side(size, threshold, before):
    """Below a threshold 1, above -1, ``before`` where it stands at it."""
    touch = _TOUCH * max(1.0, threshold)
    return 1.0 if size < threshold - touch else -1.0 if size > threshold + touch else before


@routine
def _turns(sizes, w, i, side):
    """Whether a peak (from ``side`` 1) or a dip (-1) lies beside node ``i``."""
    if side > 0.0:
        return _rises(sizes, w, i)
    before, now, after = w[sizes + max(i - 1, 0)], w[sizes + i], w[sizes + min(i + 1, COUNT - 1)]
    return now <= before and now <= after


@routine
def _lowest(low, high, w, scratch):
    """Where between two shares of the step the size is least, by golden sections."""
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    for _ in range(_ROUNDS):
        one, other = low + golden * (high - low), high - golden * (high - low)
        rises = _size(one, w, scratch) < _size(other, w, scratch)
        low, high = (low, other) if rises else (one, high)
    return 0.5 * (low + high)


@routine
def _rate_at(sizes, w):
    """Rate of the size at the start of a step, by the share of it."""
    slope = 0.0
    for n in range(COUNT):
        slope += _SLOPE[n] * w[sizes + n]
    return slope
