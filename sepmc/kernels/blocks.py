"""The door of specialised kernels: blocks of lanes in parallel. One prange loop serves all scenes; it calls their kernels by address.

A kernel compiled into a prange loop of its own would be optimised and turned into machine code three times, a third of its time to
compile.
"""

from types import ModuleType
from typing import Any

import numba
import numpy as np
from numba import carray, prange, types
from numba.extending import intrinsic

from sepmc.kernels._jit import door, entry, formula
from sepmc.kernels.lanes import LANES
from sepmc.kernels.layout import STRUCTURE

_RECORD = numba.from_dtype(STRUCTURE)


def _pointer_to(element: Any):
    """An intrinsic that takes an address to a pointer."""

    def typer(typing_context, address):
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return types.CPointer(element)(types.int64), generate

    return intrinsic(typer)


_floats: Any = _pointer_to(types.float64)
_integers: Any = _pointer_to(types.int64)
_records: Any = _pointer_to(_RECORD)


def _call_intrinsic(typing_context, address, first, arguments):
    """Call a kernel: void (int64 first, int64* arguments)."""

    def generate(context, builder, signature, values):
        from llvmlite import ir  # noqa: PLC0415

        whole = ir.IntType(64)
        kernel = ir.FunctionType(ir.VoidType(), [whole, whole.as_pointer()])
        array = context.make_array(signature.args[2])(context, builder, values[2])
        builder.call(builder.inttoptr(values[0], kernel.as_pointer()), [values[1], array.data])
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, arguments), generate


_call: Any = intrinsic(_call_intrinsic)


# What a kernel is given: address and up to three sizes of every array, four numbers each.
@formula
def vector(a, k):
    return carray(_floats(a[4 * k]), (a[4 * k + 1],))


@formula
def indices(a, k):
    return carray(_integers(a[4 * k]), (a[4 * k + 1],))


@formula
def table(a, k):
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2]))


@formula
def block(a, k):
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]))


@formula
def record(a, k):
    return carray(_records(a[4 * k]), (1,))[0]


@door
def _fly_blocks(address, blocks, arguments):
    """Fly blocks 0 to ``blocks`` of LANES cases with the kernel at an address."""
    for number in prange(blocks):
        _call(address, number * LANES, arguments)


def fly(module: ModuleType, scene, whole, numbers, nominal, slots, draws, steps, usual, every, outcomes, ends, history, status) -> None:
    """Fly every column of ``draws`` (d, n) at ``slots`` (d,) of ``nominal`` (p,), in ``steps`` (phases,) steps a phase, which usually
    lasts ``usual`` (phases,) s.

    Writes outcomes (o, n), the times ``ends`` (phases, n) at which phases end, and status (n,): 0, or -1 if this kernel cannot vouch for
    a case. If it was written for histories, also speed and distance of every joint ``every`` so many seconds, into history
    (n, rows, 2 joints). Arrays are contiguous.
    """
    arrays = (nominal, slots, draws, steps, usual, np.array([every]), outcomes, ends, history, status, scene, whole, numbers)
    blocks = (draws.shape[1] + module.LANES - 1) // module.LANES
    if not hasattr(module.enter, "address"):  # plain Python
        with np.errstate(all="ignore"):  # as compiled code is
            for number in range(blocks):
                module.fly_block(number * module.LANES, *arrays[:5], every, *arrays[6:10], scene[0], whole, numbers)
        return
    for array in arrays:
        assert array.flags.c_contiguous
    rows = [[array.ctypes.data, *array.shape, *(3 - array.ndim) * [1]] for array in arrays]
    _fly_blocks(module.enter.address, blocks, np.array(rows, dtype=np.int64).ravel())


def compile_blocks() -> None:
    """Compile the loop over blocks, or load it from the disk cache, by flying none."""
    _fly_blocks(0, 0, np.zeros(0, dtype=np.int64))


__all__ = ["block", "compile_blocks", "entry", "fly", "indices", "record", "table", "vector"]
