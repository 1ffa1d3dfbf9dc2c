"""A written kernel as Python holds it; knows no compiler."""

from dataclasses import dataclass, field
from types import ModuleType

import numpy as np


@dataclass(frozen=True)
class Kernel:
    """A written kernel, ready to fly: the addresses of its pieces (see `table`), of which the last is entered, the size of its
    workspace, how many guards it has, and how many stretches each of its stages: between two
    switches or events; or a module of plain Python."""

    address: int = 0
    size: int = 0
    calls: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    guards: int = 0
    stretches: tuple[int, ...] = ()
    plain: ModuleType | None = None

    @property
    def stages(self) -> int:
        return len(self.stretches)

    def steps(self, by_stage: np.ndarray) -> np.ndarray:
        """Steps of every stretch, as many as its stage has, (stages,)."""
        return np.repeat(by_stage, self.stretches)

    def most(self, steps: np.ndarray) -> np.ndarray:
        """Of steps (stretches,), the most of every stage, (stages,)."""
        return np.maximum.reduceat(steps, np.cumsum((0, *self.stretches[:-1])))
