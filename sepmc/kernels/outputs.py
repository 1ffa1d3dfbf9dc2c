"""What is watched over a whole flight, if asked for: joint loads, pin loads and jamming, clearance; peaks, their times, impulses."""

import math

import numpy as np

from sepmc.kernels import guides as pins
from sepmc.kernels import layout as at
from sepmc.kernels import quat, vec3
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.cfe import solve_motion
from sepmc.kernels.clearances import watch_clearance
from sepmc.kernels.dynamics import guide_bearing, guide_wrench, motion, slides
from sepmc.kernels.observe import joint_outcomes_at
from sepmc.kernels.places import body_params, first_body, joint_axes_x, joint_params, joint_work, kind_of, second_body
from sepmc.kernels.rk import extension, interpolate

# Gauss-Lobatto nodes and weights on a step, exact to degree 7 (Abramowitz and Stegun, 25.4.32).
NODES = 5
_THETA = (0.0, 0.5 - 0.5 * math.sqrt(3.0 / 7.0), 0.5, 0.5 + 0.5 * math.sqrt(3.0 / 7.0), 1.0)
_WEIGHT = (0.05, 49.0 / 180.0, 16.0 / 45.0, 49.0 / 180.0, 0.05)
# Slope at the first node of the quartic through all five.
_SLOPE = (
    sum(-1.0 / x for x in _THETA[1:]),
    *(math.prod(-x for x in _THETA[1:] if x != y) / math.prod(y - x for x in _THETA if x != y) for y in _THETA[1:]),
)
# Coefficient of the fourth Chebyshev polynomial in that quartic.
_FOURTH = tuple(1.0 / (128.0 * math.prod(x - y for y in _THETA if y != x)) for x in _THETA)
_DIP = 0.7  # least over greatest size of a load at the nodes: below, it may turn sharply between them
# What halving an interval may change of an integral: of the peak so far, and, for round-off, of that of force or moment (N, N m).
_AGREE, _NOISE, _HALVINGS = 1e-11, 1e-12, 40
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_ROUNDS = 36  # of golden section: a bracket of half a step shrinks by 3e-8, a smooth peak is then known to round-off


@stage
def watches(m):
    """Whether anything is watched."""
    return m.scene.n_load_outputs + m.scene.n_guides + m.scene.n_clearances > 0


@stage
def row_size(m):
    """Numbers a row of watched quantities holds: force and moment per joint; pins and jamming per guide."""
    size = 2 * m.scene.n_load_outputs
    for g in range(m.scene.n_guides):
        size += m.table[m.scene.pins_i + m.table[m.scene.guides_i + g]] + 1
    return size


@stage
def _norm(w, k):
    v = vec3.get(w, k)
    return math.sqrt(vec3.dot(v, v))


@stage
def _guide_row(y, j, row, k, m, w):
    """Load of each pin, N, and minus the coefficient of friction at which they would hold joint j, from row[k] on."""
    p, count = joint_params(j, m), m.table[m.scene.pins_i + j]
    if not slides(j, m, w):
        for i in range(count + 1):
            row[k + i] = -math.inf
        return
    mouth, tip, torsion, _ = guide_bearing(y, j, m, w)
    for i in range(count):
        at_mouth, at_tip = pins.pin_loads(mouth, tip, torsion, i, count, w[p + at.CIRCLE], w[p + at.PIN_CLOCK])
        row[k + i] = max(at_mouth, at_tip)
    # what would hold the joint along x, less friction, is what drives it apart; if friction does, pins carry what they do then
    work = joint_work(j, m)
    kind = w[work + at.KIND]
    w[work + at.KIND] = m.table[m.scene.held_along_i + kind_of(j, m, w)]
    solve_motion(y, m, w)
    drive = max(0.0, -m.numbers[joint_axes_x(j) + 9] * guide_wrench(j, m, w)[0][0] - w[work + at.FRICTION_FORCE])
    total = guide_bearing(y, j, m, w)[3]
    w[work + at.KIND] = kind
    solve_motion(y, m, w)
    row[k + count] = -drive / total if total > 0.0 else -math.inf


