"""The door of kernels: blocks of lanes in parallel. One prange loop serves all scenes; it calls
their kernels by address.

A kernel compiled into a prange loop of its own would be optimised and turned into machine code
three times, a third of its time to compile.
"""

import math
from typing import Any

import numpy as np
from numba import get_num_threads, prange, set_num_threads, types
from numba.extending import intrinsic

from sepmc.engine.written import Kernel
from sepmc.jit import config, door
from sepmc.routines.lanes import LANES


def _enter_intrinsic(typing_context, address, room, skipped, first, arguments):
    """Call a kernel: void (double* workspace, int64 first, int64* arguments); the workspace starts
    after so many numbers of ``room``."""

    def generate(context, builder, signature, values):
        from llvmlite import ir  # noqa: PLC0415

        whole, number = ir.IntType(64), ir.DoubleType()
        kernel = ir.FunctionType(ir.VoidType(), [number.as_pointer(), whole, whole.as_pointer()])
        data = context.make_array(signature.args[1])(context, builder, values[1]).data
        array = context.make_array(signature.args[4])(context, builder, values[4])
        workspace = builder.gep(data, [values[2]])
        builder.call(
            builder.inttoptr(values[0], kernel.as_pointer()), [workspace, values[3], array.data]
        )
        return context.get_dummy_value()

    return types.none(types.int64, room, types.int64, types.int64, arguments), generate


def _put_intrinsic(typing_context, room, k, address):
    """Put a whole number in the place of a floating one."""

    def generate(context, builder, signature, values):
        from llvmlite import ir  # noqa: PLC0415

        data = context.make_array(signature.args[0])(context, builder, values[0]).data
        places = builder.bitcast(data, ir.IntType(64).as_pointer())
        builder.store(values[2], builder.gep(places, [values[1]]))
        return context.get_dummy_value()

    return types.none(room, types.int64, types.int64), generate


_enter: Any = intrinsic(_enter_intrinsic)
_put: Any = intrinsic(_put_intrinsic)


@door
def _fly_blocks(address, blocks, size, calls, arguments):
    """Fly blocks 0 to ``blocks`` of LANES cases with the kernel at an address, whose pieces are at
    ``calls``."""
    for number in prange(blocks):
        room = np.empty(calls.shape[0] + size)
        for k in range(calls.shape[0]):
            _put(room, k, calls[k])
        _enter(address, room, calls.shape[0], number * LANES, arguments)


def fly(
    kernel: Kernel,
    scene,
    whole,
    numbers,
    nominal,
    slots,
    draws,
    steps,
    pace,
    times,
    usual,
    every,
    outcomes,
    ends,
    history,
    status,
    methods,
) -> None:
    """Fly every column of ``draws`` (d, n) at ``slots`` (d,) of ``nominal`` (p,), in ``steps``
    (stages,) steps a stage, that is a phase, or the time in which joints are late. It usually lasts
    ``usual`` (stages,) s. Where switches and events divide it, so many steps from one to the next,
    or fewer, a multiple of ``times``, if that many times the longest is no longer than ``pace``
    (stages,) s; 0: never fewer. ``methods`` (stages,) are numbers of the methods of each stage.

    Writes outcomes (o, n), the times ``ends`` (stages, n) at which stages end, and status (n,): 0,
    or -1 if this kernel cannot vouch for a case. If it was written for separations over time, also
    speed and distance of every joint ``every`` so many seconds, into history (n, rows, 2 joints);
    if for full histories, ``every`` (rows, 2) holds the time and the stage of every row. Arrays are
    contiguous.
    """
    arrays = (
        nominal,
        slots,
        draws,
        steps,
        usual,
        np.atleast_1d(np.asarray(every, dtype=np.float64)),
        outcomes,
        ends,
        history,
        status,
        scene,
        whole,
        numbers,
        pace,
        np.array([times], dtype=np.int64),
        methods,
    )
    if kernel.plain is not None:
        from sepmc.engine.interpreted import in_numbers  # noqa: PLC0415

        results = (outcomes, ends, history, status)
        given = [in_numbers(array, any(array is one for one in results)) for array in arrays]
        with np.errstate(all="ignore"):  # as compiled code is
            for first in range(0, draws.shape[1], kernel.plain.LANES):
                kernel.plain.fly_block([math.nan] * kernel.plain.SIZE_W, first, given)
        return
    for array in arrays:
        assert array.flags.c_contiguous
    sizes = [[array.ctypes.data, *array.shape, *(3 - array.ndim) * [1]] for array in arrays]
    blocks = (draws.shape[1] + LANES - 1) // LANES
    _fly_blocks(
        kernel.address, blocks, kernel.size, kernel.calls, np.array(sizes, dtype=np.int64).ravel()
    )


def compile_blocks() -> None:
    """Compile the loop over blocks, or load it from the disk cache, by flying none."""
    _fly_blocks(0, 0, 0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


def max_threads() -> int:
    """Largest number of threads a campaign can use."""
    return int(config.NUMBA_NUM_THREADS)


def use_threads(count: int | None) -> int:
    """Fly the following blocks on ``count`` threads (all if None). Returns the number in use."""
    if config.DISABLE_JIT:
        return 1
    set_num_threads(count or max_threads())
    return int(get_num_threads())


__all__ = ["compile_blocks", "fly", "max_threads", "use_threads"]
