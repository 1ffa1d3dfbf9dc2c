"""The one style of all figures of runs: axes, colours, legends, words.

Colours are those of Okabe and Ito, which colour-blind readers tell apart; line styles and tints
carry the same message in grey print. Legends, phase names and numbers stand outside the axes, so
nothing covers data. No pyplot: a figure here has no window and no state.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sepmc.paths import as_path, is_local

BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
# of bodies: what fills them, and their edges
TINTS = ("#cfe1f2", "#f8d9c4", "#d5ecd9", "#e6dff0", "#f3e9c6")
EDGES = (BLUE, VERMILION, GREEN, "#6a51a3", "#8c6d1f")
# of one thing in all figures: what is required; a reference
BOUND, REFERENCE = GREEN, VERMILION
REQUIRED = "required bound"
MARK = "#6a51a3"  # of a release or an event over time


SCREEN, PRINTED = 150, 300  # dots an inch
_dots = SCREEN


@contextmanager
def resolution(per_inch: int) -> Iterator[None]:
    """Write images with so many dots an inch meanwhile."""
    global _dots  # noqa: PLW0603
    before, _dots = _dots, per_inch
    try:
        yield
    finally:
        _dots = before


def make_folder(folder: Path) -> Path:
    """A folder, made if it is not there."""
    folder = as_path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def to_words(name: str, unit: str = "") -> str:
    """A column's name in words, without the unit it ends with."""
    suffix = "_" + unit.replace("/", "_").replace(" ", "_").replace("²", "2").replace("^", "")
    return (name.removesuffix(suffix) if unit else name).replace("_", " ")


def make_axes(
    rows: int,
    columns: int,
    size: tuple[float, float],
    widths: Sequence[float] | None = None,
) -> tuple[Figure, list[Axes]]:
    """A figure of rows x columns axes in the one style of all figures; ``size`` is that of one pair
    of axes, in inches, ``widths`` how wide the columns are beside each other."""
    figure = Figure(figsize=(columns * size[0], rows * size[1]), layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(rows, columns, squeeze=False, width_ratios=widths).ravel())
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(True, color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.tick_params(labelsize=9)
        ax.ticklabel_format(useOffset=False)
        # a "1e7" above the axes would lie on the names of phases
        ax.ticklabel_format(axis="y", scilimits=(-5, 8))
        ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return figure, axes


def set_title(figure: Figure, text: str) -> None:
    """Put a title above all axes, each of its lines folded to the width of the figure."""
    # 11 pt letters are about 6 pt wide
    width = int(figure.get_figwidth() * 72.0 / 6.0)
    lines = [fill(line, width, break_on_hyphens=False) for line in text.split("\n") if line]
    figure.suptitle("\n".join(lines), fontsize=11)


def _columns(texts: Sequence[str], inches: float) -> int:
    """In how many columns the texts of a legend stand in so many inches, in rows as even as can
    be."""
    wide = 0.55 + 0.072 * np.array([len(text) for text in texts])  # a handle, and 9 pt letters
    for columns in range(len(texts), 1, -1):
        rows = -(-len(texts) // columns)
        if columns > -(-len(texts) // rows):
            continue  # fewer columns make as many rows
        if sum(part.max() for part in np.array_split(wide, columns)) <= inches:
            return columns
    return 1


def save(figure: Figure, path: Path, order: Sequence[str] = ()) -> Path:
    """Gather one legend below all axes, what it names first in this ``order``, and write, as the
    name of the file ends. The file carries no date and no software name: equal data give equal
    bytes."""
    entries = {
        text: handle
        for ax in figure.axes
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)
        if text
    }
    named = [*(text for text in order if text in entries), *entries]
    entries = {text: entries[text] for text in named}
    if entries:
        columns = _columns(list(entries), figure.get_figwidth())
        style = {"frameon": False, "fontsize": 9, "columnspacing": 1.2}
        figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=columns,
            **style,
        )
    layout = figure.get_layout_engine()
    if layout is not None:  # savefig would draw all unseen before, only to lay it out
        figure.set_dpi(_dots)
        layout.execute(figure)
        figure.set_layout_engine(None)
    said = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    if path.suffix == ".pdf":
        said = {"CreationDate": None, "Producer": None, "Creator": None}
    with matplotlib.rc_context({"svg.hashsalt": "sepmc", "svg.fonttype": "none"}):
        # half the time of the usual level, for files a third larger
        fast: dict[str, Any] = {}
        if path.suffix == ".png":
            fast["pil_kwargs"] = {"compress_level": 3}
        into = path if is_local(path) else BytesIO()
        figure.savefig(into, format=path.suffix[1:], dpi=_dots, metadata=said, **fast)
        if isinstance(into, BytesIO):
            path.write_bytes(into.getvalue())
    return path
