"""Statistics of outcomes with standard errors, deviations from reference values, and the audit.

Only cases with status ``ok`` enter; the others are counted. A NaN in an ``ok`` case means that it
does not have this outcome (the time of a release that did not occur, say): the case is left out of
the statistics of that outcome alone, and their column ``n`` is the number of values used.

The audit checks the quality of the integration of each case: certain columns of the case table,
such as a constraint error, must not exceed bounds.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sepmc.analysis.accumulator_state import Arrays, scalars, set_scalars
from sepmc.analysis.proportions import CONFIDENCE, order_statistics, percentile_ranks

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
    """Histogram of the ``n`` finite values of an outcome, with their mean, sigma, minimum ``low``
    and maximum ``high``: ``counts`` (k,) between increasing ``edges`` (k + 1,). If all values are
    equal to a relative 1e-12, edges and counts are empty."""

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
    """Describe each outcome over the cases with status ``ok``.

    Parameters
    ----------
    cases : DataFrame or other mapping of name to column, shape (n_cases,)
        Columns ``case`` (number), ``status`` (string) and the outcomes in the units of their names.
    outcomes : sequence of str
        Columns to describe.
    reference : mapping of outcome to {"mean", "sigma", "min", "max"}, optional
        Values to compare with, in the outcome's unit; any may be absent.
    confidence : float, optional
        Confidence of the intervals of percentiles.

    Returns
    -------
    DataFrame, one row per outcome
        ``n``; ``mean``, ``sigma`` (divisor n - 1), ``min``, ``max`` and percentiles ``p0_135`` to
        ``p99_865`` (linear between sorted values), in the outcome's unit; the standard errors
        ``mean_se`` = sigma / sqrt(n) and ``sigma_se``, see Notes; ``case_min`` and ``case_max``,
        the numbers of the first cases with the extremes (floats, to allow NaN); ``p0_135_low``,
        ``p0_135_high`` and so on, the sample values that bound a percentile with the
        ``confidence``. Values that need more cases are NaN. With a ``reference`` also its values,
        ``ref_mean`` to ``ref_max``, and the deviations from them, ``dev_mean`` to ``dev_max``, in
        reference sigmas (so ``dev_sigma`` is relative).

    Raises
    ------
    KeyError
        If the case table lacks an outcome.

    Notes
    -----
    Var(s^2) = (mu4 - (n - 3) / (n - 1) sigma^4) / n for any distribution with a fourth moment, so
    se(s) = sqrt(Var(s^2)) / (2 s). The Gaussian s / sqrt(2 n) would be 58 % too large for uniform
    data.
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


def student_half_width(degrees: Any, confidence: float = 0.95) -> Any:
    """Return the half-width of a two-sided confidence interval of a mean, in standard errors.

    Parameters
    ----------
    degrees : float or ndarray
        Degrees of freedom of the standard error (Student's t).
    confidence : float

    Returns
    -------
    float or ndarray, shape of ``degrees``
        NaN where ``degrees`` is not positive.
    """
    from scipy.special import stdtrit  # noqa: PLC0415  (0.1 s that most runs do not need)

    valid = np.where(np.asarray(degrees) > 0, degrees, np.nan)
    return stdtrit(valid, 0.5 + 0.5 * confidence)


def ok_rows(cases: Mapping[str, Any]) -> np.ndarray:
    """Return the mask (n_cases,) that is True for cases with status ``ok``."""
    return np.asarray(cases["status"] == OK)


def column(cases: Any, name: str) -> np.ndarray:
    """Return a column of a case table as floats.

    Parameters
    ----------
    cases : DataFrame or other mapping of name to column
    name : str

    Returns
    -------
    ndarray, shape (n_cases,)
        Missing values of a nullable column are NaN.
    """
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
    """Build the table of `statistics` from a dict of numbers by column for each of the
    ``outcomes``; absent numbers become NaN. With a ``reference``, its columns are added."""
    columns = ["n", "mean", "sigma", "min", "max", *PERCENTILES]
    columns += ["mean_se", "sigma_se", "case_min", "case_max"]
    columns += [f"{name}_{end}" for name in PERCENTILES for end in ("low", "high")]
    # all float: a nullable column would turn NaN into pd.NA
    data = {
        name: np.array(
            [row.get(name, np.nan) for row in rows], dtype="int64" if name == "n" else float
        )
        for name in columns
    }
    if reference is not None:
        data |= _reference_columns(data, outcomes, reference)
    # all columns at once: pandas takes 0.1 s for the first insertion of a column
    return pd.DataFrame(data, index=pd.Index(list(outcomes), name="outcome", dtype="str"))


