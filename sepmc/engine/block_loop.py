"""Parallel loop over blocks of LANES cases, compiled by Numba once for all scenes: it calls the
kernel of a scene by its address.

Numba would optimise a kernel inside a parallel loop and turn it into machine code three times, a
third of its compile time.
"""

from ctypes import PYFUNCTYPE, c_int64
from functools import cache
from typing import Any

import numba
from llvmlite import binding, ir
from numba import get_thread_id, prange, types
from numba.core import base
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.extending import intrinsic

from sepmc.engine import cache_files, threads
from sepmc.engine.cache_files import LOOP
from sepmc.routines.lanes import LANES


def _enter_intrinsic(typing_context, kernel, workspace, first, arguments):
    """Define the Numba intrinsic ``_enter(kernel, workspace, first, arguments)``, which calls the
    kernel at an address. Returns its Numba signature and its code generator.

    All four arguments are int64; kernel, workspace and arguments are addresses. The kernel itself
    is void (double* workspace, int64 first, int64* arguments).
    """

    def generate(context, builder, signature, values):
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
    ``kernel``.

    ``workspaces`` is the address of the workspace of the first thread; those of the others follow
    ``size`` bytes apart. ``arguments`` is the address of a table with the address and the sizes of
    each array of the kernel.
    """
    for number in prange(blocks):
        _enter(kernel, workspaces + get_thread_id() * size, number * LANES, arguments)


def compile_loop() -> None:
    """Compile the parallel loop (`_run_blocks`) and store its object file in the cache folder."""
    signature = types.void(*5 * (types.int64,))
    function: Any = numba.cfunc(signature, parallel=True)(_run_blocks)
    library = function._library
    needed = [
        symbol.name
        for symbol in (*library._final_module.functions, *library._final_module.global_variables)
        if symbol.is_declaration and not symbol.name.startswith("llvm.")
    ]
    symbols = [function.native_name, *needed]
    cache_files.store(LOOP, symbols, library._get_compiled_object())


@cache
def loop() -> Any:
    """Return the compiled parallel loop, a callable of five integers as `_run_blocks`. It is loaded
    from the cache folder, after being compiled if it is missing there."""
    threads.in_use()  # starts the threads that the machine code uses
    base._load_global_helpers()
    for name, address in _nrt_python.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
    return PYFUNCTYPE(None, *5 * (c_int64,))(cache_files.link_or_make(LOOP, compile_loop))
