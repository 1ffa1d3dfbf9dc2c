"""Coverage of the 95 % intervals of sensitivity indices: ``python tests/measure/sensitivity.py
[REPEATS [CASES]]``.

A line for each sampler and function; first-order indices of each input, and total ones of a
Saltelli design. An interval covers an index of exactly 0 or 1 if it is within 0.002 of it.
Intervals may be refused: the fraction of such repeats is at the end of the line.
"""

import sys

import numpy as np
from scipy.special import ndtri

from sepmc.analysis.sensitivity import input_sensitivities
from sepmc.campaign.cases import Sampling, probabilities

NEAR = 0.002


def shares(*variances):
    """First-order indices of a sum of independent terms with given variances."""
    return [v / sum(variances) for v in variances]


def ishigami(u):
    """Ishigami's function, a = 7, b = 0.1."""
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])


def product(u):
    """Product of three factors, uniform between 0.7 and 1.3."""
    return np.prod(0.7 + 0.6 * u[:3], axis=0)


def same(u):
    """Inputs as sampled."""
    return u


def discrete(u):
    """Five values, a failure of 5 %, a value of 70 % with the rest uniform."""
    kept = np.where(u[2] < 0.7, 0.5, u[2])
    return np.array([np.floor(5.0 * u[0]), (u[1] < 0.05).astype(float), kept, u[3]])


def gaussian(u):
    """Normal inputs; the first two with correlation 0.6."""
    z = ndtri(u)
    return np.array([z[0], 0.6 * z[0] + 0.8 * z[1], z[2], z[3]])


def ishigami_again(u):
    """Ishigami's function, a = 5, b = 0.3."""
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[0]) + 5.0 * np.sin(x[1]) ** 2 + 0.3 * x[2] ** 4 * np.sin(x[0])


def normal(u):
    """Independent normal inputs."""
    return ndtri(u)


def failing(share):
    """Normal inputs, the second of which is 1 in a fraction of cases, else 0."""

    def inputs(u):
        return np.array([ndtri(u[0]), (u[1] < share).astype(float), ndtri(u[2]), ndtri(u[3])])

    return inputs


_A = np.array([0.5, 2.0, 2.0, 20.0])
_G = 1.0 / (3.0 * (1.0 + _A) ** 2)
_G_ALL = np.prod(1.0 + _G)


def g_function(u):
    """Sobol's function, a = 0.5, 2, 2, 20."""
    return np.prod((np.abs(4.0 * u - 2.0) + _A[:, None]) / (1.0 + _A[:, None]), axis=0)


def lognormal(sigma):
    """Outcome exp(sigma (0.8 z0 + 0.6 z1)), with its first-order and total indices."""
    part, both = np.array([0.64, 0.36, 0.0, 0.0]) * sigma**2, np.expm1(sigma**2)
    total = np.exp(sigma**2 - part) * np.expm1(part) / both
    return normal, lambda x: np.exp(sigma * (0.8 * x[0] + 0.6 * x[1])), np.expm1(part) / both, total


