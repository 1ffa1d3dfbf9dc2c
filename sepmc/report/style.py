"""Common style of the figures of runs: axes, colours, titles, legends, and writing to files.

The colours are those of Okabe and Ito, which colour-blind readers can distinguish; line styles and
tints carry the same information in grey print. Legends, phase names and numbers stand outside the
axes, so that nothing covers data. pyplot is not used: figures have no window and no global state.
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
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from sepmc.paths import as_path, is_local

BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
# of bodies: fill and edge
TINTS = ("#cfe1f2", "#f8d9c4", "#d5ecd9", "#e6dff0", "#f3e9c6")
EDGES = (BLUE, VERMILION, GREEN, "#6a51a3", "#8c6d1f")
# the same in all figures: required bounds; a reference
BOUND, REFERENCE = GREEN, VERMILION
REQUIRED = "required bound"
MARK = "#6a51a3"  # releases and events


SCREEN, PRINTED = 150, 300  # dots per inch
_dots = SCREEN


@contextmanager
def resolution(per_inch: int) -> Iterator[None]:
    """Context manager within which `save` writes images with ``per_inch`` dots per inch; outside of
    it, images have 150."""
    global _dots  # noqa: PLW0603
    before, _dots = _dots, per_inch
    try:
        yield
    finally:
        _dots = before


def make_folder(folder: Path) -> Path:
    """Create a folder, and those above it, if missing; return its path. Raises OSError if that
    fails."""
    folder = as_path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


# of width or height: in smaller axes, a number at an end could reach beyond the pad around them
_SHRUNK = 0.9


class _Panel(Axes):
    """Axes that a layout measures once. A constrained layout measures the space that labels need
    around the axes, gives the axes a size, and measures again, as the size determines the ticks. If
    the ticks are those of the first measurement, so is the space, unless the axes have texts or
    became smaller."""

    _measured: tuple[list[float], np.ndarray, np.ndarray] | None = None

    def get_tightbbox(
        self, renderer: RendererBase | None = None, *, for_layout_only: bool = False, **options: Any
    ) -> Bbox | None:
        """Return the box around axes and labels, in pixels; every second one for a layout is that
        of the call before, moved with the axes, if they need the same space."""
        ticks = [*self.get_xlim(), *self.get_xticks(), *self.get_ylim(), *self.get_yticks()]
        axes, measured = self.get_window_extent(), self._measured
        size, self._measured = np.array(axes.size), None
        if for_layout_only and measured is not None:
            ticks_before, size_before, space = measured
            if ticks == ticks_before and np.all(size >= _SHRUNK * size_before):
                return Bbox.from_extents(*axes.extents + space)
        box = super().get_tightbbox(renderer, for_layout_only=for_layout_only, **options)
        if for_layout_only and box is not None and not self.texts:
            self._measured = ticks, size, np.subtract(box.extents, axes.extents)
        return box


def make_axes(
    rows: int, columns: int, size: tuple[float, float], widths: Sequence[float] | None = None
) -> tuple[Figure, list[Axes]]:
    """Create a figure with a grid of axes in the common style.

    Parameters
    ----------
    rows, columns : int
        Numbers of axes below and beside each other.
    size : tuple of float
        Width and height of the space for each axes, in inches.
    widths : sequence of float, optional
        Relative widths of the columns; equal if None.

    Returns
    -------
    figure : Figure
    axes : list of Axes
        Row by row.
    """
    figure = Figure(figsize=(columns * size[0], rows * size[1]), layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(
        figure.subplots(
            rows, columns, squeeze=False, width_ratios=widths, subplot_kw={"axes_class": _Panel}
        ).ravel()
    )
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(True, color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.tick_params(labelsize=9)
        ax.ticklabel_format(useOffset=False)
        # a "1e7" above the axes would cover names of phases
        ax.ticklabel_format(axis="y", scilimits=(-5, 8))
        ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return figure, axes


def set_title(figure: Figure, text: str) -> None:
    """Set a title above all axes; each line of ``text`` is folded to the width of the figure, and
    empty lines are left out."""
    # 11 pt letters are about 6 pt wide
    width = int(figure.get_figwidth() * 72.0 / 6.0)
    lines = [fill(line, width, break_on_hyphens=False) for line in text.split("\n") if line]
    figure.suptitle("\n".join(lines), fontsize=11)


def set_panel_title(ax: Axes, text: str, size: float) -> None:
    """Set the title of axes whose data are drawn, in letters of ``size`` points. Its height is
    fixed, which saves two layouts of the ordinate, unless that has a "1e9" above it to keep off."""
    formatter = ax.yaxis.get_major_formatter()
    formatter.set_locs(ax.get_yticks().tolist())
    ax.set_title(text, fontsize=size, y=None if formatter.get_offset() else 1.0)


def _columns(texts: Sequence[str], inches: float) -> int:
    """Return the number of columns of a legend with entries ``texts``: the largest that fits into a
    width of ``inches``, unless fewer columns give as many rows; at least 1. A column is as wide as
    its longest entry."""
    widths = 0.55 + 0.072 * np.array([len(text) for text in texts])  # a handle, and 9 pt letters
    for columns in range(len(texts), 1, -1):
        rows = -(-len(texts) // columns)
        if columns > -(-len(texts) // rows):
            continue  # fewer columns give as many rows
        if sum(part.max() for part in np.array_split(widths, columns)) <= inches:
            return columns
    return 1


def lay_out(figure: Figure) -> None:
    """Give the axes of a figure their final places, unless that was done before. Without it savefig
    would first draw everything for the layout."""
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)


def save(figure: Figure, path: Path, order: Sequence[str] = ()) -> Path:
    """Set one legend below all axes, with one entry for equal labels, and write the figure.

    The file contains no date and no software name, so equal data give equal bytes.

    Parameters
    ----------
    figure : Figure
    path : Path
        File to write, in a folder that exists; the suffix selects the format.
    order : sequence of str
        Labels whose legend entries come first, in this order.

    Returns
    -------
    Path
        ``path``.
    """
    entries = {
        text: handle
        for ax in figure.axes
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)
        if text
    }
    ordered = [*(text for text in order if text in entries), *entries]
    entries = {text: entries[text] for text in ordered}
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
    figure.set_dpi(_dots)
    lay_out(figure)
    metadata: dict[str, str | None] = {"Software": None}
    if path.suffix == ".svg":  # the title is the text for readers who do not see the figure
        metadata = {"Date": None, "Title": " ".join(figure.get_suptitle().split())}
    if path.suffix == ".pdf":
        metadata = {"CreationDate": None, "Producer": None, "Creator": None}
    with matplotlib.rc_context({"svg.hashsalt": "sepmc", "svg.fonttype": "none"}):
        # half the time of the default level, for files a third larger
        fast: dict[str, Any] = {}
        if path.suffix == ".png":
            fast["pil_kwargs"] = {"compress_level": 3}
        target = path if is_local(path) else BytesIO()
        figure.savefig(target, format=path.suffix[1:], dpi=_dots, metadata=metadata, **fast)
        if isinstance(target, BytesIO):
            path.write_bytes(target.getvalue())
    return path
