"""What counters hold, as arrays of numbers: for a file from which another process goes on."""

from collections.abc import Iterator
from typing import Any

import numpy as np

Arrays = Iterator[np.ndarray]
_EXACT = 2.0**53  # up to which a number tells a whole one


def scalars(counter: Any) -> np.ndarray:
    """The numbers of a counter, in the order in which it has them; whole ones are exact up to
    9e15."""
    return np.array(list(_scalars(counter).values()), dtype=np.float64)


def set_scalars(counter: Any, numbers: np.ndarray) -> None:
    """Give a counter the numbers that `scalars` told of one. Raises ValueError or OverflowError if
    they are not."""
    own = _scalars(counter)
    for (name, now), number in zip(own.items(), numbers.tolist(), strict=True):
        if isinstance(now, int | np.integer) and not abs(number) <= _EXACT:
            raise ValueError(f"{name.strip('_')} = {number:g}: is no count")
        setattr(counter, name, type(now)(number))


def _scalars(counter: Any) -> dict[str, Any]:
    return {
        name: value
        for name, value in vars(counter).items()
        if isinstance(value, int | float | np.number)
    }
