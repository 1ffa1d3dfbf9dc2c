"""Entry into kernels: runs a kernel on all cases of a call, block by block of LANES cases."""

import itertools
import math
from ctypes import CFUNCTYPE, c_int64

import numpy as np

from sepmc.engine import block_loop, threads
from sepmc.engine.written_kernel import Kernel
from sepmc.routines.lanes import LANES

_LINE, _PAGE = 8, 512  # numbers in a cache line and in a page of memory
# The page that a workspace starts at can double the time of a kernel (6 % of the pages, `table2`
# without an atmosphere). So each call starts at the next page, and no run stays on a slow one.
_PAGES = 16
_calls = itertools.count()


def integrate(
    kernel: Kernel, scene, table, numbers, nominal, slots, samples, steps, pace, times, typical,
    history_times, outcomes, ends, history, status, methods,
) -> None:  # fmt: skip
    """Integrate all cases (columns of ``samples``) with a kernel, on all threads in use, and write
    the results into arrays of the caller.

    The n cases have d sampled parameters, p parameters in all, and o rows of results. A segment is
    a phase, or the part of a phase in which a delayed release is pending. Arrays are C-contiguous.

    Parameters
    ----------
    kernel : Kernel
    scene, table, numbers : ndarray
        Content of the scene (`sepmc.routines.layout.Model`).
    nominal : ndarray, shape (p,)
        Nominal parameters.
    slots : ndarray of int, shape (d,)
        Positions of the sampled parameters in ``nominal``.
    samples : ndarray, shape (d, n)
        Sampled parameters, SI units.
    steps : ndarray of int, shape (segments,)
        For each segment, the number of steps of an interval between two events; more if an event
        comes later than predicted.
    pace : ndarray, shape (segments,)
        Length, s: an interval takes ``times`` times the fewest steps that are not longer than this,
        if that is fewer than ``steps``. 0: always ``steps``.
    times : int
        See ``pace``: 1, or a larger number for a finer integration by a given step length.
    typical : ndarray, shape (segments,)
        Typical duration of each segment, s. At its start an event is predicted no later than after
        this time, which limits the first step.
    history_times : float or ndarray, shape (rows, 3)
        Interval between rows of a separation history, s. For a full history the instants of its
        rows: time, s; number of the segment; -1 for the state just before that time, 1 for that
        just after it, 0 where they do not differ.
    outcomes : ndarray, shape (o, n)
        Output: outcomes and audit columns (NaN in a case with a final status other than ok and
        never-released) and error indicators, SI units.
    ends : ndarray, shape (segments, n)
        Output: times at which segments end, s; the end of the run for segments that a case does not
        reach before. With a full history, rows for the times of changes of joints and ends of
        strokes within segments follow.
    history : ndarray, shape (n, rows, columns)
        Output, SI units: speed and distance of every joint for separation histories, all columns of
        `sepmc.schema.history_columns` for full ones.
    status : ndarray of int, shape (n,)
        Output: status of each case; below 0 if the kernel rejects it.
    methods : ndarray of int, shape (segments,)
        Number of the integration method among those of each segment; 0: the most accurate one.

    Raises
    ------
    RuntimeError
        If the kernel is a copy without machine code, as unpickling creates.
    """
    arrays = (
        nominal, slots, samples, steps, typical,
        np.atleast_1d(np.asarray(history_times, dtype=np.float64)), outcomes, ends, history, status,
        scene, table, numbers, pace, np.array([times], dtype=np.int64), methods,
    )  # fmt: skip
    if kernel.plain is not None:
        from sepmc.engine.interpreted import as_python  # noqa: PLC0415

        results = (outcomes, ends, history, status)
        values = [as_python(array, any(array is result for result in results)) for array in arrays]
        with np.errstate(all="ignore"):  # as in compiled code
            for first in range(0, samples.shape[1], kernel.plain.LANES):
                kernel.plain.integrate_block([math.nan] * kernel.plain.SIZE_W, first, values)
        return
    if not kernel.address:
        raise RuntimeError(
            "this kernel was copied or unpickled, so it has no machine code: load it again with "
            "sepmc.engine.dispatch.load_kernel"
        )
    for array in arrays:
        assert array.flags.c_contiguous
    sizes = np.array(
        [[array.ctypes.data, *array.shape, *(3 - array.ndim) * [1]] for array in arrays],
        dtype=np.int64,
    )
    buffer, workspaces = _workspaces(kernel)
    blocks = (samples.shape[1] + LANES - 1) // LANES
    if threads.is_forked():
        _run_serial(kernel.address, blocks, workspaces, sizes.ctypes.data)
        return
    with threads.parallel_region():
        block_loop.loop()(kernel.address, blocks, workspaces, buffer.strides[0], sizes.ctypes.data)


def _run_serial(kernel: int, blocks: int, workspace: int, arguments: int) -> None:
    """Integrate ``blocks`` blocks of LANES cases on the thread of the caller, outside of Numba's
    threads. The machine code is the same, and so are all bits of the results. ``kernel``,
    ``workspace`` and ``arguments`` are addresses, as in `block_loop._run_blocks`."""
    enter = CFUNCTYPE(None, *3 * (c_int64,))(kernel)
    for number in range(blocks):
        enter(workspace, number * LANES, arguments)


def _workspaces(kernel: Kernel) -> tuple[np.ndarray, int]:
    """Allocate a workspace for each thread, and store the addresses of the kernel's compile units
    just before each.

    Returns the buffer (threads, numbers), which must stay referenced, and the address of the
    workspace in its first row, at the start of a cache line.
    """
    addresses = kernel.table
    size = len(addresses) + kernel.size
    buffer = np.empty((threads.in_use(), size + -size % _LINE + _LINE + _PAGES * _PAGE))
    offset = -(buffer.ctypes.data // buffer.itemsize) % _LINE + next(_calls) % _PAGES * _PAGE
    buffer.view(np.int64)[:, offset : offset + len(addresses)] = addresses
    return buffer, buffer.ctypes.data + (offset + len(addresses)) * buffer.itemsize
