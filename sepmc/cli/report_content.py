"""Content of the report of a run."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sepmc.analysis.requirements import FAIL, Verdict
from sepmc.analysis.statistics_text import WIDTH, render_audit, render_proportions, render_summary
from sepmc.campaign import run_statistics
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.label import of_settings
from sepmc.campaign.run_statistics import RunStatistics
from sepmc.campaign.store import manifests
from sepmc.cli.figures import clearance_bounds, draw_figures, event_times, ranked_outcomes
from sepmc.cli.flight_comparison import draw_flight, read_stored_flight, render_flight
from sepmc.cli.input_sensitivity import InputSensitivity, analyse, draw_sensitivities
from sepmc.cli.options import load_run, redundant
from sepmc.cli.render import render_accuracy
from sepmc.cli.results import phases
from sepmc.processes import processes
from sepmc.report import page
from sepmc.report.drawing import draw_vehicle
from sepmc.report.history_figures import run_figures
from sepmc.scene.messages import Log, no_log
from sepmc.scene.model import VIOLATION
from sepmc.schema import Status

_PAGES = ("rates", "angles", "separation", "hinges", "clearances")  # figures of a worst case
_ACCURACY = 1e-5  # relative; errors below are not visible in a figure
_SHOWN = 12  # outcomes in the table
_WIDTH = 160  # characters of a line of the table of all outcomes
_WORST, _MOST_WORST = 2, 4  # worst cases shown over time; at most, if more requirements fail
_ROWS = 400  # of their histories


def write_report(folder: Path, campaign: Campaign, replays: bool, log: Log) -> Path:
    """Write the report of a run, with its worst cases simulated again if ``replays``; return its
    path. A second process draws the vehicle and the outcomes meanwhile."""
    with TemporaryDirectory() as temporary, processes(1) as second:
        into = Path(temporary)
        drawn = second.submit(_draw_run, folder, into)
        run = run_statistics.read_run(folder, campaign)
        drivers = analyse(folder, campaign, run)
        worst = _draw_worst(campaign, run, into, log) if replays else []
        content = _content(campaign, run, drivers, worst)
        figures = draw_sensitivities(drivers, folder, campaign, into, ".svg")
        flight = read_stored_flight(folder)
        flight_figures = []
        if flight is not None:
            content.flight = render_flight(flight[1], _WIDTH, folder)
            flight_figures.append(draw_flight(*flight, folder, into, ".svg"))
        path = folder / "report.html"
        page.write_report(content, path, *drawn.result(), figures, flight_figures)
        manifests.record_derived(folder, [path])
        return path


def _draw_run(folder: Path, into: Path) -> tuple[list[Path], list[Path]]:
    """Draw the vehicle, and the outcomes, of a run into a folder; return the paths of both."""
    campaign = load_run(folder)
    run = run_statistics.read_run(folder, campaign)
    vehicle = draw_vehicle(
        campaign.scene, campaign.file.dispersions, campaign.name, into / "vehicle.svg"
    )
    outcomes = draw_figures(
        folder,
        campaign,
        run.summary,
        run.table,
        run.verdicts,
        log=no_log,
        page=into,
        converging=True,
    )
    return [vehicle], outcomes


def _content(
    campaign: Campaign, run: RunStatistics, drivers: InputSensitivity, worst: list[page.CaseReplay]
) -> page.ReportContent:
    """Collect the content of a report."""
    manifest, counts = run.manifest, run.summary.counts
    sensitivities, attributions = drivers.texts(WIDTH)
    units = {column.name: column.unit for column in campaign.outcome_columns}
    source = campaign.file.reference.source if campaign.file.reference else "reference"
    sentences = {status.label: status.sentence for status in Status}
    table = render_summary(run.table, counts, units, source, _WIDTH)
    last = manifest["sessions"][-1]
    return page.ReportContent(
        name=campaign.name,
        title=campaign.file.title,
        facts=f"{campaign.name}, {manifest['cases']:,} cases, seed {manifest['seed']}, sampler "
        f"{campaign.scene.run.sampler}; run {last['finished'][:10]} by sepmc {last['sepmc']}; "
        f"campaign {manifest['digest']}{of_settings(campaign.settings).replace(chr(10), '; ')}",
        notes=[*manifest.get("notes", ()), *redundant(campaign)],
        verdicts=run.verdicts,
        counts=table.partition("\n")[0],
        failures=[
            f"{count} cases {label}: {sentences.get(label, '')}"
            for label, count in counts.items()
            if count and label != Status.OK.label
        ],
        proportions=render_proportions(run.table),
        statistics=run.table,
        leading=ranked_outcomes(campaign, run.table)[:_SHOWN],
        units=units,
        all_statistics=table,
        accuracy=render_accuracy(run.accuracy, phases(campaign, run.accuracy))
        if "errors" in run.accuracy
        else "",
        audit=render_audit(run.audit),
        sessions=manifest["sessions"],
        campaign=campaign.file.toml,
        sensitivities=sensitivities,
        attributions=attributions,
        replays=worst,
    )


def _draw_worst(
    campaign: Campaign, run: RunStatistics, into: Path, log: Log
) -> list[page.CaseReplay]:
    """Simulate the worst cases of the requirements again, and draw them into a folder."""
    verdicts = [v for v in run.verdicts if v.worst_case is not None and v.metric != VIOLATION]
    # requirements that fail come first, then violated ones; of each, cases that have the outcome
    verdicts.sort(key=lambda v: (v.verdict != FAIL, not v.violations, v.worst is None))
    worst: dict[Any, Verdict] = {v.worst_case: v for v in reversed(verdicts)}
    solver = campaign.scene.solver
    if solver.step is None and solver.accuracy < _ACCURACY:
        campaign = campaign.with_settings({"solver.accuracy": _ACCURACY})
    failing = sum(v.verdict == FAIL for v in worst.values())
    replays = []
    for number, v in list(reversed(worst.items()))[: min(max(_WORST, failing), _MOST_WORST)]:
        which = "the first that violates" if v.worst is None else "the worst of"
        log(f"running case {number} again, {which} {v.name}")
        every_s = campaign.scene.run.end_time / _ROWS
        case = campaign.case(number, run.manifest["seed"])
        history = campaign.simulate(case, every_s, log)
        unit = next((c.unit for c in campaign.outcome_columns if c.name == v.metric), "")
        title = (
            f"case {number}, the first of {v.violations} that violate {v.name}"
            if v.worst is None
            else f"case {number}, the worst of {v.name}: {v.metric} {v.worst:.5g} {unit}"
        )
        figures = run_figures(
            history,
            into / str(number),
            campaign.layout.bodies,
            list(campaign.layout.joints),
            suffix=".svg",
            only=_PAGES,
            required=clearance_bounds(campaign),
            marks=event_times(history.attrs),
        )
        replays.append(page.CaseReplay(title.rstrip(), figures))
    return replays
