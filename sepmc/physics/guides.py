"""Pins of a slider: what each carries, and the friction that follows. Pins stand on the first body
and reach into the second."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import sine_cosine


@formula
def bearing_forces(force, moment, engaged, toward):
    """Lateral forces (y, z), N, that all pins together carry at the mouth of the holes and at the
    tips of the pins.

    force, moment : N, N m on the second body at its joint point (the mouth), joint axes.
    engaged : m, length of pin in the hole; toward : 1 or -1, side along x on which the second body
    lies. Force and moment balance about the middle of the engaged length: N = F / 2 -+ (M x u) /
    engaged, u = toward x.
    """
    # moment about the middle: M - (engaged / 2) u x F, of which only y and z bend the pins
    my = moment[1] + 0.5 * engaged * toward * force[2]
    mz = moment[2] - 0.5 * engaged * toward * force[1]
    # (M x u) / engaged, with u = (toward, 0, 0): (M x u)_y = mz toward, (M x u)_z = -my toward
    ty, tz = toward * mz / engaged, -toward * my / engaged
    return (0.5 * force[1] - ty, 0.5 * force[2] - tz), (0.5 * force[1] + ty, 0.5 * force[2] + tz)


@formula
def around_circle(pin, pins, circle, clock):
    """What torsion of 1 N m does to one pin at either end, (y, z), N: equal forces around the
    circle (m) of pins, at mouth and tips."""
    sine, cosine = sine_cosine(clock + 2.0 * math.pi * pin / pins)
    share = 0.5 / (pins * circle) if circle > 0.0 else 0.0
    return -share * sine, share * cosine


@formula
def pin_force(end, torsion, around, pins):
    """Lateral force (y, z), N, of one pin at an end: an equal share of what all carry there, and
    torsion (N m) around the circle."""
    return end[0] / pins + torsion * around[0], end[1] / pins + torsion * around[1]


@formula
def pin_loads(mouth, tip, torsion, pin, pins, circle, clock):
    """Lateral load, N, of one pin at the mouth and at its tip."""
    around = around_circle(pin, pins, circle, clock)
    at_mouth, at_tip = (
        pin_force(mouth, torsion, around, pins),
        pin_force(tip, torsion, around, pins),
    )
    return math.hypot(at_mouth[0], at_mouth[1]), math.hypot(at_tip[0], at_tip[1])


@formula
def friction_force(coefficient, load, speed, slip_speed):
    """Friction on the second body along the direction of separation, N: Coulomb's law, smooth
    through rest."""
    return -coefficient * load * speed / math.sqrt(speed * speed + slip_speed * slip_speed)
