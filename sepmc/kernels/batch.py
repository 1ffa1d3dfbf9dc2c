"""The door: one parallel call flies a block of cases. Nothing raises inside; every case leaves a status."""

from numba import get_num_threads, prange, set_num_threads

from sepmc.kernels._jit import config, door
from sepmc.kernels.flight import fly_case


@door
def fly(m, rk, nominal, slots, draws, outcomes, status, times, phases, history, rows, level):
    """Fly every row of ``draws``.

    draws (n, d) at ``slots`` (d,) of ``nominal`` (p,); outcomes (n, o) and status (n,) are written. With ``level`` > 0 also
    times and phases (n, s), history (n, s, q) and rows (n,), the number of history rows of each case.
    """
    for i in prange(draws.shape[0]):
        status[i], rows[i] = fly_case(m, rk, nominal, slots, draws[i], outcomes[i], times[i], phases[i], history[i], level)


def max_threads() -> int:
    """Largest number of threads a campaign can use."""
    return int(config.NUMBA_NUM_THREADS)


def use_threads(count: int | None) -> int:
    """Fly the following blocks on ``count`` threads (all if None). Returns the number in use."""
    if config.DISABLE_JIT:
        return 1
    set_num_threads(count or max_threads())
    return int(get_num_threads())
