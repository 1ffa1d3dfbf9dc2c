"""Error measure of outcomes."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from sepmc.campaign.execution import step_selection
from sepmc.campaign.execution.accuracy import AchievedAccuracy, achieved
from sepmc.campaign.execution.diagnostics import accuracy_notes
from sepmc.campaign.execution.integration import Integration, _is_calibrated
from sepmc.engine.dispatch import Block

INF, NAN = np.inf, np.nan


def error(result, reference, units=None):
    """`relative_error` of plain rows."""
    result, reference = (
        np.atleast_2d(np.array(result, dtype=float)),
        np.atleast_2d(np.array(reference, dtype=float)),
    )
    return step_selection.relative_error(result, reference, units or ["m"] * reference.shape[1])


def test_error_is_over_size():
    """Alone, so without scatter: the difference over the reference."""
    assert_allclose(error([2.02, -3.0], [2.0, -3.03]), [0.01, 0.03 / 3.03])


def test_error_is_over_scatter_if_that_is_larger():
    """Numbers about zero: a case that happens to lie near zero does not count as wrong."""
    reference = np.array([[-1.0], [1e-9], [1.0]])
    spread = np.std(reference)
    assert_allclose(error(reference + np.array([[0.0], [0.01], [0.0]]), reference), 0.01 / spread)
    offset = reference + 100.0  # then size counts
    assert_allclose(error(offset + np.array([[0.0], [0.01], [0.0]]), offset), 1e-4, rtol=1e-6)


def test_error_of_what_cancels():
    """Zero but for round-off: measured against a ten-thousandth of the largest of the same unit,
    and only of the same."""
    reference, results = [[5.0, 1e-16, 1e-16]], [[5.0, 2e-16, 2e-16]]
    assert_allclose(
        error(results, reference, ["m", "m", "rad"]), [0.0, 1e-16 / 5e-4, 1.0], rtol=1e-9
    )


def test_error_of_nan():
    """At the same place it agrees; at one only, nothing is worse. It does not enter the scatter as
    a number."""
    assert_array_equal(error([[NAN, 1.0], [2.0, 1.0]], [[NAN, 1.0], [2.0, 1.0]]), [0.0, 0.0])
    assert_array_equal(error([[NAN, 1.0]], [[2.0, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[2.0, 1.0]], [[NAN, 1.0]]), [INF, 0.0])
    assert_array_equal(error([[INF]], [[1.0]]), [INF])


def test_error_of_zero():
    """Equal zeros agree although there is nothing to divide by; a number where the reference is
    nothing but zero is infinitely wrong."""
    assert_array_equal(error([[0.0, 0.0]], [[0.0, 0.0]]), [0.0, 0.0])
    assert_array_equal(error([[1e-30]], [[0.0]]), [INF])


def test_error_of_no_cases():
    assert_array_equal(
        step_selection.relative_error(np.empty((0, 3)), np.empty((0, 3)), ["m"] * 3), [0.0] * 3
    )


def test_error_does_not_change_what_it_is_given():
    result, reference = np.array([[1.0, NAN]]), np.array([[1.0, NAN]])
    step_selection.relative_error(result, reference, ["m", "m"])
    assert_array_equal(result, reference)


def test_an_angle_that_does_not_exist_is_no_reason_to_fly_again():
    """Sideslip of still air; one beyond what trial cases had is."""
    usual = Integration(None, np.ones(1), np.ones(1), limits=np.ones(1), angles={0: 0.5})
    result = np.array([[0.4], [0.6], [NAN]])
    block = Block(result, *np.zeros((4, 3)), indicators=np.zeros((3, 1)))
    assert_array_equal(_is_calibrated(usual, block), [True, False, True])


def test_accuracy_that_is_not_met_names_its_outcomes():
    """Times and positions of extremes do not count, not even alone; an error that is no number
    does."""
    positions = frozenset({"gap_clearance_time_s"})
    alone = AchievedAccuracy(1e-6, {"gap_clearance_time_s": 1e-3}, 9, positions)
    assert (alone.met, accuracy_notes(alone, False)) == (True, [])
    unknown = AchievedAccuracy(1e-6, {"mass_kg": 0.0, "gap_clearance_mm": NAN}, 9)
    assert not unknown.met
    assert "(gap_clearance_mm nan)" in accuracy_notes(unknown, False)[0]
    with_nan = AchievedAccuracy(1e-6, {"a": 2e-6, "b": NAN, "c": 3e-6, "d": 1e-7}, 9)
    assert list(with_nan.unmet) == ["b", "c", "a"]
    several = AchievedAccuracy(1e-6, {"a": 1e-7, "b": 2e-6, "c": 3e-6}, 9)
    assert "error up to 3.0e-06" in accuracy_notes(several, False)[0]
    assert "(c 3.0e-06, b 2.0e-06)" in accuracy_notes(several, False)[0]


def test_no_trial_case_tells_no_error(table2):
    """The error is not known then, which is not that it is zero; a step that is given does not
    change that."""
    told = achieved(table2, np.zeros(len(table2.outcome_columns)), 0)
    assert set(told.errors.values()) == {np.inf}
    assert not told.met
    for fixed in (False, True):
        assert "numerical " in accuracy_notes(told, fixed)[0]
