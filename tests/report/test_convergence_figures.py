"""Shares beyond a value with their bands, and running means and sigmas, against their
definitions."""

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from sepmc.analysis.proportions import binomial_interval
from sepmc.analysis.requirements import RequirementCounter, judge
from sepmc.report import convergence_figures
from sepmc.report.convergence_figures import (
    _exceedance,
    convergence_figure,
    exceedance_figure,
    running_statistics,
)
from sepmc.report.style import PRINTED, SCREEN, make_axes, resolution
from sepmc.scene.model import Requirement


@pytest.mark.parametrize("upper", [True, False])
def test_share_beyond_a_value(upper):
    """At a value the curve is the share of cases beyond it, counted, ties among them, and the band
    Clopper and Pearson's interval; beyond all cases only an upper end is left."""
    x = np.round(np.random.default_rng(2).normal(size=900), 1)
    _, (ax,) = make_axes(1, 1, (4.0, 3.0))
    _exceedance(ax, x, upper)
    (line,) = ax.get_lines()
    at, share = line.get_data()
    count = np.array([np.sum(x > v) if upper else np.sum(x < v) for v in at])
    assert np.array_equal(np.nan_to_num(share), count / 900.0)
    assert set(at) == set(x)
    band = ax.collections[0].get_paths()[0].vertices
    for v, k in [(at[5], count[5]), (at[len(at) // 2], count[len(at) // 2])]:
        for end in binomial_interval(int(k), 900):
            assert np.isclose(band, [v, end], rtol=1e-9).all(axis=1).any()
    assert count.min() == 0
    assert np.isclose(band[:, 1].max(), binomial_interval(int(count.max()), 900)[1])


def test_cases_without_an_outcome_are_beyond():
    """A curve begins at the share of cases that have no outcome, as verdicts count them."""
    x = np.concatenate([np.arange(90.0), np.full(10, np.nan)])
    for upper in (True, False):
        _, (ax,) = make_axes(1, 1, (4.0, 3.0))
        _exceedance(ax, x, upper)
        at, share = ax.get_lines()[0].get_data()
        beyond = (89.0 - at if upper else at) + 10.0
        np.testing.assert_allclose(share, beyond / 100.0)


def test_between_two_bounds_one_panel_shows_both_sides(tmp_path, monkeypatch):
    """The curve at margin 0 is the share that violates either bound, as the verdict counts it."""
    drawn = []
    monkeypatch.setattr(
        convergence_figures, "save", lambda figure, path: drawn.append(figure) or path
    )
    x = np.arange(200.0)
    two = Requirement(name="both", metric="x", at_least=10.0, at_most=180.0, probability=0.9)
    one = Requirement(name="one", metric="x", at_most=180.0, probability=0.9)
    verdicts = []
    for item in (two, one):
        tally = RequirementCounter(item)
        tally.add(np.arange(200), np.ones(200, dtype=bool), x, np.zeros(200, dtype=bool))
        verdicts.append(judge(tally, {"x": (0.0, 1.0)}, np.nan))
    exceedance_figure({"x": x}, verdicts, tmp_path, {"x": "mm"}, "title")
    (figure,) = drawn
    both, side = (ax for ax in figure.axes if ax.get_lines())
    at, share = both.get_lines()[0].get_data()
    assert share[at == 0.0] == verdicts[0].violations / 200 == 29 / 200
    assert both.get_lines()[1].get_xdata()[0] == 0.0
    assert both.get_xlabel() == "margin of x (mm)\nto the nearer of 10 and 180, below 0 beyond it"
    at, share = side.get_lines()[0].get_data()
    assert share[at == 180.0] == verdicts[1].violations / 200 == 19 / 200


def test_running_mean_and_sigma():
    """Mean and sigma of the first n values, for every n, far from zero; the interval of the mean is
    Student's."""
    x = 1e6 + np.random.default_rng(4).gamma(2.0, size=400)
    n = np.array([2, 3, 10, 57, 400])
    (mean, low, high), (sigma, least, greatest) = running_statistics(x, n)
    for k, m in enumerate(n):
        part = x[:m]
        assert mean[k] == pytest.approx(part.mean(), rel=1e-14)
        assert sigma[k] == pytest.approx(part.std(ddof=1), rel=1e-9)
        ends = stats.t.interval(0.95, m - 1, part.mean(), part.std(ddof=1) / np.sqrt(m))
        assert (low[k], high[k]) == pytest.approx(ends, rel=1e-13)
        assert least[k] < sigma[k] < greatest[k]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_convergence_of_few_cases(tmp_path, count):
    """One case has a mean and no interval; uneven values of a few give no warning."""
    x = np.array([1.0, 1.0 + 1e-9, 1e6])[:count]
    (mean, _, _), (sigma, _, _) = running_statistics(x, np.array([count]))
    assert mean[0] == pytest.approx(x.mean())
    assert np.isnan(sigma[0]) == (count == 1)
    assert convergence_figure({"a": x}, tmp_path, {}, "title").is_file()


def test_running_intervals_hold_the_truth():
    """Of ten values of a normal law, 95 % of the intervals hold its mean, and 96 % its sigma."""
    random, n = np.random.default_rng(8), np.array([10])
    stored = np.zeros(2)
    for _ in range(1000):
        result = running_statistics(random.normal(3.0, 2.0, 10), n)
        stored += [
            low[0] <= truth <= high[0]
            for (_, low, high), truth in zip(result, (3.0, 2.0), strict=True)
        ]
    assert (stored >= stats.binom.ppf(0.001, 1000, 0.95)).all(), stored
    assert stored[0] <= stats.binom.ppf(0.999, 1000, 0.95), stored


def test_dots_an_inch(tmp_path):
    """A figure for print has twice the pixels of one for the screen, and the next one not."""
    wide = []
    for per_inch in (SCREEN, PRINTED, SCREEN):
        with resolution(per_inch):
            path = convergence_figure({"a": np.arange(30.0)}, tmp_path, {}, "title")
        with Image.open(path) as image:
            wide.append(image.width)
    assert wide[1] == 2 * wide[0] == 2 * wide[2]
