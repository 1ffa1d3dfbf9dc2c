"""Shares beyond a value with their bands, and running means and sigmas, against their
definitions."""

import numpy as np
import pytest
from PIL import Image

from sepmc.analysis.proportions import interval
from sepmc.report.share_figures import _beyond, _running, convergence_figure
from sepmc.report.style import PRINTED, SCREEN, dots, sheet


@pytest.mark.parametrize("upper", [True, False])
def test_share_beyond_a_value(upper):
    """At a value the curve is the share of cases beyond it, counted, ties among them, and the band
    Clopper and Pearson's interval; beyond all cases only an upper end is left."""
    x = np.round(np.random.default_rng(2).normal(size=900), 1)
    _, (ax,) = sheet(1, 1, (4.0, 3.0))
    _beyond(ax, x, upper)
    (line,) = ax.get_lines()
    at, share = line.get_data()
    count = np.array([np.sum(x > v) if upper else np.sum(x < v) for v in at])
    assert np.array_equal(np.nan_to_num(share), count / 900.0)
    assert set(at) == set(x)
    band = ax.collections[0].get_paths()[0].vertices
    for v, k in [(at[5], count[5]), (at[len(at) // 2], count[len(at) // 2])]:
        for end in interval(int(k), 900):
            assert np.isclose(band, [v, end], rtol=1e-9).all(axis=1).any()
    assert count.min() == 0
    assert np.isclose(band[:, 1].max(), interval(int(count.max()), 900)[1])


def test_cases_without_an_outcome_are_beyond():
    """A curve begins at the share of cases that have no outcome, as verdicts count them."""
    x = np.concatenate([np.arange(90.0), np.full(10, np.nan)])
    for upper in (True, False):
        _, (ax,) = sheet(1, 1, (4.0, 3.0))
        _beyond(ax, x, upper)
        at, share = ax.get_lines()[0].get_data()
        beyond = (89.0 - at if upper else at) + 10.0
        np.testing.assert_allclose(share, beyond / 100.0)


def test_running_mean_and_sigma():
    """Mean, sigma and their standard errors of the first n values, for every n, far from zero."""
    x = 1e6 + np.random.default_rng(4).gamma(2.0, size=400)
    n = np.array([2, 3, 10, 57, 400])
    (mean, sigma), (mean_error, sigma_error) = _running(x, n)
    for k, m in enumerate(n):
        part = x[:m]
        s, fourth = part.std(ddof=1), np.mean((part - part.mean()) ** 4)
        assert mean[k] == pytest.approx(part.mean(), rel=1e-14)
        assert sigma[k] == pytest.approx(s, rel=1e-9)
        assert mean_error[k] == pytest.approx(s / np.sqrt(m), rel=1e-9)
        expected = np.sqrt(max(0.0, fourth - (m - 3) / (m - 1) * s**4) / m) / (2.0 * s)
        assert sigma_error[k] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_dots_an_inch(tmp_path):
    """A figure for print has twice the pixels of one for the screen, and the next one not."""
    wide = []
    for per_inch in (SCREEN, PRINTED, SCREEN):
        with dots(per_inch):
            path = convergence_figure({"a": np.arange(30.0)}, tmp_path, {}, "title")
        with Image.open(path) as image:
            wide.append(image.width)
    assert wide[1] == 2 * wide[0] == 2 * wide[2]
