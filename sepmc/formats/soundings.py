"""Reading of air and wind over height from tables with named columns, and from soundings of the
University of Wyoming and of the Storm Prediction Center (SPC)."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.formats.columns import Columns, Quantity, check_quantities, split_columns
from sepmc.formats.text_table import FormatError, TextTable, number, parse_table, read_table
from sepmc.formats.text_table import read_text as text_of
from sepmc.scene.messages import shorten

_HEIGHT = ("altitude", "height", "alt", "z", "h", "geometricheight", "geometricaltitude")
_GEOPOTENTIAL = ("geopotential", "hght", "hgt", "geopotentialheight", "geopotentialaltitude",
                 "gph")  # fmt: skip
_QUANTITIES = {
    "altitude": Quantity("length", _HEIGHT),
    "geopotential": Quantity("length", _GEOPOTENTIAL),
    "density": Quantity("density", ("density", "rho", "dens", "airdensity")),
    "pressure": Quantity("pressure", ("pressure", "pres", "p", "press")),
    "temperature": Quantity("temperature", ("temperature", "temp", "t")),
    "speed_of_sound": Quantity("speed", ("speedofsound", "soundspeed", "a", "cs")),
    "speed": Quantity("speed", ("speed", "windspeed", "wspd", "sknt", "ws", "sped", "ff")),
    "from": Quantity("angle", ("from", "windfrom", "drct", "wdir", "fromdirection", "dd",
                               "directionfrom", "winddirectionfrom", "windfromdirection")),
    "direction": Quantity("angle", ("direction", "to", "directionto", "windto")),
    "along": Quantity("speed", ("along", "windalong", "windx")),
    "across": Quantity("speed", ("across", "windacross", "windz")),
    # components of the air's motion; an east wind comes from the east
    "east": Quantity("speed", ("east", "eastward", "ueast", "eastwardwind", "windeastward")),
    "north": Quantity("speed", ("north", "northward", "vnorth", "northwardwind", "windnorthward")),
}  # fmt: skip
_DEFAULTS = {"from": "deg", "direction": "deg"}
_WYOMING = re.compile(
    r"^[ \t]*PRES\s+HGHT\s+TEMP\s+DWPT\s+RELH\s+MIXR\s+DRCT\s+(SKNT|SPED)\b", re.MULTILINE
)
_WIDTH = 7  # of a column of a Wyoming sounding
_SPC = re.compile(r"^[ \t]*LEVEL\s+HGHT\s+TEMP\s+DWPT\s+WDIR\s+WSPD[^%]*%RAW%", re.MULTILINE)
_MISSING = -9998.0  # values below are none


def read_air(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read a table of air over height from a file.

    Parameters
    ----------
    path : Path
    options : dict
        ``columns``: by quantity, the title of a column or ``{ column, scale }``; or the list of all
        titles of a file without a header.

    Returns
    -------
    table : dict
        Keys of ``[environment.air]``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    columns, understood = _columns(path, options, ("PRES", "HGHT", "TEMP"))
    columns_read = _find(
        columns,
        ("altitude", "geopotential", "density", "pressure", "temperature", "speed_of_sound"),
    )
    tree = _heights(columns_read)
    if "density" in columns_read:
        tree["density_kg_per_m3"] = columns_read["density"].tolist()
    elif "pressure" in columns_read and "temperature" in columns_read:
        tree["pressure_Pa"] = columns_read["pressure"].tolist()
        tree["temperature_K"] = columns_read["temperature"].tolist()
    else:
        raise FormatError(
            "needs density, or pressure and temperature; has " + ", ".join(columns.table.columns)
        )
    if "speed_of_sound" in columns_read:
        tree["speed_of_sound_m_s"] = columns_read["speed_of_sound"].tolist()
    elif "density" in columns_read and "temperature" in columns_read:
        understood.append(
            "the temperature is not read: it would give the speed of sound with pressure"
        )
    return _sorted(tree, understood)


def read_wind(path: Path, options: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Read a profile of the wind over height from a file.

    Parameters
    ----------
    path : Path
    options : dict
        ``columns``: by quantity, the title of a column or ``{ column, scale }``; or the list of all
        titles of a file without a header.

    Returns
    -------
    table : dict
        Keys of ``[environment.wind.profile]``.
    understood : list of str
        Sentences on what was read, for the user.

    Raises
    ------
    FormatError
        With the reason why the file is rejected.
    """
    columns, understood = _columns(path, options, ("HGHT", "DRCT", "SKNT"))
    names = ("speed", "from", "direction", "along", "across", "east", "north")
    columns_read = _find(columns, ("altitude", "geopotential", *names))
    tree = _heights(columns_read)
    if "along" in columns_read and "across" in columns_read:
        tree["speed_m_s"] = np.hypot(columns_read["along"], columns_read["across"]).tolist()
        tree["direction_deg"] = np.degrees(
            np.arctan2(columns_read["across"], columns_read["along"])
        ).tolist()
    elif "east" in columns_read and "north" in columns_read:
        east, north = columns_read["east"], columns_read["north"]
        tree["speed_m_s"] = np.hypot(east, north).tolist()
        tree["from_deg"] = (np.degrees(np.arctan2(-east, -north)) % 360.0).tolist()
        understood.append("east and north taken as where the air moves to")
    elif "speed" in columns_read and ("from" in columns_read) != ("direction" in columns_read):
        key = "from" if "from" in columns_read else "direction"
        tree["speed_m_s"] = columns_read["speed"].tolist()
        tree[f"{key}_deg"] = [float(f"{math.degrees(x):.12g}") for x in columns_read[key]]
        if key == "direction":
            understood.append("direction taken as where the air moves to, 0 along ground x")
    else:
        raise FormatError(
            "needs columns of speed and either from (by compass) or direction (to, from ground x), "
            "or of along and across, or of east and north; choose them by "
            'columns = { speed = "TITLE", from = "TITLE" } or the like; has '
            + ", ".join(columns.table.columns)
        )
    return _sorted(tree, understood)


