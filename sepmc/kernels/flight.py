"""One case from start to end: stretches between known times, steps, events, outcomes."""

import math

import numpy as np

from sepmc.kernels import events
from sepmc.kernels import layout as at
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.correct import hold, residuals
from sepmc.kernels.dynamics import kinetic_energy, motion, rest_energy, set_attitudes
from sepmc.kernels.layers import enter_layer, set_layers, stop_at_layer
from sepmc.kernels.layout import GRAIN
from sepmc.kernels.observe import follow_angles, full_row, joint_outcomes_at, report, separation_row
from sepmc.kernels.outputs import GOLDEN, NODES, note_tip_off, row_size, start_watching, watch_step, watches
from sepmc.kernels.places import joint_work, leaf_work
from sepmc.kernels.prepare import prepare
from sepmc.kernels.quat import normalise_all
from sepmc.kernels.rk import extend, first_stage, interpolate, keep_doubt, step
from sepmc.kernels.stretches import next_break, set_stretch

# Values of schema.Status.
OK, NEVER_RELEASED, INVALID_INPUT, OUTSIDE_ATMOSPHERE, SINGULAR_JOINT, NOT_FINITE, NO_ROOT, UNRESOLVED = 0, 1, 2, 3, 4, 5, 6, 8
INCONSISTENT_START, OUTSIDE_TABLE, JAMMED, TOO_MANY_EVENTS = 9, 10, 11, 12

_ROOT = 1e-13  # s: an event is located when the next correction is below this
# A flight of n times as many steps has root n steps at least between any two instants at which something changes. So shorter steps are
# shorter everywhere, and the difference that they make is an error that holds for what happens within one step too.
_WHOLE, _MOST_AT_LEAST = 8.0, 1000.0
_CLEVER = 60  # trials before the bracket is only halved: Newton wanders where round-off over speed is above _ROOT
_PEAK_ROUNDS = 36  # of golden section for the peak of a load
NO_CLEARANCE = 13
_UNRESOLVED = 1e-6  # drift of a quaternion in one step, or share of energy lost, beyond which a case is not called ok
_MOST_TURNED = 2.0  # rad a body may turn in a step: beyond, its phase is lost though its length is kept
_CONSISTENT = 1e-9  # m, rad, m/s, rad/s: what the constraints may be violated by at the start
_MOST_EVENTS = 10_000  # stretches without progress in time


@stage
def _health(y, m, w):
    """OK, or why the state cannot be used. Outside the atmosphere or a table there is no number, and the state is not finite."""
    for n in range(y.shape[0]):
        if not math.isfinite(y[n]):
            if w[m.scene.work + at.LEFT_AIR] != 0.0:
                return OUTSIDE_ATMOSPHERE
            return OUTSIDE_TABLE if w[m.scene.work + at.LEFT_TABLE] != 0.0 else NOT_FINITE
    return OK


@stage
def _value(i, t, y, m, w):
    """Condition ``i`` at a state, with all it needs solved for."""
    keep_apart()
    if events.on_load(i, m):
        motion(t, y, m, w)
    else:
        set_attitudes(y, m, w)
    return events.state_value(i, t, y, m, w)


@stage
def _locate(i, t, h, y0, y1, scratch, k, rk, m, w):
    """Length of the step from y0 that ends where condition ``i`` is met, on whole steps, by Newton or, without a rate, by false
    position, both within a bracket; its state in y1, which must hold the state after the whole step h, where it is met.

    Returns the length (-1 if it does not converge) and how far off in time it may be, s.
    """
    keep_apart()
    low, low_value, high, high_value, length = 0.0, w[leaf_work(i, m) + at.BEFORE], h, math.inf, h
    for trial_number in range(120):
        value, rate = _value(i, t + length, y1, m, w)
        if value >= 0.0:
            high, high_value = min(high, length), value
        else:
            low, low_value = max(low, length), value
        trial = 0.5 * (low + high)
        if trial_number < _CLEVER and rate > 0.0:
            trial = length - value / rate
        elif trial_number < _CLEVER and trial_number % 3 != 2 and high_value > low_value:
            trial = high - high_value * (high - low) / (high_value - low_value)
        if abs(trial - length) <= _ROOT or high - low <= _ROOT:
            return length, min(abs(trial - length), high - low)
        length = trial if low < trial < high else 0.5 * (low + high)
        step(t, length, y0, y1, scratch, k, rk, m, w)
        normalise_all(y1, m.scene.n_bodies)
    return -1.0, math.nan


