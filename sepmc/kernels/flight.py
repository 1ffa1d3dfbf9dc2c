"""One case from start to end: phases, stretches between discontinuities, steps, release, outcomes."""

import math

import numpy as np

from sepmc.kernels import layout as at
from sepmc.kernels._jit import stage
from sepmc.kernels.dynamics import set_attitudes
from sepmc.kernels.observe import body_outcomes, full_row, joint_residual, separation, separation_row
from sepmc.kernels.places import motor_params, motor_work, phase_params, phase_rows
from sepmc.kernels.prepare import set_inertias, set_initial_state, set_joints, set_motors
from sepmc.kernels.rk import extend, first_stage, interpolate, step

# Values of schema.Status.
OK, NEVER_RELEASED, INVALID_INPUT, OUTSIDE_ATMOSPHERE, SINGULAR_JOINT, NOT_FINITE, NO_ROOT, UNRESOLVED = 0, 1, 2, 3, 4, 5, 6, 8
NO_HISTORY, SEPARATION_HISTORY, FULL_HISTORY = 0, 1, 2

_ROOT = 1e-13  # s: a release is located when Newton's next correction is below this
_UNRESOLVED = 1e-6  # drift of a quaternion in one step beyond which a case is not called ok; table2.toml stays below 1e-13
_TOUCH = 1e-12  # m: a phase that begins this close to its stroke has reached it (the gap of a locked joint is round-off)
_GRAIN = 1e-12  # s: two times closer than this are one


@stage
def _next_break(t, m, w):
    """Earliest ignition or burn-out after t: step ends fall on them."""
    earliest = math.inf
    for i in range(m.n_motors):
        p = motor_params(i, m)
        ignition = w[p + at.IGNITION]
        burn_out = ignition + w[p + at.BURN]
        if ignition > t + _GRAIN:
            earliest = min(earliest, ignition)
        if burn_out > t + _GRAIN:
            earliest = min(earliest, burn_out)
    return earliest


@stage
def _set_burning(middle, m, w):
    """Which motors burn in the stretch of time around ``middle``: decided once, so that no stage sees a switch."""
    for i in range(m.n_motors):
        p = motor_params(i, m)
        ignition = w[p + at.IGNITION]
        w[motor_work(i, m) + at.BURNING] = 1.0 if ignition <= middle < ignition + w[p + at.BURN] else 0.0


@stage
def _normalise(y, m):
    """Quaternions back to unit length after a step. Returns the largest drift, of the order of the step's error."""
    drift = 0.0
    for b in range(m.n_bodies):
        q = b * at.STATE + at.QUATERNION
        norm = math.sqrt(y[q] ** 2 + y[q + 1] ** 2 + y[q + 2] ** 2 + y[q + 3] ** 2)
        drift = max(drift, abs(norm - 1.0))
        for i in range(4):
            y[q + i] /= norm
    return drift


@stage
def _health(y, m, w):
    """OK, or why the state cannot be used. Outside the atmosphere there is no density, and the state is not finite."""
    for n in range(y.shape[0]):
        if not math.isfinite(y[n]):
            return OUTSIDE_ATMOSPHERE if w[m.work + at.LEFT_AIR] != 0.0 else NOT_FINITE
    return OK


@stage
def _locate(t, h, joint, stroke, y0, y1, scratch, k, rk, phase, m, w):
    """Length of the step from y0 that ends at separation ``stroke``, by safeguarded Newton on whole steps; its state in y1.

    y1 must hold the state after the whole step h, which has passed the stroke. Returns -1 if it does not converge.
    """
    low, high, length = 0.0, h, h
    for _ in range(60):
        set_attitudes(y1, m, w)
        distance, speed = separation(y1, joint, m, w)
        excess = distance - stroke
        if excess >= 0.0:
            high = min(high, length)
        else:
            low = max(low, length)
        trial = length - excess / speed if speed > 0.0 else 0.5 * (low + high)
        if abs(trial - length) <= _ROOT or high - low <= _ROOT:
            return length
        if not low <= trial <= high:
            trial = 0.5 * (low + high)
        length = trial
        step(t, length, y0, y1, scratch, k, rk, phase, m, w)
        _normalise(y1, m)
    return -1.0


@stage
def _record(t, y, phase, times, phases, history, rows, level, m, w):
    """Append one history row if there is room. Returns the number of rows."""
    if rows >= times.shape[0]:
        return rows
    times[rows] = t
    phases[rows] = phase
    if level == FULL_HISTORY:
        full_row(t, y, phase, history[rows], m, w)
    else:
        separation_row(y, history[rows], m, w)
    return rows + 1


@stage
def _mark_releases(t, phase, outcomes, m):
    """Note the time at which a joint that held something in the phase before holds nothing any more."""
    if phase == 0:
        return
    for j in range(m.n_joints):
        held, holds = 0, 0
        for k in range(6):
            held += m.table[phase_rows(phase - 1, m) + 6 * j + k]
            holds += m.table[phase_rows(phase, m) + 6 * j + k]
        if held > 0 and holds == 0:
            outcomes[m.n_bodies * at.BODY_OUTCOMES + j * at.JOINT_OUTCOMES + 2] = t


