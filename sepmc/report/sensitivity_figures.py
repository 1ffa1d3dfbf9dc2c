"""Sensitivity figures: tornado charts of the means of outcomes beside variance indices, inputs that
distinguish failed cases, and outcomes over their leading inputs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.layout_engine import ConstrainedLayoutEngine

from sepmc.analysis.failure_attribution import Attribution
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
)
from sepmc.wording import to_words

_MAX_BARS = 8  # inputs per outcome
_PAD = 0.12  # inches
_PALE_ALPHA = 0.3
_LOWEST = "lowest tenth of the input (lowest value, if it has few)"
_HIGHEST = "highest tenth (highest value)"
_UNCERTAIN = "pale: effect alone not significant (95 %)"


def tornado_figure(
    sensitivities: Mapping[str, pd.DataFrame],
    folder: Path,
    units: Mapping[str, str],
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw for each outcome a tornado chart of its leading inputs, and beside it their variance
    indices with 95 % intervals.

    The bars of an input end at the mean of the outcome over the cases with the lowest and with the
    highest tenth of the input (of an input of few values: with its lowest and highest value). They
    are pale where neither the shift of the mean nor the first-order index is significant.

    Parameters
    ----------
    sensitivities : mapping of outcome to DataFrame
        From `sepmc.analysis.sensitivity.input_sensitivities`; at least one.
    folder : Path
        Created if missing.
    units : mapping of outcome to unit
    keys : mapping of input column to TOML path
    about : str
        The campaign, for the title.
    suffix : str
        Ending of the file name, with its dot, which selects the format.

    Returns
    -------
    Path
        The file written, ``sensitivity`` + suffix in the folder.
    """
    columns = min(2, len(sensitivities))
    widths = [2.4, 1.0] * columns
    figure, axes = make_axes(-(-len(sensitivities) // columns), 2 * columns, (3.8, 3.4), widths)
    pairs = list(zip(axes[::2], axes[1::2], strict=True))
    for (ax, index_axes), (outcome, table) in zip(pairs, sensitivities.items(), strict=False):
        # as in the printed table; bars are drawn from below
        mean, top = table.attrs["mean"], leading_inputs(table, _MAX_BARS)[::-1]
        places = np.arange(len(top))
        significant = ((top["shift"] > 0.0) | (top["first_low"] > 0.0)).to_numpy()
        # side by side, so that neither hides the other where both are on one side of the mean
        for end, aside, colour, hatch, text in (
            ("mean_low", 0.2, BLUE, "", _LOWEST), ("mean_high", -0.2, VERMILION, "//", _HIGHEST)
        ):  # fmt: skip
            swing = (top[end] - mean).to_numpy()
            bars = ((significant, 1.0, text), (~significant, _PALE_ALPHA, _UNCERTAIN))
            for mask, alpha, label in bars:
                ax.barh(
                    places + aside, np.where(mask, swing, np.nan), left=mean, color=colour,
                    hatch=hatch, edgecolor="white", height=0.4, alpha=alpha,
                    label=label if mask is significant or not significant.all() else None,
                )  # fmt: skip
        ax.axvline(mean, color="#555555", linewidth=0.8)
        ax.set_yticks(places, [keys.get(str(name), str(name)) for name in top.index], fontsize=8)
        ax.set_ylim(-0.6, len(top) - 0.4)
        ax.grid(axis="y", visible=False)
        unit = units.get(outcome, "")
        name = to_words(outcome, unit)
        ax.set_xlabel(f"mean of {name} ({unit})" if unit else f"mean of {name}")
        _indices(index_axes, top, places)
    for pair in pairs[len(sensitivities) :]:
        for ax in pair:
            ax.remove()
    rule = order_description(max(sensitivities.values(), key=len), _MAX_BARS)
    set_title(figure, f"Sensitivity of outcomes, inputs {rule}\n{about}")
    layout = figure.get_layout_engine()
    if isinstance(layout, ConstrainedLayoutEngine):  # names of inputs would touch the edge
        layout.set(w_pad=_PAD)
    order = (_LOWEST, _HIGHEST, _UNCERTAIN)
    return save(figure, make_folder(folder) / f"sensitivity{suffix}", order)


def _indices(ax: Axes, top: pd.DataFrame, places: np.ndarray) -> None:
    """Draw the first-order indices, and the total ones if there are any, of the n inputs in the
    rows of ``top`` with their 95 % intervals, at the ordinates ``places`` (n,); without either, a
    note that no estimator is valid."""
    for name, aside, marker, colour, text in (
        ("first", 0.12, "o", BLACK, "first-order index"),
        ("total", -0.12, "s", GREEN, "total index"),
    ):
        if top[name].notna().any():
            interval = top[[f"{name}_low", f"{name}_high"]].to_numpy().T
            half_width = np.abs(interval - top[name].to_numpy())
            ax.errorbar(
                top[name], places + aside, xerr=half_width, fmt=marker, color=colour, ms=3.5,
                capsize=2.5, linewidth=1.0,
                label=text + ("" if np.isnan(interval).all() else ", 95 %"),
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
    ax.set_xlabel("fraction of variance")
    if top.attrs.get("correlated"):
        ax.set_xlabel("fraction of variance\n(correlated inputs: no sum)")
    ax.locator_params(axis="x", nbins=4)


_REGIONS = 5  # bars of a failure
_BAR_INCHES, _HEAD_INCHES = 0.42, 1.1  # height of a bar, and of all else of its axes


def attribution_figure(
    attributions: Mapping[str, Sequence[Attribution]],
    failures: Mapping[str, str],
    folder: Path,
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw for each failure up to five inputs, or pairs of inputs, that best distinguish its cases
    from the others: a bar for the percentage of information that each explains, with the range of
    the inputs where most of the failed cases are.

    Parameters
    ----------
    attributions : mapping of failure to sequence of Attribution
        From `sepmc.analysis.failure_attribution`; no sequence may be empty.
    failures : mapping of failure to str
        Title of the panel of each failure.
    folder, keys, about, suffix
        As for `tornado_figure`.

    Returns
    -------
    Path
        The file written, ``attribution`` + suffix in the folder.
    """
    shown = {name: list(each)[:_REGIONS][::-1] for name, each in attributions.items()}
    height = _HEAD_INCHES + _BAR_INCHES * max(len(each) for each in shown.values())
    figure, axes = make_axes(len(shown), 1, (9.0, height))
    for ax, (name, each) in zip(axes, shown.items(), strict=True):
        places = np.arange(len(each))
        fractions = np.array([100.0 * one.information for one in each])
        ax.barh(places, fractions, height=0.6, color=BLUE)
        for y, (x, one) in enumerate(zip(fractions, each, strict=True)):
            ax.text(
                x + 0.8, y, f"{one.inside} of {one.violations}, among {one.cases} cases",
                va="center", fontsize=8,
            )  # fmt: skip
        ax.set_yticks(places, ["\n".join(_region_lines(one, keys)) for one in each], fontsize=8)
        ax.set(xlim=(0.0, max(1.3 * fractions.max(), 10.0)), ylim=(-0.6, len(each) - 0.4))
        ax.grid(axis="y", visible=False)
        ax.set_title(failures[name], fontsize=9, loc="left")
        ax.set_xlabel("explained information on which cases these are (%)")
    set_title(figure, f"Inputs that distinguish cases of a failure, and where most are\n{about}")
    return save(figure, make_folder(folder) / f"attribution{suffix}")


def _region_lines(one: Attribution, keys: Mapping[str, str]) -> list[str]:
    """Return a text for each input of an attribution: its TOML path and the range where most of the
    failed cases are; ``keys`` maps input columns to TOML paths."""
    return [
        f"{keys.get(name, name)} {low:.5g}" + ("" if low == high else f" to {high:.5g}")
        for name, (low, high) in zip(one.inputs, one.region, strict=True)
    ]


_DOTS, SCATTERED_INPUTS = 1500, 3  # cases drawn; inputs per outcome
_WIDE = 24  # 9 pt letters along an ordinate
_LACKS = "cases that lack a required outcome and count as violations (at the edge if without value)"


def _shown_rows(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the mask (n,) of the cases to draw as dots: the first 1,500, and those with the
    extremes of the finite values of ``x`` (n,) or ``y`` (n,)."""
    mask = np.arange(len(x)) < _DOTS
    for values in (x, y):
        finite = np.flatnonzero(np.isfinite(values))
        if len(finite):
            mask[finite[[values[finite].argmin(), values[finite].argmax()]]] = True
    return mask


def scatter_figure(
    sensitivities: Mapping[str, pd.DataFrame],
    rows: Mapping[str, np.ndarray],
    violating: Mapping[str, np.ndarray],
    folder: Path,
    units: Mapping[str, str],
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw each outcome over its three leading inputs, in a row of panels per outcome: a dot for
    each of the first 1,500 cases, and for those with the extremes of all cases.

    Parameters
    ----------
    sensitivities, folder, units, keys, about, suffix
        As for `tornado_figure`.
    rows : mapping of column to ndarray, shape (n,)
        Outcomes and their leading inputs in the ok cases.
    violating : mapping of outcome to ndarray, shape (2, n), bool
        True in the first row for cases that violate the requirement on the outcome, or any
        requirement if there is none on it, all drawn as crosses; in the second row for those that
        lack the outcome of such a requirement, all drawn as plus signs: at the lower edge of the
        panel if they lack the outcome that it shows.

    Returns
    -------
    Path
        The file written, ``scatter`` + suffix in the folder.
    """
    figure, axes = make_axes(len(sensitivities), SCATTERED_INPUTS, (4.0, 2.7))
    for row, (outcome, table) in enumerate(sensitivities.items()):
        violates, lacks = violating[outcome]
        leading = leading_inputs(table, SCATTERED_INPUTS)
        lacks = lacks & ~violates
        without = lacks & np.isnan(rows[outcome])
        unit = units.get(outcome, "")
        for k, ax in enumerate(axes[SCATTERED_INPUTS * row : SCATTERED_INPUTS * (row + 1)]):
            if k >= len(leading):
                ax.remove()
                continue
            name = str(leading.index[k])
            shown = ~(violates | lacks) & _shown_rows(rows[name], rows[outcome])
            complete = len(violates) <= _DOTS
            ax.plot(
                rows[name][shown], rows[outcome][shown], ".", ms=2.5, color=BLUE, alpha=0.5,
                label="cases" if complete else f"the first {_DOTS:,} cases and the extremes of all",
                rasterized=True,
            )  # fmt: skip
            if violates.any():
                ax.plot(
                    rows[name][violates], rows[outcome][violates], "x", ms=5, color=VERMILION,
                    label="cases that violate a requirement (on the outcome, if there is one)",
                )  # fmt: skip
            edge = ax.get_xaxis_transform()  # 0 is the lower edge
            for mask, y, transform in (
                (lacks & ~without, rows[outcome], ax.transData),
                (without, np.zeros(len(without)), edge),
            ):
                if mask.any():
                    ax.plot(
                        rows[name][mask], y[mask], "+", ms=6, color=BLACK, label=_LACKS,
                        transform=transform, clip_on=False,
                    )  # fmt: skip
            ax.set_xlabel(keys.get(name, name), fontsize=8.5)
            if not k:
                words = to_words(outcome, unit)
                label = f"{words} ({unit})" if unit else words
                ax.set_ylabel(fill(label, _WIDE), fontsize=9)
    set_title(figure, f"Outcomes over their leading inputs\n{about}")
    return save(figure, make_folder(folder) / f"scatter{suffix}")
