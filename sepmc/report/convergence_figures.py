"""How often: what share of all cases lies beyond each value of an outcome, and how well a mean and
a sigma are known as cases come in."""

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
    set_title,
    to_words,
)

_POINTS = 400  # of a curve
_RISK = 0.05  # of an interval, both sides
_FIRST = 10  # cases from which on a mean is shown


def exceedance_figure(
    values: Mapping[str, np.ndarray],
    verdicts: Sequence[Verdict],
    folder: Path,
    units: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw for each requirement on an outcome the share of cases beyond each of its values, on the
    side of the bound, with Clopper and Pearson's 95 % band at each value; between two bounds the
    share of cases that have less than each margin to the nearer of them (so is the design value);
    into ``requirements.png``, or with another ``suffix``; returns its path.

    Parameters
    ----------
    values : mapping of outcome to its values (n,) in all cases; NaN, where a case does not have it,
        counts as beyond, as it does for a verdict
    verdicts : on the requirements, each drawn if ``values`` has its metric
    folder : made if it is not there
    units : of the outcomes
    about : the campaign, for the title
    """
    drawn = [v for v in verdicts if v.metric in values and (v.at_least, v.at_most) != (None, None)]
    columns = min(2, len(drawn))
    figure, axes = make_axes(-(-len(drawn) // columns), columns, (6.4, 3.6))
    for ax, v in zip(axes, drawn, strict=False):
        unit = units.get(v.metric, "")
        name = to_words(v.metric, unit)
        label = f"{name} ({unit})" if unit else name
        bounds = [bound for bound in (v.at_least, v.at_most) if bound is not None]
        shown, bound, upper = values[v.metric], bounds[0], v.at_least is None
        if len(bounds) > 1:
            shown, bound = margins(shown, v), 0.0
            within = f"to the nearer of {v.at_least:g} and {v.at_most:g}, below 0 beyond it"
            label = f"margin of {label}\n{within}"
        _exceedance(ax, shown, upper)
        ax.axvline(bound, color=BOUND, linewidth=2.2, label=REQUIRED)
        allowed = 1.0 - v.probability
        ax.axhline(allowed, color=BLACK, linewidth=1.0, linestyle=":", label="share allowed")
        if v.design_value is not None:
            ax.plot(
                v.design_value, allowed, "D", color=BLACK, ms=5, zorder=5,
                label="design value, with the confidence required",
            )  # fmt: skip
        missing = int(np.isnan(shown).sum())
        told = f"; {missing:,} cases without outcome count as beyond" if missing else ""
        known = shown[~np.isnan(shown)]
        alike = "; constant" if len(known) > 1 and np.ptp(known) == 0.0 else ""
        ax.set_title(f"{v.name}: {v.verdict}{alike}{told}", fontsize=10)
        ax.set_xlabel(label)
        ax.set_ylabel(f"share of cases {'above' if upper else 'below'}")
    for ax in axes[len(drawn) :]:
        ax.remove()
    set_title(figure, f"Requirements of {about}")
    return save(figure, make_folder(folder) / f"requirements{suffix}")


def _exceedance(ax: Axes, values: np.ndarray, upper: bool) -> None:
    """The share of values that lie above, or below, each of them, and its band."""
    x, n = np.sort(values[~np.isnan(values)]), len(values)
    places = np.unique(np.geomspace(1, len(x), _POINTS).astype(int))
    where = np.union1d(x[places - 1], x[len(x) - places])
    below = np.searchsorted(x, where, "left"), np.searchsorted(x, where, "right")
    k = n - len(x) + (len(x) - below[1] if upper else below[0])
    low = np.where(k > 0, betaincinv(np.maximum(k, 1), n - k + 1, _RISK / 2), 0.0)
    high = np.where(k < n, betaincinv(k + 1, np.maximum(n - k, 1), 1 - _RISK / 2), 1.0)
    step: Literal["post", "pre"] = "post" if upper else "pre"
    floor = 0.3 / n  # where no case is beyond, a logarithm has no place
    if x[0] == x[-1]:  # one value has no curve
        ax.axvline(x[0], color=BLUE, linewidth=4, label="all cases, which are alike")
    else:
        ax.fill_between(
            where, np.maximum(low, floor), high, step=step, color="#a9cdea", linewidth=0,
            label="95 % at each value",
        )  # fmt: skip
        shares = np.where(k > 0, k / n, np.nan)
        ax.step(where, shares, where=step, color=BLUE, lw=1.6, label="cases")
    ax.set_yscale("log")
    ax.set_ylim(floor, 1.3)


def convergence_figure(
    values: Mapping[str, np.ndarray],
    folder: Path,
    units: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw the mean and the sigma of outcomes over the number of cases, each with its 95 % band,
    into ``convergence.png``, or with another ``suffix``; returns its path.

    Parameters
    ----------
    values : mapping of outcome to its values (n,) in the ok cases, in the order in which these came
    folder, units : as for `exceedance_figure`
    about : the campaign, for the title, and on lines of their own what cases hardly show
    """
    figure, axes = make_axes(len(values), 2, (5.2, 2.5))
    for row, (outcome, x) in enumerate(values.items()):
        n = np.unique(np.geomspace(min(_FIRST, len(x)), len(x), _POINTS).astype(int))
        unit = units.get(outcome, "")
        for ax, (curve, low, high), what in zip(
            axes[2 * row : 2 * row + 2], running_statistics(x, n), ("mean", "sigma"), strict=True
        ):
            ax.fill_between(n, low, high, color="#a9cdea", linewidth=0, label="95 %")
            ax.plot(n, curve, color=BLUE, linewidth=1.4, label="of the cases so far")
            ax.set_xscale("log")
            ax.set_ylabel(f"{what} ({unit})" if unit else what)
            ax.set_title(to_words(outcome, unit), fontsize=9.5)
    for ax in axes[-2:]:
        ax.set_xlabel("ok cases")
    set_title(figure, f"Convergence of {about}")
    return save(figure, make_folder(folder) / f"convergence{suffix}")


_WIDEST = 300.0  # logarithm of a factor on sigma: few, uneven cases say nothing of it


def running_statistics(x: np.ndarray, n: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """Mean and sigma of the first cases of an outcome, each with its 95 % interval.

    The interval of the mean is Student's; that of sigma Bonett's (Computational Statistics and Data
    Analysis 50 (2006) 775), about the median of all values. Of ten cases of a normal, a uniform and
    an exponential law, 96, 98 and 91 % hold sigma.

    Parameters
    ----------
    x : ndarray, shape (cases,)
    n : ndarray, shape (m,), int
        How many cases, >= 2.

    Returns
    -------
    mean, sigma : tuple of ndarray, each shape (m,)
        The statistic, the low end and the high end of its interval, in the unit of x.
    """
    middle, span = np.median(x), max(float(np.ptp(x)), 1e-300)
    c = (x - middle) / span  # sums of powers of small numbers
    first, second, fourth = (np.cumsum(c**p)[n - 1] / n for p in (1, 2, 4))
    mean, spread = middle + span * first, np.maximum(second - first**2, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):  # one case has no sigma: NaN
        sigma = span * np.sqrt(spread * n / (n - 1))
        reach = student_half_width(n - 1) * sigma / np.sqrt(n)
        kurtosis = np.divide(fourth, spread**2, out=np.ones(len(n)), where=spread > 0.0)
        few = n / (n - TWO_SIDED)
        error = few * np.sqrt(np.maximum(kurtosis - (n - 3) / n, 0.0) / (n - 1)) / 2.0
        reach_log = np.minimum(TWO_SIDED * error, _WIDEST)
        ends = [sigma * np.sqrt(few) * np.exp(side * reach_log) for side in (-1.0, 1.0)]
    return (mean, mean - reach, mean + reach), (sigma, *ends)
