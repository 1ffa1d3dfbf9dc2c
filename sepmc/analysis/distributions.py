"""Distribution fits of outcomes: shape, test of normality, and the nearest of six distributions.

Each distribution has two parameters, fitted by maximum likelihood; the nearest is the one of
largest likelihood, and so by any information criterion. The goodness of fit is the Anderson-Darling
statistic, which gives weight to the tails, with critical values for parameters estimated from the
same cases (Stephens in D'Agostino and Stephens, Goodness-of-Fit Techniques, Dekker 1986, tables
4.7, 4.17 and 4.22). `scipy.stats.anderson` limits the p value of a normal distribution to 0.15,
where this table reaches 0.25.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import PERCENTILES, column, ok_rows
from sepmc.analysis.statistics_text import WIDTH, aligned, rounded

MIN_CASES = 20  # an outcome with fewer values is not fitted
LEVEL = 0.05  # p value at or below which a distribution is reported not to fit
ENDS = ("p0_135", "p99_865")  # mean -+ 3 sigma of a normal distribution
_NORMAL = {0.25: 0.470, 0.15: 0.561, 0.1: 0.631, 0.05: 0.752, 0.025: 0.873, 0.01: 1.035}
_LOGISTIC = {0.25: 0.426, 0.1: 0.563, 0.05: 0.660, 0.025: 0.769, 0.01: 0.906}
_EXTREME = {0.25: 0.474, 0.1: 0.637, 0.05: 0.757, 0.025: 0.877, 0.01: 1.038}


@dataclass(frozen=True)
class Distribution:
    """Location-scale distribution to fit to values of an outcome, or to their logarithms.

    Parameters
    ----------
    scipy_name : str
        Name in `scipy.stats`.
    points : mapping of float to float
        Critical value of the Anderson-Darling statistic, for many cases, by p value.
    of_logarithm : bool
        True if the logarithms of the values, rather than the values, have the distribution.
    """

    scipy_name: str
    points: Mapping[float, float]
    of_logarithm: bool = False

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return the variable (n,) that has the distribution: the values (n,), or their natural
        logarithms if ``of_logarithm``."""
        return np.log(values) if self.of_logarithm else values

    def frozen(self, location: float, scale: float) -> Any:
        """Return the frozen `scipy.stats` distribution with this location and scale; it is that of
        the logarithms of the values if ``of_logarithm``."""
        from scipy import stats  # noqa: PLC0415  (1 s)

        return getattr(stats, self.scipy_name)(location, scale)

    def fit(self, values: np.ndarray) -> tuple[float, float]:
        """Return the location and scale that have maximum likelihood for values (n,), or for their
        logarithms if ``of_logarithm``."""
        from scipy import stats  # noqa: PLC0415

        location, scale = getattr(stats, self.scipy_name).fit(self(values))
        return float(location), float(scale)

    def probability(self, statistic: float, n: int) -> float:
        """Return the p value of an Anderson-Darling statistic of a fit to n cases; below 0.01 and
        above 0.25 these limits are returned."""
        adjustments = {"norm": 0.75 / n + 2.25 / n**2, "logistic": 0.25 / n}
        adjusted = statistic * (1.0 + adjustments.get(self.scipy_name, 0.2 / np.sqrt(n)))
        levels = np.array(list(self.points))
        p = np.exp(np.interp(adjusted, list(self.points.values()), np.log(levels)))
        return round(float(p), 4)


DISTRIBUTIONS = {
    "normal": Distribution("norm", _NORMAL),
    "lognormal": Distribution("norm", _NORMAL, of_logarithm=True),
    "Weibull": Distribution("gumbel_l", _EXTREME, of_logarithm=True),
    "extreme value, largest": Distribution("gumbel_r", _EXTREME),
    "extreme value, smallest": Distribution("gumbel_l", _EXTREME),
    "logistic": Distribution("logistic", _LOGISTIC),
}
COLUMNS = (
    "n", "skewness", "skewness_se", "kurtosis", "kurtosis_se", "normal_p", "distribution",
    "location", "scale", "p", *ENDS,
)  # fmt: skip


