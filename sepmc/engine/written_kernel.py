"""A written kernel as Python holds it; knows no compiler."""

from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Kernel:
    """A written kernel, ready to fly: the addresses of its pieces (see `table`), of which the last
    is entered, the size of its workspace, how many guards and stages it has, and sudden changes
    that it tells the times of; or a module of plain Python. ``methods`` are the names of those by
    which each stage may be flown."""

    address: int = 0
    size: int = 0
    calls: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    n_indicators: int = 0
    n_segments: int = 0
    n_changes: int = 0
    methods: tuple[tuple[str, ...], ...] = ()
    plain: ModuleType | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What a copy holds, in another process too: no address, and no code."""
        return {**vars(self), "address": 0, "calls": np.zeros(0, dtype=np.int64), "plain": None}
