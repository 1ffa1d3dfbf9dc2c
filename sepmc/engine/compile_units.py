"""CompileUnits of written kernels: functions of a workspace and numbers, compiled each for itself, that
call each other by address.

The addresses of a kernel's pieces stand in front of its workspace, so that whoever has the
workspace can call them all.
"""

from functools import partial
from typing import Any

import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from sepmc.jit import Lean, compiled, formula

_ENDLESS = 2**40  # numbers of a workspace, for who does not ask where it ends
_TYPES = {"i": types.int64, "f": types.float64, "a": types.CPointer(types.int64)}
GRAIN = 8  # addresses come in so many: the workspace behind them stays aligned


@formula
def workspace(address):
    """The workspace that starts at a pointer."""
    return carray(address, (_ENDLESS,))


def compile_unit(codes: str) -> Any:
    """Compile, at once, a function of a workspace's address and numbers ("i" whole, "f" floating;
    "a" arrays)."""
    signature = types.void(types.CPointer(types.float64), *(_TYPES[code] for code in codes))
    return partial(compiled, signature=signature, pipeline_class=Lean)


def callee(place: int, codes: str) -> Any:
    """What calls the piece whose address stands at a place of the table, with a workspace and
    numbers."""

    def typer(typing_context, w, *numbers):
        def generate(context, builder, signature, values):
            from llvmlite import ir  # noqa: PLC0415

            whole = ir.IntType(64)
            data = context.make_array(signature.args[0])(context, builder, values[0]).data
            table = builder.bitcast(data, whole.as_pointer())
            address = builder.load(builder.gep(table, [ir.Constant(whole, -1 - place)]))
            kinds = [data.type, *(context.get_value_type(kind) for kind in signature.args[1:])]
            function = ir.FunctionType(ir.VoidType(), kinds)
            builder.call(builder.inttoptr(address, function.as_pointer()), [data, *values[1:]])
            return context.get_dummy_value()

        return types.none(w, *(_TYPES[code] for code in codes)), generate

    return intrinsic(_taking(len(codes), typer))


def _taking(count: int, typer: Any) -> Any:
    """The typer of an intrinsic of a workspace and so many numbers: Numba counts its arguments."""
    takers = (
        lambda context, w: typer(context, w),  # noqa: PLW0108
        lambda context, w, a: typer(context, w, a),  # noqa: PLW0108
        lambda context, w, a, b: typer(context, w, a, b),  # noqa: PLW0108
        lambda context, w, a, b, c: typer(context, w, a, b, c),  # noqa: PLW0108
        lambda context, w, a, b, c, d: typer(context, w, a, b, c, d),  # noqa: PLW0108
    )
    return takers[count]


def table(addresses: list[int]) -> np.ndarray:
    """Addresses in the order in which they stand in front of a workspace: the last first, after
    what fills up a line of memory."""
    room = -len(addresses) % GRAIN
    return np.array([*room * [0], *reversed(addresses)], dtype=np.int64)


__all__ = ["callee", "compile_unit", "table", "workspace"]
