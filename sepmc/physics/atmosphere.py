"""US Standard Atmosphere 1976, 0 to 86 km geometric height (NOAA-S/T 76-1562, tables 3, 4 and eqs
18, 23, 33, 42).

Heights are geometric, m, or geopotential, m' (standard geopotential metre). Temperatures are
molecular-scale. Checked against the printed tables and 60-digit arithmetic in
`tests/physics/test_elementary.py`.
"""

import math

from sepmc.jit import formula, routine
from sepmc.physics.elementary import exponential
from sepmc.physics.us1976_table import BASES, G0, LAPSES, M0, R0, R_STAR, TOP

NEAR = 500.0  # m: range of the series about a height


def _bases() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the temperatures (K) and the pressures (Pa) at the bases of all layers, from the
    lowest layer up."""
    temperature, pressure = [288.15], [101_325.0]
    for low, high, lapse in zip(BASES, BASES[1:-1], LAPSES, strict=False):
        t0, p0 = temperature[-1], pressure[-1]
        t1 = t0 + lapse * (high - low)
        exponent = G0 * M0 / R_STAR
        temperature.append(t1)
        pressure.append(
            p0 * math.exp(-exponent * (high - low) / t0)
            if lapse == 0.0
            else p0 * (t0 / t1) ** (exponent / lapse)
        )
    return tuple(temperature), tuple(pressure)


_T, _P = _bases()


@formula
def sound_speed(temperature):
    """Speed of sound sqrt(gamma R* T / M0), gamma = 1.4; eq (50).

    Parameters
    ----------
    temperature : float
        Molecular-scale temperature, K.

    Returns
    -------
    float
        m/s.
    """
    return math.sqrt(1.4 * R_STAR / M0 * temperature)


@formula
def us1976(height):
    """Density, pressure and temperature at a height.

    Parameters
    ----------
    height : float
        Geometric height, m, 0 to 86,000.

    Returns
    -------
    density, pressure, temperature : float
        kg/m3, Pa, K; NaN outside the range of heights (no extrapolation).
    """
    if not 0.0 <= height <= TOP:
        return math.nan, math.nan, math.nan
    base, _ = layer(height)
    p, t = in_layer(height, base)
    return density_in_layer(height, base), p, t


@routine
def layer(height):
    """Find the layer of the standard atmosphere that contains a height.

    Parameters
    ----------
    height : float
        Geometric height, m; below 0 the lowest layer is returned, above 86,000 the highest.

    Returns
    -------
    base : tuple of 4 float
        Geopotential height of the base of the layer, m'; lapse rate of the layer over the
        temperature at its base, 1/m'; one over that temperature, 1/K; pressure there, Pa.
    top : float
        Geopotential height of the top, m'.
    """
    h, k = geopotential(height), 0
    while k < 6 and h >= BASES[k + 1]:
        k += 1
    return (BASES[k], LAPSES[k] / _T[k], 1.0 / _T[k], _P[k]), BASES[k + 1]


@formula
def geometric(h):
    """Geometric height, m, of a geopotential height h, m': R0 h / (R0 - h); eq (19)."""
    return R0 * h / (R0 - h)


@formula
def geopotential(height):
    """Geopotential height, m', of a geometric height, m: R0 z / (R0 + z); eq (18)."""
    return height * (R0 / (R0 + height))


@formula
def in_layer(height, base):
    """Pressure and temperature at a height in a known layer; eqs (23), (33).

    Parameters
    ----------
    height : float
        Geometric height, m.
    base : tuple of 4 float
        Data of the layer, from `layer`.

    Returns
    -------
    pressure, temperature : float
        Pa, K; the molecular-scale temperature.
    """
    h, warming, log_ratio = _log_temperature_ratio(height, base)
    return base[3] * exponential(-log_ratio * (G0 * M0 / R_STAR * base[2] * h)), (
        1.0 + warming
    ) / base[2]


