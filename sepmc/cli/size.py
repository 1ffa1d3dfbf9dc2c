"""`sepmc size`: the cheapest design that passes."""

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
@click.option("--minimise", metavar="FORMULA", help="Cost, a formula of the variables.")
@click.option(
    "--subject-to",
    metavar="NAME",
    multiple=True,
    help="Requirement that the design must pass. Default: all of the file.",
)
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help="Cases of every design in the search; the verdict takes four times as many. Default: "
    f"{_CASES}.",
)
@SEED
@SETTINGS
@THREADS
@out_file_option("NAME-size.csv, the designs of the search", "CSV")
@CHECK
@overwrite_option("the file in --out")
@QUIET
def size(
    file: str,
    variables: tuple[str, ...],
    minimise: str | None,
    subject_to: tuple[str, ...],
    cases: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    must_pass: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Find the design with the smallest cost that passes all requirements of FILE, and judge it by
    a run with another seed than that of the search.

    An option replaces the key of [size] in FILE. KEY is a TOML path with its unit; * stands for any
    name. With --check the command ends with code 1 unless the verdict shows every requirement.

    \b
    Example:
      sepmc size rocket.toml --vary 'push=spring.*.force_N=1500:4000' --minimise '2 * push'
    """
    from sepmc.campaign.sizing import parse_variable
    from sepmc.campaign.sizing import size as find_size
    from sepmc.campaign.store import folders
    from sepmc.cli.render import logger, show
    from sepmc.cli.size_results import render_sizing
    from sepmc.scene.messages import InputError

    parsed = tuple(parse_variable(text) for text in variables)
    campaign = load_campaign(file, settings)
    plan = campaign.file.size
    if plan is not None:
        parsed, minimise = parsed or plan.variables, minimise or plan.minimise[0]
        subject_to, cases = subject_to or plan.subject_to, cases or plan.cases
    if not parsed or not minimise:
        raise InputError(f"{campaign.name}: has no [size]: give --vary and --minimise")
    path = out or Path(f"{campaign.name}-size.csv")
    check_out_file(path, (".csv",), overwrite)
    log = logger(quiet)
    sizing = find_size(campaign, parsed, minimise, cases or _CASES, seed, threads, log, subject_to)
    folders.write_text(path, sizing.searched.to_csv(index=False))
    if not quiet:
        show(render_sizing(sizing, minimise, file, settings, campaign.file.tree))
    log(f"wrote {path}")
    sys.exit(int(must_pass and not sizing.shown))
