"""Posterior predictive check: does a model with its distributions explain measurements?

Scores are the estimated parameters, transformed so that their prior is standard normal. All
residuals, measured minus predicted values, are in units of sigma, the standard deviation of the
measurement noise.

The residuals from the mean prediction of the posterior have the covariance I - P, where P is the
covariance of the predictions over the posterior. This is exact if the model is linear in the scores
and the true scores come from the prior. In directions in which P approaches 1 the fit follows the
measurements, so the residuals say nothing about the model; these directions are left out. An error
that the fit has absorbed shows in the scores: their posterior mean has the covariance I - C, where
C is the covariance of the scores over the posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEVEL = 0.01  # false alarms of all tests together, of a model that is right
_TESTS = 3
_TOO_SMALL = 0.5  # residuals over sigma, below which sigma is far too large
_ABSORBED = 0.5  # of the variance of a direction: the fit follows the measurement there
_BLOCKS = 20  # time blocks of a channel, at most
_MIN_SAMPLES = 5  # of a block
_MAX_PREDICTIONS = 500  # that the covariance of all samples is taken from


@dataclass(frozen=True)
class ChiSquareTest:
    """Result of a chi-square test: the statistic ``chi_square``, its degrees of freedom ``freedom``
    and its upper-tail ``p_value``."""

    chi_square: float
    freedom: int
    p_value: float

    @property
    def fails(self) -> bool:
        """True if a right model rarely gives a chi-square this large: the p-value is below `LEVEL`
        divided by the number of tests, 3."""
        return self.p_value < LEVEL / _TESTS

    @property
    def ratio(self) -> float:
        """Root of chi-square over the degrees of freedom, near 1 for a right model: the root mean
        square of the tested values in their standard deviations. NaN without degrees of freedom."""
        return float(np.sqrt(self.chi_square / self.freedom)) if self.freedom else np.nan

    @property
    def is_too_small(self) -> bool:
        """True if `ratio`, a root mean square, is below 0.5 and a right model gives a chi-square
        this small with a probability below `LEVEL`; sigma is then far too large."""
        from scipy.stats import chi2  # noqa: PLC0415

        return self.ratio < _TOO_SMALL and chi2.cdf(self.chi_square, self.freedom) < LEVEL


@dataclass(frozen=True)
class TimeBlock:
    """Mean residual of a measured channel over a block of time.

    Attributes
    ----------
    channel : int
        Index of the channel.
    start_s, end_s : float
        Times of the first and the last sample of the block, in the time of the run.
    residual : float
        Mean of the residuals, in sigma.
    score : float
        Mean of the residuals divided by the standard deviation that this mean has if the model is
        right; NaN where the fit follows the measurement.
    """

    channel: int
    start_s: float
    end_s: float
    residual: float
    score: float


@dataclass(frozen=True)
class ModelCheck:
    """Results of a posterior predictive check.

    Attributes
    ----------
    blocks : ChiSquareTest
        Test of the mean residuals of all time blocks; it fails for slow loads and effects that the
        model lacks.
    parameters : ChiSquareTest
        Test of the posterior mean of the scores against the prior; it fails for parameters outside
        their distributions.
    noise : ChiSquareTest
        Test of all residuals; it fails for noise larger than sigma, or model errors as fast as it.
    by_time : tuple of TimeBlock
        All blocks of the first channel, then of the second, and so on.
    channels : tuple of ChiSquareTest
        Test of the residuals of each channel.
    """

    blocks: ChiSquareTest
    parameters: ChiSquareTest
    noise: ChiSquareTest
    by_time: tuple[TimeBlock, ...]
    channels: tuple[ChiSquareTest, ...]

    @property
    def is_short(self) -> bool:
        """True if the model with its distributions does not explain the measurements: the test
        ``blocks`` or ``parameters`` fails."""
        return self.blocks.fails or self.parameters.fails

    @property
    def worst(self) -> TimeBlock:
        """Time block whose score has the largest absolute value; NaN counts as 0."""
        return max(self.by_time, key=lambda one: np.nan_to_num(abs(one.score)))


def check_model(
    times: Sequence[np.ndarray],
    measured: Sequence[np.ndarray],
    predicted: Sequence[np.ndarray],
    scores: np.ndarray,
) -> ModelCheck:
    """Check whether a model explains measurements, by its predictions over the posterior.

    Parameters
    ----------
    times : sequence of ndarray, shape (m,)
        Times of the m measurements of each channel, s, not falling.
    measured : sequence of ndarray, shape (m,)
        Measurements of each channel, in units of sigma.
    predicted : sequence of ndarray, shape (n, m)
        Predictions of them for each of n samples of the posterior, in units of sigma.
    scores : ndarray, shape (n, d)
        The d scores of each sample of the posterior; their prior is standard normal.

    Returns
    -------
    ModelCheck
    """
    residuals = [y - h.mean(axis=0) for y, h in zip(measured, predicted, strict=True)]
    limits = [_limits(time) for time in times]
    sums = [_block_sums(r[None], edge)[0] for r, edge in zip(residuals, limits, strict=True)]
    block_predictions = np.concatenate(
        [_block_sums(h, edge) for h, edge in zip(predicted, limits, strict=True)], axis=1
    )
    variances = block_predictions.var(axis=0, ddof=1)
    by_time, k = [], 0
    for channel, (edges, own) in enumerate(zip(limits, sums, strict=True)):
        for first, end, total in zip(edges[:-1], edges[1:], own, strict=True):
            left = 1.0 - variances[k]
            score = total / np.sqrt(left) if left > 1.0 - _ABSORBED else np.nan
            at, mean = times[channel][[first, end - 1]], total / np.sqrt(end - first)
            by_time.append(TimeBlock(channel, float(at[0]), float(at[1]), float(mean), score))
            k += 1
    stride = -(-len(scores) // _MAX_PREDICTIONS)
    thinned = [h[::stride] for h in predicted]
    return ModelCheck(
        _test(np.concatenate(sums), block_predictions),
        _test(scores.mean(axis=0), scores),
        _test(np.concatenate(residuals), np.concatenate(thinned, axis=1)),
        tuple(by_time),
        tuple(_test(r, h) for r, h in zip(residuals, thinned, strict=True)),
    )


def _limits(time: np.ndarray) -> np.ndarray:
    """Return indices (b + 1,) that divide the samples at times (m,) into b blocks of about equal
    duration, with at least five samples each if there are as many: samples limits[k] to
    limits[k + 1] - 1 form block k."""
    count = max(1, min(_BLOCKS, len(time) // _MIN_SAMPLES))
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1])
    limits = [0]
    for edge in [*edges, len(time)]:
        if edge - limits[-1] >= _MIN_SAMPLES:
            limits.append(int(edge))
    limits[-1] = len(time)  # the rest belongs to the last block
    return np.array(limits if len(limits) > 1 else [0, len(time)])


def _block_sums(values: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return the sums (n, b) of values (n, m) over the blocks between ``limits`` (b + 1,), each
    divided by the root of its number of samples: sigma of a sum of independent unit noise."""
    return np.asarray(np.add.reduceat(values, limits[:-1], axis=1) / np.sqrt(np.diff(limits)))


def _test(values: np.ndarray, posterior: np.ndarray) -> ChiSquareTest:
    """Test whether values (m,) have the covariance I - P, where P is the covariance of
    ``posterior`` (n, m) over its n samples; directions in which P exceeds 0.5 are left out."""
    from scipy.stats import chi2  # noqa: PLC0415

    offsets = (posterior - posterior.mean(axis=0)) / np.sqrt(len(posterior) - 1.0)
    _, sizes, directions = np.linalg.svd(offsets, full_matrices=False)
    absorbed, along = sizes**2, (directions @ values) ** 2
    left_out = absorbed > _ABSORBED
    total = (values**2).sum() - along[left_out].sum()
    total += (along * absorbed / (1.0 - absorbed))[~left_out].sum()
    freedom = len(values) - int(np.count_nonzero(left_out))
    value = float(max(total, 0.0))
    return ChiSquareTest(value, freedom, float(chi2.sf(value, freedom)) if freedom else 1.0)


__all__ = ["LEVEL", "ChiSquareTest", "ModelCheck", "TimeBlock", "check_model"]
