"""`sepmc doctor`: check the files of a run, and repair them."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli.exits import DONE, FAILED
from sepmc.cli.figures import draw_figures
from sepmc.cli.options import QUIET, RUN
from sepmc.cli.render import logger
from sepmc.cli.results import exit_code
from sepmc.wording import count_cases

if TYPE_CHECKING:
    from sepmc.campaign.store.manifests import Finding
    from sepmc.scene.messages import Log

_FIGURES = (".png", ".svg", ".pdf")
_TABLES = (".csv", ".html")


@click.command(short_help="Check RUN, file by file, and repair it.")
@RUN
@click.option(
    "--repair",
    is_flag=True,
    help="Make files again that are missing or were changed: run cases, count and draw.",
)
@QUIET
def doctor(folder: Path, repair: bool, quiet: bool) -> None:
    """Check RUN, file by file: report files that are missing, cut short, changed since they were
    written, or never finished. Exit code 1 if there are any.

    With --repair, the cases of damaged files are run again, to the same bits, and statistics and
    figures are made again; the exit code is 0 if no fault is left. Tables of other commands, such
    as sensitivity, are only named. If a fault cannot be repaired, such as a changed campaign file,
    nothing is changed.

    \b
    Example:
      sepmc doctor runs/windy --repair
    """
    from sepmc.campaign.store import manifests

    log = logger(quiet)
    findings = manifests.diagnose(folder)
    for finding in findings:
        click.echo(finding.text)
    if not findings:
        log(f"{folder}: every file is as it was written")
        return
    if repair:
        sys.exit(_repair(folder, findings, log))
    advice = (finding.advice for finding in findings if not finding.repairable)
    click.echo(next(advice, f"to repair it: sepmc doctor {folder} --repair"), err=True)
    sys.exit(FAILED)


def _repair(folder: Path, findings: "Sequence[Finding]", log: "Log") -> int:
    """Make the missing and changed files of a run folder again. Tables of other commands are not
    made again, but removed from the ledger and named. Returns the exit code: 1 if faults are left,
    else 0. Raises StoreError if one of the ``findings`` cannot be repaired, such as a
    changed campaign file."""
    from sepmc.campaign.campaign import load
    from sepmc.campaign.case_selection import parse
    from sepmc.campaign.store import folders, manifests

    for finding in findings:
        if not finding.repairable:
            raise folders.StoreError(f"{finding.text}. It cannot be repaired; {finding.advice}")
    known = folders.ledger_is_intact(folder)
    manifests.ensure_ledger(folder)
    manifest = manifests.read_provenance(folder)
    campaign = load(folder, verify=False)
    numbers = manifest.get("numbers")
    result = campaign.run(
        parse(numbers) if numbers else manifest.get("cases"),
        manifest.get("seed"),
        out=folder,
        resume=True,
        announce=log,
    )
    n_run = sum(result.status_counts.values()) - result.resumed
    run = result.written
    assert run is not None
    figures = not known or any(finding.file.endswith(_FIGURES) for finding in findings)
    if figures:
        drawn = draw_figures(
            folder, campaign, run.summary, run.table, run.verdicts, log=logger(quiet=True)
        )
        manifests.record_derived(folder, drawn)
    exit_code(run, must_pass=False)
    log(f"{folder}: {count_cases(n_run)} run again{', figures drawn again' if figures else ''}")
    if lost := manifests.forget_damaged(folder, _FIGURES + _TABLES):
        log(
            f"not made again: {', '.join(lost)}; to make them: sepmc plot, sensitivity, fit or "
            "report"
        )
    left = manifests.diagnose(folder)
    for finding in left:
        click.echo(finding.text, err=True)
    return FAILED if left else DONE
