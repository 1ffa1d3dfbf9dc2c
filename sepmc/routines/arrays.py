"""Arrays that a kernel is given, by their addresses; as plain Python it is given the arrays
themselves."""

from typing import Any

import numba
from numba import carray, types
from numba.extending import intrinsic

from sepmc.jit import config, for_any_numbers, formula, routine
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import STRUCTURE

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


# what a kernel is given: address and up to three sizes of every array, four numbers each
Arrays = Any


@formula
def vector(a, k):
    """Array k as floats of one axis."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1],))


@formula
def indices(a, k):
    """Array k as integers of one axis."""
    return carray(_integers(a[4 * k]), (a[4 * k + 1],))


@formula
def table(a, k):
    """Array k as floats of two axes."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2]))


@formula
def block(a, k):
    """Array k as floats of three axes."""
    return carray(_floats(a[4 * k]), (a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]))


@formula
def record(a, k):
    """First record of array k, of type ``STRUCTURE``."""
    return carray(_records(a[4 * k]), (1,))[0]


@for_any_numbers
@routine
def get_column(w, slab, table, k, first):
    """Row k of a table, from number ``first`` on, into a slab; the last block of lanes is filled up
    with the last number."""
    last = table.shape[1] - 1
    if first + LANES <= table.shape[1]:
        for l in range(LANES):
            w[slab + l] = table[k, first + l]
    else:
        for l in range(LANES):
            w[slab + l] = table[k, min(first + l, last)]


@for_any_numbers
@routine
def put_columns(table, k, w, slab, count, first):
    """So many quantities of a slab into rows k, k + 1, ... of a table, from number ``first`` on, as
    far as it goes."""
    if first + LANES <= table.shape[1]:
        for i in range(count):
            for l in range(LANES):
                table[k + i, first + l] = w[slab + i * LANES + l]
    else:
        for i in range(count):
            for l in range(table.shape[1] - first):
                table[k + i, first + l] = w[slab + i * LANES + l]


if config.DISABLE_JIT:  # then they are given as they are

    def _as_it_is(a, k):
        return a[k]

    def _record_as_it_is(a, k):
        return a[k][0]

    vector = indices = table = block = _as_it_is
    record = _record_as_it_is
