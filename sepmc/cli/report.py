"""`sepmc report`: write the report of a run."""

from pathlib import Path

import click

from sepmc.cli.options import QUIET, RUN, load_run
from sepmc.cli.render import logger
from sepmc.cli.results import check_rows


@click.command(short_help="Write the report of RUN, report.html.")
@RUN
@click.option("--no-replay", is_flag=True, help="Do not simulate the worst cases again.")
@QUIET
def report(folder: Path, no_replay: bool, quiet: bool) -> None:
    """Write the report of RUN, report.html: verdicts, statistics, figures, sensitivities, the worst
    cases over time, and how the run was made, in one page that needs no network.

    \b
    Example:
      sepmc report runs/windy
    """
    check_rows(folder)
    from sepmc.cli.report_content import write_report

    log = logger(quiet)
    log(f"wrote {write_report(folder, load_run(folder), not no_replay, log)}")
