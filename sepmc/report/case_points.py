"""Data of the interactive figure of a report, which `points.js` draws: values of some cases as
dots, and histograms of all cases."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sepmc.analysis.statistics import column, ok_rows
from sepmc.wording import to_words

MAX_POINTS = 2000
_BINS = 480  # of a histogram of all cases
_EXTREMES = 24  # lowest and highest cases of each outcome among the points, fewer of many outcomes
_DIGITS = 4  # of the range of a column


def case_points(
    cases: Mapping[str, Any],
    outcomes: Sequence[str],
    inputs: Sequence[str],
    units: Mapping[str, str],
    bounds: Mapping[str, Sequence[float]],
) -> dict[str, Any]:
    """Return the values of at most `MAX_POINTS` ok cases, and histograms of all ok cases.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
        Case table; it is read one column at a time.
    outcomes, inputs : sequence of str
        Columns to include.
    units : mapping of column to unit
    bounds : mapping of outcome to sequence of float
        All lower and upper bounds that requirements set on it, in its unit
        (`sepmc.analysis.requirements.required_bounds`).

    Returns
    -------
    dict
        ``total``, number of ok cases; ``cases``, the numbers of the m cases drawn as dots: those
        with the extremes of the outcomes, and others spaced evenly over the table; ``columns``, a
        dict per column: its ``name``, ``words`` for it, ``unit``, ``kind`` (``outcome`` or
        ``input``), list of required ``bounds``, ``values`` of the m cases (None if not finite), and
        ``counts`` of all ok cases in 480 equal bins from ``low`` to ``high``. Columns without two
        different values are left out.
    """
    ok = ok_rows(cases)
    rows = np.flatnonzero(ok)
    chosen = _points(cases, rows, outcomes)
    columns = [
        drawn
        for kind, names in (("outcome", outcomes), ("input", inputs))
        for name in names
        if (drawn := _column(cases, ok, chosen, name, kind, units.get(name, ""), bounds))
    ]
    return {
        "total": len(rows),
        "cases": np.asarray(cases["case"])[chosen].tolist(),
        "columns": columns,
    }


def _points(cases: Mapping[str, Any], rows: np.ndarray, outcomes: Sequence[str]) -> np.ndarray:
    """Return the indices, in increasing order, of the rows of the case table to draw as dots, at
    most `MAX_POINTS`; ``rows`` are the indices of the ok rows, ``outcomes`` those whose extremes
    (of finite values) are included."""
    if len(rows) <= MAX_POINTS:
        return rows
    extremes = [np.empty(0, dtype=np.int64)]
    each = min(_EXTREMES, max(1, MAX_POINTS // max(1, 2 * len(outcomes))))
    for name in outcomes:
        values = column(cases, name)[rows]
        known = np.flatnonzero(np.isfinite(values))
        order = known[np.argsort(values[known], kind="stable")]
        extremes += [order[:each], order[-each:]]
    first = np.unique(np.concatenate(extremes))[:MAX_POINTS]
    others = np.setdiff1d(np.arange(len(rows)), first)
    count = MAX_POINTS - len(first)
    spaced = others[np.linspace(0, len(others) - 1, count).round().astype(np.int64)]
    return rows[np.sort(np.concatenate([first, spaced]))]


def _column(
    cases: Mapping[str, Any],
    ok: np.ndarray,
    chosen: np.ndarray,
    name: str,
    kind: str,
    unit: str,
    bounds: Mapping[str, Sequence[float]],
) -> dict[str, Any] | None:
    """Return the dict of a column in the result of `case_points`; None if the ok cases have no two
    different finite values. ``ok`` (n_cases,) is a mask, ``chosen`` (m,) are the indices of the
    rows drawn as dots; ``kind`` is "outcome" or "input", ``unit`` is "" or "1" for none, and
    ``bounds`` has those of all outcomes by name."""
    values = column(cases, name)
    finite = values[ok & np.isfinite(values)]
    if not len(finite) or (low := float(finite.min())) == (high := float(finite.max())):
        return None
    counts = np.histogram(finite, _BINS, (low, high))[0]
    decimals = _DIGITS - int(np.floor(np.log10(high - low)))
    return {
        "name": name,
        "words": to_words(name.removeprefix("in_") if kind == "input" else name, unit),
        "unit": "" if unit == "1" else unit,
        "kind": kind,
        "bounds": list(bounds.get(name, ())),
        "values": [
            round(x, decimals) + 0.0 if math.isfinite(x) else None for x in values[chosen].tolist()
        ],
        "low": low,
        "high": high,
        "counts": counts.tolist(),
    }
