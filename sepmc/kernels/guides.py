"""Pins of a slider: what each carries, and the friction that follows. Pins stand on the first body and reach into the second."""

import math

from sepmc.kernels._jit import formula

LEAST_ENGAGED = 0.01  # of the engaged length when closed: pins are never counted shorter


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
def pin_loads(mouth, tip, torsion, pin, pins, circle, clock):
    """Lateral load, N, of one pin at the mouth and at its tip: an equal share, and torsion (N m) around the circle (m) of pins."""
    angle = clock + 2.0 * math.pi * pin / pins
    around = 0.5 * torsion / (pins * circle) if circle > 0.0 else 0.0
    ty, tz = -around * math.sin(angle), around * math.cos(angle)
    at_mouth = math.hypot(mouth[0] / pins + ty, mouth[1] / pins + tz)
    at_tip = math.hypot(tip[0] / pins + ty, tip[1] / pins + tz)
    return at_mouth, at_tip


@formula
def total_load(mouth, tip, torsion, pins, circle, clock):
    """Sum of the loads of all pins at mouth and tip, N: what friction acts on."""
    total = 0.0
    for pin in range(pins):
        at_mouth, at_tip = pin_loads(mouth, tip, torsion, pin, pins, circle, clock)
        total += at_mouth + at_tip
    return total


@formula
def friction_force(coefficient, load, speed, slip_speed):
    """Friction on the second body along the direction of separation, N: Coulomb's law, smooth through rest."""
    return -coefficient * load * speed / math.sqrt(speed * speed + slip_speed * slip_speed)
