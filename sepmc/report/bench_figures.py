"""Figures of a benchmark of sepmc: error over computing time, cost of features, times of processing
stages, scaling with cases and threads, comparison with other engines."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from sepmc.report.style import BLACK, BLUE, GREEN, VERMILION, make_axes, save, set_title

ORANGE, SKY, PURPLE = "#E69F00", "#56B4E9", "#CC79A7"
METHODS = {
    "rk4": (VERMILION, "s"),
    "dopri5": (GREEN, "^"),
    "tp7": (ORANGE, "v"),
    "dop853": (BLUE, "o"),
    "sharp9": (PURPLE, "D"),
    "auto": (BLACK, "P"),
}
FORMULATIONS = {"reduced": ("-", 1.0), "full": (":", 0.9)}
ENGINES = (
    (BLUE, "o"),
    (ORANGE, "v"),
    (GREEN, "^"),
    (VERMILION, "s"),
    (PURPLE, "D"),
    (SKY, "P"),
    (BLACK, "X"),
)

# kinds of settings of other engines, by their first word
_KINDS = {"tol": "by tolerance", "order": "orders and steps by hand"}
STAR: dict[str, Any] = {
    "linestyle": "",
    "marker": "*",
    "color": BLACK,
    "markerfacecolor": "#F0E442",
    "markersize": 17,
    "zorder": 5,
}


def draw(
    frames: Mapping[str, pd.DataFrame], folder: Path, title: str, threads: int, floor: float
) -> list[Path]:
    """Draw a figure for each table of a benchmark.

    Parameters
    ----------
    frames : mapping of name to DataFrame
        Tables work_precision, row_errors, features, stages, scaling and peers (other engines);
        those that are missing or empty are not drawn.
    folder : Path
        Must exist.
    title : str
        Name of what was measured, for the titles.
    threads : int
        Number of threads, for the titles of all figures but scaling and features.
    floor : float
        Smallest error that the reference solution resolves.

    Returns
    -------
    list of Path
        Files written, ``<name>.png``.
    """
    drawers = {
        "work_precision": _work_precision,
        "row_errors": _row_errors,
        "features": _features,
        "stages": _stages,
        "scaling": _scaling,
        "peers": _peers,
    }
    # scaling has its own numbers of threads; features are timed on one
    titles = {"scaling": title, "features": f"{title}, one thread"}
    written = []
    for name, drawer in drawers.items():
        if name in frames and len(frames[name]):
            figure = drawer(frames[name], titles.get(name, f"{title}, {threads} threads"), floor)
            written.append(save(figure, folder / f"{name}.png"))
    return written


def _error_axes(ax: Axes, frame: pd.DataFrame, floor: float) -> None:
    """Set logarithmic scales and labels of axes that show error over time per case, and shade
    errors below ``floor``, the resolution of the reference; ``frame`` has the column ``error``."""
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="kernel time per case, all threads together (µs)",
        ylabel="largest error of any outcome and case",
    )
    _plain_decades(ax, "x")
    finite = frame["error"][np.isfinite(frame["error"])]
    low, high = min(floor, _clipped(finite, floor).min()) / 3.0, float(finite.max()) * 3.0
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(LogLocator(numticks=20))
    ax.axhspan(low, floor, color="#eeeeee", zorder=0, label="below the resolution of the reference")


def _row_errors(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    """Draw the true error of every case (``true_error``) over its estimated one (``error``); errors
    below a third of ``floor``, the resolution of the reference, are drawn at that third."""
    figure, (ax,) = make_axes(1, 1, (7.0, 6.0))
    estimated = _clipped(frame["error"], floor)
    true = _clipped(frame["true_error"], floor)
    ax.plot(
        estimated,
        true,
        linestyle="",
        marker=".",
        markersize=2.5,
        color=BLUE,
        alpha=0.5,
        label="cases",
    )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="estimated error (column error)",
        ylabel="true error, largest of the outcomes",
    )
    ends = np.array(
        [min(estimated.min(), true.min()) / 2.0, 2.0 * max(estimated.max(), true.max())]
    )
    ax.set(xlim=ends, ylim=ends)
    ax.plot(ends, ends, color=BLACK, linewidth=1.0, label="true = estimated")
    ax.plot(ends, 3.0 * ends, color=VERMILION, linewidth=1.0, label="three times the estimate")
    ax.plot(
        ends, 0.1 * ends, color=BLACK, linewidth=1.0, linestyle=":", label="a tenth of the estimate"
    )
    ax.axhspan(
        ends[0], floor, color="#eeeeee", zorder=0, label="below the resolution of the reference"
    )
    set_title(figure, f"Error of every case: {title}")
    return figure


def _plain_decades(ax: Axes, which: str) -> None:
    """Set the ticks of a logarithmic axis (``which`` is "x" or "y"): plain numbers if it has at
    most four decades, else powers of ten."""
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    if high > 1e4 * low:
        axis.set_major_locator(LogLocator(numticks=20))
        return
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _clipped(errors: pd.Series, floor: float) -> pd.Series:
    """Return errors, those below a third of ``floor`` replaced by that third, so that 0 can be
    drawn on a logarithmic scale."""
    return errors.clip(lower=floor / 3.0)


def _work_precision(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    """Draw error over kernel time per case, a line for each integration method and formulation, and
    the default setting as a star. Errors below a third of ``floor``, the resolution of the
    reference, are drawn at that third; rows whose error is not finite are left out of the lines."""
    figure, (ax,) = make_axes(1, 1, (7.6, 5.6))
    for (formulation, method), rows in (
        (map(str, key), rows) for key, rows in frame.groupby(["formulation", "method"], sort=False)
    ):
        rows = rows[np.isfinite(rows["error"])]
        colour, marker = METHODS.get(method, (BLACK, "o"))
        line, alpha = FORMULATIONS.get(formulation, ("-", 1.0))
        label = f"{method}, {formulation}{_scale_note(rows)}"
        fill = colour if formulation == "reduced" else "white"
        style: dict[str, Any] = {
            "color": colour,
            "linestyle": line,
            "marker": marker,
            "markerfacecolor": fill,
            "alpha": alpha,
        }
        ax.plot(
            rows["us_per_case"],
            _clipped(rows["error"], floor),
            markersize=5,
            linewidth=1.3,
            label=label,
            **style,
        )
    default = frame[frame["default"]]
    ax.plot(default["us_per_case"], _clipped(default["error"], floor), label="default", **STAR)
    _error_axes(ax, frame, floor)
    set_title(figure, f"Error over time: {title}")
    return figure


def _scale_note(rows: pd.DataFrame) -> str:
    """Return a note on the number of cases that were timed, if times of ``rows`` were scaled up
    from fewer cases; else an empty string."""
    if not rows["scaled"].any():
        return ""
    count = int(rows["cases"].min())
    or_more = "" if rows["scaled"].all() else " or more"
    return f" ({count:,} {'case' if count == 1 else 'cases'}{or_more}, scaled)"


def _peers(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    """Draw error over time per case of each engine, a line per kind of setting (tolerance, or order
    and steps by hand). The column ``ms`` of ``frame`` is the time of 10,000 cases; rows whose error
    is not finite are left out. Of an engine with a default setting, as sepmc, only the kind of the
    default is drawn.

    Errors below a third of ``floor``, the resolution of the reference, are drawn at that third.
    Times that were scaled up from fewer cases get markers without a line.
    """
    figure, (ax,) = make_axes(1, 1, (8.4, 6.2))
    frame = frame[np.isfinite(frame["error"])].assign(
        us=frame["ms"] / 10.0, kind=frame["setting"].str.extract(r"^(\w+)")[0]
    )
    for (engine, rows), (colour, marker) in zip(
        frame.groupby("engine", sort=False), ENGINES, strict=False
    ):
        kinds = list(rows.groupby("kind", sort=False))
        kinds = [kind for kind in kinds if kind[1]["default"].any()] or kinds
        for (kind, subset), line in zip(kinds, ("-", "--", "-.", ":") * len(kinds), strict=False):
            label = f"{engine}, {_KINDS.get(str(kind), kind)}" if len(kinds) > 1 else str(engine)
            subset, note = subset.sort_values("error", ascending=False), _scale_note(subset)
            ax.plot(
                subset["us"], _clipped(subset["error"], floor), color=colour, marker=marker,
                linestyle="" if note else line, markersize=6,
                markerfacecolor=colour if line == "-" and not note else "white", linewidth=1.4,
                label=f"{label}{note}",
            )  # fmt: skip
    default = frame[frame["default"].astype(bool)]
    ax.plot(default["us"], _clipped(default["error"], floor), label="sepmc, default", **STAR)
    _error_axes(ax, frame, floor)
    set_title(figure, f"Other engines: {title}")
    return figure


def _features(frame: pd.DataFrame, title: str, _: float) -> Figure:
    """Draw kernel time and floating-point operations of the scene without one of its features (or
    with histories), relative to the whole scene: a pair of bars for each row of ``frame`` after the
    first, which is the whole scene."""
    figure, (ax,) = make_axes(1, 1, (7.6, 1.6 + 0.55 * len(frame)))
    rows = frame.iloc[1:][::-1]
    positions = np.arange(len(rows))
    ax.barh(positions + 0.18, rows["time_ratio"], 0.34, color=BLUE, label="kernel time")
    ax.barh(
        positions - 0.18,
        rows["flop_ratio"].fillna(0.0),
        0.34,
        color=ORANGE,
        hatch="//",
        edgecolor="white",
        label="floating-point operations",
    )
    for ratios, aside in ((rows["time_ratio"], 0.18), (rows["flop_ratio"], -0.18)):
        for position, ratio in zip(positions + aside, ratios, strict=True):
            if np.isfinite(ratio):  # on white, above the line at 1
                ax.annotate(
                    f"{ratio:.2f}", (ratio, position), (3, 0), textcoords="offset points",
                    va="center", fontsize=8,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                )  # fmt: skip
    ax.axvline(1.0, color=BLACK, linewidth=1.0)
    ax.set_xlim(right=1.1 * max(1.0, float(rows["time_ratio"].max())))
    ax.set_yticks(
        positions,
        [f"with {name}" if name == "histories" else f"without {name}" for name in rows["feature"]],
    )
    ax.set_xlabel("ratio to the whole scene, in the same steps")
    ax.grid(False, axis="y")
    set_title(figure, f"Cost of each feature: {title}")
    return figure


def _stages(frame: pd.DataFrame, title: str, _: float) -> Figure:
    """Draw the times, s, of the processing stages of a campaign and of whole commands, with
    compiled kernels in the cache (warm) or not (cold): a bar for each row of ``frame``."""
    figure, (ax,) = make_axes(1, 1, (7.6, 1.4 + 0.36 * len(frame)))
    rows = frame[::-1].reset_index(drop=True)
    colours = {
        "stage": BLUE,
        "command, warm": GREEN,
        "command, cold": VERMILION,
        "stage, cold": ORANGE,
    }
    for kind, colour in colours.items():
        subset = rows[rows["kind"] == kind]
        if len(subset):
            ax.barh(subset.index, subset["s"], 0.7, color=colour, label=kind)
    for position, time in enumerate(rows["s"]):
        ax.annotate(
            f"{time:.3g} s",
            (time, position),
            (3, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
        )
    ax.set(xscale="log", xlabel="time (s)")
    ax.set_xlim(right=float(rows["s"].max()) * 3.0)
    _plain_decades(ax, "x")
    ax.xaxis.set_major_locator(LogLocator(numticks=20))
    ax.set_yticks(range(len(rows)), rows["stage"])
    ax.grid(False, axis="y")
    set_title(figure, f"Where the time goes: {title}")
    return figure


def _scaling(frame: pd.DataFrame, title: str, _: float) -> Figure:
    """Draw kernel time per case and peak memory over the number of cases, and the speed-up over the
    number of threads; the column ``over`` of ``frame`` says which of the two ("cases" or "threads")
    a row is for."""
    figure, (left, middle, right) = make_axes(1, 3, (3.67, 3.9))
    by_cases, threads = frame[frame["over"] == "cases"], frame[frame["over"] == "threads"]
    left.plot(by_cases["cases"], by_cases["us_per_case"], "o-", color=BLUE)
    left.set(
        xscale="log",
        xlabel="cases",
        ylabel="kernel time per case (µs)",
        ylim=(0.0, 1.15 * float(by_cases["us_per_case"].max())),
    )
    middle.plot(by_cases["cases"], by_cases["peak_MB"], "s-", color=VERMILION)
    middle.set(
        xscale="log",
        xlabel="cases",
        ylabel="peak memory, statistics only (MB)",
        ylim=(0.0, 1.15 * float(by_cases["peak_MB"].max())),
    )
    right.plot(threads["threads"], threads["speed_up"], "^-", color=GREEN, label="measured")
    right.plot(threads["threads"], threads["threads"], ":", color=BLACK, label="ideal")
    right.set(xlabel="threads", ylabel="speed-up", xticks=threads["threads"])
    set_title(figure, f"Scaling: {title}")
    return figure
