"""Values of expressions during translation: numbers, tuples of values, arrays and records.

LLVM sees only the leaves of a value: the numbers and pointers that it consists of. Tuples, arrays
and records exist only in the translator.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from typing import Any

FLOAT, INT, BOOL, POINTER = "double", "i64", "i1", "ptr"
RANK = {BOOL: 0, INT: 1, FLOAT: 2}  # a number can become one of a higher rank


@dataclass(frozen=True, slots=True)
class Number:
    """Scalar value of the code being translated: a number, a truth value or a pointer.

    Attributes
    ----------
    kind : str
        Its type in LLVM: FLOAT, INT, BOOL or POINTER.
    text : str
        Its operand in LLVM assembly, such as ``%v3`` or ``42``.
    constant : float, int or bool, optional
        Its value if it is known during translation; None if only running code knows it.
    """

    kind: str
    text: str
    constant: Any = None


@dataclass(frozen=True, slots=True)
class Array:
    """View of a C-contiguous array in the memory of the running code.

    Attributes
    ----------
    element : str
        Type of its elements: FLOAT or INT.
    data : Number
        Pointer to the first element.
    shape : tuple of Number
        Size of each axis. Empty for a 1-D array of unknown length, as a workspace is.
    """

    element: str
    data: Number
    shape: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True)
class Record:
    """Record of 64-bit integers with names, in the memory of the running code.

    Attributes
    ----------
    data : Number
        Pointer to the first integer.
    fields : tuple of str
        Names of the integers, in their order in memory.
    """

    data: Number
    fields: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Named:
    """Instance of a NamedTuple class in translated code.

    Attributes
    ----------
    type : type
        The NamedTuple class.
    values : tuple
        Value of each field, in the order of the fields.
    """

    type: Any
    values: tuple[Any, ...]


def constant(value: Any) -> Number:
    """Return a bool, int or float of Python as a `Number` with a known value. Raises OverflowError
    if an int does not fit 64 bits."""
    if isinstance(value, bool):
        return Number(BOOL, "true" if value else "false", value)
    if isinstance(value, int):
        if not -(2**63) <= value < 2**63:
            raise OverflowError(f"{value} has more than 64 bits")
        return Number(INT, str(value), value)
    bits = struct.unpack("<Q", struct.pack("<d", float(value)))[0]
    return Number(FLOAT, f"0x{bits:016X}", float(value))


def leaves(value: Any) -> Iterator[Number]:
    """Yield the leaves of a value in order: the numbers in nested tuples and fields of `Named`; of
    an array its pointer, then its sizes; of a record its pointer."""
    if isinstance(value, Number):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from leaves(item)
    elif isinstance(value, Array):
        yield value.data
        yield from value.shape
    elif isinstance(value, Record):
        yield value.data
    else:
        yield from leaves(value.values)


def rebuilt(value: Any, numbers: Iterator[Number]) -> Any:
    """Return a copy of ``value`` whose leaves, in the order of `leaves`, are replaced by the next
    items of the iterator ``numbers``."""
    if isinstance(value, Number):
        return next(numbers)
    if isinstance(value, tuple):
        return tuple(rebuilt(item, numbers) for item in value)
    if isinstance(value, Array):
        return Array(value.element, next(numbers), tuple(next(numbers) for _ in value.shape))
    if isinstance(value, Record):
        return Record(next(numbers), value.fields)
    return Named(value.type, rebuilt(value.values, numbers))


def form(value: Any, constants: bool) -> Any:
    """Return a hashable key of a value: its nesting, and the type of each leaf without its operand.
    If ``constants`` is true, the key includes the values of integers that are known."""
    if isinstance(value, Number):
        known = constants and value.kind == INT and value.constant is not None
        return (value.kind, value.constant) if known else value.kind
    if isinstance(value, tuple):
        return tuple(form(item, constants) for item in value)
    if isinstance(value, Array):
        return ("array", value.element, tuple(form(size, constants) for size in value.shape))
    if isinstance(value, Record):
        return ("record", value.fields)
    return (value.type, form(value.values, constants))


def require_alike(*values: Any) -> None:
    """Raise TypeError unless all values have the same structure: nesting of tuples, names of
    fields, element type and number of axes of arrays. The type of a number may differ: True, 1 and
    1.0 are alike."""
    forms = {form(rebuilt(value, repeat(constant(0.0))), False) for value in values}
    if len(forms) > 1:
        raise TypeError(
            "values of different forms: they must have the same nesting of tuples, and arrays the "
            "same element type and number of axes"
        )


def common_kind(*numbers: Number) -> str:
    """Return the type that numbers of several types are converted to before an operation: the one
    of the highest rank among theirs (`RANK`)."""
    kinds = {number.kind for number in numbers}
    return kinds.pop() if len(kinds) == 1 else max(kinds, key=RANK.__getitem__)
