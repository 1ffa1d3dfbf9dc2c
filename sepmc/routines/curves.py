"""Rows of separation histories: within a step, the separation distance of each joint is represented
by a polynomial, fitted to distance, speed and acceleration at points of the step."""

import math

from sepmc.jit import routine
from sepmc.routines.lanes import LANES, larger
from sepmc.routines.layout import AT_POINT, GRAIN


@routine
def fit(w, points, joints, count, matrix, length, curves, stride):
    """Fit a polynomial in the fraction of the step to the separation distance of each joint, for
    all lanes; its ``count + 4`` coefficients are written into the workspace. It has the distance
    and speed of both ends, and the acceleration of every point.

    Parameters
    ----------
    w : array
        Workspace.
    points : int
        Position in w of the distance, speed and acceleration of each joint at ``count`` points of
        the step; the first and last point are its ends.
    joints, count : int
        Number of joints (each has a polynomial); number of points.
    matrix : array, shape (count + 2, count + 2)
        Fit matrix of the integration method (`sepmc.kernel.spec.methods.Method.curve`).
    length : int
        Position of the step lengths, s.
    curves : int
        Position of the coefficients, from the constant one up.
    stride : int
        Number of coefficients stored for a polynomial; those beyond ``count + 4`` are set to 0.
    """
    size = AT_POINT * joints
    end = points + (count - 1) * size * LANES
    for j in range(joints):
        at, to = AT_POINT * j * LANES, curves + stride * j * LANES
        for k in range(count + 4, stride):
            for l in range(LANES):
                w[to + k * LANES + l] = 0.0
        for l in range(LANES):
            h = w[length + l]
            w[to + l] = w[points + at + l]
            w[to + LANES + l] = h * w[points + at + LANES + l]
        for k in range(count + 2):
            row = to + (k + 2) * LANES
            for l in range(LANES):
                total = 0.0
                for i in range(count):
                    total += matrix[k, i] * w[points + (i * size + 2) * LANES + at + l]
                h = w[length + l] if w[length + l] != 0.0 else 1.0
                value, rate = w[points + at + l], w[points + at + LANES + l]
                rate_change = (w[end + at + LANES + l] - rate) / h
                value_change = (w[end + at + l] - value - h * rate) / (h * h)
                total = total + matrix[k, count] * rate_change + matrix[k, count + 1] * value_change
                w[row + l] = h * h / ((k + 1.0) * (k + 2.0)) * total


@routine
def write(w, curves, joints, stride, begin, end, length, values, interval, history, first):
    """Write the separation speed and distance of every joint into those rows of a history whose
    times lie in the step that was just made, its ends included, for all lanes.

    Parameters
    ----------
    w : array
        Workspace.
    curves, joints, stride : int
        As in `fit`.
    begin, end, length : int
        Positions of start time, end time and length of the step of each lane, s.
    values : int
        Position of two scratch numbers per lane.
    interval : float
        Time between rows, s; row k has the time k * interval.
    history : array, shape (cases, rows, 2 joints)
        Output: of joint j, the speed (m/s) in column 2 j and the distance (m) in column 2 j + 1.
    first : int
        Index in ``history`` of the case in lane 0.
    """
    low, high = math.inf, -math.inf
    for l in range(LANES):
        low, high = min(low, w[begin + l]), max(high, w[end + l])
    if not (-math.inf < low <= high < math.inf):
        return
    last = min(math.floor(high / interval + 1e-9), history.shape[1] - 1)
    # a diverging case may have negative times
    for row in range(max(0, math.ceil(low / interval - 1e-9)), last + 1):
        t = row * interval
        for j in range(joints):
            top = curves + (stride * j + stride - 1) * LANES
            for l in range(LANES):  # also lanes without this row: so it is vectorised
                h = larger(w[length + l], GRAIN)
                fraction = (t - w[begin + l]) / h
                value, rate = w[top + l], 0.0
                for k in range(1, stride):
                    rate = value + fraction * rate
                    value = w[top - k * LANES + l] + fraction * value
                w[values + l], w[values + LANES + l] = rate / h, value
            for l in range(min(LANES, history.shape[0] - first)):
                lasts = w[length + l] > GRAIN
                if lasts and w[begin + l] - GRAIN <= t <= w[end + l] + GRAIN:
                    history[first + l, row, 2 * j] = w[values + l]
                    history[first + l, row, 2 * j + 1] = w[values + LANES + l]
