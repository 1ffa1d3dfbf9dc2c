"""Figures of design maps: for which values of one or two design variables a requirement is shown,
refuted or neither (open)."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from sepmc.analysis.requirements import FAIL, PASS
from sepmc.campaign.design_map import DesignMap
from sepmc.report.style import BLACK, BLUE, BOUND, REQUIRED, make_axes, save, set_title
from sepmc.scene.model import Requirement

_PASS, _OPEN, _FAIL = "#bfe3d0", "#eeeeee", "#f6c9b0"
_WORDS = {"shown": _PASS, "open: more cases may show or refute it": _OPEN, "refuted": _FAIL}
_LEVELS = (0.001, 0.01, 0.1, 0.5)  # of the probability of a violation
_MARKED = 400  # designs up to which each is marked by a dot


def map_figure(
    designs: DesignMap,
    requirement: Requirement,
    sentence: str,
    nominal: tuple[float | None, ...],
    about: str,
    path: Path,
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
        File to write; the suffix selects the format.

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
    set_title(figure, f"{about}, {designs.cases_text}\n{sentence}")
    return save(figure, path)


def _draw_plane(
    ax: Axes, designs: DesignMap, requirement: Requirement, nominal: tuple[float | None, ...]
) -> None:
    """Draw a map with two axes: verdicts as coloured cells, and contours of the fraction of
    violating cases; arguments as for `map_figure`."""
    x, y = (axis.values for axis in designs.axes)
    verdicts = designs.grid(requirement.name)
    codes = np.where(verdicts == PASS, 0, np.where(verdicts == FAIL, 2, 1))
    ax.grid(False)
    colours = ListedColormap([_PASS, _OPEN, _FAIL])
    ax.pcolormesh(x, y, codes, cmap=colours, vmin=-0.5, vmax=2.5, shading="nearest")
    fractions = designs.grid(f"{requirement.name}_violations") / designs.grid("cases")
    allowed = 1.0 - requirement.probability
    levels = [level for level in _LEVELS if fractions.min() < level < fractions.max()]
    if levels:
        lines = ax.contour(x, y, fractions, levels=levels, colors=BLUE, linewidths=0.9)
        ax.clabel(lines, fmt=lambda value: f"{100.0 * value:g} %", fontsize=8)
    if fractions.min() < allowed < fractions.max():
        ax.contour(x, y, fractions, levels=[allowed], colors=BOUND, linewidths=1.8)
    ax.set_ylabel(designs.axes[1].key)
    _name_verdicts(ax)
    ax.plot([], [], color=BLUE, linewidth=0.9, label="fraction of violating cases")
    ax.plot([], [], color=BOUND, linewidth=1.8, label="allowed fraction")
    _mark_nominal(ax, designs, nominal)


def _draw_line(
    ax: Axes, designs: DesignMap, requirement: Requirement, nominal: tuple[float | None, ...]
) -> None:
    """Draw a map with one axis: the percentage of violating cases with its 95 % interval, and the
    verdicts as colours behind it; arguments as for `map_figure`."""
    axis, name = designs.axes[0], requirement.name
    x, verdicts = axis.values, designs.grid(requirement.name)[0]
    edges = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
    for word, colour in _WORDS.items():
        kind = {"shown": PASS, "refuted": FAIL}.get(word)
        cells = verdicts == kind if kind else ~np.isin(verdicts, (PASS, FAIL))
        for k in np.flatnonzero(cells):
            ax.axvspan(edges[k], edges[k + 1], color=colour, linewidth=0)
    _name_verdicts(ax)
    low, high = (100.0 * designs.grid(f"{name}_{end}")[0] for end in ("low", "high"))
    fractions = 100.0 * designs.grid(f"{name}_violations")[0] / designs.grid("cases")[0]
    ax.fill_between(x, low, high, color=BLUE, alpha=0.25, linewidth=0, label="95 % interval")
    marker = "." if len(x) <= _MARKED else None
    ax.plot(x, fractions, color=BLUE, marker=marker, label="fraction of violating cases")
    ax.axhline(100.0 * (1.0 - requirement.probability), color=BOUND, label=REQUIRED)
    ax.set_ylabel("violating cases, %")
    ax.set_xlim(axis.low, axis.high)
    ax.set_ylim(bottom=0.0)
    _mark_nominal(ax, designs, nominal)


def _name_verdicts(ax: Axes) -> None:
    """Add a legend entry for the colour of each verdict to the axes."""
    for word, colour in _WORDS.items():
        ax.plot([], [], "s", markersize=10, color=colour, markeredgecolor="#999999", label=word)


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
