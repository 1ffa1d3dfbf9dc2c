"""The cases of a run with its least and greatest outcomes: they lie further out than trial cases, and are looked at again."""

import numpy as np

from sepmc.door import Block
from sepmc.schema import Status


class Extremes:
    """Draws of the cases with the least and greatest value of each of so many outcomes so far, of those that are ok."""

    def __init__(self, outcomes: int):
        self.values = np.full((2, outcomes), np.inf)  # the greatest ones with a minus
        self.draws: list[list[np.ndarray | None]] = [[None] * outcomes for _ in range(2)]

    def note(self, block: Block, draws: np.ndarray) -> None:
        """Look at cases just flown; draws (n, d)."""
        found = block.outcomes[:, : self.values.shape[1]]
        there = (block.status == Status.OK)[:, None] & np.isfinite(found)
        for side, sign in enumerate((1.0, -1.0)):
            signed = np.where(there, sign * found, np.inf)
            rows = signed.argmin(axis=0)
            least = signed[rows, np.arange(len(rows))]
            for k in np.flatnonzero(least < self.values[side]):
                self.values[side, k], self.draws[side][k] = least[k], draws[rows[k]].copy()

    def table(self) -> np.ndarray:
        """Draws (m, d) of these cases, each once."""
        kept = [row for side in self.draws for row in side if row is not None]
        return np.unique(np.array(kept), axis=0) if kept else np.empty((0, 0))