@stage
def _prepare(nominal, slots, draws, w, y, m):
    """Put the draws in place and set up the flight. Returns False if the case cannot be flown."""
    w[: nominal.shape[0]] = nominal
    for i in range(slots.shape[0]):
        if not math.isfinite(draws[i]):
            return False
        w[slots[i]] = draws[i]
    if not set_inertias(m, w):
        return False
    set_motors(m, w)
    set_joints(m, w)
    set_initial_state(y, m, w)
    return True


@stage
def fly_case(m, rk, nominal, slots, draws, outcomes, times, phases, history, level):
    """Fly one case and write its outcomes. Returns its status and the number of history rows."""
    outcomes[:] = math.nan
    size = at.STATE * m.n_bodies
    total_stages = max(rk.b.shape[0], rk.dense.shape[0])
    w = np.zeros(m.size_w)
    y0, y1, scratch, sample = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    k, weights = np.empty((total_stages, size)), np.empty(rk.dense.shape[0])
    if not _prepare(nominal, slots, draws, w, y0, m):
        return INVALID_INPUT, 0

    status, t, rows, next_sample, steps = OK, 0.0, 0, 0, 0
    gap, angle, drift = 0.0, 0.0, 0.0
    end = w[at.END_TIME]
    for phase in range(m.n_phases):
        phase_start = t
        phase_end = min(end, w[phase_params(phase, m) + at.UNTIL_TIME])
        event, stroke = m.table[m.phase_event_i + phase], w[phase_params(phase, m) + at.UNTIL_STROKE]
        wanted = phase_rows(phase, m)
        _mark_releases(t, phase, outcomes, m)
        set_attitudes(y0, m, w)
        fired = event >= 0 and separation(y0, event, m, w)[0] >= stroke - _TOUCH
        if level == FULL_HISTORY and t < phase_end and not fired:
            _set_burning(t + _GRAIN, m, w)
            rows = _record(t, y0, phase, times, phases, history, rows, level, m, w)
        while t < phase_end and not fired and status == OK:
            stretch_start, stretch_end = t, min(phase_end, _next_break(t, m, w))
            _set_burning(0.5 * (stretch_start + stretch_end), m, w)
            count = max(1, math.ceil((stretch_end - stretch_start) / rk.step - 1e-9))
            for i in range(count):
                last = i == count - 1
                t_next = stretch_end if last else stretch_start + (stretch_end - stretch_start) * (i + 1) / count
                length = t_next - t
                singular = not first_stage(t, y0, k, phase, m, w) > 0.0
                pivot = step(t, length, y0, y1, scratch, k, rk, phase, m, w)
                steps += 1
                status = SINGULAR_JOINT if singular else _health(y1, m, w)
                if status == OK and not pivot > 0.0:
                    status = SINGULAR_JOINT
                if status != OK:
                    break
                drift = max(drift, _normalise(y1, m))
                if drift > _UNRESOLVED:
                    status = UNRESOLVED
                    break
                set_attitudes(y1, m, w)
                if event >= 0 and separation(y1, event, m, w)[0] >= stroke:
                    fired = True
                    length = _locate(t, length, event, stroke, y0, y1, scratch, k, rk, phase, m, w)
                    if length < 0.0:
                        status = NO_ROOT
                        break
                    t_next = t + length
                if level != NO_HISTORY and rk.history_step > 0.0:
                    closing = fired or (last and stretch_end >= phase_end)
                    extended = False
                    while next_sample * rk.history_step <= t_next + _GRAIN:
                        ts = next_sample * rk.history_step
                        next_sample += 1
                        # the first and last state of a phase have rows of their own in a full history
                        if level == FULL_HISTORY and (ts <= phase_start + _GRAIN or (closing and ts >= t_next - _GRAIN)):
                            continue
                        if not extended:
                            extend(t, length, y0, scratch, k, rk, phase, m, w)
                            extended = True
                        interpolate(min(1.0, max(0.0, (ts - t) / length)), length, y0, sample, weights, k, rk)
                        _normalise(sample, m)
                        rows = _record(ts, sample, phase, times, phases, history, rows, level, m, w)
                t = t_next
                y0[:] = y1
                set_attitudes(y0, m, w)
                step_gap, step_angle = joint_residual(y0, wanted, m, w)
                gap, angle = max(gap, step_gap), max(angle, step_angle)
                if fired:
                    break
        if status != OK:
            break
        if level == FULL_HISTORY and t > phase_start:
            rows = _record(t, y0, phase, times, phases, history, rows, level, m, w)
        if event >= 0 and not fired and t >= end:
            status = NEVER_RELEASED
            break

    audit = m.n_bodies * at.BODY_OUTCOMES + m.n_joints * at.JOINT_OUTCOMES
    outcomes[audit], outcomes[audit + 1], outcomes[audit + 2], outcomes[audit + 3] = gap, angle, drift, steps
    if status in (OK, NEVER_RELEASED):
        set_attitudes(y0, m, w)
        for b in range(m.n_bodies):
            body_outcomes(y0, b, outcomes, b * at.BODY_OUTCOMES, m, w)
        for j in range(m.n_joints):
            o = m.n_bodies * at.BODY_OUTCOMES + j * at.JOINT_OUTCOMES
            distance, speed = separation(y0, j, m, w)
            outcomes[o], outcomes[o + 1] = speed, distance
    return status, rows
