"""Constant outcomes: numerical error alone can explain all differences between their values.

Two values with errors up to e say nothing about a difference below 2 e. So an outcome is constant
if its minimum and maximum differ by at most 2 e: its scatter may be numerical error, so it has no
distribution and no sensitivity. One case that differs by more makes the outcome vary.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc.schema import is_yes_or_no

if TYPE_CHECKING:
    from sepmc.analysis.statistics import Histogram

# Round-off relative to the scale of an outcome, which is at least 1e-4 of the largest of its unit:
# 1e-14 of that. Separations of joined bodies scatter by 2e-16 of the vehicle, which halving the
# steps need not show.
_ROUND_OFF = 1e-10
_MAX_RELATIVE_ERROR = 0.01  # of the time or place of an extreme; above it the extreme is flat
_DIGITS = 7  # largest number of digits of a constant
# Suffix of a time or place of an extreme, and of the outcome with that extreme.
_EXTREME_OF = {
    "_peak_force_time_s": "_peak_force_N",
    "_peak_moment_time_s": "_peak_moment_N_m",
    "_clearance_time_s": "_clearance_mm",
    "_clearance_station_m": "_clearance_mm",
    "_clearance_y_m": "_clearance_mm",
    "_clearance_z_m": "_clearance_mm",
}


def error_size(relative: float, scale: float, value: float) -> float:
    """Return the numerical error of an outcome at a ``value``, in its unit, including round-off
    (1e-10 of the ``scale``).

    Parameters
    ----------
    relative : float
        Error relative to the absolute ``value``, or to the ``scale`` if that is larger
        (`sepmc.campaign.execution.accuracy.errors`). If it is not finite, round-off alone counts.
    scale, value : float
        Scale of the outcome, mostly its standard deviation
        (`sepmc.campaign.execution.accuracy.scales`), and the value, in the unit of the outcome.
    """
    from_steps = relative * max(abs(value), scale) if np.isfinite(relative) else 0.0
    return float(from_steps + _ROUND_OFF * scale)


def with_constants(table: pd.DataFrame, errors: Mapping[str, tuple[float, float]]) -> pd.DataFrame:
    """Add the columns ``error_size`` and ``constant`` to a table of statistics.

    ``error_size`` is the numerical error in the unit of the outcome; ``constant`` is True if at
    least two cases have the outcome and none differs from another by more than twice the error. The
    time or place of an extreme (such as a peak force) is uncertain where the extreme is flat, by an
    amount that varies from case to case: it counts as constant only if all its values are equal or
    the extreme is constant, too.

    Parameters
    ----------
    table : DataFrame, one row per outcome
        From `sepmc.analysis.statistics.statistics`.
    errors : mapping of outcome to (relative error, scale)
        See `error_size`.

    Returns
    -------
    DataFrame
        A copy of ``table`` with the two columns.
    """
    names = list(map(str, table.index))
    low, high = (table[end].to_numpy(dtype=float) for end in ("min", "max"))
    largest = np.fmax(np.abs(low), np.abs(high))
    size = np.array([_size(name, errors, x) for name, x in zip(names, largest, strict=True)])
    with np.errstate(invalid="ignore"):  # inf - inf
        is_near = high - low <= 2.0 * size
    near_by_name = dict(zip(names, is_near, strict=True))
    extreme_is_near = np.array(
        [near_by_name.get(_extreme(name) or name, True) for name in names], dtype=bool
    )
    is_constant = (low == high) | (is_near & extreme_is_near)
    return table.assign(error_size=size, constant=(table["n"].to_numpy() > 1) & is_constant)


def _size(name: str, errors: Mapping[str, tuple[float, float]], largest: float) -> float:
    """Return the numerical error of an outcome, in its unit, from ``largest``, its largest absolute
    value, and ``errors``, the arguments ``relative`` and ``scale`` of `error_size` by outcome: 0
    for a yes-or-no outcome, NaN if ``largest`` is not finite (no case has it), and 0 for another
    outcome that ``errors`` lacks."""
    if is_yes_or_no(name):
        return 0.0
    return error_size(*errors.get(name, (np.nan, 0.0)), largest) if np.isfinite(largest) else np.nan


def _extreme(name: str) -> str | None:
    """Return the name of the outcome (peak force, peak moment or clearance) whose time or place the
    outcome ``name`` is; None if it is no time or place of an extreme."""
    return next(
        (name.removesuffix(end) + of for end, of in _EXTREME_OF.items() if name.endswith(end)), None
    )


def is_constant(table: pd.DataFrame, name: str) -> bool:
    """Return True if a table marks an outcome as constant.

    Parameters
    ----------
    table : DataFrame
        Statistics, from `with_constants` or not.
    name : str
        Outcome.

    Returns
    -------
    bool
        False for a table without the column ``constant`` or without the outcome.
    """
    return "constant" in table and name in table.index and bool(table.at[name, "constant"])


def max_spread(table: pd.DataFrame, name: str) -> float:
    """Return the largest difference that values of a constant outcome can have: twice its numerical
    error.

    Parameters
    ----------
    table : DataFrame
        From `with_constants`.
    name : str
        Outcome.

    Returns
    -------
    float
        In the unit of the outcome; 0 if it is not constant.
    """
    return 2.0 * float(table["error_size"][name]) if is_constant(table, name) else 0.0


def joint_error(one: pd.DataFrame, two: pd.DataFrame, name: str) -> float:
    """Return the largest difference between two runs that numerical error can explain.

    Parameters
    ----------
    one, two : DataFrame
        From `with_constants`, for either run.
    name : str
        Outcome.

    Returns
    -------
    float
        In the unit of the outcome. It is 0 if an error is unknown, and for the time or place of
        an extreme that is not constant in both runs.
    """
    both_constant = is_constant(one, name) and is_constant(two, name)
    if _extreme(name) and not both_constant:
        return 0.0
    sizes = [float(table["error_size"][name]) for table in (one, two)]
    return sum(sizes) if np.isfinite(sizes).all() else 0.0


def round_to_error(value: float, error: float) -> float:
    """Return a value rounded to the significant digits that its numerical error, in the same unit,
    leaves certain, one to seven (seven if the error is NaN); 0 if the error is as large as the
    value. NaN, and infinity with a finite error, are returned unchanged."""
    if not np.isfinite(value) or abs(value) <= error:
        return 0.0 if abs(value) <= error else float(value)
    digits = np.log10(abs(value) / error) if error > 0.0 else np.inf
    return float(f"{value:.{int(np.clip(np.floor(digits), 1, _DIGITS))}g}")


def constant_value(table: pd.DataFrame, name: str) -> float:
    """Return the value of a constant outcome: its mean, rounded by `round_to_error`. ``table`` is
    from `with_constants`."""
    return round_to_error(float(table["mean"][name]), float(table["error_size"][name]))


def with_constant_values(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of statistics with the numbers of constant outcomes replaced: mean, minimum,
    maximum and percentiles by their `constant_value`, sigma and standard errors by 0. A table
    without constant outcomes, or without the column ``constant``, is returned as it is."""
    if "constant" not in table:
        return table
    mask = table["constant"].to_numpy(dtype=bool)
    if not mask.any():
        return table
    values = np.full(len(table), np.nan)
    values[mask] = [constant_value(table, str(name)) for name in table.index[mask]]
    columns = {}
    for name, original in table.items():  # assignments to a frame take 2 ms each
        column = original
        if name in ("mean", "min", "max") or str(name)[:2] in ("p0", "p1", "p5", "p9"):
            column = original.where(~mask | original.isna(), values)
        elif name in ("sigma", "mean_se", "sigma_se"):
            column = original.where(~mask, 0.0)
        columns[name] = column
    return pd.DataFrame(columns, index=table.index)


