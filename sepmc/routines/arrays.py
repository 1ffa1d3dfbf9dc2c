"""Access to the arrays of a kernel by their addresses; in plain Python the arrays themselves."""

from typing import Any

import numba
from numba import carray, types
from numba.extending import intrinsic

from sepmc.jit import config, for_any_numbers, formula, routine
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import STRUCTURE

_RECORD = numba.from_dtype(STRUCTURE)


def _pointer_to(element: Any):
    """Create an intrinsic that casts an integer address to a pointer to a Numba type."""

    def typer(typing_context, address):
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return types.CPointer(element)(types.int64), generate

    return intrinsic(typer)


_floats: Any = _pointer_to(types.float64)
_integers: Any = _pointer_to(types.int64)
_records: Any = _pointer_to(_RECORD)


# arguments of a kernel: address and three sizes of every array, four numbers each
Arrays = Any


@formula
def vector(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 1-D array of floats."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1],))


@formula
def indices(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 1-D array of integers."""
    return carray(_integers(a[4 * k]), (a[4 * k + 1],))


@formula
def table(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 2-D array of floats."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2]))


@formula
def block(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 3-D array of floats."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]))


@formula
def record(a, k):
    """First record of array k of the arguments ``a`` of a kernel: an array of `layout.STRUCTURE`
    records."""
    return carray(_records(a[4 * k]), (1,))[0]


@for_any_numbers
@routine
def get_column(w, offset, table, k, first):
    """Copy LANES numbers from row k of a table, from column ``first`` on, to w[offset] and after
    it; lanes beyond the last column get the number of that column."""
    last = table.shape[1] - 1
    if first + LANES <= table.shape[1]:
        for l in range(LANES):
            w[offset + l] = table[k, first + l]
    else:
        for l in range(LANES):
            w[offset + l] = table[k, min(first + l, last)]


@for_any_numbers
@routine
def put_columns(table, k, w, offset, count, first):
    """Copy ``count`` quantities, LANES numbers each, from w[offset] on to rows k, k + 1, ... of a
    table, from column ``first`` on; lanes beyond the last column are dropped."""
    if first + LANES <= table.shape[1]:
        for i in range(count):
            for l in range(LANES):
                table[k + i, first + l] = w[offset + i * LANES + l]
    else:
        for i in range(count):
            for l in range(table.shape[1] - first):
                table[k + i, first + l] = w[offset + i * LANES + l]


if config.DISABLE_JIT:  # the arguments are the arrays

    def _array(a, k):
        return a[k]

    def _first_record(a, k):
        return a[k][0]

    vector = indices = table = block = _array
    record = _first_record
