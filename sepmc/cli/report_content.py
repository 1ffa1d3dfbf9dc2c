"""Content of the report of a run: statistics, figures and replays, gathered for the page."""

import gc
import json
import math
import shlex
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from sepmc.analysis.constant_outcomes import is_constant
from sepmc.analysis.requirements import FAIL, Verdict, required_bounds
from sepmc.analysis.statistics_text import (
    render_audit,
    render_comparison,
    render_counts,
    render_proportions,
    tail_note,
)
from sepmc.campaign import run_statistics
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.design_search import design_text
from sepmc.campaign.label import of_settings
from sepmc.campaign.limit_cases import WORST
from sepmc.campaign.run_statistics import RunStatistics
from sepmc.campaign.store import folders, manifests
from sepmc.campaign.store.shards import CaseColumns
from sepmc.cli.figures import (
    clearance_bounds,
    event_times,
    ranked_outcomes,
    start_figures,
    submitted,
)
from sepmc.cli.flight_comparison import read_stored_flight, render_flight
from sepmc.cli.input_sensitivity import (
    InputSensitivity,
    analyse,
    draw_attributions,
    draw_sensitivities,
)
from sepmc.cli.options import redundant
from sepmc.cli.render import render_accuracy
from sepmc.cli.results import phases
from sepmc.report import page
from sepmc.report.case_points import case_points
from sepmc.report.drawing import draw_vehicle
from sepmc.scene.messages import Log, no_log
from sepmc.scene.model import VIOLATION
from sepmc.scene.scenarios import BASELINE
from sepmc.schema import Status, is_yes_or_no
from sepmc.wording import count_cases

# files beside the run of a campaign with scenarios: title, a line, and columns
_BESIDE = (
    (
        "scenarios.csv",
        "Scenarios",
        "The same random numbers in each; the run folders are beside that of this page.",
        ("scenario", "run", "ok", "name", "verdict", "violations", "allowed", "title"),
    ),
    (
        "limits.csv",
        "Limit cases",
        "Inputs at their low or high end, the others nominal; and the worst combination found for "
        "each requirement. A violation here is no verdict: that is about a fraction of all cases. "
        "A case with no outcome counts as a violation.",
        ("limit", "status"),
    ),
)
_JUDGED = ("", "_outcome", "_margin")  # columns of a requirement
_COMBINED = ["low", "high", "between"]  # inputs of a combination
_PAGES = ("rates", "angles", "separation", "hinges", "clearances")  # figures of a worst case
_ACCURACY = 1e-5  # relative; errors below are not visible in a figure
_SHOWN = 12  # outcomes in the table
_INPUTS = 40  # inputs in the figure that zooms
_WIDTH = 160  # characters of a line of the table of all outcomes
_WORST, _MOST_WORST = 2, 4  # worst cases shown over time; at most, if more requirements fail
_ROWS = 400  # of their histories


def write_report(
    folder: Path,
    campaign: Campaign,
    worst: bool,
    numbers: Sequence[int],
    log: Log,
    second: Executor | None,
) -> Path:
    """Write the report of a run, ``report.html`` in its folder; return the path.

    Cases with ``numbers`` are simulated again for it, and, if ``worst``, the worst cases of the
    requirements. The process ``second``, if any, draws the vehicle, histograms, sensitivities and
    cases meanwhile, and ends.
    """
    gc.freeze()  # what imports left: a later collection of it takes 0.15 s
    with TemporaryDirectory() as temporary:
        into = Path(temporary)
        vehicle = submitted(
            partial(
                draw_vehicle,
                campaign.scene,
                campaign.file.dispersions,
                campaign.name,
                into / "vehicle.svg",
            ),
            second,
        )
        run = run_statistics.read_run(folder, campaign)
        outcomes = start_figures(
            folder,
            campaign,
            run.summary,
            run.table,
            run.verdicts,
            log=no_log,
            page=into,
            converging=True,
            second=second,
        )
        drivers = analyse(folder, campaign, run)
        sensitivities = draw_sensitivities(drivers, folder, campaign, into, ".svg", second)
        cases = _worst_cases(campaign, run) if worst else {}
        cases |= {number: (f"case {number}", "") for number in numbers if number not in cases}
        content = _content(campaign, run, drivers, folder)
        content.points = _points(campaign, run, folder, content.leading)
        replays, content.nominal = _replay(campaign, run, cases, into, log, second)
        if second is not None:
            second.shutdown(wait=False)  # it ends while the page is written
        attributions = draw_attributions(drivers, folder, into, ".svg")
        flight = read_stored_flight(folder)
        flight_figures = []
        if flight is not None:
            from sepmc.report.flight_figure import draw_flight

            content.flight = render_flight(flight, _WIDTH, folder)
            flight_figures.append(draw_flight(flight, into / "telemetry.svg"))
        outcome_figures = outcomes()
        content.replays = [replay() for replay in replays]
        path = page.write_report(
            content,
            folder / "report.html",
            [vehicle()],
            outcome_figures,
            attributions + sensitivities(),
            flight_figures,
        )
        manifests.record_derived(folder, [path])
        return path


