"""`sepmc run`: simulate one case of a file and write its time history."""

import sys
from pathlib import Path

import click

from sepmc.cli.options import (
    EVERY,
    FILE,
    NO_PLOTS,
    OUT,
    OVERWRITE,
    QUIET,
    SEED,
    SETTINGS,
    load_campaign,
)
from sepmc.cli.render import logger
from sepmc.cli.single_case import SingleRun, check_stored, simulate_single


@click.command(short_help="Simulate one case of FILE and write its time history.")
@FILE
@click.option(
    "--case",
    "number",
    type=click.IntRange(min=0),
    help="Number of the dispersed case. Default: the nominal case.",
)
@SEED
@EVERY
@OUT
@SETTINGS
@NO_PLOTS
@OVERWRITE
@QUIET
def run(
    file: str,
    number: int | None,
    seed: int | None,
    every_s: float,
    out: Path | None,
    settings: tuple[str, ...],
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Simulate one case of FILE, and write its time history into a folder. Exit code 1 if its
    status is not ok.

    \b
    Examples:
      sepmc run table1.toml --every-s 0.0005
      sepmc run table2.toml --case 4711
    """
    from sepmc.paths import as_path

    campaign = load_campaign(file, settings)
    check_stored(as_path(file), number, seed, campaign.file.input_table is not None)
    single = SingleRun(number, seed, every_s, out, overwrite, not no_plots)
    sys.exit(simulate_single(campaign, single, logger(quiet)))
