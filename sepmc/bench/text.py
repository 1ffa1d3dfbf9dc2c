"""Tables of a bench as text."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from sepmc.text_table import text_table

_FORMATS = {
    "error": "{:.1e}", "asked": "{:.0e}", "ms": "{:.3g}",
    "best_ms": "{:.3g}", "us_per_case": "{:.3g}", "time_ratio": "{:.3f}", "flop_ratio": "{:.3f}",
    "flops_per_evaluation": "{:.0f}", "flops_per_case": "{:.0f}", "evaluations": "{:.0f}",
    "s": "{:.4f}", "best_s": "{:.4f}",
    "kernel_s": "{:.4f}", "sample_s": "{:.4f}", "peak_MB": "{:.0f}", "speed_up": "{:.2f}",
    "compile_s": "{:.2f}", "over_ours": "{:.3g}", "spread": "{:.2f}",
}  # fmt: skip
QUIET = 0.1  # spread of repeats, in the median row of a part, up to which a machine is quiet
FASTER = 1.1  # that more threads are than one, at least
_SHOWN = {
    "work_precision": [
        "formulation",
        "method",
        "setting",
        "asked",
        "error",
        "worst_outcome",
        "ms",
        "spread",
        "cases",
        "repeats",
        "scaled",
        "default",
    ],
    "features": [
        "feature",
        "change",
        "ms",
        "spread",
        "time_ratio",
        "flop_ratio",
        "evaluations",
        "flops_per_evaluation",
        "flops_per_case",
    ],
    "stages": ["stage", "kind", "s", "spread", "best_s", "repeats"],
    "scaling": [
        "cases",
        "threads",
        "us_per_case",
        "kernel_s",
        "spread",
        "sample_s",
        "peak_MB",
        "speed_up",
    ],
    "peers": [
        "engine",
        "setting",
        "error",
        "ms",
        "spread",
        "over_ours",
        "cases",
        "repeats",
        "scaled",
        "compile_s",
        "note",
    ],
}
_WORDS = (
    "formulation",
    "method",
    "setting",
    "worst_outcome",
    "default",
    "scaled",
    "feature",
    "change",
    "stage",
    "kind",
    "engine",
    "note",
)
_TITLES = {
    "work_precision": "Work-precision: error against the reference, kernel time for 10,000 cases "
    "(ms, median; spread: the middle half of its repeats, over that)",
    "features": "Cost of each feature: time and operations without it, over those of the whole "
    "scene, in the same steps, one thread",
    "stages": "Time by stage and by command (s, median)",
    "scaling": "Scaling: over cases (a process each, statistics only), over threads",
    "peers": "Other engines on the same cases (ms for 10,000 cases; over_ours: over our fastest "
    "at an error as small or smaller)",
}
TABLES = tuple(_TITLES)


def table(name: str, frame: pd.DataFrame) -> str:
    """A part of the bench under its title; what does not apply is -."""
    shown = pd.DataFrame(
        {
            column: [_cell(column, value) for value in frame[column]]
            for column in _SHOWN[name]
            if column in frame
        }
    )
    shown = shown.loc[:, [bool((shown[column] != "").any()) for column in shown]]
    left = [k for k, column in enumerate(shown) if column in _WORDS]
    rows = [[str(column) for column in shown], *shown.to_numpy().tolist()]
    return "\n".join([_TITLES[name], "", *text_table(rows, left)])


def _cell(column: str, value: Any) -> str:
    if isinstance(value, bool) or type(value).__name__ == "bool":
        return {"scaled": "scaled", "default": "<- default"}[column] if value else ""
    if pd.isna(value):
        return "-"
    return _FORMATS.get(column, "{}").format(value)


def warnings(name: str, frame: pd.DataFrame) -> list[str]:
    """What is to be told of a part besides its numbers."""
    return [said for said in (unquiet(name, frame), idle_threads(frame)) if said]


def unquiet(name: str, frame: pd.DataFrame) -> str:
    """A warning if the repeats of a part lie far apart; empty if they do not."""
    spreads = frame["spread"].dropna() if "spread" in frame else pd.Series(dtype=float)
    if not len(spreads) or spreads.median() <= QUIET:
        return ""
    return (
        f"warning: the machine was not quiet: the middle half of the repeats of {name} spreads "
        f"over {100.0 * spreads.median():.0f} % of their median; ratios within a part are fairer "
        "than times"
    )


def idle_threads(frame: pd.DataFrame) -> str:
    """A warning if more threads are no faster than one; empty if they are."""
    found = frame["speed_up"].dropna() if "speed_up" in frame else pd.Series(dtype=float)
    if len(found) < 2 or found.iloc[-1] > FASTER:
        return ""
    return (
        f"warning: {frame['threads'].iloc[-1]:.0f} threads are {found.iloc[-1]:.2f} times as fast "
        "as one: something else takes the processors, or they are halves of one core"
    )


def headlines(told: Mapping[str, Any]) -> str:
    """What is to be remembered, a line each."""
    return "\n".join(f"  {name:44s} {_number(value)}" for name, value in told.items())


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
