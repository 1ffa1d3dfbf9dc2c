"""Thrust of a motor and its line of action; section 1.3 of the paper that README cites. Checked in
`tests/acceptance/test_conventions.py`."""

from sepmc.jit import formula
from sepmc.physics.elementary import exponential, sine_cosine


@formula
def thrust_direction(cant, clock, deflection, deflection_clock):
    """Unit vector of the thrust; eqs (1), (2), (3) of the paper.

    Parameters
    ----------
    cant, clock : float
        zeta_x and zeta_gamma, rad: angle of the nozzle axis from body x, and its direction about
        x, from z towards -y. The axis is (cos cant, -sin cant sin clock, sin cant cos clock).
    deflection, deflection_clock : float
        beta_F and phi_F, rad: the same angles of the thrust in the axes of the nozzle.

    Returns
    -------
    tuple of 3 float
        Body axes.
    """
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
    """Vector from the centre of mass to the thrust point; eq (4) of the paper.

    Parameters
    ----------
    cg : tuple of 3 float
        Centre of mass, layout coordinates, m.
    station, radius, clock : float
        Station of the thrust point, m; its distance from the layout axis, m; its direction about
        that axis, from z towards -y, rad.
    offset_y, offset_z : float
        Further offset of the thrust point, m.

    Returns
    -------
    tuple of 3 float
        Body axes, m.
    """
    sine, cosine = sine_cosine(clock)
    return (cg[0] - station, -radius * sine - cg[1] + offset_y, radius * cosine - cg[2] + offset_z)


@formula
def building_up(thrust, rate, since):
    """First-order thrust build-up F (1 - exp(-t / tau)).

    Parameters
    ----------
    thrust : float
        F, N.
    rate : float
        1 / tau, 1/s.
    since : float
        t, time after ignition, s.

    Returns
    -------
    float
        N.
    """
    return thrust * (1.0 - exponential(-since * rate))


@formula
def tail_off(since, time_constant):
    """Thrust during the tail-off as a fraction of the thrust at burn-out: exp(-t / tau).

    Parameters
    ----------
    since : float
        t, time after burn-out, s.
    time_constant : float
        tau, s.

    Returns
    -------
    float
    """
    return exponential(-since / time_constant)
