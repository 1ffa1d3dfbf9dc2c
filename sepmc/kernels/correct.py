"""How far constraints have drifted, and bringing a state back onto them."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels import vec3
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.cfe import build_rows, clear_wrenches, held_rows, is_translation, solve_reduced
from sepmc.kernels.dynamics import set_attitudes
from sepmc.kernels.places import body_work, row_work
from sepmc.kernels.quat import normalise_all, rate

_DRIFT = 1e-12  # m, rad, m/s, rad/s: constraints further off are corrected


@stage
def _largest(rows, m, w):
    """Largest violations of the rows in w: translations, m, rotations, rad, and their rates."""
    gap, angle, gap_rate, angle_rate = 0.0, 0.0, 0.0, 0.0
    for r in range(rows):
        row = row_work(r, m)
        value, speed = abs(w[row + at.ROW_VALUE]), abs(w[row + at.ROW_RATE])
        if is_translation(row, w):
            gap, gap_rate = max(gap, value), max(gap_rate, speed)
        else:
            angle, angle_rate = max(angle, value), max(angle_rate, speed)
    return gap, angle, gap_rate, angle_rate


@stage
def residuals(y, m, w):
    """Largest violation of the constraints that hold now: translations, m, rotations, rad, and their rates. Needs attitudes."""
    keep_apart()
    if held_rows(m, w) == 0:
        return 0.0, 0.0, 0.0, 0.0
    return _largest(build_rows(y, m, w), m, w)


@stage
def _shift(rows, what, m, w):
    """M^-1 G^T lambda with G M^-1 G^T lambda = -C or -C': least correction, weighted by mass; left where accelerations stand."""
    keep_apart()
    for b in range(m.scene.n_bodies):
        for i in range(6):
            w[body_work(b, m) + at.ACCEL + i] = 0.0
    for r in range(rows):
        w[row_work(r, m) + at.ROW_GAMMA] = -w[row_work(r, m) + what]
    clear_wrenches(m, w)
    solve_reduced(rows, m, w)


@stage
def project(y, m, w):
    """Bring positions and attitudes, then velocities and rates, back onto the constraints that hold now. Needs attitudes."""
    keep_apart()
    _shift(build_rows(y, m, w), at.ROW_VALUE, m, w)
    for b in range(m.scene.n_bodies):
        k, work = b * at.STATE, body_work(b, m)
        q = k + at.QUATERNION
        vec3.put(y, k + at.POSITION, vec3.add(vec3.get(y, k + at.POSITION), vec3.get(w, work + at.ACCEL)))
        turn = rate((y[q], y[q + 1], y[q + 2], y[q + 3]), vec3.get(w, work + at.ACCEL + 3))
        for i in range(4):
            y[q + i] += turn[i]
    normalise_all(y, m.scene.n_bodies)
    set_attitudes(y, m, w)
    _shift(build_rows(y, m, w), at.ROW_RATE, m, w)
    for b in range(m.scene.n_bodies):
        k, work = b * at.STATE, body_work(b, m)
        vec3.put(y, k + at.VELOCITY, vec3.add(vec3.get(y, k + at.VELOCITY), vec3.get(w, work + at.ACCEL)))
        vec3.put(y, k + at.RATE, vec3.add(vec3.get(y, k + at.RATE), vec3.get(w, work + at.ACCEL + 3)))


@stage
def hold(y, audit, m, w):
    """At the end of a step: correct what has drifted, if that is wanted, and note the largest violation left. Needs attitudes."""
    keep_apart()
    found = residuals(y, m, w)
    if m.scene.drift == at.PROJECTION and max(found[0], found[1], found[2], found[3]) > _DRIFT:
        project(y, m, w)
        found = residuals(y, m, w)
    for i in range(4):
        if math.isnan(found[i]) or found[i] > audit[at.GAP_AUDIT + i]:
            audit[at.GAP_AUDIT + i] = found[i]
