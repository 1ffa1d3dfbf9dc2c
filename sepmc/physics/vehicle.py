"""The vehicle of a case: inertia tensors, arms of points, direction of flight."""

from sepmc.jit import formula
from sepmc.physics import vec3
from sepmc.physics.elementary import sine_cosine


@formula
def inertia_tensor(factor, moments, products):
    """Inertia tensor, kg m2, from moments xx, yy, zz and products xy, xz, yz (integrals of x y,
    ...), all times a factor."""
    xx, yy, zz = vec3.scale(factor, moments)
    xy, xz, yz = vec3.scale(-factor, products)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


@formula
def arm(cg, point):
    """From a centre of mass to a layout point, body axes, m: stations run aft."""
    return (cg[0] - point[0], point[1] - cg[1], point[2] - cg[2])


@formula
def flight_direction(path_angle, path_yaw):
    """Unit vector of the velocity in ground axes."""
    climb, level = sine_cosine(path_angle)
    aside, ahead = sine_cosine(path_yaw)
    return (level * ahead, climb * ahead, -aside)
