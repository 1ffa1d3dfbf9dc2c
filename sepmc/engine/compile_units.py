"""Compile units of written kernels: functions of a workspace and numbers that are compiled one by
one and call each other by address.

The addresses of a kernel's units are stored in front of its workspace, so that a function with the
workspace can call every unit.
"""

from functools import partial
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from sepmc.jit import Lean, compiled, formula

_LENGTH = 2**40  # of the view of a workspace; never reached
_TYPES = {"i": types.int64, "f": types.float64, "a": types.CPointer(types.int64)}
ALIGNMENT = 8  # addresses: the workspace behind the padded table stays aligned


@formula
def workspace(address):
    """View of the workspace at a pointer to its first number, as a 1-D array of floats; its length
    is not checked."""
    return carray(address, (_LENGTH,))


def compile_unit(codes: str) -> Any:
    """Create a decorator that compiles a function of a workspace's address and numbers at once.

    Parameters
    ----------
    codes : str
        A letter for each argument after the workspace: "i" integer, "f" floating point, "a" pointer
        to arrays.

    Returns
    -------
    callable
        From a Python function to its compiled form, which has an address.
    """
    signature = types.void(types.CPointer(types.float64), *(_TYPES[code] for code in codes))
    return partial(compiled, signature=signature, pipeline_class=Lean)


def callee(position: int, codes: str) -> Any:
    """Create the function by which compiled code calls a compile unit.

    Parameters
    ----------
    position : int
        Number of the unit in the order of `table`'s ``addresses``.
    codes : str
        Types of its arguments after the workspace, as in `compile_unit`.

    Returns
    -------
    intrinsic
        Takes the workspace and these arguments.
    """

    def typer(typing_context, w, *numbers):
        def generate(context, builder, signature, values):
            from llvmlite import ir  # noqa: PLC0415

            integer = ir.IntType(64)
            data = context.make_array(signature.args[0])(context, builder, values[0]).data
            table = builder.bitcast(data, integer.as_pointer())
            address = builder.load(builder.gep(table, [ir.Constant(integer, -1 - position)]))
            types_in = [
                data.type,
                *(context.get_value_type(argument) for argument in signature.args[1:]),
            ]
            function = ir.FunctionType(ir.VoidType(), types_in)
            builder.call(builder.inttoptr(address, function.as_pointer()), [data, *values[1:]])
            return context.get_dummy_value()

        return types.none(w, *(_TYPES[code] for code in codes)), generate

    return intrinsic(_with_arity(len(codes), typer))


def _with_arity(arity: int, typer: Any) -> Any:
    """Wrap a typer for an intrinsic of a workspace and ``arity`` numbers: Numba inspects the
    signature."""
    wrappers = (
        lambda context, w: typer(context, w),  # noqa: PLW0108
        lambda context, w, a: typer(context, w, a),  # noqa: PLW0108
        lambda context, w, a, b: typer(context, w, a, b),  # noqa: PLW0108
        lambda context, w, a, b, c: typer(context, w, a, b, c),  # noqa: PLW0108
        lambda context, w, a, b, c, d: typer(context, w, a, b, c, d),  # noqa: PLW0108
    )
    return wrappers[arity]


def table(addresses: list[int]) -> np.ndarray:
    """Addresses of compile units in the order in which they are stored in front of a workspace:
    zeros up to a whole cache line, then the addresses from the last unit to the first."""
    padding = -len(addresses) % ALIGNMENT
    return np.array([*padding * [0], *reversed(addresses)], dtype=np.int64)


__all__ = ["callee", "compile_unit", "table", "workspace"]
