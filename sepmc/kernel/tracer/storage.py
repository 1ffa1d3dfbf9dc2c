"""Shapes of values, and the code that reads and stores them in the workspace of a kernel."""

import math
from collections.abc import Callable, Iterator
from typing import Any

# Shape of a value: one number, a condition, several numbers, a symmetric matrix (nine numbers
# stored as six), or a tuple of shapes.
Shape = int | str | tuple[Any, ...]
NUMBER, CONDITION, SYMMETRIC = 1, "condition", "symmetric"

# suffix of get and put, and size
_STORED: dict[Shape, tuple[str, int]] = {3: ("3", 3), 4: ("4", 4), SYMMETRIC: ("6", 6), 9: ("9", 9)}
PRECEDENCE = {
    "where": 0,
    "or": 1,
    "and": 2,
    "==": 3,
    "<": 3,
    "<=": 3,
    ">": 3,
    ">=": 3,
    "+": 4,
    "-": 4,
    "*": 5,
    "/": 5,
    "neg": 6,
}
ATOM = 9


def size_of(shape: Shape) -> int:
    """Number of floats of a value; of a tuple of shapes, the sum over its items."""
    if isinstance(shape, tuple):
        return sum(size_of(item) for item in shape)
    return _STORED[shape][1] if shape in _STORED else 1


def items_of(path: str, shapes: tuple[Shape, ...]) -> Iterator[tuple[str, Shape]]:
    """Workspace path and shape of each item of a tuple that is stored from ``path`` on, one item
    after the other."""
    offset = 0
    for shape in shapes:
        yield (f"{path} + {offset} * LANES" if offset else path), shape
        offset += size_of(shape)


def store_line(path: str, code: str, shape: Shape) -> str:
    """Line, within a loop over lanes, that stores the value of ``code``, of some shape, at a
    workspace path."""
    if shape in _STORED:
        return f"put{_STORED[shape][0]}(w, {path} + l, {code})"
    return f"w[{path} + l] = {f'1.0 if {code} else 0.0' if shape == CONDITION else code}"


def read_of(path: str, shape: Shape) -> tuple[str, int]:
    """Code, within a loop over lanes, that reads a value of some shape from a workspace path, and
    its precedence (`PRECEDENCE`)."""
    if isinstance(shape, tuple):
        return f"({', '.join(read_of(at, item)[0] for at, item in items_of(path, shape))})", ATOM
    if shape in _STORED:
        return f"get{_STORED[shape][0]}(w, {path} + l)", ATOM
    return (
        (f"w[{path} + l] > 0.0", PRECEDENCE[">"])
        if shape == CONDITION
        else (f"w[{path} + l]", ATOM)
    )


def _shared(index: int, shape: Shape) -> tuple[str, int]:
    """Code that reads a number, or a vector, of those that all cases share, and its precedence."""
    return f"w[SHARED + {index}]" if shape == NUMBER else f"vec3.get(w, SHARED + {index})", ATOM


READS: dict[str, Callable[[Any, Shape], tuple[str, int]]] = {
    "load": read_of,
    "parameter": lambda index, _: (f"w[P + {index} * LANES + l]", ATOM),
    "shared": _shared,
    "named": lambda name, _: (name, ATOM),
}


def number_code(a: Any) -> str:
    """Code of a number that is known while the kernel is written."""
    if isinstance(a, float) and not math.isfinite(a):
        return "math.nan" if math.isnan(a) else "math.inf" if a > 0.0 else "-math.inf"
    return repr(a)
