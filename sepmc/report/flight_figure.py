"""Figure of the telemetry of a flight over the envelope of a run."""

from pathlib import Path

from sepmc.analysis.telemetry import FlightComparison
from sepmc.report.style import (
    BLACK,
    VERMILION,
    make_axes,
    make_folder,
    save,
    set_title,
)
from sepmc.wording import to_words

_BANDS = (("p0.5", "p99.5", "#cfe1f2", "99 % of cases"), ("p5", "p95", "#6aa7d6", "90 % of cases"))
_DOTS = 150  # samples of a channel up to which each is marked


def draw_flight(comparison: FlightComparison, path: str | Path) -> Path:
    """Draw each channel of a flight over the percentile bands of the cases, and write the figure.

    Parameters
    ----------
    comparison : FlightComparison
        From `Result.compare_flight`.
    path : str or Path
        File to write; the suffix, ``.png``, ``.svg`` or ``.pdf``, selects the format. Its folder is
        created if missing.

    Returns
    -------
    Path
        ``path``.
    """
    path, curves = Path(path), comparison.curves
    units = {str(name): str(unit) for name, unit in comparison.channels["unit"].items()}
    make_folder(path.parent)
    columns = min(2, len(units))
    figure, axes = make_axes(-(-len(units) // columns), columns, (5.6, 3.4))
    for ax, (name, unit) in zip(axes, units.items(), strict=False):
        own = curves[curves["channel"] == name]
        time = own["time_s"]
        for low, high, tint, text in _BANDS:
            ax.fill_between(time, own[low], own[high], color=tint, linewidth=0, label=text)
        ax.plot(time, own["p50"], color=BLACK, linewidth=1.4, linestyle="--", label="median")
        ax.plot(time, own["nominal"], color=BLACK, linewidth=1.0, label="nominal case")
        marker = "." if len(own) <= _DOTS else ""
        ax.plot(
            time, own["flight"], color=VERMILION, linewidth=1.0, marker=marker, markersize=3,
            label="flight", zorder=3,
        )  # fmt: skip
        words = to_words(name, unit)
        ax.set(xlabel="time of the run (s)", ylabel=f"{words} ({unit})" if unit != "1" else words)
        ax.margins(x=0)
    for ax in axes[len(units) :]:
        ax.remove()
    about = f"{comparison.run}, {comparison.n_cases} cases; {comparison.data}"
    set_title(figure, f"Flight and envelope of the run\n{about}")
    return save(figure, path)
