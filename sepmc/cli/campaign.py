"""`sepmc campaign`: run the dispersed cases of a file into a run folder."""

import sys
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepmc.cli.dry_run import show_forecast
from sepmc.cli.exits import stopped
from sepmc.cli.figures import draw_figures, drawing_process
from sepmc.cli.options import (
    CASES,
    CHECK,
    FILE,
    NO_PLOTS,
    OUT,
    OVERWRITE,
    QUIET,
    SAMPLER,
    SEED,
    SETTINGS,
    THREADS,
    check_required,
    load_campaign,
    redundant,
    undispersed,
)
from sepmc.cli.progress import progress_bar
from sepmc.cli.rare import RARE, estimate_rare_event
from sepmc.cli.render import logger, render_timing, warn
from sepmc.cli.results import exit_code, show_results
from sepmc.paths import EXTRA

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign
    from sepmc.campaign.case_selection import CaseSelection
    from sepmc.campaign.result import Result
    from sepmc.campaign.run_options import RunOptions
    from sepmc.cluster import DaskExecutor


@click.command(short_help="Run the dispersed cases of FILE into a run folder.")
@FILE
@CASES
@SEED
@SAMPLER
@click.option(
    "--samples",
    type=click.Path(path_type=Path),
    help="Table of inputs, CSV or Parquet, one row per case, as written by sepmc sample.",
)
@OUT
@THREADS
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Number of worker processes on this machine, by Dask (extra cluster).",
)
@click.option(
    "--cluster",
    metavar="tcp://HOST:PORT",
    help="Address of a Dask scheduler whose workers run the cases; every worker must see --out "
    "under the same path.",
)
@SETTINGS
@NO_PLOTS
@OVERWRITE
@click.option("--resume", is_flag=True, help="Run only the cases missing in --out.")
@click.option(
    "--stats-only",
    is_flag=True,
    help="Store statistics and histograms, no case rows: memory and disk do not grow with cases.",
)
@click.option(
    "--keep",
    metavar="RULE,...",
    help="As --stats-only, but store the rows of some cases: failed, violating, worst:20 (of each "
    "requirement), every:1000, or all.",
)
@click.option(
    "--keep-columns",
    metavar="PATTERN,...",
    help="Columns to store of the rows that --keep selects, besides case, status and kept_as: "
    "'in_*,upper_*'.",
)
@click.option(
    "--float32", is_flag=True, help="Store the rows that --keep selects in single precision."
)
@click.option(
    "--until",
    metavar="METRIC:TOLERANCE",
    help="Stop as soon as the half width of the 95 % interval of METRIC is at most TOLERANCE. "
    "METRIC is a mean (separation_speed_m_s:0.01), .sigma, a percentile (upper_pitch_deg.p99:1%), "
    "or the fraction of a status (never-released:0.001). Checked when the number of cases has "
    "doubled; a mean or sigma waits until every value of a discrete distribution was sampled ten "
    "times. --resume continues the same rule; excludes --workers, lhs and saltelli.",
)
@click.option(
    "--max-failures",
    type=click.IntRange(min=0),
    metavar="N",
    help="Stop after more than N cases failed, with exit code 1.",
)
@click.option("--fail-fast", is_flag=True, help="Short for --max-failures 0.")
@RARE
@click.option("--dry-run", is_flag=True, help="Show what would be run, and run nothing.")
@CHECK
@QUIET
def campaign(
    file: str,
    cases: "int | CaseSelection | None",
    seed: int | None,
    sampler: str | None,
    samples: Path | None,
    out: Path | None,
    threads: int | None,
    workers: int | None,
    cluster: str | None,
    settings: tuple[str, ...],
    no_plots: bool,
    fail_fast: bool,
    rare: str | None,
    dry_run: bool,
    must_pass: bool,
    quiet: bool,
    **fields: Any,
) -> None:
    """Run the dispersed cases of FILE (a path, a run folder, or a shipped campaign) into a run
    folder.

    With --stats-only the folder contains statistics, histograms, audit and counts, but no cases/
    and no histories/, for millions of cases. Percentiles are then exact for fewer than 65,536
    cases, else those of a fine grid of bins, within 0.41 % of sigma.

    \b
    Examples:
      sepmc campaign table2.toml --cases 1e5 --seed 7 --out runs/seven
      sepmc campaign srb.toml --set motor.bsm.thrust_N=9e4 --check  # exit code by verdicts
      sepmc campaign residual-thrust.toml --rare no_recontact
    """
    resume, overwrite = fields["resume"], fields["overwrite"]
    if (resume or overwrite) and out is None:
        raise click.UsageError(
            f"--{'resume' if resume else 'overwrite'} needs --out, the run folder to use"
        )
    if workers is not None and cluster is not None:
        raise click.UsageError(
            "--workers and --cluster exclude each other: --workers starts processes on this "
            "machine, --cluster uses those of a Dask scheduler"
        )
    if resume and overwrite:
        raise click.UsageError("--resume and --overwrite exclude each other")
    if rare is not None:
        sys.exit(estimate_rare_event(rare, click.get_current_context().params))
    log = logger(quiet)
    with drawing_process(not (no_plots or dry_run)) as second:
        loaded = load_campaign(file, settings, sampler=sampler, samples=samples, verify=not resume)
        check_required(loaded, must_pass)
        from sepmc.campaign.execution.previous_run import own_cases
        from sepmc.campaign.run_options import RunOptions
        from sepmc.campaign.store import folders, manifests
        from sepmc.engine.dispatch import check_threads

        check_threads(threads)
        folder = out or folders.next_folder(loaded.name)
        if resume and cases is None:
            cases = own_cases(loaded, folder)
        if fail_fast:
            fields["max_failures"] = 0
        options = RunOptions(**fields, announce=log)
        if dry_run:
            folders.check_folder(folder, overwrite, resume)
            if options.until:
                loaded.until(options.until, loaded.select_cases(cases)[0])
                click.echo(f"stops early, as soon as {options.until} is reached; at most:")
            counts = options.stats_only or bool(options.keep)
            changed = [*settings, *([f"run.samples={samples}"] if samples else [])]
            command = ["sepmc", "compile", file, *(w for one in changed for w in ("--set", one))]
            command += ["--stats-only"] if counts else []
            show_forecast(loaded, cases, seed, folder, counts, command)
            return
        with folders.opened(folder, overwrite, resume):
            with _executor(workers, cluster, threads) as executor:
                options = replace(options, executor=executor)
                result = _run(loaded, cases, seed, threads, folder, options, quiet)
            warn(*result.notes, *redundant(loaded), *undispersed(loaded))
            log(render_timing(result))
            run = result.written
            assert run is not None
            show_results(loaded, run, log)
            if not no_plots:
                figures = draw_figures(
                    folder, loaded, run.summary, run.table, run.verdicts, log=log, second=second
                )
                manifests.record_derived(folder, figures)
            log(f"wrote {folder}")
            code = exit_code(run, must_pass)
    sys.exit(code or int(result.stopped))


