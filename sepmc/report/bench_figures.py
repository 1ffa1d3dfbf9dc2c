"""Figures of a bench: error over time, cost of features, stages, scaling, other engines. Drawn as
those of `sepmc.report.figures`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

BLACK, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = (
    "#000000",
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
)
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

# kinds of settings of other engines, by the first word of these
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
    """Draw what there is of the parts of a bench, by name, into a folder; returns the files.

    ``title`` says what was measured, on so many ``threads`` where nothing else is told; below
    ``floor`` the reference cannot tell errors apart.
    """
    drawers = {
        "work_precision": _work_precision,
        "row_errors": _row_errors,
        "features": _features,
        "stages": _stages,
        "scaling": _scaling,
        "peers": _peers,
    }
    # each of its lines tells its own number of threads; a feature is timed on one
    titles = {"scaling": title, "features": f"{title}, one thread"}
    written = []
    for name, drawer in drawers.items():
        if name in frames and len(frames[name]):
            figure = drawer(frames[name], titles.get(name, f"{title}, {threads} threads"), floor)
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=150, metadata={"Software": None})
    return written


def _figure(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(1, columns, squeeze=False).ravel())
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(True, color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.tick_params(labelsize=9)
    return figure, axes


def _error_axes(ax: Axes, frame: pd.DataFrame, floor: float) -> None:
    """Time a case and error, both logarithmic; what the reference cannot tell apart is shaded."""
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="kernel time a case, all threads together (µs)",
        ylabel="largest error of any outcome and case",
    )
    _plain_decades(ax, "x")
    finite = frame["error"][np.isfinite(frame["error"])]
    low, high = min(floor, _shown(finite, floor).min()) / 3.0, float(finite.max()) * 3.0
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(LogLocator(numticks=20))
    ax.axhspan(low, floor, color="#eeeeee", zorder=0, label="within the reference's own error")


def _row_errors(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    """Every case: its true error over what its row tells."""
    figure, (ax,) = _figure(7.0, 6.0)
    told = _shown(frame["error"], floor)
    true = _shown(frame["true_error"], floor)
    ax.plot(
        told, true, linestyle="", marker=".", markersize=2.5, color=BLUE, alpha=0.5, label="cases"
    )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="error that the row tells",
        ylabel="true error, largest of its outcomes",
    )
    ends = np.array([min(told.min(), true.min()) / 2.0, 2.0 * max(told.max(), true.max())])
    ax.set(xlim=ends, ylim=ends)
    ax.plot(ends, ends, color=BLACK, linewidth=1.0, label="as told")
    ax.plot(ends, 3.0 * ends, color=VERMILION, linewidth=1.0, label="three times that")
    ax.plot(ends, 0.1 * ends, color=BLACK, linewidth=1.0, linestyle=":", label="a tenth of that")
    ax.axhspan(ends[0], floor, color="#eeeeee", zorder=0, label="within the reference's own error")
    ax.set_title(f"Error of every case: {title}", fontsize=11)
    _legend(figure, ax, 2)
    return figure


def _plain_decades(ax: Axes, which: str) -> None:
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    if high > 1e4 * low:
        axis.set_major_locator(LogLocator(numticks=20))
        return
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _shown(errors: pd.Series, floor: float) -> pd.Series:
    """Errors that are zero are drawn at a third of the floor."""
    return errors.clip(lower=floor / 3.0)


def _legend(figure: Figure, ax: Axes, columns: int) -> None:
    handles, labels = ax.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(
        list(unique.values()),
        list(unique),
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        fontsize=9,
    )


def _work_precision(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    figure, (ax,) = _figure(7.6, 5.6)
    for (formulation, method), rows in (
        (map(str, key), rows) for key, rows in frame.groupby(["formulation", "method"], sort=False)
    ):
        rows = rows[np.isfinite(rows["error"])]
        colour, marker = METHODS.get(method, (BLACK, "o"))
        line, alpha = FORMULATIONS.get(formulation, ("-", 1.0))
        words = f"{method}, {formulation}{_scaled(rows)}"
        filled = colour if formulation == "reduced" else "white"
        style: dict[str, Any] = {
            "color": colour,
            "linestyle": line,
            "marker": marker,
            "markerfacecolor": filled,
            "alpha": alpha,
        }
        ax.plot(
            rows["us_per_case"],
            _shown(rows["error"], floor),
            markersize=5,
            linewidth=1.3,
            label=words,
            **style,
        )
    chosen = frame[frame["default"]]
    ax.plot(chosen["us_per_case"], _shown(chosen["error"], floor), label="default", **STAR)
    _error_axes(ax, frame, floor)
    _legend(figure, ax, 2)
    figure.suptitle(f"Error over time: {title}", fontsize=11)
    return figure


def _scaled(rows: pd.DataFrame) -> str:
    """By how many cases rows were timed, if not by all."""
    if not rows["scaled"].any():
        return ""
    count = int(rows["cases"].min())
    more = "" if rows["scaled"].all() else " or more"
    return f" ({count:,} {'case' if count == 1 else 'cases'}{more}, scaled)"


def _peers(frame: pd.DataFrame, title: str, floor: float) -> Figure:
    """A colour an engine; where its settings are of several kinds (the first word of them), a line
    each, but of ours only that of the default: methods by themselves have a figure of their own.
    Times of few cases are too uncertain for a line."""
    figure, (ax,) = _figure(8.4, 6.2)
    frame = frame[np.isfinite(frame["error"])].assign(
        us=frame["ms"] / 10.0, kind=frame["setting"].str.extract(r"^(\w+)")[0]
    )
    for (engine, rows), (colour, marker) in zip(
        frame.groupby("engine", sort=False), ENGINES, strict=False
    ):
        kinds = list(rows.groupby("kind", sort=False))
        kinds = [found for found in kinds if found[1]["default"].any()] or kinds
        for (kind, some), line in zip(kinds, ("-", "--", "-.", ":") * len(kinds), strict=False):
            words = f"{engine}, {_KINDS.get(str(kind), kind)}" if len(kinds) > 1 else str(engine)
            some, few = some.sort_values("error", ascending=False), _scaled(some)
            ax.plot(
                some["us"], _shown(some["error"], floor), color=colour, marker=marker,
                linestyle="" if few else line, markersize=6,
                markerfacecolor=colour if line == "-" and not few else "white", linewidth=1.4,
                label=f"{words}{few}",
            )  # fmt: skip
    chosen = frame[frame["default"].astype(bool)]
    ax.plot(chosen["us"], _shown(chosen["error"], floor), label="sepmc, default", **STAR)
    _error_axes(ax, frame, floor)
    _legend(figure, ax, 2)
    figure.suptitle(f"Other engines: {title}", fontsize=11)
    return figure


def _features(frame: pd.DataFrame, title: str, _: float) -> Figure:
    """Time and operations of what is left, as shares of the whole scene's."""
    figure, (ax,) = _figure(7.6, 1.6 + 0.55 * len(frame))
    rows = frame.iloc[1:][::-1]
    place = np.arange(len(rows))
    ax.barh(place + 0.18, rows["time_ratio"], 0.34, color=BLUE, label="kernel time")
    ax.barh(
        place - 0.18,
        rows["flop_ratio"].fillna(0.0),
        0.34,
        color=ORANGE,
        hatch="//",
        edgecolor="white",
        label="floating-point operations",
    )
    for shares, aside in ((rows["time_ratio"], 0.18), (rows["flop_ratio"], -0.18)):
        for at, share in zip(place + aside, shares, strict=True):
            if np.isfinite(share):  # on white: the line at the whole scene's may lie below
                ax.annotate(
                    f"{share:.2f}", (share, at), (3, 0), textcoords="offset points", va="center",
                    fontsize=8, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                )  # fmt: skip
    ax.axvline(1.0, color=BLACK, linewidth=1.0)
    ax.set_xlim(right=1.1 * max(1.0, float(rows["time_ratio"].max())))
    ax.set_yticks(
        place,
        [f"with {name}" if name == "histories" else f"without {name}" for name in rows["feature"]],
    )
    ax.set_xlabel("share of the whole scene, in the same steps")
    ax.grid(False, axis="y")
    _legend(figure, ax, 2)
    figure.suptitle(f"Cost of each feature: {title}", fontsize=11)
    return figure


