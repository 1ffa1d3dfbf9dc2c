"""The error of every case: how the estimate is made of guards, and what campaigns make of it."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import sepmc
from sepmc.campaign.execution.accuracy import decisive, errors
from sepmc.campaign.execution.error_estimate import _least_squares
from sepmc.campaign.execution.error_estimate import estimate as estimate_of
from sepmc.campaign.execution.integration import integrate
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.schema import Status

RANDOM = np.random.default_rng(12)
ALL = np.ones(3, dtype=bool)


def estimate(guards, errors, floor, decides, left_out=None):
    """Without what guards say by themselves, if that is not given."""
    none = np.zeros((errors.shape[1], guards.shape[1]))
    return estimate_of(guards, errors, floor, none if left_out is None else left_out, decides)


def largest(result, guards):
    """The largest error (o,) of each outcome over cases with some guards."""
    return result.largest(
        result.of_leading(guards), guards.max(axis=0) if len(guards) else guards[0:0].ravel()
    )


def trials(count=400):
    """Guards (n, 4) of which one is always zero, and errors (n, 3) made of them."""
    guards = np.exp(RANDOM.normal(size=(count, 4))) * [1e-9, 1e-3, 0.0, 10.0]
    share = (guards[:, [0, 1, 3]] / [1e-9, 1e-3, 10.0]) ** 1.5
    true = share @ np.array([[2.0, 0.0, 0.5], [0.1, 0.0, 0.0], [0.0, 1e-3, 3.0]]) * 1e-11
    return guards, true


def test_sums_are_found():
    """Errors that are sums of powers of guards are told as they are, but for the margin."""
    guards, true = trials()
    result = estimate(guards, true, np.zeros(3), ALL)
    assert_allclose(result.of_cases(guards), 4.0 / 3.0 * true.max(axis=1), rtol=1e-6)
    assert_allclose(largest(result, guards), 4.0 / 3.0 * true.max(axis=0), rtol=1e-6)
    assert (result.weights >= 0.0).all()


@pytest.mark.parametrize("spread", [0.1, 1.0, 3.0])
def test_no_trial_case_is_beyond(spread):
    """Whatever errors are besides: by factors, or by a number where one case stands out."""
    guards, true = trials()
    true = true * np.exp(RANDOM.normal(scale=spread, size=true.shape))
    true[7, 1] = 1e-9
    reported = estimate(guards, true, np.zeros(3), ALL).of_cases(guards)
    assert (reported >= true.max(axis=1)).all()


def test_one_case_does_not_raise_all():
    guards, true = trials()
    before = np.median(estimate(guards, true[:, :1], np.zeros(1), ALL[:1]).of_cases(guards))
    true[7, 0] = 30.0 * true[:, 0].max()
    after = estimate(guards, true[:, :1], np.zeros(1), ALL[:1]).of_cases(guards)
    assert after[7] >= true[7, 0]
    assert np.median(after) < before + 1.5 * true[7, 0]
    easy = np.argsort(true[:, 0])[:20]
    assert (after[easy] < true[7, 0]).all()  # a factor raises those by less


ESTIMATE = """
import numpy as np
from sepmc.campaign.execution.error_estimate import estimate
random = np.random.default_rng(5)
indicators = np.exp(random.normal(size=(537, 7)))
shares = random.uniform(size=(7, 3))
errors = np.array([(indicators**1.5 * share).sum(axis=1) for share in shares.T]).T
errors *= np.exp(random.normal(size=errors.shape))
made = estimate(indicators, errors, np.zeros(3), np.zeros((3, 7)), np.ones(3, bool))
print([float(x).hex() for x in (*made.weights.flat, *made.factor, *made.offset)])
"""


def test_no_bits_follow_from_the_linear_algebra_library():
    """OpenBLAS has other sums for other processors: `error` was not the same in every run."""
    texts = [
        subprocess.run(
            [sys.executable, "-c", ESTIMATE],
            env=os.environ | {"OPENBLAS_CORETYPE": core},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for core in ("Haswell", "Prescott")
    ]
    assert texts[0] == texts[1]
    assert texts[0].count("0x") == 3 * 7 + 6


def test_dependent_terms():
    """Of terms that are multiples of each other one is used."""
    terms = np.exp(RANDOM.normal(size=(300, 2)))
    both = np.column_stack([terms, 2.0 * terms[:, 0]])
    coefficients = _least_squares(both, terms @ [3.0, 5.0])
    assert_allclose(both @ coefficients, terms @ [3.0, 5.0], rtol=1e-13)
    assert np.count_nonzero(coefficients) == 2
    full = np.exp(RANDOM.normal(size=(300, 6)))
    target = RANDOM.normal(size=300)
    known = np.linalg.lstsq(full, target, rcond=None)[0]
    assert_allclose(_least_squares(full, target), known, rtol=1e-11)


def test_floor_and_what_decides():
    guards, true = trials()
    floor = np.array([0.0, 5e-7, 0.0])
    reported = estimate(guards, true, floor, ALL)
    assert_allclose(reported.of_cases(guards)[true.max(axis=1) < 1e-9], 5e-7, rtol=5e-3)
    rest = estimate(guards, true, floor, np.array([True, False, True]))
    assert rest.of_cases(guards).max() < 5e-7
    assert largest(rest, guards)[1] > 5e-7  # told of the outcome all the same


def test_what_guards_say_by_themselves():
    """It comes on top, of the case that has it, and of the outcome."""
    guards, true = trials()
    left_out = np.zeros((3, 4))
    left_out[1, 3] = 1e-6
    reported = estimate(guards, true, np.zeros(3), ALL, left_out)
    alone = estimate(guards, true[:, 1:2], np.zeros(1), ALL[:1])
    expected = alone.of_cases(guards) + 1e-6 * guards[:, 3]
    assert_allclose(reported.of_cases(guards), expected, rtol=1e-12)
    assert largest(reported, guards)[1] == pytest.approx(expected.max(), rel=1e-12)


def test_harder_cases_have_larger_errors():
    guards, true = trials()
    result = estimate(guards, true, np.zeros(3), ALL)
    assert_allclose(result.of_cases(4.0 * guards), 8.0 * result.of_cases(guards), rtol=1e-12)


def test_bits_do_not_depend_on_the_batch():
    guards, true = trials()
    result = estimate(guards, true, np.full(3, 1e-13), ALL)
    whole = result.of_cases(guards)
    alone = np.concatenate([result.of_cases(guards[i : i + 1]) for i in range(len(guards))])
    assert_array_equal(whole, alone)


def test_what_is_told_does_not_depend_on_groups():
    guards, true = trials()
    result = estimate(guards, true, np.full(3, 1e-13), ALL)
    parts = [guards[:150], guards[150:151], guards[151:]]
    leading = np.max([result.of_leading(part) for part in parts], axis=0)
    most = np.max([part.max(axis=0) for part in parts], axis=0)
    assert_array_equal(result.largest(leading, most), largest(result, guards))


def test_what_is_infinitely_wrong_is_left_out():
    """As where an outcome has no value at the finer steps: no fit can hold it."""
    guards, true = trials()
    expected = estimate(guards[1:], true[1:], np.zeros(3), ALL)
    true[0, 1] = np.inf
    result = estimate(guards, true, np.zeros(3), ALL)
    assert np.isfinite(result.of_cases(guards)).all()
    assert_allclose(result.of_cases(guards), expected.of_cases(guards), rtol=1e-6)


def test_without_trial_cases():
    result = estimate(np.empty((0, 2)), np.empty((0, 3)), np.array([1e-12, 2e-12, 0.0]), ALL)
    assert_array_equal(result.of_cases(np.ones((4, 2))), 2e-12)
    assert_array_equal(largest(result, np.empty((0, 2))), 0.0)


@pytest.fixture(scope="module", params=["table2", "spring-pushers"])
def flown(request):
    """A campaign, its flight, draws, and the block."""
    campaign = sepmc.load(request.param, {"run.history_step_s": 0.0})
    flight = select_steps(campaign)
    draws = campaign.in_si(campaign.sample(0, 400, 3, 400))
    return campaign, flight, draws, integrate(campaign, flight, draws)


def true_errors(campaign, flight, draws, block):
    finer = integrate(campaign, replace(flight.refined(4), error_limit=np.inf), draws)
    n, decides = len(campaign.outcome_columns), decisive(campaign.outcome_columns)
    return errors(block.outcomes[:, :n], finer.outcomes[:, :n], flight.scale)[:, decides].max(
        axis=1
    )


def test_rows_tell_their_error(flown):
    """Of cases that no trial knew: never below a third of the true one; not far above it."""
    campaign, flight, draws, block = flown
    share = true_errors(campaign, flight, draws, block) / block.error
    assert (block.status == Status.OK).all()
    assert share.max() < 3.0
    assert np.median(share) > 0.1
    assert block.error.max() <= campaign.scene.solver.accuracy


def test_what_is_told_of_the_whole(flown):
    """No outcome of any case is told to be better than the cases are."""
    campaign, _, _, block = flown
    most = block.refinement.error[decisive(campaign.outcome_columns)].max()
    assert most == pytest.approx(block.error.max(), rel=1e-12)
    assert block.refinement.n_refined <= 0.01 * len(block.error)
    assert block.refinement.n_unconverged == 0


def test_too_large_an_error_is_flown_again(flown):
    """Cases beyond what is allowed fly at finer steps; the others are left as they are, bit for
    bit."""
    campaign, flight, draws, _ = flown
    block = integrate(campaign, replace(flight, error_limit=np.inf), draws)
    most = float(np.quantile(block.error, 0.95))
    again = integrate(campaign, replace(flight, error_limit=most), draws)
    beyond = block.error > most
    assert again.refinement.n_refined == np.count_nonzero(beyond) == 20
    assert_array_equal(again.outcomes[~beyond], block.outcomes[~beyond])
    # what the finer steps changed is what was wrong before, so that it is no more than was told
    assert (again.error[beyond] < 2.0 * block.error[beyond]).all()
    steps = [c.name for c in campaign.result_columns].index("steps")
    assert (again.outcomes[beyond, steps] > 1.5 * block.outcomes[beyond, steps]).all()
    before, after = (true_errors(campaign, flight, draws, x)[beyond] for x in (block, again))
    assert np.median(after) < 0.05 * np.median(before)


def test_column_of_a_run_and_of_a_single_case():
    campaign = sepmc.load("table2", {"run.history_step_s": 0.0})
    result = campaign.run(cases=40, seed=2)
    rows = result.to_pandas()
    assert ((rows["error"] > 0.0) & (rows["error"] < 1e-9)).all()
    assert result.accuracy.worst[1] >= rows["error"].max()
    single = campaign.simulate(result.case(3))
    assert 0.0 < single.attrs["outcomes"]["error"] <= campaign.scene.solver.accuracy
