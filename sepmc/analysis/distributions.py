"""Which law an outcome follows: its shape, whether it may be normal, and the nearest of some laws.

Laws have two parameters each, fitted by maximum likelihood, so that the likeliest of them is the
nearest by any criterion of information. How well a law fits is told by Anderson and Darling's
statistic, which weighs the tails, with the points that hold where both parameters come from the
same cases (Stephens in D'Agostino and Stephens, Goodness-of-Fit Techniques, Dekker 1986, tables
4.7, 4.17 and 4.22); held to simulation in the tests.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.statistics import PERCENTILES, WIDTH, aligned, column, ok_rows, rounded

MIN_CASES = 20  # cases from which anything is told
LEVEL = 0.05  # below which a law is said not to fit
ENDS = ("p0_135", "p99_865")  # three sigmas of a normal law from its mean
_NORMAL = {0.25: 0.470, 0.15: 0.561, 0.1: 0.631, 0.05: 0.752, 0.025: 0.873, 0.01: 1.035}
_LOGISTIC = {0.25: 0.426, 0.1: 0.563, 0.05: 0.660, 0.025: 0.769, 0.01: 0.906}
_EXTREME = {0.25: 0.474, 0.1: 0.637, 0.05: 0.757, 0.025: 0.877, 0.01: 1.038}


@dataclass(frozen=True)
class Distribution:
    """A law with a location and a scale, by its name in scipy; of the values, or of their
    logarithms. ``points`` are of the statistic by probability, for many cases."""

    scipy_name: str
    points: Mapping[float, float]
    of_logarithm: bool = False

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """What is location and scale of: values (n,), or their logarithms."""
        return np.log(values) if self.of_logarithm else values

    def frozen(self, location: float, scale: float) -> Any:
        """The law with its parameters."""
        from scipy import stats  # noqa: PLC0415  (1 s)

        return getattr(stats, self.scipy_name)(location, scale)

    def fit(self, values: np.ndarray) -> tuple[float, float]:
        """Location and scale of greatest likelihood."""
        from scipy import stats  # noqa: PLC0415

        location, scale = getattr(stats, self.scipy_name).fit(self(values))
        return float(location), float(scale)

    def probability(self, statistic: float, n: int) -> float:
        """How likely n cases of the law lie as far from the one fitted to them, between 0.01 and
        0.25, which stand for what is beyond."""
        more = {"norm": 0.75 / n + 2.25 / n**2, "logistic": 0.25 / n}
        reached = statistic * (1.0 + more.get(self.scipy_name, 0.2 / np.sqrt(n)))
        levels = np.array(list(self.points))
        p = np.exp(np.interp(reached, list(self.points.values()), np.log(levels)))
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
    "n", "skewness", "skewness_se", "kurtosis", "kurtosis_se", "normal_p", "law", "location",
    "scale", "p", *ENDS,
)  # fmt: skip


CONSTANT = "constant"  # in place of a law


def fit_distributions(
    cases: Mapping[str, Any], outcomes: Sequence[str], constant: Collection[str] = ()
) -> pd.DataFrame:
    """Shape of each outcome over the cases whose status is ``ok``, and the law nearest to it.

    Parameters
    ----------
    cases : DataFrame or other mapping of name to column, shape (n_cases,)
        ``status`` and the outcomes.
    outcomes : sequence of str
        Columns to describe.
    constant : collection of str
        Those whose values differ by no more than their numerical error
        (`sepmc.analysis.constant_outcomes`); their law is `CONSTANT`, without numbers.

    Returns
    -------
    DataFrame, one row per outcome
        ``n``; ``skewness`` and ``kurtosis`` (excess: 0 of a normal law), with standard errors of
        normal cases; ``normal_p``, how likely so many cases of a normal law lie as far from it;
        the nearest ``law``, its ``location`` and ``scale`` (of the logarithm if it is lognormal or
        Weibull), its ``p``, and its points ``p0_135`` and ``p99_865``, in the outcome's unit.
        Probabilities stop at 0.01 and 0.25, which stand for what is beyond. An outcome with fewer
        than `MIN_CASES` values, or most of them equal to others, has no law.
    """
    ok = ok_rows(cases)
    rows = [
        {"n": int(np.isfinite(column(cases, name)[ok]).sum()), "law": CONSTANT}
        if name in constant
        else _fit_nearest(column(cases, name)[ok])
        for name in outcomes
    ]
    return pd.DataFrame(rows, index=pd.Index(outcomes, name="outcome"), columns=list(COLUMNS))


def _fit_nearest(values: np.ndarray) -> dict[str, Any]:
    x = np.sort(values[np.isfinite(values)])
    n = len(x)
    found: dict[str, Any] = {"n": n, "law": ""}
    if n < MIN_CASES or 2 * len(np.unique(x)) < n:
        return found
    z = (x - x.mean()) / x.std()
    found |= {
        "skewness": (z**3).mean(),
        # of normal cases, exact (Fisher, Proc. R. Soc. A 130, 1930)
        "skewness_se": np.sqrt(6.0 * (n - 2) / ((n + 1.0) * (n + 3))),
        "kurtosis": (z**4).mean() - 3.0,
        "kurtosis_se": np.sqrt(24.0 * n * (n - 2) * (n - 3) / ((n + 3.0) * (n + 5))) / (n + 1),
    }
    likeliest = -np.inf
    for name, law in DISTRIBUTIONS.items():
        if law.of_logarithm and x[0] <= 0.0:
            continue
        location, scale = law.fit(x)
        with_parameters, y = law.frozen(location, scale), law(x)
        p = law.probability(_anderson_darling(with_parameters, y), n)
        if name == "normal":
            found["normal_p"] = p
        likelihood = with_parameters.logpdf(y).sum() - (y.sum() if law.of_logarithm else 0.0)
        if likelihood > likeliest:
            likeliest = likelihood
            ends = with_parameters.ppf([PERCENTILES[end] / 100.0 for end in ENDS])
            ends = np.exp(ends) if law.of_logarithm else ends
            found |= {"law": name, "location": location, "scale": scale, "p": p}
            found |= zip(ENDS, ends, strict=True)
    return found


def _anderson_darling(law: Any, x: np.ndarray) -> float:
    """The statistic A^2 of rising values (n,)."""
    n = len(x)
    weights = (2.0 * np.arange(1, n + 1) - 1.0) / n
    return float(-n - weights @ (law.logcdf(x) + law.logsf(x[::-1])))


def render_fits(
    found: pd.DataFrame,
    statistics: pd.DataFrame,
    units: Mapping[str, str],
    width: int = WIDTH,
    sampler: str = "random",
) -> str:
    """The laws of outcomes, as an engineer reads them in a terminal; ``statistics`` are of the same
    cases."""
    rows = [["outcome", "unit", "skewness", "kurtosis", "normal, p", "nearest law", "p"]]
    for end in ENDS:
        rows[0] += [f"{PERCENTILES[end]:g} %: law", "cases (95 %)"]
    beside = statistics.loc[list(found.index)]
    for (name, row), (_, at) in zip(found.iterrows(), beside.iterrows(), strict=True):
        law = str(row["law"])
        cells = [str(name), units.get(str(name), "")]
        if law == CONSTANT:
            rows.append([*cells, *3 * ["-"], CONSTANT, *5 * ["-"]])
            continue
        if not law:
            between = [part for end in ENDS for part in ("-", _interval(at, end))]
            rows.append([*cells, *5 * ["-"], *between])
            continue
        cells += [f"{row[k]:.2f} +- {row[f'{k}_se']:.2f}" for k in ("skewness", "kurtosis")]
        cells += [_probability(row["normal_p"])]
        cells += [law if row["p"] > LEVEL else f"none ({law})", _probability(row["p"])]
        for end in ENDS:
            cells += [rounded(row[end], at["sigma"]), _interval(at, end)]
        rows.append(cells)
    told = [line.rstrip() for line in aligned(rows, width)]
    told += [
        "",
        "+-: one standard error, if the law is normal; larger where it has longer tails.",
        "p: how likely so many cases of that law lie as far from it. The more cases, the smaller a "
        "difference it shows.",
    ]
    if sampler != "random":
        told += [f"Cases of run.sampler = '{sampler}' are not independent: p is no probability."]
    return "\n".join(told)


def _probability(p: float) -> str:
    return "> 0.25" if p >= max(_NORMAL) else "< 0.01" if p <= min(_NORMAL) else f"{p:.2f}"


def _interval(row: pd.Series, end: str) -> str:
    """Where a point of all cases lies, as so many show."""
    ends = [row[f"{end}_low"], row[f"{end}_high"]]
    if not np.isfinite(ends).all():
        return "too few"
    return " to ".join(rounded(end, row["sigma"]) for end in ends)
