"""`sepmc report`: write the report of a run as one HTML page."""

from pathlib import Path

import click

from sepmc.cli.figures import drawing_process
from sepmc.cli.options import QUIET, RUN, load_run
from sepmc.cli.render import logger
from sepmc.cli.results import check_rows
from sepmc.cli.single_case import check_stored

_MOST = 100  # cases of --replays


def _numbers(ctx: click.Context, param: click.Parameter, value: str | None) -> list[int]:
    """Return the case numbers of the text ``3,17``, sorted, each once; empty for None. Raises
    BadParameter for other text, a negative number, or too many different numbers."""
    try:
        numbers = [] if value is None else sorted({int(number) for number in value.split(",")})
    except ValueError:
        raise click.BadParameter(f"{value}: must be case numbers, as 3,17") from None
    if any(number < 0 for number in numbers) or len(numbers) > _MOST:
        raise click.BadParameter(f"{value}: must be at most {_MOST} case numbers, from 0 on")
    return numbers


@click.command(short_help="Write the report of RUN, report.html.")
@RUN
@click.option("--no-replay", is_flag=True, help="Do not simulate the worst cases again.")
@click.option(
    "--replays",
    "numbers",
    metavar="N,N",
    callback=_numbers,
    help="Also simulate the cases with these numbers again, such as 3,17.",
)
@QUIET
def report(folder: Path, no_replay: bool, numbers: list[int], quiet: bool) -> None:
    """Write the report of RUN, report.html: verdicts, statistics, figures, sensitivities, the worst
    cases (and those of --replays) over time and as three-dimensional replays, and how the run was
    made, in one page that needs no network.

    \b
    Examples:
      sepmc report runs/windy
      sepmc report runs/windy --replays 3,17
    """
    with drawing_process(True) as second:  # imports at the same time as this one
        check_rows(folder)
        for number in numbers:
            check_stored(folder, number, None)
        from sepmc.cli.report_content import write_report

        log = logger(quiet)
        log(f"wrote {write_report(folder, load_run(folder), not no_replay, numbers, log, second)}")
