"""Marks of the functions that `sepmc.translator` compiles for kernels; they stay plain Python."""

import os
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, TypeVar

_F = TypeVar("_F", bound=Callable[..., Any])
PLAIN = "NUMBA_DISABLE_JIT"  # environment variable, as Numba's
# Whether formulas and routines are imported to run as plain Python, one lane at a time.
config = SimpleNamespace(plain=os.environ.get(PLAIN, "0") != "0")


def formula(function: _F) -> _F:
    """Mark a formula on scalars and tuples. Compiled code always inlines it: a loop over cases with
    a call in it is not vectorised."""
    return function


def long_formula(function: _F) -> _F:
    """Mark a formula too large to be inlined everywhere."""
    return function


def routine(function: _F) -> _F:
    """Mark a function of a workspace."""
    return function


def for_any_numbers(function: _F) -> _F:
    """Mark a function that is compiled once, not anew for each whole number in its calls. (Where
    these are loop counts, specialised code is faster.)"""
    return function


def noinline() -> None:
    """Keep a routine from being inlined. As the first line of a large routine it saves most of the
    compile time of its callers."""
