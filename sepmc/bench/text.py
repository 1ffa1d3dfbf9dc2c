"""Tables, warnings and summary of a benchmark as plain text."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from sepmc.text_table import text_table

_FORMATS = {
    "error": "{:.1e}", "requested": "{:.0e}", "ms": "{:.3g}",
    "best_ms": "{:.3g}", "us_per_case": "{:.3g}", "time_ratio": "{:.3f}", "flop_ratio": "{:.3f}",
    "flops_per_evaluation": "{:.0f}", "flops_per_case": "{:.0f}", "evaluations": "{:.0f}",
    "s": "{:.4f}", "best_s": "{:.4f}",
    "kernel_s": "{:.4f}", "sample_s": "{:.4f}", "peak_MB": "{:.0f}", "speed_up": "{:.2f}",
    "compile_s": "{:.2f}", "over_ours": "{:.3g}", "spread": "{:.2f}",
}  # fmt: skip
MAX_QUIET_SPREAD = 0.1  # largest median spread of repeats without a warning
MIN_SPEED_UP = 1.1  # smallest speed-up of several threads without a warning
_COLUMNS = {
    "work_precision": (
        "formulation method setting requested error worst_outcome ms spread cases repeats scaled "
        "default"
    ),
    "features": (
        "feature change ms spread time_ratio flop_ratio evaluations flops_per_evaluation "
        "flops_per_case"
    ),
    "stages": "stage kind s spread best_s repeats",
    "scaling": "cases threads us_per_case kernel_s spread sample_s peak_MB speed_up",
    "peers": "engine setting error ms spread over_ours cases repeats scaled compile_s note",
}
_TEXT_COLUMNS = (
    "formulation", "method", "setting", "worst_outcome", "default", "scaled", "feature", "change",
    "stage", "kind", "engine", "note",
)  # fmt: skip
_TITLES = {
    "work_precision": "Work-precision: error against the reference, kernel time for 10,000 cases "
    "(ms, median; spread: interquartile range of its repeats over the median)",
    "features": "Cost of each feature: time and operations without it, over those of the whole "
    "scene, in the same steps, one thread",
    "stages": "Time by stage and by command (s, median)",
    "scaling": "Scaling: over cases (a process each, statistics only), over threads",
    "peers": "Other engines on the same cases (ms for 10,000 cases; over_ours: over our fastest "
    "at an error as small or smaller)",
}
TABLES = tuple(_TITLES)


def render_table(name: str, frame: pd.DataFrame) -> str:
    """Return the table of a part of the benchmark as plain text under its title; "-" marks missing
    values, and columns without any text are left out."""
    cells = pd.DataFrame(
        {
            column: [_cell(column, value) for value in frame[column]]
            for column in _COLUMNS[name].split()
            if column in frame
        }
    )
    cells = cells.loc[:, [bool((cells[column] != "").any()) for column in cells]]
    left = [k for k, column in enumerate(cells) if column in _TEXT_COLUMNS]
    rows = [[str(column) for column in cells], *cells.to_numpy().tolist()]
    return "\n".join([_TITLES[name], "", *text_table(rows, left)])


def _cell(column: str, value: Any) -> str:
    """Return a value of a column as text; NaN is "-". True is a mark that depends on the column,
    such as "<- default", and False an empty text."""
    if isinstance(value, bool) or type(value).__name__ == "bool":
        return {"scaled": "scaled", "default": "<- default"}[column] if value else ""
    if pd.isna(value):
        return "-"
    return _FORMATS.get(column, "{}").format(value)


def warnings(name: str, frame: pd.DataFrame) -> list[str]:
    """Return the warnings on the table ``frame`` of the part ``name``: that of `noise_warning`,
    then that of `threads_warning`, each only if there is one."""
    return [warning for warning in (noise_warning(name, frame), threads_warning(frame)) if warning]


def noise_warning(name: str, frame: pd.DataFrame) -> str:
    """Return a warning if the median of the column ``spread`` of a part's table (interquartile
    range of the repeats of a row over their median) is above 10 %, else an empty string, also if
    there is no spread. ``name`` is the part."""
    spreads = frame["spread"].dropna() if "spread" in frame else pd.Series(dtype=float)
    if not len(spreads) or spreads.median() <= MAX_QUIET_SPREAD:
        return ""
    return (
        f"warning: the machine was busy: the interquartile range of the repeats of {name} is "
        f"{100.0 * spreads.median():.0f} % of their median; ratios within a part are more reliable "
        "than times"
    )


def threads_warning(frame: pd.DataFrame) -> str:
    """Return a warning if the largest number of threads is at most 1.1 times as fast as one, else
    an empty string.

    ``frame`` is the table of a part of the benchmark; only that of "scaling" has the columns used,
    ``threads`` and ``speed_up`` (over one thread), in which threads rise from row to row. Without
    two speed-ups there is no warning.
    """
    speed_ups = frame["speed_up"].dropna() if "speed_up" in frame else pd.Series(dtype=float)
    if len(speed_ups) < 2 or speed_ups.iloc[-1] > MIN_SPEED_UP:
        return ""
    return (
        f"warning: {frame['threads'].iloc[-1]:.0f} threads are {speed_ups.iloc[-1]:.2f} times as "
        "fast as one: other processes use the cores, or the threads share one core"
    )


def render_headlines(headlines: Mapping[str, Any]) -> str:
    """Return the most important results, by label, as plain text of a line each."""
    return "\n".join(f"  {name:44s} {_number(value)}" for name, value in headlines.items())


def _number(value: Any) -> str:
    """Return a float with four significant digits, any other value as it prints."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