_I1, _I2, _I13 = 0.5 * (1.0 + 0.06 * np.pi**4) ** 2, 25.0 / 8.0, 8.0 * 0.09 * np.pi**8 / 225.0
_I = _I1 + _I2 + _I13
_R = 0.36 / 12.0
_P = _R / ((1.0 + _R) ** 3 - 1.0)
_PT = _R * (1.0 + _R) ** 2 / ((1.0 + _R) ** 3 - 1.0)
# variance of the tied input: it is 0.5 in 70 % of cases, else uniform between 0.7 and 1
_TIED = 0.3 * (0.35**2 + 0.09 / 12.0) - (0.3 * 0.35) ** 2
# inputs as a function of uniform numbers, outcome, first-order indices, total ones
PROBLEMS = {
    "ishigami": (same, ishigami, [0.3139, 0.4424, 0.0, 0.0], [0.5576, 0.4424, 0.2437, 0.0]),
    "product": (same, product, [_P, _P, _P, 0.0], [_PT, _PT, _PT, 0.0]),
    "additive": (
        same, lambda x: 3.0 * x[0] + 2.0 * x[1] + x[2],
        [*shares(9.0, 4.0, 1.0), 0.0], [*shares(9.0, 4.0, 1.0), 0.0],
    ),
    "discrete": (
        discrete, lambda x: x[0] + 5.0 * x[1] + 3.0 * x[2],
        [*shares(2.0, 25.0 * 0.05 * 0.95, 9.0 * _TIED), 0.0],
        [*shares(2.0, 25.0 * 0.05 * 0.95, 9.0 * _TIED), 0.0],
    ),
    # y = z0 + z1 + z2, Var = 2 + 1.2 + 1; E[y | z0] = 1.6 z0
    "correlated": (
        gaussian, lambda x: x[0] + x[1] + x[2],
        [2.56 / 4.2, 2.56 / 4.2, 1.0 / 4.2, 0.0], None,
    ),
    # not used in the choice of estimators
    "g-function": (
        same, g_function, _G / (_G_ALL - 1.0), _G * _G_ALL / (1.0 + _G) / (_G_ALL - 1.0),
    ),
    "ishigami 2": (
        same, ishigami_again,
        [_I1 / _I, _I2 / _I, 0.0, 0.0], [(_I1 + _I13) / _I, _I2 / _I, _I13 / _I, 0.0],
    ),
    "step": (
        same, lambda x: (x[0] > 0.7) + x[1],
        [*shares(0.21, 1.0 / 12.0), 0.0, 0.0], [*shares(0.21, 1.0 / 12.0), 0.0, 0.0],
    ),
    "interaction": (
        same, lambda x: (x[0] - 0.5) * (x[1] - 0.5), [0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0],
    ),
    "flag": (
        same, lambda x: ((x[0] > 0.8) & (x[1] > 0.5)).astype(float),
        [4.0 / 9.0, 1.0 / 9.0, 0.0, 0.0], [8.0 / 9.0, 5.0 / 9.0, 0.0, 0.0],
    ),
    "rare flag": (  # in 1 % of cases
        same, lambda x: ((x[0] > 0.98) & (x[1] > 0.5)).astype(float),
        [0.25 * 0.0196 / 0.0099, 0.0004 * 0.25 / 0.0099, 0.0, 0.0],
        [0.5 * 0.0196 / 0.0099, 0.02 * 0.25 / 0.0099, 0.0, 0.0],
    ),
    "failure": (
        failing(0.05), lambda x: x[0] + 5.0 * x[1],
        [*shares(1.0, 25.0 * 0.0475), 0.0, 0.0], [*shares(1.0, 25.0 * 0.0475), 0.0, 0.0],
    ),
    "rare failure": (
        failing(0.01), lambda x: x[0] + 20.0 * x[1],
        [*shares(1.0, 400.0 * 0.0099), 0.0, 0.0], [*shares(1.0, 400.0 * 0.0099), 0.0, 0.0],
    ),
    "lognormal 0.5": lognormal(0.5),
    "lognormal 1": lognormal(1.0),
    "lognormal 1.5": lognormal(1.5),
}  # fmt: skip
SAMPLERS = ("random", "lhs", "sobol", "saltelli", "plan")


def drawn(sampler, seed, cases):
    """Uniform numbers (4, n) of a sampler; an input table has random rows, sorted by its last
    column."""
    sampling = Sampling("random" if sampler == "plan" else sampler, cases)
    u = probabilities([f"x{k}" for k in range(4)], seed, 0, cases, sampling)
    return u[:, np.argsort(u[3])] if sampler == "plan" else u


def coverage(sampler, problem, repeats, cases):
    """Fractions (4,) of intervals that contain the first-order and the total indices, NaN if none
    is given; and the fraction of repeats with intervals."""
    inputs, outcome, *known = PROBLEMS[problem]
    cases -= cases % 6 if sampler == "saltelli" else 0
    covered = np.full((2, repeats, 4), np.nan)
    for seed in range(repeats):
        x = inputs(drawn(sampler, seed, cases))
        names = [f"x{k}" for k in range(4)]
        rows = dict(zip(names, x, strict=True)) | {"y": outcome(x), "case": np.arange(cases)}
        rows["status"] = np.full(cases, "ok")
        try:
            table = input_sensitivities(rows, names, "y", sampler).reindex(names)
        except ValueError:  # the outcome does not vary
            continue
        # an input that happens to be constant has no row: no interval is given
        for k, (name, true) in enumerate(zip(("first", "total"), known, strict=True)):
            if true is not None and table[f"{name}_low"].notna().all():
                low, high = table[f"{name}_low"] - NEAR, table[f"{name}_high"] + NEAR
                covered[k, seed] = (low <= true) & (true <= high)
    given = ~np.isnan(covered[0]).any(axis=1)
    mean = covered[:, given].mean(axis=1) if given.any() else np.full((2, 4), np.nan)
    return mean, float(given.mean())


def main():
    """Measure and print."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    cases = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    print(
        f"{repeats} repeats of {cases} cases: 0.95 +- {2 * np.sqrt(0.0475 / repeats):.3f} are due"
    )
    for sampler in SAMPLERS:
        for problem in PROBLEMS:
            if sampler == "saltelli" and problem == "correlated":  # refused when the file is read
                continue
            (first, total), given = coverage(sampler, problem, repeats, cases)
            told = "refused" if np.isnan(first).all() else np.array2string(first, precision=3)
            more = "" if np.isnan(total).all() else f" total {np.array2string(total, precision=3)}"
            often = f"; given in {100 * given:.0f} %" if 0.0 < given < 1.0 else ""
            print(f"{sampler:9s} {problem:13s} first {told}{more}{often}", flush=True)


if __name__ == "__main__":
    main()
