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


@click.command(short_help="Find the cheapest design of FILE that passes all requirements.")
@FILE
@click.option(
    "--vary",
    "variables",
    metavar="NAME=KEY=LOW:HIGH",
    multiple=True,
    required=True,
    help="Design variable: its name in the cost, its TOML path with unit, its range.",
)
@click.option(
    "--minimise", metavar="FORMULA", required=True, help="Cost, a formula of the variables."
)
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    default=2000,
    show_default=True,
    help="Cases of every design in the search; the verdict takes four times as many.",
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
    minimise: str,
    cases: int,
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

    KEY is a TOML path with its unit; * stands for any name. With --check the command ends with
    code 1 unless the verdict shows every requirement.

    \b
    Example:
      sepmc size rocket.toml --vary 'push=spring.*.force_N=1500:4000' --minimise '2 * push'
    """
    from sepmc.campaign.sizing import parse_variable
    from sepmc.campaign.sizing import size as find_size
    from sepmc.campaign.store import folders
    from sepmc.cli.render import logger, show
    from sepmc.cli.size_results import render_sizing

    parsed = [parse_variable(text) for text in variables]
    campaign = load_campaign(file, settings)
    path = out or Path(f"{campaign.name}-size.csv")
    check_out_file(path, (".csv",), overwrite)
    log = logger(quiet)
    sizing = find_size(campaign, parsed, minimise, cases, seed, threads, log)
    folders.write_text(path, sizing.searched.to_csv(index=False))
    if not quiet:
        show(render_sizing(sizing, minimise, file, settings, campaign.file.tree))
    log(f"wrote {path}")
    sys.exit(int(must_pass and not sizing.shown))
