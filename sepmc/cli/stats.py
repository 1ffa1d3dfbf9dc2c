"""`sepmc stats`: compute the statistics of a run again from its files."""

import sys
from pathlib import Path

import click

from sepmc.cli.options import CHECK, RUN, check_required, load_run
from sepmc.cli.render import logger, warn
from sepmc.cli.results import check_rows, exit_code, show_results, show_selected


@click.command(short_help="Compute the statistics of RUN again from its files.")
@RUN
@click.option(
    "--columns",
    metavar="PATTERN,...",
    help="Print only these outcomes: 'upper_*,separation_*'. The files still contain all of them.",
)
@click.option(
    "--where",
    "terms",
    multiple=True,
    metavar="TERM",
    help="Use only the cases that satisfy a condition, such as joint.bolt.fails=1 or "
    "spring.*.fails=1 (any of them), or several with ' or ' between them. If given twice, both "
    "must be satisfied. Writes nothing.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print the content of statistics.json, not tables."
)
@CHECK
def stats(
    folder: Path, columns: str | None, terms: tuple[str, ...], as_json: bool, must_pass: bool
) -> None:
    """Compute the statistics and verdicts of RUN again from its files, print them, and write them
    into RUN. With --where, print those of the cases whose inputs or outcomes satisfy a condition,
    and write nothing.

    \b
    Examples:
      sepmc stats runs/windy --where 'initial.alpha_deg>5'
      sepmc stats runs/windy --columns 'separation_*'
      sepmc stats runs/windy --json | jq .outcomes.separation_speed_m_s.p99
    """
    from sepmc.campaign import run_statistics
    from sepmc.campaign.store import folders, result_files

    if result_files.read_history(folder) is not None:
        raise folders.StoreError(
            f"{folder}: is a single case, which has no statistics; give the folder of a campaign"
        )
    manifest = check_rows(folder)
    campaign = load_run(folder)
    check_required(campaign, must_pass)
    if terms:
        if must_pass:
            raise click.UsageError(
                "--check and --where exclude each other: --check judges all cases of the run"
            )
        show_selected(folder, campaign, terms, columns, as_json)
        return
    summary = run_statistics.read_summary(folder, campaign)
    if not manifest.get("complete", True):
        count = sum(summary.counts.values())
        warn(f"the run is not complete: {count} of {manifest.get('cases')} cases")
    warn(*manifest.get("notes", ()))
    run, log = run_statistics.write(folder, campaign, summary), logger(quiet=as_json)
    show_results(campaign, run, log, columns)
    log(f"wrote {folder}")
    code = exit_code(run, must_pass)
    if as_json:
        click.echo((folder / "statistics.json").read_text(encoding="utf-8"), nl=False)
    sys.exit(code)
