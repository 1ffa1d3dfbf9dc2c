"""Layers of the standard atmosphere: a step ends where a body passes from one to the next, since temperature has a corner there."""

import math

from sepmc.kernels import layout as at
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.atmosphere import geopotential, layer
from sepmc.kernels.dynamics import height
from sepmc.kernels.places import body_params, body_work
from sepmc.kernels.quat import normalise_all
from sepmc.kernels.rk import step

_ROOT = 1e-13  # s: a border is located when the next correction is below this
_BORDER = 1e-6  # m', on both sides of a border: which layer a body that is there flies in follows from where it goes
_ROUNDS = 100


@stage
def _flies(b, m, w):
    """Whether body b has aerodynamics in the standard atmosphere."""
    return m.scene.atmosphere == at.US1976 and b != m.scene.ground and w[body_params(b) + at.AREA] > 0.0


@stage
def _climb(y, b, m, w):
    return y[b * at.STATE + at.VELOCITY + 1] + w[m.scene.work + at.ORIGIN_VELOCITY + 1]


@stage
def enter_layer(altitude, b, m, w):
    """Let body b fly in the layer of a height from now on."""
    base, top = layer(altitude)
    k = body_work(b, m) + at.LAYER
    w[k], w[k + 1], w[k + 2], w[k + 3] = base
    w[body_work(b, m) + at.LAYER_TOP] = top


@stage
def set_layers(t, y, m, w):
    """Layers at the start of a flight; on a border, the one that a body is going to."""
    keep_apart()
    for b in range(m.scene.n_bodies):
        if _flies(b, m, w):
            enter_layer(height(t, y, b, m, w) + (_BORDER if _climb(y, b, m, w) >= 0.0 else -_BORDER), b, m, w)


@stage
def _beyond(t, y, b, m, w):
    """How far body b is above its layer, m' (positive), or below it (negative); 0 within."""
    k = body_work(b, m)
    h = geopotential(height(t, y, b, m, w))
    if h > w[k + at.LAYER_TOP] + _BORDER:
        return h - w[k + at.LAYER_TOP]
    return h - w[k + at.LAYER] if h < w[k + at.LAYER] - _BORDER else 0.0


@stage
def _fly_to(t, length, y0, y1, scratch, k, rk, m, w):
    step(t, length, y0, y1, scratch, k, rk, m, w)
    normalise_all(y1, m.scene.n_bodies)


@stage
def _turn(h, y0, y1, b, m, w):
    """When in a step of length h body b turns from climbing to falling or back, s from its start; h if it does not."""
    first, last = _climb(y0, b, m, w), _climb(y1, b, m, w)
    return h * first / (first - last) if first * last < 0.0 else h


@stage
def _locate(side, border, t, high, y0, y1, scratch, k, rk, b, m, w):
    """Length of the step from y0 at which body b passes a border, before ``high``, beyond it; its state in y1."""
    keep_apart()
    low, length = 0.0, high
    for _ in range(_ROUNDS):
        value = side * (geopotential(height(t + length, y1, b, m, w)) - border)
        rate = side * _climb(y1, b, m, w)
        if value >= 0.0:
            high = min(high, length)
        else:
            low = max(low, length)
        trial = length - value / rate if rate > 0.0 else 0.5 * (low + high)
        if abs(trial - length) <= _ROOT or high - low <= _ROOT:
            break
        length = trial if low < trial < high else 0.5 * (low + high)
        _fly_to(t, length, y0, y1, scratch, k, rk, m, w)
    return length


@stage
def stop_at_layer(t, h, y0, y1, scratch, k, rk, m, w):
    """Shorten a step to where a body first leaves its layer. y1 holds the state at its end, before and after.

    Returns its length, that body (-1 if none does), and a height in the layer that it comes to.
    """
    keep_apart()
    length, leaves, into = h, -1, 0.0
    for b in range(m.scene.n_bodies):
        if not _flies(b, m, w):
            continue
        far, end = _beyond(t + length, y1, b, m, w), length
        if far == 0.0:
            end = _turn(length, y0, y1, b, m, w)
            if end < length:
                _fly_to(t, end, y0, y1, scratch, k, rk, m, w)
                far = _beyond(t + end, y1, b, m, w)
        if far != 0.0:
            side = math.copysign(1.0, far)
            border = geopotential(height(t + end, y1, b, m, w)) - far
            length = _locate(side, border, t, end, y0, y1, scratch, k, rk, b, m, w)
            leaves, into = b, height(t + length, y1, b, m, w) + 2.0 * side * _BORDER
        elif end < length:
            _fly_to(t, length, y0, y1, scratch, k, rk, m, w)
    return length, leaves, into