def _stages(frame: pd.DataFrame, title: str, _: float) -> Figure:
    figure, (ax,) = _figure(7.6, 1.4 + 0.36 * len(frame))
    rows = frame[::-1].reset_index(drop=True)
    colours = {
        "stage": BLUE,
        "command, warm": GREEN,
        "command, cold": VERMILION,
        "stage, cold": ORANGE,
    }
    for kind, colour in colours.items():
        some = rows[rows["kind"] == kind]
        if len(some):
            ax.barh(some.index, some["s"], 0.7, color=colour, label=kind)
    for at, spent in enumerate(rows["s"]):
        ax.annotate(
            f"{spent:.3g} s",
            (spent, at),
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
    _legend(figure, ax, 4)
    figure.suptitle(f"Where the time goes: {title}", fontsize=11)
    return figure


def _scaling(frame: pd.DataFrame, title: str, _: float) -> Figure:
    figure, (left, middle, right) = _figure(11.0, 3.9, 3)
    sizes, threads = frame[frame["over"] == "cases"], frame[frame["over"] == "threads"]
    left.plot(sizes["cases"], sizes["us_per_case"], "o-", color=BLUE)
    left.set(
        xscale="log",
        xlabel="cases",
        ylabel="kernel time a case (µs)",
        ylim=(0.0, 1.15 * float(sizes["us_per_case"].max())),
    )
    middle.plot(sizes["cases"], sizes["peak_MB"], "s-", color=VERMILION)
    middle.set(
        xscale="log",
        xlabel="cases",
        ylabel="peak memory, statistics only (MB)",
        ylim=(0.0, 1.15 * float(sizes["peak_MB"].max())),
    )
    right.plot(threads["threads"], threads["speed_up"], "^-", color=GREEN, label="measured")
    right.plot(threads["threads"], threads["threads"], ":", color=BLACK, label="ideal")
    right.set(xlabel="threads", ylabel="speed-up", xticks=threads["threads"])
    right.legend(frameon=False, fontsize=9)
    figure.suptitle(f"Scaling: {title}", fontsize=11)
    return figure
