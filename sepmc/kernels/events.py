"""Conditions on time and state that end phases, let joints go and end the push of springs; when they are met."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import vec3
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.cfe import joint_axes, joint_geometry, separation
from sepmc.kernels.dynamics import height, motion, set_attitudes
from sepmc.kernels.layout import GRAIN
from sepmc.kernels.places import joint_params, joint_work, kind_of, kind_rows, leaf, leaf_work, motor_params, spring_work
from sepmc.kernels.springs import spring_line

_TOUCH = 1e-12  # of a threshold (or of 1 m, 1 rad, ...): a condition this close is met; the gap of a locked joint is round-off


@stage
def _angle(j, m, w):
    """Angle by which B has turned from A at joint j, rad, and a vector along its axis, ground axes. Needs attitudes."""
    ax, ay, az, bx, by = joint_axes(j, m, w)
    bz = vec3.cross(bx, by)
    dx, dy, dz = vec3.sub(bx, ax), vec3.sub(by, ay), vec3.sub(bz, az)
    half = min(1.0, math.sqrt(0.125 * (vec3.dot(dx, dx) + vec3.dot(dy, dy) + vec3.dot(dz, dz))))
    turn = vec3.add(vec3.cross(ax, bx), vec3.add(vec3.cross(ay, by), vec3.cross(az, bz)))
    return 2.0 * math.asin(half), turn


@stage
def state_value(i, t, y, m, w):
    """How far condition ``i`` on the state is beyond its threshold (met at >= 0), and its rate or NaN if that is not known.

    Needs attitudes; joint forces must have been solved for by the caller if the condition is on them.
    """
    keep_apart()
    what, which, threshold = m.table[leaf(i, m)], m.table[leaf(i, m) + 1], w[m.table[leaf(i, m) + 3]]
    if what == at.AT_STROKE:
        distance, speed = separation(y, which, m, w)
        return distance - threshold, speed
    if what == at.AT_SPRING_STROKE:
        _, _, _, length, rate = spring_line(y, which, m, w)
        return length - w[spring_work(which, m) + at.EXTENSION_START] - threshold, rate
    if what == at.AT_ALTITUDE:
        side, b = w[leaf_work(i, m) + at.FROM_SIDE], which
        rate = y[b * at.STATE + at.VELOCITY + 1] + w[m.scene.work + at.ORIGIN_VELOCITY + 1]
        return side * (height(t, y, b, m, w) - threshold), side * rate
    if what == at.AT_FORCE:
        force = vec3.get(w, joint_work(which, m) + at.FORCE_B)
        return math.sqrt(vec3.dot(force, force)) - threshold, math.nan
    if what == at.AT_MOMENT:
        moment = vec3.get(w, joint_work(which, m) + at.MOMENT_B)
        return math.sqrt(vec3.dot(moment, moment)) - threshold, math.nan
    _, _, omega_a, omega_b, d, d_rate = joint_geometry(y, which, m, w)
    if what == at.AT_DISTANCE:
        distance = math.sqrt(vec3.dot(d, d))
        return distance - threshold, vec3.dot(d, d_rate) / distance
    angle, turn = _angle(which, m, w)
    size = math.sqrt(vec3.dot(turn, turn))
    return angle - threshold, vec3.dot(turn, vec3.sub(omega_b, omega_a)) / size


@stage
def on_time(i, m):
    """Whether condition ``i`` is met at a known time."""
    return m.table[leaf(i, m)] <= at.AT_BURN_OUT


@stage
def on_load(i, m):
    """Whether condition ``i`` is on the force or moment of a joint."""
    return m.table[leaf(i, m)] in (at.AT_FORCE, at.AT_MOMENT)


@stage
def known_time(i, m, w):
    """When condition ``i`` on time is met, s."""
    if m.table[leaf(i, m)] == at.AT_TIME:
        return w[m.table[leaf(i, m) + 3]]
    p = motor_params(m.table[leaf(i, m) + 1], m)
    return w[p + at.IGNITION] + w[p + at.IGNITION_DELAY] + w[p + at.BURN]


@stage
def is_armed(i, phase, m, w):
    """Whether condition ``i`` is waited for: its phase is on, or its release or spring has not gone, and it is not met."""
    event = m.table[leaf(i, m) + 2]
    waited = event == phase if event < m.scene.n_phases else math.isinf(w[m.scene.events_w + event])
    return waited and w[leaf_work(i, m) + at.MET] == 0.0


@stage
def waits_for_load(phase, m, w):
    """Whether a condition on a joint's force or moment is armed."""
    for i in range(m.scene.n_leaves):
        if on_load(i, m) and is_armed(i, phase, m, w):
            return True
    return False


