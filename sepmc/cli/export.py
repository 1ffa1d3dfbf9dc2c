"""`sepmc export`: write the rows of a run in the formats of other programs."""

from pathlib import Path

import click

from sepmc.cli.options import RUN, check_out_file, load_run, overwrite_option

_FORMATS = ("csv", "mat", "netcdf", "hdf5", "xlsx")


@click.command(short_help="Write the rows of RUN for MATLAB, Excel and other programs.")
@RUN
@click.option(
    "--format", "kind", type=click.Choice(_FORMATS), required=True, help="Format of the file."
)
@click.option(
    "--histories", is_flag=True, help="Write the separations over time, not the case table."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="File to write. Default: the name of RUN, with the ending of the format.",
)
@overwrite_option("the file in --out")
def export(folder: Path, kind: str, histories: bool, out: Path | None, overwrite: bool) -> None:
    """Write the case table of RUN, or the history of the single case in RUN: every column with its
    unit and meaning, the status as text. Without --out the file is in the current folder. MATLAB
    (struct cases or history), netCDF and CSV need nothing else; HDF5 and Excel need the extra
    export.

    \b
    Examples:
      sepmc export runs/windy --format mat
      sepmc export runs/windy --format csv --histories --out separations.csv
    """
    from sepmc.campaign.store import folders, result_files, shards
    from sepmc.campaign.stored_result import open_run
    from sepmc.formats.write_table import ENDINGS, write_table
    from sepmc.schema import Column, history_columns

    path = out or Path(f"{folder.name}{'_histories' if histories else ''}{ENDINGS[kind]}")
    check_out_file(path, (ENDINGS[kind],), overwrite)
    history = result_files.read_history(folder)
    if history is not None:
        known = {c.name: c for c in history_columns(load_run(folder).layout.contents)}
        known["time_s"] = Column("time_s", "s", "time since the start")
        columns = [known.get(key, Column(key, "", "")) for key in map(str, history)]
        values = {column.name: history[column.name].to_numpy() for column in columns}
        write_table(path, kind, columns, values, "history")
        click.echo(f"wrote {path}: {len(history)} rows, {len(columns)} columns")
        return
    result = open_run(folder)
    name, values = "cases", result.table
    if histories:
        table = result.histories()
        if table is None:
            raise folders.StoreError(
                f"{folder}: contains no histories; run it again with run.history_step_s > 0"
            )
        name, values = "histories", {str(key): table[key].to_numpy() for key in table}
    units = shards.units(folder, folders.HISTORIES if histories else folders.CASES)
    meanings = {column.name: column.meaning for column in result.campaign.columns}
    columns = [Column(key, units.get(key, ""), meanings.get(key, "")) for key in values]
    write_table(path, kind, columns, values, name)
    click.echo(f"wrote {path}: {len(next(iter(values.values())))} rows, {len(columns)} columns")
