"""Flow angles, and the aerodynamic force and moment of one body.

"Paper" is the source of the constraint force equations that README cites. Checked in
`tests/acceptance/test_conventions.py`.
"""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import arctan2_of_two

STILL = 1e-6  # m/s: the direction of slower air is round-off
BEHIND = 1e-12  # of the speed: a smaller offset from the axis is round-off


@formula
def flow_angles(u):
    """Angle of attack and sideslip: tan(alpha) = -v / u, sin(beta) = w / V.

    Paper eqs (10), (11), with cos(beta) = sqrt(u^2 + v^2) / V.

    Parameters
    ----------
    u : tuple of 3 float
        Air-relative velocity (u, v, w), body axes, m/s.

    Returns
    -------
    alpha : float
        rad, -pi to pi; 0 if u and v are 0.
    beta : float
        rad, -pi/2 to pi/2; 0 if all components are 0.
    """
    return arctan2_of_two(-u[1], u[0], u[2], math.sqrt(u[0] * u[0] + u[1] * u[1]))


@formula
def reported_angles(u, angles):
    """Flow angles for outcomes, NaN where they have no meaning.

    Alpha is NaN where the speed in the x-y plane of the body is below `STILL`, beta where the whole
    speed is. In flow from behind alpha is pi, never -pi, so that round-off does not change its
    sign.

    Parameters
    ----------
    u : tuple of 3 float
        Air-relative velocity, body axes, m/s.
    angles : tuple of 2 float
        Alpha and beta of `flow_angles`, rad.

    Returns
    -------
    alpha, beta : float
        rad.
    """
    along = math.sqrt(u[0] * u[0] + u[1] * u[1])
    moving = math.sqrt(along * along + u[2] * u[2])
    from_behind = abs(u[1]) < -BEHIND * u[0]
    return (
        math.nan if along < STILL else math.pi if from_behind else angles[0],
        math.nan if moving < STILL else angles[1],
    )


@formula
def aero_force(qs, c):
    """Aerodynamic force q S (-C_A, C_N, -C_Y).

    Parameters
    ----------
    qs : float
        Dynamic pressure times reference area, N.
    c : sequence of float
        Coefficients; the first three are C_A (axial), C_N (normal) and C_Y (side).

    Returns
    -------
    tuple of 3 float
        Force, body axes, N.
    """
    return (-qs * c[0], qs * c[1], -qs * c[2])


@formula
def aero_moment(qsl, c):
    """Aerodynamic moment q S L (C_l, -C_n, C_m).

    Parameters
    ----------
    qsl : float
        Dynamic pressure times reference area and length, N m.
    c : tuple of 3 float
        Coefficients C_l (roll), C_n (yaw), C_m (pitch).

    Returns
    -------
    tuple of 3 float
        Moment, body axes, N m.
    """
    return (qsl * c[0], -qsl * c[1], qsl * c[2])
