"""Conversion of accumulators, which collect statistics case by case, to float arrays and back, so
that another process can load them from a file."""

from collections.abc import Iterator
from typing import Any

import numpy as np

Arrays = Iterator[np.ndarray]
_EXACT = 2.0**53  # a float holds integers exactly up to this


def scalars(counter: Any) -> np.ndarray:
    """Return the attributes of an accumulator that are single numbers as one array (k,), in the
    order in which they were first set; integers are exact up to 9e15. True and False are numbers,
    1 and 0; None, arrays and all other attributes are left out."""
    return np.array(list(_scalars(counter).values()), dtype=np.float64)


def set_scalars(counter: Any, numbers: np.ndarray) -> None:
    """Set the attributes of an accumulator that are single numbers to ``numbers`` (k,), which
    `scalars` returned; each keeps its type.

    Raises
    ------
    ValueError
        If there are more or fewer numbers than attributes, or an integer attribute would become
        NaN, or larger than 9e15 in magnitude.
    """
    current = _scalars(counter)
    for (name, value), number in zip(current.items(), numbers.tolist(), strict=True):
        if isinstance(value, int | np.integer) and not abs(number) <= _EXACT:
            raise ValueError(f"{name.strip('_')} = {number:g}: must be a count of at most 9e15")
        setattr(counter, name, type(value)(number))


def _scalars(counter: Any) -> dict[str, Any]:
    """Return the attributes of an accumulator that are numbers (also True and False), by name, in
    the order in which they were first set."""
    return {
        name: value
        for name, value in vars(counter).items()
        if isinstance(value, int | float | np.number)
    }