def _content(
    campaign: Campaign, run: RunStatistics, drivers: InputSensitivity, folder: Path
) -> page.ReportContent:
    """Return the content of the report of a run in ``folder`` without the case points, the replays
    and the comparison with a flight, which the caller adds. It has no figures: `page.write_report`
    takes these beside it."""
    manifest, counts = run.manifest, run.summary.counts
    units = {column.name: column.unit for column in campaign.outcome_columns}
    source = campaign.file.reference.source if campaign.file.reference else "reference"
    sentences = {status.label: status.sentence for status in Status}
    table = run.table[[not is_yes_or_no(name) for name in run.table.index]]
    last = manifest["sessions"][-1]
    return page.ReportContent(
        name=campaign.name,
        title=campaign.file.title,
        facts=f"{campaign.name}, {count_cases(manifest['cases'], ',')}, seed {manifest['seed']}, "
        f"sampler {campaign.scene.run.sampler}; run {last['finished'][:10]} "
        f"by sepmc {last['sepmc']}; campaign {manifest['digest']}"
        f"{of_settings(campaign.settings).replace(chr(10), '; ')}",
        notes=[*manifest.get("notes", ()), *redundant(campaign)],
        verdicts=run.verdicts,
        counts=render_counts(counts, _WIDTH),
        failures=[
            f"{count_cases(count)} {label}: {sentences.get(label, '')}"
            for label, count in counts.items()
            if count and label != Status.OK.label
        ],
        proportions=render_proportions(run.table),
        statistics=table,
        leading=[name for name in ranked_outcomes(campaign, run.table) if name in table.index][
            :_SHOWN
        ],
        units=units,
        tail_note=tail_note(table),
        comparison=render_comparison(table, source, _WIDTH),
        accuracy=render_accuracy(run.accuracy, phases(campaign, run.accuracy))
        if "errors" in run.accuracy
        else "",
        audit=render_audit(run.audit),
        sessions=manifest["sessions"],
        campaign=campaign.file.toml,
        run=shlex.quote(str(folder)),
        driver_notes=drivers.notes(),
        beside=[*sizing_table(folder), *tables_beside(folder)],
    )


