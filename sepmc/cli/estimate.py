"""`sepmc estimate`: estimate the dispersed parameters of a file from telemetry."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from sepmc.cli.options import (
    FILE,
    NO_PLOTS,
    OUT,
    OVERWRITE,
    QUIET,
    SEED,
    SETTINGS,
    THREADS,
    load_campaign,
)

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.scene.messages import Log


@click.command(short_help="Estimate the dispersed parameters of FILE from telemetry.")
@FILE
@click.option(
    "--cases",
    type=int,
    default=1000,
    show_default=True,
    help="Number of cases of the posterior sample, which are also run.",
)
@SEED
@SETTINGS
@THREADS
@OUT
@NO_PLOTS
@OVERWRITE
@QUIET
def estimate(
    file: str,
    cases: int,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Estimate the dispersed parameters of FILE from its [[measurement]] tables, and run the cases
    of the estimate into a run folder.

    The distributions of FILE are what is known before the flight (the prior). The posterior is a
    sample of inputs, samples.parquet in the run folder; with --samples it can be run in any other
    campaign that has these parameters. A check says whether FILE explains the measurements at all;
    if not, the exit code is 1.

    \b
    Example:
      sepmc estimate flight.toml --out runs/after-flight
    """
    from sepmc.campaign.estimation import estimate as estimate_parameters
    from sepmc.campaign.store import folders
    from sepmc.cli.estimate_results import (
        count_sweeps,
        render_estimation,
        write_estimation,
        write_samples,
    )
    from sepmc.cli.render import logger, show, warn

    campaign = load_campaign(file, settings)
    folder = out or folders.next_folder(campaign.name)
    log = logger(quiet)
    folders.check_folder(folder, overwrite)
    with folders.opened(folder, resume=True):  # a run in it stays until it can be replaced
        estimation = estimate_parameters(
            campaign, cases, seed, threads, log, None if quiet else count_sweeps(log)
        )
        with TemporaryDirectory() as temporary:
            table = write_samples(estimation, campaign, Path(temporary) / folders.SAMPLES)
            folders.clear(folder)
            _run(campaign, table, threads, folder, log)
        written = write_estimation(estimation, folder, figure=not no_plots)
    if not quiet:
        show(render_estimation(estimation, folder))
    warn(*estimation.notes)
    log(f"wrote {folder}: " + ", ".join(path.name for path in written))
    sys.exit(int(estimation.check.is_short))


def _run(campaign: "Campaign", table: Path, threads: int | None, folder: Path, log: "Log") -> None:
    """Run the cases of a posterior sample, the ``table`` for ``run.samples``, into a folder, and
    log their verdicts on the requirements."""
    from sepmc.analysis.requirements_text import render_verdicts
    from sepmc.campaign.run_options import RunOptions
    from sepmc.cli.render import screen_width

    posterior = campaign.with_settings({"run.samples": str(table)})
    result = posterior.run(threads=threads, out=folder, options=RunOptions(announce=log))
    run = result.written
    assert run is not None
    units = {column.name: column.unit for column in campaign.outcome_columns}
    if run.verdicts:
        log(render_verdicts(run.verdicts, units, screen_width()))
