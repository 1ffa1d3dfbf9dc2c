"""`sepmc map`: judge the requirements of a campaign over one or two design variables."""

import math
from pathlib import Path

import click

from sepmc.cli.options import (
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

_AXIS = "KEY=LOW:HIGH:COUNT"
_CASES = 1000


@click.command(name="map", short_help="Judge the requirements of FILE over design variables.")
@FILE
@click.option(
    "--x",
    "x_axis",
    metavar=_AXIS,
    help="Design variable of the x axis. Default: [map] of the file.",
)
@click.option("--y", "y_axis", metavar=_AXIS, help="Design variable of the y axis.")
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help="Cases of every design, on common random numbers. Default: map.cases of the file, or "
    f"{_CASES}.",
)
@click.option(
    "--max-cases",
    type=click.IntRange(min=1),
    help="Largest number of cases of a design: it is doubled, up to this number, while the verdict "
    "is open. Default: as --cases.",
)
@SEED
@SETTINGS
@THREADS
@out_file_option("NAME-map.parquet, with a figure for each requirement beside it", "CSV or Parquet")
@NO_PLOTS
@overwrite_option("the files of the map in --out")
@QUIET
def map_(
    file: str,
    x_axis: str | None,
    y_axis: str | None,
    cases: int | None,
    max_cases: int | None,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Judge each requirement of FILE at every point of a grid of designs: shown, refuted, or open,
    if the cases show neither. With --max-cases, designs that are open are run with more cases, at a
    confidence that is raised for the number of these looks.

    The verdicts are written as a table, NAME-map.parquet by default, with a figure for each
    requirement beside it.

    KEY is a TOML path with its unit; * stands for any name. An option replaces the key of [map] in
    FILE; --x replaces both axes. Case N has the same random numbers in every design. To judge a
    design that was chosen by a map, run it with another seed.

    \b
    Example:
      sepmc map rocket.toml --x 'spring.*.force_N=2000:3000:21' \\
        --y motor.retro.thrust_N=1500:2100:13 --cases 500
    """
    from sepmc.campaign.design_map import map_designs, parse_axis
    from sepmc.cli.map_results import figure_paths, render_map, write_figures, write_table
    from sepmc.cli.progress import progress_bar
    from sepmc.cli.render import logger, show
    from sepmc.scene.messages import InputError

    first, second = (
        [] if text is None else [parse_axis(text, name)]
        for name, text in (("--x", x_axis), ("--y", y_axis))
    )
    campaign = load_campaign(file, settings)
    plan = campaign.file.map
    if plan is not None:
        cases, max_cases = cases or plan.cases, max_cases or plan.max_cases
        second = second or list([] if first else plan.axes[1:])
        first = first or list(plan.axes[:1])
    if not first:
        raise InputError(f"{campaign.name}: has no [map]: give --x {_AXIS}")
    axes, cases = first + second, cases or _CASES
    path = out or Path(f"{campaign.name}-map.parquet")
    check_out_file(path, (".csv", ".parquet"), overwrite)
    for image in [] if no_plots else figure_paths(campaign, path):
        check_out_file(image, (".png",), overwrite)
    log = logger(quiet)
    with progress_bar(cases * math.prod(axis.count for axis in axes), quiet) as report:

        def progress(done: int, total: int) -> None:
            if report:
                report(done, total, 0)

        designs = map_designs(campaign, axes, cases, seed, threads, progress, log, max_cases)
    written = [write_table(designs, campaign, path)]
    if not no_plots:
        written += write_figures(designs, campaign, path)
    if not quiet:
        show(render_map(designs, campaign))
    log("wrote " + ", ".join(map(str, written)))