@stage
def watched_at(m):
    """Start of the outcomes of watched quantities: joint loads, guides, clearances; tip-off rates follow."""
    return joint_outcomes_at(m.scene.n_joints, m)


@stage
def clearances_at(m):
    """Start of the outcomes of clearances."""
    o = watched_at(m) + m.scene.n_load_outputs * at.LOADS_OUTCOMES
    for g in range(m.scene.n_guides):
        o += m.table[m.scene.pins_i + m.table[m.scene.guides_i + g]] + 2
    return o


@stage
def counts(i, m, w):
    """Whether clearance ``i`` is counted yet: from the start, or once its joint is free."""
    after = m.table[m.scene.clearances_i + 3 * i + 2]
    return after < 0 or kind_of(after, m, w) == at.FREE


@stage
def watch(t, y, row, m, w):
    """All watched quantities of a state into ``row``, each such that its peak is its greatest value; clearances apart."""
    keep_apart()
    motion(t, y, m, w)
    k = 0
    for i in range(m.scene.n_load_outputs):
        work = joint_work(m.table[m.scene.load_outputs_i + i], m)
        row[k], row[k + 1] = _norm(w, work + at.FORCE_B), _norm(w, work + at.MOMENT_B)
        k += 2
    for g in range(m.scene.n_guides):
        j = m.table[m.scene.guides_i + g]
        _guide_row(y, j, row, k, m, w)
        k += m.table[m.scene.pins_i + j] + 1


@stage
def start_watching(outcomes, m):
    """Nothing seen yet."""
    o = watched_at(m)
    for _ in range(m.scene.n_load_outputs):
        outcomes[o], outcomes[o + 2], outcomes[o + 3], outcomes[o + 5] = 0.0, 0.0, 0.0, 0.0
        o += at.LOADS_OUTCOMES
    for g in range(m.scene.n_guides):
        outcomes[o] = 0.0
        o += m.table[m.scene.pins_i + m.table[m.scene.guides_i + g]] + 2


@stage
def _keep(t, row, outcomes, m):
    """Take over from a row of watched quantities what is greater than before."""
    keep_apart()
    o, k = watched_at(m), 0
    for _ in range(m.scene.n_load_outputs):
        for part in range(2):
            if not row[k + part] <= outcomes[o + 3 * part]:
                outcomes[o + 3 * part], outcomes[o + 3 * part + 1] = row[k + part], t
        o += at.LOADS_OUTCOMES
        k += 2
    for g in range(m.scene.n_guides):
        o += 1
        count = m.table[m.scene.pins_i + m.table[m.scene.guides_i + g]]
        for i in range(count):
            if row[k + i] > -math.inf and not row[k + i] <= outcomes[o + i]:
                outcomes[o + i] = row[k + i]
        if row[k + count] > -math.inf and not -row[k + count] >= outcomes[o + count]:
            outcomes[o + count] = -row[k + count]
        o += count + 1
        k += count + 1


@stage
def _state_at(theta, h, y0, sample, weights, k, rk, m):
    """State at a fraction of the step, quaternions of unit length."""
    interpolate(theta, h, y0, sample, weights, k, rk)
    quat.normalise_all(sample, m.scene.n_bodies)


@stage
def _refine(c, low, high, t, h, y0, sample, weights, k, rk, row, outcomes, m, w):
    """Find the peak of column ``c`` between two fractions of the step by golden section, and keep what is seen."""
    keep_apart()
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    _state_at(a, h, y0, sample, weights, k, rk, m)
    watch(t + a * h, sample, row, m, w)
    fa = row[c]
    _state_at(b, h, y0, sample, weights, k, rk, m)
    watch(t + b * h, sample, row, m, w)
    fb = row[c]
    for _ in range(_ROUNDS):
        if fa >= fb:
            high, b, fb = b, a, fa
            a = high - GOLDEN * (high - low)
            theta = a
        else:
            low, a, fa = a, b, fb
            b = low + GOLDEN * (high - low)
            theta = b
        _state_at(theta, h, y0, sample, weights, k, rk, m)
        watch(t + theta * h, sample, row, m, w)
        if theta == a:
            fa = row[c]
        else:
            fb = row[c]
    _keep(t + theta * h, row, outcomes, m)


