"""Springs, pushers and pistons between two points."""

from sepmc.jit import formula


@formula
def spring_force(force, stiffness, damping, extension, rate):
    """Force apart, N: ``force`` at the start, falling with the extension (m) and its rate (m/s)."""
    return force - stiffness * extension - damping * rate
