"""Marks in the source of the functions that `sepmc.translator` compiles for kernels.

The marks are decorators that return the function unchanged, so in Python it stays callable; the
translator finds them only as ``@NAME`` above the function. A workspace is the buffer of floats in
which a kernel keeps all numbers of the cases that it integrates side by side.
"""

import os
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, TypeVar

_F = TypeVar("_F", bound=Callable[..., Any])
PLAIN = "NUMBA_DISABLE_JIT"  # environment variable, as Numba's
# Whether formulas and routines are imported to run as plain Python, one lane at a time.
config = SimpleNamespace(plain=os.environ.get(PLAIN, "0") != "0")


def formula(function: _F) -> _F:
    """Mark a formula, a function of numbers and tuples, and return it unchanged: the mark is only
    the text ``@formula`` in the source, which the translator reads. Compiled code inlines every
    call of it, since a loop over cases with a call in it is not vectorised."""
    return function


def long_formula(function: _F) -> _F:
    """Mark a formula that is too large to be inlined in every call, and return it unchanged; the
    compiler decides where it is inlined."""
    return function


def routine(function: _F) -> _F:
    """Mark a routine, a function with loops or searches, mostly over numbers in a workspace, and
    return it unchanged: the mark is only the text ``@routine`` in the source, which the translator
    reads. The compiler decides where the routine is inlined."""
    return function


def for_any_numbers(function: _F) -> _F:
    """Mark a function that is compiled once for all values of its integer arguments, and return it
    unchanged.

    Other routines are compiled anew for each set of integers that are known in a call, which makes
    them faster where these are loop counts.
    """
    return function


def noinline() -> None:
    """Keep the routine that calls this function from being inlined; in Python it does nothing.
    Called in the first line of a large routine, it saves most of the compile time of the
    callers."""
