"""Draws of one seed, rounded so that a scene reads well."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def rounded(number: float, digits: int = 4) -> float:
    """A number to so many significant digits."""
    return float(f"{number:.{digits}g}")


class Dice:
    """A stream of draws that follows from a seed alone, and from the number of the stream."""

    def __init__(self, seed: int, stream: int = 0):
        self.random = np.random.default_rng([20190, seed, stream] if stream else [20190, seed])

    def chance(self, probability: float) -> bool:
        """True with a probability from 0 to 1."""
        return bool(self.random.random() < probability)

    def between(self, low: float, high: float) -> float:
        """A number from low to high."""
        return rounded(self.random.uniform(low, high))

    def about(self, size: float) -> float:
        """A number from -size to size."""
        return self.between(-size, size)

    def decades(self, low: float, high: float) -> float:
        """A number whose logarithm is uniform."""
        return rounded(float(np.exp(self.random.uniform(np.log(low), np.log(high)))))

    def vector(self, size: float, count: int = 3) -> list[float]:
        """So many numbers from -size to size."""
        return [self.about(size) for _ in range(count)]

    def direction(self) -> list[float]:
        """A vector of no particular length, never near zero."""
        drawn = self.random.normal(size=3)
        return [
            rounded(x, 3) for x in drawn / np.linalg.norm(drawn) * self.random.uniform(0.5, 2.0)
        ]

    def pick(self, items: Sequence[T]) -> T:
        """One of the items, all equally likely."""
        return items[int(self.random.integers(len(items)))]

    def weighted(self, weights: Mapping[T, float]) -> T:
        """One of the keys, as likely as its weight says."""
        shares = np.array(list(weights.values())) / sum(weights.values())
        return list(weights)[int(self.random.choice(len(shares), p=shares))]

    def some(self, items: Sequence[T], count: int) -> list[T]:
        """So many of the items, in their order."""
        chosen = self.random.permutation(len(items))[:count]
        return [items[i] for i in sorted(chosen)]
