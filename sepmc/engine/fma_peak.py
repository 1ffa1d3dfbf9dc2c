"""The most fused multiply-adds this machine does in a second: the ceiling that other kernels are
held against."""

import numpy as np
from numba import njit, prange

from sepmc.jit import formula

NUMBERS = 64  # side by side, in as many registers as that takes
CHAINS = 8  # slabs of them, in turn: a multiply-add takes four cycles, and two can begin in each
STEPS = 32  # multiply-adds on each number between load and store
FLOPS = 2 * STEPS * CHAINS * NUMBERS  # of a pass over a block


@formula
def _one(x, a, b):
    return (
        x[0] * a + b, x[1] * a + b, x[2] * a + b, x[3] * a + b, x[4] * a + b, x[5] * a + b,
        x[6] * a + b, x[7] * a + b,
    )  # fmt: skip


@formula
def _four(x, a, b):
    return _one(_one(_one(_one(x, a, b), a, b), a, b), a, b)


@formula
def _sixteen(x, a, b):
    return _four(_four(_four(_four(x, a, b), a, b), a, b), a, b)


@njit(parallel=True, fastmath={"contract"}, error_model="numpy")
def multiply_add(blocks, passes, a, b):
    """Put every number of ``blocks`` (m, CHAINS NUMBERS) through ``passes`` times STEPS of x = x a
    + b; a block a thread.

    Numbers do not wait for each other: the loop over them is vectorised, and as many multiply-adds
    as the processor holds are under way.
    """
    for i in prange(blocks.shape[0]):
        w = blocks[i]
        for _ in range(passes):
            for k in range(NUMBERS):
                x = (
                    w[k], w[k + NUMBERS], w[k + 2 * NUMBERS], w[k + 3 * NUMBERS],
                    w[k + 4 * NUMBERS], w[k + 5 * NUMBERS], w[k + 6 * NUMBERS], w[k + 7 * NUMBERS],
                )  # fmt: skip
                x = _sixteen(_sixteen(x, a, b), a, b)
                w[k], w[k + NUMBERS], w[k + 2 * NUMBERS], w[k + 3 * NUMBERS] = (
                    x[0],
                    x[1],
                    x[2],
                    x[3],
                )
                w[k + 4 * NUMBERS], w[k + 5 * NUMBERS], w[k + 6 * NUMBERS], w[k + 7 * NUMBERS] = (
                    x[4],
                    x[5],
                    x[6],
                    x[7],
                )


def blocks(threads: int) -> np.ndarray:
    """Numbers to work on, a block a thread."""
    return np.ones((threads, CHAINS * NUMBERS))
