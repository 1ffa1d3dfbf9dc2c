"""Commands that fly cases. Nothing heavy is imported until a command needs it."""

import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli.figures import drawing_beside
from sepmc.cli.options import (
    CASES,
    CHECK,
    EVERY,
    FILE,
    NO_PLOTS,
    OUT,
    OVERWRITE,
    QUIET,
    RUN,
    SAMPLER,
    SEED,
    SETTINGS,
    check_required,
    load_campaign,
    redundant,
    undispersed,
)
from sepmc.cli.rare import RARE, tell_rare
from sepmc.cli.render import (
    manifest_with_rows,
    plain_errors,
    progress_bar,
    speaker,
    stopped,
    tell_results,
    timing_line,
)
from sepmc.paths import EXTRA

if TYPE_CHECKING:
    from sepmc.campaign.case_selection import CaseSelection
    from sepmc.cluster import DaskExecutor


@click.command(short_help="Fly the dispersed cases of FILE into a run folder.")
@FILE
@CASES
@SEED
@SAMPLER
@click.option(
    "--plan",
    type=click.Path(path_type=Path),
    help="Table of inputs, CSV or Parquet, a row for each case, as sepmc sample writes it.",
)
@OUT
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Threads; default all cores. The result does not depend on it.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Fly in so many processes of this machine, by Dask (extra cluster).",
)
@click.option(
    "--cluster",
    metavar="tcp://HOST:PORT",
    help="Fly on the workers of a Dask scheduler, who all see --out under the same path.",
)
@SETTINGS
@NO_PLOTS
@OVERWRITE
@click.option("--resume", is_flag=True, help="Fly only the cases missing in --out.")
@click.option(
    "--stats-only",
    is_flag=True,
    help="Keep statistics and histograms, no case rows: memory and disk do not grow with cases.",
)
@click.option(
    "--keep",
    metavar="RULE,...",
    help="As --stats-only, but keep rows that failed, are violating, the worst:20 of each "
    "requirement, every:1000, or all, in the folder kept of --out.",
)
@click.option(
    "--keep-columns", metavar="PATTERN,...", help="Of these rows keep such columns: 'in_*,upper_*'."
)
@click.option("--float32", is_flag=True, help="Keep their numbers in single precision.")
@click.option(
    "--until",
    metavar="METRIC:TOLERANCE",
    help="Fly no more cases than it takes for both ends of the 95 % interval of METRIC to be that "
    "near: of a mean (separation_speed_m_s:0.01), .sigma, a percentile (upper_pitch_deg.p99:1%), "
    "or the share of a status (never-released:0.001). Looks when cases have doubled; a mean or a "
    "sigma waits until every value that FILE gives a probability was drawn ten times. With "
    "--resume goes on as if it had not stopped; excludes --workers, lhs and saltelli.",
)
@click.option(
    "--max-failures",
    type=click.IntRange(min=0),
    metavar="N",
    help="Stop once more than N cases did not come to their end; the exit code is then 1.",
)
@click.option("--fail-fast", is_flag=True, help="Short for --max-failures 0.")
@RARE
@click.option("--dry-run", is_flag=True, help="Say what would be flown, and fly nothing.")
@CHECK
@QUIET
def campaign(
    file: str,
    cases: "int | CaseSelection | None",
    seed: int | None,
    sampler: str | None,
    plan: Path | None,
    out: Path | None,
    threads: int | None,
    workers: int | None,
    cluster: str | None,
    settings: tuple[str, ...],
    no_plots: bool,
    overwrite: bool,
    resume: bool,
    stats_only: bool,
    keep: str | None,
    keep_columns: str | None,
    float32: bool,
    until: str | None,
    max_failures: int | None,
    fail_fast: bool,
    rare: str | None,
    dry_run: bool,
    must_pass: bool,
    quiet: bool,
) -> None:
    """Fly the dispersed cases of FILE (a path, a run folder, or a shipped campaign) into a run
    folder.

    With --stats-only the folder holds statistics, histograms, audit and counts, but no cases/ and
    no histories/: for millions of cases. Percentiles are then those of a fine grid of bins, exact
    up to 65,536 cases and within 0.41 % of sigma beyond.

    \b
    Examples:
      sepmc campaign table2.toml --cases 1e5 --seed 7 --out runs/seven
      sepmc campaign srb.toml --set motor.bsm.thrust_N=9e4 --check
      sepmc campaign residual-thrust.toml --rare no_recontact
    """
    say = speaker(quiet)
    with plain_errors(quiet), drawing_beside(not (no_plots or dry_run or rare)) as second:
        if (resume or overwrite) and out is None:
            raise click.UsageError(
                f"--{'resume' if resume else 'overwrite'} needs --out, the run folder meant"
            )
        if workers and cluster:
            raise click.UsageError("--workers are of this machine; --cluster has its own")
        if resume and overwrite:
            raise click.UsageError("--resume and --overwrite exclude each other")
        if rare is not None:
            sys.exit(tell_rare(rare, click.get_current_context().params))
        loaded = load_campaign(file, settings, sampler=sampler, plan=plan, verify=not resume)
        check_required(loaded, must_pass)
        from sepmc.campaign.execution.previous_run import own_cases
        from sepmc.campaign.store import folders
        from sepmc.engine.dispatch import check_threads

        check_threads(threads)
        folder = out or folders.next_folder(loaded.name)
        if resume and cases is None:
            cases = own_cases(loaded, folder)
        numbers, _ = loaded.select_cases(cases)
        if dry_run:
            from sepmc.cli.plan import tell_plan

            folders.check_folder(folder, overwrite, resume)
            if until:
                loaded.until(until, numbers)
                click.echo(f"stops as soon as {until} is known, of at most:")
            counts, more = stats_only or bool(keep), [f"run.samples={plan}"] if plan else []
            compiling = ["sepmc", "compile", file]
            compiling += [word for each in (*settings, *more) for word in ("--set", each)]
            compiling += ["--stats-only"] if counts else []
            tell_plan(loaded, cases, seed, folder, counts, compiling, click.echo)
            return
        with folders.opened(folder, overwrite, resume):  # until all is written
            with (
                progress_bar(numbers.count, quiet) as progress,
                _crew(workers, cluster, threads) as crew,
            ):
                try:
                    result = loaded.run(
                        cases,
                        seed,
                        threads,
                        folder,
                        overwrite=overwrite,
                        resume=resume,
                        stats_only=stats_only,
                        keep=keep,
                        keep_columns=keep_columns,
                        float32=float32,
                        until=until,
                        crew=crew,
                        max_failures=0 if fail_fast else max_failures,
                        progress=progress,
                        announce=say,
                    )
                except KeyboardInterrupt as error:
                    word, code = stopped(error)
                    own = numbers == loaded.numbers or numbers.are_first
                    which = "" if own else f" --cases {numbers}"
                    what = (
                        f"finished cases are kept. Go on with: sepmc campaign {folder} --out "
                        f"{folder} --resume{which}"
                    )
                    if not (folder / folders.MANIFEST).is_file():
                        what = "no case was flown yet"
                    click.echo(f"\n{word}; {what}", err=True)
                    sys.exit(code)
            for note in result.notes + redundant(loaded) + undispersed(loaded):
                click.echo(f"warning: {note}", err=True)
            say(timing_line(result))
            code = tell_results(
                folder,
                loaded,
                result.kept.summary,
                say,
                plots=not no_plots,
                check=must_pass,
                second=second,
            )
    sys.exit(code or int(result.stopped))


