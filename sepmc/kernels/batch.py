"""The door: one parallel call flies a block of cases. Nothing raises inside; every case leaves a status."""

import subprocess

import numpy as np
from numba import get_num_threads, prange, set_num_threads

from sepmc.kernels._jit import compiling, config, door, is_cached, one_at_a_time
from sepmc.kernels.flight import fly_case
from sepmc.kernels.layout import STRUCTURE, Model, Tableau


@door
def fly(scene, table, numbers, rk, nominal, slots, draws, outcomes, guards, status, times, phases, history, rows, level):
    """Fly every row of ``draws``.

    draws (n, d) at ``slots`` (d,) of ``nominal`` (p,); outcomes (n, o), guards (n, g) and status (n,) are written. With ``level`` > 0 also
    times and phases (n, s), history (n, s, q) and rows (n,), the number of history rows of each case.
    """
    for i in prange(draws.shape[0]):
        m = Model(scene[0], table, numbers)
        status[i], rows[i] = fly_case(
            m, rk, nominal, slots, draws[i], outcomes[i], guards[i], times[i], phases[i], history[i], level
        )  # fmt: skip


def compile_door() -> None:
    """Compile the door, or load it from the disk cache, by flying no case of an empty scene: its types are those of any scene."""
    integers, numbers = np.zeros(0, dtype=np.int64), np.zeros(0)
    scene = np.zeros(1, dtype=STRUCTURE)
    method = Tableau(np.zeros((1, 1)), np.zeros(1), np.zeros(1), np.zeros((1, 1)), np.zeros(1), 1.0, 0.0)
    table, codes, block = np.zeros((0, 0)), np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0, 0))
    fly(scene, integers, numbers, method, numbers, integers, table, table, table, integers, table, codes, block, integers, 0)


def compile_apart() -> bool:
    """Compile the door into the disk cache in a process of its own. Returns whether that worked.

    Code as compiled in a process and the same code loaded from the cache can differ in the last bit (the linker picks other
    copies of inlined functions). Every campaign flies what the cache holds, so that every run of a case gives the same bits.
    """
    process = compiling("from sepmc.kernels.batch import compile_door; compile_door()")
    try:
        with one_at_a_time("general"):
            return is_compiled() or subprocess.run(**process, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def is_compiled() -> bool:
    """Whether the disk cache holds the door."""
    return is_cached(fly)


def max_threads() -> int:
    """Largest number of threads a campaign can use."""
    return int(config.NUMBA_NUM_THREADS)


def use_threads(count: int | None) -> int:
    """Fly the following blocks on ``count`` threads (all if None). Returns the number in use."""
    if config.DISABLE_JIT:
        return 1
    set_num_threads(count or max_threads())
    return int(get_num_threads())
