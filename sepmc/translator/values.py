"""Values of translated code: numbers, tuples of values, arrays and records.

Tuples, arrays and records exist only during translation; LLVM sees their leaves, which are numbers
and pointers.
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
    """A number or pointer.

    Attributes
    ----------
    kind : str
        Its type in LLVM: FLOAT, INT, BOOL or POINTER.
    text : str
        Its operand in LLVM's assembly.
    constant : float, int or bool, optional
        Its value, if known.
    """

    kind: str
    text: str
    constant: Any = None


@dataclass(frozen=True, slots=True)
class Array:
    """View of a contiguous array.

    Attributes
    ----------
    element : str
        FLOAT or INT.
    data : Number
        Pointer to the first element.
    shape : tuple of Number
        Empty for a workspace, which has one axis and no length.
    """

    element: str
    data: Number
    shape: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True)
class Record:
    """Record of integers, by a pointer to the first.

    Attributes
    ----------
    data : Number
    fields : tuple of str
    """

    data: Number
    fields: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Named:
    """Named tuple of values.

    Attributes
    ----------
    type : type
        Of the tuple.
    values : tuple
        In the order of its fields.
    """

    type: Any
    values: tuple[Any, ...]


def constant(value: Any) -> Number:
    """Number that is known during translation."""
    if isinstance(value, bool):
        return Number(BOOL, "true" if value else "false", value)
    if isinstance(value, int):
        if not -(2**63) <= value < 2**63:
            raise OverflowError(f"{value} has more than 64 bits")
        return Number(INT, str(value), value)
    bits = struct.unpack("<Q", struct.pack("<d", float(value)))[0]
    return Number(FLOAT, f"0x{bits:016X}", float(value))


def leaves(value: Any) -> Iterator[Number]:
    """Numbers and pointers of a value, in order."""
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
    """Value of the form of ``value`` with other leaves, taken from an iterator."""
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
    """Hashable form of a value: types without operands; with the values of known integers if
    ``constants``."""
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
    """Raise TypeError unless values differ in nothing but their numbers and the types of these."""
    forms = {form(rebuilt(value, repeat(constant(0.0))), False) for value in values}
    if len(forms) > 1:
        raise TypeError("values of different forms")


def common_kind(*numbers: Number) -> str:
    """Type of an operation on several numbers."""
    kinds = {number.kind for number in numbers}
    return kinds.pop() if len(kinds) == 1 else max(kinds, key=RANK.__getitem__)
