"""Constraint rows of a joint: C, C' and the parts of C'' (see CONVENTIONS.md, Joint).

d = r_B - r_A, e and b fixed in A, a fixed in B, all in ground axes; omega in ground axes.
Translation: C = d . e.   Rotation: C = a . b, n = a x b.  Paper eqs (16), (17), differentiated with every term kept.
"""

from sepmc.kernels import vec3
from sepmc.kernels._jit import formula


@formula
def translation(d, d_rate, e, rho_a, rho_b, omega_a, omega_b):
    """Row of a translation constraint: its lever arms on A and B and the right-hand side gamma.

    C'' = e . (x_B'' - x_A'') + arm_B . omega_B' + arm_A . omega_A' - gamma, with arm_B = rho_B x e, arm_A = -(rho_A + d) x e.
    """
    arm_a = vec3.cross(e, vec3.add(rho_a, d))
    arm_b = vec3.cross(rho_b, e)
    centripetal_b = vec3.cross(omega_b, vec3.cross(omega_b, rho_b))
    centripetal_a = vec3.cross(omega_a, vec3.cross(omega_a, rho_a))
    e_rate = vec3.cross(omega_a, e)
    gamma = -vec3.dot(vec3.sub(centripetal_b, centripetal_a), e) - 2.0 * vec3.dot(d_rate, e_rate) - vec3.dot(d, vec3.cross(omega_a, e_rate))
    return arm_a, arm_b, gamma


@formula
def rotation(a, b, omega_a, omega_b):
    """Row of a rotation constraint: n and gamma in C'' = n . (omega_B' - omega_A') - gamma."""
    a_rate = vec3.cross(omega_b, a)
    b_rate = vec3.cross(omega_a, b)
    gamma = -vec3.dot(vec3.cross(omega_b, a_rate), b) - 2.0 * vec3.dot(a_rate, b_rate) - vec3.dot(a, vec3.cross(omega_a, b_rate))
    return vec3.cross(a, b), gamma


@formula
def rotation_pair(axis, ax, ay, az, bx, by):
    """Vectors (a of B, b of A) whose product vanishes while B does not turn about ``axis`` of A; paper eqs (21)-(23).

    ax, ay, az are the joint axes carried by A, bx, by those carried by B.
    """
    if axis == 0:  # roll
        return by, az
    if axis == 1:  # yaw
        return bx, az
    return bx, ay  # pitch
