"""Thrust of a motor and its line of action; paper section 1.3."""

import math

from sepmc.kernels._jit import formula


@formula
def thrust_direction(cant, clock, deflection, deflection_clock):
    """Unit thrust in body axes: eqs (1), (2), (3). cant zeta_x, clock zeta_gamma, deflection beta_F and its clock phi_F, rad."""
    cx, sx = math.cos(cant), math.sin(cant)
    cg, sg = math.cos(clock), math.sin(clock)
    fx = math.cos(deflection)
    fy = -math.sin(deflection) * math.sin(deflection_clock)
    fz = math.sin(deflection) * math.cos(deflection_clock)
    return (cx * fx - sx * fz, -sg * sx * fx + cg * fy - sg * cx * fz, cg * sx * fx + sg * fy + cg * cx * fz)


@formula
def thrust_arm(cg, station, radius, clock, offset_y, offset_z):
    """From the centre of mass to the thrust point, body axes, m: eq (4). cg in layout coordinates."""
    return (
        cg[0] - station,
        -radius * math.sin(clock) - cg[1] + offset_y,
        radius * math.cos(clock) - cg[2] + offset_z,
    )


@formula
def thrust_level(thrust, build_up, since):
    """Thrust, N, ``since`` seconds after ignition: first-order build-up to ``thrust`` with time constant ``build_up``."""
    if build_up <= 0.0:
        return thrust
    return thrust * (1.0 - math.exp(-since / build_up))


@formula
def tail_off(since, time_constant):
    """Share of the thrust at burn-out that is left ``since`` seconds later: exp(-since / time_constant)."""
    return math.exp(-since / time_constant)