def sizing_table(folder: Path) -> list[page.PlainTable]:
    """Return a list with the section of the report on a sizing, if the run in ``folder`` is its
    verdict run: sentences, and a table of the designs searched whose costs are nearest to that of
    the chosen one. Empty for any other run."""
    if not manifests.is_recorded(folder, folders.SIZING):
        return []
    sizing = json.loads((folder / folders.SIZING).read_text(encoding="utf-8"))
    search, verdict = sizing["search"], sizing["verdict"]
    ranges = ", ".join(
        f"{name} = {one['key']} from {one['low']:g} to {one['high']:g}"
        for name, one in sizing["vary"].items()
    )
    rejected = design_text(sizing["nearest_not_accepted"] or {})
    ends = ", ".join(sizing["at_ends"])
    sentences = [
        f"Smallest {sizing['minimise']} over {ranges}, subject to "
        f"{', '.join(sizing['subject_to'])}: {design_text(sizing['design'])}.",
        f"The search accepted {search['accepted']} of {search['designs']} designs, by "
        f"{search['cases']:,} cases of seed {search['seed']} each, the same random numbers for "
        "all. A design is accepted if its margin is not below 0: that of the worst case in units "
        "of the spread of all cases, after as many violations as are accepted; it is empty if too "
        "many cases lack the outcome.",
        f"The nearest design that it did not accept: {rejected}." if rejected else "",
        f"At an end of its range, which decided it: {ends}." if ends else "",
        f"The verdicts above are those of this run, {verdict['cases']:,} cases of seed "
        f"{verdict['seed']}, none of which was used to choose the design; their confidence is "
        f"raised for up to {verdict['confidence_raised_for_runs']} such runs"
        f"{'' if verdict['shown'] else '; not every requirement is shown'}.",
    ]
    rows = sorted(search["nearest"], key=lambda row: row["cost"])
    head = list(rows[0])
    cells = [["" if row[name] is None else f"{row[name]:.6g}" for name in head] for row in rows]
    return [page.PlainTable("Sizing", " ".join(filter(None, sentences)), head, cells)]


def tables_beside(folder: Path) -> list[page.PlainTable]:
    """Return the tables of scenarios and of limit cases that `sepmc scenarios` wrote beside a run
    folder; none unless the folder is that of the campaign itself, ``baseline``. A file that does
    not exist is left out."""
    if folder.resolve().name != BASELINE:
        return []
    tables = []
    for name, title, note, columns in _BESIDE:
        path = folder.resolve().parent / name
        if not path.is_file():
            continue
        table = pd.read_csv(path)
        margins = [str(head) for head in table if str(head).endswith("_margin")]
        names = [head.removesuffix("_margin") for head in margins]
        wanted = [*columns, *(f"{name}{end}" for name in names for end in _JUDGED)]
        wanted += _COMBINED if margins else []
        shown = table[[head for head in wanted if head in table]]
        if margins:  # the name of any other limit case says where its inputs are
            is_worst = table["limit"].astype(str).str.startswith(WORST)
            shown = shown.assign(**{head: table[head].where(is_worst) for head in _COMBINED})
        shown = shown.dropna(axis=1, how="all")
        rows = [[_cell(value) for value in row] for row in shown.itertuples(index=False)]
        tables.append(page.PlainTable(title, note, list(map(str, shown)), rows))
    return tables


