"""Access to the arrays that a kernel is called with. In plain Python they are items of a list;
compiled code gets the address and the sizes of each (`sepmc.translator.operations`)."""

from typing import Any

from sepmc.jit import for_any_numbers, noinline, routine
from sepmc.routines.lanes import LANES

# arguments of a kernel: address and three sizes of every array, four numbers each
Arrays = Any


def vector(a, k):
    """Return array k of the arguments ``a`` of a kernel, a 1-D array of floats."""
    return a[k]


def indices(a, k):
    """Return array k of the arguments ``a`` of a kernel, a 1-D array of integers."""
    return a[k]


def table(a, k):
    """Return array k of the arguments ``a`` of a kernel, a 2-D array of floats."""
    return a[k]


def block(a, k):
    """Return array k of the arguments ``a`` of a kernel, a 3-D array of floats."""
    return a[k]


def record(a, k):
    """Return the first record of array k of the arguments ``a`` of a kernel, an array of records of
    the type `layout.STRUCTURE`."""
    return a[k][0]


@for_any_numbers
@routine
def get_column(w, offset, table, k, first):
    """Copy LANES numbers from row k of a table, columns ``first`` and following, to w[offset] and
    following: one for each lane. Lanes beyond the last column get the number of the last column."""
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
    """Copy ``count`` quantities, LANES numbers each, from w[offset] and following into rows k, k +
    1, ... of a table, columns ``first`` and following. Lanes beyond the last column are
    dropped."""
    noinline()
    if first + LANES <= table.shape[1]:
        for i in range(count):
            for l in range(LANES):
                table[k + i, first + l] = w[offset + i * LANES + l]
    else:
        for i in range(count):
            for l in range(table.shape[1] - first):
                table[k + i, first + l] = w[offset + i * LANES + l]