def _crew(
    workers: int | None, address: str | None, threads: int | None
) -> "AbstractContextManager[DaskExecutor | None]":
    """Workers that are asked for, if there are any."""
    if workers is None and address is None:
        return nullcontext()
    from sepmc.scene.messages import InputError

    try:
        from sepmc.cluster import crew
    except ImportError:
        raise InputError(
            f"--workers and --cluster need Dask, the extra cluster: {EXTRA.format('cluster')}"
        ) from None
    return crew(workers, address, threads)


@click.command(short_help="Write the table of inputs of FILE's cases.")
@FILE
@CASES
@SEED
@SAMPLER
@SETTINGS
@click.option(
    "--out", type=click.Path(path_type=Path), help="CSV or Parquet to write; default NAME.parquet."
)
@click.option("--overwrite", is_flag=True, help="Replace the table in --out.")
def sample(
    file: str,
    cases: "int | CaseSelection | None",
    seed: int | None,
    sampler: str | None,
    settings: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
) -> None:
    """Write the table of inputs of FILE's cases, a row each: columns case and in_..., in the units
    of the file. sepmc campaign FILE --plan TABLE flies exactly these, whoever wrote them; for
    [dispersion] in FILE, a table of an upstream campaign can give any of the inputs.

    \b
    Example:
      sepmc sample table2.toml --cases 500 --sampler lhs --out plan.csv
    """
    with plain_errors(False):
        from sepmc.cli.plan import write_sample
        from sepmc.scene.messages import InputError

        loaded = load_campaign(file, settings, sampler=sampler)
        path = out or Path(f"{loaded.name}.parquet")
        if path.suffix.lower() not in (".csv", ".parquet"):
            raise InputError(f"--out {path}: must end in .csv or .parquet")
        if path.exists() and not overwrite:
            raise InputError(f"{path}: exists; add --overwrite or choose another --out")
        click.echo(f"wrote {path}: {write_sample(loaded, cases, seed, path)}")


