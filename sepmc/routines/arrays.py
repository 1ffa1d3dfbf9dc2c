"""Access to the arrays of a kernel. In plain Python these are in a list; compiled code gets address
and sizes of each (`sepmc.translator.operations`)."""

from typing import Any

from sepmc.jit import for_any_numbers, noinline, routine
from sepmc.routines.lanes import LANES

# arguments of a kernel: address and three sizes of every array, four numbers each
Arrays = Any


def vector(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 1-D array of floats."""
    return a[k]


def indices(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 1-D array of integers."""
    return a[k]


def table(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 2-D array of floats."""
    return a[k]


def block(a, k):
    """Array k of the arguments ``a`` of a kernel, as a 3-D array of floats."""
    return a[k]


def record(a, k):
    """First record of array k of the arguments ``a`` of a kernel: an array of `layout.STRUCTURE`
    records."""
    return a[k][0]


@for_any_numbers
@routine
def get_column(w, offset, table, k, first):
    """Copy LANES numbers from row k of a table, from column ``first`` on, to w[offset] and after
    it; lanes beyond the last column get the number of that column."""
    noinline()
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
    noinline()
    if first + LANES <= table.shape[1]:
        for i in range(count):
            for l in range(LANES):
                table[k + i, first + l] = w[offset + i * LANES + l]
    else:
        for i in range(count):
            for l in range(table.shape[1] - first):
                table[k + i, first + l] = w[offset + i * LANES + l]
