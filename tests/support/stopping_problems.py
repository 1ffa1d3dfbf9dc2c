"""Fifteen problems of known statistics, most of them with values that are rarely sampled.

Cases are sampled, counted and judged by the code that runs campaigns with ``--until``; outcomes are
formulas of the inputs.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import multivariate_normal, norm

from sepmc.analysis.rare_values import count_values, occurrences, rare_values
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.stopping import parse_stopping_rule
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.cases import Sampling, sample
from sepmc.scene.correlation import Copula
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.parameters import Parameter

REPEATS, CASES = 1000, 2**17
OUTCOMES = ["speed_m_s", "gap_recontact"]


def normal(name="speed"):
    """Standard normal input."""
    return Dispersion(Parameter(name, name, "", 1.0, None), "normal", (0.0, 1.0, np.inf))


def uniform(name):
    """Input between 0 and 1."""
    return Dispersion(Parameter(name, name, "", 1.0, None), "uniform", (0.0, 1.0))


def discrete(name, *weights, values=None):
    """Input with values 0, 1, ... of given probabilities; 0 has the rest."""
    weights = (1.0 - sum(weights), *weights)
    values = values or tuple(map(float, range(len(weights))))
    return Dispersion(Parameter(name, name, "", 1.0, None), "discrete", values, weights)


def together(coefficient):
    """Copula of the first two inputs."""
    low = np.linalg.cholesky([[1.0, coefficient], [coefficient, 1.0]])
    return (Copula((0, 1), tuple(map(tuple, low.tolist()))),)


@dataclass(frozen=True)
class Problem:
    """Stopping rule ``until``, inputs, an outcome of them (NaN: failed case), and the ``truth`` of
    the statistic."""

    until: str
    inputs: tuple[Dispersion, ...]
    outcome: Callable[[np.ndarray], np.ndarray]
    truth: float
    copulas: tuple[Copula, ...] = ()

    def rows(self, seed, first, end):
        """Inputs (n, d) of cases, and their table."""
        inputs = sample(self.inputs, seed, first, end - first, Sampling(copulas=self.copulas))
        values = self.outcome(inputs.T)
        failed = np.isnan(values)
        return inputs, {
            "case": np.arange(first, end),
            "status": np.where(failed, "never-released", "ok").astype(object),
            "speed_m_s": values,
            "gap_recontact": np.where(failed, np.nan, (values < 0.0).astype(float)),
        }


def mixture(fraction, point, shift):
    """Quantile of normal cases of which a fraction is shifted."""
    return brentq(
        lambda x: (1.0 - fraction) * norm.cdf(x) + fraction * norm.cdf(x - shift) - point,
        -40.0,
        40.0,
    )


_BOTH = 0.0012437  # probability that two inputs with correlation 0.5 are both in their last 1 %
# the same for the last 2 % and correlation 0.8
_PAIR = float(multivariate_normal.cdf([norm.ppf(0.02)] * 2, cov=[[1.0, 0.8], [0.8, 1.0]]))
PROBLEMS = {
    "a rare failure decides the mean": Problem(
        "speed_m_s:0.02", (normal(), discrete("fails", 0.002)),
        lambda x: 1.45 + 0.103 * x[0] - 20.2 * x[1], 1.45 - 20.2 * 0.002,
    ),
    "a rare failure changes the mean little": Problem(
        "speed_m_s:0.5%", (normal(), discrete("fails", 0.002)),
        lambda x: 1.45 + 0.103 * x[0] - 1.0 * x[1], 1.45 - 0.002,
    ),
    "two failures that correlate": Problem(
        "speed_m_s:1.5%", (discrete("one", 0.01), discrete("two", 0.01), normal()),
        lambda x: 1.45 + 0.1 * x[2] - 15.0 * x[0] * x[1], 1.45 - 15.0 * _BOTH, together(0.5),
    ),
    "a delay of three values": Problem(
        "speed_m_s:2%", (normal(), discrete("delay", 0.025, 0.005, values=(0.0, 0.02, 0.9))),
        lambda x: 0.05 + 0.01 * x[0] + x[1], 0.05 + 0.025 * 0.02 + 0.005 * 0.9,
    ),
    "sigma of a mixture": Problem(
        "speed_m_s.sigma:5%", (normal(), discrete("fails", 0.01)),
        lambda x: x[0] + 6.0 * x[1], np.sqrt(1.0 + 36.0 * 0.01 * 0.99),
    ),
    "a percentile where a failure begins": Problem(
        "speed_m_s.p99:0.5", (normal(), discrete("fails", 0.012)),
        lambda x: x[0] + 20.0 * x[1], mixture(0.012, 0.99, 20.0),
    ),
    "share of cases that touch": Problem(
        "gap_recontact:0.002", (normal(), discrete("fails", 0.004)),
        lambda x: 5.0 + x[0] - 20.0 * x[1], 0.004,
    ),
    "share of cases that fail": Problem(
        "never-released:25%", (normal(), discrete("fails", 0.003)),
        lambda x: np.where(x[1] == 1.0, np.nan, x[0]), 0.003,
    ),
    "two modes that no file tells of": Problem(
        "speed_m_s:2%", (normal(), uniform("gust")),
        lambda x: 1.45 + 0.1 * x[0] - 8.0 * (x[1] > 0.99), 1.45 - 0.08,
    ),
    "a long tail": Problem(
        "speed_m_s:3%", (normal(),), lambda x: np.exp(x[0]), np.exp(0.5),
    ),
    # not used in the choice of the rules
    "fresh: a stuck spring in skewed noise": Problem(
        "speed_m_s:1%", (normal(), discrete("fails", 0.004)),
        lambda x: np.exp(0.3 * x[0]) - 3.0 * x[1], np.exp(0.045) - 0.012,
    ),
    "fresh: three failures": Problem(
        "speed_m_s:1%",
        (normal(), discrete("one", 0.01), discrete("two", 0.003), discrete("three", 0.02)),
        lambda x: 2.0 + 0.2 * x[0] - 4.0 * x[1] - 6.0 * x[2] + 3.0 * x[3], 2.002,
    ),
    "fresh: a pair that nearly always fails": Problem(
        "speed_m_s:5%", (discrete("one", 0.02), discrete("two", 0.02), normal()),
        lambda x: 1.0 + 0.1 * x[2] + 10.0 * x[0] * x[1], 1.0 + 10.0 * _PAIR, together(0.8),
    ),
    "fresh: sigma of an even law": Problem(
        "speed_m_s.sigma:2%", (uniform("gust"),), lambda x: x[0], 12.0**-0.5,
    ),
    "fresh: sigma with a rare failure": Problem(
        "speed_m_s.sigma:5%", (normal(), discrete("fails", 0.004)),
        lambda x: x[0] + 8.0 * x[1], np.sqrt(1.0 + 64.0 * 0.004 * 0.996),
    ),
}  # fmt: skip


def stopped(problem, seed, max_cases=CASES):
    """Cases after which a problem stops, and the last evaluation of the rule."""
    until = parse_stopping_rule(problem.until, OUTCOMES)
    values = rare_values(problem.inputs, problem.copulas)
    every = list(CaseSelection.first(max_cases).doubling(until.first(values)))
    tables, counts = [], np.zeros(1 + len(values), dtype=int)
    for numbers in every:
        inputs, table = problem.rows(seed, *numbers.ranges[0])
        tables.append(table)
        counts += count_values(values, inputs)
        rows = {name: np.concatenate([t[name] for t in tables]) for name in table}
        counts_of_values = occurrences(values, counts.tolist())
        look = until.look(TableStatistics(rows, OUTCOMES, [], {}), len(every), counts_of_values)
        if look.sufficient:
            break
    return numbers.end, look


def coverage(name, repeats=REPEATS):
    """Fractions of repeats in which the final interval contains the truth, and in which the
    statistic was known well enough; and the mean number of cases."""
    problem, seed = PROBLEMS[name], zlib.crc32(name.encode())
    ends = [stopped(problem, seed + repeat) for repeat in range(repeats)]
    covered = [look.low <= problem.truth <= look.high for _, look in ends]
    enough = [look.sufficient for _, look in ends]
    return float(np.mean(covered)), float(np.mean(enough)), float(np.mean([n for n, _ in ends]))
