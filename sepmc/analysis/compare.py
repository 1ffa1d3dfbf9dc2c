"""Comparison of two runs: differences of their campaign files and of their outcomes.

Rows are joined by case number. Where a number means the same samples in both runs, as with one
seed, the two rows are a pair: the mean difference of pairs is known far better than the difference
of means (Student's t). Runs whose numbers mean different samples are compared as independent ones
(Welch, Biometrika 34, 1947). Yes-or-no outcomes are compared as proportions.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import difference_interval, paired_interval
from sepmc.analysis.statistics import column, ok_rows, student_half_width
from sepmc.analysis.statistics_text import WIDTH, aligned, rounded
from sepmc.scene.model import SALTELLI
from sepmc.scene.setting_checks import split_units
from sepmc.scene.units import UNITS, unit_kind
from sepmc.schema import is_yes_or_no

_ABSENT = "-"
# numbers of a distribution that are in no unit
_UNSCALED = ("weights", "truncate_sigma", "relative", "column")
RANDOM = "random"  # sampler of independent cases


def tree_differences(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    path: tuple[str, ...] = (),
    units: bool = False,
) -> list[str]:
    """List the differences of two campaign trees.

    Parameters
    ----------
    one, two : mapping
        TOML trees.
    path : tuple of str
        TOML path of the trees, put before the keys.
    units : bool
        True to list a number given in another unit even if its value in SI agrees to 1e-12.

    Returns
    -------
    list of str
        ``path: old -> new`` for each value that differs; ``-`` for an absent one.
    """
    sentences = []
    other_key = {_without_units(path, key): key for key in two}
    pairs = {key: key if key in two else other_key.get(_without_units(path, key)) for key in one}
    added = [key for key in two if key not in pairs.values()]
    for key, other in [*pairs.items(), *((key, key) for key in added)]:
        a, b = _by_name(one.get(key, _ABSENT)), _by_name(two.get(other or key, _ABSENT))
        same = a == b
        if other not in (None, key):
            same = not units and _same_in_si(a, b, _factor(path, key) / _factor(path, str(other)))
        elif isinstance(a, dict) and isinstance(b, dict):
            sentences += tree_differences(a, b, (*path, *key.split(".")), units)
            continue
        if not same:
            renamed = "" if other in (None, key) else f"{other} = "
            sentences.append(f"{'.'.join((*path, key))}: {_brief(a)} -> {renamed}{_brief(b)}")
    return sentences


def _without_units(path: tuple[str, ...], key: str) -> tuple[str, ...]:
    """Return the path of a key, with that of a dispersed parameter split, without units."""
    return split_units((*path, *key.split(".")))[0]


def _factor(path: tuple[str, ...], key: str) -> float:
    """Return the factor to SI of the unit in the name of a key, 1 without a unit; ``path`` are the
    tables that contain the key."""
    unit = split_units((*path, *key.split(".")))[1]
    return UNITS[unit_kind(unit)][unit] if unit else 1.0


def _same_in_si(a: Any, b: Any, factor: float) -> bool:
    """Return True if ``a`` times ``factor`` equals ``b``, to 1e-12: numbers, lists of them, the
    components of a vector or the numbers of a distribution."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        scaled = {key: 1.0 if key in _UNSCALED or a.get("relative") else factor for key in a}
        return a.keys() == b.keys() and all(_same_in_si(a[k], b[k], scaled[k]) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same_in_si, a, b, [factor] * len(a)))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a * factor, b, rel_tol=1e-12)
    return bool(a == b)


def _by_name(value: Any) -> Any:
    """Return an array of tables as a table of them by name; other values unchanged."""
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        return {str(item.get("name", i)): item for i, item in enumerate(value)}
    return value


