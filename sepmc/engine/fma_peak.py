"""Loop, compiled by numba, that reaches the peak rate of fused multiply-adds of this machine, an
upper bound for the rate of a kernel."""

import numpy as np
from numba import njit, prange

NUMBERS = 64  # numbers in a chain, in vector registers
CHAINS = 8  # independent chains: a multiply-add takes four cycles, two can start in each
STEPS = 32  # multiply-adds on each number between load and store
FLOPS = 2 * STEPS * CHAINS * NUMBERS  # in a pass over a block


@njit(forceinline=True, fastmath={"contract"})
def _one(x, a, b):
    """Return the tuple of x a + b for each of the eight numbers in the tuple ``x``."""
    return (
        x[0] * a + b, x[1] * a + b, x[2] * a + b, x[3] * a + b, x[4] * a + b, x[5] * a + b,
        x[6] * a + b, x[7] * a + b,
    )  # fmt: skip


@njit(forceinline=True, fastmath={"contract"})
def _four(x, a, b):
    """Return the eight numbers of the tuple ``x`` after four multiply-adds x a + b of each."""
    return _one(_one(_one(_one(x, a, b), a, b), a, b), a, b)


@njit(forceinline=True, fastmath={"contract"})
def _sixteen(x, a, b):
    """Return the eight numbers of the tuple ``x`` after sixteen multiply-adds x a + b of each."""
    return _four(_four(_four(_four(x, a, b), a, b), a, b), a, b)


@njit(parallel=True, fastmath={"contract"}, error_model="numpy")
def multiply_add(blocks, passes, a, b):
    """Replace every number x in ``blocks`` by x a + b, ``passes`` * STEPS times in succession; each
    row is processed by one thread.

    The numbers are independent, so the loop over them is vectorised and the processor's pipelines
    are full.

    Parameters
    ----------
    blocks : ndarray, shape (m, CHAINS * NUMBERS)
        Changed in place.
    passes : int
    a, b : float
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
    """Return an array of ones to call `multiply_add` with, shape (threads, CHAINS * NUMBERS)."""
    return np.ones((threads, CHAINS * NUMBERS))
