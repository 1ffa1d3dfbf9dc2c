"""Units of parameter names, by kind of quantity, with their factors to SI."""

import math
from typing import Any, TypeGuard

_DEG = math.pi / 180.0
_FT, _LB, _LBF = 0.3048, 0.45359237, 4.4482216152605
_SLUG = _LBF / _FT

# kind -> {suffix: factor to SI}; messages and column names use the first suffix
UNITS: dict[str, dict[str, float]] = {
    "mass": {"kg": 1.0, "g": 1e-3, "t": 1e3, "lb": _LB, "slug": _SLUG},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": _FT},
    "area": {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6, "in2": 0.0254**2, "ft2": _FT**2},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "angle": {"deg": _DEG, "rad": 1.0},
    "speed": {"m_s": 1.0, "km_s": 1e3, "km_h": 1.0 / 3.6, "ft_s": _FT, "kn": 1852.0 / 3600.0},
    "angular rate": {"deg_s": _DEG, "rad_s": 1.0, "rpm": 2.0 * math.pi / 60.0},
    "acceleration": {"m_s2": 1.0, "ft_s2": _FT},
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6, "lbf": _LBF},
    "moment": {"N_m": 1.0, "kN_m": 1e3, "lbf_ft": _LBF * _FT},
    "frequency": {"hz": 1.0},
    "stiffness": {"N_per_m": 1.0, "N_per_mm": 1e3, "kN_per_m": 1e3, "lbf_per_in": _LBF / 0.0254},
    "damping": {"N_s_per_m": 1.0, "kN_s_per_m": 1e3, "lbf_s_per_in": _LBF / 0.0254},
    "density": {"kg_per_m3": 1.0, "g_per_cm3": 1e3, "slug_per_ft3": _SLUG / _FT**3},
    "inertia": {
        "kg_m2": 1.0,
        "kg_mm2": 1e-6,
        "kg_cm2": 1e-4,
        "g_cm2": 1e-7,
        "t_m2": 1e3,
        "slug_ft2": _SLUG * _FT**2,
        "lb_ft2": _LB * _FT**2,
        "lb_in2": _LB * 0.0254**2,
    },
    "pressure": {
        "Pa": 1.0,
        "hPa": 1e2,
        "kPa": 1e3,
        "mbar": 1e2,
        "bar": 1e5,
        "psi": _LBF / 0.0254**2,
    },
    "temperature": {"K": 1.0},
}

_SUFFIXES = sorted({s for table in UNITS.values() for s in table}, key=len, reverse=True)


def unit_kind(suffix: str) -> str:
    """Kind of quantity (a key of `UNITS`) of a unit suffix: "length" for ``mm``. Raises
    StopIteration if the suffix is unknown."""
    return next(kind for kind, table in UNITS.items() if suffix in table)


def unit_text(suffix: str) -> str:
    """Unit suffix as text for readers: "deg/s" for ``deg_s``, "kg m2" for ``kg_m2``, "1" for an
    empty one."""
    over, per, under = suffix.partition("_per_")
    if per:
        return f"{over.replace('_', ' ')}/{under}"
    head, _, last = suffix.rpartition("_")
    return f"{head}{'/' if last in ('s', 's2', 'h') else ' '}{last}" if head else suffix or "1"


def split_unit(key: str) -> tuple[str, str]:
    """Split a key into stem and unit suffix, the longest known one: ``mass_kg`` into ``("mass",
    "kg")``, ``moment_N_m`` into ``("moment", "N_m")``; a key without a known unit into ``(key,
    "")``."""
    for suffix in _SUFFIXES:
        if key.endswith("_" + suffix):
            return key[: -len(suffix) - 1], suffix
    return key, ""


def is_number(value: Any) -> TypeGuard[int | float]:
    """True if a TOML value is a finite number; a boolean is not a number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def are_numbers(value: Any) -> bool:
    """True if a TOML value is a list, nested or not, that has only finite numbers; an empty list
    counts."""
    stack = [value]
    while stack:
        item = stack.pop()
        if isinstance(item, list):
            stack += item
        elif not is_number(item):
            return False
    return isinstance(value, list)
