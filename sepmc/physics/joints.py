"""Constraint rows of a joint: C, C' and the parts of C'' (see CONVENTIONS.md, Joint).

d = r_B - r_A, e and b fixed in A, a fixed in B, all in ground axes; omega in ground axes.
Translation: C = d . e.   Rotation: C = a . b, n = a x b.   Rod: C = |d| - L, e = d / |d|.
Paper eqs (16), (17), differentiated with every term kept. Checked against finite differences of C.
"""

import math

from sepmc.jit import formula
from sepmc.physics import vec3


@formula
def across(e, y):
    """The unit vector at right angles to a unit vector e that is nearest to y; not finite if y is
    along e. With e the x axis of a joint it is its y axis, as in `sepmc.scene.kinds.joint_axes`,
    against which it is checked."""
    return vec3.unit(vec3.sub(y, vec3.scale(vec3.dot(e, y), e)))


@formula
def centripetal(omega, rho):
    """omega x (omega x rho): what a turning lever arm adds to the acceleration of its end, m/s2."""
    return vec3.cross(omega, vec3.cross(omega, rho))


@formula
def between(x_a, v_a, rho_a, omega_a, x_b, v_b, rho_b, omega_b):
    """d = r_B - r_A of a point of body A and one of body B, and d'; all in ground axes, rho from
    the mass centre to the point."""
    d = vec3.sub(vec3.add(x_b, rho_b), vec3.add(x_a, rho_a))
    return d, vec3.sub(
        vec3.add(v_b, vec3.cross(omega_b, rho_b)), vec3.add(v_a, vec3.cross(omega_a, rho_a))
    )


@formula
def translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b):
    """Row of a translation constraint: its lever arms on A and B and the right-hand side gamma.

    C'' = e . (x_B'' - x_A'') + arm_B . omega_B' + arm_A . omega_A' - gamma, with arm_B = rho_B x e,
    arm_A = -(rho_A + d) x e.
    """
    arm_a = vec3.cross(e, vec3.add(rho_a, d))
    arm_b = vec3.cross(rho_b, e)
    e_rate = vec3.cross(omega_a, e)
    turning = vec3.dot(vec3.sub(centripetal(omega_b, rho_b), centripetal(omega_a, rho_a)), e)
    gamma = -turning - 2.0 * vec3.dot(d_rate, e_rate) - vec3.dot(d, vec3.cross(omega_a, e_rate))
    return arm_a, arm_b, gamma


@formula
def translation_rate(d, d_rate, e, omega_a):
    """C' of a translation constraint, m/s."""
    return vec3.dot(d_rate, e) + vec3.dot(d, vec3.cross(omega_a, e))


@formula
def rotation(a, b, omega_a, omega_b):
    """Row of a rotation constraint: n and gamma in C'' = n . (omega_B' - omega_A') - gamma."""
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
    """C' of a rotation constraint, rad/s."""
    return vec3.dot(vec3.cross(omega_b, a), b) + vec3.dot(a, vec3.cross(omega_a, b))


@formula
def rod(d, d_rate, rho_a, rho_b, omega_a, omega_b):
    """Row of a rod: its direction e, lever arms on A and B and gamma, as for a translation. Not
    finite if its length is zero."""
    length = math.sqrt(vec3.dot(d, d))
    e = vec3.scale(1.0 / length, d)
    along = vec3.dot(d_rate, e)
    turning = vec3.dot(vec3.sub(centripetal(omega_b, rho_b), centripetal(omega_a, rho_a)), e)
    gamma = -turning - (vec3.dot(d_rate, d_rate) - along * along) / length
    return e, vec3.cross(e, rho_a), vec3.cross(rho_b, e), gamma
