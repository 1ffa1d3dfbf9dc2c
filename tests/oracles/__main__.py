"""Commands that compare the engine with oracles: ``python tests/oracles``.

Exit codes are those of `sepmc`: 1 if anything differs.
"""

import sys
from pathlib import Path

if __name__ == "__main__":  # so that `oracles` is imported as a package
    sys.path[0] = str(Path(__file__).parents[1])

import click

from sepmc.cli.exits import Program
from sepmc.cli.options import OVERWRITE, QUIET, SETTINGS, load_campaign
from sepmc.cli.render import logger


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Compare the engine with an independent simulation and with other engines."""


@main.command()
@click.argument("count", type=click.IntRange(min=1))
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the first scene.",
)
@click.option(
    "--compiled",
    type=click.IntRange(min=0),
    default=0,
    help="Number of scenes that also run compiled.",
)
@click.option(
    "--rows",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    help="Compared cases of every scene.",
)
@click.option(
    "--limit",
    "limit_s",
    type=click.FloatRange(min=0, min_open=True),
    default=60.0,
    show_default=True,
    help="Time for a scene, s; after it the scene is compiled, with at least 600 s.",
)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    metavar="KIND",
    help="Feature of every scene, such as direction, ignition or optional; can be repeated.",
)
@QUIET
def random(
    count: int,
    seed: int,
    compiled: int,
    rows: int,
    limit_s: float,
    kinds: tuple[str, ...],
    quiet: bool,
) -> None:
    """Compare COUNT random scenes, case by case, with independent simulations.

    \b
    Examples:
      python tests/oracles random 30 --seed 7
      python tests/oracles random 30 --kind direction --kind ignition
    """
    from oracles.random_scenes import run

    verdicts = run.judge_scenes(count, seed, compiled, logger(quiet), rows, limit_s, kinds)
    click.echo(run.table(verdicts))
    sys.exit(1 if any(map(run.fails, verdicts)) else 0)


@main.command()
@QUIET
def shipped(quiet: bool) -> None:
    """Compare shipped campaigns and the scenes of `sepmc verify` with independent simulations."""
    from oracles import shipped_campaigns
    from sepmc.validation.line import table

    log = logger(quiet)
    lines = []
    for check in (shipped_campaigns.scenes, shipped_campaigns.campaigns):
        log(f"{check.__name__} ...")
        lines += check()
    click.echo(table(lines))
    sys.exit(0 if all(line.passes for line in lines) else 1)


@main.command()
@QUIET
def engines(quiet: bool) -> None:
    """Compare cases of shipped campaigns with other engines; needs pip install '.[peers]'."""
    from oracles.external_engines import compare

    installed = compare.needed(logger(quiet))
    text, agreed = compare.report(logger(quiet), engines=installed)
    click.echo(text)
    sys.exit(0 if agreed else 1)


@main.command()
@click.argument("file")
@click.option(
    "--out", type=click.Path(path_type=Path), help="New folder; runs/bench-NAME-N by default."
)
@click.option("--quick", is_flag=True, help="One or two minutes instead of ten.")
@OVERWRITE
@SETTINGS
@QUIET
def race(
    file: str,
    out: Path | None,
    quick: bool,
    overwrite: bool,
    settings: tuple[str, ...],
    quiet: bool,
) -> None:
    """Run `sepmc bench` of FILE with other engines on the same cases."""
    from oracles.engine_race import tables
    from oracles.engine_race.inputs import check
    from oracles.engine_race.race import left_out
    from sepmc.bench.bench import bench
    from sepmc.campaign.store import folders

    if overwrite and out is None:
        raise click.UsageError("--overwrite needs --out, the folder meant")
    log, campaign = logger(quiet), load_campaign(file, settings)
    check(campaign.scene)
    for sentence in left_out(tables.QUICK if quick else None):
        log(sentence)
    folder = out or folders.next_folder(f"bench-{campaign.name}")
    bench(campaign, folder, log, quick=quick, peers=tables.measure, overwrite=overwrite)
    log(f"wrote {folder}")


if __name__ == "__main__":
    main()
