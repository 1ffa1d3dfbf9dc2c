"""`sepmc size`: find the cheapest design that passes all requirements."""

import sys
from pathlib import Path

import click

from sepmc.cli.options import (
    CHECK,
    FILE,
    NO_PLOTS,
    QUIET,
    SEED,
    SETTINGS,
    THREADS,
    check_out_file,
    load_campaign,
    out_file_option,
    overwrite_option,
)

_CASES = 2000


@click.command(short_help="Find the cheapest design of FILE that passes all requirements.")
@FILE
@click.option(
    "--vary",
    "variables",
    metavar="NAME=KEY=LOW:HIGH",
    multiple=True,
    help="Design variable: its name in the cost, its TOML path with unit, its range. Default: "
    "[size] of the file, as for all of these options.",
)
@click.option(
    "--minimise",
    metavar="FORMULA",
    multiple=True,
    help="Cost, a formula of the names of the variables. Give it two or three times for a front of "
    "designs.",
)
@click.option(
    "--subject-to",
    metavar="NAME",
    multiple=True,
    help="Requirement that the design must pass. Default: all of the file.",
)
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help="Cases of every design in the search; the run for the verdict has four times as many. "
    f"Default: {_CASES}.",
)
@SEED
@SETTINGS
@THREADS
@out_file_option("NAME-size.csv, the designs of the search", "CSV")
@click.option(
    "--run",
    "run_folder",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Store the run for the verdict in DIR; sepmc report DIR then shows the sizing too.",
)
@NO_PLOTS
@CHECK
@overwrite_option("the files of the sizing in --out")
@QUIET
def size(
    file: str,
    variables: tuple[str, ...],
    minimise: tuple[str, ...],
    subject_to: tuple[str, ...],
    cases: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    run_folder: Path | None,
    no_plots: bool,
    must_pass: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Find the design with the smallest cost that passes all requirements of FILE, and judge it by
    a run with another seed than that of the search.

    The designs of the search are written as a table, NAME-size.csv by default. With one cost, the
    design, the search and the verdict are recorded in a JSON file of the same name.

    Several costs give a few designs of which none is better than another one in every cost (a
    front), each judged in this way; a table and a figure of them are written beside --out. --run
    then is an error.

    An option replaces the key of [size] in FILE. KEY is a TOML path with its unit; * stands for any
    name. With --check the exit code is 1 unless every verdict is pass.

    \b
    Example:
      sepmc size rocket.toml --vary 'push=spring.*.force_N=1500:4000' --minimise '2 * push' \
          --run sized
      sepmc report sized
    """
    from sepmc.campaign.sizing import parse_variable
    from sepmc.campaign.sizing import size as find_size
    from sepmc.campaign.store import folders, manifests
    from sepmc.campaign.trade_off import trade_off
    from sepmc.cli.render import logger, show, warn
    from sepmc.cli.size_results import (
        render_sizing,
        render_trade_off,
        repeat_command,
        sizing_record,
        write_trade_off,
    )
    from sepmc.scene.messages import InputError

    parsed = tuple(parse_variable(text) for text in variables)
    campaign = load_campaign(file, settings)
    plan = campaign.file.size
    if plan is not None:
        parsed, minimise = parsed or plan.variables, minimise or plan.minimise
        subject_to, cases = subject_to or plan.subject_to, cases or plan.cases
    if not parsed or not minimise:
        raise InputError(f"{campaign.name}: has no [size]: give --vary and --minimise")
    path = out or Path(f"{campaign.name}-size.csv")
    check_out_file(path, (".csv",), overwrite)
    log, cases = logger(quiet), cases or _CASES
    if len(minimise) == 1:
        record = path.with_suffix(".json")
        check_out_file(record, (), overwrite)
        sizing = find_size(
            campaign,
            parsed,
            minimise[0],
            cases,
            seed,
            threads,
            log,
            subject_to,
            run_folder,
            overwrite,
        )
        command = repeat_command(sizing, file, settings, campaign.file.tree)
        content = sizing_record(sizing, campaign, parsed, minimise[0], subject_to, command)
        folders.write_text(path, sizing.searched.to_csv(index=False))
        folders.write_json(record, content)
        warn(*sizing.verdict.notes)
        if not quiet:
            show(render_sizing(sizing, minimise[0], command))
        log(f"wrote {path}, {record}")
        if run_folder is not None:
            folders.write_json(run_folder / folders.SIZING, content)
            manifests.record_derived(run_folder, [run_folder / folders.SIZING])
            log(f"wrote {run_folder}, the run for the verdict")
        sys.exit(int(must_pass and not sizing.shown))
    if run_folder is not None:
        raise InputError("--run: needs a single cost; each design of a front has its own run")
    table, image = (path.with_name(f"{path.stem}-front{end}") for end in (".parquet", ".png"))
    for each in [table] if no_plots else [table, image]:
        check_out_file(each, (), overwrite)
    front = trade_off(campaign, parsed, minimise, cases, seed, threads, log, subject_to)
    folders.write_text(path, front.searched.to_csv(index=False))
    written = [path, write_trade_off(front, campaign, table)]
    if not no_plots:
        from sepmc.report.trade_off_figure import trade_off_figure

        written.append(trade_off_figure(front, campaign.name, image))
    if not quiet:
        show(render_trade_off(front, parsed))
    log("wrote " + ", ".join(map(str, written)))
    sys.exit(int(must_pass and not front.shown))
