"""Reading of aerodynamic decks in long tables, which have a row for each combination of Mach
number, alpha and beta, and a column for each coefficient."""

import itertools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.formats.columns import (
    Columns,
    Quantity,
    check_quantities,
    plain,
    split_columns,
    split_header,
)
from sepmc.formats.text_table import FormatError, TextTable, read_table
from sepmc.scene.model import COEFFICIENTS, DERIVATIVES

AXES = {
    "mach": Quantity("", ("mach", "machnumber", "ma", "m")),
    "alpha": Quantity("angle", ("alpha", "aoa", "alfa", "angleofattack")),
    "beta": Quantity("angle", ("beta", "aos", "sideslip", "angleofsideslip")),
}
# that the option ``columns`` may name
QUANTITIES = (*AXES, *COEFFICIENTS, *DERIVATIVES, "lift", "drag")
# titles that mean one coefficient by their capitals; in small letters cn and cl mean two
_EXACT = {
    "CA": "axial", "CX": "", "CN": "normal", "CY": "side", "Cl": "roll", "CLL": "roll",
    "Cm": "pitch", "CM": "pitch", "Cn": "yaw", "CLN": "yaw", "CROLL": "roll", "CPITCH": "pitch",
    "CYAW": "yaw", "CL": "lift", "CD": "drag", "CLM": "pitch",
    "CMQ": "pitch_q", "Cmq": "pitch_q", "CLMQ": "pitch_q", "CNQ": "normal_q", "CAQ": "axial_q",
    "CLLP": "roll_p", "Clp": "roll_p", "CLLR": "roll_r", "Clr": "roll_r",
    "CLNP": "yaw_p", "Cnp": "yaw_p", "CLNR": "yaw_r", "Cnr": "yaw_r", "CYP": "side_p",
    "CYR": "side_r", "CYp": "side_p", "CYr": "side_r",
}  # fmt: skip
_EXACT |= {f"C_{name[1:]}": meaning for name, meaning in _EXACT.items()}
_SMALL = {
    "ca": "axial", "cy": "side", "cm": "pitch", "cll": "roll", "cln": "yaw", "cmq": "pitch_q",
    "clp": "roll_p", "cnr": "yaw_r", "cd": "drag",
}  # fmt: skip
_TWO_MEANINGS = {"cn": {"normal": "CN", "yaw": "Cn"}, "cl": {"lift": "CL", "roll": "Cl"}}
_CELLS = 100_000