def render_constants(table: pd.DataFrame, units: Mapping[str, str] | None = None) -> list[str]:
    """Render the constant outcomes of a table of `with_constants`, except yes-or-no ones: a line
    for each, with its name, a colon and the text of `render_constant`. ``units`` maps outcomes to
    units."""
    return [
        f"{name}: {render_constant(table, name, units)}"
        for name in map(str, table.index)
        if is_constant(table, name) and not is_yes_or_no(name)
    ]


def render_constant(table: pd.DataFrame, name: str, units: Mapping[str, str] | None = None) -> str:
    """Render a constant outcome as its value, or as undetermined for the time or place of a flat
    extreme, with the reason why it counts as constant. ``table`` is from `with_constants`, ``name``
    the outcome. ``units`` maps outcomes to units: an outcome that it lacks, and any if it is None,
    is rendered without one."""
    mean, error, n = (float(table[key][name]) for key in ("mean", "error_size", "n"))
    unit = (units or {}).get(name, "")
    unit = "" if unit == "1" else f" {unit}"
    difference = (
        f"{n:.0f} values differ by no more than twice their numerical error of {error:.1g}{unit}"
    )
    if _extreme(name) and error > _MAX_RELATIVE_ERROR * abs(mean):
        return f"undetermined, as its extreme is flat ({difference})"
    remark = f"all {n:.0f} values are equal" if table.at[name, "sigma"] == 0.0 else difference
    return f"constant {constant_value(table, name):.{_DIGITS}g}{unit} ({remark})"


def collapse_constant(
    histogram: "Histogram | None", table: pd.DataFrame, name: str
) -> "Histogram | None":
    """Return the histogram of an outcome, reduced to a single value if the outcome is constant.

    Parameters
    ----------
    histogram : Histogram or None
    table : DataFrame
        From `with_constants`.
    name : str
        Outcome.

    Returns
    -------
    Histogram or None
        ``histogram`` itself if it is None or the outcome is not constant; else a copy without bins,
        with the constant value as mean and both ends, and a sigma of 0.
    """
    if histogram is None or not is_constant(table, name):
        return histogram
    value, empty = constant_value(table, name), np.empty(0)
    return histogram._replace(
        mean=value, sigma=0.0, low=value, high=value, edges=empty, counts=empty
    )
