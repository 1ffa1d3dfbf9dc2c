"""US Standard Atmosphere 1976, 0 to 86 km geometric height (NOAA-S/T 76-1562, tables 3, 4 and eqs 18, 23, 33, 42)."""

import math

from sepmc.kernels._jit import formula

R0 = 6_356_766.0  # m, radius that ties geopotential to geometric height
G0 = 9.80665  # m/s2
R_STAR = 8314.32  # J/(kmol K), the value of the 1976 standard
M0 = 28.9644  # kg/kmol
TOP = 86_000.0  # m

_H = (0.0, 11_000.0, 20_000.0, 32_000.0, 47_000.0, 51_000.0, 71_000.0)  # m', base of each layer
_L = (-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3)  # K/m', lapse rate


def _bases() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Temperature (K) and pressure (Pa) at the base of each layer, built up from the ground."""
    temperature, pressure = [288.15], [101_325.0]
    for low, high, lapse in zip(_H, _H[1:], _L, strict=False):
        t0, p0 = temperature[-1], pressure[-1]
        t1 = t0 + lapse * (high - low)
        gmr = G0 * M0 / R_STAR
        temperature.append(t1)
        pressure.append(p0 * math.exp(-gmr * (high - low) / t0) if lapse == 0.0 else p0 * (t0 / t1) ** (gmr / lapse))
    return tuple(temperature), tuple(pressure)


_T, _P = _bases()


@formula
def sound_speed(temperature):
    """Speed of sound, m/s, from the molecular-scale temperature, K; eq (50) of the 1976 standard."""
    return math.sqrt(1.4 * R_STAR / M0 * temperature)


@formula
def us1976(height):
    """Density, pressure and molecular-scale temperature at a geometric height.

    height : m, 0 to 86 km. Outside, all three are NaN: nothing is extrapolated.
    Returns kg/m3, Pa, K. Checked against the printed tables of the standard.
    """
    if not 0.0 <= height <= TOP:
        return math.nan, math.nan, math.nan
    h = R0 * height / (R0 + height)
    k = 0
    while k < 6 and h >= _H[k + 1]:
        k += 1
    t = _T[k] + _L[k] * (h - _H[k])
    gmr = G0 * M0 / R_STAR
    if _L[k] == 0.0:
        p = _P[k] * math.exp(-gmr * (h - _H[k]) / _T[k])
    else:
        p = _P[k] * math.exp(-gmr / _L[k] * math.log(t / _T[k]))
    return p * M0 / (R_STAR * t), p, t
