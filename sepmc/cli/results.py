"""Printing of the statistics and verdicts of a run, and its exit code. Heavy modules are imported
at use."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.exits import FAILED, INVALID, first_fault
from sepmc.cli.render import for_screen, render_accuracy, screen_width, show, warn
from sepmc.wording import count_cases

if TYPE_CHECKING:
    import pandas as pd

    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.run_statistics import RunStatistics
    from sepmc.scene.messages import Log

_FEW_OK = 0.9  # fraction of completed cases below which statistics get a warning
ACCURACY_FAULT = "the requested accuracy was not met; see the warning above"


def check_rows(folder: Path) -> dict[str, Any]:
    """Return the manifest of a run folder that stores the rows of its cases (of an interrupted run,
    those so far). Raises StoreError if the folder has statistics only, maybe with selected rows, a
    single case, or a rare-event estimate, or as `read_manifest`, such as for a changed file."""
    from sepmc.campaign.store import folders, manifests

    manifest = manifests.read_manifest(folder)
    if "rare" in manifest:
        raise folders.StoreError(
            f"{folder}: contains {folders.RARE} and no run: see rare.json and rare.png; sepmc "
            f"campaign {folder} --samples {folder / 'rare.parquet'} runs its cases"
        )
    if manifest.get("stats_only"):
        stored = "with the rows selected by --keep" if manifest.get("keep") else "without case rows"
        advice = (
            "see statistics.csv and statistics.json; any case can be run again: sepmc run "
            f"{folder} --case N"
            if manifest.get("complete")
            else f"it was interrupted; to continue: sepmc campaign {folder} --out {folder} --resume"
        )
        raise folders.StoreError(
            f"{folder}: contains statistics {stored}, but this command needs all rows; {advice}"
        )
    if "cases" not in manifest:
        raise folders.StoreError(f"{folder}: contains a single case; give the folder of a campaign")
    return manifest


def show_results(
    campaign: "Campaign", run: "RunStatistics", log: "Log", columns: str | None = None
) -> None:
    """Print statistics, failures, audit, numerical error and verdicts of a run by ``log``. If
    ``columns`` is given (patterns separated by commas), statistics are only of the outcomes that
    match it. Raises InputError if a pattern matches none."""
    from sepmc.analysis import requirements_text
    from sepmc.analysis.statistics_text import render_audit, render_summary
    from sepmc.schema import Status

    units = {column.name: column.unit for column in campaign.outcome_columns}
    source = campaign.file.reference.source if campaign.file.reference else "reference"
    counts, width = run.summary.counts, screen_width()
    log(render_summary(matching(run.table, columns), counts, units, source, width))
    sentences = {status.label: status.sentence for status in Status}
    for label, count in counts.items():
        if label != Status.OK.label and count:
            cases = run.summary.failed[label]
            first = ", ".join(map(str, cases)) + (", ..." if count > len(cases) else "")
            log(f"{count_cases(count)} {label}: {sentences.get(label, '')} (case {first})")
    total, ok = sum(counts.values()), counts.get(Status.OK.label, 0)
    if 0 < ok < _FEW_OK * total:
        warn(f"statistics leave out {total - ok} of {total} cases, which did not complete")
    log(render_audit(run.audit, width))
    if "errors" in run.accuracy:
        log(for_screen(render_accuracy(run.accuracy, phases(campaign, run.accuracy))))
    if run.verdicts:
        log(requirements_text.render_verdicts(run.verdicts, units, width))


def phases(campaign: "Campaign", accuracy: Any) -> list[str]:
    """Return the names of the kernel segments of a run, from the entry ``accuracy`` of its
    manifest; those of the phases of the campaign if it has no segments."""
    return accuracy.get("stages") or [phase.name for phase in campaign.scene.phase]


def exit_code(run: "RunStatistics", must_pass: bool) -> int:
    """Print the first fault of a run, and return its exit code: 1 without an ok case, 3 if the
    audit failed or the accuracy is not met, 1 if ``must_pass`` and a requirement has another
    verdict than pass; 0 without a fault."""
    from sepmc.analysis.requirements import PASS
    from sepmc.schema import Status

    return first_fault(
        (
            not run.summary.counts.get(Status.OK.label, 0),
            FAILED,
            "no case ended with status ok; see the column status",
        ),
        (
            (run.audit["beyond"] > 0).any(),
            INVALID,
            "the audit failed; shorten solver.step_s or look at the cases named in statistics.json",
        ),
        (not run.accuracy.get("met", True), INVALID, ACCURACY_FAULT),
        (
            must_pass and any(verdict.verdict != PASS for verdict in run.verdicts),
            FAILED,
            "not every requirement has the verdict pass",
        ),
    )


def show_selected(
    folder: Path, campaign: "Campaign", terms: tuple[str, ...], columns: str | None, as_json: bool
) -> None:
    """Print statistics and verdicts of the cases of a run that satisfy all conditions ``terms``, as
    tables or, if ``as_json``, in the form of ``statistics.json``. Statistics are only of the
    outcomes that match ``columns`` (patterns separated by commas; all if None). Raises InputError
    if no case satisfies the conditions, or a pattern matches no outcome."""
    import pandas as pd

    from sepmc.analysis import requirements_text, row_filter
    from sepmc.analysis.row_statistics import TableStatistics
    from sepmc.analysis.statistics import ok_rows
    from sepmc.analysis.statistics_text import render_summary
    from sepmc.campaign import run_statistics
    from sepmc.campaign.store import folders, manifests, shards
    from sepmc.scene.messages import InputError

    cases = shards.CaseColumns(folder)
    names = row_filter.filter_names(campaign.file.dispersions, list(cases))
    selected = row_filter.matching_rows(cases, names, terms)
    condition = row_filter.describe_filter(terms)
    if not selected.any():
        raise InputError(f"{condition}: satisfied by none of {cases.rows} cases")
    outcomes, audits, bounds, required = campaign.summary_inputs
    rows = {name: cases[name][selected] for name in ("case", "status", *outcomes, *audits)}
    run = run_statistics.evaluate(
        campaign,
        TableStatistics(rows, outcomes, audits, bounds, required),
        {**manifests.read_manifest(folder), "rarely_drawn": ()},
        with_reference=False,
    )
    units, width = {c.name: c.unit for c in campaign.outcome_columns}, screen_width()
    table = matching(run.table, columns)
    if as_json:
        click.echo(folders.json_text({"where": list(terms)} | run.as_json(units, table)), nl=False)
        return
    show(f"{condition}: satisfied by {selected.sum()} of {cases.rows} cases")
    for message in row_filter.assumed_units(names, terms):
        show(message)
    if ok_rows(cases)[selected].any():
        show(render_summary(table, run.summary.counts, units, width=width))
    else:
        ends = pd.Series(cases["status"][selected]).value_counts()
        statuses = ", ".join(f"{count} {label}" for label, count in ends.items())
        show(f"no statistics, as none of these cases completed: {statuses}")
    if run.verdicts:
        show(requirements_text.render_verdicts(run.verdicts, units, width, population="such cases"))
        if missing := requirements_text.render_cases_needed(run.verdicts):
            show(missing)
    if by := row_filter.filter_outcomes(names, terms):
        show(
            f"selected by outcomes ({', '.join(by)}), not by inputs: verdicts on these cases may "
            "follow from the selection"
        )


def matching(table: "pd.DataFrame", columns: str | None) -> "pd.DataFrame":
    """Return the rows of a table of statistics whose outcomes match a pattern of ``columns``, a
    text of patterns separated by commas; all rows if None. Raises InputError if a pattern matches
    no outcome."""
    from sepmc.scene.messages import InputError, nearest

    if columns is None:
        return table
    patterns = [pattern.strip() for pattern in columns.split(",")]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in table.index):
            raise InputError(
                f"--columns {pattern}: no such outcome; {nearest(pattern, table.index)}"
            )
    return table[[any(fnmatchcase(name, p) for p in patterns) for name in table.index]]