@stage
def _highest(i, t, h, y0, y1, scratch, k, rk, m, w):
    """Length of the step from y0 at which condition ``i``, which rises and falls within h, is highest; its state in y1."""
    keep_apart()
    low, high, length = 0.0, h, 0.5 * h
    for _ in range(60):
        length = 0.5 * (low + high)
        step(t, length, y0, y1, scratch, k, rk, m, w)
        normalise_all(y1, m.scene.n_bodies)
        value, rate = _value(i, t + length, y1, m, w)
        if value >= 0.0 or high - low <= _ROOT:
            break
        if rate > 0.0:
            low = length
        else:
            high = length
    return length


@stage
def _load_value(i, theta, t, h, y0, sample, weights, k, rk, m, w):
    """Condition ``i`` on a load at a fraction of the step from y0, whose continuous extension is ready."""
    interpolate(theta, h, y0, sample, weights, k, rk)
    normalise_all(sample, m.scene.n_bodies)
    return _value(i, t + theta * h, sample, m, w)[0]


@stage
def _load_met(i, t, h, y0, sample, weights, k, rk, m, w):
    """A fraction of the step at which condition ``i`` on a load is met, though it may fall again within the step; 1 if there is none.

    Looked for at its quarters, and by golden section around the greatest of them if it comes near the threshold.
    """
    keep_apart()
    best, greatest, least = 0, w[leaf_work(i, m) + at.BEFORE], w[leaf_work(i, m) + at.BEFORE]
    for quarter in range(1, 5):
        value = _load_value(i, 0.25 * quarter, t, h, y0, sample, weights, k, rk, m, w)
        if value >= 0.0:
            return 0.25 * quarter
        least = min(least, value)
        if value > greatest:
            best, greatest = quarter, value
    if not greatest + (greatest - least) >= 0.0:
        return 1.0
    low, high = 0.25 * max(best - 1, 0), 0.25 * min(best + 1, 4)
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    fa = _load_value(i, a, t, h, y0, sample, weights, k, rk, m, w)
    fb = _load_value(i, b, t, h, y0, sample, weights, k, rk, m, w)
    for _ in range(_PEAK_ROUNDS):
        if fa >= 0.0 or fb >= 0.0:
            return a if fa >= 0.0 else b
        if fa >= fb:
            high, b, fb = b, a, fa
            a = high - GOLDEN * (high - low)
            fa = _load_value(i, a, t, h, y0, sample, weights, k, rk, m, w)
        else:
            low, a, fa = a, b, fb
            b = low + GOLDEN * (high - low)
            fb = _load_value(i, b, t, h, y0, sample, weights, k, rk, m, w)
    return 1.0


@stage
def _first_event(t, h, y0, y1, sample, scratch, weights, k, rk, phase, m, w):
    """Shorten a step to the first condition that is met within it. y1 then holds the state at its end.

    Returns its length (-1 if the event cannot be located), the condition or -1, how far off in time it may be, and whether the
    stages in ``k`` are still those of this step.
    """
    keep_apart()
    first, length, error, stages_kept = -1, h, 0.0, True
    if events.waits_for_load(phase, m, w):  # a load may rise and fall within the step
        extend(t, h, y0, scratch, k, rk, m, w)
        for i in range(m.scene.n_leaves):
            if events.on_load(i, m) and events.is_armed(i, phase, m, w):
                length = min(length, h * _load_met(i, t, h, y0, sample, weights, k, rk, m, w))
        if length < h:
            step(t, length, y0, y1, scratch, k, rk, m, w)
            normalise_all(y1, m.scene.n_bodies)
    for i in range(m.scene.n_leaves):
        if events.on_time(i, m) or not events.is_armed(i, phase, m, w):
            continue
        met = _value(i, t + length, y1, m, w)[0] >= 0.0
        if not met and events.may_graze(i, t, length, y1, m, w):
            sample[:] = y1
            top = _highest(i, t, length, y0, y1, scratch, k, rk, m, w)
            met = _value(i, t + top, y1, m, w)[0] >= 0.0
            if met:
                length = top
            else:
                y1[:] = sample
                stages_kept = False
        if met:
            first = i
            length, error = _locate(i, t, length, y0, y1, scratch, k, rk, m, w)
            stages_kept = True
            if length < 0.0:
                break
    return length, first, error, stages_kept


@stage
def _keep_slowness(i, t, h, y, guards, m, w):
    """How slowly condition ``i`` is met at the end of a step, s per unit of its value: an error of the value is so much of one of time."""
    value, rate = _value(i, t, y, m, w)
    if math.isnan(rate):  # of a load: on average over the step
        rate = (value - w[leaf_work(i, m) + at.BEFORE]) / h if h > 0.0 else 0.0
    g = 3 * m.scene.n_bodies + i
    guards[g] = max(guards[g], 1.0 / rate if rate > 0.0 else math.inf)


