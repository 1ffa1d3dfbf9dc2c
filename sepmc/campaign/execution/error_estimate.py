"""Estimate of the numerical error of every case, from error indicators of its integration: a model
fitted to calibration cases of known error.

An error indicator is a number that a kernel computes for each case from its steps: it grows with
the error.
"""

from dataclasses import dataclass, replace

import numpy as np

# Factor on the bound of the calibration cases. True errors of other cases compared with it:
# sepmc/validation/README.md.
_SAFETY_FACTOR = 4.0 / 3.0
# fraction of the largest error of a case below which an outcome never leads
_NEAR = 0.5
# size of a term, over that of the largest, below which it depends on the others
_DEPENDENT = 1e-9


@dataclass(frozen=True)
class Estimate:
    """Model that gives the relative errors of the o outcomes of a case from its g error indicators.

    The sum over the indicators g of ``weights[k, g] * (indicator[g] / size[g]) ** 1.5`` is the
    error of outcome k. It is multiplied by ``factor[k]``, or ``offset[k]`` is added, whichever
    gives less, so that no calibration case has a larger error; ``factor`` is infinite if
    indicators do not explain some errors. Then ``floor[k]`` and the sum over g of
    ``direct[k, g] * indicator[g]`` are added.

    Attributes
    ----------
    size : ndarray, shape (g,)
        Largest value of each indicator in the calibration cases.
    weights : ndarray, shape (o, g)
        Fitted weights of the indicators times a safety factor, not negative.
    factor, offset : ndarray, shape (o,)
        Factor on the weighted sum, at least 1, and number added to it instead if that gives less.
    floor : ndarray, shape (o,)
        Error that is added in every case.
    direct : ndarray, shape (o, g)
        Error per unit of an indicator that is added to the fitted error.
    leading : ndarray of int
        Indices of the decisive outcomes that can have the largest error of a case.
    is_decisive : ndarray of bool, shape (o,)
        True for the outcomes whose error counts as that of the case: all but contact and the times
        and positions of extremes (`sepmc.campaign.execution.accuracy.decisive`).
    """

    size: np.ndarray
    weights: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    floor: np.ndarray
    direct: np.ndarray
    leading: np.ndarray
    is_decisive: np.ndarray

    def of_cases(self, indicators: np.ndarray) -> np.ndarray:
        """Relative error of each case (n,): the largest one of the outcomes in `leading`, from the
        indicators (n, g) of n cases.

        Sums are made term by term, so that a case has the same bits in any batch.
        """
        terms, errors = _terms(indicators, self.size), np.zeros(len(indicators))
        for k in self.leading:
            np.maximum(errors, self._bound(k, self._sum(k, terms), indicators), out=errors)
        return errors

    def of_leading(self, indicators: np.ndarray) -> np.ndarray:
        """Relative error (o,) of each outcome in `leading`, those that can have the largest error
        of a case: the largest over n cases with indicators (n, g); 0 for all other outcomes."""
        errors = np.zeros(len(self.floor))
        terms = _terms(indicators, self.size)
        for k in self.leading:
            errors[k] = self._bound(k, self._sum(k, terms), indicators).max(initial=0.0)
        return errors

    def largest(self, leading: np.ndarray, largest: np.ndarray) -> np.ndarray:
        """Upper bound of the error of each outcome over a set of cases, in a tenth of the time of
        `of_outcomes`.

        Parameters
        ----------
        leading : ndarray, shape (o,)
            Result of `of_leading` for these cases.
        largest : ndarray, shape (g,)
            Largest value of each indicator over these cases; empty if there are no cases, and then
            ``leading`` is returned.

        Returns
        -------
        ndarray, shape (o,)
            ``leading`` for the outcomes in `Estimate.leading`; for the others the error at the
            largest indicators, but for a decisive outcome no more than the largest of ``leading``.
            The bits do not depend on how cases are grouped.
        """
        if not len(largest):
            return leading
        errors, largest = leading.copy(), largest[None, :]
        terms_of_largest = _terms(largest, self.size)
        for k in sorted(set(range(len(errors))) - set(self.leading.tolist())):
            errors[k] = self._bound(k, self._sum(k, terms_of_largest), largest)[0]
        limit = leading[self.leading].max(initial=0.0)
        return np.where(self.is_decisive, np.minimum(errors, limit), errors)

    def of_outcomes(self, indicators: np.ndarray) -> np.ndarray:
        """Relative error of each outcome of every case, shape (o, n), from the indicators (n, g)
        of n cases."""
        terms = _terms(indicators, self.size)
        return np.array(
            [self._bound(k, self._sum(k, terms), indicators) for k in range(len(self.floor))]
        )

    def _sum(self, k: int, terms: np.ndarray) -> np.ndarray:
        """Weighted sum (n,) over g of the ``terms`` (g, n) of n cases, for outcome ``k``. Most
        weights are zero: a matrix product is slower, and much slower on busy cores."""
        error = np.zeros(terms.shape[1])
        for indicator in np.flatnonzero(self.weights[k]):
            error += self.weights[k, indicator] * terms[indicator]
        return error

    def _bound(self, k: int, error: np.ndarray, indicators: np.ndarray) -> np.ndarray:
        """Relative error (n,) of outcome ``k`` in n cases, from its weighted sum ``error`` (n,)
        (`_sum`) and the indicators (n, g): raised by factor or offset, whichever gives less (by the
        offset if the factor is infinite), plus floor and direct terms."""
        error_bound = error + self.offset[k]
        if np.isfinite(self.factor[k]):
            error_bound = np.minimum(self.factor[k] * error, error_bound)
        for indicator in np.flatnonzero(self.direct[k]):
            error_bound += self.direct[k, indicator] * indicators[:, indicator]
        return np.asarray(error_bound + self.floor[k])


