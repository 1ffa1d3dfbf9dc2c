"""Horizontal wind of given speed and direction."""

from sepmc.jit import formula
from sepmc.physics.elementary import sine_cosine


@formula
def wind(speed, direction):
    """Velocity of the air over the ground, ground axes (x forward, y up, z right).

    Parameters
    ----------
    speed : float
        m/s.
    direction : float
        Direction to which the air moves, rad: 0 along x, pi/2 along z.

    Returns
    -------
    tuple of 3 float
        m/s.
    """
    sine, cosine = sine_cosine(direction)
    return (speed * cosine, 0.0, speed * sine)
