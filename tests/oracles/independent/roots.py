"""First time in a step at which a function becomes positive."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, minimize_scalar

_SAMPLES = 8  # samples of a function per step; peaks between them are searched


def first_root(value: Callable[[float], float], start: float, end: float) -> float | None:
    """First time in (start, end] at which ``value`` is not negative, or None. It is negative at the
    start."""
    times = np.linspace(start, end, _SAMPLES + 1).tolist()
    values = [value(t) for t in times]
    for i in range(1, _SAMPLES + 1):
        low, high = times[i - 1], times[i]
        if values[i] < 0.0:
            if i == _SAMPLES or not (values[i] >= values[i - 1] and values[i] >= values[i + 1]):
                continue
            # too far below zero for a smooth peak to reach it
            if values[i] + (values[i] - min(values[i - 1], values[i + 1])) < 0.0:
                continue
            high = _peak(value, low, times[i + 1])
            if value(high) < 0.0:
                continue
        while low > start and value(low) >= 0.0:
            low -= 0.5 * (end - start) / _SAMPLES
        return float(brentq(value, low, high, xtol=1e-15)) if value(low) < 0.0 else float(low)
    return None


def _peak(value: Callable[[float], float], low: float, high: float) -> float:
    """Time of the maximum between two times."""
    minimum = minimize_scalar(
        lambda t: -value(t), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    return float(minimum.x)
