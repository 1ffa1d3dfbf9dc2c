"""The door of kernels: blocks of lanes in parallel. One prange loop serves all scenes; it calls
their kernels by address.

A kernel compiled into a prange loop of its own would be optimised and turned into machine code
three times, a third of its time to compile.
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
_LINE, _PAGE = 8, 512  # numbers of a line of memory, and of a page
# Pages of memory differ: where one lies can cost a kernel up to twice the time (6 % of the places
# of `table2` without an atmosphere). So no run stays where it is: each flight starts a page on.
_PLACES = 16
_flights = itertools.count()


def _enter_intrinsic(typing_context, kernel, workspace, first, arguments):
    """Call a kernel: void (double* workspace, int64 first, int64* arguments)."""

    def generate(context, builder, signature, values):
        from llvmlite import ir  # noqa: PLC0415

        whole, number = ir.IntType(64), ir.DoubleType().as_pointer()
        kinds = [number, whole, whole.as_pointer()]
        function = ir.FunctionType(ir.VoidType(), kinds).as_pointer()
        address, place, first, given = values
        builder.call(
            builder.inttoptr(address, function),
            [builder.inttoptr(place, number), first, builder.inttoptr(given, kinds[2])],
        )
        return context.get_dummy_value()

    return types.none(*4 * (types.int64,)), generate


_enter: Any = intrinsic(_enter_intrinsic)


def _run_blocks(kernel, blocks, workspaces, size, arguments):
    """Fly blocks 0 to ``blocks`` of LANES cases with the kernel at an address; each thread has a
    workspace of its own, so many bytes from one to the next."""
    for number in prange(blocks):
        _enter(kernel, workspaces + get_thread_id() * size, number * LANES, arguments)


def integrate(
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
    typical,
    every,
    outcomes,
    ends,
    history,
    status,
    methods,
) -> None:
    """Fly every column of ``draws`` (d, n) at ``slots`` (d,) of ``nominal`` (p,), in ``steps``
    (stages,) steps a stage, that is a phase, or the time in which joints are late. It usually lasts
    ``typical`` (stages,) s. Where switches and events divide it, so many steps from one to the next,
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
        typical,
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
    if not kernel.address:
        raise RuntimeError("a copy of a kernel cannot be flown: it has to be loaded again")
    for array in arrays:
        assert array.flags.c_contiguous
    sizes = np.array(
        [[array.ctypes.data, *array.shape, *(3 - array.ndim) * [1]] for array in arrays],
        dtype=np.int64,
    )
    room, workspaces = _workspaces(kernel)
    blocks = (draws.shape[1] + LANES - 1) // LANES
    if threads.is_forked():
        _run_serial(kernel.address, blocks, workspaces, sizes.ctypes.data)
        return
    with threads.in_turn():
        _loop()(kernel.address, blocks, workspaces, room.strides[0], sizes.ctypes.data)


def _run_serial(kernel: int, blocks: int, workspace: int, arguments: int) -> None:
    """`_run_blocks` on the thread of the caller: the same machine code of the kernel, so the same
    bits, outside of Numba's threads."""
    enter = CFUNCTYPE(None, *3 * (c_int64,))(kernel)
    for number in range(blocks):
        enter(workspace, number * LANES, arguments)


def _workspaces(kernel: Kernel) -> tuple[np.ndarray, int]:
    """A row for each thread, with the addresses of the kernel's pieces at its start, and the
    address of what comes after these in the first row, where a line of memory begins."""
    calls = kernel.calls
    size = len(calls) + kernel.size
    room = np.empty((threads.in_use(), size + -size % _LINE + _LINE + _PLACES * _PAGE))
    skipped = -(room.ctypes.data // room.itemsize) % _LINE + next(_flights) % _PLACES * _PAGE
    room.view(np.int64)[:, skipped : skipped + len(calls)] = calls
    return room, room.ctypes.data + (skipped + len(calls)) * room.itemsize


def compile_blocks() -> None:
    """Compile the loop over blocks into the cache folder."""
    signature = types.void(*5 * (types.int64,))
    cache_files.store(NAME, *machine_code(compiled(_run_blocks, signature, parallel=True)))


@cache
def _loop() -> Any:
    """The loop over blocks; it is compiled if it is not in the cache folder."""
    threads.in_use()  # which lets machine code find Numba's threads
    return PYFUNCTYPE(None, *5 * (c_int64,))(cache_files.link_or_make(NAME, compile_blocks))


__all__ = ["NAME", "compile_blocks", "integrate"]
