"""Figures of a campaign, after Figs 8 to 11 of Wang, Li, Liu, Journal of System Simulation 31(4),
2019: separation over time as percentile bands, and histograms of outcomes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.markers import TICKUP
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from sepmc.analysis.statistics import Histogram, percentile_curves
from sepmc.analysis.statistics_text import rounded
from sepmc.report.style import (
    BLACK,
    BLUE,
    BOUND,
    REFERENCE,
    REQUIRED,
    VERMILION,
    make_axes,
    make_folder,
    save,
    set_panel_title,
    set_title,
)
from sepmc.wording import count_cases, to_words

BANDS = (
    ("min", "max", "#dce9f5", "min to max"),
    ("p1", "p99", "#a9cdea", "1 to 99 %"),
    ("p5", "p95", "#6aa7d6", "5 to 95 %"),
)
CURVES = (
    ("separation_speed_m_s", "axial separation speed", "m/s"),
    ("separation_distance_mm", "axial separation distance", "mm"),
)


def separation_curves(frame: pd.DataFrame) -> list[tuple[str, str, str, str]]:
    """Return, for each column of separation speed, then for each of separation distance in
    ``frame``, the column, its prefix (``<joint>_``, or empty for the whole vehicle), the quantity
    in words and its unit."""
    names = [str(name) for name in frame.columns]
    return [
        (name, name.removesuffix(stem), words, unit)
        for stem, words, unit in CURVES
        for name in names
        if name.endswith(stem)
    ]


SAMPLES = 5  # single cases drawn over the bands
OVERVIEW = 12


def band_figures(
    histories: pd.DataFrame,
    folder: Path,
    units: Mapping[str, str],
    labels: Mapping[str, str] | None = None,
    about: str = "",
    suffix: str = ".png",
) -> list[Path]:
    """Draw each separation speed and distance over time, as percentile bands over the cases, in a
    figure of its own.

    Parameters
    ----------
    histories : DataFrame, long form
        A row per case and time, without failed cases: ``case``, ``time_s`` and the columns of
        separation speed and distance.
    folder : Path
        Created if missing.
    units : mapping of column to unit
    labels : mapping of column to words, optional
        Replace the words for a column in labels and titles.
    about : str
        Second line of the titles.
    suffix : str
        Ending of the file names, with its dot, which selects the format.

    Returns
    -------
    list of Path
        Files written, ``<joint>_separation_speed`` + suffix and so on; columns without values are
        left out.
    """
    folder, labels, written = make_folder(folder), labels or {}, []
    for name, prefix, words, unit in separation_curves(histories):
        if histories[name].notna().any():
            label = f"{labels.get(name, to_words(prefix) + words)} ({units.get(name, unit)})"
            file_name = f"{prefix}{words.removeprefix('axial ').replace(' ', '_')}{suffix}"
            written.append(_bands(histories, name, label, folder / file_name, about))
    return written


def histogram_figures(
    histograms: Mapping[str, Histogram | None],
    folder: Path,
    units: Mapping[str, str],
    reference: Mapping[str, Mapping[str, float]] | None = None,
    labels: Mapping[str, str] | None = None,
    source: str = "reference",
    required: Mapping[str, Sequence[float]] | None = None,
    about: str = "",
    suffix: str = ".png",
    alone: bool = True,
) -> list[Path]:
    """Draw an overview of histograms side by side, and if ``alone`` also each in its own figure.

    The overview has the outcomes with a reference or required bounds if there is a reference; else
    the first 12 outcomes, those with required bounds first.

    Parameters
    ----------
    histograms : mapping of outcome to Histogram or None
        An outcome without values (None) is left out.
    folder, units, labels, about, suffix
        As for `band_figures`.
    reference : mapping of outcome to {"mean", "min", "max", ...}, optional
        Reference values, marked in the histograms, in the outcome's unit.
    source : str
        Name of the reference in legends.
    required : mapping of outcome to sequence of float, optional
        All required lower and upper bounds, marked in the histograms.
    alone : bool
        True to draw each histogram also in a file of its own, ``hist_<outcome>`` + suffix.

    Returns
    -------
    list of Path
        Files written; the overview, ``histograms`` + suffix, is the last.
    """
    folder, reference, labels = make_folder(folder), reference or {}, labels or {}
    required, written = required or {}, []
    present = {name: histogram for name, histogram in histograms.items() if histogram}
    labels_of = {name: labels.get(name, to_words(name, units.get(name, ""))) for name in present}
    # outcomes with requirements first
    sorted_names = sorted(present, key=lambda name: name not in required)
    selected = [name for name in sorted_names if name in reference or name in required]
    overview = (selected if reference else []) or sorted_names[:OVERVIEW]
    sheets = [(f"hist_{name}", [name]) for name in present if alone]
    sheets += [("histograms", overview)] if overview else []
    for file, names in sheets:
        panels = [
            (
                present[name],
                labels_of[name],
                units.get(name, ""),
                reference.get(name, {}),
                source,
                required.get(name, ()),
            )
            for name in names
        ]
        path = folder / f"{file}{suffix}"
        written.append(_histograms(panels, path, about, file == "histograms"))
    return written


def _histograms(
    panels: Sequence[tuple[Any, ...]], path: Path, about: str, side_by_side: bool
) -> Path:
    """Draw a figure of histograms, three in a row if ``side_by_side``, else one, and return its
    path; each of the ``panels`` is a tuple of the arguments of `_histogram` after ``ax``, ``about``
    is the title."""
    columns = min(3, len(panels)) if side_by_side else 1
    figure, axes = make_axes(
        -(-len(panels) // columns), columns, (3.8, 3.0) if columns > 1 else (6.4, 4.4)
    )
    for ax, panel in zip(axes, panels, strict=False):
        _histogram(ax, *panel)
    for ax in axes[len(panels) :]:
        ax.remove()
    set_title(figure, about)
    source = panels[0][4]
    order = (*_LEGEND, f"{source} mean", f"{source} min and max", REQUIRED)
    return save(figure, path, order)


def _bands(histories: pd.DataFrame, column: str, label: str, path: Path, about: str) -> Path:
    """Draw minimum, maximum, percentile bands and median of a quantity over time, and a few single
    cases, into the file ``path``, and return it. ``label`` labels the ordinate and ends in the unit
    in brackets; the title is the label without the unit, with ``about`` as its second line."""
    curves = percentile_curves(histories, column).dropna(how="all")
    figure, (ax,) = make_axes(1, 1, (6.4, 4.4))
    for low, high, tint, text in BANDS:
        ax.fill_between(
            curves.index, curves[low], curves[high], color=tint, linewidth=0, label=text
        )
    numbers = np.sort(histories["case"].unique())
    for number in numbers[
        np.linspace(0, len(numbers) - 1, min(SAMPLES, len(numbers))).round().astype(int)
    ]:
        case_rows = histories[histories["case"] == number].sort_values("time_s")
        # over the median, which a case may follow
        ax.plot(
            case_rows["time_s"], case_rows[column], color=VERMILION, linewidth=0.7, zorder=3,
            label="single cases",
        )  # fmt: skip
    ax.plot(curves.index, curves["p50"], color=BLACK, linewidth=2.2, linestyle="--", label="median")
    ax.set(xlabel="time (s)", ylabel=label)
    ax.margins(x=0)
    quantity = label[: label.rfind(" (")]
    cases = count_cases(len(numbers), ",")  # fewer than the campaign has, if some failed
    count = "" if f" {cases}" in about else f" of {cases}"
    set_title(figure, f"{quantity[:1].upper()}{quantity[1:]}{count}\n{about}")
    return save(figure, path)


def _histogram(
    ax: Axes,
    histogram: Histogram,
    words: str,
    unit: str,
    reference: Mapping[str, float],
    source: str,
    required: Sequence[float],
) -> None:
    """Draw the histogram of an outcome as a density, whose axis (the vertical one) is logarithmic
    if the distribution has a long tail.

    Equal values, which have no density, are one vertical line. Also marked are the extremes, the
    ``reference`` values, the ``required`` bounds (those far outside are named in the title instead)
    and, if the distribution is nearly normal, the normal density of equal mean and sigma. ``words``
    and ``unit`` label the horizontal axis; ``source`` names the reference.
    """
    mean, sigma, has_bins = histogram.mean, histogram.sigma, histogram.edges.size > 0
    if has_bins:
        density = histogram.counts / (histogram.counts.sum() * np.diff(histogram.edges))
        # one outline: separate bars would take most of the drawing time
        ax.stairs(
            density, histogram.edges, fill=True, facecolor="#a9cdea", edgecolor="white",
            linewidth=0.4, label=_CASES,
        )  # fmt: skip
        centres = 0.5 * (histogram.edges[1:] + histogram.edges[:-1])
        low_bars = centres[(density < _SEEN * density.max()) & (histogram.counts > 0)]
        if _has_long_tail(histogram):
            ax.set_yscale("log")
            ax.set_ylim(0.5 * density[histogram.counts > 0].min(), 2.0 * density.max())
        elif len(low_bars):
            ax.plot(
                low_bars, np.zeros(len(low_bars)), linestyle="", marker=TICKUP, markersize=7,
                color=BLUE, clip_on=False, label=_LOW,
            )  # fmt: skip
        # between the axis and its numbers, so that no data is covered
        below = ScaledTranslation(0.0, -3.5 / 72.0, ax.figure.dpi_scale_trans)
        ax.plot(
            [histogram.low, histogram.high], [0.0, 0.0], linestyle="", marker="^", markersize=5,
            color=BLACK, clip_on=False, transform=ax.get_xaxis_transform() + below, label=_ENDS,
        )  # fmt: skip
        ax.tick_params(axis="x", pad=5.5)
        if _is_bell(histogram):
            grid = np.linspace(
                min(histogram.low, mean - 3.5 * sigma), max(histogram.high, mean + 3.5 * sigma), 300
            )
            normal = np.exp(-0.5 * ((grid - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
            ax.plot(grid, normal, color=BLACK, linewidth=1.4, label=_NORMAL)
    else:  # equal values have no density
        ax.axvline(histogram.low, color=BLUE, linewidth=4, label=_ALIKE)
        ax.set_yticks([])
    for names, style, text in (
        (("mean",), "--", f"{source} mean"),
        (("min", "max"), ":", f"{source} min and max"),
    ):
        for name in names:
            if np.isfinite(reference.get(name, np.nan)):
                ax.axvline(
                    reference[name], color=REFERENCE, linestyle=style, linewidth=1.6, label=text
                )
    low, high = histogram.low, histogram.high
    width = high - low
    shown = [b for b in required if not has_bins or low - width <= b <= high + width]
    for bound in shown:
        ax.axvline(bound, color=BOUND, linestyle="-", linewidth=2.2, label=REQUIRED)
    title = (
        f"n {histogram.n:,}, mean {rounded(mean, sigma)}, sigma {rounded(sigma, sigma)} {unit}"
        if has_bins or histogram.n == 1
        else f"n {histogram.n:,}, constant {rounded(mean, 0.0)} {unit}"
    ).rstrip()
    hidden = ", ".join(f"{bound:g}" for bound in required if bound not in shown)
    # drawn, it would shrink the histogram to a line
    note = f"\nrequired bound {hidden} is far outside" if hidden else ""
    set_panel_title(ax, fill(title, _TITLE_WIDTH) + note, 9)
    if len(rounded(mean, sigma, 2)) > 6:  # long tick labels would overlap
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    # a wider label would overlap its neighbour
    ax.set_xlabel(fill(f"{words} ({unit})" if unit else words, 40))
    if has_bins:
        per = f" (1/({unit}))" if set(unit) & set("/ ") else f" (1/{unit})" if unit else ""
        scale = ", logarithmic" if ax.get_yscale() == "log" else ""
        ax.set_ylabel(fill(f"density{per}{scale}", _ORDINATE_WIDTH))


# entries of the legend of histograms, in order
_CASES, _LOW, _ENDS = "cases", "bars too low to see", "minimum and maximum"
_ALIKE = "all cases"
# a normal density is drawn below these |skewness| and |excess kurtosis|: its peak is within 5 %
_SKEWED, _PEAKED = 0.2, 0.4
_NORMAL = (
    f"normal, same mean and sigma (where |skewness| < {_SKEWED:g}, |excess kurtosis| < {_PEAKED:g})"
)
_LEGEND = (_CASES, _ALIKE, _LOW, _ENDS, _NORMAL)
_TITLE_WIDTH = 44  # characters of a title line that fit over a panel
_ORDINATE_WIDTH = 22  # characters along the ordinate of a panel
_SEEN = 0.01  # of the highest bar: lower ones are marked
_TAIL = 0.3  # of all bars: if more are too low to see, the scale is logarithmic


def _has_long_tail(histogram: Histogram) -> bool:
    """Return True if more than 30 % of the occupied bins are lower than 1 % of the highest, so that
    a linear scale would hide the distribution."""
    occupied = histogram.counts > 0
    low_bars = occupied & (histogram.counts < _SEEN * histogram.counts.max())
    return bool(low_bars.sum() > _TAIL * occupied.sum())


def _is_bell(histogram: Histogram) -> bool:
    """Return True if skewness and excess kurtosis of a histogram are below 0.2 and 0.4 in absolute
    value, near those of a normal distribution."""
    weights = histogram.counts / histogram.counts.sum()
    centres = 0.5 * (histogram.edges[1:] + histogram.edges[:-1])
    deviations = centres - weights @ centres
    second, third, fourth = (float(weights @ deviations**power) for power in (2, 3, 4))
    if second == 0.0:
        return False
    skewness, kurtosis = third / second**1.5, fourth / second**2 - 3.0
    return abs(skewness) < _SKEWED and abs(kurtosis) < _PEAKED
