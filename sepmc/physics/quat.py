"""Attitude: quaternions (scalar first, body to ground), matrices (9-tuples by rows) and the angles
pitch, yaw, roll of CONVENTIONS.md. Checked in `tests/acceptance/test_conventions.py` and
`tests/kernel/test_attitude_angles.py`."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import arctan2, sine_cosine


@formula
def matrix(q):
    """Attitude matrix (body to ground, 9-tuple by rows) of a quaternion (scalar first). The
    quaternion may have any length but 0, as within a step its length is not quite 1; the matrix is
    orthogonal for all."""
    w, x, y, z = q
    two = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        1.0 - two * (y * y + z * z),
        two * (x * y - w * z),
        two * (x * z + w * y),
        two * (x * y + w * z),
        1.0 - two * (x * x + z * z),
        two * (y * z - w * x),
        two * (x * z - w * y),
        two * (y * z + w * x),
        1.0 - two * (x * x + y * y),
    )


@formula
def unit(q):
    """Quaternion of unit length, q / |q|. If q is zero, it is not finite in a kernel; called
    directly from Python, the function raises ZeroDivisionError."""
    inverse = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] * inverse, q[1] * inverse, q[2] * inverse, q[3] * inverse)


@formula
def rate(q, omega):
    """Rate q' = 1/2 q (0, omega) of a quaternion.

    Parameters
    ----------
    q : tuple of 4 float
        Scalar first, body to ground.
    omega : tuple of 3 float
        Angular rate, body axes, rad/s.

    Returns
    -------
    tuple of 4 float
        1/s.
    """
    w, x, y, z = q
    p, r, s = omega
    return (
        0.5 * (-x * p - y * r - z * s),
        0.5 * (w * p + y * s - z * r),
        0.5 * (w * r + z * p - x * s),
        0.5 * (w * s + x * r - y * p),
    )


@formula
def from_angles(pitch, yaw, roll):
    """Quaternion (scalar first, body to ground) of the attitude Rz(pitch) Ry(yaw) Rx(roll), angles
    in rad."""
    sp, cp = sine_cosine(0.5 * pitch)
    sy, cy = sine_cosine(0.5 * yaw)
    sr, cr = sine_cosine(0.5 * roll)
    return (
        cp * cy * cr + sp * sy * sr,
        cp * cy * sr - sp * sy * cr,
        cp * sy * cr + sp * cy * sr,
        sp * cy * cr - cp * sy * sr,
    )


@formula
def angles(m):
    """Pitch, yaw and roll, rad, of an attitude matrix (9-tuple by rows); singular at yaw = +-90
    deg.

    Eq (7) of the paper that README cites gives their rates.
    """
    return pitch(m), yaw(m), roll(m)


@formula
def pitch(m):
    """Pitch atan2(m10, m00) of an attitude matrix, rad."""
    return arctan2(m[3], m[0])


# sine of the yaw beyond which pitch and roll are nearly singular
SINE_SINGULAR = math.sin(math.radians(89.0))


@formula
def yaw(m):
    """Yaw atan2(-m20, sqrt(m00^2 + m10^2)) of an attitude matrix, rad."""
    return arctan2(-m[6], math.sqrt(m[0] * m[0] + m[3] * m[3]))


# distance from the origin, for numbers up to 1, below which the side is round-off of the motion
_THROUGH = 1e-9


@formula
def may_wind(u, v, deviation):
    """Return True if a path in the plane from u to v, known only roughly, may pass the origin on
    either side.

    That is so if the straight line from u to v comes closer to the origin than ``deviation``. The
    change of the path's angle about the origin is then known only up to a full turn. If the line
    passes through the origin itself (to 1e-9), the side is a matter of round-off, and the answer is
    False.

    Parameters
    ----------
    u, v : tuple of 2 float
        Ends of the path.
    deviation : float
        Largest distance of the path from the straight line between its ends.
    """
    along, across = v[0] - u[0], v[1] - u[1]
    square = along * along + across * across
    fraction = -(u[0] * along + u[1] * across) / (square if square > 0.0 else 1.0)
    fraction = 0.0 if fraction < 0.0 else fraction
    fraction = 1.0 if fraction > 1.0 else fraction
    x, y = u[0] + fraction * along, u[1] + fraction * across
    distance = x * x + y * y
    return _THROUGH * _THROUGH < distance < deviation * deviation


@formula
def heading(m):
    """Elements (m00, m10, m21, m22) of an attitude matrix: the cosine and sine of the pitch, then
    the sine and cosine of the roll, each pair times the cosine of the yaw.

    Parameters
    ----------
    m : tuple of 9 float
        Attitude matrix.

    Returns
    -------
    tuple of 4 float
    """
    return m[0], m[3], m[7], m[8]


@formula
def turns_unclear(u, v, rate_u, rate_v, h):
    """Return True if it is not certain by how many full turns pitch or roll changed in a step.

    The body's x axis then passed close to the singular direction (yaw +-90 deg). The two pairs of
    `heading` move on smooth paths in the plane, which deviate from a straight line by at most h^2 /
    8 times their second derivative; twice that is allowed for (`may_wind`).

    Parameters
    ----------
    u, v : tuple of 4 float
        `heading` at the start and at the end of the step.
    rate_u, rate_v : tuple of 3 float
        Body rates there, rad/s.
    h : float
        Length of the step, s.
    """
    across_u, across_v = (
        rate_u[1] * rate_u[1] + rate_u[2] * rate_u[2],
        rate_v[1] * rate_v[1] + rate_v[2] * rate_v[2],
    )
    square_u, square_v = across_u + rate_u[0] * rate_u[0], across_v + rate_v[0] * rate_v[0]
    size_u, size_v = u[2] * u[2] + u[3] * u[3], v[2] * v[2] + v[3] * v[3]
    across = across_u if across_u > across_v else across_v
    total = square_u if square_u > square_v else square_v
    size = size_u if size_u > size_v else size_v
    a, b, c = rate_v[0] - rate_u[0], rate_v[1] - rate_u[1], rate_v[2] - rate_u[2]
    deviation = 0.25 * h * (h * math.sqrt(across * total) + math.sqrt(a * a + b * b + c * c))
    roll_deviation = deviation + 0.125 * h * h * total * size  # a roll alone turns on a circle
    return may_wind((u[0], u[1]), (v[0], v[1]), deviation) | may_wind(
        (u[2], u[3]), (v[2], v[3]), roll_deviation
    )


@formula
def roll(m):
    """Roll atan2(m21, m22) of an attitude matrix, rad."""
    return arctan2(m[7], m[8])