@click.command(short_help="Fly one case of FILE and write its time history.")
@FILE
@click.option(
    "--case",
    "number",
    type=click.IntRange(min=0),
    help="Dispersed case to fly; default the nominal.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the case, instead of the file's.")
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
    """Fly one case of FILE and write its time history. Exit code 1 if its status is not ok.

    \b
    Examples:
      sepmc run table1.toml --every-s 0.0005
      sepmc run table2.toml --case 4711
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.cli.single import check_held, tell_single
        from sepmc.paths import as_path

        loaded = load_campaign(file, settings)
        check_held(as_path(file), number, seed, loaded.file.input_table is not None)
        code = tell_single(loaded, number, seed, every_s, out, overwrite, say, not no_plots)
    sys.exit(code)


@click.command(short_help="Fly one case of RUN again, and see whether its row is the same.")
@RUN
@click.option("--case", "number", type=click.IntRange(min=0), help="The case of this number.")
@click.option("--worst", metavar="REQUIREMENT", help="The worst case of a requirement.")
@click.option("--least", metavar="OUTCOME", help="The case of least OUTCOME.")
@click.option("--greatest", metavar="OUTCOME", help="The case of greatest OUTCOME.")
@click.option(
    "--nearest",
    metavar="OUTCOME:AT",
    help="The case nearest to a percentile (p99.73), the mean or a value of OUTCOME.",
)
@EVERY
@OUT
@click.option(
    "--film",
    type=click.Choice(("gif", "mp4")),
    help="A moving drawing too, film.gif or, with ffmpeg, film.mp4 (half a minute).",
)
@NO_PLOTS
@OVERWRITE
@QUIET
def replay(
    folder: Path,
    number: int | None,
    worst: str | None,
    least: str | None,
    greatest: str | None,
    nearest: str | None,
    every_s: float,
    out: Path | None,
    film: str | None,
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Fly one case of RUN again with its time history. Its row is flown again too, by the compiled
    kernel of the campaign, and compared bit by bit. Figures show the nominal case behind it. Exit
    code 1 if its status is not ok, or its row differs.

    \b
    Examples:
      sepmc replay runs/windy --worst no_recontact --film gif
      sepmc replay runs/windy --nearest separation_speed_m_s:p99.73
    """
    say = speaker(quiet)
    with plain_errors(quiet):
        from sepmc.cli.single import check_held, chosen, tell_single

        manifest_with_rows(folder)
        ways = {"worst": worst, "least": least, "greatest": greatest, "nearest": nearest}
        given = {way: asked for way, asked in ways.items() if asked}
        if len(given) + (number is not None) != 1:
            raise click.UsageError("give one of --case, --worst, --least, --greatest and --nearest")
        loaded = load_campaign(str(folder), (), warn=False)
        for way, asked in given.items():
            number = chosen(folder, loaded, way, asked, say)
        check_held(folder, number, None)
        code = tell_single(
            loaded, number, None, every_s, out, overwrite, say, not no_plots, folder, film
        )
    sys.exit(code)
