"""The report of a run: one HTML page that holds everything, figures as SVG among it, and asks
nothing of a server."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from sepmc.analysis.requirements import (
    FAIL,
    NOT_SHOWN,
    PASS,
    Verdict,
    format_proportion,
    has_two_bounds,
    render_missing,
    requirement_sentence,
)
from sepmc.analysis.statistics_text import column_groups, rounded

_STYLES = {PASS: "pass", FAIL: "fail"}


@dataclass
class CaseReplay:
    """A case that is shown over time, in SVG files."""

    title: str
    figures: Sequence[Path]


@dataclass
class ReportContent:
    """What a report tells.

    ``name``, ``title`` : of the campaign; ``facts``: one line on cases, seed and date
    ``notes`` : warnings of the run
    ``verdicts`` ; ``counts``: a line on statuses; ``failures``: a line on each but ok; ``shares``:
        a line on each outcome that is yes or no
    ``statistics`` : table of `sepmc.analysis.statistics.statistics`; ``telling``: the outcomes that
        come first; ``units``: by outcome; ``every``: the table as text
    ``drivers``, ``causes`` : texts on each outcome, and on what is violated
    ``replays`` : cases shown over time
    ``accuracy``, ``audit`` : texts
    ``sessions`` : of the manifest; ``campaign``: the file
    """

    name: str
    title: str
    facts: str
    notes: Sequence[str]
    verdicts: Sequence[Verdict]
    counts: str
    failures: Sequence[str]
    shares: Sequence[str]
    statistics: pd.DataFrame
    telling: Sequence[str]
    units: Mapping[str, str]
    every: str
    accuracy: str
    audit: str
    sessions: Sequence[Mapping[str, Any]]
    campaign: str
    drivers: Sequence[str] = ()
    causes: Sequence[str] = ()
    replays: Sequence[CaseReplay] = field(default_factory=list)


def write_report(
    report: ReportContent,
    path: Path,
    vehicle: Sequence[Path],
    outcomes: Sequence[Path],
    drivers: Sequence[Path],
) -> Path:
    """Write a report into a file, with its figures from SVG files: the ``vehicle``, the
    ``outcomes`` and what drives them; those of replays are named there. Returns the path."""
    figures = {
        "vehicle_figures": _embedded(vehicle),
        "outcome_figures": _embedded(outcomes),
        "driver_figures": _embedded(drivers),
        "replays": [
            {"title": one.title, "figures": _embedded(one.figures)} for one in report.replays
        ],
    }
    template = files("sepmc.report").joinpath("report.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    columns, rows = _statistics(report.statistics, report.telling)
    page = environment.from_string(template).render(
        vars(report)
        | figures
        | {
            "columns": columns,
            "telling": rows,
            "outcomes": len(report.statistics),
            "verdicts": [_verdict(v, report.units.get(v.metric, "")) for v in report.verdicts],
            "sessions": [_session(one) for one in report.sessions],
        }
    )
    path.write_text(page, encoding="utf-8")
    return path


_HALF = 700.0  # points: figures that are no wider stand side by side


def _embedded(paths: Sequence[Path]) -> list[dict[str, str]]:
    """SVG files as elements of a page, and the class of each by its width."""
    found = []
    for path in paths:
        text = path.read_text(encoding="utf-8")
        svg = text[text.index("<svg") :]
        width = float(svg.partition(' width="')[2].partition("pt")[0])
        found.append({"svg": svg, "style": "half" if width <= _HALF else "whole"})
    return found


def _statistics(table: pd.DataFrame, names: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the statistics of some outcomes."""
    cells = [
        (head, column)
        for _, columns in column_groups(table.loc[list(names)], None)
        for head, column in columns.items()
    ]
    rows = [[name, *(column[i] for _, column in cells)] for i, name in enumerate(names)]
    return [head for head, _ in cells], rows


def _verdict(v: Verdict, unit: str) -> dict[str, Any]:
    """A row of the table of requirements."""
    unit = "" if unit == "1" else unit

    def shown(value: float | None, case: str = "") -> str:
        if value is None:
            return "-"
        return f"{rounded(value, abs(value), 4)} {unit}".rstrip() + case

    return {
        "verdict": v.verdict.upper(),
        "style": _STYLES.get(v.verdict, "other"),
        "sentence": requirement_sentence(v, unit),
        "why": f"{v.more} more cases without a violation would show it"
        if v.verdict == NOT_SHOWN
        else v.why,
        "violations": f"{v.violations} of {v.cases}",
        "missing": render_missing(v) if v.missing else "",
        "allowed": v.allowed if v.allowed >= 0 else "too few cases",
        "share": " to ".join(
            format_proportion(*end)
            for end in ((v.share_low, math.floor), (v.share_high, math.ceil))
        ),
        "worst": f"case {v.worst_case}"
        if v.worst is None and v.worst_case is not None
        else shown(v.worst, f" ({v.worst_case})"),
        "design": ("margin " if has_two_bounds(v) and v.design_value is not None else "")
        + shown(v.design_value),
    }


def _session(one: Mapping[str, Any]) -> dict[str, Any]:
    """A row of the table of sessions."""
    seconds = ", ".join(f"{stage} {s:.3g}" for stage, s in one.get("timing_s", {}).items())
    packages = ", ".join(f"{name} {v}" for name, v in one.get("versions", {}).items())
    return {
        "started": one.get("started", ""),
        "cases": one.get("cases_flown", ""),
        "threads": one.get("threads", ""),
        "seconds": seconds,
        "versions": f"sepmc {one.get('sepmc', '')}, {packages}, {one.get('machine', '')}",
    }
