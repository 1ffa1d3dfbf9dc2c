"""`sepmc allocate`: find which tolerances may be doubled, or must be halved."""

import sys
from pathlib import Path

import click

from sepmc.cli.options import (
    CHECK,
    FILE,
    QUIET,
    SEED,
    SETTINGS,
    THREADS,
    check_out_file,
    load_campaign,
    out_file_option,
    overwrite_option,
)


@click.command(short_help="Find which tolerances of FILE may be doubled, or must be halved.")
@FILE
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help="Cases of every run. Default: run.cases of the file.",
)
@SEED
@SETTINGS
@THREADS
@out_file_option("NAME-allocation.csv, a row for each input", "CSV")
@CHECK
@overwrite_option("the file in --out")
@QUIET
def allocate(
    file: str,
    cases: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    must_pass: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Halve and double the spread of each dispersed input of FILE, on the same random numbers, and
    show how the probability of a violation changes, as a table that is also written as a CSV file,
    NAME-allocation.csv by default.

    If FILE passes its requirements, the proposal doubles as many spreads as possible while it still
    passes; else it halves as few as possible until it passes. A run with another seed judges the
    proposal. With --check the exit code is 1 unless that run shows every requirement.

    \b
    Example:
      sepmc allocate lightband --cases 2000
    """
    from sepmc.campaign.allocation import allocate as allocate_spreads
    from sepmc.campaign.store import folders
    from sepmc.cli.allocation_results import render_allocation
    from sepmc.cli.progress import progress_bar
    from sepmc.cli.render import logger, show, warn

    campaign = load_campaign(file, settings)
    path = out or Path(f"{campaign.name}-allocation.csv")
    check_out_file(path, (".csv",), overwrite)
    log = logger(quiet)
    each = cases or campaign.scene.run.cases
    with progress_bar(each, quiet) as report:

        def progress(done: int, runs: int) -> None:
            if report:
                report(done * each, runs * each, 0)

        allocation = allocate_spreads(campaign, cases, seed, threads, log, progress)
    folders.write_text(path, allocation.table.to_csv(index=False))
    warn(*allocation.notes)
    if not quiet:
        show(render_allocation(allocation, file, settings))
    log(f"wrote {path}")
    sys.exit(int(must_pass and not allocation.shown))
