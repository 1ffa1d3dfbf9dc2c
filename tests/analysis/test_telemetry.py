"""Telemetry against the cases of a run: shift, envelope, residuals, nearest cases."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sepmc.analysis.telemetry import Channel, Histories, compare_channels, noise_of
from sepmc.scene.messages import InputError

STEP, ROWS, CASES = 0.01, 101, 20
TIMES = np.arange(ROWS) * STEP


def history(case):
    """Two columns of a case: a rate that grows, and an acceleration with a step."""
    rng = np.random.default_rng(case)
    a, b, c = rng.normal([2.0, 1.0, 5.0], [0.4, 0.2, 0.5])
    return np.array([a * TIMES**2 + b * np.sin(4 * TIMES), np.where(TIMES < 0.3, 0.0, c)])


def histories(skip=()):
    numbers = np.array([k for k in range(CASES) if k not in skip])
    nominal = np.array([2.0 * TIMES**2 + np.sin(4 * TIMES), np.where(TIMES < 0.3, 0.0, 5.0)])
    return Histories(numbers, ("rate", "acc"), STEP, np.array([*map(history, numbers)]), nominal)


def flight(case, shift, seed, noise=(0.01, 0.05), step=0.004):
    """Telemetry of a case, sampled in other times, from before it to after it."""
    rng = np.random.default_rng(seed)
    time = np.arange(-0.31, 1.4, step)
    rows = [np.interp(np.clip(time, 0, 1), TIMES, x) for x in history(case)]
    noisy = [x + s * rng.standard_normal(len(time)) for x, s in zip(rows, noise, strict=True)]
    return {n: Channel(time + shift, x) for n, x in zip(("rate", "acc"), noisy, strict=True)}


@pytest.mark.slow
def test_known_shift_and_case_are_recovered():
    """Over 16 noisy flights the shift is off by one standard error in the mean square."""
    pulls = []
    for seed in range(16):
        shift = -3.0 + 17.123 * seed
        result = compare_channels(flight(seed, shift, seed), histories())
        assert result.shift.is_estimated
        assert result.nearest[0][0] == seed
        assert result.nearest[0][1] < 0.5 * result.nearest[1][1]
        assert result.shift.error < 0.004
        pulls.append((result.shift.value - shift) / result.shift.error)
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 1.5
    assert max(map(abs, pulls)) < 3.5


def test_shift_of_a_flight_that_is_no_case_has_the_error_of_the_cases():
    for case in range(6):
        result = compare_channels(flight(case, 12.0, case), histories(skip=(case,)))
        assert abs(result.shift.value - 12.0) < 3.0 * result.shift.error
        assert result.shift.error > 0.001


def test_table_of_a_known_difference():
    """A flight that is the nominal case plus 0.25 from 0.5 s on."""
    cases = histories()
    time = np.linspace(0.0, 1.0, 201)
    rate = np.interp(time, TIMES, cases.nominal[0]) + np.where(time >= 0.5, 0.25, 0.0)
    one = Histories(cases.numbers, ("rate",), STEP, cases.values[:, :1], cases.nominal[:1])
    result = compare_channels({"rate": Channel(time + 7.0, rate)}, one, 7.0)
    row = result.channels.loc["rate"]
    assert not result.shift.is_estimated
    assert row["samples"] == 201
    assert_allclose(row["residual_max"], 0.25)
    assert_allclose(row["residual_rms"], 0.25 * np.sqrt(101 / 201))
    assert row["residual_max_at_s"] >= 0.5
    instant = row["envelope_used_at_s"]
    own = [np.interp(instant, TIMES, x) for x in one.values[:, 0]]
    low, median, high = np.percentile(own, [0.5, 50.0, 99.5])
    value = np.interp(instant, TIMES, cases.nominal[0]) + (0.25 if instant >= 0.5 else 0.0)
    half = high - median if value > median else median - low
    widened = np.hypot(half, 2.5758 * noise_of(rate))
    assert_allclose(row["envelope_used"], abs(value - median) / widened, rtol=1e-4)


def wrapped(angles):
    """Angles, deg, within -180 and 180."""
    return (angles + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("as_measured", [lambda a: a % 360.0, wrapped, lambda a: a + 1080.0])
def test_angles_are_compared_up_to_full_turns(as_measured):
    """A roll through several turns, whose cases begin on both sides of 180 deg, is compared as if
    it did not jump: the shift, the envelope, residuals and nearest cases are the same."""
    rng = np.random.default_rng(4)
    starts, rates = rng.normal(180.0, 20.0, CASES), rng.normal(900.0, 30.0, CASES)
    swing = 40.0 * np.sin(9.0 * TIMES)
    curves = starts[:, None] + rates[:, None] * TIMES + swing
    nominal = 180.0 + 900.0 * TIMES + swing
    time = np.arange(0.05, 0.9, 0.004)
    flown = np.interp(time, TIMES, curves[7]) + 0.1 * rng.standard_normal(len(time))

    def compared(angles, change):
        own = Histories(
            np.arange(CASES), ("roll",), STEP, angles(curves)[:, None], angles(nominal)[None]
        )
        return compare_channels({"roll": Channel(time + 3.0, change(flown), "deg")}, own)

    result, expected = compared(wrapped, as_measured), compared(np.array, np.array)
    assert expected.nearest[0][0] == 7
    assert abs(expected.shift.value - 3.0) < 3.0 * expected.shift.error
    assert_allclose(result.shift.value, expected.shift.value, atol=1e-9)
    assert_allclose(result.shift.error, expected.shift.error, rtol=1e-6)
    assert [case for case, _ in result.nearest] == [case for case, _ in expected.nearest]
    columns = ["envelope_used", "inside_99", "residual_rms", "residual_max"]
    assert_allclose(
        result.channels[columns].to_numpy(float), expected.channels[columns].to_numpy(float),
        rtol=1e-6,
    )  # fmt: skip


def test_flight_outside_the_envelope_is_not_inside():
    cases = histories()
    rate = cases.nominal[0] + np.where(TIMES >= 0.5, 10.0, 0.0)
    one = Histories(cases.numbers, ("rate",), STEP, cases.values[:, :1], cases.nominal[:1])
    row = compare_channels({"rate": Channel(TIMES, rate)}, one, 0.0).channels.loc["rate"]
    assert row["envelope_used"] > 3.0
    assert_allclose(row["inside_99"], 0.5, atol=0.02)


@pytest.mark.parametrize("sigma", [0.02, 3.0])
def test_noise_is_measured(sigma):
    time = np.linspace(0.0, 3.0, 3001)
    noisy = np.sin(time) + sigma * np.random.default_rng(1).standard_normal(len(time))
    assert_allclose(noise_of(noisy), sigma, rtol=0.05)


def test_channels_that_do_not_move_have_no_shift():
    still = Histories(np.arange(3), ("x",), STEP, np.ones((3, 1, ROWS)), np.ones((1, ROWS)))
    with pytest.raises(InputError, match="do not change over time"):
        compare_channels({"x": Channel(TIMES + 4.0, np.ones(ROWS))}, still)


def test_flight_of_another_time_is_refused():
    with pytest.raises(InputError, match="0 samples within the run"):
        compare_channels(flight(1, 100.0, 1), histories(), 0.0)


def test_case_that_ends_early_counts_by_what_it_has():
    cases = histories()
    cases.values[5, :, 60:] = np.nan
    result = compare_channels(flight(5, 0.0, 5), cases, 0.0)
    assert result.nearest[0][0] == 5
    assert result.curves.notna().all(axis=None)