@stage
def _record(t, y, phase, times, phases, history, rows, level, m, w):
    """Append one history row if there is room. Returns the number of rows."""
    keep_apart()
    if rows >= times.shape[0]:
        return rows
    times[rows] = t
    phases[rows] = phase
    if level == at.FULL_HISTORY:
        full_row(t, y, history[rows], m, w)
    else:
        separation_row(y, history[rows], m, w)
    return rows + 1


@stage
def _note_releases(t, y, outcomes, m, w):
    """Note when a joint that held something became free, and the rates at that time."""
    for j in range(m.scene.n_joints):
        o = joint_outcomes_at(j, m) + 2
        if w[joint_work(j, m) + at.KIND] == at.FREE and math.isinf(outcomes[o]):
            outcomes[o] = t
            note_tip_off(j, y, outcomes, m, w)


@stage
def _begin(y, outcomes, m, w):
    """Joints as the first phase wants them. A joint that holds has no release time yet: infinite, NaN at the end."""
    for j in range(m.scene.n_joints):
        kind, work = m.table[m.scene.phase_kinds_i + j], joint_work(j, m)
        w[work + at.KIND] = kind
        if kind != at.FREE:
            outcomes[joint_outcomes_at(j, m) + 2] = math.inf
    for event in range(m.scene.n_events):
        w[m.scene.events_w + event] = math.inf
    events.set_sides(0.0, y, 0, m, w)


@stage
def _drop_infinite(outcomes, m):
    """Joints that still hold have no release time: NaN."""
    for j in range(m.scene.n_joints):
        o = joint_outcomes_at(j, m) + 2
        outcomes[o] = outcomes[o] if math.isfinite(outcomes[o]) else math.nan