# reported in place of a distribution
CONSTANT, DISCRETE, TOO_FEW = "constant", "discrete", "too few cases"
_NOT_FITTED = (CONSTANT, DISCRETE, TOO_FEW)


def fit_distributions(
    cases: Mapping[str, Any], outcomes: Sequence[str], constant: Collection[str] = ()
) -> pd.DataFrame:
    """Describe the shape of each outcome over the ``ok`` cases and fit the nearest distribution.

    Parameters
    ----------
    cases : DataFrame or other mapping of name to column, shape (n_cases,)
        ``status`` and the outcomes.
    outcomes : sequence of str
        Columns to describe.
    constant : collection of str
        Constant outcomes, whose scatter numerical error can explain
        (`sepmc.analysis.constant_outcomes`).

    Returns
    -------
    DataFrame, one row per outcome
        ``n``, the number of finite values; ``skewness`` and excess ``kurtosis``, with the standard
        errors ``skewness_se`` and ``kurtosis_se`` that they have in normal samples; ``normal_p``,
        the p value of a normal distribution; ``distribution``, a key of `DISTRIBUTIONS`: the
        nearest one (of largest likelihood), its ``location`` and ``scale`` (of the logarithm for
        lognormal and Weibull), its p value ``p``, and its quantiles ``p0_135`` and ``p99_865`` in
        the outcome's unit.
        P values are limited to 0.01 and 0.25. ``distribution`` is `CONSTANT` for the ``constant``
        outcomes, `TOO_FEW` for one with fewer than `MIN_CASES` values and `DISCRETE` for one with
        fewer than n / 2 distinct values; all other columns but ``n`` are then NaN.
    """
    ok = ok_rows(cases)
    table_rows = [
        {"n": int(np.isfinite(column(cases, name)[ok]).sum()), "distribution": CONSTANT}
        if name in constant
        else _fit_nearest(column(cases, name)[ok])
        for name in outcomes
    ]
    return pd.DataFrame(table_rows, index=pd.Index(outcomes, name="outcome"), columns=list(COLUMNS))


def _fit_nearest(values: np.ndarray) -> dict[str, Any]:
    """Return the row of `fit_distributions`, by column, for the values (n,) of one outcome; columns
    that would be NaN are absent, and values that are not finite are left out."""
    x = np.sort(values[np.isfinite(values)])
    n = len(x)
    row: dict[str, Any] = {"n": n, "distribution": ""}
    if n < MIN_CASES:
        return row | {"distribution": TOO_FEW}
    if 2 * len(np.unique(x)) < n:
        return row | {"distribution": DISCRETE}
    z = (x - x.mean()) / x.std()
    row |= {
        "skewness": (z**3).mean(),
        # exact for normal cases (Fisher, Proc. R. Soc. A 130, 1930)
        "skewness_se": np.sqrt(6.0 * (n - 2) / ((n + 1.0) * (n + 3))),
        "kurtosis": (z**4).mean() - 3.0,
        "kurtosis_se": np.sqrt(24.0 * n * (n - 2) * (n - 3) / ((n + 3.0) * (n + 5))) / (n + 1),
    }
    best_likelihood = -np.inf
    for name, distribution in DISTRIBUTIONS.items():
        if distribution.of_logarithm and x[0] <= 0.0:
            continue
        location, scale = distribution.fit(x)
        fitted, y = distribution.frozen(location, scale), distribution(x)
        p = distribution.probability(_anderson_darling(fitted, y), n)
        if name == "normal":
            row["normal_p"] = p
        likelihood = fitted.logpdf(y).sum() - (y.sum() if distribution.of_logarithm else 0.0)
        if likelihood > best_likelihood:
            best_likelihood = likelihood
            tails = fitted.ppf([PERCENTILES[end] / 100.0 for end in ENDS])
            tails = np.exp(tails) if distribution.of_logarithm else tails
            row |= {"distribution": name, "location": location, "scale": scale, "p": p}
            row |= zip(ENDS, tails, strict=True)
    return row


