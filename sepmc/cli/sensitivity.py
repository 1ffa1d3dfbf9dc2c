"""`sepmc sensitivity`: rank the inputs that drive the outcomes of a run, and its failures."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli.options import NO_PLOTS, OUTCOMES, RUN, load_run
from sepmc.cli.render import screen_width, show
from sepmc.cli.results import check_rows

if TYPE_CHECKING:
    import pandas as pd

_TABLE = "sensitivity.csv"


@click.command(short_help="Rank the inputs that drive the outcomes of RUN, and its failures.")
@RUN
@OUTCOMES
@NO_PLOTS
def sensitivity(folder: Path, outcomes: tuple[str, ...], no_plots: bool) -> None:
    """Rank the inputs that drive each OUTCOME of RUN, or the four most important outcomes:
    first-order indices (total indices too for a Saltelli design), rank and partial rank
    correlation, and the means where the input is lowest and highest. Inputs with a significant
    index come first, with those that shift the mean most. Then attribute violations and failures:
    the inputs, and pairs of inputs, that distinguish the cases that violate a requirement or
    failed. Writes sensitivity.csv (its rows of other outcomes stay), causes.csv, sensitivity.png
    and scatter.png into RUN.

    \b
    Sampler of RUN    first-order index, 95 % interval     total  attribution of failures
      random, table   of neighbours, or of groups          -      by the G-test
      lhs             the same, conservative               -      by the G-test
      sobol           none: its points are patterned       -      none
      saltelli        of the design                        yes    none

    Indices have no intervals where few cases, far from the others, decide the variance of the
    outcome. Inputs that vary together are named, as their indices do not add up.

    \b
    Example:
      sepmc sensitivity runs/windy upper_pitch_deg separation_speed_m_s
    """
    check_rows(folder)
    import pandas as pd

    from sepmc.analysis import failure_attribution
    from sepmc.analysis.sensitivity import index_notes
    from sepmc.campaign import run_statistics
    from sepmc.campaign.store import folders, manifests
    from sepmc.cli.input_sensitivity import analyse, draw_sensitivities

    campaign = load_run(folder)
    run = run_statistics.read_run(folder, campaign)
    drivers = analyse(folder, campaign, run, outcomes)
    for text in [text for texts in drivers.texts(screen_width()) for text in texts]:
        show(text)
    written = [folder / "causes.csv"]
    if drivers.sensitivities:
        noted = {
            name: table.assign(note=" ".join(index_notes(table, drivers.keys)))
            for name, table in drivers.sensitivities.items()
        }
        table = pd.concat(noted, names=["outcome", "input"]).reset_index()
        before = _stored(folder, list(table.columns)) if outcomes else table[:0]
        table = pd.concat([before[~before["outcome"].isin(drivers.sensitivities)], table])
        folders.write_text(folder / _TABLE, table.to_csv(index=False))
        written.insert(0, folder / _TABLE)
    causes = failure_attribution.attribution_table(drivers.attributions)
    folders.write_text(folder / "causes.csv", causes.to_csv(index=False))
    if not no_plots:
        written += draw_sensitivities(drivers, folder, campaign, folder)()
    manifests.record_derived(folder, written)
    for path in written:
        click.echo(path)


def _stored(folder: Path, columns: list[str]) -> "pd.DataFrame":
    """Return the table ``sensitivity.csv`` of a run folder; an empty table with ``columns`` if the
    file is missing, was changed, or has other columns."""
    from contextlib import suppress
    from io import BytesIO

    import pandas as pd

    from sepmc.campaign.store import manifests
    from sepmc.scene.limits import CAMPAIGN_BYTES, read_limited

    if manifests.is_recorded(folder, _TABLE):
        with suppress(ValueError):  # raised by pandas for a file that is no table, too
            table = pd.read_csv(BytesIO(read_limited(folder / _TABLE, CAMPAIGN_BYTES)))
            if list(table.columns) == columns:
                return table
    return pd.DataFrame(columns=pd.Index(columns))