def _run(
    campaign: "Campaign",
    cases: "int | CaseSelection | None",
    seed: int | None,
    threads: int | None,
    folder: Path,
    options: "RunOptions",
    quiet: bool,
) -> "Result":
    """Run a campaign into a folder with a progress bar (none if ``quiet``), and return the result.
    If it is interrupted, print the command that resumes the run, and exit.

    ``cases``, ``seed`` and ``threads`` are those of `Campaign.run`; the ``progress`` of ``options``
    is replaced.
    """
    from sepmc.campaign.store import folders

    selection, _ = campaign.select_cases(cases)
    with progress_bar(selection.count, quiet) as progress:
        try:
            return campaign.run(
                cases, seed, threads, folder, options=replace(options, progress=progress)
            )
        except KeyboardInterrupt as error:
            word, code = stopped(error)
            default = selection == campaign.numbers or selection.are_first
            which = "" if default else f" --cases {selection}"
            state = (
                f"finished cases are stored. Continue with: sepmc campaign {folder} --out {folder} "
                f"--resume{which}"
            )
            if not (folder / folders.MANIFEST).is_file():
                state = "no case was run yet"
            click.echo(f"\n{word}; {state}", err=True)
            sys.exit(code)


def _executor(
    workers: int | None, address: str | None, threads: int | None
) -> "AbstractContextManager[DaskExecutor | None]":
    """Return a context manager that starts ``workers`` processes, or connects to the Dask scheduler
    at ``address``, and yields their executor; it yields None if neither is given. Raises InputError
    if Dask is not installed."""
    if workers is None and address is None:
        return nullcontext()
    from sepmc.scene.messages import InputError

    try:
        from sepmc.cluster import dask_executor
    except ImportError:
        raise InputError(
            f"--workers and --cluster need Dask, the extra cluster: {EXTRA.format('cluster')}"
        ) from None
    return dask_executor(workers, address, threads)
