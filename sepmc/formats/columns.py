"""Conversion of the columns of a file to quantities in SI; they are found by the names and units in
its header, or by what a campaign names."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.formats.text_table import FormatError, TextTable
from sepmc.scene.messages import nearest, shorten
from sepmc.scene.units import UNITS, is_number, split_unit

# spellings of units by those of keys; temperatures in degrees have an offset
_SPELLINGS = {
    "m/s": "m_s", "mps": "m_s", "meter/second": "m_s", "km/s": "km_s", "km/h": "km_h",
    "kmh": "km_h", "ft/s": "ft_s", "fps": "ft_s", "kt": "kn", "kts": "kn", "knot": "kn",
    "knots": "kn", "deg/s": "deg_s", "°/s": "deg_s", "dps": "deg_s", "rad/s": "rad_s",
    "m/s2": "m_s2", "m/s^2": "m_s2", "m/s²": "m_s2", "ft/s2": "ft_s2", "ft/s^2": "ft_s2",
    "n m": "N_m", "nm": "N_m", "lbf ft": "lbf_ft", "ft lbf": "lbf_ft",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "newton": "N",
    "newtons": "N", "n": "N", "kn": "kN", "lbs": "lbf", "pounds": "lbf", "lbf": "lbf",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "feet": "ft", "foot": "ft",
    "degree": "deg", "degrees": "deg", "°": "deg", "radians": "rad", "radian": "rad",
    "kg/m3": "kg_per_m3", "kg/m^3": "kg_per_m3", "kg/m³": "kg_per_m3", "kg_m3": "kg_per_m3",
    "kg m-3": "kg_per_m3", "g/cm3": "g_per_cm3", "slug/ft3": "slug_per_ft3", "pa": "Pa",
    "hpa": "hPa", "mb": "mbar", "kpa": "kPa", "kelvin": "K", "k": "K", "c": "degC", "°c": "degC",
    "deg_c": "degC", "degc": "degC", "celsius": "degC",
}  # fmt: skip
_IN_BRACKETS = re.compile(r"(.*?)\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*")
_AFTER_COMMA = re.compile(r"(.+?)\s*,\s*([^,]+)")
_ZERO_CELSIUS = 273.15


@dataclass(frozen=True)
class Quantity:
    """Quantity that a column of a file may have.

    Attributes
    ----------
    kind : str
        Key of `sepmc.scene.units.UNITS`; empty for one without a unit.
    names : tuple of str
        Names by which a column is recognised, in small letters without blanks and punctuation.
    """

    kind: str
    names: tuple[str, ...]


def split_header(title: str, kind: str) -> tuple[str, str]:
    """Split the title of a column into name and unit: ``thrust (N)``, ``thrust [N]``, ``thrust, N``
    and ``thrust_N`` all give ``("thrust", "N")``.

    Parameters
    ----------
    title : str
    kind : str
        Kind of quantity, a key of `sepmc.scene.units.UNITS`: it distinguishes knots from
        kilonewtons, for example.

    Returns
    -------
    name, unit : str
        The unit as a suffix of keys, such as ``deg_s``; as written if it is no unit of this kind;
        empty if the title has none. After ``_`` only a unit of this kind is split off: all of
        ``thrust_x`` is a name.
    """
    units = {**UNITS.get(kind, {}), **({"degC": 1.0} if kind == "temperature" else {})}
    for pattern in (_IN_BRACKETS, _AFTER_COMMA):
        if match := pattern.fullmatch(title):
            return match[1], _unit(match[2], units)
    name, unit = split_unit(title)
    if unit in units:
        return name, unit
    head, _, last = title.rpartition("_")
    known = _unit(last, units)
    return (head, known) if head and known in units else (title, "")


def _unit(text: str, units: dict[str, float]) -> str:
    """Unit suffix of keys, one of ``units``, that a spelling such as ``m/s`` means. For any other
    spelling the result is not in ``units``: the spelling itself, or the suffix of a unit of another
    kind of quantity."""
    if text in units:
        return text
    spelling = _SPELLINGS.get(text.lower(), text)
    if spelling not in units and text.lower() in ("lb", "lbs") and "lbf" in units:
        return "lbf"
    if spelling == "kN" and "kn" in units:
        return "kn"
    return spelling


def plain(name: str) -> str:
    """Name in small letters, with only its letters a to z and digits."""
    return re.sub(r"[^a-z0-9]+", "", name.lower())


def split_columns(option: Any) -> tuple[list[str] | None, dict[str, Any] | None]:
    """Split the option ``columns`` of a file (None: not given) into the titles of a file without a
    header, if it is a list, and the columns by quantity, if it is a table; None for what it is not.
    Raises FormatError if it is neither."""
    if option is not None and not isinstance(option, list | dict):
        raise FormatError(
            "columns: must be a table of titles by quantity, or the list of all titles of a file "
            "without a header"
        )
    titles = [str(title) for title in option] if isinstance(option, list) else None
    return titles, option if isinstance(option, dict) else None


def named_column(key: str, value: Any, expected: str) -> tuple[str, float]:
    """Return name and factor of the column that the entry ``key`` of the option ``columns`` names
    by ``value``: a name, or a table ``{ column, scale }``. Raises FormatError if the value is
    neither, with ``expected`` as what it must be, or the table has another key."""
    entry = value if isinstance(value, dict) else {"column": value}
    if unknown := [each for each in entry if each not in ("column", "scale")]:
        raise FormatError(f"columns.{key}.{unknown[0]}: unknown key; allowed: column, scale")
    name, scale = entry.get("column"), entry.get("scale", 1.0)
    if not isinstance(name, str) or not is_number(scale):
        raise FormatError(f"columns.{key}: must be {expected}")
    return name, float(scale)


def check_quantities(named: Collection[str], known: Collection[str], kind: str) -> None:
    """Raise FormatError if the option ``columns`` has a quantity (``named``, without units) that is
    not ``known``; ``kind`` is a word for such quantities."""
    for name in named:
        if name not in known:
            raise FormatError(f"columns.{name}: no such {kind}; {nearest(name, known)}")


class Columns:
    """Columns of a table by quantity; `find` converts one to SI. Creating the object raises
    FormatError if ``named`` is not valid or names a column that the table does not have.

    Parameters
    ----------
    table : TextTable
    named : dict, optional
        Columns that a campaign names, by quantity: a title, or ``{ column, scale }``, where
        ``scale`` is a factor. A unit in the key (``thrust_lbf``) is that of the column.

    Attributes
    ----------
    named : dict of str to (str, float, str)
        Title, factor and unit (empty: that of the title) of each named column, by quantity.
    understood : list of str
        Sentences for the user, which readers add to.
    """

    def __init__(self, table: TextTable, named: dict[str, Any] | None = None):
        self.table, self.understood = table, list[str]()
        self.named: dict[str, tuple[str, float, str]] = {}
        for key, value in (named or {}).items():
            quantity, unit = split_unit(key)
            title, scale = named_column(
                key, value, "the title of a column, or { column = TITLE, scale = NUMBER }"
            )
            table.check_numbers(title)
            if title not in table.columns:
                raise FormatError(
                    f"columns.{key}: no column {shorten(title)}; {nearest(title, table.columns)}"
                )
            self.named[quantity] = (title, scale, unit)

    def find(self, name: str, quantity: Quantity, default: str = "") -> np.ndarray | None:
        """Find the column of a quantity (the one that ``named`` gives, else the one with a title of
        the quantity) and convert it to SI.

        Parameters
        ----------
        name : str
            Name of the quantity in messages and in ``columns``.
        quantity : Quantity
        default : str
            Unit of a column that has none, neither in ``named`` nor in its title; if empty, such a
            column is an error. A quantity without a kind of unit is not converted.

        Returns
        -------
        ndarray (n,) or None
            None if the file has no such column.

        Raises
        ------
        FormatError
            If two columns have the quantity, it is no column of numbers, or the unit is missing or
            not one of the quantity.
        """
        scale = 1.0
        if name in self.named:
            title, scale, unit = self.named[name]
            unit = unit or split_header(title, quantity.kind)[1]
        else:
            titles = []
            for each in (*self.table.columns, *self.table.texts):
                stem, unit = split_header(each, quantity.kind)
                if plain(stem) in quantity.names:
                    titles.append((each, unit))
            if not titles:
                return None
            if len(titles) > 1:
                both = " and ".join(each for each, _ in titles[:2])
                raise FormatError(f"has two columns of {name}: {both}; choose by columns.{name}")
            title, unit = titles[0]
        self.table.check_numbers(title)
        values = scale * self.table.columns[title]
        if not quantity.kind:
            return values
        if not (unit or default):
            stem, units = split_header(title, quantity.kind)[0], list(UNITS[quantity.kind])
            raise FormatError(
                f"column {shorten(title)}: has no unit; name it as {stem}_{units[0]}, or give "
                f'columns = {{ {name}_{units[0]} = "{title}" }}; units: {", ".join(units)}'
            )
        return values_in_si(values, title, unit or default, quantity.kind)


def values_in_si(values: np.ndarray, title: str, unit: str, kind: str) -> np.ndarray:
    """Return the values (n,) of the column ``title``, converted to SI from ``unit``, a suffix of
    keys or "degC" (temperatures only). ``kind`` is the kind of quantity, a key of `UNITS`. Raises
    FormatError if the unit is empty or not one of this kind."""
    units = UNITS[kind]
    if kind == "temperature" and unit == "degC":
        return values + _ZERO_CELSIUS
    if unit not in units:
        what = f"{unit!r} is no unit of {kind}" if unit else "has no unit"
        example = f"{split_header(title, kind)[0]}_{next(iter(units))}"
        raise FormatError(
            f"column {shorten(title)}: {what}; name it as {example}; units: {', '.join(units)}"
        )
    return values * units[unit]
