"""Handle of a written kernel; independent of the compiler."""

from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

_ALIGNMENT = 8  # addresses: the workspace behind the padded table stays aligned


@dataclass(frozen=True)
class Kernel:
    """A written kernel, ready to run: compiled code or a module of plain Python.

    Attributes
    ----------
    address : int
        Address of the entry function; 0 if there is no machine code.
    size : int
        Number of floats in the workspace.
    table : ndarray of int
        Addresses of the compile units, stored in front of the workspace (`table`).
    n_indicators : int
        Number of error indicators of a case.
    n_segments : int
        Number of segments: phases, and parts of phases in which delayed releases are pending.
    n_changes : int
        Number of reported times within segments: changes of joints and ends of strokes, which a
        full history has rows for.
    methods : tuple of tuple of str
        Names of the integration methods of each segment.
    plain : module, optional
        The kernel as a module of plain Python.
    """

    address: int = 0
    size: int = 0
    table: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    n_indicators: int = 0
    n_segments: int = 0
    n_changes: int = 0
    methods: tuple[tuple[str, ...], ...] = ()
    plain: ModuleType | None = None

    def __getstate__(self) -> dict[str, Any]:
        """State for pickling: without addresses and without code."""
        return {**vars(self), "address": 0, "table": np.zeros(0, dtype=np.int64), "plain": None}


def table(addresses: list[int]) -> np.ndarray:
    """Addresses of compile units in the order in which they are stored in front of a workspace:
    zeros up to a whole cache line, then the addresses from the last unit to the first."""
    padding = -len(addresses) % _ALIGNMENT
    return np.array([*padding * [0], *reversed(addresses)], dtype=np.int64)
