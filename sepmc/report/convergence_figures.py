"""Exceedance curves of required outcomes, and convergence of means and sigmas with the number of
cases."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from scipy.special import betaincinv

from sepmc.analysis.requirements import Verdict, margins
from sepmc.analysis.statistics import TWO_SIDED, student_half_width
from sepmc.report.style import (
    BLACK,
    BLUE,
    BOUND,
    REQUIRED,
    make_axes,
    make_folder,
    save,
    set_panel_title,
    set_title,
)
from sepmc.wording import to_words

_POINTS = 400  # points of a curve
_RISK = 0.05  # of an interval, both sides together
_FIRST = 10  # smallest number of cases with a mean


def exceedance_figure(
    values: Mapping[str, np.ndarray],
    verdicts: Sequence[Verdict],
    folder: Path,
    units: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw for each requirement the fraction of cases beyond each value of its outcome (above it if
    the bound is an upper one, below it if a lower one), with its 95 % Clopper-Pearson band.

    For a requirement with two bounds it is the fraction of cases below each value of the margin,
    the signed distance from the nearer bound.

    Parameters
    ----------
    values : mapping of outcome to ndarray, shape (n,)
        Values in all cases; NaN, where a case does not have the outcome, counts as a violation, as
        it does for a verdict.
    verdicts : sequence of Verdict
        Verdicts whose ``metric`` is not in ``values``, or which have no bound, are not drawn; at
        least one must remain.
    folder : Path
        Created if missing.
    units : mapping of outcome to unit
    about : str
        The campaign, for the title.
    suffix : str
        Ending of the file name, with its dot, which selects the format.

    Returns
    -------
    Path
        The file written, ``requirements`` + suffix in the folder.
    """
    drawn = [v for v in verdicts if v.metric in values and (v.at_least, v.at_most) != (None, None)]
    columns = min(2, len(drawn))
    figure, axes = make_axes(-(-len(drawn) // columns), columns, (6.4, 3.6))
    for ax, v in zip(axes, drawn, strict=False):
        unit = units.get(v.metric, "")
        name = to_words(v.metric, unit)
        label = f"{name} ({unit})" if unit else name
        bounds = [bound for bound in (v.at_least, v.at_most) if bound is not None]
        outcome, bound, upper = values[v.metric], bounds[0], v.at_least is None
        if len(bounds) > 1:
            outcome, bound = margins(outcome, v), 0.0
            bounds_text = f"to the nearer of {v.at_least:g} and {v.at_most:g}, below 0 beyond it"
            label = f"margin of {label}\n{bounds_text}"
        _exceedance(ax, outcome, upper)
        ax.axvline(bound, color=BOUND, linewidth=2.2, label=REQUIRED)
        allowed = 1.0 - v.probability
        ax.axhline(allowed, color=BLACK, linewidth=1.0, linestyle=":", label="allowed fraction")
        if v.design_value is not None:
            ax.plot(
                v.design_value, allowed, "D", color=BLACK, ms=5, zorder=5,
                label="design value, with the required confidence",
            )  # fmt: skip
        missing = int(np.isnan(outcome).sum())
        note = f"; {missing:,} cases without the outcome count as violations" if missing else ""
        present = outcome[~np.isnan(outcome)]
        constant = "; constant" if len(present) > 1 and np.ptp(present) == 0.0 else ""
        set_panel_title(ax, f"{v.name}: {v.verdict}{constant}{note}", 10)
        ax.set_xlabel(label)
        ax.set_ylabel(f"fraction of cases {'above' if upper else 'below'}")
    for ax in axes[len(drawn) :]:
        ax.remove()
    set_title(figure, f"Requirements of {about}")
    return save(figure, make_folder(folder) / f"requirements{suffix}")


def _exceedance(ax: Axes, values: np.ndarray, upper: bool) -> None:
    """Draw the fraction of cases above (if ``upper``) or below each value, as a curve over the
    ``values`` (n,) of the cases, and its 95 % band; NaN counts as beyond every value."""
    x, n = np.sort(values[~np.isnan(values)]), len(values)
    ranks = np.unique(np.geomspace(1, len(x), _POINTS).astype(int))
    points = np.union1d(x[ranks - 1], x[len(x) - ranks])
    below = np.searchsorted(x, points, "left"), np.searchsorted(x, points, "right")
    k = n - len(x) + (len(x) - below[1] if upper else below[0])
    low = np.where(k > 0, betaincinv(np.maximum(k, 1), n - k + 1, _RISK / 2), 0.0)
    high = np.where(k < n, betaincinv(k + 1, np.maximum(n - k, 1), 1 - _RISK / 2), 1.0)
    step: Literal["post", "pre"] = "post" if upper else "pre"
    floor = 0.3 / n  # zero has no place on a logarithmic scale
    if x[0] == x[-1]:  # one value has no curve
        ax.axvline(x[0], color=BLUE, linewidth=4, label="all cases (equal)")
    else:
        ax.fill_between(
            points, np.maximum(low, floor), high, step=step, color="#a9cdea", linewidth=0,
            label="95 % interval at each value",
        )  # fmt: skip
        fractions = np.where(k > 0, k / n, np.nan)
        ax.step(points, fractions, where=step, color=BLUE, lw=1.6, label="cases")
    ax.set_yscale("log")
    ax.set_ylim(floor, 1.3)


def convergence_figure(
    values: Mapping[str, np.ndarray],
    folder: Path,
    units: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw mean and sigma of each outcome over the number of cases, with 95 % bands.

    Parameters
    ----------
    values : mapping of outcome to ndarray, shape (n,)
        Values in the ok cases, in the order of the cases.
    folder, units, suffix
        As for `exceedance_figure`.
    about : str
        The campaign, for the title; further lines are notes on undersampled values.

    Returns
    -------
    Path
        The file written, ``convergence`` + suffix in the folder.
    """
    figure, axes = make_axes(len(values), 2, (5.2, 2.5))
    for row, (outcome, x) in enumerate(values.items()):
        n = np.unique(np.geomspace(min(_FIRST, len(x)), len(x), _POINTS).astype(int))
        unit = units.get(outcome, "")
        for ax, (curve, low, high), statistic in zip(
            axes[2 * row : 2 * row + 2], running_statistics(x, n), ("mean", "sigma"), strict=True
        ):
            ax.fill_between(n, low, high, color="#a9cdea", linewidth=0, label="95 % interval")
            ax.plot(n, curve, color=BLUE, linewidth=1.4, label="estimate from the first n cases")
            ax.set_xscale("log")
            ax.set_ylabel(f"{statistic} ({unit})" if unit else statistic)
            set_panel_title(ax, to_words(outcome, unit), 9.5)
    for ax in axes[-2:]:
        ax.set_xlabel("number n of ok cases")
    set_title(figure, f"Convergence of {about}")
    return save(figure, make_folder(folder) / f"convergence{suffix}")


_MAX_LOG_FACTOR = 300.0  # largest logarithm of the factor on sigma, for few and uneven cases


def running_statistics(x: np.ndarray, n: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """Return mean and sigma of the first n cases of an outcome for several n, each with its 95 %
    interval.

    The interval of the mean is Student's; that of sigma Bonett's (Computational Statistics and Data
    Analysis 50 (2006) 775), about the median of all values. With ten cases of a normal, a uniform
    and an exponential distribution its coverage is 96, 98 and 91 %.

    Parameters
    ----------
    x : ndarray, shape (cases,)
        Values of the outcome, in the order of the cases.
    n : ndarray, shape (m,), int
        Numbers of cases, at least 2 (for 1 the mean is given, and NaN for all else).

    Returns
    -------
    mean, sigma : tuple of three ndarray, each shape (m,)
        For each n the statistic, and the low and the high end of its interval, in the unit of x.
    """
    median, span = np.median(x), max(float(np.ptp(x)), 1e-300)
    c = (x - median) / span  # scaled, so that powers neither overflow nor underflow
    mean_power, second, fourth = (np.cumsum(c**p)[n - 1] / n for p in (1, 2, 4))
    mean, spread = median + span * mean_power, np.maximum(second - mean_power**2, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):  # one case has no sigma: NaN
        sigma = span * np.sqrt(spread * n / (n - 1))
        reach = student_half_width(n - 1) * sigma / np.sqrt(n)
        kurtosis = np.divide(fourth, spread**2, out=np.ones(len(n)), where=spread > 0.0)
        correction = n / (n - TWO_SIDED)
        error = correction * np.sqrt(np.maximum(kurtosis - (n - 3) / n, 0.0) / (n - 1)) / 2.0
        reach_log = np.minimum(TWO_SIDED * error, _MAX_LOG_FACTOR)
        ends = [sigma * np.sqrt(correction) * np.exp(side * reach_log) for side in (-1.0, 1.0)]
    return (mean, mean - reach, mean + reach), (sigma, *ends)
