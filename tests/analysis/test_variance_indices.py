"""Sensitivity estimators and the cases that they are valid for."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binom

from sepmc.analysis.sensitivity import input_sensitivities, render_sensitivities
from sepmc.campaign.cases import Sampling, probabilities


def table_of(x, y, sampler="random", **more):
    names = [f"x{k}" for k in range(len(x))]
    cases = dict(zip(names, x, strict=True)) | {"y": y, "status": np.full(len(y), "ok")} | more
    return input_sensitivities(cases, names, "y", sampler).sort_index()


def test_a_sobol_sequence_gives_no_first_order_indices():
    """Intervals of an input without effect held 0 in none of 16 seeds."""
    u = probabilities(["a", "b", "c", "d"], 0, 0, 1024, Sampling("sobol", 1024))
    table = table_of(u, (0.8 + u[0]) * (0.8 + u[1]))
    assert table["first"].isna().all()  # seen from the cases alone
    table = table_of(u, (0.8 + u[0]) * (0.8 + u[1]), "sobol")
    assert table["first"].isna().all()
    assert "a Sobol sequence is patterned" in " ".join(render_sensitivities(table, "y", {}).split())


def test_ties_do_not_depend_on_the_order_of_rows():
    """An input without effect, nominal in 70 % of cases, beside one by which rows are sorted."""
    rng = np.random.default_rng(0)
    x = np.array([np.where(rng.random(2000) < 0.7, 0.0, rng.random(2000)), rng.random(2000)])
    y = x[1] + 0.1 * rng.random(2000)
    order = np.argsort(x[1])
    one, two = table_of(x, y), table_of(x[:, order], y[order])
    np.testing.assert_allclose(one["first"], two["first"], atol=1e-9)
    assert two.loc["x0", "first_low"] <= 0.0 <= two.loc["x0", "first_high"]


def test_correlated_inputs_are_named():
    z = np.random.default_rng(1).normal(size=(3, 1000))
    x = np.array([z[0], 0.8 * z[0] + 0.6 * z[1], z[2]])
    text = render_sensitivities(table_of(x, x[0] + x[1]), "y", {})
    assert "x0, x1 are correlated" in " ".join(text.split())


def test_a_saltelli_design_goes_by_its_case_numbers():
    """Rows from within a group on, and one outcome that is missing: other groups are used."""
    n = 6 * 128
    u = probabilities(["a", "b", "c", "d"], 1, 0, n, Sampling("saltelli", n))
    y, kept = 3.0 * u[0] + u[1], np.arange(n) >= 2
    y[300] = np.nan
    table = table_of(u[:, kept], y[kept], "saltelli", case=np.arange(n)[kept])
    np.testing.assert_allclose(table["total"], [0.9, 0.1, 0.0, 0.0], atol=0.03)
    assert "2 groups are left out" in table.attrs["note"]
    y[::7] = np.nan
    assert table_of(u, y, "saltelli")["total"].isna().all()


def covered(inputs, outcome, known, sampler, repeats, cases):
    """How often intervals of first-order indices hold the known ones within 0.002, of all that are
    given; and how many are."""
    stored = []
    for seed in range(repeats):
        x = inputs(probabilities(["a", "b", "c"], seed, 0, cases, Sampling(sampler, cases)))
        table = table_of(x, outcome(x), sampler)
        low, high = table["first_low"] - 0.002, table["first_high"] + 0.002
        stored += ((low <= known) & (known <= high))[low.notna()].tolist()
    return np.sum(stored), len(stored)


def fewest(count, share=0.95, chance=1e-3):
    """Of so many intervals, those that hold the truth with less than such a chance are fewer."""
    return binom.ppf(chance, count, share)


LINEAR = 3.0**-2 * np.array([4.0, 4.0, 1.0])
COVERED = {
    "sum": (lambda u: u, lambda x: 2.0 * x[0] + 2.0 * x[1] + x[2], LINEAR, "random"),
    "lhs": (lambda u: u, lambda x: 2.0 * x[0] + 2.0 * x[1] + x[2], LINEAR, "lhs"),
    "saltelli": (lambda u: u, lambda x: 2.0 * x[0] + 2.0 * x[1] + x[2], LINEAR, "saltelli"),
    "step": (
        lambda u: u, lambda x: (x[0] > 0.7) + x[1],
        np.array([0.21, 1.0 / 12.0, 0.0]) / (0.21 + 1.0 / 12.0), "random",
    ),
    "interaction": (lambda u: u, lambda x: (x[0] - 0.5) * (x[1] - 0.5), np.zeros(3), "random"),
    "flag": (
        lambda u: u, lambda x: ((x[0] > 0.8) & (x[1] > 0.5)).astype(float),
        np.array([4.0, 1.0, 0.0]) / 9.0, "random",
    ),
    "interaction of a design": (
        lambda u: u, lambda x: (x[0] - 0.5) * (x[1] - 0.5), np.zeros(3), "saltelli",
    ),
    "failure": (
        lambda u: np.array([ndtri(u[0]), u[1] < 0.05, u[2]]), lambda x: x[0] + 5.0 * x[1],
        np.array([1.0, 25.0 * 0.0475, 0.0]) / (1.0 + 25.0 * 0.0475), "random",
    ),
    "rare failure": (
        lambda u: np.array([ndtri(u[0]), u[1] < 0.02, u[2]]), lambda x: x[0] + 20.0 * x[1],
        np.array([1.0, 400.0 * 0.0196, 0.0]) / (1.0 + 400.0 * 0.0196), "random",
    ),
    # excess kurtosis of 110 and more: most intervals are refused, the others may hold it
    "tail": (
        ndtri, lambda x: np.exp(0.8 * x[0] + 0.6 * x[1]),
        np.expm1([0.64, 0.36, 0.0]) / np.expm1(1.0), "random",
    ),
    "far tail": (
        ndtri, lambda x: np.exp(1.5 * (0.8 * x[0] + 0.6 * x[1])),
        np.expm1([1.44, 0.81, 0.0]) / np.expm1(2.25), "random",
    ),
    "rare flag": (
        lambda u: u, lambda x: ((x[0] > 0.98) & (x[1] > 0.5)).astype(float),
        np.array([0.0049, 0.0001, 0.0]) / 0.0099, "random",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", COVERED)
def test_intervals_that_are_given_hold_the_index(name):
    """As often as a binomial law of 95 % lets them, but for a chance of 0.1 %."""
    stored, count = covered(*COVERED[name], repeats=60, cases=500)
    assert stored >= fewest(count)
    assert count or name in ("tail", "far tail", "rare flag")


def test_indices_of_few_cases_have_no_interval():
    x = np.random.default_rng(2).normal(size=(3, 1000))
    table = table_of(x, np.exp(2.0 * x[0]))
    assert table["first"].notna().all()
    assert table[["first_low", "first_high"]].isna().all(axis=None)
    text = " ".join(render_sensitivities(table, "y", {}).split())
    assert "without intervals: a few outliers among 1000 cases" in text
    assert "+-" not in text
    assert "by shift of the mean" in text


def test_a_design_whose_independent_cases_are_alike():
    """The only failure is in a case that repeats others but for one input."""
    n = 6 * 64
    u = probabilities(["a", "b", "c", "d"], 1, 0, n, Sampling("saltelli", n))
    with pytest.raises(ValueError, match="the same in all independent cases"):
        table_of(u, np.where(np.arange(n) == 8, 1.0, 0.0), "saltelli")


def test_a_latin_hypercube_says_that_its_intervals_are_wide():
    u = probabilities(["a", "b", "c"], 1, 0, 640, Sampling("lhs", 640))
    assert "at least 95 %" in table_of(u, 2.0 * u[0] + u[1], "lhs").attrs["note"]
