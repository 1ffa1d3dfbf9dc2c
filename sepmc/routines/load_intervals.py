"""Intervals between the times at which motors and constant loads switch on or off: the time of the
next switch, and which loads are active in an interval.

The numbers of a case are stored one after the other in the workspace ``w``, from w[case] on:
parameters, then interval data. ``m`` is the `layout.Model` of the scene.
"""

import math

from sepmc.jit import formula, noinline, routine
from sepmc.routines import layout as at
from sepmc.routines.layout import GRAIN


@formula
def motor_params(i, m, case):
    """Position in the workspace of the first parameter of motor i (the
    others follow it), for the case whose numbers begin at ``case``; m is the `Model`."""
    return case + m.scene.motors_p + at.MOTOR_SIZE * i


@formula
def load_params(i, m, case):
    """Position in the workspace of the first parameter of constant load i (the
    others follow it), for the case whose numbers begin at ``case``; m is the `Model`."""
    return case + m.scene.loads_p + at.LOAD_SIZE * i


@formula
def motor_work(i, m, case):
    """Position in the workspace of the first number of the interval data of motor i (the
    others follow it), for the case whose numbers begin at ``case``; m is the `Model`."""
    return case + m.scene.motors_w + at.MOTOR_WORK * i


@formula
def load_work(i, m, case):
    """Position in the workspace of the first number of the interval data of constant load i (the
    others follow it), for the case whose numbers begin at ``case``; m is the `Model`."""
    return case + m.scene.loads_w + at.LOAD_WORK * i


@routine
def _ignition_time(i, m, w, case):
    """Return the ignition time of motor i of a case, its delay included, s; infinite as long as the
    event, release or joint that ignites it has not occurred."""
    p = motor_params(i, m, case)
    return w[p + at.IGNITION] + w[p + at.IGNITION_DELAY]


@routine
def _earlier(earliest, time, t):
    """Return the earlier of two times, ``earliest`` and ``time``; ``time`` is ignored unless it is
    more than GRAIN, which is round-off, after ``t``."""
    return min(earliest, time) if time > t + GRAIN else earliest


@routine
def next_load_switch(t, m, w, case):
    """Return the time of the first switch of a motor or constant load after the time ``t``.

    Switches are ignition, burn-out, rows of thrust profiles, start and end of constant loads. The
    end of a short build-up or tail-off counts, too, so that the steps within it are short.

    Parameters
    ----------
    t : float
        s.
    m : Model
    w : array
        Workspace.
    case : int
        Position in w of the numbers of the case.

    Returns
    -------
    float
        s; infinite if there is no switch after t.
    """
    noinline()
    brief = at.BRIEF / at.TRANSIENT * w[case + at.END_TIME]
    earliest = math.inf
    for i in range(m.scene.n_motors):
        start = _ignition_time(i, m, w, case)
        earliest = _earlier(earliest, start, t)
        p = motor_params(i, m, case)
        end, build_up, tail_off = start + w[p + at.BURN], w[p + at.BUILD_UP], w[p + at.TAIL_OFF]
        earliest = _earlier(earliest, end, t)
        if 0.0 < build_up < brief:
            earliest = _earlier(earliest, start + at.TRANSIENT * build_up, t)
        if 0.0 < tail_off < brief:
            earliest = _earlier(earliest, end + at.TRANSIENT * tail_off, t)
        first, rows = m.table[m.scene.profile_i + 2 * i], m.table[m.scene.profile_i + 2 * i + 1]
        for k in range(rows):
            earliest = _earlier(earliest, start + m.numbers[first + 2 * k], t)
    for i in range(m.scene.n_loads):
        earliest = _earlier(earliest, w[load_params(i, m, case) + at.LOAD_START], t)
        earliest = _earlier(earliest, w[load_params(i, m, case) + at.LOAD_END], t)
    return earliest


@routine
def set_active_loads(middle, m, w, case):
    """Store in the interval data of a case, for the interval around the time ``middle``, s: whether
    each motor is off, burns or tails off, the level and slope of its thrust profile while it burns
    (1 and 0 without one; while it tails off, the level at burn-out and 0), and whether each
    constant load acts.

    ``case`` is the position in the workspace ``w`` of the numbers of the case, ``m`` the Model. The
    data are set once for an interval between switches, so that no stage of a step sees a switch.
    """
    noinline()
    for i in range(m.scene.n_motors):
        p, work = motor_params(i, m, case), motor_work(i, m, case)
        since = middle - _ignition_time(i, m, w, case)
        w[work + at.BURNING], w[work + at.LEVEL], w[work + at.SLOPE] = at.OFF, 1.0, 0.0
        if since >= 0.0 and since < w[p + at.BURN]:
            w[work + at.BURNING] = at.ON
        elif since >= 0.0 and w[p + at.TAIL_OFF] > 0.0:
            w[work + at.BURNING] = at.TAILING
        first, rows = m.table[m.scene.profile_i + 2 * i], m.table[m.scene.profile_i + 2 * i + 1]
        if rows > 0 and w[work + at.BURNING] == at.ON:
            _set_profile(since, first, rows, work, m, w)
        elif rows > 0 and w[work + at.BURNING] == at.TAILING:  # starts from the level at burn-out
            burn = w[p + at.BURN]
            _set_profile(burn - GRAIN, first, rows, work, m, w)
            w[work + at.LEVEL], w[work + at.SLOPE] = (
                w[work + at.LEVEL] + w[work + at.SLOPE] * burn,
                0.0,
            )
    for i in range(m.scene.n_loads):
        p = load_params(i, m, case)
        w[load_work(i, m, case) + at.ACTS] = (
            1.0 if w[p + at.LOAD_START] <= middle < w[p + at.LOAD_END] else 0.0
        )


@routine
def _set_profile(since, first, rows, work, m, w):
    """Store the level and slope of the thrust profile of a motor, ``since`` seconds after ignition,
    in its interval data (LEVEL and SLOPE after w[work]): fraction of the thrust = level + slope t,
    t from ignition, s. At a row the span after it counts; both numbers are 0 before the first row,
    at the last one and after it.

    ``first`` is the position in ``m.numbers`` of the ``rows`` rows (time, fraction) of the profile.
    """
    w[work + at.LEVEL], w[work + at.SLOPE] = 0.0, 0.0
    for k in range(rows - 1):
        t0, f0 = m.numbers[first + 2 * k], m.numbers[first + 2 * k + 1]
        t1, f1 = m.numbers[first + 2 * k + 2], m.numbers[first + 2 * k + 3]
        if t0 <= since < t1:
            w[work + at.SLOPE] = (f1 - f0) / (t1 - t0)
            w[work + at.LEVEL] = f0 - w[work + at.SLOPE] * t0
