"""Moves of particles by a surrogate of the model, for posteriors that are long and thin.

The residuals are a quadratic regression over the particles, in coordinates in which a model is
nearly one: inputs rather than their normal scores. A chain that is reversible for this surrogate
makes many steps along the regression lines of the particles, which keep to a thin posterior. Its
end is a proposal for the model itself (delayed acceptance: Christen and Fox, J. Comput. Graph.
Stat. 14 (2005) 795).
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
    """Piecewise linear rising functions of single scores.

    Parameters
    ----------
    values : ndarray, shape (knots, d)
        Values of the functions at the scores `knots`. Only the shape of a column counts: `of`
        shifts and scales it. One that does not rise everywhere is replaced by the scores.
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
        """Scores of the tables."""
        return np.linspace(-_REACH, _REACH, _CELLS + 1)

    def of(self, scores: np.ndarray) -> np.ndarray:
        """Coordinates (n, d) of scores (n, d); those beyond the reach stay at its ends."""
        cell, part = self._cells(scores)
        columns = np.arange(scores.shape[1])
        width = 2.0 * _REACH / _CELLS
        return np.asarray(self._values[cell, columns] + part * width * self._slopes[cell, columns])

    def scores(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores (n, d) of coordinates (n, d), and which (n,) are within reach."""
        knots, table = self.knots(), self._values
        within = ((values > table[0]) & (values < table[-1])).all(axis=1)
        columns = [np.interp(v, table[:, k], knots) for k, v in enumerate(values.T)]
        return np.column_stack(columns), within

    def log_density(self, scores: np.ndarray) -> np.ndarray:
        """Logs (n,) of the density of the coordinates of standard normal scores, but for a
        constant."""
        cell, _ = self._cells(scores)
        slopes = self._slopes[cell, np.arange(scores.shape[1])]
        return np.asarray(-0.5 * (scores**2).sum(axis=1) - np.log(slopes).sum(axis=1))

    def _cells(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cell of each score, and its position there."""
        position = np.clip((scores + _REACH) * (_CELLS / (2.0 * _REACH)), 0.0, _CELLS)
        cell = np.minimum(position.astype(np.int64), _CELLS - 1)
        return cell, position - cell


@dataclass(frozen=True)
class SurrogateMove:
    """Chains on a surrogate of the posterior at a temperature.

    Attributes
    ----------
    coordinates : Coordinates
    first, second : ndarray of int
        Coordinates of the products in the regression.
    fit : ndarray, shape (terms, k)
        Components of the residuals by constant, coordinates and products.
    lines : ndarray, shape (d, d)
        Rows are steps of one standard deviation along the regression line of each coordinate.
    temperature : float
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
        """Regression over particles (n, d) with residuals (n, m) and weights (n,)."""
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
        """Ends (n, d) of chains, and what `log_ratio` needs. A ``length`` of 1 makes the most
        steps."""
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
        """Logs (n,) of the ratio of the densities of proposing back and forth."""
        return log_ratio.copy()

    def _log_likelihood(self, values: np.ndarray) -> np.ndarray:
        """Logs (n,) of the likelihood of the surrogate at the temperature."""
        components = _terms(values, self.first, self.second) @ self.fit
        return np.asarray(-0.5 * self.temperature * (components**2).sum(axis=1))


def _terms(
    values: np.ndarray, first: np.ndarray | None = None, second: np.ndarray | None = None
) -> np.ndarray:
    """Terms (n, terms) of a regression: constant, coordinates, and products of some of them."""
    terms = [np.ones((len(values), 1)), values]
    if first is not None:
        terms.append(values[:, first] * values[:, second])
    return np.hstack(terms)


__all__ = ["Coordinates", "SurrogateMove"]