@stage
def set_sides(t, y, phase, m, w):
    """From which side each threshold of height is approached that is waited for from now on: of a phase that begins, or, as the
    first one does, of the releases."""
    keep_apart()
    for i in range(m.scene.n_leaves):
        event = m.table[leaf(i, m) + 2]
        if m.table[leaf(i, m)] == at.AT_ALTITUDE and (event == phase or (phase == 0 and event >= m.scene.n_phases)):
            above = height(t, y, m.table[leaf(i, m) + 1], m, w) > w[m.table[leaf(i, m) + 3]]
            w[leaf_work(i, m) + at.FROM_SIDE] = -1.0 if above else 1.0


@stage
def solve_if_waited(t, y, phase, m, w):
    """Attitudes, and joint forces if a condition on them is armed, at a state."""
    if waits_for_load(phase, m, w):
        motion(t, y, m, w)
    else:
        set_attitudes(y, m, w)


@stage
def meet(t, y, phase, loads, m, w):
    """Mark the armed conditions that are met at a state, those on joint forces only if ``loads``. Returns whether any was."""
    keep_apart()
    if loads:
        solve_if_waited(t, y, phase, m, w)
    else:
        set_attitudes(y, m, w)
    found = False
    for i in range(m.scene.n_leaves):
        if not is_armed(i, phase, m, w) or (on_load(i, m) and not loads):
            continue
        if on_time(i, m):
            met = t >= known_time(i, m, w) - GRAIN
        else:
            met = state_value(i, t, y, m, w)[0] >= -_TOUCH * max(1.0, abs(w[m.table[leaf(i, m) + 3]]))
        if met:
            w[leaf_work(i, m) + at.MET] = 1.0
            found = True
    return found


@stage
def is_due(event, m, w):
    """Whether all conditions of one clause of an event are met."""
    first, count = m.table[m.scene.events_i + 2 * event], m.table[m.scene.events_i + 2 * event + 1]
    for c in range(first, first + count):
        leaves, n = m.table[m.scene.clauses_i + 2 * c], m.table[m.scene.clauses_i + 2 * c + 1]
        unmet = 0
        for k in range(leaves, leaves + n):
            if w[leaf_work(m.table[m.scene.clause_leaves_i + k], m) + at.MET] == 0.0:
                unmet += 1
        if unmet == 0:
            return True
    return False


@stage
def _told(j, event, m):
    """The kind that an event (the end of a phase, a release) tells joint j to take, or -1."""
    if event < m.scene.n_phases - 1:
        return m.table[m.scene.phase_kinds_i + m.scene.n_joints * (event + 1) + j]
    release = event - m.scene.n_phases
    if 0 <= release < m.scene.n_releases and m.table[m.scene.releases_i + 2 * release] == j:
        return m.table[m.scene.releases_i + 2 * release + 1]
    return -1


@stage
def _is_less(kind, of, m):
    """Whether a kind holds only what another holds too, and less. Three rows of rotation hold every rotation."""
    first, second = kind_rows(kind, m), kind_rows(of, m)
    count, turns = m.table[second], 0
    for k in range(second + 1, second + 1 + count):
        if at.ROTATION <= m.table[k] < at.ROD:
            turns += 1
    for i in range(first + 1, first + 1 + m.table[first]):
        held = turns == 3 and at.ROTATION <= m.table[i] < at.ROD
        for k in range(second + 1, second + 1 + count):
            held = held or m.table[k] == m.table[i]
        if not held:
            return False
    return m.table[first] < count


