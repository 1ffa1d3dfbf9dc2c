"""Figures of a campaign and of a single run, after Figs 2 to 11 of Wang, Li, Liu, Journal of System
Simulation 31(4), 2019.
"""

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
    set_title,
    to_words,
)

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
    """Separation columns of every joint in a frame: (column, prefix of its joint or "", words,
    unit)."""
    names = [str(name) for name in frame.columns]
    return [
        (name, name.removesuffix(stem), words, unit)
        for stem, words, unit in CURVES
        for name in names
        if name.endswith(stem)
    ]


SAMPLES = 5  # single cases drawn into the bands
OVERVIEW = 12


def band_figures(
    histories: pd.DataFrame,
    folder: Path,
    units: Mapping[str, str],
    labels: Mapping[str, str] | None = None,
    about: str = "",
    suffix: str = ".png",
) -> list[Path]:
    """Draw separation over time as bands over the cases. Failed cases are
    the caller's to leave out. ``about``: what stands in titles; ``suffix``: of the files."""
    folder, labels, written = make_folder(folder), labels or {}, []
    for name, joint, words, unit in separation_curves(histories):
        if histories[name].notna().any():
            label = f"{labels.get(name, to_words(joint) + words)} ({units.get(name, unit)})"
            file = f"{joint}{words.removeprefix('axial ').replace(' ', '_')}{suffix}"
            written.append(_bands(histories, name, label, folder / file, about))
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
    """Draw histograms of outcomes side by side, and each ``alone`` too. An
    outcome without values (None) is left out. Bounds that are ``required`` of an outcome are
    marked. ``about``: what stands in titles; ``suffix``: of the files."""
    folder, reference, labels = make_folder(folder), reference or {}, labels or {}
    required, written = required or {}, []
    values = {name: found for name, found in histograms.items() if found}
    words_of = {name: labels.get(name, to_words(name, units.get(name, ""))) for name in values}
    ordered = sorted(values, key=lambda name: name not in required)  # what is required comes first
    chosen = [name for name in ordered if name in reference or name in required]
    overview = (chosen if reference else []) or ordered[:OVERVIEW]
    sheets = [(f"hist_{name}", [name]) for name in values if alone]
    sheets += [("histograms", overview)] if overview else []
    for file, names in sheets:
        panels = [
            (
                values[name],
                words_of[name],
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
    """Draw a figure of histograms, each given by the arguments of `_histogram`; returns its
    path."""
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
    """Envelope, percentile bands, median and a few single cases of a quantity over time."""
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
        one = histories[histories["case"] == number].sort_values("time_s")
        # over the median: a case may lie along it
        ax.plot(
            one["time_s"], one[column], color=VERMILION, linewidth=0.7, zorder=3,
            label="single cases",
        )  # fmt: skip
    ax.plot(curves.index, curves["p50"], color=BLACK, linewidth=2.2, linestyle="--", label="median")
    ax.set(xlabel="time (s)", ylabel=label)
    ax.margins(x=0)
    title = label[: label.rfind(" (")]
    cases = f"{len(numbers):,} cases"  # fewer than the campaign has, where some failed
    told = "" if f" {cases}" in about else f" of {cases}"
    set_title(figure, f"{title[:1].upper()}{title[1:]}{told}\n{about}")
    return save(figure, path)


def _histogram(
    ax: Axes,
    found: Histogram,
    words: str,
    unit: str,
    reference: Mapping[str, float],
    source: str,
    required: Sequence[float],
) -> None:
    """Density histogram of an outcome, logarithmic where it has a long tail, with its extremes,
    the normal density of equal mean and sigma where it is like one, the reference, and the bounds
    that are required."""
    mean, sigma, spread = found.mean, found.sigma, found.edges.size > 0
    if spread:
        density = found.counts / (found.counts.sum() * np.diff(found.edges))
        # one outline: bars would take most of the time of the figure
        ax.stairs(
            density, found.edges, fill=True, facecolor="#a9cdea", edgecolor="white",
            linewidth=0.4, label=_CASES,
        )  # fmt: skip
        centres, low = 0.5 * (found.edges[1:] + found.edges[:-1]), density < _SEEN * density.max()
        few = centres[low & (found.counts > 0)]
        if _has_long_tail(found):
            ax.set_yscale("log")
            ax.set_ylim(0.5 * density[found.counts > 0].min(), 2.0 * density.max())
        elif len(few):
            ax.plot(
                few, np.zeros(len(few)), linestyle="", marker=TICKUP, markersize=7,
                color=BLUE, clip_on=False, label=_LOW,
            )  # fmt: skip
        # below the axis, between it and its numbers: nothing of the cases is covered
        below = ScaledTranslation(0.0, -3.5 / 72.0, ax.figure.dpi_scale_trans)
        ax.plot(
            [found.low, found.high], [0.0, 0.0], linestyle="", marker="^", markersize=5,
            color=BLACK, clip_on=False, transform=ax.get_xaxis_transform() + below, label=_ENDS,
        )  # fmt: skip
        ax.tick_params(axis="x", pad=5.5)
        if _is_bell(found):
            grid = np.linspace(
                min(found.low, mean - 3.5 * sigma), max(found.high, mean + 3.5 * sigma), 300
            )
            normal = np.exp(-0.5 * ((grid - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
            ax.plot(grid, normal, color=BLACK, linewidth=1.4, label=_NORMAL)
    else:  # a density of equal values does not exist
        ax.axvline(found.low, color=BLUE, linewidth=4, label=_ALIKE)
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
    reach = found.high - found.low
    near = [b for b in required if not spread or found.low - reach <= b <= found.high + reach]
    for bound in near:
        ax.axvline(bound, color=BOUND, linestyle="-", linewidth=2.2, label=REQUIRED)
    title = (
        f"n {found.n:,}, mean {rounded(mean, sigma)}, sigma {rounded(sigma, sigma)} {unit}"
        if spread or found.n == 1
        else f"n {found.n:,}, constant {rounded(mean, 0.0)} {unit}"
    ).rstrip()
    far = ", ".join(f"{bound:g}" for bound in required if bound not in near)
    # drawn, it would leave a line of the histogram
    ax.set_title(title + (f"\nrequired bound {far} is far outside" if far else ""), fontsize=9)
    if len(rounded(mean, sigma, 2)) > 6:  # ticks so long would run into each other
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    # wider, it would run into its neighbour in the overview
    ax.set_xlabel(fill(f"{words} ({unit})" if unit else words, 40))
    if spread:
        per = f" (1/({unit}))" if set(unit) & set("/ ") else f" (1/{unit})" if unit else ""
        ax.set_ylabel(f"density{per}{', logarithmic' if ax.get_yscale() == 'log' else ''}")


# what legends of histograms name, in this order
_CASES, _LOW, _ENDS = "cases", "bars too low to be seen", "least and greatest"
_ALIKE = "all cases"
# of a normal law both are 0; bounds of what is drawn as one: its peak is then within some 5 %
_SKEWED, _PEAKED = 0.2, 0.4
_NORMAL = (
    f"normal, same mean and sigma (where |skewness| < {_SKEWED:g}, |excess kurtosis| < {_PEAKED:g})"
)
_LEGEND = (_CASES, _ALIKE, _LOW, _ENDS, _NORMAL)
_SEEN = 0.01  # of the highest bar: lower ones are marked
_TAIL = 0.3  # of all bars: if more are too low to be seen, they are shown on a logarithmic scale


def _has_long_tail(found: Histogram) -> bool:
    """Whether so many bars are too low to be seen that a linear scale hides how cases lie."""
    filled = found.counts > 0
    low = filled & (found.counts < _SEEN * found.counts.max())
    return bool(low.sum() > _TAIL * filled.sum())


def _is_bell(found: Histogram) -> bool:
    """Whether the shape of a histogram, however many cases it has, is that of a normal law."""
    share = found.counts / found.counts.sum()
    centres = 0.5 * (found.edges[1:] + found.edges[:-1])
    apart = centres - share @ centres
    second, third, fourth = (float(share @ apart**power) for power in (2, 3, 4))
    if second == 0.0:
        return False
    skewness, kurtosis = third / second**1.5, fourth / second**2 - 3.0
    return abs(skewness) < _SKEWED and abs(kurtosis) < _PEAKED
