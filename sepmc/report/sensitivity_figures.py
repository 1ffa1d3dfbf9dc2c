"""What drives outcomes: tornado charts of how far their means swing with each input, beside its
indices, and outcomes over the inputs that drive them most."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine

from sepmc.analysis.sensitivity import leading_inputs, order_description
from sepmc.report.style import (
    BLACK,
    BLUE,
    GREEN,
    VERMILION,
    make_axes,
    make_folder,
    save,
    set_title,
    to_words,
)

_BARS = 8  # inputs of an outcome
_PAD = 0.12  # inches
_PALE = 0.3
_LOWEST = "lowest tenth of the input, or its lowest of few values"
_HIGHEST = "highest tenth, or value"
_UNTOLD = "pale: effect by itself not told from 0 (95 %)"


def tornado_figure(
    found: Mapping[str, pd.DataFrame],
    folder: Path,
    units: Mapping[str, str],
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw for each outcome a tornado chart, and beside it the indices of the inputs with their 95
    % intervals, into ``sensitivity.png``, or with another ``suffix``; returns its path. Bars are
    pale where neither the swing of the mean nor the first-order index is told from 0.

    Parameters
    ----------
    found : mapping of outcome to what `sepmc.analysis.sensitivity.input_sensitivities` tells of it
    folder : made if it is not there
    units : of the outcomes
    keys : mapping of input column to the path that the file has for it
    about : the campaign, for the title
    """
    columns = min(2, len(found))
    widths = [2.4, 1.0] * columns
    figure, axes = make_axes(-(-len(found) // columns), 2 * columns, (3.8, 3.4), widths)
    pairs = list(zip(axes[::2], axes[1::2], strict=True))
    for (ax, beside), (outcome, table) in zip(pairs, found.items(), strict=False):
        # those that the printed table has, in its order: bars are drawn from below
        middle, top = table.attrs["mean"], leading_inputs(table, _BARS)[::-1]
        places = np.arange(len(top))
        told = ((top["shift"] > 0.0) | (top["first_low"] > 0.0)).to_numpy()
        # beside each other: where both ends lie on one side of the mean, neither hides the other
        for end, aside, colour, hatch, text in (
            ("mean_low", 0.2, BLUE, "", _LOWEST), ("mean_high", -0.2, VERMILION, "//", _HIGHEST)
        ):  # fmt: skip
            swing = (top[end] - middle).to_numpy()
            for those, alpha, label in ((told, 1.0, text), (~told, _PALE, _UNTOLD)):
                ax.barh(
                    places + aside, np.where(those, swing, np.nan), left=middle, color=colour,
                    hatch=hatch, edgecolor="white", height=0.4, alpha=alpha,
                    label=label if those is told or not told.all() else None,
                )  # fmt: skip
        ax.axvline(middle, color="#555555", linewidth=0.8)
        ax.set_yticks(places, [keys.get(str(name), str(name)) for name in top.index], fontsize=8)
        ax.set_ylim(-0.6, len(top) - 0.4)
        ax.grid(axis="y", visible=False)
        unit = units.get(outcome, "")
        name = to_words(outcome, unit)
        ax.set_xlabel(f"mean of {name} ({unit})" if unit else f"mean of {name}")
        _indices(beside, top, places)
    for pair in pairs[len(found) :]:
        for ax in pair:
            ax.remove()
    said = order_description(max(found.values(), key=len), _BARS)
    set_title(figure, f"What drives outcomes: {said}\n{about}")
    layout = figure.get_layout_engine()
    if isinstance(layout, ConstrainedLayoutEngine):  # names of inputs would touch the edge
        layout.set(w_pad=_PAD)
    order = (_LOWEST, _HIGHEST, _UNTOLD)
    return save(figure, make_folder(folder) / f"sensitivity{suffix}", order)


def _indices(ax: Axes, top: pd.DataFrame, places: np.ndarray) -> None:
    """First-order indices, and total ones where there are, with their intervals."""
    for name, aside, marker, colour, text in (
        ("first", 0.12, "o", BLACK, "first-order index"),
        ("total", -0.12, "s", GREEN, "total index"),
    ):
        if top[name].notna().any():
            ends = top[[f"{name}_low", f"{name}_high"]].to_numpy().T
            reach = np.abs(ends - top[name].to_numpy())
            ax.errorbar(
                top[name], places + aside, xerr=reach, fmt=marker, color=colour, ms=3.5,
                capsize=2.5, linewidth=1.0, label=text + ("" if np.isnan(ends).all() else ", 95 %"),
            )  # fmt: skip
    if not top[["first", "total"]].notna().any(axis=None):
        ax.text(
            0.5, 0.5, "not given:\nno estimator is valid\nfor these cases", fontsize=8,
            ha="center", va="center", transform=ax.transAxes,
        )  # fmt: skip
        ax.set_xticks([])
    ax.axvline(0.0, color="#555555", linewidth=0.8)
    ax.set_yticks(places, [])
    ax.set_ylim(-0.6, len(top) - 0.4)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("share of variance")
    if top.attrs.get("correlated"):
        ax.set_xlabel("share of variance\n(inputs vary together: no sum)")
    ax.locator_params(axis="x", nbins=4)


_DOTS, _INPUTS = 1500, 3  # cases that are drawn; inputs of an outcome
_WIDE = 24  # letters of 9 pt along an ordinate


def _drawn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which cases (n,) are drawn: the first ones, and those at the ends of either number."""
    found = np.arange(len(x)) < _DOTS
    for values in (x, y):
        known = np.flatnonzero(np.isfinite(values))
        if len(known):
            found[known[[values[known].argmin(), values[known].argmax()]]] = True
    return found


def scatter_figure(
    found: Mapping[str, pd.DataFrame],
    rows: Mapping[str, np.ndarray],
    violating: Mapping[str, np.ndarray],
    folder: Path,
    units: Mapping[str, str],
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw each outcome over the inputs that drive it most, case by case, into ``scatter.png``, or
    with another ``suffix``; returns its path.

    Parameters
    ----------
    found, folder, units, keys, about : as for `tornado_figure`
    rows : the ok cases, by column
    violating : by outcome, which of them violate what is required of it, or, where that is nothing,
        any requirement (n,); drawn as crosses
    """
    figure, axes = make_axes(len(found), _INPUTS, (4.0, 2.7))
    for row, (outcome, every) in enumerate(found.items()):
        crossed, table = violating[outcome], leading_inputs(every, _INPUTS)
        unit = units.get(outcome, "")
        for k, ax in enumerate(axes[_INPUTS * row : _INPUTS * (row + 1)]):
            if k >= len(table):
                ax.remove()
                continue
            name = str(table.index[k])
            fine, few = ~crossed & _drawn(rows[name], rows[outcome]), len(crossed) <= _DOTS
            ax.plot(
                rows[name][fine], rows[outcome][fine], ".", ms=2.5, color=BLUE, alpha=0.5,
                label="cases" if few else f"the first {_DOTS:,} cases and the extremes of all",
                rasterized=True,
            )  # fmt: skip
            if crossed.any():
                ax.plot(
                    rows[name][crossed], rows[outcome][crossed], "x", ms=5, color=VERMILION,
                    label="cases that violate what is required of the outcome, or else anything",
                )  # fmt: skip
            ax.set_xlabel(keys.get(name, name), fontsize=8.5)
            if not k:
                words = to_words(outcome, unit)
                said = f"{words} ({unit})" if unit else words
                ax.set_ylabel(fill(said, _WIDE), fontsize=9)
    set_title(figure, f"Outcomes over what drives them most\n{about}")
    return save(figure, make_folder(folder) / f"scatter{suffix}")
