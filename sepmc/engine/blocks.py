"""Entry into compiled kernels: one parallel loop over blocks of lanes, for all scenes, that calls a
kernel by its address.

A kernel compiled into a parallel loop of its own would be optimised and turned into machine code
three times, a third of its compile time.
"""

import itertools
import math
from ctypes import CFUNCTYPE, PYFUNCTYPE, c_int64
from functools import cache
from typing import Any

import numpy as np
from numba import get_thread_id, prange, types
from numba.extending import intrinsic

from sepmc.engine import cache_files, threads
from sepmc.engine.written_kernel import Kernel
from sepmc.jit import compiled, machine_code
from sepmc.routines.lanes import LANES

NAME = "blocks"  # of the loop's object file
_LINE, _PAGE = 8, 512  # numbers in a cache line and in a page of memory
# The page that a workspace starts at can double the time of a kernel (6 % of the pages, `table2`
# without an atmosphere). So each call starts at the next page, and no run stays on a slow one.
_PAGES = 16
_calls = itertools.count()


def _enter_intrinsic(typing_context, kernel, workspace, first, arguments):
    """Typer of a Numba intrinsic that calls a kernel at an address: void (double* workspace, int64
    first, int64* arguments)."""

    def generate(context, builder, signature, values):
        from llvmlite import ir  # noqa: PLC0415

        integer, double_p = ir.IntType(64), ir.DoubleType().as_pointer()
        types_in = [double_p, integer, integer.as_pointer()]
        function = ir.FunctionType(ir.VoidType(), types_in).as_pointer()
        address, data, first, values_p = values
        builder.call(
            builder.inttoptr(address, function),
            [builder.inttoptr(data, double_p), first, builder.inttoptr(values_p, types_in[2])],
        )
        return context.get_dummy_value()

    return types.none(*4 * (types.int64,)), generate


_enter: Any = intrinsic(_enter_intrinsic)


def _run_blocks(kernel, blocks, workspaces, size, arguments):
    """Integrate ``blocks`` blocks of LANES cases each, in parallel, with the kernel at the address
    ``kernel``. The first workspace is at the address ``workspaces``, those of the other threads are
    ``size`` bytes apart; ``arguments`` is the address of the sizes of all arrays."""
    for number in prange(blocks):
        _enter(kernel, workspaces + get_thread_id() * size, number * LANES, arguments)


def integrate(
    kernel: Kernel, scene, table, numbers, nominal, slots, samples, steps, pace, times, typical,
    history_times, outcomes, ends, history, status, methods,
) -> None:  # fmt: skip
    """Integrate all cases (columns of ``samples``) with a kernel.

    The n cases have d sampled parameters, p parameters in all, o outcomes and error indicators. A
    segment is a phase, or the part of a phase in which a delayed release is pending. Arrays are
    contiguous.

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
        Steps of a segment. An interval between two events takes as many or fewer.
    pace : ndarray, shape (segments,)
        Step length, s, which fewer steps must not exceed; 0: never fewer.
    times : int
        Numbers of steps of an interval are multiples of this.
    typical : ndarray, shape (segments,)
        Typical duration of each segment, s.
    history_times : float or ndarray, shape (rows, 3)
        Interval between rows of a separation history, s. For a full history the instants of its
        rows: time, s; number of the segment; -1 for the state just before that time, 1 for that
        just after it, 0 where they do not differ.
    outcomes : ndarray, shape (o, n)
        Output: outcomes, audit columns and error indicators, SI units.
    ends : ndarray, shape (segments, n)
        Output: times at which segments end, s. With a full history, rows for the times of changes
        within segments follow.
    history : ndarray, shape (n, rows, columns)
        Output: for separation histories speed and distance of every joint.
    status : ndarray of int, shape (n,)
        Output: status of each case; below 0 if the kernel rejects it.
    methods : ndarray of int, shape (segments,)
        Number of the integration method among those of each segment; 0: the most accurate one.

    Raises
    ------
    RuntimeError
        If the kernel is a copy without machine code, as unpickling makes it.
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
        raise RuntimeError("a copy of a kernel has no machine code: load the kernel again")
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
        _loop()(kernel.address, blocks, workspaces, buffer.strides[0], sizes.ctypes.data)


def _run_serial(kernel: int, blocks: int, workspace: int, arguments: int) -> None:
    """Integrate all blocks on the thread of the caller, outside of Numba's threads, by the same
    machine code, so with the same bits. ``kernel``, ``workspace`` and ``arguments`` are addresses,
    as in `_run_blocks`."""
    enter = CFUNCTYPE(None, *3 * (c_int64,))(kernel)
    for number in range(blocks):
        enter(workspace, number * LANES, arguments)


def _workspaces(kernel: Kernel) -> tuple[np.ndarray, int]:
    """Allocate one workspace for each thread, each with the addresses of the compile units in
    front.

    Returns the buffer (threads, numbers) and the address of the first workspace, at the start of a
    cache line.
    """
    addresses = kernel.table
    size = len(addresses) + kernel.size
    buffer = np.empty((threads.in_use(), size + -size % _LINE + _LINE + _PAGES * _PAGE))
    offset = -(buffer.ctypes.data // buffer.itemsize) % _LINE + next(_calls) % _PAGES * _PAGE
    buffer.view(np.int64)[:, offset : offset + len(addresses)] = addresses
    return buffer, buffer.ctypes.data + (offset + len(addresses)) * buffer.itemsize


def compile_blocks() -> None:
    """Compile the parallel loop over blocks and store its object file in the cache folder."""
    signature = types.void(*5 * (types.int64,))
    cache_files.store(NAME, *machine_code(compiled(_run_blocks, signature, parallel=True)))


@cache
def _loop() -> Any:
    """The loop over blocks, `_run_blocks`, as a callable: loaded from the cache folder, after
    compiling it if it is missing there."""
    threads.in_use()  # starts the threads that the machine code uses
    return PYFUNCTYPE(None, *5 * (c_int64,))(cache_files.link_or_make(NAME, compile_blocks))


__all__ = ["NAME", "compile_blocks", "integrate"]
