"""One generic Runge-Kutta step and its continuous extension; the method is data (methods.py)."""

from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.dynamics import derivative
from sepmc.kernels.layout import QUATERNION, RATE, STATE, VELOCITY


@stage
def first_stage(t, y, k, m, w):
    """Derivative at the start of a step, into k[0]; it serves every trial length from there. Returns the smallest pivot."""
    keep_apart()
    return derivative(t, y, k[0], m, w)


@stage
def stages(first, last, t, h, y, scratch, k, rk, m, w):
    """Stages ``first`` to ``last`` - 1 from the stages before them. Returns the smallest pivot."""
    keep_apart()
    pivot = 1.0
    for i in range(first, last):
        scratch[:] = 0.0
        for j in range(i):
            weight = rk.a[i, j]
            if weight != 0.0:
                for n in range(y.shape[0]):
                    scratch[n] += weight * k[j, n]
        for n in range(y.shape[0]):
            scratch[n] = y[n] + h * scratch[n]
        pivot = min(pivot, derivative(t + rk.c[i] * h, scratch, k[i], m, w))
    return pivot


@stage
def step(t, h, y, out, scratch, k, rk, m, w):
    """One step of length h from y at t into ``out``; stage 0 must stand in k[0]. Returns the smallest pivot."""
    keep_apart()
    count = rk.b.shape[0]
    pivot = stages(1, count, t, h, y, scratch, k, rk, m, w)
    _combine(h, rk.b, y, out, k)
    return pivot


@stage
def keep_doubt(h, bodies, guards, k, rk):
    """Largest that steps may have done wrong to velocity, attitude and rate of bodies, into the first of ``guards``; after `step`."""
    keep_apart()
    for g in range(3 * bodies):
        first = STATE * (g // 3) + (VELOCITY, QUATERNION, RATE)[g % 3]
        for n in range(first, first + (4 if g % 3 == 1 else 3)):
            doubt = 0.0
            for i in range(rk.doubt.shape[0]):
                doubt += rk.doubt[i] * k[i, n]
            guards[g] = max(guards[g], abs(h * doubt))


@stage
def extend(t, h, y, scratch, k, rk, m, w):
    """The stages that only the continuous extension needs, after `step`."""
    keep_apart()
    stages(rk.b.shape[0], rk.dense.shape[0], t, h, y, scratch, k, rk, m, w)


@stage
def interpolate(theta, h, y, out, weights, k, rk):
    """State at fraction ``theta`` of the step from y, by the continuous extension. ``weights`` is scratch."""
    keep_apart()
    for i in range(rk.dense.shape[0]):
        weight = 0.0
        for p in range(rk.dense.shape[1] - 1, -1, -1):
            weight = weight * theta + rk.dense[i, p]
        weights[i] = weight
    _combine(h, weights, y, out, k)


@stage
def extension(q, n, h, y, k, rk):
    """Coefficient of number ``n`` of the state by power ``q`` of the share of the step from y that is gone by."""
    total = 0.0
    for i in range(rk.dense.shape[0]):
        total += rk.dense[i, q] * k[i, n]
    return h * total + (y[n] if q == 0 else 0.0)


@stage
def _combine(h, weights, y, out, k):
    """y + h sum_i weights_i k_i into ``out``."""
    keep_apart()
    out[:] = 0.0
    for i in range(weights.shape[0]):
        if weights[i] != 0.0:
            for n in range(y.shape[0]):
                out[n] += weights[i] * k[i, n]
    for n in range(y.shape[0]):
        out[n] = y[n] + h * out[n]
