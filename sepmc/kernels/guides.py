"""Pins of a slider: what each carries, and the friction that follows. Pins stand on the first body and reach into the second."""

import math

from sepmc.kernels._jit import formula, keep_apart, stage
from sepmc.kernels.elementary import sine_cosine
from sepmc.kernels.lanes import LANES

_SETTLED = 1e-13  # of a friction force: what another round may change
_ROUNDS, _TURNS = 40, 100  # of Newton's method for a guide; of all guides in turn


@formula
def bearing_forces(force, moment, engaged, toward):
    """Lateral forces (y, z), N, that all pins together carry at the mouth of the holes and at the tips of the pins.

    force, moment : N, N m on the second body at its joint point (the mouth), joint axes.
    engaged : m, length of pin in the hole; toward : 1 or -1, side along x on which the second body lies.
    Force and moment balance about the middle of the engaged length: N = F / 2 -+ (M x u) / engaged, u = toward x.
    """
    # moment about the middle: M - (engaged / 2) u x F, of which only y and z bend the pins
    my = moment[1] + 0.5 * engaged * toward * force[2]
    mz = moment[2] - 0.5 * engaged * toward * force[1]
    # (M x u) / engaged, with u = (toward, 0, 0): (M x u)_y = mz toward, (M x u)_z = -my toward
    ty, tz = toward * mz / engaged, -toward * my / engaged
    return (0.5 * force[1] - ty, 0.5 * force[2] - tz), (0.5 * force[1] + ty, 0.5 * force[2] + tz)


@formula
def around_circle(pin, pins, circle, clock):
    """What torsion of 1 N m does to one pin at either end, (y, z), N: equal forces around the circle (m) of pins, at mouth and tips."""
    sine, cosine = sine_cosine(clock + 2.0 * math.pi * pin / pins)
    share = 0.5 / (pins * circle) if circle > 0.0 else 0.0
    return -share * sine, share * cosine


@formula
def pin_force(end, torsion, around, pins):
    """Lateral force (y, z), N, of one pin at an end: an equal share of what all carry there, and torsion (N m) around the circle."""
    return end[0] / pins + torsion * around[0], end[1] / pins + torsion * around[1]


@formula
def pin_loads(mouth, tip, torsion, pin, pins, circle, clock):
    """Lateral load, N, of one pin at the mouth and at its tip."""
    around = around_circle(pin, pins, circle, clock)
    at_mouth, at_tip = pin_force(mouth, torsion, around, pins), pin_force(tip, torsion, around, pins)
    return math.hypot(at_mouth[0], at_mouth[1]), math.hypot(at_tip[0], at_tip[1])


@formula
def friction_force(coefficient, load, speed, slip_speed):
    """Friction on the second body along the direction of separation, N: Coulomb's law, smooth through rest."""
    return -coefficient * load * speed / math.sqrt(speed * speed + slip_speed * slip_speed)


@stage
def balance(w, place, ends, out):
    """Friction of guides, N, that is in balance with the loads of pins it changes itself, into ``out``. Returns whether there is any: if
    not, a guide jams.

    place : where lanes hold, of guide after guide, its friction per newton of load, and of each of its ``ends`` of pins the force there
        without friction and what each guide's friction, 1 N of it, adds: pairs (y, z)
    Loads are convex in a friction force, so that Newton's method from none on comes to the smallest balance; guides take turns.
    """
    keep_apart()
    count = len(ends)
    for j in range(count):
        w[out + j * LANES] = 0.0
    for _ in range(_TURNS):
        settled, start = True, place
        for j in range(count):
            before = w[out + j * LANES]
            load = _settle_one(w, start, ends[j], j, count, out)
            if load < 0.0:
                return False
            settled = settled and not abs(w[out + j * LANES] - before) > _SETTLED * abs(w[start]) * load
            start += (1 + ends[j] * (2 + 2 * count)) * LANES
        if settled:
            return True
    return False


@stage
def _settle_one(w, start, ends, j, count, out):
    """Friction of guide ``j`` while that of the others stays. Returns the load of its pins, N; -1 if it jams."""
    keep_apart()
    share, now = w[start], out + j * LANES
    for _ in range(_ROUNDS):
        load, slope = 0.0, 0.0
        for end in range(ends):
            k = start + (1 + end * (2 + 2 * count)) * LANES
            y, z = w[k], w[k + LANES]
            for i in range(count):
                y += w[out + i * LANES] * w[k + (2 + 2 * i) * LANES]
                z += w[out + i * LANES] * w[k + (3 + 2 * i) * LANES]
            size = math.sqrt(y * y + z * z)
            load += size
            if size > 0.0:
                slope += (y * w[k + (2 + 2 * j) * LANES] + z * w[k + (3 + 2 * j) * LANES]) / size
        if not 1.0 - share * slope > 0.0:
            return -1.0
        change = (share * load - w[now]) / (1.0 - share * slope)
        w[now] += change
        if not abs(change) > _SETTLED * abs(share) * load:
            return load
    return -1.0
