"""`sepmc bench`: measure speed and accuracy of a file on this machine."""

from pathlib import Path

import click

from sepmc.cli.options import FILE, QUIET, SETTINGS, THREADS, load_campaign, overwrite_option
from sepmc.cli.render import logger


@click.command(short_help="Measure speed and accuracy of FILE on this machine.")
@FILE
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder to write. Default: runs/bench-NAME-N."
)
@click.option(
    "--cases",
    type=click.IntRange(min=1, max=10**7),
    help="Number of timed cases. Default: 10000, with --quick 1000.",
)
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    help="Repeats of each timing, of which the median is taken. Default: 7, with --quick 3.",
)
@THREADS
@click.option(
    "--quick",
    is_flag=True,
    help="Measure fewer settings, and nothing that takes minutes: a rough look.",
)
@overwrite_option("the bench in --out")
@SETTINGS
@QUIET
def bench(
    file: str,
    out: Path | None,
    cases: int | None,
    repeats: int | None,
    threads: int | None,
    quick: bool,
    overwrite: bool,
    settings: tuple[str, ...],
    quiet: bool,
) -> None:
    """Measure speed and accuracy of FILE on this machine: error over run time, cost of each
    feature, scaling with threads, and time by stage.

    Errors are relative to a reference at very many steps. Tables go to the screen and as Parquet,
    with bench.json and figures, into a folder. It takes 4 to 10 minutes on two cores, a minute or
    two with --quick.

    \b
    Example:
      sepmc bench table2.toml --quick
    """
    if overwrite and out is None:
        raise click.UsageError("--overwrite needs --out, the folder to replace")
    campaign = load_campaign(file, settings)
    from sepmc.bench.bench import bench as measure
    from sepmc.campaign.store import folders

    folder, log = out or folders.next_folder(f"bench-{campaign.name}"), logger(quiet)
    measure(
        campaign,
        folder,
        log,
        cases=cases,
        repeats=repeats,
        threads=threads,
        quick=quick,
        overwrite=overwrite,
    )
    log(f"wrote {folder}")
