"""US Standard Atmosphere 1976, 0 to 86 km geometric height (NOAA-S/T 76-1562, tables 3, 4 and eqs
18, 23, 33, 42)."""

import math

from sepmc.jit import formula, routine
from sepmc.physics.elementary import exponential
from sepmc.physics.us1976_table import BASES, G0, LAPSES, M0, R0, R_STAR, TOP

NEAR = 500.0  # m, rise for which the series about a height are used


def _bases() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Temperature (K) and pressure (Pa) at the base of each layer, built up from the ground."""
    temperature, pressure = [288.15], [101_325.0]
    for low, high, lapse in zip(BASES, BASES[1:-1], LAPSES, strict=False):
        t0, p0 = temperature[-1], pressure[-1]
        t1 = t0 + lapse * (high - low)
        gmr = G0 * M0 / R_STAR
        temperature.append(t1)
        pressure.append(
            p0 * math.exp(-gmr * (high - low) / t0)
            if lapse == 0.0
            else p0 * (t0 / t1) ** (gmr / lapse)
        )
    return tuple(temperature), tuple(pressure)


_T, _P = _bases()


@formula
def sound_speed(temperature):
    """Speed of sound, m/s, from the molecular-scale temperature, K; eq (50) of the 1976
    standard."""
    return math.sqrt(1.4 * R_STAR / M0 * temperature)


@formula
def us1976(height):
    """Density, pressure and molecular-scale temperature at a geometric height.

    height : m, 0 to 86 km. Outside, all three are NaN: nothing is extrapolated.
    Returns kg/m3, Pa, K. Checked against the printed tables of the standard.
    """
    if not 0.0 <= height <= TOP:
        return math.nan, math.nan, math.nan
    base, _ = layer(height)
    p, t = in_layer(height, base)
    return density_in_layer(height, base), p, t


@routine
def layer(height):
    """The layer of a geometric height, m, and its top, geopotential m'.

    The layer: base, m', lapse rate over temperature at the base, 1/m', one over temperature, 1/K,
    and pressure, Pa, there.
    """
    h, k = geopotential(height), 0
    while k < 6 and h >= BASES[k + 1]:
        k += 1
    return (BASES[k], LAPSES[k] / _T[k], 1.0 / _T[k], _P[k]), BASES[k + 1]


@formula
def geometric(h):
    """Geometric height, m, of a geopotential height, m'; eq (19)."""
    return R0 * h / (R0 - h)


@formula
def geopotential(height):
    """Geopotential height, m', of a geometric height, m; eq (18)."""
    return height * (R0 / (R0 + height))


@formula
def in_layer(height, base):
    """Pressure, Pa, and temperature, K, at a geometric height, m, in the layer that `layer` gave;
    eqs (23), (33)."""
    h, z, logarithm = _warmed(height, base)
    return base[3] * exponential(-logarithm * (G0 * M0 / R_STAR * base[2] * h)), (1.0 + z) / base[2]


@formula
def density_in_layer(height, base):
    """Density, kg/m3, as `in_layer`; eq (42). It is over temperature as pressure, and ln(T / T0) =
    z (ln(1 + z) / z)."""
    h, z, logarithm = _warmed(height, base)
    return (
        M0
        / R_STAR
        * base[3]
        * base[2]
        * exponential(-logarithm * (G0 * M0 / R_STAR * base[2] * h + z))
    )


@formula
def _warmed(height, base):
    """Height h above the base of a layer, m', z = L h / T0, by which the temperature has changed,
    and ln(1 + z) / z.

    With that, ln p falls by (g M / R) h / T0 ln(1 + z) / z, with or without a lapse rate: eqs (33a)
    and (33b) in one, as ln(1 + z) / z = 2 artanh(s) / z with s = z / (2 + z) has a series that
    holds at z = 0 too. |s| <= 0.15 in every layer.
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
    """Density, kg/m3, about a height as a power series in the rise of geopotential height, m', from
    there: nine coefficients.

    With T = T_a + L H, (1 + b H) rho' = -(a + b) rho, a = g M / (R T_a), b = L / T_a: each
    coefficient follows from the one before, with or without a lapse rate. Cut off, it is good to
    1e-14 for a rise of `NEAR` metres, and far cheaper than `density_in_layer`.
    """
    cooler = 1.0 / (1.0 + base[1] * (geopotential(height) - base[0]))
    a, b = G0 * M0 / R_STAR * base[2] * cooler, base[1] * cooler
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
    """Density, kg/m3, from `density_series` after a rise of geopotential height, m'."""
    high = c[5] + rise * (c[6] + rise * (c[7] + rise * c[8]))
    return c[0] + rise * (c[1] + rise * (c[2] + rise * (c[3] + rise * (c[4] + rise * high))))


@formula
def geopotential_rise(rise, share, ratio):
    """Rise of geopotential height, m', for a rise in height, m, which is a small ``share`` of the
    distance R0 + h to the earth's centre; ``ratio`` is R0 / (R0 + h). Good to 1e-16 for `NEAR`
    metres."""
    return ratio * ratio * rise * (1.0 - share * (1.0 - share * (1.0 - share)))
