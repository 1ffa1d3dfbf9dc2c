"""Calibration cases, which the integration steps are selected with: corners (each input at an end
of its distribution) and a sample."""

from typing import NamedTuple

import numpy as np

from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.units import UNITS

CORNERS = 24  # besides the median case; more if a discrete distribution has many values
SAMPLE = 512  # calibration cases sampled from the distributions
_CORNER_PROBABILITY = 0.001  # probability of the corners of a distribution
_WIDE_ANGLE = 0.5 * np.pi  # an angle with a wider range can have extremes anywhere
_CORNERS_PER_VALUE = 3  # minimum number of corners with each value of a discrete distribution


class CalibrationSize(NamedTuple):
    """Number of calibration cases: ``corners`` as in `corner_cases`, most inputs of which are at
    ends of their distributions, and ``sample`` cases as in `calibration_sample`. The median case
    comes in addition."""

    corners: int
    sample: int


def corner_cases(campaign: Definition, corners: int | None = None) -> np.ndarray:
    """Return the inputs of the median case and of corner cases, the same ones at every call.

    The first row is the median of every parameter. In the others each parameter is at one of its
    two ends (quantiles at 0.001 and 0.999), chosen by a fixed random sequence. Exceptions: angles
    that vary over more than a quarter turn take evenly spaced quantiles, discrete distributions
    take every value, and parameters whose path ends in ``.fails`` stay at their median.

    Parameters
    ----------
    campaign : Definition
    corners : int, optional
        Number of corners, `CORNERS` if None; more are returned if a discrete distribution needs
        them, to have three corners with each of its values.

    Returns
    -------
    ndarray, shape (1 + corners, d)
        Inputs, a row per case, SI.
    """
    dispersions = campaign.file.dispersions
    corners = CORNERS if corners is None else corners
    count = max(
        [
            corners,
            *(
                _CORNERS_PER_VALUE * len(_value_probabilities(dispersion))
                for dispersion in dispersions
                if dispersion.distribution == "discrete"
            ),
        ]
    )
    random = np.random.Generator(np.random.Philox(key=20))
    tosses = np.resize(
        random.integers(0, 2, (max(1, corners), max(1, len(dispersions)))),
        (count, max(1, len(dispersions))),
    )
    table = np.empty((count + 1, len(dispersions)), order="F")
    for i, dispersion in enumerate(dispersions):
        u = np.where(tosses[:, i] == 1, 1.0 - _CORNER_PROBABILITY, _CORNER_PROBABILITY)
        if dispersion.parameter.path.endswith(".fails"):  # not a corner of anything
            u = np.full(count, 0.5)
        elif dispersion.distribution == "discrete":
            u = random.permutation(np.resize(_value_probabilities(dispersion), count))
        elif _is_wide(dispersion):
            u = (random.permutation(count) + 0.5) / max(1, count)
        table[:, i] = _quantiles(dispersion, np.concatenate([[0.5], u]))
    return table * campaign.factors


def calibration_sample(campaign: Definition, count: int) -> np.ndarray:
    """Return a sample of the inputs, the same one at every call: two Latin hypercubes of half the
    cases each (of an odd number the first has one more).

    In the second half all values of a discrete distribution are equally frequent, whatever their
    weights; parameters whose path ends in ``.fails`` keep their weights.

    Parameters
    ----------
    campaign : Definition
    count : int
        Number of cases.

    Returns
    -------
    ndarray, shape (count, d)
        Inputs, a row per case, SI.
    """
    dispersions, half = campaign.file.dispersions, (count + 1) // 2
    random = np.random.Generator(np.random.Philox(key=21))
    table = np.empty((count, len(dispersions)), order="F")
    for i, dispersion in enumerate(dispersions):
        u = np.concatenate(
            [(random.permutation(n) + random.random(n)) / max(1, n) for n in (half, count - half)]
        )
        if dispersion.distribution == "discrete" and not dispersion.parameter.path.endswith(
            ".fails"
        ):
            u[half:] = random.permutation(np.resize(_value_probabilities(dispersion), count - half))
        table[:, i] = _quantiles(dispersion, np.clip(u, 2.0**-54, 1.0 - 2.0**-53))
    return table * campaign.factors


def _quantiles(dispersion: Dispersion, u: np.ndarray) -> np.ndarray:
    """Return the quantiles (n,) of a distribution at probabilities ``u`` (n,), in the unit of the
    file; the median in place of each value that the parameter does not allow."""
    values = cases.quantile(dispersion, u)
    return (
        np.where(dispersion.allowed(values), values, cases.quantile(dispersion, np.array([0.5])))
        if dispersion.has_tails
        else values
    )


def _value_probabilities(dispersion: Dispersion) -> np.ndarray:
    """Return, in the order of the values of a discrete distribution, a probability (k,) at which
    its quantile is the value: the middle of the value's step of the cumulative distribution.
    Values without weight are left out."""
    weights = np.array(dispersion.weights)
    edges = np.cumsum(weights) / np.sum(weights)
    return (edges - 0.5 * weights / np.sum(weights))[weights > 0.0]


def _is_wide(dispersion: Dispersion) -> bool:
    """Return True if a parameter is an angle whose quantiles at 0.001 and 0.999 differ by more
    than a quarter turn."""
    if dispersion.parameter.unit not in UNITS["angle"]:
        return False
    low, high = (
        cases.quantile(dispersion, np.array([_CORNER_PROBABILITY, 1.0 - _CORNER_PROBABILITY]))
        * dispersion.parameter.factor
    )
    return bool(high - low > _WIDE_ANGLE)
