"""Two runs beside each other: what differs in their files, and by how much their outcomes differ.

Rows are joined by case number. Where one number means the same draws in both runs, as with one
seed, the two rows are a pair: the difference of a pair is known far better than that of two means
(Student's t). Runs whose numbers mean different draws are compared as independent samples (Welch,
Biometrika 34, 1947). Outcomes that are yes or no are compared as proportions.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import difference_interval, paired_interval
from sepmc.analysis.statistics import column, ok_rows, student_half_width
from sepmc.analysis.statistics_text import WIDTH, aligned, rounded
from sepmc.scene.model import SALTELLI
from sepmc.schema import is_yes_or_no

_MISSING = "-"
RANDOM = "random"  # the sampler of independent cases


def tree_differences(one: Mapping[str, Any], two: Mapping[str, Any], path: str = "") -> list[str]:
    """A sentence for each value that two campaign trees do not share, by its TOML path."""
    found = []
    for key in [*one, *(key for key in two if key not in one)]:
        where = f"{path}.{key}" if path else key
        a, b = one.get(key, _MISSING), two.get(key, _MISSING)
        a, b = _by_name(a), _by_name(b)
        if isinstance(a, dict) and isinstance(b, dict):
            found += tree_differences(a, b, where)
        elif a != b:
            found.append(f"{where}: {_brief(a)} -> {_brief(b)}")
    return found


def _by_name(value: Any) -> Any:
    """An array of tables as a table of them by name."""
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        return {str(item.get("name", i)): item for i, item in enumerate(value)}
    return value


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def paired_rows(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    changed: Collection[str] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two case tables that belong together.

    All cases that both tables hold are pairs, or none: a choice of the cases in which inputs agree
    would leave out those that a change has an effect on. They are pairs if one number means the
    same draws in both tables: inputs that were not changed agree in every common case, and there
    are such inputs, or inputs that agree tell most of the cases apart.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case`` (each number once, in any order) and inputs.
    inputs : names of the inputs that both have
    changed : those of them whose values may differ, as their laws, correlations or the seed do

    Returns
    -------
    in_one, in_two : ndarray, shape (n_pairs,), int
        Places of the pairs in either table, by rising case number.
    """
    _, in_one, in_two = np.intersect1d(
        np.asarray(one["case"]), np.asarray(two["case"]), return_indices=True
    )
    known = {name: column(one, name)[in_one] for name in inputs}
    agree = [name for name, x in known.items() if (x == column(two, name)[in_two]).all()]
    kept = [name for name in inputs if name not in changed]
    if set(kept) <= set(agree) and (kept or _distinguishes_rows([known[name] for name in agree])):
        return in_one, in_two
    return in_one[:0], in_two[:0]


def _distinguishes_rows(values: Sequence[np.ndarray]) -> bool:
    """Whether columns (n,) differ between most rows, as draws of a continuous law do. One such
    column is enough: 84 of a million rows take 2 s, where rows of one table took 45 s."""
    code = np.zeros(len(values[0]) if values else 0, dtype=np.int64)
    for one in values:
        own = np.unique(one, return_inverse=True)[1]
        distinct, code = np.unique(code * (own.max(initial=0) + 1) + own, return_inverse=True)
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
    """Differences of the outcomes of two case tables, the second minus the first.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case``, ``status``, inputs, outcomes.
    inputs, outcomes : names that both have
    changed : inputs that were drawn anew; see `paired_rows`
    error_sizes : mapping of outcome to how far a value of the one run and one of the other may be
        apart by numerical error alone, in its unit, optional

    Returns
    -------
    DataFrame, a row per outcome
        ``mean_one``, ``mean_two``, ``sigma_one``, ``sigma_two``; ``difference`` of the means with
        its 95 % interval ``low``, ``high`` (Student's t, exact for normal outcomes; of an outcome
        that is yes or no see `sepmc.analysis.proportions`), and from how many ``pairs`` of cases;
        0 pairs: from independent samples. ``below_error``: whether no pair, or, without pairs, no
        case of the one from any of the other, differs by more than its numerical error: the
        difference is then 0.
    """
    in_one, in_two = paired_rows(one, two, inputs, changed)
    rows = []
    for name in outcomes:
        a, b = (np.where(ok_rows(t), column(t, name), np.nan) for t in (one, two))
        before, after = a[in_one], b[in_two]
        both = np.isfinite(before) & np.isfinite(after)
        a, b = a[np.isfinite(a)], b[np.isfinite(b)]
        pairs = int(both.sum()) if both.sum() > 1 else 0
        by = _proportion_difference if is_yes_or_no(name) else _mean_difference
        difference, low, high = by(*((before[both], after[both], True) if pairs else (a, b, False)))
        error = (error_sizes or {}).get(name, 0.0)
        if pairs:
            farthest = float(np.abs(after[both] - before[both]).max())
        else:
            farthest = float(np.ptp(np.concatenate([a, b]))) if len(a) and len(b) else np.inf
        below = 0.0 < farthest <= error
        if below:
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
                "below_error": below,
            }
        )
    return pd.DataFrame(rows, index=pd.Index(list(outcomes), name="outcome"))


def _mean_difference(a: np.ndarray, b: np.ndarray, paired: bool) -> tuple[float, float, float]:
    """Difference of two means, and its 95 % interval: of pairs, or of independent samples."""
    if min(len(a), len(b)) < 2:
        return np.nan, np.nan, np.nan
    if paired:
        apart = b - a
        difference, freedoms = apart.mean(), len(apart) - 1.0
        error = apart.std(ddof=1) / np.sqrt(len(apart))
    else:
        difference = b.mean() - a.mean()
        of_a, of_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
        error, freedoms = np.sqrt(of_a + of_b), 1.0
        if error > 0.0:  # Welch and Satterthwaite, by shares, which do not underflow
            share = of_a / (of_a + of_b)
            freedoms = 1.0 / (share**2 / (len(a) - 1) + (1.0 - share) ** 2 / (len(b) - 1))
    reach = student_half_width(freedoms) * error
    return difference, difference - reach, difference + reach


def _proportion_difference(
    a: np.ndarray, b: np.ndarray, paired: bool
) -> tuple[float, float, float]:
    """Difference of two shares of cases, and its 95 % interval, from outcomes that are 0 or 1."""
    if not (len(a) and len(b)):
        return np.nan, np.nan, np.nan
    if paired:
        ends = paired_interval(int((b > a).sum()), int((a > b).sum()), len(a))
    else:
        ends = difference_interval(int(a.sum()), len(a), int(b.sum()), len(b))
    return b.mean() - a.mean(), *ends


def dependence_warning(samplers: Sequence[str]) -> str:
    """The sentence on intervals of differences where cases of a run are not independent of each
    other; empty if they are. `run.samples` is not looked into."""
    if SALTELLI in samplers:
        return (
            "sampler saltelli: cases of a run repeat each other but for one parameter, so these "
            "intervals are too narrow"
        )
    if patterned := [name for name in dict.fromkeys(samplers) if name != RANDOM]:
        return (
            f"sampler {' and '.join(patterned)}: cases of a run are not independent, so these "
            "intervals are those of as many random cases, mostly too wide"
        )
    return ""


def render_comparison(table: pd.DataFrame, width: int = WIDTH) -> str:
    """Differences as an engineer reads them in a terminal."""
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
    told = (
        "differences are of pairs where there are some, means and sigmas of all ok cases of a run"
    )
    return "\n".join([*aligned(rows, width), told])
