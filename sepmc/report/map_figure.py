"""Figures of design maps: for which values of one or two design variables a requirement is shown,
refuted or neither (open)."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from sepmc.analysis.requirements import FAIL, PASS
from sepmc.campaign.design_map import DesignMap
from sepmc.report.style import BLACK, BLUE, BOUND, make_axes, save, set_title
from sepmc.scene.model import Requirement

# colours of verdicts, by the codes of `_codes`
_COLOURS = ("#bfe3d0", "#eeeeee", "#d8cbe6", "#f6c9b0")
_PASS, _OPEN, _LACKING, _FAIL = range(len(_COLOURS))
_LEVELS = (0.001, 0.01, 0.1, 0.5)  # of the probability of a violation
_FRACTION = "fraction of violating cases, those without the outcome among them"
_ALLOWED = "allowed fraction"
_MARKED = 400  # designs up to which each is marked by a dot


def map_figure(
    designs: DesignMap,
    requirement: Requirement,
    sentence: str,
    nominal: tuple[float | None, ...],
    about: str,
    path: Path,
    settings: str = "",
) -> Path:
    """Draw the verdicts on a requirement over one or two design variables.

    Parameters
    ----------
    designs : DesignMap
        Map with one or two axes.
    requirement : Requirement
        One of the requirements of the map.
    sentence : str
        The requirement in words, for the title.
    nominal : tuple of float or None
        Nominal value of each axis, in its unit; None if it stands for several parameters with
        different nominal values.
    about : str
        The campaign, for the title.
    path : Path
        File to write, in a folder that exists; the suffix selects the format.
    settings : str
        Further lines of the title: settings that change the campaign.

    Returns
    -------
    Path
        ``path``.
    """
    figure, (ax,) = make_axes(1, 1, (7.2, 5.4 if len(designs.axes) > 1 else 4.4))
    if len(designs.axes) > 1:
        _draw_plane(ax, designs, requirement, nominal)
    else:
        _draw_line(ax, designs, requirement, nominal)
    ax.set_xlabel(designs.axes[0].key)
    looks = ""
    if len(designs.looks) > 1:
        raised = 100.0 * designs.confidence(requirement)
        looks = (
            f"\nconfidence of each verdict raised to {raised:.4g} % for {len(designs.looks)} looks"
        )
    head = f"{about}, {designs.cases_text}, seed {designs.seed}{settings}"
    set_title(figure, f"{head}\n{sentence}{looks}")
    return save(figure, path)


def _codes(designs: DesignMap, requirement: Requirement) -> np.ndarray:
    """Return the verdicts on a requirement over the grid of designs as integer codes, shape (count
    of y, count of x), or (1, count of x) of a map with one axis: `_PASS`; `_FAIL`; `_LACKING`, open
    only because cases did not finish or lack the outcome; or `_OPEN`, open otherwise."""
    verdicts = designs.grid(requirement.name)
    lacking = designs.open_by_lacking(requirement).reshape(verdicts.shape)
    kinds = [verdicts == PASS, verdicts == FAIL, lacking]
    return np.select(kinds, [_PASS, _FAIL, _LACKING], _OPEN)


def _draw_plane(
    ax: Axes, designs: DesignMap, requirement: Requirement, nominal: tuple[float | None, ...]
) -> None:
    """Draw a map with two axes: verdicts as coloured cells, and contours of the fraction of
    violating cases; arguments as for `map_figure`."""
    x, y = (axis.values for axis in designs.axes)
    ax.grid(False)
    codes, top = _codes(designs, requirement), len(_COLOURS) - 0.5
    ax.pcolormesh(
        x, y, codes, cmap=ListedColormap(_COLOURS), vmin=-0.5, vmax=top, shading="nearest"
    )
    fractions = designs.grid(f"{requirement.name}_violations") / designs.grid("cases")
    allowed = 1.0 - requirement.probability
    levels = [level for level in _LEVELS if fractions.min() < level < fractions.max()]
    if levels:
        lines = ax.contour(x, y, fractions, levels=levels, colors=BLUE, linewidths=0.9)
        ax.clabel(lines, fmt=lambda value: f"{100.0 * value:g} %", fontsize=8)
    if fractions.min() < allowed < fractions.max():
        ax.contour(x, y, fractions, levels=[allowed], colors=BOUND, linewidths=1.8)
    ax.set_ylabel(designs.axes[1].key)
    _name_verdicts(ax, designs, requirement)
    ax.plot([], [], color=BLUE, linewidth=0.9, label=_FRACTION)
    ax.plot([], [], color=BOUND, linewidth=1.8, label=_ALLOWED)
    _mark_nominal(ax, designs, nominal)


def _draw_line(
    ax: Axes, designs: DesignMap, requirement: Requirement, nominal: tuple[float | None, ...]
) -> None:
    """Draw a map with one axis: the percentage of violating cases with its two-sided interval
    (`DesignMap.interval_confidence`, at least 95 %), and the verdicts as colours behind it;
    arguments as for `map_figure`."""
    axis, name = designs.axes[0], requirement.name
    x, codes = axis.values, _codes(designs, requirement)[0]
    edges = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
    for k, code in enumerate(codes):
        ax.axvspan(edges[k], edges[k + 1], color=_COLOURS[code], linewidth=0)
    _name_verdicts(ax, designs, requirement)
    low, high = (100.0 * designs.grid(f"{name}_{end}")[0] for end in ("low", "high"))
    fractions = 100.0 * designs.grid(f"{name}_violations")[0] / designs.grid("cases")[0]
    band = f"{100.0 * designs.interval_confidence:.4g} % interval of the fraction, two-sided"
    ax.fill_between(x, low, high, color=BLUE, alpha=0.25, linewidth=0, label=band)
    marker = "." if len(x) <= _MARKED else None
    ax.plot(x, fractions, color=BLUE, marker=marker, label=_FRACTION)
    ax.axhline(100.0 * (1.0 - requirement.probability), color=BOUND, label=_ALLOWED)
    ax.set_ylabel("violating cases, %")
    ax.set_xlim(axis.low, axis.high)
    ax.set_ylim(bottom=0.0)
    _mark_nominal(ax, designs, nominal)


def _name_verdicts(ax: Axes, designs: DesignMap, requirement: Requirement) -> None:
    """Add a legend entry for the colour of each verdict to the axes; that of designs which are open
    because cases did not finish or lack the outcome only if there are any."""
    sides = f", one-sided at {100.0 * designs.confidence(requirement):.4g} %"
    words = {_PASS: f"shown{sides}", _OPEN: "open: more cases may show or refute it"}
    if designs.open_by_lacking(requirement).any():
        words[_LACKING] = "open: cases lack the outcome; as violations they would refute it"
    words[_FAIL] = f"refuted{sides}"
    for code, word in words.items():
        ax.plot(
            [], [], "s", markersize=10, color=_COLOURS[code], markeredgecolor="#999999", label=word
        )  # fmt: skip


def _mark_nominal(ax: Axes, designs: DesignMap, nominal: tuple[float | None, ...]) -> None:
    """Mark the nominal design in the axes, unless it is outside the map or a value of it is
    None."""
    inside = [
        value
        for value, axis in zip(nominal, designs.axes, strict=True)
        if value is not None and axis.low <= value <= axis.high
    ]
    if len(inside) < len(designs.axes):
        return
    if len(inside) > 1:
        ax.plot(inside[:1], inside[1:], "+", markersize=12, color=BLACK, label="nominal")
    else:
        ax.axvline(inside[0], color=BLACK, linestyle="--", label="nominal")
