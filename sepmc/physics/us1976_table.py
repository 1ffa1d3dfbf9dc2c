"""Constants and layers of the US Standard Atmosphere 1976 (NOAA-S/T 76-1562, tables 2 and 4):
numbers alone, nothing to compile."""

R0 = 6_356_766.0  # m, radius that ties geopotential to geometric height
G0 = 9.80665  # m/s2
R_STAR = 8314.32  # J/(kmol K), the value of the 1976 standard
M0 = 28.9644  # kg/kmol
TOP = 86_000.0  # m

# m', of each layer; the top
BASES = (0.0, 11_000.0, 20_000.0, 32_000.0, 47_000.0, 51_000.0, 71_000.0, R0 * TOP / (R0 + TOP))
LAPSES = (-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3)  # K/m'
BORDERS = tuple(R0 * h / (R0 - h) for h in BASES[1:-1])  # m, geometric
