"""`sepmc plot`: draw the figures of a run again, for print."""

from functools import partial
from pathlib import Path

import click

from sepmc.cli.figures import clearance_bounds, draw_figures, event_times
from sepmc.cli.options import RUN, load_run
from sepmc.cli.results import check_rows


@click.command(short_help="Draw the figures of RUN again, for print.")
@RUN
@click.option("--all", "every", is_flag=True, help="Draw a histogram of every outcome, not twelve.")
@click.option(
    "--format",
    "ending",
    type=click.Choice(("png", "svg", "pdf")),
    default="png",
    show_default=True,
    help="Format of the files; PNG at 300 dots per inch.",
)
def plot(folder: Path, every: bool, ending: str) -> None:
    """Draw the figures of RUN again from its files, for print, into RUN. Of a campaign, the
    histograms of twelve outcomes (--all: of every outcome) are drawn together, and each also into a
    file of its own; if RUN has case rows, a figure shows how the means converge. Of a single case,
    its history over time is drawn.

    \b
    Example:
      sepmc plot runs/windy --all --format pdf
    """
    from sepmc.campaign import run_statistics
    from sepmc.campaign.label import of_case
    from sepmc.campaign.store import manifests, result_files
    from sepmc.report.history_figures import run_figures
    from sepmc.report.style import PRINTED, resolution

    history, suffix = result_files.read_history(folder), f".{ending}"
    manifest = manifests.read_manifest(folder)
    with resolution(PRINTED):
        if history is not None:
            written = run_figures(
                history,
                folder,
                manifest["bodies"],
                manifest["joints"],
                of_case(manifest["campaign"], manifest["case"], manifest.get("settings", {})),
                suffix,
                required=clearance_bounds(load_run(folder)),
                marks=event_times(manifest),
            )
        else:
            if not (manifest.get("stats_only") and manifest.get("complete")):
                check_rows(folder)
            campaign = load_run(folder)
            draw = partial(
                draw_figures,
                folder,
                campaign,
                every=every,
                log=partial(click.echo, err=True),
                suffix=suffix,
                separate=True,
            )
            if manifest.get("stats_only"):
                written = draw(result_files.read_stored_statistics(folder))
            else:
                run = run_statistics.read_run(folder, campaign)
                written = draw(run.summary, run.table, run.verdicts, converging=True)
    manifests.record_derived(folder, written)
    for path in written:
        click.echo(path)
