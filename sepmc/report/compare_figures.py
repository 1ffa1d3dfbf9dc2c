"""Figure with the cumulative distributions of each outcome in two runs, in the same axes."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sepmc.report.style import BLUE, VERMILION, make_axes, make_folder, save, set_title
from sepmc.wording import to_words


def overlay_figure(
    values: Mapping[str, tuple[np.ndarray, np.ndarray]],
    folder: Path,
    units: Mapping[str, str],
    names: tuple[str, str],
) -> Path:
    """Draw the cumulative distribution of each outcome in two runs.

    Parameters
    ----------
    values : mapping of outcome to (ndarray, shape (n,), ndarray, shape (m,))
        Finite values in the first and in the second run, at least one each.
    folder : Path
        Created if missing.
    units : mapping of outcome to unit
    names : tuple of str
        Names of the first and of the second run.

    Returns
    -------
    Path
        The file written, ``compare.png`` in the folder.
    """
    columns = min(3, len(values))
    figure, axes = make_axes(-(-len(values) // columns), columns, (3.8, 3.0))
    for ax, (outcome, pair) in zip(axes, values.items(), strict=False):
        for x, colour, style, name in zip(pair, (BLUE, VERMILION), ("-", "--"), names, strict=True):
            ordered = np.sort(np.append(x, x.min()))  # so that the curve starts at 0
            fraction = np.arange(len(x) + 1) / len(x)
            ax.step(ordered, fraction, where="post", color=colour, linestyle=style, label=name)
        unit = units.get(outcome, "")
        words = to_words(outcome, unit)
        ax.set_xlabel(f"{words} ({unit})" if unit else words)
        ax.set_ylabel("fraction of cases below")
        ax.set_ylim(0.0, 1.0)
    for ax in axes[len(values) :]:
        ax.remove()
    set_title(figure, f"{names[0]} and {names[1]}")
    return save(figure, make_folder(folder) / "compare.png")
