"""How rarely: the levels from cases of the laws to the bound, and which inputs violate it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sepmc.analysis.subset_simulation import mean_interval
from sepmc.campaign.execution.rare_event import RareEventEstimate
from sepmc.report.style import (
    BLUE,
    BOUND,
    REQUIRED,
    make_axes,
    make_folder,
    save,
    set_title,
    to_words,
)

_INPUTS = 10  # drawn
_ALIKE = 1e-6  # of the range of margins: levels no farther apart lie at one
_MEAN, _JUMP = "mean of the replicas", "many cases have this margin"


def rare_figure(
    found: RareEventEstimate,
    folder: Path,
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw the probability of coming to each level over its margin, of every replica and of their
    mean with its 95 % interval, and the normal scores of the inputs in the cases that violate; into
    ``rare.png``, or with another ``suffix``; returns its path.

    Parameters
    ----------
    found : what was estimated
    folder : made if it is not there
    keys : paths of inputs in the file, by column
    about : the campaign and what is asked, for the title
    """
    drawn = list(found.inputs.items())[:_INPUTS]
    figure, axes = make_axes(1, 2 if drawn else 1, (6.0, 4.2))
    ax, levels = axes[0], [level for level in found.levels if level.replicas.any()]
    margin = np.array([level.threshold for level in levels])
    each = np.array([level.replicas for level in levels]).reshape(len(levels), -1)
    ends = np.array([mean_interval(level.replicas) for level in levels]).reshape(-1, 2)
    mean = np.array([level.reached for level in levels])
    ax.errorbar(
        margin, mean, yerr=np.abs(ends.T - mean), fmt="none", ecolor=BLUE, capsize=3, label="95 %"
    )
    # where many cases have one margin, several levels lie there
    jumps = np.flatnonzero(np.abs(np.diff(margin)) <= _ALIKE * np.ptp(margin))
    for part in np.split(np.arange(len(levels)), jumps + 1):
        shown = np.where(each[part] > 0.0, each[part], np.nan)
        ax.plot(margin[part], shown, color="#a9a9a9", lw=0.8, label="replicas")
        ax.plot(margin[part], mean[part], "o-", color=BLUE, lw=1.6, ms=4, label=_MEAN)
    for jump in jumps:
        both = slice(jump, jump + 2)
        ax.plot(margin[both], mean[both], ":", color=BLUE, lw=1.2, label=_JUMP)
    ax.axvline(0.0, color=BOUND, lw=2.2, label=REQUIRED)
    ax.set_yscale("log")
    unit = "" if found.unit == "1" else f" ({found.unit})"
    ax.set_xlabel(f"margin of {to_words(found.metric, found.unit)}{unit}")
    ax.set_ylabel("probability that the margin is less")
    low, high = found.interval
    said = f"probability of a violation {found.probability:.2e}, 95 %: {low:.1e} to {high:.1e}"
    ax.set_title(said, fontsize=10)
    if drawn:
        ax, rows = axes[1], np.arange(len(drawn))[::-1]
        means, sigmas = np.array([said for _, said in drawn]).T
        ax.errorbar(means, rows, xerr=sigmas, fmt="o", color=BLUE, ms=4, capsize=3)
        ax.axvspan(-1.0, 1.0, color="#eeeeee", zorder=0, label="all cases, one sigma")
        ax.set_yticks(rows, [keys.get(name, name) for name, _ in drawn], fontsize=8)
        ax.set_xlabel("normal score in cases that violate: mean and one sigma")
        ax.set_title("inputs that drive it", fontsize=10)
    set_title(figure, f"Rare event of {about}")
    return save(figure, make_folder(folder) / f"rare{suffix}")
