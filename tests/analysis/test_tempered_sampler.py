"""Posterior samples: against closed forms, and along thin posteriors."""

import numpy as np
import pytest
from scipy.special import ndtr

from sepmc.analysis import tempered_sampler
from sepmc.analysis.surrogate_moves import Coordinates
from sepmc.analysis.tempered_sampler import NoLikelihoodError, sample_posterior


def linear_problem(samples=30, dimensions=3, seed=0):
    """Matrix and measurements of a linear model, in sigma."""
    random = np.random.default_rng(seed)
    matrix = random.standard_normal((samples, dimensions)) * np.geomspace(3.0, 0.1, dimensions)
    return matrix, matrix @ random.standard_normal(dimensions) + random.standard_normal(samples)


def sampled(size=400, seed=1, problem=None):
    matrix, measured = problem or linear_problem()
    return sample_posterior(
        lambda z: measured - z @ matrix.T, matrix.shape[1], size, np.random.default_rng(seed)
    )


def test_a_linear_model_has_the_posterior_and_the_evidence_of_the_closed_form():
    matrix, measured = linear_problem()
    sample = sampled()
    precision = np.eye(3) + matrix.T @ matrix
    mean, spread = np.linalg.solve(precision, matrix.T @ measured), np.linalg.inv(precision)
    deviation = np.sqrt(np.diag(spread))
    assert np.abs((sample.scores.mean(axis=0) - mean) / deviation).max() < 0.2
    assert sample.scores.std(axis=0) / deviation == pytest.approx(1.0, abs=0.12)
    covariance = np.eye(len(measured)) + matrix @ matrix.T
    evidence = -0.5 * measured @ np.linalg.solve(covariance, measured)
    evidence -= 0.5 * np.linalg.slogdet(covariance)[1]
    assert sample.log_evidence == pytest.approx(evidence, abs=0.4)
    assert sample.temperatures[-1] == 1.0
    assert (np.diff(sample.temperatures) > 0.0).all()


def test_a_seed_gives_the_same_bits_and_another_one_does_not():
    first, again, other = sampled(100), sampled(100), sampled(100, seed=2)
    assert first.scores.tobytes() == again.scores.tobytes()
    assert first.log_evidence == again.log_evidence
    assert first.scores.tobytes() != other.scores.tobytes()


def test_particles_move_along_a_thin_posterior_of_uniform_inputs():
    """Eight inputs of which three sums are known to 4e-3 of their spread."""
    random = np.random.default_rng(3)
    matrix = 100.0 * random.standard_normal((3, 8))

    def inputs(scores):
        return 12.0**0.5 * (ndtr(scores) - 0.5)

    measured = inputs(random.standard_normal(8)) @ matrix.T
    table = np.tile(inputs(Coordinates.knots())[:, None], 8)
    sample = sample_posterior(
        lambda z: measured - inputs(z) @ matrix.T,
        8,
        200,
        random,
        Coordinates(table),
    )
    assert sample.correlation < 3.0 / 200**0.5
    assert sample.sweeps < 4 * len(sample.temperatures)
    assert np.abs(measured - inputs(sample.scores) @ matrix.T).max() < 6.0  # sigma


def test_particles_that_hardly_move_are_worth_few_independent_ones(monkeypatch):
    """As few as the scatter of means from seed to seed says."""
    matrix, measured = linear_problem()
    precision = np.eye(3) + matrix.T @ matrix
    mean, spread = np.linalg.solve(precision, matrix.T @ measured), np.linalg.inv(precision)

    def effective(seeds):
        samples = [sampled(100, seed) for seed in range(seeds)]
        errors = np.array([one.scores.mean(axis=0) - mean for one in samples])
        actual = np.diag(spread) / (errors**2).mean(axis=0)
        return np.mean([one.effective for one in samples], axis=0), actual

    stated, actual = effective(30)
    assert (stated > 90.0).all()
    assert (actual > 45.0).all()
    move = tempered_sampler._GlobalMove.propose
    monkeypatch.setattr(
        tempered_sampler._GlobalMove,
        "propose",
        lambda own, scores, rest, length, random: move(own, scores, rest, 0.3, random),
    )
    for name, value in (("_GLOBAL", 1), ("_SWEEPS", 2), ("_LAST_SWEEPS", 2)):
        monkeypatch.setattr(tempered_sampler, name, value)
    stated, actual = effective(30)
    assert (stated < 25.0).all()
    assert (actual < 25.0).all()


def test_what_is_impossible_has_no_samples():
    def residuals(scores):
        return np.where(scores < 0.5, np.nan, scores - 1.0)

    sample = sample_posterior(residuals, 1, 200, np.random.default_rng(0))
    assert (sample.scores >= 0.5).all()
    with pytest.raises(NoLikelihoodError):
        sample_posterior(lambda z: np.full_like(z, np.nan), 2, 50, np.random.default_rng(0))


def test_a_posterior_that_is_too_far_ends(monkeypatch):
    """The number of temperatures is bounded."""
    monkeypatch.setattr(tempered_sampler, "_TEMPERATURES", 3)
    with pytest.raises(tempered_sampler.FarPosteriorError):
        sample_posterior(lambda z: 1e4 * (z - 4.0), 2, 50, np.random.default_rng(0))


def test_coordinates_and_scores_are_inverse():
    """A discrete input, which does not rise, has its score as coordinate."""
    knots = Coordinates.knots()
    table = np.column_stack([ndtr(knots), np.exp(knots), np.sign(knots)])
    coordinates = Coordinates(table)
    scores = np.random.default_rng(0).standard_normal((50, 3))
    values = coordinates.of(scores)
    back, within = coordinates.scores(values)
    assert within.all()
    assert back == pytest.approx(scores, abs=1e-12)
    assert values[:, 2] == pytest.approx(scores[:, 2])
    assert not coordinates.scores(np.full((1, 3), 100.0))[1].any()