def _columns(
    path: Path, options: dict[str, Any], needed: tuple[str, ...]
) -> tuple[Columns, list[str]]:
    """Read the columns of a file; return them, and sentences on its format. ``options`` as for
    `read_air`. Of a sounding only the columns ``needed`` (such as "HGHT") are read, and only the
    rows that have all of them. Raises FormatError if the file is no table or has several
    soundings, or for columns of a sounding that the options name."""
    named = options.get("columns")
    titles, by_name = split_columns(named)
    if path.suffix.lower() != ".parquet":
        text = text_of(path)
        for pattern, rows_of, layout in (
            (_WYOMING, _wyoming_rows, "a sounding of fixed width: PRES HGHT TEMP ... DRCT {}"),
            (_SPC, _spc_rows, "a sounding of SPC: LEVEL (hPa) HGHT (m) TEMP (C) WDIR WSPD (kt)"),
        ):
            count = len(pattern.findall(text))
            if count > 1:
                raise FormatError(f"has {count} soundings; must have one")
            if match := pattern.search(text):
                if named is not None:
                    raise FormatError(
                        f"is {layout.partition(':')[0]}, whose columns have fixed names; leave out "
                        f"columns = {shorten(named)}"
                    )
                rows = rows_of(text, match.start())
                table, left = _sounding(rows, needed)
                is_si = bool(rows and "SPED" in rows[0])
                understood = [layout.format("SPED (m/s)" if is_si else "SKNT (kn)")]
                if left:
                    understood.append(f"{left} rows without {', '.join(needed)} are not read")
                return Columns(table), understood
        table = parse_table(text, titles)
    else:
        table = read_table(path)
    return Columns(table, by_name), []


_TITLES = {
    "PRES": "PRES (hPa)", "HGHT": "HGHT (m)", "TEMP": "TEMP (degC)", "DRCT": "DRCT (deg)",
    "SKNT": "SKNT (kn)", "SPED": "SPED (m/s)",
}  # fmt: skip


def _sounding(rows: list[dict[str, float]], needed: tuple[str, ...]) -> tuple[TextTable, int]:
    """Table of the columns ``needed`` of a sounding, without the rows that lack a value of one of
    these, and the number of those rows. ``rows`` have values by column, NaN where missing; if they
    have SPED, it replaces SKNT. Raises FormatError if the table has fewer than two rows."""
    if rows and "SPED" in rows[0]:
        needed = tuple("SPED" if name == "SKNT" else name for name in needed)
    whole = [row for row in rows if all(math.isfinite(row[name]) for name in needed)]
    if len(whole) < 2:
        raise FormatError(f"has fewer than two rows with {', '.join(needed)}")
    columns = {_TITLES[name]: np.array([row[name] for row in whole]) for name in needed}
    return TextTable(columns, (), "fixed width"), len(rows) - len(whole)


