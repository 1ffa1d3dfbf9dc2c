"""Springs, pushers and pistons between two points."""

from sepmc.jit import formula


@formula
def spring_force(force, stiffness, damping, extension, rate):
    """Separating force F = F0 - k x - c x'.

    Parameters
    ----------
    force : float
        F0, force without extension, N.
    stiffness, damping : float
        k, N/m; c, N s/m.
    extension, rate : float
        x, m; x', m/s.

    Returns
    -------
    float
        N, positive if it drives the points apart.
    """
    return force - stiffness * extension - damping * rate
