"""Figures of one case over time, after Figs 2 to 7 of Wang, Li, Liu, Journal of System Simulation
31(4), 2019."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sepmc.report.figures import separation_curves
from sepmc.report.style import (
    BLACK,
    BLUE,
    BOUND,
    EDGES,
    GREEN,
    MARK,
    REQUIRED,
    VERMILION,
    make_axes,
    make_folder,
    save,
    set_title,
)
from sepmc.wording import to_words

_GAP, _OWN = "_clearance_mm", "this case"
BY_COMPONENT = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."))  # x, y, z
# dashed and dash-dot as in Fig 7
BY_BODY = ((BLUE, "--"), (VERMILION, "-."), (GREEN, ":"), (BLACK, "-"))
BY_JOINT = tuple((colour, style) for style in ("-", "--", ":", "-.") for colour in EDGES)
# smallest range, in any unit drawn here (deg, deg/s, mm, N, N m ...); a smaller one is round-off
# and does not fill the axes
FLAT = 1e-6
_SIGNAL, _MOST_SIGNALS = "signal_", 12  # start of the columns of signals; most of them on a page
_TOO_FLAT = 0.05  # fraction of a shared scale below which a panel keeps its own


class Panel(NamedTuple):
    """Content of one panel of a figure: lines over time in one pair of axes.

    Parameters
    ----------
    label : str
        Label of the ordinate.
    lines : list of (column, label)
        Columns of the history to draw, and their labels in the legend.
    styles : tuple of (colour, line style)
        Styles of the lines in order, repeated if there are more lines.
    small_counts : bool
        True if small values matter, as for a clearance: the minimum of the first line is then part
        of the label, and the scale is logarithmic if the values of that line and ``required`` are
        positive and span more than a factor of ten.
    quantity : str
        Panels of a figure with the same quantity share a scale; empty: none shared.
    required : sequence of float
        Required lower and upper bounds, drawn as horizontal lines.
    """

    label: str
    lines: list[tuple[str, str]]
    styles: tuple[tuple[str, str], ...]
    small_counts: bool = False
    quantity: str = ""
    required: Sequence[float] = ()


def run_figures(
    history: pd.DataFrame,
    folder: Path,
    bodies: Sequence[str],
    joints: Sequence[str],
    about: str = "",
    suffix: str = ".png",
    behind: pd.DataFrame | None = None,
    only: Collection[str] | None = None,
    required: Mapping[str, Sequence[float]] | None = None,
    marks: Mapping[str, float] | None = None,
) -> list[Path]:
    """Draw the motion, forces and clearances of one case over time, a file for each kind. Thin
    lines mark the phases, named above; dotted or dashed vertical lines mark releases and events,
    named in the legend. The style does not say whether it is a release or an event.

    Parameters
    ----------
    history : DataFrame, a row per time
        ``time_s``, ``phase``, and optionally: per body ``b`` ``{b}_omega_{x,y,z}_deg_s``,
        ``{b}_{alpha,roll,yaw,pitch}_deg``, ``{b}_axial_acceleration_m_s2``; per joint ``j`` and
        body ``{j}_force_on_{b}_{x,y,z}_N``, ``{j}_moment_on_{b}_{x,y,z}_N_m``;
        ``separation_speed_m_s``, ``separation_distance_mm``; per clearance ``c``
        ``{c}_clearance_mm``; per hinge ``{j}_angle_deg`` and ``{j}_angle_rate_deg_s``; per pair of
        bodies ``{b}_from_{a}_distance_m`` and ``{b}_from_{a}_{roll,yaw,pitch}_deg``; per pin ``n``
        of a joint ``{j}_pin{n}_{mouth,tip}_load_N``; per signal ``signal_{name}``. Forces and
        moments of a joint are in the axes of its first body. At a phase boundary two rows share a
        time (end of one phase, start of the next), so that a step is drawn as a step.
    folder : Path
        Created if missing.
    bodies, joints : sequence of str
        Names of all bodies and joints of the scene.
    about : str
        Second line of the titles: campaign and case.
    suffix : str
        Ending of the file names, with its dot, which selects the format.
    behind : DataFrame, optional
        History of the nominal case, drawn behind in pale lines.
    only : collection of str, optional
        Names, without suffix, of the only files to draw; all if None.
    required : mapping of outcome to sequence of float, optional
        All required lower and upper bounds; only those of columns ``{c}_clearance_mm`` are marked.
    marks : mapping of name to time in s, optional
        Times of releases and events.

    Returns
    -------
    list of Path
        Files written: ``force_on_<body>``, ``moment_on_<body>``, ``rates``, ``angles``,
        ``axial_acceleration``, ``separation``, ``hinges``, ``relative_motion``, ``signals``,
        ``clearances``, ``pin_loads``, each + suffix; ``signals`` shows the first 12. Those without
        data are left out, and so are forces, moments and separations that stay 0.
    """
    folder, written = make_folder(folder), []

    def draw(
        file: str, title: str, panels: list[Panel], columns: int = 1, zeros: bool = True
    ) -> None:
        if only is not None and file not in only:
            return
        names = [name for panel in panels for name, _ in panel.lines if name in history]
        stays_zero = all(history[name].abs().max() < FLAT for name in names)
        if not zeros and stays_zero and len(history) > 1:
            return
        drawn = [
            panel
            for panel in panels
            if any(name in history and history[name].notna().any() for name, _ in panel.lines)
        ]
        if drawn:
            written.append(
                _time_page(
                    history,
                    folder / f"{file}{suffix}",
                    f"{title}\n{about}",
                    drawn,
                    min(columns, len(drawn)),
                    behind,
                    marks or {},
                )
            )

    def components(stem: str, unit: str, symbol: str) -> list[tuple[str, str]]:
        return [(f"{stem}_{axis}_{unit}", f"${symbol}_{axis}$") for axis in "xyz"]

    def body_panel(quantity: str, label: str) -> Panel:
        return Panel(label, [(f"{body}_{quantity}", to_words(body)) for body in bodies], BY_BODY)

    for body in bodies:
        kinds = (("force", "N", "N", "F"), ("moment", "N_m", "N m", "M"))
        for kind, unit, unit_text, symbol in kinds:
            stems = {joint: f"{joint}_{kind}_on_{body}" for joint in joints}
            panels = [
                Panel(
                    f"{kind} at {to_words(j)} ({unit_text})",
                    components(stem, unit, symbol),
                    BY_COMPONENT,
                )
                for j, stem in stems.items()
            ]
            draw(
                f"{kind}_on_{body}",
                f"Constraint {kind} on {to_words(body)}, in the axes of the joint's first body",
                panels,
                zeros=False,
            )
    rates = [
        Panel(
            f"{to_words(body)} (deg/s)",
            components(f"{body}_omega", "deg_s", r"\omega"),
            BY_COMPONENT,
            quantity="rate",
        )
        for body in bodies
    ]
    draw("rates", "Angular rates in body axes", rates)
    draw(
        "angles",
        "Attitude",
        [
            body_panel(f"{angle}_deg", f"{angle} (deg)")
            for angle in ("alpha", "pitch", "yaw", "roll")
        ],
        2,
    )
    draw(
        "axial_acceleration",
        "Axial acceleration of the centre of mass, gravity included",
        [body_panel("axial_acceleration_m_s2", "axial acceleration (m/s²)")],
    )
    lines_by_quantity: dict[str, list[tuple[str, str]]] = {}
    for name, joint, words, unit in separation_curves(history):
        lines_by_quantity.setdefault(f"{words} ({unit})", []).append(
            (name, to_words(joint).strip())
        )
    curves = [
        Panel(label, lines, BY_JOINT if len(lines) > 1 else ((BLUE, "-"),))
        for label, lines in lines_by_quantity.items()
    ]
    draw("separation", "Separation", curves, zeros=False)
    hinge_panels = [
        Panel(
            f"{words} ({unit_text})",
            [(f"{joint}_{stem}", to_words(joint)) for joint in joints],
            BY_BODY if len(joints) > 1 else ((BLUE, "-"),),
        )
        for stem, words, unit_text in (
            ("angle_deg", "angle about the joint's x axis", "deg"),
            ("angle_rate_deg_s", "angular rate about it", "deg/s"),
        )
    ]
    draw("hinges", "Hinges", hinge_panels)
    pairs = [(a, b) for a in bodies for b in bodies if f"{b}_from_{a}_distance_m" in history]
    draw(
        "relative_motion",
        "Relative motion of two bodies",
        [
            Panel(
                f"{words} ({unit})",
                [
                    (f"{b}_from_{a}_{words}_{unit}", f"{to_words(b)} from {to_words(a)}")
                    for a, b in pairs
                ],
                BY_BODY if len(pairs) > 1 else ((BLUE, "-"),),
            )
            for words, unit in (
                ("distance", "m"),
                ("pitch", "deg"),
                ("yaw", "deg"),
                ("roll", "deg"),
            )
        ],
        2,
    )
    of_items = tuple(f"{name}_" for name in (*bodies, *joints))
    draw(
        "signals",
        "Signals, in the units of the keys that name them",
        [
            Panel(to_words(name.removeprefix(_SIGNAL)), [(name, _OWN)], ((BLUE, "-"),))
            for name in map(str, history.columns)
            if name.startswith(_SIGNAL) and not name.startswith(of_items)
        ][:_MOST_SIGNALS],
        2,
    )
    draw(
        "clearances",
        "Clearances",
        [
            Panel(
                f"{to_words(name.removesuffix(_GAP))} (mm)",
                [(name, _OWN)],
                ((BLUE, "-"),),
                small_counts=True,
                required=(required or {}).get(name, ()),
            )
            for name in map(str, history.columns)
            if name.endswith(_GAP)
        ],
    )
    draw(
        "pin_loads",
        "Lateral loads on pins",
        [
            Panel(
                f"{to_words(joint)}, {end} (N)",
                [
                    (name, f"pin {name.removeprefix(joint).removesuffix(ending)[len('_pin') :]}")
                    for name in map(str, history.columns)
                    if name.startswith(f"{joint}_pin") and name.endswith(ending)
                ],
                BY_BODY,
                quantity="load",
            )
            for joint in joints
            for end, ending in (("hole entry", "_mouth_load_N"), ("pin tip", "_tip_load_N"))
        ],
        2,
    )
    return written


def _time_page(
    history: pd.DataFrame,
    path: Path,
    title: str,
    panels: list[Panel],
    columns: int,
    behind: pd.DataFrame | None,
    marks: Mapping[str, float],
) -> Path:
    """Draw panels over a common time axis, in rows of ``columns``, into the file ``path``, and
    return it. ``marks`` are times, s, by name; ``behind`` is the history of the nominal case, drawn
    in pale lines, or None."""
    rows = -(-len(panels) // columns)
    figure, axes = make_axes(
        rows, columns, (6.4, 4.0) if rows == 1 else (6.4 if columns == 1 else 4.6, 2.8)
    )
    phases = _phases(history)
    for index, (ax, panel) in enumerate(zip(axes, panels, strict=False)):
        for (name, text), (colour, style) in zip(
            panel.lines, (panel.styles * len(panel.lines))[: len(panel.lines)], strict=True
        ):
            if behind is not None and name in behind:
                ax.plot(
                    behind["time_s"],
                    behind[name],
                    color=colour,
                    linewidth=3.0,
                    alpha=0.25,
                    zorder=1.8,
                    label="nominal case (pale)",
                )
            if name in history:
                ax.plot(
                    history["time_s"],
                    history[name],
                    color=colour,
                    linestyle=style,
                    linewidth=1.6,
                    label=text,
                )
        ax.set_ylabel(_label(history, panel, _TALL if rows == 1 else _SHORT))
        ax.margins(x=0)
        begin, end = history["time_s"].iloc[0], history["time_s"].iloc[-1]
        if end > begin:
            ax.set_xlim(begin, end)
        low, high = ax.get_ylim()
        for bound in panel.required:
            ax.axhline(bound, color=BOUND, linewidth=2.2, zorder=1.9, label=REQUIRED)
        if panel.small_counts and _spans(history[panel.lines[0][0]], panel.required):
            ax.set_yscale("log")
            ax.set_ylabel(f"{ax.get_ylabel()}\nlogarithmic")
        elif high - low < FLAT:
            ax.set_ylim((low + high) / 2 - 0.5, (low + high) / 2 + 0.5)
        for _, start, _ in phases[1:]:
            ax.axvline(start, color="#777777", linewidth=0.7, zorder=1.5)  # behind the data
        _mark(ax, marks)
        if index < columns:
            _name_phases(ax, phases, figure.get_figwidth() / columns)
        if index >= len(panels) - columns:
            ax.set_xlabel("time (s)")
    for ax in axes[len(panels) :]:
        ax.remove()
    for quantity in {panel.quantity for panel in panels if panel.quantity}:
        _share_scale([a for a, p in zip(axes, panels, strict=False) if p.quantity == quantity])
    set_title(figure, title)
    return save(figure, path)


_NEAR = 0.01  # fraction of the time axis within which marks share a legend entry
_NAMED = 2  # marks named in an entry; more would not fit
_MARK_STYLES = ((0, (1, 1)), (0, (5, 2)), (0, (3, 1, 1, 1)), (0, (1, 3)))


def _mark(ax: Axes, marks: Mapping[str, float]) -> None:
    """Draw a vertical line at the time, s, of each of the ``marks`` within the axes; marks near
    each other share a line style and a legend entry. Styles follow each other in order of time."""
    begin, end = ax.get_xlim()
    groups: list[list[tuple[float, str]]] = []
    for time, name in sorted((time, to_words(name)) for name, time in marks.items()):
        if not begin < time < end:
            continue
        if groups and time - groups[-1][-1][0] < _NEAR * (end - begin):
            groups[-1].append((time, name))
        else:
            groups.append([(time, name)])
    for number, group in enumerate(groups):
        first, last = f"{group[0][0]:.4g}", f"{group[-1][0]:.4g}"
        others = f" and {len(group) - _NAMED} more" if len(group) > _NAMED else ""
        names = ", ".join(name for _, name in group[:_NAMED])
        style = _MARK_STYLES[number % len(_MARK_STYLES)]
        for time, _ in group:
            ax.axvline(
                time,
                color=MARK,
                linewidth=1.3,
                linestyle=style,
                zorder=1.6,
                label=f"{names}{others} ({first if first == last else f'{first} to {last}'} s)",
            )


_SHORT, _TALL = 26, 48  # 10 pt letters along the ordinate of stacked and of single panels


def _label(history: pd.DataFrame, panel: Panel, letters: int) -> str:
    """Return the label of a panel's ordinate, folded to lines of at most ``letters`` characters;
    with `Panel.small_counts` it has another line: the minimum of its first column, and when (not
    if that column is all NaN)."""
    text, name = fill(panel.label, letters), panel.lines[0][0]
    if not panel.small_counts or not history[name].notna().any():
        return text
    index = int(np.nanargmin(history[name]))
    minimum, time = history[name].iloc[index], history["time_s"].iloc[index]
    return f"{text}\nminimum {minimum:.4g} at {time:.4g} s"


def _share_scale(axes: Sequence[Axes]) -> None:
    """Set the same vertical limits in all ``axes``: the lowest and the highest limit of any of
    them. Axes whose own limits span less than 5 % of that keep their own, and are labelled ``own
    scale``."""
    limits = np.array([ax.get_ylim() for ax in axes])
    low, high = limits[:, 0].min(), limits[:, 1].max()
    for ax, (own_low, own_high) in zip(axes, limits, strict=True):
        if own_high - own_low < _TOO_FLAT * (high - low):
            ax.set_ylabel(f"{ax.get_ylabel()}\nown scale")
        else:
            ax.set_ylim(low, high)


def _spans(values: "pd.Series[float]", bounds: Sequence[float]) -> bool:
    """Return True if values and bounds are all positive and span more than a factor of ten, so that
    a logarithmic scale suits them; NaN is left out."""
    numbers = np.append(values, bounds)
    low, high = np.nanmin(numbers), np.nanmax(numbers)
    return bool(0.0 < 10.0 * low < high)


def _phases(history: pd.DataFrame) -> list[tuple[str, float, float]]:
    """Return (name, start, end) of each phase of a history, in order: the times, s, of its first
    and last row. The list is empty if the history has no rows or no column ``phase``."""
    if "phase" not in history or history.empty:
        return []
    names, time = history["phase"].to_numpy(), history["time_s"].to_numpy()
    edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1), len(names)]
    return [(str(names[i]), float(time[i]), float(time[j - 1])) for i, j in pairwise(edges)]


def _name_phases(ax: Axes, phases: Iterable[tuple[str, float, float]], inches: float) -> None:
    """Write the name of each phase, from `_phases`, above its span of the time axis; all names are
    slanted if one is wider than its span. ``inches`` is the width of the axes with its labels."""
    phases = list(phases)
    duration = phases[-1][2] - phases[0][1] if phases else 0.0
    # 8 pt letters are about 4.4 pt wide; the axes take about 85 % of the width of the figure
    slanted = any(
        len(name) * 4.4 * duration > (end - start) * inches * 0.85 * 72
        for name, start, end in phases
    )
    for name, start, end in phases:
        ax.annotate(
            to_words(name), ((start + end) / 2, 1.0), (0, 3), xycoords=ax.get_xaxis_transform(),
            textcoords="offset points", fontsize=8,
            ha="left" if slanted else "center", va="bottom", rotation=35 if slanted else 0,
            rotation_mode="anchor", color="#555555",
        )  # fmt: skip