@stage
def change(j, event, m, w):
    """When joint j changes because of an event: it is late by its delay. Infinite if the event has not come, the joint fails, or it
    would not merely let go."""
    kind = _told(j, event, m)
    if kind < 0 or not _is_less(kind, kind_of(j, m, w), m):
        return math.inf
    p = joint_params(j, m)
    return math.inf if w[p + at.FAILS] >= 0.5 else w[m.scene.events_w + event] + w[p + at.DELAY]


@stage
def _let_go(t, m, w):
    """Change what every joint holds that is due. Returns whether any changed."""
    changed = False
    for event in range(m.scene.n_phases + m.scene.n_releases):
        for j in range(m.scene.n_joints):
            if change(j, event, m, w) <= t + GRAIN:
                w[joint_work(j, m) + at.KIND] = _told(j, event, m)
                changed = True
    return changed


@stage
def settle(t, y, phase, m, w):
    """Everything that happens at an instant: conditions met, phases ended, joints let go, springs spent; until nothing more does.

    What joints carry is judged last: a joint that lets go at this instant carries nothing on. Returns the phase then on, and whether
    anything changed.
    """
    keep_apart()
    changed, loads = False, False
    for _ in range(8 * (m.scene.n_events + m.scene.n_joints) + 8):
        again = meet(t, y, phase, loads, m, w)
        if phase < m.scene.n_phases - 1 and is_due(phase, m, w):
            w[m.scene.events_w + phase] = t
            phase += 1
            set_sides(t, y, phase, m, w)
            again = True
            changed = True
        for event in range(m.scene.n_phases, m.scene.n_events):
            if math.isinf(w[m.scene.events_w + event]) and is_due(event, m, w):
                w[m.scene.events_w + event] = t
                again = True
                spring = event - m.scene.n_phases - m.scene.n_releases
                if spring >= 0:
                    w[spring_work(spring, m) + at.SPENT] = 1.0
                    changed = True
        if _let_go(t, m, w):
            again = True
            changed = True
        if loads and not again:
            break
        loads = not again
    return phase, changed


@stage
def next_known_time(t, phase, m, w):
    """Earliest time after t at which something happens by the clock: conditions on time, joints that let go late."""
    keep_apart()
    earliest = math.inf
    for i in range(m.scene.n_leaves):
        if on_time(i, m) and is_armed(i, phase, m, w):
            earliest = min(earliest, known_time(i, m, w))
    for event in range(m.scene.n_phases + m.scene.n_releases):
        if not math.isinf(w[m.scene.events_w + event]):
            for j in range(m.scene.n_joints):
                earliest = min(earliest, change(j, event, m, w))
    return earliest if earliest > t else math.inf


@stage
def remember(t, y, phase, m, w):
    """Values of the armed conditions at the start of a step."""
    keep_apart()
    for i in range(m.scene.n_leaves):
        if not on_time(i, m) and is_armed(i, phase, m, w):
            work = leaf_work(i, m)
            w[work + at.BEFORE], w[work + at.BEFORE_RATE] = state_value(i, t, y, m, w)


@stage
def may_graze(i, t, h, y, m, w):
    """Whether a condition that is unmet at both ends of a step can have been met within it. Needs attitudes of the end state ``y``.

    It does not fall at the start, and falls at the end; if both rates are known, the tangents at the ends cross beyond the threshold.
    """
    keep_apart()
    work = leaf_work(i, m)
    before, rate_before = w[work + at.BEFORE], w[work + at.BEFORE_RATE]
    after, rate_after = state_value(i, t + h, y, m, w)
    if rate_before < 0.0 or not rate_after < 0.0:
        return False
    if not rate_before > 0.0:  # at rest, or not known
        return True
    crossing = (after - before - rate_after * h) / (rate_before - rate_after)
    return before + rate_before * crossing >= 0.0


@stage
def never_let_go(phase, m, w):
    """Whether a phase other than the last is still on, or a joint still holds what it was told to let go."""
    if phase < m.scene.n_phases - 1:
        return True
    for event in range(m.scene.n_phases + m.scene.n_releases):
        for j in range(m.scene.n_joints):
            kind = _told(j, event, m)
            told = kind >= 0 and not math.isinf(w[m.scene.events_w + event])
            if told and _is_less(kind, kind_of(j, m, w), m):
                return True
    return False