@formula
def density_in_layer(height, base):
    """Density p M0 / (R* T) at a height in a known layer; eq (42).

    With p of `in_layer` and T = T0 (1 + z), a single exponential gives p / T, since ln(T / T0) = z
    (ln(1 + z) / z).

    Parameters
    ----------
    height : float
        Geometric height, m.
    base : tuple of 4 float
        Data of the layer, from `layer`.

    Returns
    -------
    float
        kg/m3.
    """
    h, warming, log_ratio = _log_temperature_ratio(height, base)
    return (
        M0
        / R_STAR
        * base[3]
        * base[2]
        * exponential(-log_ratio * (G0 * M0 / R_STAR * base[2] * h + warming))
    )


@formula
def _log_temperature_ratio(height, base):
    """Return three numbers: the geopotential height h above the base of a layer, m'; the relative
    change of temperature from the base, z = L h / T0; and ln(1 + z) / z. ``height`` is geometric,
    m; ``base`` has the data of the layer, from `layer`.

    The pressure follows from -ln(p / p0) = (g M / R) h / T0 ln(1 + z) / z, with or without a lapse
    rate: eqs (33a) and (33b) in one. ln(1 + z) / z = 2 artanh(s) / z with s = z / (2 + z) has a
    series that is valid at z = 0, too. |s| <= 0.15 in every layer.
    """
    h = geopotential(height) - base[0]
    z = base[1] * h
    inverse = 1.0 / (2.0 + z)
    s = z * inverse
    s2 = s * s
    series = 1.0 / 13.0 + s2 * (1.0 / 15.0 + s2 * (1.0 / 17.0 + s2 * (1.0 / 19.0)))
    series = 1.0 / 7.0 + s2 * (1.0 / 9.0 + s2 * (1.0 / 11.0 + s2 * series))
    series = 1.0 + s2 * (1.0 / 3.0 + s2 * (0.2 + s2 * series))
    return h, z, 2.0 * inverse * series


@formula
def density_series(height, base):
    """Power series of the density about a height, in the rise H of geopotential height from there.

    With T = T_a + L H, (1 + b H) rho' = -(a + b) rho, a = g M / (R T_a), b = L / T_a: a recurrence
    for the coefficients, with or without a lapse rate. The error of nine terms is 1e-14 for a rise
    of `NEAR` metres. To evaluate them (`density_near`) costs far less than `density_in_layer`.

    Parameters
    ----------
    height : float
        Geometric height about which to expand, m.
    base : tuple of 4 float
        Data of the layer that contains it, from `layer`.

    Returns
    -------
    tuple of 9 float
        Coefficients c_k, kg/m3/m'^k: the density is the sum of c_k H^k.
    """
    temperature_ratio = 1.0 / (1.0 + base[1] * (geopotential(height) - base[0]))
    a, b = G0 * M0 / R_STAR * base[2] * temperature_ratio, base[1] * temperature_ratio
    c0 = density_in_layer(height, base)
    c1 = -c0 * (a + b)
    c2 = -c1 * (a + 2.0 * b) / 2.0
    c3 = -c2 * (a + 3.0 * b) / 3.0
    c4 = -c3 * (a + 4.0 * b) / 4.0
    c5 = -c4 * (a + 5.0 * b) / 5.0
    c6 = -c5 * (a + 6.0 * b) / 6.0
    c7 = -c6 * (a + 7.0 * b) / 7.0
    c8 = -c7 * (a + 8.0 * b) / 8.0
    return c0, c1, c2, c3, c4, c5, c6, c7, c8


@formula
def density_near(c, rise):
    """Density, kg/m3, from its power series ``c`` (`density_series`), at a ``rise`` of geopotential
    height, m', from the height about which the series is."""
    tail = c[5] + rise * (c[6] + rise * (c[7] + rise * c[8]))
    return c[0] + rise * (c[1] + rise * (c[2] + rise * (c[3] + rise * (c[4] + rise * tail))))


@formula
def geopotential_rise(rise, fraction, ratio):
    """Rise of geopotential height for a rise of geometric height that starts at the height h.

    Parameters
    ----------
    rise : float
        Rise of geometric height, m.
    fraction : float
        ``rise`` divided by the distance R0 + h from the earth's centre.
    ratio : float
        R0 / (R0 + h).

    Returns
    -------
    float
        Rise of geopotential height, m'; relative error 1e-16 for a rise of `NEAR` metres.
    """
    return ratio * ratio * rise * (1.0 - fraction * (1.0 - fraction * (1.0 - fraction)))