def _cell(value: Any) -> str:
    """Return a value of a stored table as text, a float with 5 significant digits; empty for NaN,
    which stands for a missing value."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.5g}"
    return str(value)


def _points(
    campaign: Campaign, run: RunStatistics, folder: Path, outcomes: Sequence[str]
) -> dict[str, Any]:
    """Return the data of the figure of the page that can be zoomed, as
    `sepmc.report.case_points.case_points` returns them: of the first `_INPUTS` inputs, and of those
    ``outcomes`` that are not constant."""
    return case_points(
        CaseColumns(folder),
        [name for name in outcomes if not is_constant(run.table, name)],
        [column.name for column in campaign.input_columns][:_INPUTS],
        {column.name: column.unit for column in campaign.columns},
        required_bounds(campaign.file.requirements),
    )


def _worst_cases(campaign: Campaign, run: RunStatistics) -> dict[int, tuple[str, str]]:
    """Choose the worst cases of requirements to show over time, those of failing requirements
    first: as many cases as requirements fail, but at least two, if there are, and at most four. The
    first cases that did not finish or lack a required outcome follow, at most four.

    Returns, by case number, its title in the report, and the end of a log message with the reason
    of the choice.
    """
    verdicts = [v for v in run.verdicts if v.worst_case is not None and v.metric != VIOLATION]
    # requirements that fail come first, then violated ones; of each, cases that have the outcome
    verdicts.sort(key=lambda v: (v.verdict != FAIL, not v.violations, v.worst is None))
    worst: dict[Any, Verdict] = {v.worst_case: v for v in reversed(verdicts)}
    failing = sum(v.verdict == FAIL for v in worst.values())
    cases = {}
    for number, v in list(reversed(worst.items()))[: min(max(_WORST, failing), _MOST_WORST)]:
        unit = next((c.unit for c in campaign.outcome_columns if c.name == v.metric), "")
        if v.worst is None:
            title = f"case {number}, the first of {v.violations} that violate {v.name}"
            reason = f", the first that violates {v.name}"
        else:
            title = f"case {number}, the worst of {v.name}: {v.metric} {v.worst:.5g} {unit}"
            reason = f", the worst of {v.name}"
        cases[number] = title.rstrip(), reason
    return cases | _first_missing_cases(verdicts, set(cases))


def _first_missing_cases(
    verdicts: Sequence[Verdict], others: set[int]
) -> dict[int, tuple[str, str]]:
    """Choose, for each verdict on an outcome, the first case that did not finish or lacks the
    outcome, at most four cases, without those in ``others``; return titles and reasons as
    `_worst_cases` does."""
    cases: dict[int, tuple[str, str]] = {}
    for v in verdicts:
        has_bound = v.at_least is not None or v.at_most is not None
        if has_bound and v.first_missing is not None and v.first_missing not in others:
            title = f"case {v.first_missing}, the first of {v.missing} without {v.metric}: "
            cases.setdefault(
                v.first_missing,
                (
                    f"{title}it counts as a violation of {v.name}",
                    f", the first without the outcome of {v.name}",
                ),
            )
    return dict(list(cases.items())[:_MOST_WORST])


def _replay(
    campaign: Campaign,
    run: RunStatistics,
    cases: dict[int, tuple[str, str]],
    into: Path,
    log: Log,
    second: Executor | None,
) -> tuple[list[Callable[[], page.CaseReplay]], dict[str, Any] | None]:
    """Simulate cases again, and draw them over time into the folder ``into``, in the process
    ``second`` if there is one.

    ``cases`` has, by case number, the title of its replay and the reason for it, with which the log
    message "running case N again" ends. Returns for each of these cases a function that waits for
    its figures and returns its replay, and the replay data of the nominal case; an empty list and
    None without cases. An accuracy finer than a figure can show is replaced by a coarser one.
    """
    if not cases:
        return [], None
    # 0.25 s, most of it for scipy.spatial, that a page without replays does not need
    from sepmc.report.history_figures import run_figures
    from sepmc.report.replay_data import replay_data

    solver, every_s = campaign.scene.solver, campaign.scene.run.end_time / _ROWS
    if solver.step is None and solver.accuracy < _ACCURACY:
        campaign = campaign.with_settings({"solver.accuracy": _ACCURACY})
    replays: list[Callable[[], page.CaseReplay]] = []
    for number, (title, reason) in cases.items():
        log(f"running case {number} again{reason}")
        case = campaign.case(number, run.manifest["seed"])
        history = campaign.simulate(case, every_s, log)
        figures = submitted(
            partial(
                run_figures,
                history,
                into / str(number),
                campaign.layout.bodies,
                list(campaign.layout.joints),
                suffix=".svg",
                only=_PAGES,
                required=clearance_bounds(campaign),
                marks=event_times(history.attrs),
            ),
            second,
        )
        data = replay_data(history, case.scene, title, number) if len(history) else None
        replays.append(partial(_case_replay, number, title, figures, data))
    nominal = campaign.simulate(None, every_s, log)
    return replays, replay_data(nominal, campaign.nominal().scene, "nominal case")


def _case_replay(
    number: int, title: str, figures: Callable[[], list[Path]], data: dict[str, Any] | None
) -> page.CaseReplay:
    """Return the replay of a case, whose ``figures`` are waited for."""
    return page.CaseReplay(number, title, figures(), data)
