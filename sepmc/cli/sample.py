"""`sepmc sample`: write the sampled inputs of the cases of a campaign as a table."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from sepmc.cli.options import (
    CASES,
    FILE,
    SAMPLER,
    SEED,
    SETTINGS,
    check_out_file,
    load_campaign,
    out_file_option,
    overwrite_option,
)
from sepmc.wording import count_cases

if TYPE_CHECKING:
    from sepmc.campaign.case_selection import CaseSelection


@click.command(short_help="Write the table of inputs of FILE's cases.")
@FILE
@CASES
@SEED
@SAMPLER
@SETTINGS
@out_file_option("NAME.parquet", "CSV or Parquet")
@overwrite_option("the table in --out")
def sample(
    file: str,
    cases: "int | CaseSelection | None",
    seed: int | None,
    sampler: str | None,
    settings: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
) -> None:
    """Write the sampled inputs of FILE's cases as a table, NAME.parquet by default, one row per
    case: columns case and in_..., in the units of the file. sepmc campaign FILE --samples TABLE
    runs exactly these cases. A table from another program can give any of the inputs of
    [dispersion] in the same way.

    \b
    Example:
      sepmc sample table2.toml --cases 500 --sampler lhs --out samples.csv
    """
    import numpy as np
    import pandas as pd

    from sepmc.campaign.store import folders, shards
    from sepmc.scene.limits import PLAN_NUMBERS
    from sepmc.scene.messages import InputError
    from sepmc.schema import Column

    campaign = load_campaign(file, settings, sampler=sampler)
    path = out or Path(f"{campaign.name}.parquet")
    check_out_file(path, (".csv", ".parquet"), overwrite)
    selection, total = campaign.select_cases(cases)
    inputs = campaign.input_columns
    if selection.count * len(inputs) > PLAN_NUMBERS:
        raise InputError(
            f"cases = {selection.count:,}: a table of {len(inputs)} inputs can have at most "
            f"{PLAN_NUMBERS // len(inputs):,} cases"
        )
    ranges = selection.ranges
    samples = np.concatenate([campaign.sample(a, b - a, seed, total) for a, b in ranges])
    table = pd.DataFrame({"case": np.concatenate([np.arange(a, b) for a, b in ranges])})
    for i, column in enumerate(inputs):
        table[column.name] = samples[:, i]
    if path.suffix.lower() == ".csv":
        folders.write_text(path, table.to_csv(index=False))
    else:
        columns = [Column("case", "1", "number of the case"), *inputs]
        shards.write_parquet(path, columns, {c.name: table[c.name].to_numpy() for c in columns})
    click.echo(f"wrote {path}: {count_cases(len(table))}, {len(inputs)} inputs")
