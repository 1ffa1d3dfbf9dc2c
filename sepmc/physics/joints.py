"""Constraint rows of a joint: C, C' and the parts of C'' (CONVENTIONS.md, Joint).

d = r_B - r_A, e and b fixed in A, a fixed in B; all vectors, omega too, in ground axes.

    translation  C = d . e
    rotation     C = a . b,  n = a x b
    rod          C = |d| - L,  e = d / |d|

These are eqs (16), (17) of the paper that README cites, differentiated with every term kept.
Checked against finite differences of C in `tests/kernel/test_joints.py`. Vectors are tuples of 3
float: positions and arms in m, velocities in m/s, angular rates in rad/s.
"""

import math

from sepmc.jit import formula
from sepmc.physics import vec3


@formula
def across(e, y):
    """Unit vector that is normal to the unit vector ``e`` and, among those, nearest to ``y``. If
    y is along e, it is meaningless or not finite in a kernel; called directly from Python, the
    function may raise ZeroDivisionError.

    With e the x axis of a joint it is the y axis of the joint. Checked against
    `sepmc.scene.kinds.joint_axes`.
    """
    return vec3.unit(vec3.sub(y, vec3.scale(vec3.dot(e, y), e)))


@formula
def centripetal(omega, rho):
    """Acceleration omega x (omega x rho) of the end of a lever arm that rotates, m/s2."""
    return vec3.cross(omega, vec3.cross(omega, rho))


@formula
def between(x_a, v_a, rho_a, omega_a, x_b, v_b, rho_b, omega_b):
    """Vector d from a point of body A to a point of body B, and its rate d'; all vectors are in
    ground axes.

    Parameters
    ----------
    x_a, v_a, x_b, v_b : tuple of 3 float
        Position and velocity of the centres of mass, m, m/s.
    rho_a, rho_b : tuple of 3 float
        From the centres of mass to the points, m.
    omega_a, omega_b : tuple of 3 float
        Angular rates, rad/s.

    Returns
    -------
    d, d_rate : tuple of 3 float
        m, m/s.
    """
    d = vec3.sub(vec3.add(x_b, rho_b), vec3.add(x_a, rho_a))
    return d, vec3.sub(
        vec3.add(v_b, vec3.cross(omega_b, rho_b)), vec3.add(v_a, vec3.cross(omega_a, rho_a))
    )


@formula
def translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b):
    """Row of a translation constraint: the vectors and the number in its second derivative

    C'' = e . (x_B'' - x_A'') + arm_B . omega_B' + arm_A . omega_A' - gamma, with arm_B = rho_B x e,
    arm_A = -(rho_A + d) x e.

    Parameters
    ----------
    d, d_rate : tuple of 3 float
        Vector between the joint points and its rate, from `between`.
    e : tuple of 3 float
        Unit vector fixed in A: direction of the translation.
    rho_a, rho_b, omega_a, omega_b : tuple of 3 float
        As in `between`.

    Returns
    -------
    arm_a, arm_b : tuple of 3 float
        Factors of omega_A' and omega_B' in C'' (moments of a unit force along e), m.
    gamma : float
        m/s2.
    """
    arm_a = vec3.cross(e, vec3.add(rho_a, d))
    arm_b = vec3.cross(rho_b, e)
    e_rate = vec3.cross(omega_a, e)
    rotating = vec3.dot(vec3.sub(centripetal(omega_b, rho_b), centripetal(omega_a, rho_a)), e)
    gamma = -rotating - 2.0 * vec3.dot(d_rate, e_rate) - vec3.dot(d, vec3.cross(omega_a, e_rate))
    return arm_a, arm_b, gamma


@formula
def translation_rate(d, d_rate, e, omega_a):
    """Rate C' = d' . e + d . (omega_A x e) of a translation constraint, m/s; arguments as in
    `translation`."""
    return vec3.dot(d_rate, e) + vec3.dot(d, vec3.cross(omega_a, e))


@formula
def rotation(a, b, omega_a, omega_b):
    """Row of a rotation constraint: the vector n = a x b and the number gamma in its second
    derivative C'' = n . (omega_B' - omega_A') - gamma.

    Parameters
    ----------
    a, b : tuple of 3 float
        Unit vectors fixed in B and in A.
    omega_a, omega_b : tuple of 3 float
        Angular rates, rad/s.

    Returns
    -------
    n : tuple of 3 float
    gamma : float
        rad/s2.
    """
    a_rate = vec3.cross(omega_b, a)
    b_rate = vec3.cross(omega_a, b)
    gamma = (
        -vec3.dot(vec3.cross(omega_b, a_rate), b)
        - 2.0 * vec3.dot(a_rate, b_rate)
        - vec3.dot(a, vec3.cross(omega_a, b_rate))
    )
    return vec3.cross(a, b), gamma


@formula
def rotation_rate(a, b, omega_a, omega_b):
    """Rate C' = (omega_B x a) . b + a . (omega_A x b) of a rotation constraint, rad/s; arguments as
    in `rotation`: ``a`` is fixed in body B, ``b`` in body A."""
    return vec3.dot(vec3.cross(omega_b, a), b) + vec3.dot(a, vec3.cross(omega_a, b))


@formula
def rod(d, d_rate, rho_a, rho_b, omega_a, omega_b):
    """Row of a rod: e, arm_a, arm_b and gamma in its second derivative C'', which has the form
    given in `translation`. If the length of the rod is zero, they are not finite in a kernel;
    called directly from Python, the function raises ZeroDivisionError.

    Parameters
    ----------
    d, d_rate, rho_a, rho_b, omega_a, omega_b : tuple of 3 float
        As in `translation`.

    Returns
    -------
    e : tuple of 3 float
        Unit vector along the rod, from A to B.
    arm_a, arm_b : tuple of 3 float
        As in `translation`, m.
    gamma : float
        m/s2.
    """
    length = math.sqrt(vec3.dot(d, d))
    e = vec3.scale(1.0 / length, d)
    along = vec3.dot(d_rate, e)
    rotating = vec3.dot(vec3.sub(centripetal(omega_b, rho_b), centripetal(omega_a, rho_a)), e)
    gamma = -rotating - (vec3.dot(d_rate, d_rate) - along * along) / length
    return e, vec3.cross(e, rho_a), vec3.cross(rho_b, e), gamma
