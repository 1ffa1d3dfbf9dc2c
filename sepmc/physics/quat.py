"""Attitude: quaternions (scalar first, body to ground), matrices and the angles pitch, yaw, roll of
CONVENTIONS.md."""

import math

from sepmc.jit import formula
from sepmc.physics.elementary import arctan2, sine_cosine


@formula
def matrix(q):
    """Attitude matrix (9-tuple, body to ground) of a quaternion, orthogonal whatever its length:
    within a step that is not quite 1."""
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
    """The quaternion made of unit length."""
    inverse = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] * inverse, q[1] * inverse, q[2] * inverse, q[3] * inverse)


@formula
def rate(q, omega):
    """q' = 1/2 q (0, omega), omega in body axes, rad/s."""
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
    """Quaternion of Rz(pitch) Ry(yaw) Rx(roll), angles in rad."""
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
    """(pitch, yaw, roll) in rad of an attitude matrix; the paper's eq (7) is their rate. Singular
    at yaw = +-90 deg."""
    return pitch(m), yaw(m), roll(m)


@formula
def pitch(m):
    """Pitch, rad, of an attitude matrix."""
    return arctan2(m[3], m[0])


# of the yaw near which pitch and roll turn about at once
SINE_SINGULAR = math.sin(math.radians(89.0))


@formula
def yaw(m):
    """Yaw, rad, of an attitude matrix."""
    return arctan2(-m[6], math.sqrt(m[0] * m[0] + m[3] * m[3]))


# from the origin, with numbers up to 1: on which side it passes is beyond the accuracy of a flight
_THROUGH = 1e-9


@formula
def may_wind(u, v, bend):
    """Whether a path in a plane from u to v, pairs, that strays from the straight line by ``bend``
    at most may pass the origin on either side: by how much it turns about the origin is then not
    known. One that goes through the origin passes it on none."""
    along, across = v[0] - u[0], v[1] - u[1]
    square = along * along + across * across
    share = -(u[0] * along + u[1] * across) / (square if square > 0.0 else 1.0)
    share = 0.0 if share < 0.0 else share
    share = 1.0 if share > 1.0 else share
    x, y = u[0] + share * along, u[1] + share * across
    distance = x * x + y * y
    return _THROUGH * _THROUGH < distance < bend * bend


@formula
def heading(m):
    """The pairs whose angles pitch and roll are: the x axis seen along the vertical of the turn,
    that vertical seen along the x axis."""
    return m[0], m[3], m[7], m[8]


@formula
def turns_unclear(u, v, rate_u, rate_v, h):
    """Whether the x axis passed the vertical in a step of length h so closely that pitch or roll
    may have gone on by a turn more or less.

    u, v : `heading` at the start and the end of the step; rate_u, rate_v : body rates there, rad/s
    Both pairs move on smooth paths, which stray from a straight line by h^2 / 8 times their second
    derivative at most; twice that counts.
    """
    across_u, across_v = (
        rate_u[1] * rate_u[1] + rate_u[2] * rate_u[2],
        rate_v[1] * rate_v[1] + rate_v[2] * rate_v[2],
    )
    square_u, square_v = across_u + rate_u[0] * rate_u[0], across_v + rate_v[0] * rate_v[0]
    size_u, size_v = u[2] * u[2] + u[3] * u[3], v[2] * v[2] + v[3] * v[3]
    across = across_u if across_u > across_v else across_v
    whole = square_u if square_u > square_v else square_v
    size = size_u if size_u > size_v else size_v
    a, b, c = rate_v[0] - rate_u[0], rate_v[1] - rate_u[1], rate_v[2] - rate_u[2]
    bend = 0.25 * h * (h * math.sqrt(across * whole) + math.sqrt(a * a + b * b + c * c))
    spun = bend + 0.125 * h * h * whole * size  # a roll alone turns on a circle
    return may_wind((u[0], u[1]), (v[0], v[1]), bend) | may_wind((u[2], u[3]), (v[2], v[3]), spun)


@formula
def roll(m):
    """Roll, rad, of an attitude matrix."""
    return arctan2(m[7], m[8])
