"""State of accumulators as float arrays, so that another process can load it from a file."""

from collections.abc import Iterator
from typing import Any

import numpy as np

Arrays = Iterator[np.ndarray]
_EXACT = 2.0**53  # a float holds integers exactly up to this


def scalars(counter: Any) -> np.ndarray:
    """Return the numeric attributes of an accumulator in their order; integers are exact up to
    9e15."""
    return np.array(list(_scalars(counter).values()), dtype=np.float64)


def set_scalars(counter: Any, numbers: np.ndarray) -> None:
    """Set the numeric attributes of an accumulator to ``numbers`` that `scalars` returned.

    Raises
    ------
    ValueError, OverflowError
        If the numbers do not fit the attributes.
    """
    current = _scalars(counter)
    for (name, value), number in zip(current.items(), numbers.tolist(), strict=True):
        if isinstance(value, int | np.integer) and not abs(number) <= _EXACT:
            raise ValueError(f"{name.strip('_')} = {number:g}: is not a count")
        setattr(counter, name, type(value)(number))


def _scalars(counter: Any) -> dict[str, Any]:
    """Return the numeric attributes of an accumulator by name."""
    return {
        name: value
        for name, value in vars(counter).items()
        if isinstance(value, int | float | np.number)
    }
