"""`sepmc replay`: simulate one case of a run again, and check its row."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli.options import EVERY, NO_PLOTS, OUT, OVERWRITE, QUIET, RUN, load_run
from sepmc.cli.render import logger
from sepmc.cli.results import check_rows
from sepmc.cli.single_case import SingleRun, check_stored, simulate_single

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign


@click.command(short_help="Simulate one case of RUN again, and check its row.")
@RUN
@click.option("--case", "number", type=click.IntRange(min=0), help="The case of this number.")
@click.option("--worst", metavar="REQUIREMENT", help="The worst case of a requirement.")
@click.option("--min", metavar="OUTCOME", help="The case with the minimum of OUTCOME.")
@click.option("--max", metavar="OUTCOME", help="The case with the maximum of OUTCOME.")
@click.option(
    "--nearest",
    metavar="OUTCOME:AT",
    help="The case nearest to a percentile (p99.73), the mean or a value of OUTCOME.",
)
@EVERY
@OUT
@click.option(
    "--animate",
    type=click.Choice(("gif", "mp4")),
    help="Write an animation too: animation.gif or, with ffmpeg, animation.mp4 (half a minute).",
)
@NO_PLOTS
@OVERWRITE
@QUIET
def replay(
    folder: Path,
    number: int | None,
    every_s: float,
    out: Path | None,
    animate: str | None,
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
    **ways: str | None,
) -> None:
    """Simulate one case of RUN again with its time history. To check its row in RUN, the compiled
    kernel of the campaign integrates the case again too, and the row is compared bit by bit.
    Figures show the nominal case behind it. Exit code 1 if its status is not ok, or its row
    differs.

    \b
    Examples:
      sepmc replay runs/windy --worst no_recontact --animate gif
      sepmc replay runs/windy --nearest separation_speed_m_s:p99.73
    """
    log = logger(quiet)
    check_rows(folder)
    targets = {way: target for way, target in ways.items() if target is not None}
    if len(targets) + (number is not None) != 1:
        raise click.UsageError("give exactly one of --case, --worst, --min, --max and --nearest")
    campaign = load_run(folder)
    for way, target in targets.items():
        number, sentence = _select(folder, campaign, way, target)
        log(f"{folder}: case {number} {sentence}")
    check_stored(folder, number, None)
    single = SingleRun(number, None, every_s, out, overwrite, not no_plots, folder, animate)
    sys.exit(simulate_single(campaign, single, log))


def _select(folder: Path, campaign: "Campaign", way: str, target: str) -> tuple[int, str]:
    """Select a case of a run; return its number, and the end of a sentence that says why, such as
    ``has the minimum of COLUMN``.

    ``way`` is the option worst, min, max or nearest, and ``target`` its value: for worst the name
    or metric of a requirement; for min and max an outcome, input or audit column; for nearest such
    a column, a colon, and a percentile (p99.73), ``mean`` or a value. Of min, max and nearest only
    cases whose status is ok count. Raises InputError if
    ``target`` is none of these or no case can be selected, StoreError if the folder is damaged.
    """
    from sepmc.campaign import run_statistics
    from sepmc.campaign.execution import replay
    from sepmc.campaign.execution.accuracy import with_scales
    from sepmc.campaign.store import shards

    if way == "worst":
        run = run_statistics.read_run(folder, campaign)
        errors = run_statistics.numerical_errors(run.accuracy)
        scaled = with_scales(campaign, errors, run.table)
        return replay.worst_case(run.summary, campaign, scaled, target)
    cases = shards.CaseColumns(folder)
    if way == "nearest":
        number, value = replay.nearest_case(cases, target)
        return number, f"is nearest to {value}"
    return replay.extreme_case(cases, target, way == "min"), f"has the {way}imum of {target}"
