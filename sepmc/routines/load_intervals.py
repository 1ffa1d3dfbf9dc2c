"""Intervals between the switches of motors and loads: time of the next switch, and the active loads
in an interval.

The numbers of a case are stored in ``w`` one after the other, from ``case`` on; ``m`` is the
`layout.Model`.
"""

import math

from sepmc.jit import formula, noinline, routine
from sepmc.routines import layout as at
from sepmc.routines.layout import GRAIN


@formula
def motor_params(i, m, case):
    """Position in ``w`` of the parameters of motor i of the case at ``case``; m: `Model`."""
    return case + m.scene.motors_p + at.MOTOR_SIZE * i


@formula
def load_params(i, m, case):
    """Position in ``w`` of the parameters of load i of the case at ``case``; m: `Model`."""
    return case + m.scene.loads_p + at.LOAD_SIZE * i


@formula
def motor_work(i, m, case):
    """Position in ``w`` of the interval data of motor i of the case at ``case``; m: `Model`."""
    return case + m.scene.motors_w + at.MOTOR_WORK * i


@formula
def load_work(i, m, case):
    """Position in ``w`` of the interval data of load i of the case at ``case``; m: `Model`."""
    return case + m.scene.loads_w + at.LOAD_WORK * i


@routine
def _ignition_time(i, m, w, case):
    """Ignition time of motor i, s."""
    p = motor_params(i, m, case)
    return w[p + at.IGNITION] + w[p + at.IGNITION_DELAY]


@routine
def _earlier(earliest, time, t):
    """Earlier of two times; the second one, ``time``, is ignored if it is not after ``t``."""
    return min(earliest, time) if time > t + GRAIN else earliest


@routine
def next_load_switch(t, m, w, case):
    """Earliest discontinuity of a load after a time.

    Ignition, burn-out, knots of thrust profiles, start and end of constant loads, and the end of a
    short transient, so that the steps within it are short.

    Parameters
    ----------
    t : float
        s.
    m : Model
    w : array
        Workspace.
    case : int
        Position of the case's numbers.

    Returns
    -------
    float
        s; infinite if there is none.
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
    """Set in ``w`` which motors and constant loads act in the interval around the time ``middle``,
    s, and the lines of their thrust profiles. It is set once for the interval, so that no stage of
    a step sees a switch."""
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
    """Set the line of a thrust profile (fraction of the thrust: level + slope t, t from ignition)
    that holds ``since`` seconds after ignition; zero before its first and after its last row.
    ``first`` and ``rows`` are the position and number of its rows, ``work`` that of the result."""
    w[work + at.LEVEL], w[work + at.SLOPE] = 0.0, 0.0
    for k in range(rows - 1):
        t0, f0 = m.numbers[first + 2 * k], m.numbers[first + 2 * k + 1]
        t1, f1 = m.numbers[first + 2 * k + 2], m.numbers[first + 2 * k + 3]
        if t0 <= since < t1:
            w[work + at.SLOPE] = (f1 - f0) / (t1 - t0)
            w[work + at.LEVEL] = f0 - w[work + at.SLOPE] * t0
