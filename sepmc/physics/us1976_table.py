"""Constants and layers of the US Standard Atmosphere 1976 (NOAA-S/T 76-1562, tables 2 and 4)."""

R0 = 6_356_766.0  # m, earth radius of the geopotential
G0 = 9.80665  # m/s2
R_STAR = 8314.32  # J/(kmol K), as in the standard
M0 = 28.9644  # kg/kmol
TOP = 86_000.0  # m, geometric height at which the standard ends here

# base of each layer, m', and the top
BASES = (0.0, 11_000.0, 20_000.0, 32_000.0, 47_000.0, 51_000.0, 71_000.0, R0 * TOP / (R0 + TOP))
LAPSES = (-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3)  # K/m'
BORDERS = tuple(R0 * h / (R0 - h) for h in BASES[1:-1])  # of the layers, geometric, m