@stage
def fly_case(m, rk, nominal, slots, draws, outcomes, guards, times, phases, history, level):
    """Fly one case and write its outcomes. Returns its status and the number of history rows."""
    outcomes[:] = math.nan
    guards[:] = 0.0
    size = at.STATE * m.scene.n_bodies + 1
    total_stages = max(rk.b.shape[0], rk.dense.shape[0])
    w = np.zeros(m.scene.size_w)
    y0, y1, scratch, sample = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    k, weights = np.empty((total_stages, size)), np.empty(rk.dense.shape[0])
    watched = np.empty((NODES + 1, row_size(m)))
    if not prepare(nominal, slots, draws, w, y0, m):
        return INVALID_INPUT, 0

    status, t, rows, after_row, next_sample, steps, phase = OK, 0.0, 0, 0, 0, 0, 0
    end, audit = w[at.END_TIME], outcomes[outcomes.shape[0] - at.AUDIT :]
    audit[:] = 0.0
    audit[at.PIVOT_AUDIT] = 1.0
    _begin(y0, outcomes, m, w)
    start_watching(outcomes, m)
    set_layers(t, y0, m, w)
    set_attitudes(y0, m, w)
    start = residuals(y0, m, w)
    if not max(start[0], start[1], start[2], start[3]) <= _CONSISTENT:
        _drop_infinite(outcomes, m)
        return INCONSISTENT_START, 0
    energy0 = kinetic_energy(y0, m, w)
    energy_scale, energy_lost, idle = max(energy0, rest_energy(y0, m, w)), 0.0, 0
    set_stretch(GRAIN, m, w)
    phase, _ = events.settle(t, y0, phase, m, w)
    _note_releases(t, y0, outcomes, m, w)
    fresh = True  # what the joints hold has just changed
    least = max(1, math.ceil(min(math.sqrt(end / (_WHOLE * rk.step)), _MOST_AT_LEAST) - 1e-9))
    divided, split_end, fresh_t = 0, -1.0, -1.0
    while t < end and status == OK:
        if fresh and level == at.FULL_HISTORY:
            set_stretch(t + GRAIN, m, w)
            rows = _record(t, y0, phase, times, phases, history, rows, level, m, w)
        fresh_t = t if fresh else fresh_t
        fresh = False
        stretch_end = min(end, next_break(t, m, w), events.next_known_time(t, phase, m, w))
        set_stretch(0.5 * (t + stretch_end), m, w)
        stretch_start = t
        count = max(least, math.ceil((stretch_end - stretch_start) / rk.step - 1e-9))
        if divided > 0:  # again up to a condition that was met within the first steps
            stretch_end, count, divided = split_end, divided, 0
        for i in range(count):
            last = i == count - 1
            t_next = stretch_end if last else stretch_start + (stretch_end - stretch_start) * (i + 1) / count
            length = t_next - t
            pivot = first_stage(t, y0, k, m, w)
            events.remember(t, y0, phase, m, w)
            pivot = min(pivot, step(t, length, y0, y1, scratch, k, rk, m, w))
            steps += 1
            status = _health(y1, m, w)
            if status == OK and not pivot > 0.0:
                status = SINGULAR_JOINT
            if status != OK:
                break
            audit[at.PIVOT_AUDIT] = min(audit[at.PIVOT_AUDIT], pivot)
            keep_doubt(length, m.scene.n_bodies, guards, k, rk)
            drift = normalise_all(y1, m.scene.n_bodies)
            audit[at.DRIFT_AUDIT] = max(audit[at.DRIFT_AUDIT], drift)
            if drift > _UNRESOLVED:
                status = UNRESOLVED
                break
            found, error, stages_kept, whole = -1, 0.0, True, length
            length, leaves, into = stop_at_layer(t, length, y0, y1, scratch, k, rk, m, w)
            border = length
            if m.scene.n_leaves > 0:
                length, found, error, stages_kept = _first_event(t, length, y0, y1, sample, scratch, weights, k, rk, phase, m, w)
                if length < 0.0:
                    status = NO_ROOT
                    break
            cut = found >= 0 or length < whole
            if cut and i + 1 < least and length > GRAIN and t > split_end + GRAIN:
                divided, split_end = least - i, t + length
                set_attitudes(y0, m, w)
                break
            if cut:
                t_next, split_end = t + length, -1.0
            if found >= 0:
                _keep_slowness(found, t + length, length, y1, guards, m, w)
                audit[at.EVENT_AUDIT] = max(audit[at.EVENT_AUDIT], error)
                w[leaf_work(found, m) + at.MET] = 1.0
            if leaves >= 0 and length == border:
                enter_layer(into, leaves, m, w)
            wants_history = level != at.NO_HISTORY and rk.history_step > 0.0
            if length > 0.0 and (watches(m) or (wants_history and next_sample * rk.history_step <= t_next + GRAIN)):
                if cut or not stages_kept:
                    step(t, length, y0, sample, scratch, k, rk, m, w)
                extend(t, length, y0, scratch, k, rk, m, w)
                if watches(m):
                    watch_step(t, length, y0, sample, weights, k, rk, watched, outcomes, m, w)
                while wants_history and next_sample * rk.history_step <= t_next + GRAIN:
                    ts = next_sample * rk.history_step
                    closing = ts >= t_next - GRAIN and (cut or last)
                    if closing and level == at.FULL_HISTORY:  # told below, or at the start of what comes next
                        break
                    next_sample += 1
                    if level == at.FULL_HISTORY and ts <= fresh_t + GRAIN:
                        continue
                    interpolate(min(1.0, max(0.0, (ts - t) / length)), length, y0, sample, weights, k, rk)
                    normalise_all(sample, m.scene.n_bodies)
                    rows = _record(ts, sample, phase, times, phases, history, rows, level, m, w)
            idle = idle + 1 if t_next <= t else 0
            t = t_next
            y0[:] = y1
            set_attitudes(y0, m, w)
            hold(y0, audit, m, w)
            if m.scene.friction != 0:  # asked of accepted states only: a trial beyond the end of the pins may jam
                w[m.scene.work + at.JAMMED] = 0.0
                motion(t, y0, m, w)
                if w[m.scene.work + at.JAMMED] != 0.0:
                    status = JAMMED
                    break
            lost, turned = follow_angles(y0, length, m, w)
            if lost:
                audit[at.SINGULAR_AUDIT] = 1.0
            if turned > _MOST_TURNED:
                status = UNRESOLVED
                break
            if w[m.scene.work + at.UNSEARCHED] != 0.0:
                status = NO_CLEARANCE
                break
            energy = kinetic_energy(y0, m, w)
            work = y0[size - 1]
            energy_scale = max(energy_scale, energy, abs(work), rest_energy(y0, m, w))
            energy_lost = max(energy_lost, abs(energy - energy0 - work))
            if idle > _MOST_EVENTS:
                status = TOO_MANY_EVENTS
                break
            if cut:
                break
        if status != OK:
            break
        if level == at.FULL_HISTORY:  # as the joints still hold; kept if they change now
            after_row = _record(t, y0, phase, times, phases, history, rows, level, m, w)
        set_stretch(t + GRAIN, m, w)  # a load that has just switched counts as it is from now on
        phase, fresh = events.settle(t, y0, phase, m, w)
        if level == at.FULL_HISTORY and (fresh or t >= end):
            rows = after_row
        _note_releases(t, y0, outcomes, m, w)

    audit[at.ENERGY_AUDIT] = energy_lost / energy_scale
    audit[at.STEPS_AUDIT], audit[at.REDUNDANT_AUDIT] = steps, w[m.scene.work + at.REDUNDANT]
    if status == OK and audit[at.ENERGY_AUDIT] > _UNRESOLVED:
        status = UNRESOLVED
    if status == OK and events.never_let_go(phase, m, w):
        status = NEVER_RELEASED
    _drop_infinite(outcomes, m)
    if status in (OK, NEVER_RELEASED):
        report(t, y0, outcomes, m, w)
    return status, rows
