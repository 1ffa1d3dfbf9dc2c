"""Algebra of 3-vectors (tuples of 3 float) and 3 x 3 matrices (tuples of 9 float, by rows)."""

import math

from sepmc.jit import formula, routine


@formula
def add(a, b):
    """Sum a + b of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@formula
def sub(a, b):
    """Difference a - b of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@formula
def scale(s, a):
    """Product s a of a number and a vector."""
    return (s * a[0], s * a[1], s * a[2])


@formula
def dot(a, b):
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@formula
def cross(a, b):
    """Vector product a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@formula
def unit(a):
    """Unit vector a / |a|. If a is zero, it is not finite in a kernel; called directly from Python,
    the function raises ZeroDivisionError."""
    return scale(1.0 / math.sqrt(dot(a, a)), a)


@formula
def perpendicular(a):
    """Some unit vector normal to a: a x e, normalised, where e is the axis along which a has the
    component of smallest size. If a is zero, it is not finite in a kernel; called directly from
    Python, the function raises ZeroDivisionError."""
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    smallest_axis = (
        (1.0, 0.0, 0.0) if x <= min(y, z) else ((0.0, 1.0, 0.0) if y <= z else (0.0, 0.0, 1.0))
    )
    return unit(cross(a, smallest_axis))


@formula
def rotate(m, a):
    """Product m a: from body to ground axes if m is an attitude matrix."""
    return (
        m[0] * a[0] + m[1] * a[1] + m[2] * a[2],
        m[3] * a[0] + m[4] * a[1] + m[5] * a[2],
        m[6] * a[0] + m[7] * a[1] + m[8] * a[2],
    )


@formula
def unrotate(m, a):
    """Product m^T a: from ground to body axes if m is an attitude matrix."""
    return (
        m[0] * a[0] + m[3] * a[1] + m[6] * a[2],
        m[1] * a[0] + m[4] * a[1] + m[7] * a[2],
        m[2] * a[0] + m[5] * a[1] + m[8] * a[2],
    )


@formula
def add_matrices(a, b):
    """Sum a + b of two matrices."""
    return (
        a[0] + b[0],
        a[1] + b[1],
        a[2] + b[2],
        a[3] + b[3],
        a[4] + b[4],
        a[5] + b[5],
        a[6] + b[6],
        a[7] + b[7],
        a[8] + b[8],
    )


@formula
def symmetric_inverse(m):
    """Inverse of a symmetric matrix by cofactors. If the determinant is 0, it is not finite in a
    kernel; called directly from Python, the function raises ZeroDivisionError."""
    c00 = m[4] * m[8] - m[5] * m[5]
    c01 = m[2] * m[5] - m[1] * m[8]
    c02 = m[1] * m[5] - m[2] * m[4]
    det = m[0] * c00 + m[1] * c01 + m[2] * c02
    c11 = m[0] * m[8] - m[2] * m[2]
    c12 = m[1] * m[2] - m[0] * m[5]
    c22 = m[0] * m[4] - m[1] * m[1]
    return (
        c00 / det,
        c01 / det,
        c02 / det,
        c01 / det,
        c11 / det,
        c12 / det,
        c02 / det,
        c12 / det,
        c22 / det,
    )


@formula
def is_positive_definite(m):
    """Return True for a positive definite symmetric matrix (Sylvester's criterion); False for
    NaN."""
    minor = m[0] * m[4] - m[1] * m[1]
    det = (
        m[0] * (m[4] * m[8] - m[5] * m[5])
        - m[1] * (m[1] * m[8] - m[5] * m[2])
        + m[2] * (m[1] * m[5] - m[4] * m[2])
    )
    return m[0] > 0.0 and minor > 0.0 and det > 0.0


@formula
def get(w, k):
    """Return the vector stored in w[k], w[k + 1], w[k + 2]."""
    return (w[k], w[k + 1], w[k + 2])


@routine
def split(d, axis):
    """Split the vector d along the unit vector ``axis``. Returns its component along it (a number)
    and the rest of d across it (a vector).

    The rest is projected twice, so that it is normal to the axis even if it is short.
    """
    along = dot(d, axis)
    across = sub(d, scale(along, axis))
    return along, sub(across, scale(dot(across, axis), axis))


@formula
def put(w, k, a):
    """Store the vector ``a`` in w[k], w[k + 1], w[k + 2]."""
    w[k], w[k + 1], w[k + 2] = a


@formula
def get_matrix(w, k):
    """Return the matrix, by rows, stored in w[k] and the eight numbers after it."""
    return (w[k], w[k + 1], w[k + 2], w[k + 3], w[k + 4], w[k + 5], w[k + 6], w[k + 7], w[k + 8])
