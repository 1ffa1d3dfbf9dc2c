"""Cases of a run in which inputs have certain values: those in which a joint fails, say."""

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


def names_of(dispersions: Sequence[Dispersion], columns: Sequence[str]) -> dict[str, str]:
    """What the columns of numbers of a case table can be called: by their names, and inputs by
    their keys and paths."""
    found = {name: name for name in columns if name != "status"}
    for law in dispersions:
        found |= {law.parameter.key: law.parameter.column, law.parameter.path: law.parameter.column}
    return found


def where(
    rows: Mapping[str, np.ndarray], columns: Mapping[str, str], asked: Sequence[str]
) -> np.ndarray:
    """Which cases (n,) meet all of what is ``asked``: terms such as ``joint.pins.fails=1`` or
    ``initial.alpha_deg>5``, or several with ``or`` between them, of which one is enough; so is one
    of the names that match a pattern, as in ``spring.*.fails=1``.

    Parameters
    ----------
    rows : case table by column
    columns : mapping of what an input or outcome can be called to its column
    asked : terms

    Raises
    ------
    InputError
        If a term cannot be read, or names nothing that the table has.
    """
    found = np.ones(len(rows["case"]), dtype=bool)
    for text in asked:
        found &= np.any([_meets(rows, columns, term, text) for term in _OR.split(text)], axis=0)
    return found


def outcomes_of(columns: Mapping[str, str], asked: Sequence[str]) -> list[str]:
    """Columns by which cases are chosen that are no inputs."""
    terms = [_read(columns, term, text) for text in asked for term in _OR.split(text)]
    found = dict.fromkeys(name for known, _, _ in terms for name in known)
    return [name for name in found if not name.startswith("in_") and name != "case"]


def _meets(
    rows: Mapping[str, np.ndarray], columns: Mapping[str, str], term: str, text: str
) -> np.ndarray:
    """Which cases (n,) meet one term of a ``text``."""
    known, test, number = _read(columns, term, text)
    return np.any([_TESTS[test](column(rows, each), number) for each in known], axis=0)


def _read(columns: Mapping[str, str], term: str, text: str) -> tuple[list[str], str, float]:
    """Columns, test and number of one term of a ``text``."""
    match = _TERM.fullmatch(term)
    if not match:
        raise InputError(
            f"where = {text}: must be NAME=VALUE, with =, !=, <, <=, > or >=; "
            "several with 'or' between them"
        )
    name, test, value = match.groups()
    known = sorted({columns[each] for each in fnmatch.filter(columns, name)})
    if not known:
        offered = [each for each in columns if not _unit_left_out(each, columns)]
        keys = [each for each in offered if "." in each]
        offered = keys if "." in name and keys else offered
        raise InputError(f"where = {text}: no such input or outcome; {nearest(name, offered)}")
    try:
        number = float(value)
    except ValueError:
        number = np.nan
    if np.isnan(number):
        raise InputError(f"where = {text}: {value!r} must be a number")
    return known, test, number


def _unit_left_out(name: str, columns: Mapping[str, str]) -> str:
    """The unit of an input that is called by its path without it; empty if it is not."""
    stem = "in_" + name.replace(".", "_").replace("-", "_") + "_"
    return columns[name].removeprefix(stem) if columns[name].startswith(stem) else ""


def units_taken(columns: Mapping[str, str], asked: Sequence[str]) -> list[str]:
    """Sentences on the units of numbers of terms that name an input without one."""
    terms = [_TERM.fullmatch(term) for text in asked for term in _OR.split(text)]
    names = [each for term in terms if term for each in fnmatch.filter(columns, term[1])]
    units = {name: _unit_left_out(name, columns) for name in names}
    return [
        f"{name} is taken in {unit}, as {columns[name]} is"
        for name, unit in units.items()
        if unit and "*" not in name
    ]


def in_words(asked: Sequence[str]) -> str:
    """What is asked, as it is told."""
    several = len(asked) > 1
    return " and ".join(f"({each})" if several and _OR.search(each) else each for each in asked)
