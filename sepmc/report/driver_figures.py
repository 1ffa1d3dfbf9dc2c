"""What drives outcomes: tornado charts of how far their means swing with each input, and outcomes
over the inputs that drive them most."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.layout_engine import ConstrainedLayoutEngine

from sepmc.analysis.drivers import foremost
from sepmc.report.style import BLUE, VERMILION, entitle, in_words, made, save, sheet

_BARS = 8  # inputs of an outcome
_PAD = 0.12  # inches


def tornado_figure(
    found: Mapping[str, pd.DataFrame],
    folder: Path,
    units: Mapping[str, str],
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw a tornado chart for each outcome into ``drivers.png``, or with another ``suffix``;
    returns its path.

    Parameters
    ----------
    found : mapping of outcome to what `sepmc.analysis.drivers.drivers` tells of it
    folder : made if it is not there
    units : of the outcomes
    keys : mapping of input column to the path that the file has for it
    about : the campaign, for the title
    """
    columns = min(2, len(found))
    figure, axes = sheet(-(-len(found) // columns), columns, (6.4, 3.4))
    for ax, (outcome, table) in zip(axes, found.items(), strict=False):
        # those that the printed table has, in its order: bars are drawn from below
        middle, top = table.attrs["mean"], foremost(table, _BARS)[::-1]
        places = np.arange(len(top))
        # beside each other: where both ends lie on one side of the mean, neither hides the other
        for end, aside, colour, hatch, text in (
            ("mean_low", 0.2, BLUE, "", "lowest tenth of the input, or its lowest of few values"),
            ("mean_high", -0.2, VERMILION, "//", "highest tenth, or value"),
        ):
            ax.barh(
                places + aside, top[end] - middle, left=middle, color=colour, hatch=hatch,
                edgecolor="white", height=0.4, label=text,
            )  # fmt: skip
        ax.axvline(middle, color="#555555", linewidth=0.8)
        ax.set_yticks(places, [keys.get(str(name), str(name)) for name in top.index], fontsize=8)
        ax.grid(axis="y", visible=False)
        unit = units.get(outcome, "")
        name = in_words(outcome, unit)
        ax.set_xlabel(f"mean of {name} ({unit})" if unit else f"mean of {name}")
    for ax in axes[len(found) :]:
        ax.remove()
    entitle(figure, f"What drives the outcomes of {about}\nthe surest first-order index on top")
    layout = figure.get_layout_engine()
    if isinstance(layout, ConstrainedLayoutEngine):  # names of inputs would touch the edge
        layout.set(w_pad=_PAD)
    return save(figure, made(folder) / f"drivers{suffix}")


_DOTS, _INPUTS = 1500, 3  # cases that are drawn; inputs of an outcome


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
    figure, axes = sheet(len(found), _INPUTS, (4.0, 2.7))
    for row, (outcome, every) in enumerate(found.items()):
        crossed, table = violating[outcome], foremost(every, _INPUTS)
        unit = units.get(outcome, "")
        for k, ax in enumerate(axes[_INPUTS * row : _INPUTS * (row + 1)]):
            if k >= len(table):
                ax.remove()
                continue
            name = str(table.index[k])
            fine = ~crossed & (np.arange(len(crossed)) < _DOTS)
            ax.plot(
                rows[name][fine], rows[outcome][fine], ".", ms=2.5, color=BLUE, alpha=0.5,
                label="cases", rasterized=True,
            )  # fmt: skip
            if crossed.any():
                ax.plot(
                    rows[name][crossed], rows[outcome][crossed], "x", ms=5, color=VERMILION,
                    label="cases that violate what is required of the outcome, or else anything",
                )  # fmt: skip
            ax.set_xlabel(keys.get(name, name), fontsize=8.5)
            if not k:
                words = in_words(outcome, unit)
                ax.set_ylabel(f"{words} ({unit})" if unit else words, fontsize=9)
    entitle(figure, f"Outcomes of {about} over what drives them most")
    return save(figure, made(folder) / f"scatter{suffix}")
