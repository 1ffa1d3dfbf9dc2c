"""Gravity over a flat ground: along -y, constant or falling with the inverse square of the distance to the centre."""

from sepmc.kernels._jit import formula
from sepmc.kernels.layout import INVERSE_SQUARE, NO_GRAVITY
from sepmc.kernels.us1976_table import R0


@formula
def gravity(kind, surface, height):
    """Acceleration downward, m/s2: ``surface`` at the ground, times (R0 / (R0 + height))^2 if inverse-square.

    Source: eq (17) of the 1976 standard atmosphere. Checked against its printed table.
    """
    if kind == NO_GRAVITY:
        return 0.0
    if kind == INVERSE_SQUARE:
        return inverse_square(surface, height)
    return surface


@formula
def inverse_square(surface, height):
    """``surface`` times (R0 / (R0 + height))^2, m/s2."""
    ratio = R0 / (R0 + height)
    return surface * ratio * ratio


@formula
def inverse_square_near(acceleration, share):
    """``acceleration`` at a height, m/s2, after a rise that is a small ``share`` of the distance R0 + h; as `geopotential_rise`."""
    return acceleration * (1.0 - share * (2.0 - share * (3.0 - 4.0 * share)))
