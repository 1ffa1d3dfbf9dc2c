"""`sepmc map`: verdicts over design variables."""

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


@click.command(name="map", short_help="Judge the requirements of FILE over design variables.")
@FILE
@click.option("--x", "x_axis", metavar=_AXIS, required=True, help="Design variable of the x axis.")
@click.option("--y", "y_axis", metavar=_AXIS, help="Design variable of the y axis.")
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Cases of every design, on common random numbers.",
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
    x_axis: str,
    y_axis: str | None,
    cases: int,
    seed: int | None,
    settings: tuple[str, ...],
    threads: int | None,
    out: Path | None,
    no_plots: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Judge each requirement of FILE at every point of a grid of designs: shown, refuted, or open
    with these cases.

    KEY is a TOML path with its unit; * stands for any name. Cases with one number have the same
    random numbers in every design. The verdict on a design that was chosen by a map needs another
    seed.

    \b
    Example:
      sepmc map rocket.toml --x 'spring.*.force_N=2000:3000:21' \\
        --y motor.retro.thrust_N=1500:2100:13 --cases 500
    """
    from sepmc.campaign.design_map import map_designs, parse_axis
    from sepmc.cli.map_results import figure_paths, render_map, write_figures, write_table
    from sepmc.cli.progress import progress_bar
    from sepmc.cli.render import logger, show

    axes = [parse_axis(x_axis, "--x")] + ([parse_axis(y_axis, "--y")] if y_axis else [])
    campaign = load_campaign(file, settings)
    path = out or Path(f"{campaign.name}-map.parquet")
    check_out_file(path, (".csv", ".parquet"), overwrite)
    for image in [] if no_plots else figure_paths(campaign, path):
        check_out_file(image, (".png",), overwrite)
    log, total = logger(quiet), cases
    for axis in axes:
        total *= axis.count
    with progress_bar(total, quiet) as report:

        def progress(done: int, n_designs: int) -> None:
            if report:
                report(done * cases, n_designs * cases, 0)

        if report:
            report(0, total, 0)
        designs = map_designs(campaign, axes, cases, seed, threads, progress, log)
    written = [write_table(designs, campaign, path)]
    if not no_plots:
        written += write_figures(designs, campaign, path)
    if not quiet:
        show(render_map(designs, campaign))
    log("wrote " + ", ".join(map(str, written)))
