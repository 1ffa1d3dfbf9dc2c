"""How rarely: the levels from cases of the laws to the bound, and which inputs violate it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sepmc.analysis.rare import interval
from sepmc.campaign.rare import Rare
from sepmc.report.style import BLUE, VERMILION, entitle, in_words, made, save, sheet

_INPUTS = 10  # drawn


def rare_figure(
    found: Rare, folder: Path, keys: Mapping[str, str], about: str, suffix: str = ".png"
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
    figure, axes = sheet(1, 2 if drawn else 1, (6.0, 4.2))
    ax, levels = axes[0], [level for level in found.levels if level.replicas.any()]
    margin = np.array([level.threshold for level in levels])
    each = np.array([level.replicas for level in levels])
    for k, replica in enumerate(each.T):
        shown = np.where(replica > 0.0, replica, np.nan)
        ax.plot(margin, shown, color="#a9a9a9", lw=0.8, label="replicas" if k == 0 else None)
    ends = np.array([interval(level.replicas) for level in levels]).reshape(-1, 2)
    mean = np.array([level.reached for level in levels])
    ax.fill_between(margin, *ends.T, color="#a9cdea", linewidth=0, label="95 %")
    ax.plot(margin, mean, "o-", color=BLUE, lw=1.6, ms=4, label="mean of the replicas")
    ax.axvline(0.0, color=VERMILION, lw=1.6, label="bound")
    ax.set_yscale("log")
    unit = "" if found.unit == "1" else f" ({found.unit})"
    ax.set_xlabel(f"margin of {in_words(found.metric, found.unit)}{unit}")
    ax.set_ylabel("probability of no more margin")
    low, high = found.interval
    ax.set_title(f"{found.probability:.2e}, 95 %: {low:.1e} to {high:.1e}", fontsize=10)
    if drawn:
        ax, rows = axes[1], np.arange(len(drawn))[::-1]
        means, sigmas = np.array([said for _, said in drawn]).T
        ax.errorbar(means, rows, xerr=sigmas, fmt="o", color=BLUE, ms=4, capsize=3)
        ax.axvspan(-1.0, 1.0, color="#eeeeee", zorder=0, label="all cases, one sigma")
        ax.set_yticks(rows, [keys.get(name, name) for name, _ in drawn], fontsize=8)
        ax.set_xlabel("normal score in cases that violate: mean and one sigma")
        ax.set_title("inputs that drive them", fontsize=10)
    entitle(figure, f"Rare event of {about}")
    return save(figure, made(folder) / f"rare{suffix}")
