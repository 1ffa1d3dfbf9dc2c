"""Sample statistics of a campaign's outcomes, how sure they are, and how they lie beside reference
figures.

Rows whose status is not ``ok`` never enter; they are counted. A NaN in an ``ok`` row is an outcome
that case does not have (no release time, say): it is left out of that outcome alone, and the column
``n`` says how many values stand behind every figure of the row.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars
from sepmc.analysis.proportions import (
    CONFIDENCE,
    order_statistics,
    percentile_ranks,
)

OK = "ok"
TWO_SIDED = 1.959963984540054  # normal quantile of 97.5 %
PERCENTILES = {
    "p0_135": 0.135,
    "p1": 1.0,
    "p5": 5.0,
    "p50": 50.0,
    "p95": 95.0,
    "p99": 99.0,
    "p99_865": 99.865,
}
REFERENCED = ("mean", "sigma", "min", "max")


class Histogram(NamedTuple):
    """How the n finite values of an outcome lie: cases between rising edges. Values that are all
    equal have no edges and no counts."""

    n: int
    mean: float
    sigma: float
    low: float
    high: float
    edges: np.ndarray
    counts: np.ndarray


def statistics(
    cases: Mapping[str, Any],
    outcomes: Sequence[str],
    reference: Mapping[str, Mapping[str, float]] | None = None,
    confidence: float = CONFIDENCE,
) -> pd.DataFrame:
    """Describe each outcome over the cases whose status is ``ok``.

    Parameters
    ----------
    cases : DataFrame or other mapping of name to column, shape (n_cases,)
        Columns ``case`` (number), ``status`` (string) and the outcomes, each in the unit its name
        ends with.
    outcomes : sequence of str
        Columns to describe.
    reference : mapping of outcome to {"mean", "sigma", "min", "max"}, optional
        Figures to compare with, in the outcome's unit; any of the four, or the outcome itself, may
        be absent.
    confidence : float, optional
        Of the intervals of percentiles.

    Returns
    -------
    DataFrame, one row per outcome
        ``n``; ``mean``, ``sigma`` (divisor n - 1), ``min``, ``max`` and percentiles ``p0_135`` to
        ``p99_865`` (linear between order statistics: sample percentiles), in
        the outcome's unit; ``mean_se`` = sigma / sqrt(n) and ``sigma_se``, see Notes; ``case_min``
        and ``case_max``, the numbers of the (first) cases with the extremes, floats so that they
        can be NaN too; ``p0_135_low``, ``p0_135_high`` and so on, the order statistics that hold
        that percentile of the law between them with the ``confidence``. What needs more values than
        there are is NaN. With ``reference`` also ``ref_*``, and deviations here minus reference:
        ``dev_mean``, ``dev_min``, ``dev_max`` in reference sigmas, ``dev_sigma`` relative (0.01 is
        one percent).

    Notes
    -----
    Var(s^2) = (mu4 - (n - 3) / (n - 1) sigma^4) / n for any law with a fourth moment, so se(s) =
    sqrt(Var(s^2)) / (2 s). The Gaussian s / sqrt(2 n) would be 58 % too large for uniform data.
    Checked against repeated sampling in the tests.
    """
    missing = [name for name in outcomes if name not in cases]
    if missing:
        raise KeyError(f"the case table has no column {', '.join(missing)}")
    ok = ok_rows(cases)
    numbers = np.asarray(cases["case"])[ok]
    return statistics_table(
        [_describe(column(cases, name)[ok], numbers, confidence) for name in outcomes],
        outcomes,
        reference,
    )


def student_half_width(freedoms: Any, confidence: float = 0.95) -> Any:
    """Half the width of a two-sided interval of a mean, in standard errors that were estimated with
    so many degrees of freedom (Student's t); shape of ``freedoms``, NaN of those below 1."""
    from scipy.special import stdtrit  # noqa: PLC0415  (0.1 s that most runs do not need)

    known = np.where(np.asarray(freedoms) > 0, freedoms, np.nan)
    return stdtrit(known, 0.5 + 0.5 * confidence)


def ok_rows(cases: Mapping[str, Any]) -> np.ndarray:
    """Which cases count, shape (n_cases,), bool."""
    return np.asarray(cases["status"] == OK)


def column(cases: Any, name: str) -> np.ndarray:
    """A column of a case table as floats; what a nullable column lacks is NaN."""
    values = cases[name]
    return (
        values.to_numpy(dtype=float, na_value=np.nan)
        if isinstance(values, pd.Series)
        else np.asarray(values, dtype=float)
    )


def statistics_table(
    rows: Sequence[Mapping[str, object]],
    outcomes: Sequence[str],
    reference: Mapping[str, Mapping[str, float]] | None,
) -> pd.DataFrame:
    """The table of `statistics` from a row for each outcome."""
    columns = [
        "n",
        "mean",
        "sigma",
        "min",
        "max",
        *PERCENTILES,
        "mean_se",
        "sigma_se",
        "case_min",
        "case_max",
        *(f"{name}_{end}" for name in PERCENTILES for end in ("low", "high")),
    ]
    # all float: a nullable column would turn the NaN of a row into pd.NA
    data = {
        name: np.array(
            [row.get(name, np.nan) for row in rows], dtype="int64" if name == "n" else float
        )
        for name in columns
    }
    if reference is not None:
        data |= _reference_columns(data, outcomes, reference)
    # all columns at once: the first insertion of one more name takes pandas 0.1 s
    return pd.DataFrame(data, index=pd.Index(list(outcomes), name="outcome", dtype="str"))


def histogram(x: np.ndarray) -> Histogram | None:
    """Histogram of the finite values among x, shape (n,), or None if there are none."""
    x = x[np.isfinite(x)]
    if not x.size:
        return None
    mean, sigma = _moments(x)[:2]
    return histogram_of(
        x.size, mean, sigma, float(x.min()), float(x.max()), lambda edges: np.histogram(x, edges)[0]
    )


def histogram_of(
    n: int,
    mean: float,
    sigma: float,
    low: float,
    high: float,
    count: Callable[[np.ndarray], np.ndarray],
) -> Histogram:
    """Histogram with as many bins as n values fill; ``count`` gives the cases between edges."""
    # below that it is round-off, and the edges of the bins would coincide
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        return Histogram(n, mean, 0.0 if n > 1 else np.nan, low, high, np.empty(0), np.empty(0))
    edges = np.linspace(low, high, int(np.clip(2 * np.cbrt(n), 8, 60)) + 1)
    return Histogram(n, mean, sigma, low, high, edges, count(edges))


def _describe(values: np.ndarray, numbers: np.ndarray, confidence: float) -> dict[str, object]:
    """One row of the table from one outcome's values, shape (n_ok,), and the case numbers they
    belong to."""
    there = ~np.isnan(values)
    x, numbers = values[there], numbers[there]
    if x.size == 0:
        return {"n": 0}
    mean, sigma, mean_se, sigma_se = _moments(x)
    row = {
        "n": x.size,
        "mean": mean,
        "sigma": sigma,
        "min": x.min(),
        "max": x.max(),
        "mean_se": mean_se,
        "sigma_se": sigma_se,
    }
    # between two infinities there is no number, and the table then says NaN
    with np.errstate(invalid="ignore"):
        row |= dict(zip(PERCENTILES, np.percentile(x, list(PERCENTILES.values())), strict=True))
    row |= percentile_ends(x.size, partial(order_statistics, x), confidence)
    return row | {"case_min": numbers[x.argmin()], "case_max": numbers[x.argmax()]}


def percentile_ends(
    n: int, ranked: Callable[[np.ndarray], np.ndarray], confidence: float = CONFIDENCE
) -> dict[str, float]:
    """Intervals of the percentiles, by name: order statistics that hold each with a ``confidence``,
    of values ``ranked`` by rising places; an end that n values cannot give is NaN."""
    places: dict[str, int] = {}
    for name, percent in PERCENTILES.items():
        low, high = percentile_ranks(n, percent / 100.0, confidence)
        places |= {f"{name}_low": low, f"{name}_high": high}
    there = {name: place for name, place in places.items() if 0 <= place < n}
    return dict(zip(there, ranked(np.array(list(there.values()), dtype=int)), strict=True))


def _moments(x: np.ndarray) -> tuple[float, float, float, float]:
    """Mean, sigma and the standard errors of both, from values of shape (n,), n >= 1."""
    n, low, span = x.size, x.min(), np.ptp(x)
    if n == 1:
        return float(low), np.nan, np.nan, np.nan
    # the rounded mean of equal values need not equal them, and would leave a sigma of some 1e-17
    if span == 0.0:
        return float(low), 0.0, 0.0, 0.0
    # an infinity in an ok row stays visible: mean inf, sigma NaN
    with np.errstate(invalid="ignore"):
        mean = x.mean()
        # of order 1, so that the fourth power neither overflows nor underflows
        c = (x - mean) / span
        c *= c
        variance, fourth = c.sum() / (n - 1), np.mean(c * c)
        sigma = np.sqrt(variance)
        # (n - 3) n^2 < (n - 1)^3 and fourth >= mean(c)^2 keep the bracket positive
        sigma_se = np.sqrt((fourth - (n - 3) / (n - 1) * variance**2) / n) / (2.0 * sigma)
    return (
        float(mean),
        float(sigma * span),
        float(sigma * span / np.sqrt(n)),
        float(sigma_se * span),
    )


def _reference_columns(
    data: Mapping[str, np.ndarray],
    outcomes: Sequence[str],
    reference: Mapping[str, Mapping[str, float]],
) -> dict[str, np.ndarray]:
    """The reference figures and the deviations from them; absent ones are NaN."""
    given = {
        name: np.array(
            [float(reference.get(outcome, {}).get(name, np.nan)) for outcome in outcomes]
        )
        for name in REFERENCED
    }
    # deviations in units of nothing do not exist
    scale = np.where(given["sigma"] > 0.0, given["sigma"], np.nan)
    deviations = {f"dev_{name}": (data[name] - given[name]) / scale for name in REFERENCED}
    return {f"ref_{name}": values for name, values in given.items()} | deviations


def status_counts(cases: Mapping[str, Any]) -> dict[str, int]:
    """Count the cases of each status: ``ok`` first (0 if there is none), then the failures, most
    frequent first. Sums to the rows."""
    counts = {
        str(status): int(count)
        for status, count in pd.Series(cases["status"]).value_counts(dropna=False).items()
        if count
    }
    return {OK: counts.pop(OK, 0)} | counts


class AuditSummary:
    """The worst value of an audit column and the number of cases beyond its bound; NaN is worse
    than any number."""

    def __init__(self, name: str, bounds: Mapping[str, float]):
        self.bound, self._smallest = bounds.get(name, np.nan), name.startswith("smallest")
        self.worst, self.case, self.beyond, self._rank = np.nan, -1, 0, -np.inf

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Take values of ok cases, shape (n,), and the numbers of these cases, rising."""
        if not x.size:
            return
        order = -x if self._smallest else x
        at = int(order.argmax())  # of the first NaN, if there is one
        rank = np.inf if np.isnan(x[at]) else float(order[at])
        if self.case < 0 or rank > self._rank:
            self.worst, self.case, self._rank = float(x[at]), int(numbers[at]), rank
        if not np.isnan(self.bound) and not x[at] <= self.bound:
            self.beyond += int(np.count_nonzero(~(x <= self.bound)))

    def new_partial(self) -> "AuditSummary":
        """What counts other cases for this one to `merge`."""
        found = copy(self)
        found.worst, found.case, found.beyond, found._rank = np.nan, -1, 0, -np.inf
        return found

    def state(self) -> list[np.ndarray]:
        """What it holds, for `restore`."""
        return [scalars(self)]

    def restore(self, arrays: Arrays) -> None:
        """Hold what another one held."""
        set_scalars(self, next(arrays))

    def merge(self, others: "AuditSummary") -> None:
        """Take cases that come next, which others counted."""
        if others.case >= 0 and (self.case < 0 or others._rank > self._rank):
            self.worst, self.case, self._rank = others.worst, others.case, others._rank
        self.beyond += others.beyond


def audit(
    cases: Mapping[str, Any], bounds: Mapping[str, float], columns: Sequence[str]
) -> pd.DataFrame:
    """How well the ok cases of a case table were integrated.

    Returns
    -------
    table : DataFrame, one row for each of ``columns`` that the case table has
        worst (the largest value; of smallest_pivot the smallest), case (the first that has it),
        bound (NaN: none), beyond (number of ok cases whose value is above it or NaN).
    """
    ok = ok_rows(cases)
    numbers = np.asarray(cases["case"])[ok]
    found = {name: AuditSummary(name, bounds) for name in columns if name in cases}
    for name, worst in found.items():
        worst.add(column(cases, name)[ok], numbers)
    return audit_table(found)


def audit_table(found: Mapping[str, AuditSummary]) -> pd.DataFrame:
    """The table of `audit`."""
    rows = {name: [w.worst, w.case, w.bound, w.beyond] for name, w in found.items()}
    return pd.DataFrame.from_dict(
        rows, orient="index", columns=["worst", "case", "bound", "beyond"]
    )


def percentile_curves(histories: pd.DataFrame, column: str) -> pd.DataFrame:
    """Spread of a quantity over the cases, at each time.

    Parameters
    ----------
    histories : DataFrame, long form
        Columns ``case``, ``time_s`` and ``column``: one row per case and time. Rows of failed cases
        are the caller's to leave out.
    column : str
        The quantity. NaN is left out of its time.

    Returns
    -------
    DataFrame, shape (n_times, 8)
        Indexed by ``time_s`` in s, ascending: ``min``, ``p1``, ``p5``, ``p50``, ``p95``, ``p99``,
        ``max``, ``mean``, in the column's unit.
    """
    # cases may reach one time by different sums; nobody asks for less than a nanosecond
    time = histories["time_s"].round(9)
    grouped = histories[column].astype(float).groupby(time)
    curves = grouped.agg(["min", "max", "mean"])
    inner = ["p1", "p5", "p50", "p95", "p99"]
    quantiles = grouped.quantile(np.array([PERCENTILES[name] for name in inner]) / 100.0).unstack()
    curves[inner] = quantiles.to_numpy().reshape(len(curves), len(inner))
    return curves[["min", *inner, "max", "mean"]].rename_axis("time_s")
