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


_SCRIPTS = ("tables.js", "replay.js", "cases.js", "points.js")


@dataclass
class CaseReplay:
    """A case that the report shows over time, as figures and as a three-dimensional replay.

    Parameters
    ----------
    number : int
        Case number, from 0.
    title : str
        Heading of the case.
    figures : sequence of Path
        SVG files of its figures over time.
    data : mapping, optional
        Data of the replay, from `sepmc.report.replay_data.replay_data`; None for no replay.
    """

    number: int
    title: str
    figures: Sequence[Path]
    data: Mapping[str, Any] | None = None


@dataclass
class PlainTable:
    """A section of the report that consists of a table of texts.

    Parameters
    ----------
    title : str
        Heading of the section.
    note : str
        A line between the heading and the table.
    head : sequence of str
        Heads of the columns.
    rows : sequence of sequence of str
        Cells of each row.
    """

    title: str
    note: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass
class ReportContent:
    """Content of a report, apart from the figures that are given as files.

    Parameters
    ----------
    name, title : str
        Name and title of the campaign.
    facts : str
        A line on cases, seed and date.
    notes : sequence of str
        Warnings of the run.
    verdicts : sequence of Verdict
    counts : str
        A line on the number of cases by status.
    failures : sequence of str
        A line on each status except ok that a case has.
    proportions : sequence of str
        A line on each yes-or-no outcome.
    statistics : DataFrame
        From `sepmc.analysis.statistics.statistics`; all outcomes are listed at the end.
    leading : sequence of str
        Outcomes in the first table.
    units : mapping of outcome to unit
    tail_note : str
        Sentence on extreme percentiles of few cases, or empty.
    comparison : str
        Text on the comparison with the reference, or empty.
    accuracy, audit : str
        Texts on the numerical accuracy and on the audit of the run.
    sessions : sequence of mapping
        Entries of the manifest on the sessions (runs of the program) that ran the cases.
    campaign : str
        Text of the campaign file.
    run : str
        The run folder as it is to be written in a command line.
    driver_notes : sequence of str
        Sentences below the figures of sensitivity.
    replays : sequence of CaseReplay
        Cases shown over time.
    nominal : mapping, optional
        Data of the replay of the nominal case, from `sepmc.report.replay_data.replay_data`; None
        for no replay.
    flight : str
        Text on the comparison with a flight; empty without one.
    beside : sequence of PlainTable
        Tables of scenarios and limit cases that were run beside the campaign.
    points : mapping, optional
        Data of the interactive figure of cases, from `sepmc.report.case_points.case_points`; None
        for no figure.
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
    tail_note: str
    comparison: str
    accuracy: str
    audit: str
    sessions: Sequence[Mapping[str, Any]]
    campaign: str
    run: str = "RUN"
    driver_notes: Sequence[str] = ()
    replays: Sequence[CaseReplay] = field(default_factory=list)
    nominal: Mapping[str, Any] | None = None
    flight: str = ""
    beside: Sequence[PlainTable] = ()
    points: Mapping[str, Any] | None = None


def write_report(
    report: ReportContent,
    path: Path,
    vehicle: Sequence[Path],
    outcomes: Sequence[Path],
    sensitivity: Sequence[Path],
    flight: Sequence[Path] = (),
) -> Path:
    """Write a report as one HTML page that contains all its figures and scripts.

    Parameters
    ----------
    report : ReportContent
    path : Path
        File to write.
    vehicle, outcomes, sensitivity, flight : sequence of Path
        SVG files of the figures of the vehicle, of the outcomes, of their sensitivity, and of a
        flight.

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
            {
                "number": replay.number,
                "title": replay.title,
                "figures": _embedded(replay.figures),
            }
            for replay in report.replays
        ],
        "replay_data": [
            data
            for data in (report.nominal, *(replay.data for replay in report.replays))
            if data is not None
        ],
        "replayed": [replay.number for replay in report.replays],
        "scripts": [resource(name) for name in _SCRIPTS],
    }
    environment = templates()
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    columns, rows = _statistics(report.statistics, report.leading)
    html = environment.get_template("report.html.j2").render(
        vars(report)
        | figures
        | {
            "columns": columns,
            "leading": rows,
            "all_outcomes": _statistics(report.statistics, list(report.statistics.index))[1],
            "verdicts": [verdict_row(v, report.units.get(v.metric, "")) for v in report.verdicts],
            "sessions": [_session(session) for session in report.sessions],
        }
    )
    path.write_text(html, encoding="utf-8")
    return path


