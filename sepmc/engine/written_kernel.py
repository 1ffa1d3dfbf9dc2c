"""Handle of a loaded kernel: compiled, or plain Python. This module imports no compiler."""

from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

_ALIGNMENT = 8  # addresses: the workspace behind the padded table stays aligned


@dataclass(frozen=True)
class Kernel:
    """Kernel that is ready to run: machine code in this process, or a module of plain Python.

    Attributes
    ----------
    address : int
        Address of the entry function; 0 if there is no machine code.
    size : int
        Number of floats in a workspace.
    table : ndarray of int
        Addresses of the compile units, from the module function `table`; they are stored in memory
        just before each workspace.
    n_indicators : int
        Number of error indicators of a case.
    n_segments : int
        Number of segments: phases, and parts of phases in which delayed releases are pending.
    n_changes : int
        Number of reported times within segments: changes of joints and ends of strokes, for which a
        full history has rows.
    methods : tuple of tuple of str
        Names of the integration methods of each segment.
    plain : module, optional
        Module of plain Python; None if the kernel is compiled.
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
        """Return the state for pickling: without addresses and code, so that a copy cannot run."""
        return {**vars(self), "address": 0, "table": np.zeros(0, dtype=np.int64), "plain": None}


def table(addresses: list[int]) -> np.ndarray:
    """Return the addresses of compile units in the order in which they are stored just before a
    workspace: the addresses from the last unit to the first, so that unit k is k + 1 places before
    the workspace. Zeros in front make the length a multiple of a cache line (8 numbers)."""
    padding = -len(addresses) % _ALIGNMENT
    return np.array([*padding * [0], *reversed(addresses)], dtype=np.int64)
