"""Sensitivity estimators and the cases that they are valid for."""

import numpy as np

from sepmc.analysis.drivers import drivers, text
from sepmc.campaign.cases import Sampling, probabilities


def table_of(x, y, sampler="random", **more):
    names = [f"x{k}" for k in range(len(x))]
    cases = dict(zip(names, x, strict=True)) | {"y": y, "status": np.full(len(y), "ok")} | more
    return drivers(cases, names, "y", sampler).sort_index()


def test_a_sobol_sequence_gives_no_first_order_indices():
    """Intervals of an input without effect held 0 in none of 16 seeds."""
    u = probabilities(["a", "b", "c", "d"], 0, 0, 1024, Sampling("sobol", 1024))
    table = table_of(u, (0.8 + u[0]) * (0.8 + u[1]))
    assert table["first"].isna().all()  # seen from the cases alone
    table = table_of(u, (0.8 + u[0]) * (0.8 + u[1]), "sobol")
    assert table["first"].isna().all()
    assert "a Sobol sequence is patterned" in " ".join(text(table, "y", {}).split())


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
    told = text(table_of(x, x[0] + x[1]), "y", {})
    assert "x0, x1 vary together" in " ".join(told.split())


def test_a_saltelli_design_goes_by_its_case_numbers():
    """Rows from within a group on, and one outcome that is missing: other groups are used."""
    n = 6 * 128
    u = probabilities(["a", "b", "c", "d"], 1, 0, n, Sampling("saltelli", n))
    y, kept = 3.0 * u[0] + u[1], np.arange(n) >= 2
    y[300] = np.nan
    table = table_of(u[:, kept], y[kept], "saltelli", case=np.arange(n)[kept])
    np.testing.assert_allclose(table["total"], [0.9, 0.1, 0.0, 0.0], atol=0.03)
    assert "2 groups are left out" in table.attrs["said"]
    y[::7] = np.nan
    assert table_of(u, y, "saltelli")["total"].isna().all()
