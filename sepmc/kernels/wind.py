"""Horizontal wind of given speed and direction."""

import math

from sepmc.kernels._jit import formula


@formula
def wind(speed, direction):
    """Velocity of the air in ground axes, m/s; direction (rad) is where it moves to: 0 along x, 90 deg along z."""
    return (speed * math.cos(direction), 0.0, speed * math.sin(direction))