def templates(*packages: str) -> jinja2.Environment:
    """Return the Jinja environment whose templates are the files of `sepmc.report`, then those of
    the given packages; it escapes HTML."""

    def load(name: str) -> str | None:
        for package in ("sepmc.report", *packages):
            if files(package).joinpath(name).is_file():
                return resource(name, package)
        return None

    loader = jinja2.FunctionLoader(load)
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)


def resource(name: str, package: str = "sepmc.report") -> str:
    """Return the text of the file ``name`` of a package, `sepmc.report` by default."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


# points: figures up to this width stand side by side, at 0.79 of their size or more
_HALF_WIDTH = 560.0


def _embedded(paths: Sequence[Path]) -> list[dict[str, str]]:
    """Return for each SVG file a dict: ``svg`` is its element for the page, ``style`` its CSS
    class, ``half`` for a narrow figure and ``whole`` for a wide one. Narrow ones come first."""
    figures = []
    for path in paths:
        text = path.read_text(encoding="utf-8")
        svg = text[text.index("<svg") :].replace("<svg", '<svg role="img"', 1)
        width = float(svg.partition(' width="')[2].partition("pt")[0])
        figures.append({"svg": svg, "style": "half" if width <= _HALF_WIDTH else "whole"})
    return sorted(figures, key=lambda figure: figure["style"])  # pairs first


def _statistics(
    table: pd.DataFrame, names: Sequence[str]
) -> tuple[list[str], list[list[str | int]]]:
    """Return the heads of the columns after the first and the rows of a table of the statistics of
    outcomes ``names``; cells are texts, but case numbers are integers. A row begins with the name
    of the outcome, as in ``names``."""
    cells = [
        (head, column)
        for _, columns in column_groups(table.loc[list(names)], None)
        for head, column in columns.items()
    ]
    rows = [
        [
            name,
            *(
                int(column[i]) if head == "case" and column[i] != "-" else column[i]
                for head, column in cells
            ),
        ]
        for i, name in enumerate(names)
    ]
    return [head for head, _ in cells], rows


def verdict_row(v: Verdict, unit: str) -> dict[str, Any]:
    """Return the texts and numbers of a verdict for a row of the table of requirements, by the
    names that the template uses; ``unit`` is that of the outcome."""
    unit = "" if unit == "1" else unit

    def format_value(value: float | None) -> str:
        return "-" if value is None else f"{rounded(value, abs(value), 4)} {unit}".rstrip()

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
        "worst": "" if v.worst is None and v.worst_case is not None else format_value(v.worst),
        "case": v.worst_case,
        "without": v.first_missing if v.first_missing != v.worst_case else None,
        "design": ("margin " if has_two_bounds(v) and v.design_value is not None else "")
        + format_value(v.design_value),
    }


def _session(one: Mapping[str, Any]) -> dict[str, Any]:
    """Return the texts and numbers of a session (``one``, an entry of the manifest) for a row of
    the table of sessions, by the names that the template uses; an empty text for what the entry
    lacks."""
    seconds = ", ".join(f"{stage} {s:.3g}" for stage, s in one.get("timing_s", {}).items())
    packages = ", ".join(f"{name} {v}" for name, v in one.get("versions", {}).items())
    return {
        "started": one.get("started", ""),
        "cases": one.get("cases_flown", ""),
        "threads": one.get("threads", ""),
        "seconds": seconds,
        "versions": f"sepmc {one.get('sepmc', '')}, {packages}, {one.get('machine', '')}",
    }