def _brief(value: Any) -> str:
    """Return the text of a value, cut to 60 characters."""
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def paired_rows(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    changed: Collection[str] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Find the rows of two case tables that are pairs.

    All common cases are pairs, or none: a selection of cases whose inputs agree would leave out
    those that a change affects. They are pairs if a case number means the same samples in both
    tables: the unchanged inputs agree in every common case, and either there are such inputs or the
    agreeing inputs distinguish most cases.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case`` (unique, in any order) and inputs.
    inputs : sequence of str
        Inputs of both tables.
    changed : collection of str
        Inputs whose values may differ because their distribution, correlation or seed does.

    Returns
    -------
    in_one, in_two : ndarray, shape (n_pairs,), int
        Row indices of the pairs in either table, by increasing case number.
    """
    _, in_one, in_two = np.intersect1d(
        np.asarray(one["case"]), np.asarray(two["case"]), return_indices=True
    )
    values = {name: column(one, name)[in_one] for name in inputs}
    agree = [name for name, x in values.items() if (x == column(two, name)[in_two]).all()]
    unchanged = [name for name in inputs if name not in changed]
    if set(unchanged) <= set(agree) and (
        unchanged or _distinguishes_rows([values[name] for name in agree])
    ):
        return in_one, in_two
    return in_one[:0], in_two[:0]


def _distinguishes_rows(values: Sequence[np.ndarray]) -> bool:
    """Return True if columns (n,) differ between most rows, as samples of a continuous distribution
    do. One such column is enough: 84 of a million rows take 2 s, where rows of one table took 45
    s."""
    code = np.zeros(len(values[0]) if values else 0, dtype=np.int64)
    for column_values in values:
        codes = np.unique(column_values, return_inverse=True)[1]
        distinct, code = np.unique(code * (codes.max(initial=0) + 1) + codes, return_inverse=True)
        if 2 * len(distinct) > len(code):
            return True
    return False


def compare(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    outcomes: Sequence[str],
    changed: Collection[str] = (),
    error_sizes: Mapping[str, float] | None = None,
) -> pd.DataFrame:
    """Compare the outcomes of two case tables, the second minus the first.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case``, ``status``, inputs, outcomes.
    inputs, outcomes : sequence of str
        Names that both have.
    changed : collection of str
        See `paired_rows`.
    error_sizes : mapping of outcome to float, optional
        Difference that numerical error alone explains, in the outcome's unit.

    Returns
    -------
    DataFrame, a row per outcome
        ``mean_one``, ``mean_two``, ``sigma_one``, ``sigma_two``; ``difference`` of the means with
        its 95 % interval ``low``, ``high`` (Student's t, exact for normal outcomes; for yes-or-no
        outcomes see `sepmc.analysis.proportions`), and the number of ``pairs``, 0 for independent
        samples; ``below_error``: True if no pair, or no two cases of independent samples, differ by
        more than the numerical error: the difference is then 0.
    """
    in_one, in_two = paired_rows(one, two, inputs, changed)
    rows = []
    for name in outcomes:
        a, b = (np.where(ok_rows(t), column(t, name), np.nan) for t in (one, two))
        first, second = a[in_one], b[in_two]
        both = np.isfinite(first) & np.isfinite(second)
        a, b = a[np.isfinite(a)], b[np.isfinite(b)]
        pairs = int(both.sum()) if both.sum() > 1 else 0
        difference_of = _proportion_difference if is_yes_or_no(name) else _mean_difference
        difference, low, high = difference_of(
            *((first[both], second[both], True) if pairs else (a, b, False))
        )
        error = (error_sizes or {}).get(name, 0.0)
        if pairs:
            max_difference = float(np.abs(second[both] - first[both]).max())
        else:
            max_difference = float(np.ptp(np.concatenate([a, b]))) if len(a) and len(b) else np.inf
        below_error = 0.0 < max_difference <= error
        if below_error:
            difference, low, high = 0.0, 0.0, 0.0
        rows.append(
            {
                "mean_one": a.mean() if len(a) else np.nan,
                "mean_two": b.mean() if len(b) else np.nan,
                "sigma_one": a.std(ddof=1) if len(a) > 1 else np.nan,
                "sigma_two": b.std(ddof=1) if len(b) > 1 else np.nan,
                "difference": difference,
                "low": low,
                "high": high,
                "pairs": pairs,
                "below_error": below_error,
            }
        )
    return pd.DataFrame(rows, index=pd.Index(list(outcomes), name="outcome"))


def _mean_difference(a: np.ndarray, b: np.ndarray, paired: bool) -> tuple[float, float, float]:
    """Return the difference of two means and its 95 % interval, from pairs or independent
    samples."""
    if min(len(a), len(b)) < 2:
        return np.nan, np.nan, np.nan
    if paired:
        differences = b - a
        difference, degrees = differences.mean(), len(differences) - 1.0
        error = differences.std(ddof=1) / np.sqrt(len(differences))
    else:
        difference = b.mean() - a.mean()
        variance_a, variance_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
        error, degrees = np.sqrt(variance_a + variance_b), 1.0
        if error > 0.0:  # Welch-Satterthwaite, by fractions, which do not underflow
            fraction = variance_a / (variance_a + variance_b)
            degrees = 1.0 / (fraction**2 / (len(a) - 1) + (1.0 - fraction) ** 2 / (len(b) - 1))
    half_width = student_half_width(degrees) * error
    return difference, difference - half_width, difference + half_width


def _proportion_difference(
    a: np.ndarray, b: np.ndarray, paired: bool
) -> tuple[float, float, float]:
    """Return the difference of two proportions and its 95 % interval, from outcomes that are 0 or
    1."""
    if not (len(a) and len(b)):
        return np.nan, np.nan, np.nan
    if paired:
        interval = paired_interval(int((b > a).sum()), int((a > b).sum()), len(a))
    else:
        interval = difference_interval(int(a.sum()), len(a), int(b.sum()), len(b))
    return b.mean() - a.mean(), *interval


def dependence_warning(samplers: Sequence[str]) -> str:
    """Return the warning on intervals of differences if cases of a run are not independent.

    Parameters
    ----------
    samplers : sequence of str
        Of the runs. A table of samples is not examined.

    Returns
    -------
    str
        Empty if all cases are independent.
    """
    if SALTELLI in samplers:
        return (
            "sampler saltelli: cases of a run differ in one parameter only, so these intervals are "
            "too narrow"
        )
    if others := [name for name in dict.fromkeys(samplers) if name != RANDOM]:
        return (
            f"sampler {' and '.join(others)}: cases of a run are not independent, so these "
            "intervals are those of as many random cases, mostly too wide"
        )
    return ""


def render_comparison(table: pd.DataFrame, width: int = WIDTH) -> str:
    """Render the differences of two runs as a text table.

    Parameters
    ----------
    table : DataFrame
        From `compare`.
    width : int
        Characters in a line.

    Returns
    -------
    str
    """
    head = ["outcome", "mean, first", "second", "second - first", "95 % interval", "sigma, first",
            "second", "pairs"]  # fmt: skip
    rows = [head]
    for name, row in table.iterrows():
        scale = max(abs(row["high"] - row["low"]), 1e-3 * abs(row["sigma_one"]), 1e-300)
        rows.append(
            [
                str(name),
                rounded(row["mean_one"], row["sigma_one"]),
                rounded(row["mean_two"], row["sigma_two"]),
                rounded(row["difference"], scale),
                "below numerical error"
                if row["below_error"]
                else f"{rounded(row['low'], scale)} to {rounded(row['high'], scale)}",
                rounded(row["sigma_one"], row["sigma_one"]),
                rounded(row["sigma_two"], row["sigma_two"]),
                str(int(row["pairs"])) if row["pairs"] else "none",
            ]
        )
    note = "differences are of pairs if there are any; means and sigmas are of all ok cases"
    return "\n".join([*aligned(rows, width), note])
