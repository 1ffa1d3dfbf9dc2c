"""Outcomes that are constant: their values differ by no more than their numerical error.

Two values that each err by at most e say nothing of a difference below 2 e. So an outcome is
constant if its least and its greatest value are no further apart: what scatter there is may be
round-off, and has no distribution and no drivers. One case that differs by more is enough for it to
vary, however many do not.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc.schema import is_yes_or_no

if TYPE_CHECKING:
    from sepmc.analysis.statistics import Histogram

# Round-off, of the scale of an outcome, which is 1e-4 of the largest of its unit or more: 1e-14 of
# that. Separations of bodies that a joint holds scatter by 2e-16 of the vehicle, which halved steps
# need not show.
_ROUND_OFF = 1e-10
_PLACED = 0.01  # of a time or place of an extreme: less sure, the extreme is flat
_DIGITS = 7  # that a constant is written with, at most
# The outcome from whose extreme another one tells the time or the place, by the ends of both names.
_EXTREMES = {
    "_peak_force_time_s": "_peak_force_N",
    "_peak_moment_time_s": "_peak_moment_N_m",
    "_clearance_time_s": "_clearance_mm",
    "_clearance_station_m": "_clearance_mm",
    "_clearance_y_m": "_clearance_mm",
    "_clearance_z_m": "_clearance_mm",
}


def error_size(share: float, scale: float, value: float) -> float:
    """Numerical error of an outcome at a ``value``, in its unit, round-off included.

    Parameters
    ----------
    share : float
        Error as a share of the size of the outcome, or of the ``scale`` if that is larger
        (`sepmc.campaign.execution.accuracy.errors`). Where it is not known or infinite, round-off
        alone counts.
    scale, value : float
        In the unit of the outcome.
    """
    known = share * max(abs(value), scale) if np.isfinite(share) else 0.0
    return float(known + _ROUND_OFF * scale)


def with_constants(table: pd.DataFrame, errors: Mapping[str, tuple[float, float]]) -> pd.DataFrame:
    """Statistics with two more columns: ``error_size``, the numerical error in the unit of each
    outcome, and ``constant``, whether at least two cases have it and none differs from another by
    more than twice that.

    When and where an extreme lies is as uncertain as the extreme is flat, from case to case by
    another amount: it is called constant only if the extreme is, too.

    Parameters
    ----------
    table : DataFrame, one row per outcome
        From `sepmc.analysis.statistics.statistics`.
    errors : mapping of outcome to (share, scale)
        See `error_size`.
    """
    names = list(map(str, table.index))
    low, high = (table[end].to_numpy(dtype=float) for end in ("min", "max"))
    largest = np.fmax(np.abs(low), np.abs(high))
    size = np.array([_size(name, errors, x) for name, x in zip(names, largest, strict=True)])
    with np.errstate(invalid="ignore"):  # infinities have no distance from each other
        near = high - low <= 2.0 * size
    of_name = dict(zip(names, near, strict=True))
    flat = np.array([of_name.get(_extreme(name) or name, True) for name in names], dtype=bool)
    alike = (low == high) | (near & flat)
    return table.assign(error_size=size, constant=(table["n"].to_numpy() > 1) & alike)


def _size(name: str, errors: Mapping[str, tuple[float, float]], largest: float) -> float:
    """The numerical error of an outcome, none of what is yes or no; NaN if no case has it."""
    if is_yes_or_no(name):
        return 0.0
    return error_size(*errors.get(name, (np.nan, 0.0)), largest) if np.isfinite(largest) else np.nan


def _extreme(name: str) -> str | None:
    """The outcome of whose extreme another one is the time or place; None if it is none."""
    return next(
        (name.removesuffix(end) + of for end, of in _EXTREMES.items() if name.endswith(end)), None
    )


def is_constant(table: pd.DataFrame, name: str) -> bool:
    """Whether a table of `with_constants` says so of an outcome; of any other table, no."""
    return "constant" in table and name in table.index and bool(table.at[name, "constant"])


def max_spread(table: pd.DataFrame, name: str) -> float:
    """How far the values of a constant outcome may be apart, in its unit; 0 of any other."""
    return 2.0 * float(table["error_size"][name]) if is_constant(table, name) else 0.0


def joint_error(one: pd.DataFrame, two: pd.DataFrame, name: str) -> float:
    """How far an outcome of one run and of another may be apart by numerical error alone, in its
    unit; 0 if that is not known, as of times and places of extremes that are not flat."""
    alike = is_constant(one, name) and is_constant(two, name)
    if _extreme(name) and not alike:
        return 0.0
    sizes = [float(table["error_size"][name]) for table in (one, two)]
    return sum(sizes) if np.isfinite(sizes).all() else 0.0


def round_to_error(value: float, error: float) -> float:
    """A value to the digits that its numerical error leaves; 0 if it leaves none."""
    if not np.isfinite(value) or abs(value) <= error:
        return 0.0 if abs(value) <= error else float(value)
    digits = np.log10(abs(value) / error) if error > 0.0 else np.inf
    return float(f"{value:.{int(np.clip(np.floor(digits), 1, _DIGITS))}g}")


def constant_value(table: pd.DataFrame, name: str) -> float:
    """The one value of a constant outcome, see `round_to_error`."""
    return round_to_error(float(table["mean"][name]), float(table["error_size"][name]))


def with_constant_values(table: pd.DataFrame) -> pd.DataFrame:
    """Statistics for a reader: those of a constant outcome are its one value, without a sigma."""
    if "constant" not in table:
        return table
    found = table.copy()
    rows = found["constant"].to_numpy(dtype=bool)
    values = [constant_value(table, str(name)) for name in found.index[rows]]
    for name in found:
        if name in ("mean", "min", "max") or str(name)[:2] in ("p0", "p1", "p5", "p9"):
            found.loc[rows, name] = np.where(np.isnan(found[name][rows]), np.nan, values)
    found.loc[rows, ["sigma", "mean_se", "sigma_se"]] = 0.0
    return found


def render_constants(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> list[str]:
    """The constant outcomes of a table of `with_constants`, a line each, but for those that are yes
    or no."""
    return [
        f"{name}: {render_constant(table, name, units)}"
        for name in map(str, table.index)
        if is_constant(table, name) and not is_yes_or_no(name)
    ]


def render_constant(table: pd.DataFrame, name: str, units: Mapping[str, str] | None = None) -> str:
    """At what a constant outcome is constant, in words."""
    mean, error, n = (float(table[key][name]) for key in ("mean", "error_size", "n"))
    unit = (units or {}).get(name, "")
    unit = "" if unit == "1" else f" {unit}"
    within = f"{n:.0f} values differ by no more than their numerical error, {error:.1g}{unit}"
    if _extreme(name) and error > _PLACED * abs(mean):
        return f"not known, as its extreme is flat ({within})"
    alike = f"all {n:.0f} values are the same" if table.at[name, "sigma"] == 0.0 else within
    return f"constant {constant_value(table, name):.{_DIGITS}g}{unit} ({alike})"


def collapse_constant(
    found: "Histogram | None", table: pd.DataFrame, name: str
) -> "Histogram | None":
    """The histogram of an outcome; if that is constant, of its one value, without bins."""
    if found is None or not is_constant(table, name):
        return found
    value, none = constant_value(table, name), np.empty(0)
    return found._replace(mean=value, sigma=0.0, low=value, high=value, edges=none, counts=none)