def _terms(indicators: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Terms of the error model: ``(indicators / size) ** 1.5``, shape (g, n), for indicators (n, g)
    and size (g,). Indicators are of order 6 in the step, errors of order 9."""
    ratio_of_size = indicators.T / size[:, None]
    return np.asarray(ratio_of_size * np.sqrt(ratio_of_size))


def estimate(
    indicators: np.ndarray,
    errors: np.ndarray,
    floor: np.ndarray,
    direct: np.ndarray,
    is_decisive: np.ndarray,
) -> Estimate:
    """Fit an error estimate to calibration cases, by the model that `Estimate` describes.

    Parameters
    ----------
    indicators : ndarray, shape (n, g)
        Error indicators of the calibration cases.
    errors : ndarray, shape (n, o)
        Their known relative errors; infinite ones are left out of the fit.
    floor : ndarray, shape (o,)
        Error of each outcome that is added in every case.
    direct : ndarray, shape (o, g)
        Error per unit of an indicator that is added to the fitted error.
    is_decisive : ndarray of bool, shape (o,)
        As in `Estimate`.

    Returns
    -------
    Estimate
        Weights are fitted by least squares, not negative, and raised by a safety factor. A decisive
        outcome is leading if in some calibration case its estimated error is at least half the
        largest one of that case; without calibration cases all decisive outcomes are.
    """
    size = indicators.max(axis=0, initial=0.0)
    size = np.where(size > 0.0, size, 1.0)
    outcomes = errors.shape[1]
    weights = np.zeros((outcomes, len(size)))
    factor, offset = np.ones(outcomes), np.zeros(outcomes)
    if len(indicators):
        terms = np.ascontiguousarray(_terms(indicators, size).T)
        for k, column in enumerate(errors.T):
            finite = np.isfinite(column)  # an infinite error is reported for the whole campaign
            if not finite.any():
                continue
            known_errors, of_known = column[finite], terms[finite]
            coefficients = _fitted(of_known, known_errors)
            fitted_errors = (of_known * coefficients).sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.where(known_errors > 0.0, known_errors / fitted_errors, 1.0)
            weights[k], factor[k] = _SAFETY_FACTOR * coefficients, max(float(ratio.max()), 1.0)
            offset[k] = _SAFETY_FACTOR * max(float((known_errors - fitted_errors).max()), 0.0)
    leading = np.flatnonzero(is_decisive)
    fitted = Estimate(size, weights, factor, offset, floor, direct, leading, is_decisive)
    if not len(indicators):
        return fitted
    estimates = fitted.of_outcomes(indicators)[leading]
    is_near = (estimates >= _NEAR * estimates.max(axis=0, initial=0.0)).any(axis=1)
    return replace(fitted, leading=leading[is_near])


def _fitted(terms: np.ndarray, known_errors: np.ndarray) -> np.ndarray:
    """Weights (g,), not negative, with which the sum of the terms (n, g) fits the known errors (n,)
    best, by least squares; terms whose weight would be negative are left out (weight 0)."""
    weights = np.zeros(terms.shape[1])
    largest = float(known_errors.max())
    columns_used = np.flatnonzero(terms.any(axis=0) & (largest > 0.0))
    while len(columns_used):
        solution = _least_squares(terms[:, columns_used], known_errors / largest)
        if (solution >= 0.0).all():
            weights[columns_used] = largest * solution
            break
        columns_used = columns_used[solution > 0.0]
    return weights


def _least_squares(terms: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Coefficients (g,) of the terms (n, g) whose sum fits ``target`` (n,) best, by modified
    Gram-Schmidt with pivoting; 0 for terms that depend linearly on the others.

    LAPACK is not used: its results differ in their last bits by processor and number of threads,
    and so would the column ``error`` of every case.
    """
    rest, residual = terms.T.copy(), target.copy()
    coefficients = np.zeros(len(rest))
    pivots: list[int] = []
    products = np.zeros((len(rest), len(rest)))  # of terms with the directions before them
    projections = np.zeros(len(rest))
    smallest = _DEPENDENT * np.sqrt((rest * rest).sum(axis=1).max())
    while len(pivots) < len(rest):
        norms = np.sqrt((rest * rest).sum(axis=1))
        norms[pivots] = 0.0
        pivot = int(norms.argmax())
        if norms[pivot] <= smallest:
            break
        direction = rest[pivot] / norms[pivot]
        products[pivot] = (rest * direction).sum(axis=1)
        rest -= products[pivot][:, None] * direction
        projections[pivot] = (residual * direction).sum()
        residual -= projections[pivot] * direction
        pivots.append(pivot)
    for k, pivot in reversed(list(enumerate(pivots))):
        later = sum(float(products[pivot, j] * coefficients[j]) for j in pivots[k + 1 :])
        coefficients[pivot] = (projections[pivot] - later) / products[pivot, pivot]
    return coefficients
