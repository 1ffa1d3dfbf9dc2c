"""Shapes of symbolic values, and the kernel code that reads them from the workspace and stores them
there.

A workspace path is the code of an index into the workspace ``w`` without the lane, such as
``S + X_body1``; code within a loop over lanes adds the lane number ``l``.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

# Shape of a value: one number, a condition, several numbers, a symmetric matrix (nine numbers
# stored as six), or a tuple of shapes.
Shape = int | str | tuple[Any, ...]
NUMBER, CONDITION, SYMMETRIC = 1, "condition", "symmetric"

# by shape: suffix of the functions get and put that read and store such a value, and its floats
_STORED: dict[Shape, tuple[str, int]] = {3: ("3", 3), 4: ("4", 4), SYMMETRIC: ("6", 6), 9: ("9", 9)}
# of operators, the higher the tighter they bind
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
ATOM = 9  # precedence of names, calls and indices, which need no parentheses


def size_of(shape: Shape) -> int:
    """Number of floats that a value of a shape takes in the workspace per lane; of a tuple of
    shapes, the sum over its items."""
    if isinstance(shape, tuple):
        return sum(size_of(item) for item in shape)
    return _STORED[shape][1] if shape in _STORED else 1


def items_of(path: str, shapes: tuple[Shape, ...]) -> Iterator[tuple[str, Shape]]:
    """Yield the workspace path (code of an index, without the lane) and the shape of each item of a
    tuple of values with these shapes, which is stored from ``path`` on, one item after the
    other."""
    offset = 0
    for shape in shapes:
        yield (f"{path} + {offset} * LANES" if offset else path), shape
        offset += size_of(shape)


def store_line(path: str, code: str, shape: Shape) -> str:
    """Line of kernel code, within a loop over lanes, that stores a value at a workspace path;
    ``code`` is the code of the value, of the given shape. A condition is stored as 1.0 or 0.0."""
    if shape in _STORED:
        return f"put{_STORED[shape][0]}(w, {path} + l, {code})"
    return f"w[{path} + l] = {f'1.0 if {code} else 0.0' if shape == CONDITION else code}"


def read_of(path: str, shape: Shape) -> tuple[str, int]:
    """Kernel code, within a loop over lanes, that reads a value of the given shape from a workspace
    path; and the precedence of that code (`PRECEDENCE` or ATOM)."""
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
    """Kernel code that reads a number, or a vector of three, from the numbers that all cases share,
    at ``index`` among them; and the precedence of that code."""
    return f"w[SHARED + {index}]" if shape == NUMBER else f"vec3.get(w, SHARED + {index})", ATOM


# by operator of a node that reads: function from its argument and shape to code and precedence
READS: dict[str, Callable[[Any, Shape], tuple[str, int]]] = {
    "load": read_of,
    "parameter": lambda index, _: (f"w[P + {index} * LANES + l]", ATOM),
    "shared": _shared,
    "named": lambda name, _: (name, ATOM),
}


def number_code(a: Any) -> str:
    """Python code of a number that is known while the kernel is written: ``math.nan``,
    ``math.inf``, ``-math.inf``, or its repr. It must be a number of Python: the repr of one of
    NumPy is no code of a kernel."""
    if isinstance(a, float) and not math.isfinite(a):
        return "math.nan" if math.isnan(a) else "math.inf" if a > 0.0 else "-math.inf"
    return repr(a)