@stage
def _rises(f0, f1, f2, f3, f4):
    """Whether the quartic through the values at the nodes, of which f0 is not below f1, still rises at the first: its peak lies beyond."""
    return f0 >= f1 and _SLOPE[0] * f0 + _SLOPE[1] * f1 + _SLOPE[2] * f2 + _SLOPE[3] * f3 + _SLOPE[4] * f4 > 0.0


@stage
def _quadrature(c, rows):
    """Mean of column ``c`` over the interval that the nodes lie in."""
    total = 0.0
    for i in range(NODES):
        total += _WEIGHT[i] * rows[i, c]
    return total


@stage
def _is_rough(c, floor, rows):
    """Whether column ``c``, the size of a vector that is not as good as nothing, may have an integral that the nodes do not give to
    ``floor``: it comes near to zero and may turn sharply there, or its Chebyshev coefficients do not fall fast (the eighth, which the
    quadrature leaves out, is about the fourth squared)."""
    least, greatest, fourth = rows[0, c], rows[0, c], 0.0
    for i in range(NODES):
        least, greatest, fourth = min(least, rows[i, c]), max(greatest, rows[i, c]), fourth + _FOURTH[i] * rows[i, c]
    return greatest > 1e3 * floor and (least < _DIP * greatest or fourth * fourth > floor * greatest)


@stage
def _mean(c, low, high, t, h, y0, sample, weights, k, rk, rows, m, w):
    """Mean of column ``c`` between two fractions of the step."""
    keep_apart()
    for i in range(NODES):
        theta = low + _THETA[i] * (high - low)
        _state_at(theta, h, y0, sample, weights, k, rk, m)
        watch(t + theta * h, sample, rows[i], m, w)
    return _quadrature(c, rows)


@stage
def _integral(c, whole, floor, t, h, y0, sample, weights, k, rk, m, w):
    """Mean of column ``c`` over the step: each interval is halved until its halves agree with it to ``floor``. A corner takes fifteen
    halvings; there are _HALVINGS at most."""
    keep_apart()
    rows = np.empty((NODES, row_size(m)))
    total, low, width, before, left = 0.0, 0.0, 1.0, whole, _HALVINGS
    while low < 1.0:
        first = _mean(c, low, low + 0.5 * width, t, h, y0, sample, weights, k, rk, rows, m, w)
        second = _mean(c, low + 0.5 * width, low + width, t, h, y0, sample, weights, k, rk, rows, m, w)
        if left > 0 and width > 2.0**-15 and not abs(0.5 * (first + second) - before) * width <= floor:
            width, before, left = 0.5 * width, first, left - 1
            continue
        total += 0.5 * width * (first + second)
        low += width
        while width < 1.0 and low % (2.0 * width) == 0.0:
            width *= 2.0
        if low < 1.0:
            before = _mean(c, low, low + width, t, h, y0, sample, weights, k, rk, rows, m, w)
    return total


@stage
def watch_step(t, h, y0, sample, weights, k, rk, rows, outcomes, m, w):
    """Watch a step from y0 whose continuous extension is ready: peaks with their times, impulses, clearances.

    ``rows`` (NODES + 1, n) is scratch. What the joints hold must not have changed within the step.
    """
    keep_apart()
    if row_size(m) > 0:
        _watch_loads(t, h, y0, sample, weights, k, rk, rows, outcomes, m, w)
    for i in range(m.scene.n_clearances):
        if counts(i, m, w):
            _watch_clearance(i, t, h, y0, k, rk, outcomes, m, w)


