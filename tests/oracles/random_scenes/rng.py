"""Random numbers of one seed, rounded so that a scene is readable."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def rounded(number: float, digits: int = 4) -> float:
    """Number rounded to significant digits."""
    return float(f"{number:.{digits}g}")


class RandomStream:
    """Random stream determined by a seed and the number of the stream."""

    def __init__(self, seed: int, stream: int = 0):
        self.generator = np.random.default_rng([20190, seed, stream] if stream else [20190, seed])

    def chance(self, probability: float) -> bool:
        """True with a probability from 0 to 1."""
        return bool(self.generator.random() < probability)

    def uniform(self, low: float, high: float) -> float:
        """Uniform number from low to high."""
        return rounded(self.generator.uniform(low, high))

    def symmetric(self, size: float) -> float:
        """Uniform number from -size to size."""
        return self.uniform(-size, size)

    def log_uniform(self, low: float, high: float) -> float:
        """Log-uniform number from low to high."""
        return rounded(float(np.exp(self.generator.uniform(np.log(low), np.log(high)))))

    def vector(self, size: float, count: int = 3) -> list[float]:
        """List of uniform numbers from -size to size."""
        return [self.symmetric(size) for _ in range(count)]

    def direction(self) -> list[float]:
        """Vector of three, length 0.5 to 2."""
        normal = self.generator.normal(size=3)
        return [
            rounded(x, 3)
            for x in normal / np.linalg.norm(normal) * self.generator.uniform(0.5, 2.0)
        ]

    def choice(self, items: Sequence[T]) -> T:
        """One of the items, all equally likely."""
        return items[int(self.generator.integers(len(items)))]

    def weighted_choice(self, weights: Mapping[T, float]) -> T:
        """One of the keys, with probabilities proportional to their weights."""
        probabilities = np.array(list(weights.values())) / sum(weights.values())
        return list(weights)[int(self.generator.choice(len(probabilities), p=probabilities))]

    def subset(self, items: Sequence[T], count: int) -> list[T]:
        """Random subset of the items, in their order."""
        chosen = self.generator.permutation(len(items))[:count]
        return [items[i] for i in sorted(chosen)]
