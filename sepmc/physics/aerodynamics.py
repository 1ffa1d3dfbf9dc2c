"""Angles of the flow, and the aerodynamic force and moment of one body."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import arctan2_of_two

STILL = 1e-6  # m/s: slower air has no direction that could be told from round-off
BEHIND = 1e-12  # of the speed: what is further off the axis is no round-off


@formula
def flow_angles(u):
    """Angle of attack and sideslip, rad, from the air-relative velocity in body axes; paper eqs
    (10), (11).

    sin(beta) = w / V, cos(beta) = sqrt(u^2 + v^2) / V.
    """
    return arctan2_of_two(-u[1], u[0], u[2], math.sqrt(u[0] * u[0] + u[1] * u[1]))


@formula
def reported_angles(u, angles):
    """Angle of attack and sideslip as they are told, given the air-relative velocity in body axes:
    none where the air is still, no angle of attack where it moves across the plane of symmetry
    only; with air from right behind, pi, not pi of the sign of a round-off."""
    along = math.sqrt(u[0] * u[0] + u[1] * u[1])
    moving = math.sqrt(along * along + u[2] * u[2])
    behind = abs(u[1]) < -BEHIND * u[0]
    return (
        math.nan if along < STILL else math.pi if behind else angles[0],
        math.nan if moving < STILL else angles[1],
    )


@formula
def aero_force(qs, c):
    """Force in body axes, N, from dynamic pressure x area (N) and C_A, C_N, C_Y: q S (-C_A, C_N,
    -C_Y)."""
    return (-qs * c[0], qs * c[1], -qs * c[2])


@formula
def aero_moment(qsl, c):
    """Moment in body axes, N m, from q S L (N m) and C_l, C_n, C_m: q S L (C_l, -C_n, C_m)."""
    return (qsl * c[0], -qsl * c[1], qsl * c[2])
