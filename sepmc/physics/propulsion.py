"""Thrust of a motor and its line of action; paper section 1.3."""

from sepmc.jit import formula
from sepmc.physics.elementary import exponential, sine_cosine


@formula
def thrust_direction(cant, clock, deflection, deflection_clock):
    """Unit thrust in body axes: eqs (1), (2), (3). cant zeta_x, clock zeta_gamma, deflection beta_F
    and its clock phi_F, rad."""
    sx, cx = sine_cosine(cant)
    sg, cg = sine_cosine(clock)
    deflected, fx = sine_cosine(deflection)
    sine, cosine = sine_cosine(deflection_clock)
    fy, fz = -deflected * sine, deflected * cosine
    return (
        cx * fx - sx * fz,
        -sg * sx * fx + cg * fy - sg * cx * fz,
        cg * sx * fx + sg * fy + cg * cx * fz,
    )


@formula
def thrust_arm(cg, station, radius, clock, offset_y, offset_z):
    """From the centre of mass to the thrust point, body axes, m: eq (4). cg in layout
    coordinates."""
    sine, cosine = sine_cosine(clock)
    return (cg[0] - station, -radius * sine - cg[1] + offset_y, radius * cosine - cg[2] + offset_z)


@formula
def building_up(thrust, rate, since):
    """Thrust, N, ``since`` seconds after ignition: first-order build-up at a rate, 1/s, one over
    its time constant."""
    return thrust * (1.0 - exponential(-since * rate))


@formula
def tail_off(since, time_constant):
    """Share of the thrust at burn-out that is left ``since`` seconds later: exp(-since /
    time_constant)."""
    return exponential(-since / time_constant)
