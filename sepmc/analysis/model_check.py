"""Posterior predictive check: does a model with its distributions explain measurements?

In units of sigma, the residuals from the mean prediction of the posterior have the covariance
I - P, where P is that of the predictions over the posterior: exactly so if the model is linear in
normal scores and the true scores are of the prior. Where P approaches 1 the measurements determine
the fit, so that residuals say nothing about the model; such directions are left out. What the fit
has absorbed shows in the scores: their posterior mean has the covariance I - C under the prior,
where C is that of the posterior.
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
    """Chi-square of a test, its degrees of freedom and its p-value (upper tail)."""

    chi_square: float
    freedom: int
    p_value: float

    @property
    def fails(self) -> bool:
        """True if a model that is right gives so large a value rarely (`LEVEL`)."""
        return self.p_value < LEVEL / _TESTS

    @property
    def ratio(self) -> float:
        """Root mean square of what is tested, in its own standard deviations; NaN of nothing."""
        return float(np.sqrt(self.chi_square / self.freedom)) if self.freedom else np.nan

    @property
    def is_too_small(self) -> bool:
        """True if the ratio is far below 1, and rarely so small of a model that is right."""
        from scipy.stats import chi2  # noqa: PLC0415

        return self.ratio < _TOO_SMALL and chi2.cdf(self.chi_square, self.freedom) < LEVEL


@dataclass(frozen=True)
class TimeBlock:
    """Residuals of a channel in a part of the time.

    Attributes
    ----------
    channel : int
    start_s, end_s : float
        Of the run.
    residual : float
        Mean, in sigma.
    score : float
        The same in its own standard deviations; NaN where the fit follows the measurement.
    """

    channel: int
    start_s: float
    end_s: float
    residual: float
    score: float


@dataclass(frozen=True)
class ModelCheck:
    """Posterior predictive check.

    Attributes
    ----------
    blocks : ChiSquareTest
        Of the means of the residuals over blocks of time: loads and effects that the model lacks.
    parameters : ChiSquareTest
        Of the estimated scores against the prior: parameters outside their distributions.
    noise : ChiSquareTest
        Of all residuals: noise beyond sigma, or errors of the model that are as fast.
    by_time : tuple of TimeBlock
    channels : tuple of ChiSquareTest
        Of the residuals of each channel.
    """

    blocks: ChiSquareTest
    parameters: ChiSquareTest
    noise: ChiSquareTest
    by_time: tuple[TimeBlock, ...]
    channels: tuple[ChiSquareTest, ...]

    @property
    def is_short(self) -> bool:
        """True if the model with its distributions does not explain the measurements."""
        return self.blocks.fails or self.parameters.fails

    @property
    def worst(self) -> TimeBlock:
        """Time block with the largest score."""
        return max(self.by_time, key=lambda one: np.nan_to_num(abs(one.score)))


def check_model(
    times: Sequence[np.ndarray],
    measured: Sequence[np.ndarray],
    predicted: Sequence[np.ndarray],
    scores: np.ndarray,
) -> ModelCheck:
    """Check a model by the predictions of its posterior.

    Parameters
    ----------
    times : sequence of ndarray, shape (m,)
        Of the samples of each channel, s.
    measured : sequence of ndarray, shape (m,)
        In units of sigma.
    predicted : sequence of ndarray, shape (n, m)
        At the samples of the posterior, in units of sigma.
    scores : ndarray, shape (n, d)
        Of the posterior, whose prior is standard normal.

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
    """Limits (b + 1,) of the indices of time blocks of about equal duration."""
    count = max(1, min(_BLOCKS, len(time) // _MIN_SAMPLES))
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1)[1:-1])
    limits = [0]
    for edge in [*edges, len(time)]:
        if edge - limits[-1] >= _MIN_SAMPLES:
            limits.append(int(edge))
    limits[-1] = len(time)  # the rest belongs to the last block
    return np.array(limits if len(limits) > 1 else [0, len(time)])


def _block_sums(values: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Sums (n, b) of values (n, m) over blocks, in standard deviations of independent noise."""
    return np.asarray(np.add.reduceat(values, limits[:-1], axis=1) / np.sqrt(np.diff(limits)))


def _test(values: np.ndarray, posterior: np.ndarray) -> ChiSquareTest:
    """Test values (m,) that have the covariance I - P, with P that of the posterior (n, m)."""
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