def _wyoming_rows(text: str, begin: int) -> list[dict[str, float]]:
    """Rows of a sounding in the format of the University of Wyoming: columns of seven characters,
    below the line of titles, where index ``begin`` of ``text`` is. Each row has the numbers by
    title, in the units of the file; a missing one is NaN. The rows end at the first line after
    them that has other characters than numbers and blanks."""
    lines = text[begin:].splitlines()
    names = ("PRES", "HGHT", "TEMP", "DWPT", "RELH", "MIXR", "DRCT",
             "SKNT" if "SKNT" in lines[0] else "SPED")  # fmt: skip
    rows = list[dict[str, float]]()
    for line in lines[1:]:
        cells = [line[k * _WIDTH : (k + 1) * _WIDTH].strip() for k in range(len(names))]
        if not cells[0]:
            continue
        if not re.fullmatch(r"[-+.\d\s]+", line):
            if rows:
                break
            continue
        rows.append({name: _value(cell) for name, cell in zip(names, cells, strict=True)})
    return rows


def _spc_rows(text: str, begin: int) -> list[dict[str, float]]:
    """Rows of a sounding in the format of the Storm Prediction Center and SHARPpy, between %RAW%
    and %END% after index ``begin`` of ``text``. Each row has the numbers by column, PRES to SKNT,
    in the units of the file; NaN for a missing one (-9999) and for a text that is no number. Cells
    beyond SKNT are ignored. Raises FormatError for a line with fewer cells that is not blank."""
    names = ("PRES", "HGHT", "TEMP", "DWPT", "DRCT", "SKNT")
    rows = list[dict[str, float]]()
    head, _, body = text[begin:].partition("%RAW%")
    first = len((text[:begin] + head + "%").splitlines())
    for n, line in enumerate(body.partition("%END%")[0].splitlines(), first):
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) < len(names):
            if line.strip():
                raise FormatError(
                    f"line {n}: {shorten(line.strip())} is no row of {' '.join(names)}"
                )
            continue
        rows.append({name: _value(cell) for name, cell in zip(names, cells, strict=False)})
    return rows


def _value(cell: str) -> float:
    """Convert the text of a cell to a number; NaN if it is no finite number, or marks a missing
    value (-9998 or less)."""
    try:
        value = number(cell)
    except ValueError:
        return math.nan
    return value if _MISSING < value < math.inf else math.nan


def _find(columns: Columns, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    check_quantities(columns.named, names, "quantity")
    columns_read = {}
    for name in names:
        values = columns.find(name, _QUANTITIES[name], _DEFAULTS.get(name, ""))
        if values is not None:
            columns_read[name] = values
    return columns_read


def _heights(columns_read: dict[str, np.ndarray]) -> dict[str, Any]:
    if "altitude" in columns_read:
        return {"altitude_m": columns_read["altitude"].tolist()}
    if "geopotential" in columns_read:
        return {"geopotential_m": columns_read["geopotential"].tolist()}
    raise FormatError("needs a column of altitude, such as altitude_m, or of geopotential height")


def _sorted(tree: dict[str, Any], understood: list[str]) -> tuple[dict[str, Any], list[str]]:
    """Sort the rows of a table by rising height, the first key of ``tree``. Returns the sorted
    copy, and the list ``understood`` itself, to which sentences on the rows were added. Raises
    FormatError if a height occurs twice."""
    key = next(iter(tree))
    heights = np.array(tree[key])
    order = np.argsort(heights, kind="stable")
    if (np.diff(heights[order]) == 0.0).any():
        twice = heights[order][int(np.argmin(np.diff(heights[order])))]
        raise FormatError(f"has two rows at the height {twice:g} m")
    if (order != np.arange(len(order))).any():
        understood.append("rows sorted by height")
    understood.insert(0, f"{len(heights)} rows, {heights.min():g} to {heights.max():g} m")
    return {name: np.array(values)[order].tolist() for name, values in tree.items()}, understood
