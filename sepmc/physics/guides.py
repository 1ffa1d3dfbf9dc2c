"""Loads and friction of the pins of a slider. Pins are fixed to the first body and reach into holes
of the second."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import sine_cosine


@formula
def bearing_forces(force, moment, engaged, toward):
    """Lateral forces that all pins together exert on the second body, at the hole entry and at the
    pin tips.

    N = F / 2 -+ (M x u) / engaged (- at the entry, + at the tips), u = toward x. This is the
    balance of forces, and of moments about the middle of the engaged length.

    Parameters
    ----------
    force, moment : tuple of 3 float
        Force and moment of the joint on the second body at its joint point (the hole entry), joint
        axes, N and N m.
    engaged : float
        Length of pin in the hole, m, > 0.
    toward : float
        1 or -1: side along x on which the second body lies.

    Returns
    -------
    entry, tip : tuple of 2 float
        Components (y, z), N.
    """
    # moment about the middle: M - (engaged / 2) u x F, of which only y and z bend the pins
    my = moment[1] + 0.5 * engaged * toward * force[2]
    mz = moment[2] - 0.5 * engaged * toward * force[1]
    # (M x u) / engaged, with u = (toward, 0, 0): (M x u)_y = mz toward, (M x u)_z = -my toward
    ty, tz = toward * mz / engaged, -toward * my / engaged
    return (0.5 * force[1] - ty, 0.5 * force[2] - tz), (0.5 * force[1] + ty, 0.5 * force[2] + tz)


@formula
def around_circle(pin, pins, circle, clock):
    """Lateral force of one pin on the second body, at one of its ends (hole entry or tip), for a
    torsion (moment on the second body about the joint's x axis) of 1 N m.

    All pins carry equal forces, tangential to the circle on which they stand: half at the hole
    entries, half at the tips.

    Parameters
    ----------
    pin, pins : int
        Number of the pin, from 0; number of pins.
    circle : float
        Radius of the circle of pins, m; 0: no torsion is carried.
    clock : float
        Angle of pin 0 from the joint's y axis toward z, rad.

    Returns
    -------
    tuple of 2 float
        Components (y, z), N per N m.
    """
    sine, cosine = sine_cosine(clock + 2.0 * math.pi * pin / pins)
    force = 0.5 / (pins * circle) if circle > 0.0 else 0.0
    return -force * sine, force * cosine


@formula
def pin_force(end, torsion, around, pins):
    """Lateral force of one pin on the second body, at one of its ends (hole entry or tip):
    end / pins + torsion around.

    Parameters
    ----------
    end : tuple of 2 float
        Force of all pins together at that end, from `bearing_forces`, N.
    torsion : float
        Moment of the joint on the second body about its x axis, N m.
    around : tuple of 2 float
        Force of this pin for a torsion of 1 N m, from `around_circle`, N per N m.
    pins : int
        Number of pins.

    Returns
    -------
    tuple of 2 float
        Components (y, z), N.
    """
    return end[0] / pins + torsion * around[0], end[1] / pins + torsion * around[1]


@formula
def friction_force(coefficient, load, speed, slip_speed):
    """Coulomb friction -mu N v / sqrt(v^2 + v_s^2), smooth through rest.

    Parameters
    ----------
    coefficient : float
        mu.
    load : float
        N, normal force, N.
    speed : float
        v, separation speed, m/s.
    slip_speed : float
        v_s, m/s, > 0.

    Returns
    -------
    float
        On the second body along the direction of separation, N.
    """
    return -coefficient * load * speed / math.sqrt(speed * speed + slip_speed * slip_speed)