@stage
def _watch_clearance(i, t, h, y0, k, rk, outcomes, m, w):
    """Clearance ``i`` over a step."""
    keep_apart()
    first, entry = clearances_at(m) + at.CLEARANCE_OUTCOMES * i, m.scene.clearances_i + 3 * i
    a, b = m.table[entry], m.table[entry + 1]
    path = np.empty((rk.dense.shape[1], at.PATH))
    for n in range(at.PATH):
        for q in range(path.shape[0]):
            if n < 3:
                n_a, n_b = a * at.STATE + at.POSITION + n, b * at.STATE + at.POSITION + n
                path[q, n] = extension(q, n_b, h, y0, k, rk) - extension(q, n_a, h, y0, k, rk)
            else:
                body = a if n < 7 else b
                path[q, n] = extension(q, body * at.STATE + at.QUATERNION + (n - 3) % 4, h, y0, k, rk)
    p_a, p_b = m.scene.parts_i + 2 * a, m.scene.parts_i + 2 * b
    parts_a, parts_b = (m.table[p_a], m.table[p_a + 1]), (m.table[p_b], m.table[p_b + 1])
    cg_a, cg_b = vec3.get(w, body_params(a) + at.CG), vec3.get(w, body_params(b) + at.CG)
    if not watch_clearance(parts_a, parts_b, cg_a, cg_b, m.numbers, t, h, path, outcomes[first : first + at.CLEARANCE_OUTCOMES]):
        w[m.scene.work + at.UNSEARCHED] = 1.0


@stage
def _watch_loads(t, h, y0, sample, weights, k, rk, rows, outcomes, m, w):
    """Peaks of what joints and guides carry, with their times, and impulses."""
    keep_apart()
    for i in range(NODES):
        _state_at(_THETA[i], h, y0, sample, weights, k, rk, m)
        watch(t + _THETA[i] * h, sample, rows[i], m, w)
        _keep(t + _THETA[i] * h, rows[i], outcomes, m)
    o, c = watched_at(m), 0
    for _ in range(m.scene.n_load_outputs):
        for part in range(2):
            total = _quadrature(c, rows)
            floor = _AGREE * outcomes[o + 3 * part] + _NOISE * max(outcomes[o], outcomes[o + 3])
            if _is_rough(c, floor, rows):
                total = _integral(c, total, floor, t, h, y0, sample, weights, k, rk, m, w)
            outcomes[o + 3 * part + 2] += h * total
            c += 1
        o += at.LOADS_OUTCOMES
    for g in range(m.scene.n_guides):
        j = m.table[m.scene.guides_i + g]
        if slides(j, m, w):
            outcomes[o] += h
        o += m.table[m.scene.pins_i + j] + 2
    for c in range(row_size(m)):
        for i in range(1, NODES - 1):
            if rows[i, c] > rows[i - 1, c] and rows[i, c] >= rows[i + 1, c]:
                _refine(c, _THETA[i - 1], _THETA[i + 1], t, h, y0, sample, weights, k, rk, rows[NODES], outcomes, m, w)
        f0, f1, f2, f3, f4 = rows[0, c], rows[1, c], rows[2, c], rows[3, c], rows[4, c]
        if _rises(f0, f1, f2, f3, f4):
            _refine(c, 0.0, _THETA[1], t, h, y0, sample, weights, k, rk, rows[NODES], outcomes, m, w)
        if _rises(f4, f3, f2, f1, f0):
            _refine(c, _THETA[NODES - 2], 1.0, t, h, y0, sample, weights, k, rk, rows[NODES], outcomes, m, w)


@stage
def note_tip_off(j, y, outcomes, m, w):
    """Rates of both bodies of joint j, which has just become free, if they are asked for."""
    o = clearances_at(m) + m.scene.n_clearances * at.CLEARANCE_OUTCOMES
    for i in range(m.scene.n_tip_off):
        asked = m.table[m.scene.tip_off_i + i]
        for b in (first_body(asked, m), second_body(asked, m)):
            if b != m.scene.ground:
                if asked == j:
                    vec3.put(outcomes, o, vec3.get(y, b * at.STATE + at.RATE))
                o += 3
