"""HTML report of a run: one self-contained page with SVG figures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from sepmc.analysis.requirements import FAIL, NOT_SHOWN, PASS, Verdict, has_two_bounds
from sepmc.analysis.requirements_text import format_proportion, render_missing, requirement_sentence
from sepmc.analysis.statistics_text import column_groups, rounded

_STYLES = {PASS: "pass", FAIL: "fail"}


@dataclass
class CaseReplay:
    """A case shown over time, in SVG files."""

    title: str
    figures: Sequence[Path]


@dataclass
class ReportContent:
    """Content of a report.

    Parameters
    ----------
    name, title : str
        Of the campaign.
    facts : str
        A line on cases, seed and date.
    notes : sequence of str
        Warnings of the run.
    verdicts : sequence of Verdict
    counts : str
        A line on statuses.
    failures : sequence of str
        A line on each status except ok.
    proportions : sequence of str
        A line on each yes-or-no outcome.
    statistics : DataFrame
        From `sepmc.analysis.statistics.statistics`.
    leading : sequence of str
        Outcomes in the first table.
    units : mapping of outcome to unit
    all_statistics : str
        The whole table as text.
    accuracy, audit : str
    sessions : sequence of mapping
        Of the manifest.
    campaign : str
        The campaign file.
    sensitivities, attributions : sequence of str
        Texts on each outcome, and on each violated requirement.
    replays : sequence of CaseReplay
    flight : str
        Text on the comparison with a flight; empty without one.
    """

    name: str
    title: str
    facts: str
    notes: Sequence[str]
    verdicts: Sequence[Verdict]
    counts: str
    failures: Sequence[str]
    proportions: Sequence[str]
    statistics: pd.DataFrame
    leading: Sequence[str]
    units: Mapping[str, str]
    all_statistics: str
    accuracy: str
    audit: str
    sessions: Sequence[Mapping[str, Any]]
    campaign: str
    sensitivities: Sequence[str] = ()
    attributions: Sequence[str] = ()
    replays: Sequence[CaseReplay] = field(default_factory=list)
    flight: str = ""


def write_report(
    report: ReportContent,
    path: Path,
    vehicle: Sequence[Path],
    outcomes: Sequence[Path],
    sensitivity: Sequence[Path],
    flight: Sequence[Path] = (),
) -> Path:
    """Write a report with its figures from SVG files.

    Parameters
    ----------
    report : ReportContent
    path : Path
        Of the page.
    vehicle, outcomes, sensitivity, flight : sequence of Path
        Figures of the vehicle, of the outcomes, of their sensitivity, and of a flight.

    Returns
    -------
    Path
        ``path``.
    """
    figures = {
        "vehicle_figures": _embedded(vehicle),
        "outcome_figures": _embedded(outcomes),
        "sensitivity_figures": _embedded(sensitivity),
        "flight_figures": _embedded(flight),
        "replays": [
            {"title": replay.title, "figures": _embedded(replay.figures)}
            for replay in report.replays
        ],
    }
    template = files("sepmc.report").joinpath("report.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    columns, rows = _statistics(report.statistics, report.leading)
    html = environment.from_string(template).render(
        vars(report)
        | figures
        | {
            "columns": columns,
            "leading": rows,
            "outcomes": len(report.statistics),
            "verdicts": [_verdict(v, report.units.get(v.metric, "")) for v in report.verdicts],
            "sessions": [_session(session) for session in report.sessions],
        }
    )
    path.write_text(html, encoding="utf-8")
    return path


# points: figures up to this width stand side by side, at 0.79 of their size or more
_HALF_WIDTH = 560.0


def _embedded(paths: Sequence[Path]) -> list[dict[str, str]]:
    """Return SVG files as elements of a page, and the class of each by its width."""
    figures = []
    for path in paths:
        text = path.read_text(encoding="utf-8")
        svg = text[text.index("<svg") :]
        width = float(svg.partition(' width="')[2].partition("pt")[0])
        figures.append({"svg": svg, "style": "half" if width <= _HALF_WIDTH else "whole"})
    return sorted(figures, key=lambda figure: figure["style"])  # pairs first


def _statistics(table: pd.DataFrame, names: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the statistics of some outcomes."""
    cells = [
        (head, column)
        for _, columns in column_groups(table.loc[list(names)], None)
        for head, column in columns.items()
    ]
    rows = [[name, *(column[i] for _, column in cells)] for i, name in enumerate(names)]
    return [head for head, _ in cells], rows


def _verdict(v: Verdict, unit: str) -> dict[str, Any]:
    """Return a row of the table of requirements."""
    unit = "" if unit == "1" else unit

    def format_value(value: float | None, case: str = "") -> str:
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
        else format_value(v.worst, f" ({v.worst_case})"),
        "design": ("margin " if has_two_bounds(v) and v.design_value is not None else "")
        + format_value(v.design_value),
    }


def _session(one: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the table of sessions."""
    seconds = ", ".join(f"{stage} {s:.3g}" for stage, s in one.get("timing_s", {}).items())
    packages = ", ".join(f"{name} {v}" for name, v in one.get("versions", {}).items())
    return {
        "started": one.get("started", ""),
        "cases": one.get("cases_flown", ""),
        "threads": one.get("threads", ""),
        "seconds": seconds,
        "versions": f"sepmc {one.get('sepmc', '')}, {packages}, {one.get('machine', '')}",
    }
