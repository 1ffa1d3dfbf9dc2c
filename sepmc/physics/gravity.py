"""Gravity over a flat ground: along -y, constant or falling with the inverse square of the distance
to the centre."""

from sepmc.jit import formula
from sepmc.physics.us1976_table import R0


@formula
def inverse_square(surface, height):
    """Acceleration downward, m/s2: ``surface`` at the ground, times (R0 / (R0 + height))^2; eq (17)
    of the 1976 standard."""
    ratio = R0 / (R0 + height)
    return surface * ratio * ratio


@formula
def inverse_square_near(acceleration, share):
    """``acceleration`` at a height, m/s2, after a rise that is a small ``share`` of the distance R0
    + h; as `geopotential_rise`."""
    return acceleration * (1.0 - share * (2.0 - share * (3.0 - 4.0 * share)))
