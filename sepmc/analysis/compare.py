"""Comparison of two runs: differences of their campaign files and of their outcomes.

Rows of the two case tables are joined by case number. If a case number has the same sampled inputs
in both runs, as with the same seed, its two rows are a pair: the mean difference of pairs is known
far better than the difference of means (Student's t). Otherwise the runs are compared as
independent samples (Welch, Biometrika 34, 1947). Yes-or-no outcomes are compared as proportions.
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
    """List the differences between the parsed TOML of two campaign files.

    Tables of an array of tables are matched by their ``name``, and keys that differ only in their
    unit, such as ``mass_kg`` and ``mass_g``, are matched too.

    Parameters
    ----------
    one, two : mapping
        Parsed TOML of the first and of the second file, or of a table of them.
    path : tuple of str
        TOML path of that table; it begins every path returned.
    units : bool
        True to list a number given in another unit even if its value in SI agrees to 1e-12.

    Returns
    -------
    list of str
        ``path: old -> new`` for each value that differs, values cut to 60 characters; ``-`` stands
        for an absent value. A matched key of another unit gives ``path: old -> new_key = new``.
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
    """Return the TOML path of a key in the table at ``path``, without units; a key that is itself a
    dotted path, as those of ``[dispersion]`` are, is split at its dots."""
    return split_units((*path, *key.split(".")))[0]


def _factor(path: tuple[str, ...], key: str) -> float:
    """Return the factor that converts the value of a key to SI, from the unit in the key's name; 1
    if the name has no unit. ``path`` is the TOML path of the table that contains the key."""
    unit = split_units((*path, *key.split(".")))[1]
    return UNITS[unit_kind(unit)][unit] if unit else 1.0


def _same_in_si(a: Any, b: Any, factor: float) -> bool:
    """Return True if ``a`` times ``factor`` equals ``b`` to a relative 1e-12.

    Lists and tables are equal if all their elements are; the factor is left out for numbers of a
    distribution that have no unit, such as ``truncate_sigma``, and for a relative one. Values that
    are not numbers must be equal.
    """
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        scaled = {key: 1.0 if key in _UNSCALED or a.get("relative") else factor for key in a}
        return a.keys() == b.keys() and all(_same_in_si(a[k], b[k], scaled[k]) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same_in_si, a, b, [factor] * len(a)))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a * factor, b, rel_tol=1e-12)
    return bool(a == b)


def _by_name(value: Any) -> Any:
    """Return a list of tables as a dict of them by their ``name``, or by their index where they
    have none; return any other value unchanged."""
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        return {str(item.get("name", i)): item for i, item in enumerate(value)}
    return value


def _brief(value: Any) -> str:
    """Return the text of a value; one longer than 60 characters is cut to 60, which end in
    ``...``."""
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def paired_rows(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    changed: Collection[str] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Find the rows of two case tables that are pairs: the same case number and the same samples.

    Either all case numbers that both tables contain give pairs, or none does: a selection of the
    cases whose inputs agree would leave out those that a change between the runs affects. They give
    pairs if every input that is not in ``changed`` has equal values in all these cases. If all
    inputs are in ``changed``, those with equal values must also differ between most cases.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case`` (unique, in any order) and inputs.
    inputs : sequence of str
        Inputs of both tables.
    changed : collection of str
        Inputs whose values may differ because their distribution, correlation or seed differs.

    Returns
    -------
    in_one, in_two : ndarray, shape (n_pairs,), int
        Row indices of the pairs in the first and in the second table, by increasing case number;
        empty without pairs.
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
    """Return True if more than half of the rows formed by the columns, each (n,), are distinct, as
    samples of a continuous distribution are. Columns are added one by one until that is so, which
    is 20 times as fast as to look for the distinct rows of all columns."""
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
    """Compare the outcomes of the ok cases of two case tables; differences are second minus first.
    Cases without an outcome are left out of its row.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case``, ``status``, inputs, outcomes.
    inputs, outcomes : sequence of str
        Names of columns that both tables have.
    changed : collection of str
        Inputs whose values may differ, see `paired_rows`.
    error_sizes : mapping of outcome to float, optional
        Largest difference that numerical error alone can explain, in the outcome's unit; 0 for an
        outcome that is not listed.

    Returns
    -------
    DataFrame, a row per outcome
        ``mean_one``, ``mean_two``, ``sigma_one``, ``sigma_two``; ``difference`` of the means (of
        the pairs, if there are two or more) with its 95 % interval ``low``, ``high`` (Student's t,
        exact for normal outcomes; for yes-or-no outcomes see `sepmc.analysis.proportions`), and the
        number of ``pairs``, 0 for independent samples. ``below_error`` is True if there are
        differences within pairs, or between any two cases of independent samples, but none exceeds
        ``error_sizes``: ``difference``, ``low`` and ``high`` are then 0.
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
    """Return the mean of ``b`` minus that of ``a`` and both ends of its 95 % interval, by
    Student's t (Welch's if not paired).

    ``a`` and ``b`` are values of an outcome in two runs; if ``paired``, equal indices are a pair.
    All three results are NaN if either has fewer than two values.
    """
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
    """Return the proportion of ones in ``b`` minus that in ``a``, and both ends of the 95 %
    interval.

    ``a`` and ``b`` are zeros and ones of two runs; if ``paired``, equal indices are a pair. All
    three results are NaN if either is empty.
    """
    if not (len(a) and len(b)):
        return np.nan, np.nan, np.nan
    if paired:
        interval = paired_interval(int((b > a).sum()), int((a > b).sum()), len(a))
    else:
        interval = difference_interval(int(a.sum()), len(a), int(b.sum()), len(b))
    return b.mean() - a.mean(), *interval


def dependence_warning(samplers: Sequence[str]) -> str:
    """Return a warning that intervals of differences are wrong, as cases are not independent.

    Parameters
    ----------
    samplers : sequence of str
        ``run.sampler`` of both runs. Cases from a table of samples (``run.samples``) are not
        examined.

    Returns
    -------
    str
        Empty if the sampler of both runs is random.
    """
    if SALTELLI in samplers:
        return (
            "sampler saltelli: the cases of a run are not independent, as many differ in one "
            "parameter only, so these intervals are too narrow"
        )
    if others := [name for name in dict.fromkeys(samplers) if name != RANDOM]:
        return (
            f"sampler {' and '.join(others)}: the cases of a run are not independent; these "
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
        Largest number of characters in a line; further columns go to a block below.

    Returns
    -------
    str
        A line per outcome, and a note on pairs.
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
    note = (
        "differences: of pairs (same case number and samples in both runs) if there are any; "
        "means and sigmas: of all ok cases"
    )
    return "\n".join([*aligned(rows, width), note])
