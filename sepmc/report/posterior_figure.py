"""Figure of an estimation from telemetry: measurements over the bands of prior and posterior, with
the residuals below."""

from pathlib import Path

import numpy as np

from sepmc.campaign.estimation import INTERVAL, Estimation
from sepmc.report.style import BLACK, VERMILION, make_axes, make_folder, save, set_title
from sepmc.wording import to_words

_PRIOR, _POSTERIOR = "#cfe1f2", "#2c7fb8"
_SIGMAS = 2.0  # of the band of residuals
_DOTS = 400  # samples up to which each is a dot


def posterior_figure(estimation: Estimation, about: str, path: Path) -> Path:
    """Draw each measured channel over the bands of cases with parameters distributed as before the
    flight (prior) and as estimated (posterior), and below it its residuals from the posterior mean.

    Residuals are in units of the channel's sigma. The mean residual of each block of time is drawn
    in standard deviations of that mean instead (`sepmc.analysis.model_check.TimeBlock.score`).

    Parameters
    ----------
    estimation : Estimation
        Result of the estimation, with its curves and its model check.
    about : str
        Last line of the title.
    path : Path
        File to write; the suffix selects the format. Its folder is created if missing.

    Returns
    -------
    Path
        ``path``.
    """
    make_folder(path.parent)
    channels, width = estimation.channels, min(2, len(estimation.channels))
    bands = -(-len(channels) // width)
    figure, axes = make_axes(2 * bands, width, (5.8, 2.6))
    percent = f"{100.0 * INTERVAL:g} %"
    for k, channel in enumerate(channels):
        row, column = divmod(k, width)
        upper, lower = axes[2 * row * width + column], axes[(2 * row + 1) * width + column]
        own = estimation.curves[estimation.curves["measurement"] == k]
        time, sigma = own["time_s"], own["sigma"]
        for stem, tint, text in (
            ("prior", _PRIOR, f"{percent} before the flight"),
            ("posterior", _POSTERIOR, f"{percent} after the flight"),
        ):
            upper.fill_between(
                time, own[f"{stem}_low"], own[f"{stem}_high"], color=tint, linewidth=0, label=text
            )
        upper.plot(time, own["posterior_median"], color=BLACK, linewidth=0.9, label="median after")
        few = len(own) <= _DOTS
        upper.plot(
            time, own["measured"], color=VERMILION, linestyle="" if few else "-", linewidth=0.7,
            marker="." if few else "", markersize=3.0, label="measured",
        )  # fmt: skip
        words = to_words(channel.column, channel.unit)
        upper.set_ylabel(f"{words} ({channel.unit})" if channel.unit != "1" else words)
        lower.axhspan(-_SIGMAS, _SIGMAS, color="#e8e8e8", linewidth=0, label=f"{_SIGMAS:g} sigma")
        lower.plot(
            time, own["residual"] / sigma, color="#999999", linestyle="", marker=".", markersize=2.5
        )
        blocks = [one for one in estimation.check.by_time if one.channel == k]
        centres = [0.5 * (one.start_s + one.end_s) for one in blocks]
        scores = np.array([one.score for one in blocks])
        lower.plot(
            centres, scores, color=VERMILION, marker="s", markersize=4.0, linewidth=0.8,
            label="mean of a block, in its deviations",
        )  # fmt: skip
        lower.set(xlabel="time of the run (s)", ylabel="residual (sigma)")
        for ax in (upper, lower):
            ax.margins(x=0.01)
    for k in range(len(channels), bands * width):
        row, column = divmod(k, width)
        axes[2 * row * width + column].remove()
        axes[(2 * row + 1) * width + column].remove()
    verdict = "model shortfall" if estimation.check.is_short else "explained by the model"
    set_title(figure, f"Telemetry and estimate: {verdict}\n{about}")
    return save(figure, path)
