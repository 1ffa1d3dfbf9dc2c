"""Samples of a posterior over independent standard normal scores, of a model whose residuals are
normal: tempered sequential Monte Carlo.

The likelihood is raised to powers (temperatures) from 0 to 1, each chosen so that half of the
particles stay effective (Del Moral, Doucet and Jasra, J. R. Stat. Soc. B 68 (2006) 411). At each
one, particles are resampled and then moved until they have forgotten where they started, by two
Metropolis moves. One proposes from the local normal approximation of Gauss and Newton, so that it
follows curved ridges; its Jacobian is that of a quadratic regression of the residuals over the
particles. The other, for what a regression does not see, is a Crank-Nicolson proposal that keeps a
t distribution with mean and covariance of the particles (Grumitt, Karamanis and Seljak, Inverse
Problems 40 (2024) 125023). Approximations shape proposals alone; the likelihood is the model's.

The sampler is our own: a likelihood here is one call of a kernel for all particles, of a model that
no library can trace. blackjax needs one in JAX; pocoMC needs torch, and is under the GPL; emcee has
no evidence; dynesty asks for one point after the other; particles draws from the global random
state of numpy, which others share.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_EFFECTIVE = 0.5  # fraction of the particles that a temperature leaves effective
_FREEDOM = 5.0  # degrees of freedom of the t distribution: tails heavier than those of a posterior
_ACCEPTED = 0.5  # acceptance rate below which proposals become shorter
_ADAPTED = 1.5  # largest factor of the length of a proposal from one sweep to the next
_SHORTEST = 1e-2  # proposal
_GLOBAL = 4  # one in so many sweeps proposes by the t distribution
_CORRELATED = 0.5  # with the start of a temperature, at which moves end
_SWEEPS, _LAST_SWEEPS = 20, 100  # at most, of a temperature and of the last one
_COMPONENTS = 40  # principal components of the residuals, at most
_NEGLIGIBLE = 1e-3  # variance of a component, at the temperature
_POINTS_PER_TERM = 3  # of the regression, at least

# maps scores (n, d) to residuals (n, m) in sigma, NaN where a case has none
Residuals = Callable[[np.ndarray], np.ndarray]


class NoLikelihoodError(ValueError):
    """No sample of the prior has a likelihood above 0."""


@dataclass(frozen=True)
class PosteriorSample:
    """Sample of a posterior.

    Attributes
    ----------
    scores : ndarray, shape (n, d)
    log_likelihood : ndarray, shape (n,)
        Minus half of the sum of the squares of the residuals.
    log_evidence : float
        Natural logarithm of the mean of this likelihood over the prior.
    temperatures : tuple of float
        Rising to 1.
    sweeps : int
        Moves of every particle, of all temperatures.
    correlation : float
        Largest correlation over the dimensions of the scores with those at the start of the last
        temperature, where particles have copies.
    """

    scores: np.ndarray
    log_likelihood: np.ndarray
    log_evidence: float
    temperatures: tuple[float, ...]
    sweeps: int
    correlation: float


def sample_posterior(
    residuals: Residuals,
    dimensions: int,
    size: int,
    random: np.random.Generator,
    report: Callable[[float, int], None] | None = None,
) -> PosteriorSample:
    """Sample a posterior whose prior is standard normal.

    Parameters
    ----------
    residuals : callable
        Maps scores (n, d) to residuals (n, m).
    dimensions, size : int
        Of the scores, d and n.
    random : Generator
    report : callable (temperature, sweeps), optional

    Returns
    -------
    PosteriorSample

    Raises
    ------
    NoLikelihoodError
    """
    scores = random.standard_normal((size, dimensions))
    rest = residuals(scores)
    logs = _log_likelihood(rest)
    if not np.isfinite(logs).any():
        raise NoLikelihoodError
    temperature, temperatures, log_evidence = 0.0, list[float](), 0.0
    sweeps, correlation, lengths = 0, 0.0, [1.0, 1.0]
    while temperature < 1.0:
        increment = _increment(logs, 1.0 - temperature)
        weights = _weights(increment * logs)
        log_evidence += _log_mean_exp(increment * logs)
        temperature = min(temperature + increment, 1.0)
        temperatures.append(temperature)
        moves: tuple[_Move, _Move] = (
            _LocalMove.of(scores, rest, temperature),
            _GlobalMove.of(scores, weights),
        )
        chosen = _resample(weights, random)
        scores, rest, logs = scores[chosen], rest[chosen], logs[chosen]
        start, last = scores, temperature == 1.0
        enough = 3.0 / math.sqrt(size) if last else _CORRELATED
        for sweep in range(_LAST_SWEEPS if last else _SWEEPS):
            which = int(sweep % _GLOBAL == _GLOBAL - 1)
            proposal, context = moves[which].propose(scores, rest, lengths[which], random)
            new = residuals(proposal)
            proposed = _log_likelihood(new)
            log_ratio = moves[which].log_ratio(proposal, new, context)
            with np.errstate(invalid="ignore"):
                log_ratio += temperature * (proposed - logs)
                log_ratio += 0.5 * ((scores**2).sum(axis=1) - (proposal**2).sum(axis=1))
            accepted = np.log(random.random(size)) < log_ratio
            scores = np.where(accepted[:, None], proposal, scores)
            rest = np.where(accepted[:, None], new, rest)
            logs = np.where(accepted, proposed, logs)
            sweeps += 1
            change = min(max(accepted.mean() / _ACCEPTED, 0.5), _ADAPTED)
            lengths[which] = float(np.clip(lengths[which] * change, _SHORTEST, 1.0))
            if report:
                report(temperature, sweeps)
            correlation = _largest_correlation(start, scores)
            if correlation < enough:
                break
    order = random.permutation(size)  # copies of one particle stood together
    return PosteriorSample(
        scores[order], logs[order], log_evidence, tuple(temperatures), sweeps, correlation
    )


def _log_likelihood(residuals: np.ndarray) -> np.ndarray:
    """Log likelihoods (n,); minus infinity where a residual is NaN."""
    logs = -0.5 * (residuals**2).sum(axis=1)
    return np.where(np.isnan(logs), -np.inf, logs)


@dataclass(frozen=True)
class _GlobalMove:
    """Proposals that keep a t distribution: ``mean`` (d,), Cholesky ``factor`` (d, d) of its
    scale."""

    mean: np.ndarray
    factor: np.ndarray

    @classmethod
    def of(cls, scores: np.ndarray, weights: np.ndarray) -> "_GlobalMove":
        """Fit to weighted particles (n, d); with few of them, correlations shrink."""
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
        """Proposals (n, d), and what `log_ratio` needs. A ``length`` of 1 forgets the scores."""
        size, dimensions = scores.shape
        distance = self._distance(scores)
        scale = 0.5 * (_FREEDOM + distance)
        scale /= random.gamma(0.5 * (_FREEDOM + dimensions), size=size)
        noise = random.standard_normal((size, dimensions)) @ self.factor.T
        proposal = self.mean + math.sqrt(1.0 - length**2) * (scores - self.mean)
        return proposal + length * np.sqrt(scale)[:, None] * noise, distance

    def log_ratio(self, proposal: np.ndarray, _: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Logs (n,) of the ratio of the densities of proposing back and forth."""
        new, half = self._distance(proposal), 0.5 * (_FREEDOM + proposal.shape[1])
        return np.asarray(half * (np.log1p(new / _FREEDOM) - np.log1p(distance / _FREEDOM)))

    def _distance(self, scores: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distances (n,)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415

        offsets = solve_triangular(self.factor, (scores - self.mean).T, lower=True)
        return np.asarray((offsets**2).sum(axis=0))


@dataclass(frozen=True)
class _LocalMove:
    """Proposals from the local normal approximation of a posterior at a temperature.

    Attributes
    ----------
    basis : ndarray, shape (k, m)
        Principal components of the residuals, orthonormal.
    slope : ndarray, shape (k, d)
        Derivatives of the components at scores 0.
    curvature : ndarray, shape (d, k, d)
        Second derivatives.
    temperature : float
    """

    basis: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
    temperature: float

    @classmethod
    def of(cls, scores: np.ndarray, residuals: np.ndarray, temperature: float) -> "_LocalMove":
        """Regression over particles (n, d) with residuals (n, m)."""
        known = np.isfinite(residuals).all(axis=1)
        scores, offsets = scores[known], residuals[known]
        count, dimensions = scores.shape
        offsets = offsets - offsets.mean(axis=0)
        _, sizes, basis = np.linalg.svd(offsets, full_matrices=False)
        kept = sizes[:_COMPONENTS] ** 2 * temperature > _NEGLIGIBLE * count
        basis = basis[:_COMPONENTS][kept]
        components = offsets @ basis.T
        terms = [np.ones((count, 1)), scores]
        linear = np.linalg.lstsq(np.hstack(terms), components, rcond=None)[0][1:]
        most = int(math.sqrt(2.0 * max(count / _POINTS_PER_TERM - dimensions, 0.0)))
        curved = np.sort(np.argsort(-(linear**2).sum(axis=1), kind="stable")[: max(most - 1, 0)])
        first, second = (curved[k] for k in np.triu_indices(len(curved)))
        terms.append(scores[:, first] * scores[:, second])
        fit = np.linalg.lstsq(np.hstack(terms), components, rcond=None)[0]
        curvature = np.zeros((dimensions, len(basis), dimensions))
        np.add.at(curvature, (first, slice(None), second), fit[1 + dimensions :])
        np.add.at(curvature, (second, slice(None), first), fit[1 + dimensions :])
        return cls(basis, fit[1 : 1 + dimensions].T, curvature, temperature)

    def propose(
        self, scores: np.ndarray, residuals: np.ndarray, length: float, random: np.random.Generator
    ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
        """Proposals (n, d), and what `log_ratio` needs. A ``length`` of 1 goes to the local
        maximum before the random step."""
        centre, factor = self._approximation(scores, residuals, length)
        noise = random.standard_normal(scores.shape)
        step = np.linalg.solve(np.swapaxes(factor, 1, 2), noise[:, :, None])[:, :, 0]
        proposal = centre + length * step
        forth = _log_density(noise, factor)
        return proposal, (scores, residuals, forth, length)

    def log_ratio(
        self,
        proposal: np.ndarray,
        residuals: np.ndarray,
        context: tuple[np.ndarray, np.ndarray, np.ndarray, float],
    ) -> np.ndarray:
        """Logs (n,) of the ratio of the densities of proposing back and forth."""
        scores, _, forth, length = context
        centre, factor = self._approximation(proposal, np.nan_to_num(residuals), length)
        noise = (np.swapaxes(factor, 1, 2) @ (scores - centre)[:, :, None])[:, :, 0] / length
        return _log_density(noise, factor) - forth

    def _approximation(
        self, scores: np.ndarray, residuals: np.ndarray, length: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, d) of proposals, and Cholesky factors (n, d, d) of the local precision."""
        size, dimensions = scores.shape
        components = len(self.basis)
        bend = (scores @ self.curvature.reshape(dimensions, -1)).reshape(size, components, -1)
        jacobian = self.slope + bend
        transposed = np.swapaxes(jacobian, 1, 2)
        precision = np.eye(dimensions) + self.temperature * (transposed @ jacobian)
        gradient = transposed @ (residuals @ self.basis.T)[:, :, None]
        newton = np.linalg.solve(precision, self.temperature * gradient + scores[:, :, None])
        stride = 1.0 - math.sqrt(1.0 - length**2)
        return scores - stride * newton[:, :, 0], np.linalg.cholesky(precision)


_Move = _GlobalMove | _LocalMove


def _log_density(noise: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Logs (n,) of normal densities, but for a constant, from standard noise (n, d) and Cholesky
    factors (n, d, d) of the precision."""
    log_diagonal = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(log_diagonal - 0.5 * (noise**2).sum(axis=1))


def _weights(logs: np.ndarray) -> np.ndarray:
    """Normalised weights (n,)."""
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def _log_mean_exp(logs: np.ndarray) -> float:
    return float(logs.max() + np.log(np.mean(np.exp(logs - logs.max()))))


def _increment(logs: np.ndarray, most: float) -> float:
    """Increment of the temperature, at most ``most``, that leaves a fraction of the possible
    particles effective."""
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
    """Indices (n,) of particles in proportion to their weights (systematic resampling)."""
    points = (np.arange(len(weights)) + random.random()) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), points), len(weights) - 1)


def _largest_correlation(start: np.ndarray, scores: np.ndarray) -> float:
    """Largest correlation of scores (n, d) with their start, over the dimensions."""
    a, b = start - start.mean(axis=0), scores - scores.mean(axis=0)
    product = (a * b).sum(axis=0)
    sizes = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return float(np.max(product / np.where(sizes > 0.0, sizes, 1.0)))


__all__ = ["NoLikelihoodError", "PosteriorSample", "sample_posterior"]
