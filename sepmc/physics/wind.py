"""Horizontal wind of given speed and direction."""

from sepmc.jit import formula
from sepmc.physics.elementary import sine_cosine


@formula
def wind(speed, direction):
    """Velocity of the air in ground axes, m/s; direction (rad) is where it moves to: 0 along x, 90
    deg along z."""
    sine, cosine = sine_cosine(direction)
    return (speed * cosine, 0.0, speed * sine)
