"""Writing of result tables in formats of other programs: CSV, MATLAB, netCDF, HDF5, Excel."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.paths import EXTRA
from sepmc.scene.messages import InputError
from sepmc.schema import Column

ENDINGS = {"csv": ".csv", "mat": ".mat", "netcdf": ".nc", "hdf5": ".h5", "xlsx": ".xlsx"}
_MATLAB_NAME = 63  # letters of a name in MATLAB
_EXCEL_ROWS = 1_048_575
_PACKAGES = {"hdf5": "h5py", "xlsx": "openpyxl"}  # of the extra `export`

Array = np.ndarray


def write_table(
    path: Path, kind: str, columns: Sequence[Column], values: Mapping[str, Array], name: str
) -> None:
    """Write a table to a file, with the units and meanings of its columns where the format has room
    for them (all but CSV).

    Parameters
    ----------
    path : Path
    kind : {"csv", "mat", "netcdf", "hdf5", "xlsx"}
    columns : sequence of Column
        Name, unit and meaning of each column to write.
    values : mapping of str to ndarray (n,)
        Values of the columns by name; numbers are written to the last bit.
    name : str
        Name of the table: of a struct in MATLAB, a group in HDF5, a sheet in Excel.

    Raises
    ------
    InputError
        If the package of the format is not installed, or the table is too long for it.
    """
    if kind in _PACKAGES:
        try:
            import_module(_PACKAGES[kind])
        except ImportError:
            raise InputError(
                f"format = {kind!r}: needs {_PACKAGES[kind]}, of the extra export "
                f"({EXTRA.format('export')})"
            ) from None
    table = {column.name: _plain(values[column.name]) for column in columns}
    writer = {
        "csv": _write_csv,
        "mat": _write_mat,
        "netcdf": _write_netcdf,
        "hdf5": _write_hdf5,
        "xlsx": _write_xlsx,
    }[kind]
    writer(path, columns, table, name)


def _plain(values: Any) -> Array:
    """Convert a column to an array (n,): numbers and booleans unchanged, anything else to objects
    of type str."""
    array = np.asarray(values)
    return array if array.dtype.kind in "fiub" else array.astype(str).astype(object)


def _is_text(array: Array) -> bool:
    return array.dtype == object


def _write_csv(path: Path, columns: Sequence[Column], table: dict[str, Array], name: str) -> None:
    import pandas as pd  # noqa: PLC0415

    pd.DataFrame(table).to_csv(path, index=False)


def matlab_names(names: Sequence[str]) -> dict[str, str]:
    """Make names of columns valid for MATLAB: names of more than 63 characters are cut to 63. A cut
    name that is taken by an earlier column ends in a number instead (_1, _2, ...), still within 63.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    dict of str to str
        The name in MATLAB of each column.
    """
    used: set[str] = set()
    result = {}
    for name in names:
        short, number = name[:_MATLAB_NAME], 1
        while short in used:
            ending = f"_{number}"
            short, number = name[: _MATLAB_NAME - len(ending)] + ending, number + 1
        used.add(short)
        result[name] = short
    return result


def _write_mat(path: Path, columns: Sequence[Column], table: dict[str, Array], name: str) -> None:
    from scipy.io import savemat  # noqa: PLC0415

    names = matlab_names(list(table))
    content = {
        name: {names[key]: values[:, None] for key, values in table.items()},
        "units": {names[column.name]: column.unit for column in columns},
        "meanings": {names[column.name]: column.meaning for column in columns},
    }
    cut = {short: key for key, short in names.items() if short != key}
    if cut:
        content["long_names"] = cut
    savemat(path, content, long_field_names=True, do_compression=True)


def _write_netcdf(
    path: Path, columns: Sequence[Column], table: dict[str, Array], name: str
) -> None:
    from scipy.io import netcdf_file  # noqa: PLC0415

    rows = len(next(iter(table.values())))
    with netcdf_file(path, "w", version=2) as file:
        file.createDimension("row", rows)
        file.title = name
        for column in columns:
            values = table[column.name]
            if _is_text(values):
                width = max((len(text.encode()) for text in values), default=1) or 1
                file.createDimension(f"letters_of_{column.name}", width)
                variable = file.createVariable(
                    column.name, "c", ("row", f"letters_of_{column.name}")
                )
                letters = np.array([text.encode() for text in values], dtype=f"S{width}")
                variable[:] = letters.view("S1").reshape(rows, width)
            else:
                is_small = values.dtype.kind in "iub" and np.abs(values).max(initial=0) < 2**31
                variable = file.createVariable(column.name, "i" if is_small else "d", ("row",))
                variable[:] = values
            variable.units, variable.long_name = column.unit, column.meaning


def _write_hdf5(path: Path, columns: Sequence[Column], table: dict[str, Array], name: str) -> None:
    h5py = import_module("h5py")

    with h5py.File(path, "w") as file:
        group = file.create_group(name)
        for column in columns:
            values = table[column.name]
            kind = h5py.string_dtype() if _is_text(values) else None
            data = group.create_dataset(column.name, data=values, dtype=kind)
            data.attrs["units"], data.attrs["long_name"] = column.unit, column.meaning


def _write_xlsx(path: Path, columns: Sequence[Column], table: dict[str, Array], name: str) -> None:
    import pandas as pd  # noqa: PLC0415

    rows = len(next(iter(table.values())))
    if rows > _EXCEL_ROWS:
        raise InputError(
            f"format = 'xlsx': has room for {_EXCEL_ROWS:,} rows, the run has {rows:,}; choose "
            "another format, such as 'csv'"
        )
    listed = pd.DataFrame([(c.name, c.unit, c.meaning) for c in columns],
                          columns=["column", "unit", "meaning"])  # fmt: skip
    with pd.ExcelWriter(path, engine="openpyxl") as writer:
        pd.DataFrame(table).to_excel(writer, sheet_name=name, index=False)
        listed.to_excel(writer, sheet_name="columns", index=False)
