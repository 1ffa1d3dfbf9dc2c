"""The check of a model: false alarms at the stated rate, and faults that are named."""

import numpy as np
import pytest

from sepmc.analysis.model_check import check_model

SAMPLES, DIMENSIONS, PARTICLES = 60, 4, 200
TIME = np.linspace(0.0, 1.0, SAMPLES)


def checked(seed, fault=0.0, noise=1.0, truth=None):
    """Check of a linear model with its exact posterior, by measurements with a ``fault``."""
    random = np.random.default_rng(seed)
    powers = TIME[:, None] ** np.arange(DIMENSIONS)
    matrix = powers * np.array([3.0, 3.0, 0.3, 0.01])
    scores = random.standard_normal(DIMENSIONS) if truth is None else truth
    measured = matrix @ scores + noise * random.standard_normal(SAMPLES) + fault
    spread = np.linalg.inv(np.eye(DIMENSIONS) + matrix.T @ matrix)
    posterior = random.multivariate_normal(spread @ matrix.T @ measured, spread, PARTICLES)
    return check_model([TIME], [measured], [posterior @ matrix.T], posterior)


def test_p_values_of_a_model_that_is_right_are_uniform():
    checks = [checked(seed) for seed in range(60)]
    for name in ("blocks", "parameters", "noise"):
        values = np.array([getattr(one, name).p_value for one in checks])
        assert np.mean(values < 0.1) == pytest.approx(0.1, abs=0.12)  # three deviations
        assert np.mean(values < 0.5) == pytest.approx(0.5, abs=0.2)
    assert sum(one.is_short for one in checks) <= 3  # more in 1 of 300 runs


def test_an_effect_that_is_missing_is_named_with_its_time():
    fault = np.where((TIME > 0.4) & (TIME < 0.5), 4.0, 0.0)
    checks = [checked(seed, fault) for seed in range(20)]
    assert all(one.blocks.fails for one in checks)
    assert all(one.worst.start_s > 0.35 and one.worst.end_s < 0.55 for one in checks)


def test_parameters_outside_their_distributions_are_named():
    one = checked(0, truth=np.array([6.0, 0.0, 0.0, 0.0]))
    assert one.parameters.fails
    assert one.is_short
    assert not one.blocks.fails


def test_noise_beyond_sigma_is_no_shortfall_of_the_model():
    one = checked(3, noise=1.3)
    assert one.noise.fails
    assert not one.parameters.fails


def test_a_sigma_that_is_far_too_large_is_named():
    """And one that is right, or 1.4 times too large, is not."""
    small = [checked(seed, noise=0.2).channels[0] for seed in range(10)]
    assert all(one.is_too_small for one in small)
    assert np.mean([one.ratio for one in small]) == pytest.approx(0.2, abs=0.03)
    right = [checked(seed, noise=noise).channels[0] for seed in range(10) for noise in (0.7, 1.0)]
    assert not any(one.is_too_small for one in right)
    assert not any(checked(seed, noise=0.2).noise.fails for seed in range(3))