def read_deck(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read an aerodynamic table of a campaign from a long table in a text or Parquet file.

    Parameters
    ----------
    path : Path
    options : dict
        ``columns``: by coefficient or axis, the title of a column or ``{ column, scale }``; or the
        list of all titles of a file without a header.

    Returns
    -------
    table : dict
        Keys of ``[body.NAME.aerodynamics.table]``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    titles, named = split_columns(options.get("columns"))
    return deck_of(read_table(path, titles), named or {})


def deck_of(table: TextTable, named: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Convert a long table to an aerodynamic table and sentences on it, as `read_deck` returns
    them; ``named`` is the dict ``columns`` of its options. Raises FormatError unless there are
    columns of at least one axis and of at least one coefficient."""
    columns = Columns(table, named)
    axes = {}
    for name, quantity in AXES.items():
        points = columns.find(name, quantity, "deg" if name != "mach" else "")
        if points is not None:
            axes[name] = points
    if not axes:
        raise FormatError(
            "needs a column of mach, alpha_deg or beta_deg; has " + ", ".join(table.columns)
        )
    values = _coefficients(columns)
    if not values:
        raise FormatError(
            "has no coefficient, such as CA, CN, CY, Cl, Cm, Cn; has " + ", ".join(table.columns)
        )
    understood = list(columns.understood)
    _from_lift(values, axes, understood)
    grid_axes, order = _grid(axes, table)
    shape = [len(points) for points in grid_axes.values()]
    tree: dict[str, Any] = {}
    for name, points in grid_axes.items():
        is_angle = name != "mach"
        tree[f"{name}_deg" if is_angle else name] = [
            float(f"{math.degrees(x):.12g}") if is_angle else float(x) for x in points
        ]
    for name in (*COEFFICIENTS, *DERIVATIVES):
        if name in values:
            tree[name] = values[name][order].reshape(shape).tolist()
    rows = ", ".join(f"{len(points)} rows of {name}" for name, points in grid_axes.items())
    coefficients = ", ".join(name for name in (*COEFFICIENTS, *DERIVATIVES) if name in values)
    understood.insert(0, f"{rows}; {coefficients}")
    return tree, understood


def _coefficients(columns: Columns) -> dict[str, np.ndarray]:
    """Columns (n,) of the coefficients and derivatives in a long table, by name; ``lift`` and
    ``drag`` count too. A sentence on the columns that are neither these nor axes is added to
    ``columns.understood``. Raises FormatError if the meaning of a title is not unique, two columns
    give one coefficient, or an option names an unknown one."""
    values: dict[str, np.ndarray] = {}
    check_quantities(columns.named, QUANTITIES, "coefficient")
    used = {title for title, _, _ in columns.named.values()}
    for name, (title, scale, _) in columns.named.items():
        if name not in AXES:
            values[name] = scale * columns.table.columns[title]
    for title in columns.table.texts:
        if coefficient_of(title) not in ("", *columns.named):
            columns.table.check_numbers(title)
    left = list(columns.table.texts)
    for title, numbers in columns.table.columns.items():
        if title in used or any(
            plain(split_header(title, q.kind)[0]) in q.names for q in AXES.values()
        ):
            continue
        bare = split_header(title, "")[0].strip()
        meanings = _TWO_MEANINGS.get(plain(bare), {}) if bare not in _EXACT else {}
        if meanings.keys() - columns.named.keys():
            both = " or ".join(f"{short} ({name})" for name, short in meanings.items())
            raise FormatError(
                f"column {title} has two meanings: write {both}, or name it by columns"
            )
        name = coefficient_of(title)
        if not name or name in columns.named:
            left.append(title)
        elif name in values:
            raise FormatError(
                f"has two columns of {name}; one of them is {title}: choose by columns.{name}"
            )
        else:
            values[name] = numbers
    _refuse_conditions(left, values)
    if left:
        columns.understood.append(f"not read: {', '.join(left)}")
    return values


def coefficient_of(title: str) -> str:
    """Coefficient or derivative, ``lift`` or ``drag``, that the title of a column means; empty if
    it means none."""
    bare = split_header(title, "")[0].strip()
    if bare in (*COEFFICIENTS, *DERIVATIVES):
        return bare
    return _EXACT.get(bare, _SMALL.get(plain(bare), ""))


def _refuse_conditions(left: list[str], values: dict[str, np.ndarray]) -> None:
    """Raise FormatError if the axial or normal coefficient is only in one or more columns for
    conditions of the motor, such as "CA Power-Off" and "CA Power-On" of RASAero: the file must
    choose one. ``left`` are the titles that were not understood; ``values`` are the columns of
    coefficients by name ("axial", "normal")."""
    for meaning, short in (("axial", "CA"), ("normal", "CN")):
        titles = [each for each in left if re.match(rf"{short}[ _]power", each, re.IGNORECASE)]
        if titles and meaning not in values:
            raise FormatError(
                f"has {short} as {' and '.join(titles)}; choose by columns = "
                f'{{ {meaning} = "{titles[0]}" }}'
            )


def _from_lift(
    values: dict[str, np.ndarray], axes: dict[str, np.ndarray], understood: list[str]
) -> None:
    """Replace the columns ``lift`` and ``drag`` in ``values``, if they are there, by normal and
    axial force, in place, and add a sentence to ``understood``; if normal and axial force are there
    already, only remove them. ``axes`` are the columns of the axes, rad. Raises FormatError if only
    one of the two is there, there is no alpha, or a sideslip is not 0."""
    lift, drag = values.pop("lift", None), values.pop("drag", None)
    if lift is None and drag is None:
        return
    if "normal" in values and "axial" in values:
        understood.append("CL and CD not read: the file has CN and CA")
        return
    if lift is None or drag is None or "alpha" not in axes:
        of_roll = "; Cl is the roll moment here: lift is CL" if "roll" in values else ""
        raise FormatError(
            f"needs CL and CD together, over alpha, to make CN and CA of them{of_roll}"
        )
    if "beta" in axes and axes["beta"].any():
        raise FormatError("CL and CD at a sideslip are in other axes; give CN and CA")
    sine, cosine = np.sin(axes["alpha"]), np.cos(axes["alpha"])
    values["normal"] = lift * cosine + drag * sine
    values["axial"] = drag * cosine - lift * sine
    understood.append("CN = CL cos alpha + CD sin alpha, CA = CD cos alpha - CL sin alpha")


def _grid(
    axes: dict[str, np.ndarray], table: TextTable
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Arrange the rows of a long table as a grid. ``axes`` are the columns (rows,) of the axes.

    Returns the distinct points of each axis, rising, and an array (combinations,) with the index of
    the row of each combination of points, the last axis fastest. Raises FormatError if there are
    more than `_CELLS` combinations, or one is missing or given twice."""
    points = {name: np.unique(values) for name, values in axes.items()}
    shape = tuple(len(each) for each in points.values())
    if math.prod(shape) > _CELLS:
        raise FormatError(
            f"has {' x '.join(map(str, shape))} combinations of {', '.join(points)}, more than "
            "100,000: does each column have what its title says?"
        )
    index = np.ravel_multi_index(
        [np.searchsorted(points[name], axes[name]) for name in points], shape
    )
    order = np.full(math.prod(shape), -1)
    for row, cell in enumerate(index):
        if order[cell] >= 0:
            what = _where(points, int(cell), shape)
            raise FormatError(f"{table.where(row)}: {what} is there twice")
        order[cell] = row
    if (order < 0).any():
        missing = int(np.argmin(order))
        raise FormatError(
            f"has no row for {_where(points, missing, shape)} "
            f"({int((order < 0).sum())} of {len(order)} combinations are missing)"
        )
    return points, order


def _where(points: dict[str, np.ndarray], cell: int, shape: tuple[int, ...]) -> str:
    """Place of a cell in a table, for messages: "mach = 0.8, alpha = 4 deg". ``cell`` is its flat
    index in a table of this ``shape``; ``points`` are the values of the axes, angles in rad."""
    cell_index = np.unravel_index(cell, shape)
    return ", ".join(
        f"{name} = {math.degrees(x):g} deg" if name != "mach" else f"{name} = {x:g}"
        for name, x in zip(points, itertools.starmap(
            lambda each, k: float(each[k]), zip(points.values(), cell_index, strict=True)
        ), strict=True)
    )  # fmt: skip
