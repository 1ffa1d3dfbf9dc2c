"""Calibration cases: corners of the distributions, and a sample."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sepmc.campaign import cases
from sepmc.campaign.execution import step_selection


def test_corners_do_not_depend_on_the_seed(table2):
    """Nor on how many cases there are: how a campaign is flown is a matter of its scene and
    laws."""
    base = step_selection.corner_cases(table2)
    assert base.shape == (step_selection.CORNERS + 1, len(table2.file.dispersions))
    assert_array_equal(
        step_selection.corner_cases(table2.with_settings({"run.seed": 1, "run.cases": 5})), base
    )


def test_corners_are_the_nominal_and_the_edges(table2):
    """The middle of every law first; then of each parameter a thousandth of the probability from
    either end, both ends often."""
    result = step_selection.corner_cases(table2) / table2.factors
    middle = [cases.quantile(d, np.array([0.5]))[0] for d in table2.file.dispersions]
    assert_allclose(result[0], middle, rtol=1e-12, atol=1e-12)
    for values, law in zip(result[1:].T, table2.file.dispersions, strict=True):
        if law.numbers == (0.0, 360.0):
            continue
        low, high = cases.quantile(law, np.array([0.001, 0.999]))
        assert_allclose(
            np.unique(np.round((values - low) / (high - low), 9)), [0.0, 1.0], atol=1e-9
        )
        assert 4 <= np.sum(values > 0.5 * (low + high)) <= step_selection.CORNERS - 4
    assert len(np.unique(result[1:] > result[0], axis=0)) == step_selection.CORNERS


@pytest.mark.parametrize(
    ("law", "wide"),
    [
        ({"uniform": [0.0, 360.0]}, True),
        ({"uniform": [-60.0, 60.0]}, True),
        ({"normal": [0.0, 40.0]}, True),
        ({"uniform": 40.0}, False),
    ],
)
def test_corners_of_an_angle_all_round(table2, law, wide):
    """Both ends of a full turn are one direction: angles that spread over more than 90 deg are
    spaced over all of it."""
    result = np.sort(
        step_selection.corner_cases(
            table2.with_settings({"dispersion": {"environment.wind.direction_deg": law}})
        )[1:, 0]
    )
    if not wide:
        assert len(np.unique(result)) == 2
        return
    assert len(np.unique(result)) == step_selection.CORNERS
    assert np.diff(result).max() <= 0.25 * (result[-1] - result[0])
    if law == {"uniform": [0.0, 360.0]}:
        assert_allclose(np.degrees(result), 7.5 + 15.0 * np.arange(24))


def test_corners_have_every_value_of_a_discrete_law(table2):
    """However rare, each at least three times; there are more corners if there are many values. A
    weight of 0 is never drawn."""
    values = [440.0 + i for i in range(12)]
    weights = [1.0] * 10 + [1e-12, 0.0]
    laws = {
        "body.upper.mass_kg": {"discrete": values, "weights": weights},
        "body.lower.mass_kg": {"uniform": 25.0},
    }
    campaign = table2.with_settings({"dispersion": laws})
    result = step_selection.corner_cases(campaign)
    assert len(result) == 3 * 11 + 1
    assert [np.count_nonzero(result[1:, 0] == value) for value in values] == [3] * 11 + [0]
    drawn = step_selection.calibration_sample(campaign, 40)
    assert set(drawn[:, 0]) == set(values[:-1])
    assert set(drawn[:20, 0]) <= set(values[:10])


def test_the_sample_covers_every_law(table2):
    """A Latin hypercube in each half: one case in every share of the probability of each parameter;
    not of the seed."""
    result = step_selection.calibration_sample(table2, 32)
    assert_array_equal(
        result, step_selection.calibration_sample(table2.with_settings({"run.seed": 5}), 32)
    )
    for values, law, factor in zip(result.T, table2.file.dispersions, table2.factors, strict=True):
        low, high = law.numbers
        for half in (values[:16], values[16:]):
            assert_array_equal(
                np.sort(((half / factor - low) / (high - low) * 16.0).astype(int)), np.arange(16)
            )


def test_corners_without_dispersion(table2):
    assert step_selection.corner_cases(table2.with_settings({"dispersion": {}})).shape == (
        step_selection.CORNERS + 1,
        0,
    )


@pytest.mark.parametrize(
    "law",
    [
        {"normal": 5.0},
        {"triangular": [440.0, 458.0, 480.0]},
        {"discrete": [450.0, 460.0]},
        {"constant": 458.0},
    ],
)
def test_corners_of_every_law(table2, law):
    """Finite: tails are cut at a thousandth, a discrete law gives its own values."""
    campaign = table2.with_settings({"dispersion": {"body.upper.mass_kg": law}})
    result = step_selection.corner_cases(campaign)
    assert np.isfinite(result).all()
    assert np.all((result > 400.0) & (result < 500.0))
    if "discrete" in law:
        assert set(result[1:, 0]) == {450.0, 460.0}
