"""Gravity over a flat ground: along -y, constant or with the inverse square of the distance to the
earth's centre."""

from sepmc.jit import formula
from sepmc.physics.us1976_table import R0


@formula
def inverse_square(surface, height):
    """Acceleration g0 (R0 / (R0 + z))^2, with R0 = 6356766 m; eq (17) of the 1976 standard.

    Parameters
    ----------
    surface : float
        g0, acceleration at the ground, m/s2.
    height : float
        z, m.

    Returns
    -------
    float
        Downward, m/s2.
    """
    ratio = R0 / (R0 + height)
    return surface * ratio * ratio


@formula
def inverse_square_near(acceleration, fraction):
    """Acceleration after a small rise from the height h: the series of g / (1 + s)^2 to s^3.

    Parameters
    ----------
    acceleration : float
        g at the height h, m/s2.
    fraction : float
        s, rise divided by the distance R0 + h from the earth's centre.

    Returns
    -------
    float
        Downward, m/s2; relative error 1e-16 for a rise of `atmosphere.NEAR` metres.
    """
    return acceleration * (1.0 - fraction * (2.0 - fraction * (3.0 - 4.0 * fraction)))
