"""Figure of a rare-event estimate: probabilities of the levels of subset simulation, from typical
cases to the required bound, and the inputs of violating cases."""

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
)
from sepmc.wording import to_words

_MAX_INPUTS = 10  # inputs drawn
_SAME_MARGIN = 1e-6  # fraction of the range of margins within which levels coincide
_MEAN, _JUMP = "mean of the replicas", "many cases have this margin"


def rare_figure(
    result: RareEventEstimate,
    folder: Path,
    keys: Mapping[str, str],
    about: str,
    suffix: str = ".png",
) -> Path:
    """Draw the probability that the margin is below the threshold of each level, by replica and as
    mean with its 95 % interval, and the normal scores of the leading inputs in violating cases.

    Parameters
    ----------
    result : RareEventEstimate
        From `sepmc.campaign.execution.rare_event`.
    folder : Path
        Created if missing.
    keys : mapping of input column to TOML path
    about : str
        Campaign and requirement, for the title.
    suffix : str
        Ending of the file name, with its dot, which selects the format.

    Returns
    -------
    Path
        The file written, ``rare`` + suffix in the folder.
    """
    inputs = list(result.inputs.items())[:_MAX_INPUTS]
    figure, axes = make_axes(1, 2 if inputs else 1, (6.0, 4.2))
    ax, levels = axes[0], [level for level in result.levels if level.replicas.any()]
    margin = np.array([level.threshold for level in levels])
    replicas = np.array([level.replicas for level in levels]).reshape(len(levels), -1)
    ends = np.array([mean_interval(level.replicas) for level in levels]).reshape(-1, 2)
    mean = np.array([level.reached for level in levels])
    ax.errorbar(
        margin, mean, yerr=np.abs(ends.T - mean), fmt="none", ecolor=BLUE, capsize=3, label="95 %"
    )
    # several levels coincide where many cases have one margin
    jumps = np.flatnonzero(np.abs(np.diff(margin)) <= _SAME_MARGIN * np.ptp(margin))
    for part in np.split(np.arange(len(levels)), jumps + 1):
        positive = np.where(replicas[part] > 0.0, replicas[part], np.nan)
        ax.plot(margin[part], positive, color="#a9a9a9", lw=0.8, label="replicas")
        ax.plot(margin[part], mean[part], "o-", color=BLUE, lw=1.6, ms=4, label=_MEAN)
    for jump in jumps:
        pair = slice(jump, jump + 2)
        ax.plot(margin[pair], mean[pair], ":", color=BLUE, lw=1.2, label=_JUMP)
    ax.axvline(0.0, color=BOUND, lw=2.2, label=REQUIRED)
    ax.set_yscale("log")
    unit = "" if result.unit == "1" else f" ({result.unit})"
    ax.set_xlabel(f"margin of {to_words(result.metric, result.unit)}{unit}")
    ax.set_ylabel("probability that the margin is less")
    low, high = result.interval
    title = f"probability of a violation {result.probability:.2e}, 95 %: {low:.1e} to {high:.1e}"
    ax.set_title(title, fontsize=10)
    if inputs:
        ax, rows = axes[1], np.arange(len(inputs))[::-1]
        means, sigmas = np.array([score for _, score in inputs]).T
        ax.errorbar(means, rows, xerr=sigmas, fmt="o", color=BLUE, ms=4, capsize=3)
        ax.axvspan(-1.0, 1.0, color="#eeeeee", zorder=0, label="all cases, one sigma")
        ax.set_yticks(rows, [keys.get(name, name) for name, _ in inputs], fontsize=8)
        ax.set_xlabel("normal score in cases that violate: mean and one sigma")
        ax.set_title("leading inputs", fontsize=10)
    set_title(figure, f"Rare event: {about}")
    return save(figure, make_folder(folder) / f"rare{suffix}")