def _anderson_darling(distribution: Any, x: np.ndarray) -> float:
    """Return the Anderson-Darling statistic A^2 of values (n,), in increasing order, for a frozen
    `scipy.stats` distribution."""
    n = len(x)
    weights = (2.0 * np.arange(1, n + 1) - 1.0) / n
    return float(-n - weights @ (distribution.logcdf(x) + distribution.logsf(x[::-1])))


def render_fits(
    fits: pd.DataFrame,
    statistics: pd.DataFrame,
    units: Mapping[str, str],
    width: int = WIDTH,
    sampler: str = "random",
) -> str:
    """Render the fits of outcomes as a text table with a row per outcome, and notes below it.

    Parameters
    ----------
    fits : DataFrame
        From `fit_distributions`.
    statistics : DataFrame
        Table of `sepmc.analysis.statistics.statistics` for the same cases.
    units : mapping of outcome to unit
    width : int
        Largest number of characters in a line.
    sampler : str
        Value of ``run.sampler``; a note follows if its cases are not independent.

    Returns
    -------
    str
        The nearest distribution is ``none (NAME)`` if its p value is at most `LEVEL`.
    """
    rows = [["outcome", "unit", "skewness", "kurtosis", "normal, p", "nearest distribution", "p"]]
    for end in ENDS:
        rows[0] += [f"{PERCENTILES[end]:g} %: fitted", "cases (95 %)"]
    sample = statistics.loc[list(fits.index)]
    for (outcome, row), (_, statistic_row) in zip(fits.iterrows(), sample.iterrows(), strict=True):
        name_of_fit = str(row["distribution"])
        cells = [str(outcome), units.get(str(outcome), "")]
        if name_of_fit == CONSTANT:
            rows.append([*cells, *3 * ["-"], CONSTANT, *5 * ["-"]])
            continue
        if name_of_fit in _NOT_FITTED:
            intervals = [part for end in ENDS for part in ("-", _interval(statistic_row, end))]
            rows.append([*cells, *3 * ["-"], name_of_fit, "-", *intervals])
            continue
        cells += [f"{row[k]:.2f} +- {row[f'{k}_se']:.2f}" for k in ("skewness", "kurtosis")]
        cells += [_probability(row["normal_p"])]
        cells += [
            name_of_fit if row["p"] > LEVEL else f"none ({name_of_fit})",
            _probability(row["p"]),
        ]
        for end in ENDS:
            cells += [rounded(row[end], statistic_row["sigma"]), _interval(statistic_row, end)]
        rows.append(cells)
    lines = [line.rstrip() for line in aligned(rows, width)]
    lines += [
        "",
        "+-: one standard error for normal cases; larger for heavier tails.",
        fill(
            "p: probability that as many cases of that distribution deviate from it at least as "
            "much (Anderson-Darling). More cases detect smaller deviations.",
            width,
        ),
    ]
    if sampler != "random":
        lines += [
            f"Cases of run.sampler = '{sampler}' are not independent: p is not a probability."
        ]
    return "\n".join(lines)


def _probability(p: float) -> str:
    """Format a p value with two decimals, or as ``> 0.25`` or ``< 0.01`` at the ends of the
    tabulated range."""
    return "> 0.25" if p >= max(_NORMAL) else "< 0.01" if p <= min(_NORMAL) else f"{p:.2f}"


def _interval(row: pd.Series, end: str) -> str:
    """Format the 95 % interval of a percentile of the cases as ``low to high``, or as ``too few``
    cases to give it; ``row`` is a row of statistics, ``end`` the name of the percentile."""
    ends = [row[f"{end}_low"], row[f"{end}_high"]]
    if not np.isfinite(ends).all():
        return "too few"
    return " to ".join(rounded(end, row["sigma"]) for end in ends)
