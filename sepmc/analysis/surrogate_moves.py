"""Moves of particles by a surrogate of the model, for posteriors that are long and thin.

Particles are points in the space of scores: the estimated inputs, transformed so that their prior
is standard normal. The surrogate is a quadratic regression of the model's residuals (measured minus
predicted values, in sigma) over the particles. It uses coordinates in which a model is nearly
quadratic, the inputs themselves, rather than their scores. A Markov chain that is reversible for
the surrogate makes many steps along the regression lines of the particles, which stay in a thin
posterior. The end of the chain is a proposal for the model itself (delayed acceptance: Christen and
Fox, J. Comput. Graph. Stat. 14 (2005) 795).
"""

import math
from dataclasses import dataclass

import numpy as np

_REACH, _CELLS = 5.0, 200  # of the scores that a chain moves in, and of the tables of coordinates
_COMPONENTS = 40  # principal components of the residuals, at most
_NEGLIGIBLE = 1e-3  # variance of a component, at the temperature
_POINTS_PER_TERM = 3  # of the regression, at least
_TURNS = 6  # steps of a chain along the line of each dimension
_STEP = 2.0  # standard deviations


class Coordinates:
    """Coordinates of the regression: d piecewise linear rising functions, one of each score.

    Parameters
    ----------
    values : ndarray, shape (knots, d)
        Values of the functions at the scores `knots`. Only the shape of a column matters: it is
        shifted and scaled to 0 at the score 0 and a difference of 2 between the scores -1 and 1. A
        column that does not rise everywhere is replaced by the scores themselves.
    """

    def __init__(self, values: np.ndarray):
        knots, middle = self.knots(), len(values) // 2
        unit = int(np.searchsorted(knots, 1.0)) - middle
        size = values[middle + unit] - values[middle - unit]  # of two standard deviations
        scaled = 2.0 * (values - values[middle]) / np.where(size > 0.0, size, np.inf)
        rises = (np.diff(scaled, axis=0) > 0.0).all(axis=0)
        self._values = np.where(rises, scaled, knots[:, None])
        self._slopes = np.diff(self._values, axis=0) / (knots[1] - knots[0])

    @staticmethod
    def knots() -> np.ndarray:
        """Return the 201 equally spaced scores, -5 to 5, at which the functions are tabulated."""
        return np.linspace(-_REACH, _REACH, _CELLS + 1)

    def of(self, scores: np.ndarray) -> np.ndarray:
        """Return the coordinates (n, d) of scores (n, d); a score beyond -5 to 5 has the coordinate
        of the nearer end."""
        cell, part = self._cells(scores)
        columns = np.arange(scores.shape[1])
        width = 2.0 * _REACH / _CELLS
        return np.asarray(self._values[cell, columns] + part * width * self._slopes[cell, columns])

    def scores(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores (n, d) of coordinates ``values`` (n, d), and a mask (n,) that is True
        where all d scores are between -5 and 5; the score of a value beyond is -5 or 5."""
        knots, table = self.knots(), self._values
        within = ((values > table[0]) & (values < table[-1])).all(axis=1)
        columns = [np.interp(v, table[:, k], knots) for k, v in enumerate(values.T)]
        return np.column_stack(columns), within

    def log_density(self, scores: np.ndarray) -> np.ndarray:
        """Return the logarithm (n,), up to a constant, of the prior density of the coordinates at
        scores (n, d), which are standard normal."""
        cell, _ = self._cells(scores)
        slopes = self._slopes[cell, np.arange(scores.shape[1])]
        return np.asarray(-0.5 * (scores**2).sum(axis=1) - np.log(slopes).sum(axis=1))

    def _cells(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return for scores (n, d) the index (n, d) of the interval between two knots that contains
        each, and the position (n, d) in it, 0 to 1."""
        position = np.clip((scores + _REACH) * (_CELLS / (2.0 * _REACH)), 0.0, _CELLS)
        cell = np.minimum(position.astype(np.int64), _CELLS - 1)
        return cell, position - cell


@dataclass(frozen=True)
class SurrogateMove:
    """Proposals by Markov chains on a surrogate of the posterior.

    Attributes
    ----------
    coordinates : Coordinates
    first, second : ndarray of int, shape (p,)
        Indices of the two coordinates in each of p products of the regression.
    fit : ndarray, shape (terms, k)
        Regression coefficients of k principal components of the residuals: of the constant, of
        the d coordinates, and of the p products.
    lines : ndarray, shape (d, d)
        Row i is a step along the regression line of all coordinates on coordinate i, of one
        standard deviation of that coordinate.
    temperature : float
        Power to which the likelihood is raised, 0 to 1.
    """

    coordinates: Coordinates
    first: np.ndarray
    second: np.ndarray
    fit: np.ndarray
    lines: np.ndarray
    temperature: float

    @classmethod
    def of(
        cls,
        scores: np.ndarray,
        residuals: np.ndarray,
        weights: np.ndarray,
        temperature: float,
        coordinates: Coordinates,
    ) -> "SurrogateMove":
        """Fit the surrogate, quadratic in ``coordinates``, to particles with ``scores`` (n, d),
        ``residuals`` (n, m) in sigma and ``weights`` (n,), at a ``temperature``, the power of the
        likelihood; particles with a residual that is not finite are left out. The weights determine
        only ``lines``."""
        known = np.isfinite(residuals).all(axis=1)
        values, residuals = coordinates.of(scores[known]), residuals[known]
        weights = np.asarray(weights[known] / weights[known].sum())
        count, dimensions = values.shape
        offsets = residuals - residuals.mean(axis=0)
        _, sizes, basis = np.linalg.svd(offsets, full_matrices=False)
        kept = sizes[:_COMPONENTS] ** 2 * temperature > _NEGLIGIBLE * count
        components = residuals @ basis[:_COMPONENTS][kept].T
        linear = np.linalg.lstsq(_terms(values), components, rcond=None)[0][1:]
        most = int(math.sqrt(2.0 * max(count / _POINTS_PER_TERM - dimensions, 0.0))) - 1
        effect = (linear**2).sum(axis=1) * values.var(axis=0)
        curved = np.sort(np.argsort(-effect, kind="stable")[: max(most, 0)])
        first, second = (curved[k] for k in np.triu_indices(len(curved)))
        fit = np.linalg.lstsq(_terms(values, first, second), components, rcond=None)[0]
        centred = values - weights @ values
        covariance = (weights[:, None] * centred).T @ centred
        spread = np.sqrt(np.diag(covariance))
        lines = covariance / np.where(spread > 0.0, spread, 1.0)[:, None]
        return cls(coordinates, first, second, fit, lines, temperature)

    def propose(
        self, scores: np.ndarray, _: np.ndarray, length: float, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run a chain on the surrogate from each of the ``scores`` (n, d). The second argument, the
        residuals of the particles, is not used.

        ``length``, up to 1, is the fraction of the largest number of steps that is made. Return the
        scores (n, d) at the ends of the chains and the logarithms (n,) of the proposal ratio, which
        `log_ratio` takes. A particle with a score beyond -5 to 5 does not move.
        """
        size, dimensions = scores.shape
        values = self.coordinates.of(scores)
        start = self._log_likelihood(values)
        ends, logs = scores, start + self.coordinates.log_density(scores)
        likelihood = start
        moves = (np.abs(scores) < _REACH).all(axis=1)
        turns = np.concatenate([random.permutation(dimensions) for _ in range(_TURNS)])
        for k in turns[: math.ceil(length * len(turns))]:
            step = _STEP * random.standard_normal((size, 1))
            uniform = random.random(size)
            trial = values + step * self.lines[k]
            trial_scores, within = self.coordinates.scores(trial)
            trial_likelihood = self._log_likelihood(trial)
            trial_logs = trial_likelihood + self.coordinates.log_density(trial_scores)
            accepted: np.ndarray = moves & within & (np.log(uniform) < trial_logs - logs)
            values = np.where(accepted[:, None], trial, values)
            ends = np.where(accepted[:, None], trial_scores, ends)
            logs = np.where(accepted, trial_logs, logs)
            likelihood = np.where(accepted, trial_likelihood, likelihood)
        prior = 0.5 * ((scores**2).sum(axis=1) - (ends**2).sum(axis=1))
        return ends, start - likelihood - prior

    def log_ratio(self, _: np.ndarray, log_ratio: np.ndarray) -> np.ndarray:
        """Return the logarithm (n,) of the density of proposing the start from the end over that of
        proposing the end from the start. `propose` computed it: ``log_ratio`` is its second result,
        of which a copy is returned. The first argument, the ends of the chains, is not used."""
        return log_ratio.copy()

    def _log_likelihood(self, values: np.ndarray) -> np.ndarray:
        """Return the logarithm (n,) of the surrogate's likelihood to the power `temperature`,
        without its constant. ``values`` (n, d) are coordinates as `Coordinates.of` makes them from
        scores."""
        components = _terms(values, self.first, self.second) @ self.fit
        return np.asarray(-0.5 * self.temperature * (components**2).sum(axis=1))


def _terms(
    values: np.ndarray, first: np.ndarray | None = None, second: np.ndarray | None = None
) -> np.ndarray:
    """Return the terms (n, 1 + d + p) of a regression at coordinates ``values`` (n, d): 1, the
    coordinates, and the p products of those with indices ``first`` and ``second`` (none if
    None)."""
    terms = [np.ones((len(values), 1)), values]
    if first is not None:
        terms.append(values[:, first] * values[:, second])
    return np.hstack(terms)


__all__ = ["Coordinates", "SurrogateMove"]
