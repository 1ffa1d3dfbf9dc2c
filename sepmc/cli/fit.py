"""`sepmc fit`: fit distributions to the outcomes of a run."""

from pathlib import Path

import click

from sepmc.cli.figures import ranked_outcomes
from sepmc.cli.options import OUTCOMES, RUN, load_run
from sepmc.cli.render import screen_width, show
from sepmc.cli.results import check_rows

_SHOWN = 12  # outcomes on the screen unless some are named


@click.command(short_help="Fit distributions to the outcomes of RUN, and test for normality.")
@RUN
@OUTCOMES
def fit(folder: Path, outcomes: tuple[str, ...]) -> None:
    """Fit distributions to each OUTCOME of RUN, by default to the most important ones: skewness and
    kurtosis (each with its standard error for a normal distribution), a test for normality, the
    nearest of six distributions, and its 99.865 % point beside that of the cases. Writes
    distributions.csv, with all outcomes but those that are yes or no, into RUN.

    \b
    Example:
      sepmc fit runs/windy separation_speed_m_s
    """
    check_rows(folder)
    from sepmc.analysis import constant_outcomes, distributions
    from sepmc.campaign import run_statistics
    from sepmc.campaign.store import folders, manifests, shards
    from sepmc.cli.input_sensitivity import check_outcomes
    from sepmc.schema import is_yes_or_no

    campaign = load_run(folder)
    check_outcomes(campaign, outcomes)
    table = run_statistics.read_run(folder, campaign).table
    names = [str(name) for name in table.index if not is_yes_or_no(str(name))]
    for name in outcomes:
        if name not in names:
            raise folders.StoreError(
                f"{name}: is yes or no, so it has no distribution to fit; give another outcome"
            )
    constants = [name for name in names if constant_outcomes.is_constant(table, name)]
    fits = distributions.fit_distributions(shards.CaseColumns(folder), names, constants)
    shown = list(outcomes) or ranked_outcomes(campaign, table)[:_SHOWN]
    units = {column.name: column.unit for column in campaign.outcome_columns}
    sampler = campaign.scene.run.sampler
    show(distributions.render_fits(fits.loc[shown], table, units, screen_width(), sampler))
    path = folder / "distributions.csv"
    folders.write_text(path, fits.to_csv())
    manifests.record_derived(folder, [path])
    click.echo(path)
