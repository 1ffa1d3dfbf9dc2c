"""Separations over time, between the ends of steps: polynomials through distance, speed and
acceleration."""

import math

from sepmc.jit import routine
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import AT_POINT, GRAIN


@routine
def fit(w, points, joints, count, matrix, length, curves, stride):
    """The polynomials of a step, by powers of its share gone by, of values, rates and accelerations
    at its beginning, at points within and at its end; ``matrix`` is the method's
    (`sepmc.kernel.spec.methods.Method.curve`), ``stride`` how many numbers a curve has."""
    size = AT_POINT * joints
    end = points + (count - 1) * size * LANES
    for j in range(joints):
        at, to = AT_POINT * j * LANES, curves + stride * j * LANES
        for k in range(2, stride):
            for l in range(LANES):
                w[to + k * LANES + l] = 0.0
        for l in range(LANES):
            h = w[length + l]
            w[to + l] = w[points + at + l]
            w[to + LANES + l] = h * w[points + at + LANES + l]
        for k in range(count + 2):
            place = to + (k + 2) * LANES
            for i in range(count):
                acceleration = points + i * size * LANES + at + 2 * LANES
                for l in range(LANES):
                    w[place + l] += matrix[k, i] * w[acceleration + l]
            for l in range(LANES):
                h = w[length + l] if w[length + l] != 0.0 else 1.0
                value, rate = w[points + at + l], w[points + at + LANES + l]
                faster = (w[end + at + LANES + l] - rate) / h
                further = (w[end + at + l] - value - h * rate) / (h * h)
                total = w[place + l] + matrix[k, count] * faster + matrix[k, count + 1] * further
                w[place + l] = h * h / ((k + 1.0) * (k + 2.0)) * total


@routine
def write(w, curves, joints, stride, begin, end, length, every, history, first):
    """Speed and distance of every joint at the instants of the step just made, up to the time
    ``end``, every so many seconds, into rows of a history (cases, rows, 2 joints)."""
    low, high = math.inf, -math.inf
    for l in range(LANES):
        low, high = min(low, w[begin + l]), max(high, w[end + l])
    if not (-math.inf < low <= high < math.inf):
        return
    last = min(math.floor(high / every + 1e-9), history.shape[1] - 1)
    # a flight that goes astray may have times before it began
    for row in range(max(0, math.ceil(low / every - 1e-9)), last + 1):
        t = row * every
        for l in range(min(LANES, history.shape[0] - first)):
            h, start = w[length + l], w[begin + l]
            if h > GRAIN and start - GRAIN <= t <= w[end + l] + GRAIN:
                share = (t - start) / h
                for j in range(joints):
                    top = curves + (stride * j + stride - 1) * LANES + l
                    value, rate = w[top], 0.0
                    for k in range(1, stride):
                        rate = value + share * rate
                        value = w[top - k * LANES] + share * value
                    history[first + l, row, 2 * j] = rate / h
                    history[first + l, row, 2 * j + 1] = value
