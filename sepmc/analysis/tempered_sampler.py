"""Tempered sequential Monte Carlo: samples of a posterior whose prior is standard normal.

The scores, the unknowns, are independent standard normal variables under the prior; the residuals
of the model (measured minus predicted values, in sigma) are normal. Particles are points in the
space of scores.

The likelihood is raised to powers (here called temperatures) from 0 to 1, each chosen so that half
of the particles stay effective (Del Moral, Doucet and Jasra, J. R. Stat. Soc. B 68 (2006) 411). At
each temperature, particles are resampled and then moved until their correlation with the start is
small, by two kinds of Metropolis moves: chains on a surrogate (`sepmc.analysis.surrogate_moves`),
and, for effects that a regression does not represent, a Crank-Nicolson proposal that preserves a t
distribution with the mean and covariance of the particles (Grumitt, Karamanis and Seljak, Inverse
Problems 40 (2024) 125023). Approximations affect proposals alone; the likelihood is that of the
model.

No library fits: a likelihood here is one call of a kernel for all particles, of a model that no
library can trace. blackjax needs a likelihood in JAX; pocoMC needs torch, and is under the GPL;
emcee gives no evidence; dynesty evaluates one point after the other; the package particles samples
from the global random state of numpy.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sepmc.analysis.surrogate_moves import Coordinates, SurrogateMove

_EFFECTIVE = 0.5  # fraction of the particles that a temperature leaves effective
_FREEDOM = 5.0  # degrees of freedom of the t distribution: tails heavier than those of a posterior
_ACCEPTED = 0.5  # acceptance rate below which proposals become shorter
_ADAPTED = 1.5  # largest factor of the length of a proposal from one sweep to the next
_SHORTEST = 1e-2  # proposal
_GLOBAL = 4  # one in so many sweeps proposes by the t distribution
_CORRELATED = 0.5  # with the start of a temperature, at which moves end
_SWEEPS, _LAST_SWEEPS = 20, 100  # at most, of a temperature and of the last one
_TEMPERATURES = 150  # at most
# maps scores (n, d) to residuals (n, m) in sigma, NaN where a case has none
Residuals = Callable[[np.ndarray], np.ndarray]


class NoLikelihoodError(ValueError):
    """Error: no sample of the prior has a likelihood above 0 (finite residuals)."""


class FarPosteriorError(ValueError):
    """Error: the posterior is so far from the prior that 150 temperatures do not reach it."""


@dataclass(frozen=True)
class PosteriorSample:
    """Sample of a posterior, n particles of equal weight in random order.

    Attributes
    ----------
    scores : ndarray, shape (n, d)
        The d unknowns of each particle, independent standard normal variables under the prior.
    log_likelihood : ndarray, shape (n,)
        Minus half of the sum of the squares of its residuals.
    log_evidence : float
        Natural logarithm of the mean over the prior of this likelihood.
    temperatures : tuple of float
        Powers of the likelihood that were used, rising to 1.
    sweeps : int
        Number of proposed moves of each particle, at all temperatures together.
    correlation : float
        Largest correlation, of all d scores, between the particles and their start at the last
        temperature, where some are copies of one another; near 0 if they moved enough.
    acceptance : float
        Fraction of the moves proposed at the last temperature that were accepted.
    effective : ndarray, shape (d,)
        Effective sample size of each score: the number of independent particles whose mean would be
        as uncertain.
    """

    scores: np.ndarray
    log_likelihood: np.ndarray
    log_evidence: float
    temperatures: tuple[float, ...]
    sweeps: int
    correlation: float
    acceptance: float
    effective: np.ndarray


def sample_posterior(
    residuals: Residuals,
    dimensions: int,
    size: int,
    random: np.random.Generator,
    coordinates: Coordinates | None = None,
    report: Callable[[float, int], None] | None = None,
) -> PosteriorSample:
    """Sample a posterior whose prior is standard normal.

    Parameters
    ----------
    residuals : callable
        The model: maps scores (n, d) to residuals (n, m) in sigma, NaN where a case has none.
    dimensions, size : int
        Number d of scores, and number n of particles.
    random : Generator
    coordinates : Coordinates, optional
        Functions of the scores in which the residuals are nearly quadratic; default the scores
        themselves.
    report : callable (temperature, sweeps), optional
        Called after each move of all particles, with the temperature and the number of moves so
        far.

    Returns
    -------
    PosteriorSample

    Raises
    ------
    NoLikelihoodError
        If no sample of the prior has finite residuals.
    FarPosteriorError
        If 150 temperatures do not reach 1.
    """
    if coordinates is None:
        coordinates = Coordinates(np.tile(Coordinates.knots()[:, None], dimensions))
    scores = random.standard_normal((size, dimensions))
    rest = residuals(scores)
    logs = _log_likelihood(rest)
    if not np.isfinite(logs).any():
        raise NoLikelihoodError
    temperature, temperatures, log_evidence = 0.0, list[float](), 0.0
    sweeps, correlations, lengths = 0, np.zeros(dimensions), [1.0, 1.0]
    effective, acceptances = np.full(dimensions, float(size)), list[float]()
    while temperature < 1.0:
        increment = _increment(logs, 1.0 - temperature)
        weights = _weights(increment * logs)
        log_evidence += _log_mean_exp(increment * logs)
        temperature = min(temperature + increment, 1.0)
        if len(temperatures) == _TEMPERATURES:
            raise FarPosteriorError
        temperatures.append(temperature)
        moves: tuple[SurrogateMove | _GlobalMove, ...] = (
            SurrogateMove.of(scores, rest, weights, temperature, coordinates),
            _GlobalMove.of(scores, weights),
        )
        chosen = _resample(weights, random)
        scores, rest, logs = scores[chosen], rest[chosen], logs[chosen]
        start, last, acceptances = scores, temperature == 1.0, []
        enough = 3.0 / math.sqrt(size) if last else _CORRELATED
        for sweep in range(_LAST_SWEEPS if last else _SWEEPS):
            which = int(sweep % _GLOBAL == _GLOBAL - 1)
            proposal, context = moves[which].propose(scores, rest, lengths[which], random)
            new = residuals(proposal)
            proposed = _log_likelihood(new)
            log_ratio = moves[which].log_ratio(proposal, context)
            with np.errstate(invalid="ignore"):
                log_ratio += temperature * (proposed - logs)
                log_ratio += 0.5 * ((scores**2).sum(axis=1) - (proposal**2).sum(axis=1))
            accepted = np.log(random.random(size)) < log_ratio
            scores = np.where(accepted[:, None], proposal, scores)
            rest = np.where(accepted[:, None], new, rest)
            logs = np.where(accepted, proposed, logs)
            sweeps += 1
            acceptances.append(float(accepted.mean()))
            change = min(max(acceptances[-1] / _ACCEPTED, 0.5), _ADAPTED)
            lengths[which] = float(np.clip(lengths[which] * change, _SHORTEST, 1.0))
            if report:
                report(temperature, sweeps)
            correlations = _correlations(start, scores)
            if correlations.max() < enough:
                break
        effective = _effective(effective, weights, correlations)
    order = random.permutation(size)  # copies of one particle stood together
    return PosteriorSample(
        scores[order],
        logs[order],
        log_evidence,
        tuple(temperatures),
        sweeps,
        float(correlations.max()),
        float(np.mean(acceptances)),
        effective,
    )


def _log_likelihood(residuals: np.ndarray) -> np.ndarray:
    """Return the log likelihoods (n,), up to a constant, of residuals (n, m) in sigma; minus
    infinity where a residual is NaN."""
    logs = -0.5 * (residuals**2).sum(axis=1)
    return np.where(np.isnan(logs), -np.inf, logs)


@dataclass(frozen=True)
class _GlobalMove:
    """Proposals that preserve a multivariate t distribution, given by its ``mean`` (d,) and the
    lower Cholesky ``factor`` (d, d) of its scale matrix."""

    mean: np.ndarray
    factor: np.ndarray

    @classmethod
    def of(cls, scores: np.ndarray, weights: np.ndarray) -> "_GlobalMove":
        """Fit the distribution to particles with ``scores`` (n, d) and ``weights`` (n,), which add
        up to 1: its mean is theirs, and its scale matrix is their covariance. The fewer are
        effective, the more correlations are reduced towards 0."""
        mean = weights @ scores
        offsets = scores - mean
        covariance = (weights[:, None] * offsets).T @ offsets
        count, dimensions = 1.0 / (weights**2).sum(), scores.shape[1]
        diagonal = np.diag(np.diag(covariance))
        shrinkage = dimensions / (dimensions + count)
        covariance = (1.0 - shrinkage) * covariance + shrinkage * diagonal
        return cls(mean, np.linalg.cholesky(covariance + 1e-12 * np.eye(dimensions)))

    def propose(
        self, scores: np.ndarray, _: np.ndarray, length: float, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return proposals (n, d) from ``scores`` (n, d), and the squared Mahalanobis distances
        (n,) of the ``scores`` from the mean, which `log_ratio` takes. ``length``, above 0 and up to
        1, is the size of the move: at 1 the direction of a proposal from the mean does not depend
        on the scores. The second argument, the residuals, is not used."""
        size, dimensions = scores.shape
        distance = self._distance(scores)
        scale = 0.5 * (_FREEDOM + distance)
        scale /= random.gamma(0.5 * (_FREEDOM + dimensions), size=size)
        noise = random.standard_normal((size, dimensions)) @ self.factor.T
        proposal = self.mean + math.sqrt(1.0 - length**2) * (scores - self.mean)
        return proposal + length * np.sqrt(scale)[:, None] * noise, distance

    def log_ratio(self, proposal: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return the logarithm (n,) of the density of proposing the start from the proposal over
        that of the opposite; ``distance`` is the second result of `propose`."""
        new, half = self._distance(proposal), 0.5 * (_FREEDOM + proposal.shape[1])
        return np.asarray(half * (np.log1p(new / _FREEDOM) - np.log1p(distance / _FREEDOM)))

    def _distance(self, scores: np.ndarray) -> np.ndarray:
        """Return the squared Mahalanobis distances (n,) of scores (n, d) from the mean, by the
        scale matrix."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415

        offsets = solve_triangular(self.factor, (scores - self.mean).T, lower=True)
        return np.asarray((offsets**2).sum(axis=0))


def _weights(logs: np.ndarray) -> np.ndarray:
    """Return weights (n,) that add up to 1 from their logarithms (n,), which need only be right up
    to a constant."""
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def _log_mean_exp(logs: np.ndarray) -> float:
    return float(logs.max() + np.log(np.mean(np.exp(logs - logs.max()))))


def _increment(logs: np.ndarray, most: float) -> float:
    """Return the increment of the temperature, at most ``most``, after which half of the particles
    with a finite log likelihood in ``logs`` (n,) are effective."""
    wanted = _EFFECTIVE * np.count_nonzero(np.isfinite(logs))

    def suffices(increment: float) -> bool:
        return bool(1.0 / (_weights(increment * logs) ** 2).sum() >= wanted)

    if suffices(most):
        return most
    low, high = 0.0, most
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if suffices(middle) else (low, middle)
    return high if low == 0.0 else low


def _resample(weights: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return indices (n,) of particles, each as often as its weight in ``weights`` (n,), which add
    up to 1, requires (systematic resampling)."""
    points = (np.arange(len(weights)) + random.random()) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), points), len(weights) - 1)


def _correlations(start: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Return for each of d scores the correlation (d,), over n particles, of its values in
    ``scores`` (n, d) with those in ``start`` (n, d): 0 for a score that has the same value in all
    particles."""
    a, b = start - start.mean(axis=0), scores - scores.mean(axis=0)
    product = (a * b).sum(axis=0)
    sizes = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return np.asarray(product / np.where(sizes > 0.0, sizes, 1.0))


def _effective(before: np.ndarray, weights: np.ndarray, correlations: np.ndarray) -> np.ndarray:
    """Return the effective sample size (d,) of each score after a temperature from that ``before``
    it (d,).

    Resampling by ``weights`` (n,), which add up to 1, makes copies and reduces it; moves restore
    it, the more the smaller the ``correlations`` (d,) with the start are.
    """
    size, kept = len(weights), correlations**2
    copies = before / (size * (weights**2).sum())
    return np.asarray(1.0 / ((1.0 - kept) / size + kept / copies))


__all__ = ["FarPosteriorError", "NoLikelihoodError", "PosteriorSample", "sample_posterior"]
