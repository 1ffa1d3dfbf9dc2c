"""Dispersions to a case table. The only place that draws random numbers.

Every dispersed parameter has a Philox stream of its own, keyed by the seed and the parameter's path
without unit. Case i uses number i of each stream: one more parameter, or more cases, changes no
other draw, and any case can be drawn alone.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from sepmc.scene import parameters
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.model import Scene

_RARE = 1e-6  # of the probability of a law: less is beyond its ends
_PER_BLOCK = 4  # Philox 4x64 gives four numbers per counter value


def stream(seed: int, path: str, first: int, count: int) -> np.ndarray:
    """Numbers ``first`` to ``first + count`` of the stream of a parameter, uniform in (0, 1).

    Returns
    -------
    u : ndarray, shape (count,)
        Multiples of 2^-53 plus 2^-54: never 0 or 1, so that every quantile is finite.
    """
    key = int.from_bytes(
        hashlib.blake2b(f"{seed}:{path}".encode(), digest_size=16).digest(), "little"
    )
    generator = np.random.Philox(key=key).advance(first // _PER_BLOCK)
    skip = first % _PER_BLOCK
    raw = generator.random_raw(skip + count)[skip:]
    raw >>= np.uint64(11)
    u = raw.astype(float)  # in place from here on: a third of the time of one expression
    u *= 2.0**-53
    u += 2.0**-54
    return np.minimum(u, 1.0 - 2.0**-53, out=u)


def quantile(dispersion: Dispersion, u: np.ndarray) -> np.ndarray:
    """Values of a law at probabilities ``u``, in the unit of the parameter's key; shape of u."""
    numbers = dispersion.numbers
    if dispersion.law == "uniform":
        low, high = numbers
        return low + u * (high - low)
    if dispersion.law == "triangular":
        low, mode, high = numbers
        if high == low:
            return np.full_like(u, low)
        left = (mode - low) / (high - low)
        rising = low + np.sqrt(u * (high - low) * (mode - low))
        return np.where(u < left, rising, high - np.sqrt((1.0 - u) * (high - low) * (high - mode)))
    if dispersion.law == "normal":
        from scipy.special import ndtr, ndtri  # noqa: PLC0415  (0.1 s that other laws do not need)

        mean, sigma, cut = numbers
        tail = ndtr(-cut)
        return mean + sigma * ndtri(tail + u * (1.0 - 2.0 * tail))
    if dispersion.law == "discrete":
        edges = np.cumsum(dispersion.weights) / np.sum(dispersion.weights)
        return np.array(numbers)[
            np.minimum(np.searchsorted(edges, u, side="right"), len(numbers) - 1)
        ]
    return np.full_like(u, numbers[0])


def draw(dispersions: tuple[Dispersion, ...], seed: int, first: int, count: int) -> np.ndarray:
    """Case table of cases ``first`` to ``first + count``, in the units of the keys.

    Returns
    -------
    table : ndarray, shape (count, len(dispersions))
        In Fortran order: each parameter is contiguous. Measured: 160 ns a case for 27 uniform laws.
    """
    table = np.empty((len(dispersions), count))
    for row, dispersion in zip(table, dispersions, strict=True):
        row[:] = quantile(dispersion, stream(seed, dispersion.parameter.path, first, count))
    return table.T


def extremes(scene: Scene, dispersions: Sequence[Dispersion]) -> tuple[Scene, ...]:
    """The scene with all dispersed parameters at the lower ends of their laws, and at the upper;
    none if nothing is dispersed."""
    if not dispersions:
        return ()
    ends = [_ends(d) * d.parameter.factor for d in dispersions]
    values = (
        {d.parameter.path: float(end[k]) for d, end in zip(dispersions, ends, strict=True)}
        for k in (0, 1)
    )
    return tuple(parameters.replace(scene, each) for each in values)


def _ends(law: Dispersion) -> np.ndarray:
    """Least and largest value (2,) of a law, in the unit of the parameter's key."""
    if law.law == "discrete":
        return np.array([min(law.numbers), max(law.numbers)])
    return quantile(law, np.array([_RARE, 1.0 - _RARE]))
