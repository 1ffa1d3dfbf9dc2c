"""Two runs beside each other: what differs in their files, and by how much their outcomes differ.

Cases of equal number and equal inputs, but for those that were changed, are pairs, as two runs of
one seed have them: the difference of a pair is known far better than that of two means. Runs that
share no pairs are compared as independent samples (Welch, Biometrika 34, 1947).
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import TWO_SIDED, WIDTH, aligned, column, ok_rows, rounded

_MISSING = "-"


def differences(one: Mapping[str, Any], two: Mapping[str, Any], path: str = "") -> list[str]:
    """A sentence for each value that two campaign trees do not share, by its TOML path."""
    found = []
    for key in [*one, *(key for key in two if key not in one)]:
        where = f"{path}.{key}" if path else key
        a, b = one.get(key, _MISSING), two.get(key, _MISSING)
        a, b = _by_name(a), _by_name(b)
        if isinstance(a, dict) and isinstance(b, dict):
            found += differences(a, b, where)
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


def are_pairs(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    changed: Collection[str] = (),
) -> np.ndarray:
    """Which cases (n,) of the numbers that both tables hold have equal inputs, but for those that
    were changed: that were drawn anew, or that differ in every case, as correlation makes them.
    Where all were changed there are no pairs, unless both tables hold the same cases.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case`` and inputs; cases are numbered from 0 without a gap.
    inputs : names of the inputs that both have
    changed : those of them that were drawn anew, as their laws differ, or the seed: they may agree
        in some cases all the same
    """
    count = min(len(one["case"]), len(two["case"]))
    equal = {name: column(one, name)[:count] == column(two, name)[:count] for name in inputs}
    if equal and all(each.all() for each in equal.values()):
        return np.ones(count, dtype=bool)
    kept = [each for name, each in equal.items() if name not in changed and each.any()]
    return np.logical_and.reduce(kept) if kept else np.zeros(count, dtype=bool)


def compare(
    one: Mapping[str, Any],
    two: Mapping[str, Any],
    inputs: Sequence[str],
    outcomes: Sequence[str],
    changed: Collection[str] = (),
) -> pd.DataFrame:
    """Differences of the outcomes of two case tables, the second minus the first.

    Parameters
    ----------
    one, two : mapping of name to column
        ``case``, ``status``, inputs, outcomes.
    inputs, outcomes : names that both have
    changed : inputs that were drawn anew; see `are_pairs`

    Returns
    -------
    DataFrame, a row per outcome
        ``mean_one``, ``mean_two``, ``sigma_one``, ``sigma_two``; ``difference`` of the means with
        its 95 % interval ``low``, ``high``, and from how many ``pairs`` of cases; 0 pairs: from
        independent samples.
    """
    pairs, rows = are_pairs(one, two, inputs, changed), []
    for name in outcomes:
        a, b = (np.where(ok_rows(t), column(t, name), np.nan) for t in (one, two))
        apart = (b[: len(pairs)] - a[: len(pairs)])[pairs]
        apart = apart[np.isfinite(apart)]
        a, b = a[np.isfinite(a)], b[np.isfinite(b)]
        if len(apart) > 1:
            difference, error = apart.mean(), apart.std(ddof=1) / np.sqrt(len(apart))
        elif min(len(a), len(b)) > 1:
            difference = b.mean() - a.mean()
            error = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
        else:
            difference = error = np.nan
        rows.append(
            {
                "mean_one": a.mean() if len(a) else np.nan,
                "mean_two": b.mean() if len(b) else np.nan,
                "sigma_one": a.std(ddof=1) if len(a) > 1 else np.nan,
                "sigma_two": b.std(ddof=1) if len(b) > 1 else np.nan,
                "difference": difference,
                "low": difference - TWO_SIDED * error,
                "high": difference + TWO_SIDED * error,
                "pairs": len(apart) if len(apart) > 1 else 0,
            }
        )
    return pd.DataFrame(rows, index=pd.Index(list(outcomes), name="outcome"))


def text(table: pd.DataFrame, width: int = WIDTH) -> str:
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
                f"{rounded(row['low'], scale)} to {rounded(row['high'], scale)}",
                rounded(row["sigma_one"], row["sigma_one"]),
                rounded(row["sigma_two"], row["sigma_two"]),
                str(int(row["pairs"])) if row["pairs"] else "none",
            ]
        )
    told = (
        "differences are of pairs where there are some, means and sigmas of all cases of each run"
    )
    return "\n".join([*aligned(rows, width), told])
