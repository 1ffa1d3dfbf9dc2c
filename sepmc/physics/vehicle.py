"""Inertia tensors, lever arms and flight direction of a case. Checked in
`tests/acceptance/test_conventions.py`."""

from sepmc.jit import formula
from sepmc.physics import vec3
from sepmc.physics.elementary import sine_cosine


@formula
def inertia_tensor(factor, moments, products):
    """Inertia tensor of a body about its centre of mass.

    Parameters
    ----------
    factor : float
        Multiplies all elements.
    moments : tuple of 3 float
        I_xx, I_yy, I_zz, kg m2.
    products : tuple of 3 float
        Integrals of x y, x z, y z over the mass, kg m2.

    Returns
    -------
    tuple of 9 float
        Matrix by rows, kg m2; its off-diagonal elements are minus the products.
    """
    xx, yy, zz = vec3.scale(factor, moments)
    xy, xz, yz = vec3.scale(-factor, products)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def arm(cg, point):
    """Vector from a centre of mass ``cg`` to a ``point``, body axes, m. Both are given in layout
    coordinates (station, y, z), m, whose stations run aft, opposite to body x."""
    return (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])


@formula
def flight_direction(path_angle, path_yaw):
    """Unit vector of the velocity, ground axes: (cos theta cos sigma, sin theta cos sigma, -sin
    sigma).

    Parameters
    ----------
    path_angle : float
        theta, path pitch, rad: of its part in the x-y plane, from x toward y (up).
    path_yaw : float
        sigma, rad: from the x-y plane toward -z (left). It is the azimuth only if theta is 0.

    Returns
    -------
    tuple of 3 float
    """
    climb, level = sine_cosine(path_angle)
    lateral, forward = sine_cosine(path_yaw)
    return (level * forward, climb * forward, -lateral)
