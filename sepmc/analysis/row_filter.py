"""Row filter: cases whose inputs or outcomes satisfy terms such as ``joint.pins.fails=1``."""

import fnmatch
import re
from collections.abc import Mapping, Sequence

import numpy as np

from sepmc.analysis.statistics import column
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import InputError, nearest

_TERM = re.compile(r"\s*([^<>=!\s]+)\s*(<=|>=|!=|=|<|>)\s*(\S+)\s*")
_OR = re.compile(r"\s+or\s+")
_TESTS = {
    "=": np.equal,
    "!=": np.not_equal,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}


def filter_names(dispersions: Sequence[Dispersion], columns: Sequence[str]) -> dict[str, str]:
    """Map each name that a filter accepts to a numeric column of the case table.

    Parameters
    ----------
    dispersions : sequence of Dispersion
        The dispersed parameters, which are inputs.
    columns : sequence of str
        Columns of the case table; ``status`` is left out.

    Returns
    -------
    dict of str to str
        Column by accepted name: the column's own name, and for an input also its TOML path with its
        unit (``initial.alpha_deg``) and without it (``initial.alpha``).
    """
    names = {name: name for name in columns if name != "status"}
    for dispersion in dispersions:
        names |= {
            dispersion.parameter.key: dispersion.parameter.column,
            dispersion.parameter.path: dispersion.parameter.column,
        }
    return names


def matching_rows(
    rows: Mapping[str, np.ndarray], columns: Mapping[str, str], terms: Sequence[str]
) -> np.ndarray:
    """Return the mask (n,) of cases that satisfy all terms.

    Parameters
    ----------
    rows : mapping of column to values, shape (n,)
        The case table.
    columns : mapping of accepted name to column
        From `filter_names`.
    terms : sequence of str
        Each term is a comparison such as ``joint.pins.fails=1`` or ``initial.alpha_deg>5``, or
        several of them joined by ``or``. A name with wildcards, as in ``spring.*.fails=1``, is
        satisfied if any matching column is. A missing outcome, NaN, satisfies ``!=`` and no other
        comparison. Without terms all cases satisfy the filter.

    Returns
    -------
    ndarray, shape (n,), bool

    Raises
    ------
    InputError
        If a term cannot be parsed, or a name in it matches no column.
    """
    mask = np.ones(len(rows["case"]), dtype=bool)
    for term in terms:
        mask &= np.any(
            [_meets(rows, columns, alternative, term) for alternative in _OR.split(term)], axis=0
        )
    return mask


def filter_outcomes(columns: Mapping[str, str], terms: Sequence[str]) -> list[str]:
    """List the outcomes that a filter uses.

    Parameters
    ----------
    columns : mapping of accepted name to column
        From `filter_names`.
    terms : sequence of str
        As for `matching_rows`.

    Returns
    -------
    list of str
        Columns that are neither inputs nor the case number.

    Raises
    ------
    InputError
        As `matching_rows`.
    """
    parsed = [_read(columns, each, term) for term in terms for each in _OR.split(term)]
    names = dict.fromkeys(name for matches, _, _ in parsed for name in matches)
    return [name for name in names if not name.startswith("in_") and name != "case"]


def _meets(
    rows: Mapping[str, np.ndarray], columns: Mapping[str, str], term: str, text: str
) -> np.ndarray:
    """Return the mask (n,) of cases that satisfy the comparison ``term`` in at least one of the
    columns that its name matches; ``text`` is the whole term that it is an alternative of, for
    messages. Raises InputError if ``term`` cannot be parsed or matches no column."""
    names, test, number = _read(columns, term, text)
    return np.any([_TESTS[test](column(rows, name), number) for name in names], axis=0)


def _read(columns: Mapping[str, str], term: str, text: str) -> tuple[list[str], str, float]:
    """Parse the comparison ``term``, one alternative of a term of a filter.

    Return the matching columns, the operator (a key of `_TESTS`) and the number. ``text`` is the
    whole term, for messages. Raises InputError if it cannot be parsed or matches no column.
    """
    match = _TERM.fullmatch(term)
    if not match:
        raise InputError(
            f"where = {text}: must be NAME=VALUE, or with !=, <, <=, > or >= in place of =; "
            "several with 'or' between them"
        )
    name, test, value = match.groups()
    names = sorted({columns[name] for name in fnmatch.filter(columns, name)})
    if not names:
        offered = [name for name in columns if not _unit_left_out(name, columns)]
        keys = [name for name in offered if "." in name]
        offered = keys if "." in name and keys else offered
        raise InputError(f"where = {text}: no such input or outcome; {nearest(name, offered)}")
    try:
        number = float(value)
    except ValueError:
        number = np.nan
    if np.isnan(number):
        raise InputError(f"where = {text}: {value!r} must be a number")
    return names, test, number


def _unit_left_out(name: str, columns: Mapping[str, str]) -> str:
    """Return the unit that an accepted ``name`` of an input leaves out, as ``deg`` for
    ``initial.alpha``; an empty string for a name that leaves out none. ``columns`` maps accepted
    names to columns (`filter_names`)."""
    stem = "in_" + name.replace(".", "_").replace("-", "_") + "_"
    return columns[name].removeprefix(stem) if columns[name].startswith(stem) else ""


def assumed_units(columns: Mapping[str, str], terms: Sequence[str]) -> list[str]:
    """Return a sentence, with the unit that is assumed, for each input that the terms of a filter
    name without its unit; ``columns`` is from `filter_names`."""
    matches = [_TERM.fullmatch(match) for term in terms for match in _OR.split(term)]
    names = [name for match in matches if match for name in fnmatch.filter(columns, match[1])]
    units = {name: _unit_left_out(name, columns) for name in names}
    return [
        f"{name} is taken in {unit}, as {columns[name]} is"
        for name, unit in units.items()
        if unit and "*" not in name
    ]


def describe_filter(terms: Sequence[str]) -> str:
    """Return the terms of a filter joined by ``and``; alternatives are put in parentheses if there
    are several terms."""
    several = len(terms) > 1
    return " and ".join(f"({term})" if several and _OR.search(term) else term for term in terms)