def histogram(x: np.ndarray) -> Histogram | None:
    """Return the histogram of the finite ones of values ``x`` (n,), None if there are none; see
    `histogram_of` for its bins."""
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
    """Build a histogram of ``n`` finite values with 2 n^(1/3) bins (8 to 60) of equal width, from
    their minimum ``low`` to their maximum ``high``.

    ``mean`` and ``sigma`` become fields of the histogram. ``count`` maps increasing edges (k + 1,)
    to the numbers (k,) of values between them. The histogram has no bins, and the sigma 0 (NaN for
    one value), if the values are equal to a relative 1e-12.
    """
    # a smaller range is round-off, and edges of bins would coincide
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        return Histogram(n, mean, 0.0 if n > 1 else np.nan, low, high, np.empty(0), np.empty(0))
    edges = np.linspace(low, high, int(np.clip(2 * np.cbrt(n), 8, 60)) + 1)
    return Histogram(n, mean, sigma, low, high, edges, count(edges))


def _describe(values: np.ndarray, numbers: np.ndarray, confidence: float) -> dict[str, object]:
    """Return the row of `statistics`, as a dict by column, of an outcome from its values and case
    numbers in the ok cases, each (n_ok,). NaN is left out, and not counted in ``n``; if all values
    are NaN, the row is ``n`` = 0 alone. ``confidence`` is that of the intervals of percentiles."""
    present = ~np.isnan(values)
    x, numbers = values[present], numbers[present]
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
    # a percentile between two infinities is NaN
    with np.errstate(invalid="ignore"):
        row |= dict(zip(PERCENTILES, np.percentile(x, list(PERCENTILES.values())), strict=True))
    row |= percentile_ends(x.size, partial(order_statistics, x), confidence)
    return row | {"case_min": numbers[x.argmin()], "case_max": numbers[x.argmax()]}


def percentile_ends(
    n: int, at_ranks: Callable[[np.ndarray], np.ndarray], confidence: float = CONFIDENCE
) -> dict[str, float]:
    """Return the lower and upper bounds of all `PERCENTILES` by column name, as ``p50_low``.

    Parameters
    ----------
    n : int
        Number of values.
    at_ranks : callable
        Maps zero-based ranks (k,) to the values of these ranks in increasing order.
    confidence : float
        Confidence of each interval.

    Returns
    -------
    dict of str to float
        Bounds that n values cannot give are absent.
    """
    ranks: dict[str, int] = {}
    for name, percent in PERCENTILES.items():
        low, high = percentile_ranks(n, percent / 100.0, confidence)
        ranks |= {f"{name}_low": low, f"{name}_high": high}
    existing = {name: rank for name, rank in ranks.items() if 0 <= rank < n}
    return dict(zip(existing, at_ranks(np.array(list(existing.values()), dtype=int)), strict=True))


def _moments(x: np.ndarray) -> tuple[float, float, float, float]:
    """Return mean, sigma, standard error of the mean and standard error of sigma of values (n,),
    n >= 1, none of them NaN; all but the mean are NaN for one value, or if a value is infinite."""
    n, low, span = x.size, x.min(), np.ptp(x)
    if n == 1:
        return float(low), np.nan, np.nan, np.nan
    # the rounded mean of equal values need not equal them, which would give a sigma of 1e-17
    if span == 0.0:
        return float(low), 0.0, 0.0, 0.0
    # an infinity in an ok row gives mean inf, sigma NaN
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
    """Return the columns ``ref_*`` of reference values and ``dev_*`` of deviations from them, each
    (n_outcomes,). ``data`` are the columns of `statistics`. A deviation is a value of ``data``
    minus that of the reference, in sigmas of the reference. Values that the reference does not
    contain give NaN; so do deviations if it contains no sigma above 0."""
    known = {
        name: np.array(
            [float(reference.get(outcome, {}).get(name, np.nan)) for outcome in outcomes]
        )
        for name in REFERENCED
    }
    # no deviations in units of a zero sigma
    scale = np.where(known["sigma"] > 0.0, known["sigma"], np.nan)
    deviations = {f"dev_{name}": (data[name] - known[name]) / scale for name in REFERENCED}
    return {f"ref_{name}": values for name, values in known.items()} | deviations


def status_counts(cases: Mapping[str, Any]) -> dict[str, int]:
    """Count the cases of each status: ``ok`` first (0 if there is none), then the others by
    frequency."""
    counts = {
        str(status): int(count)
        for status, count in pd.Series(cases["status"]).value_counts(dropna=False).items()
        if count
    }
    return {OK: counts.pop(OK, 0)} | counts


class AuditSummary:
    """Accumulator for the audit of one column: its ``worst`` value with the first ``case`` that has
    it, its ``bound`` (NaN: none), and the number of cases ``beyond`` the bound.

    The worst value is the largest, or the smallest of a column whose name begins with ``smallest``;
    NaN is worse than any number and beyond any bound; without a bound ``beyond`` is 0. Without
    cases ``worst`` is NaN and ``case`` -1.
    """

    def __init__(self, name: str, bounds: Mapping[str, float]):
        self.bound, self._is_minimum = bounds.get(name, np.nan), name.startswith("smallest")
        self.worst, self.case, self.beyond, self._rank = np.nan, -1, 0, -np.inf

    def add(self, x: np.ndarray, numbers: np.ndarray) -> None:
        """Add values (n,) of ok cases and their case numbers (n,), in increasing order and above
        those already added. The worst value is the largest, or the smallest of a column whose
        name begins with ``smallest``; NaN is worse still, and beyond any bound."""
        if not x.size:
            return
        order = -x if self._is_minimum else x
        at = int(order.argmax())  # the first NaN, if any
        rank = np.inf if np.isnan(x[at]) else float(order[at])
        if self.case < 0 or rank > self._rank:
            self.worst, self.case, self._rank = float(x[at]), int(numbers[at]), rank
        if not np.isnan(self.bound):
            self.beyond += int(np.count_nonzero(~(x <= self.bound)))

    def new_partial(self) -> "AuditSummary":
        """Return an empty summary of the same column for later cases, to pass to `merge`."""
        empty = copy(self)
        empty.worst, empty.case, empty.beyond, empty._rank = np.nan, -1, 0, -np.inf
        return empty

    def state(self) -> list[np.ndarray]:
        """Return what was accumulated so far as float arrays, which `restore` takes."""
        return [scalars(self)]

    def restore(self, arrays: Arrays) -> None:
        """Replace what was accumulated by the array of `state`, the next one of the iterator
        ``arrays``. Raises ValueError if it has another length or no number where a count is
        expected (`set_scalars`), and StopIteration if there is no array left."""
        set_scalars(self, next(arrays))

    def merge(self, others: "AuditSummary") -> None:
        """Add the summary of other cases, which follow those already added."""
        if others.case >= 0 and (self.case < 0 or others._rank > self._rank):
            self.worst, self.case, self._rank = others.worst, others.case, others._rank
        self.beyond += others.beyond


def audit(
    cases: Mapping[str, Any], bounds: Mapping[str, float], columns: Sequence[str]
) -> pd.DataFrame:
    """Audit the integration of the ok cases of a case table.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
    bounds : mapping of column to bound
        Largest value that passes, for columns that have a bound.
    columns : sequence of str
        Audit columns; those that the case table lacks are left out.

    Returns
    -------
    DataFrame, one row for each audit column in the case table
        Indexed by name of the column: ``worst`` (the largest value, of ``smallest_pivot`` the
        smallest; NaN if any value is NaN), ``case`` (number of the first case that has it),
        ``bound`` (NaN: none), ``beyond`` (number of ok cases whose value is above the bound or NaN;
        0 without a bound). Without ok cases ``worst`` is NaN and ``case`` -1.
    """
    ok = ok_rows(cases)
    numbers = np.asarray(cases["case"])[ok]
    summaries = {name: AuditSummary(name, bounds) for name in columns if name in cases}
    for name, summary in summaries.items():
        summary.add(column(cases, name)[ok], numbers)
    return audit_table(summaries)


def audit_table(summaries: Mapping[str, AuditSummary]) -> pd.DataFrame:
    """Build the table that `audit` returns, with the columns ``worst``, ``case``, ``bound`` and
    ``beyond`` (number of cases), from the summary of each audit column, by name."""
    rows = {name: [one.worst, one.case, one.bound, one.beyond] for name, one in summaries.items()}
    return pd.DataFrame.from_dict(
        rows, orient="index", columns=["worst", "case", "bound", "beyond"]
    )


def percentile_curves(histories: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return percentiles of a quantity over the cases, for each time; times are rounded to 1e-9 s,
    and those that are then equal count as one.

    Parameters
    ----------
    histories : DataFrame, long form
        Columns ``case``, ``time_s`` and ``column``: a row per case and time, without failed cases.
    column : str
        Name of the column of the quantity; NaN is left out.

    Returns
    -------
    DataFrame, shape (n_times, 8)
        Indexed by increasing ``time_s`` in s: ``min``, ``p1``, ``p5``, ``p50``, ``p95``, ``p99``,
        ``max``, ``mean``, in the column's unit.
    """
    # sums of steps differ by round-off from case to case; nanoseconds identify a time
    time = histories["time_s"].round(9)
    grouped = histories[column].astype(float).groupby(time)
    curves = grouped.agg(["min", "max", "mean"])
    inner = ["p1", "p5", "p50", "p95", "p99"]
    quantiles = grouped.quantile(np.array([PERCENTILES[name] for name in inner]) / 100.0).unstack()
    curves[inner] = quantiles.to_numpy().reshape(len(curves), len(inner))
    return curves[["min", *inner, "max", "mean"]].rename_axis("time_s")
