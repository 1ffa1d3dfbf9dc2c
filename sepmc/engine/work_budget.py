"""How much flights in plain Python work, counted in lines of their kernels: the same on every
machine, so what is decided by it is the same there, too."""

import contextlib
import math
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from types import FunctionType
from typing import Any

# of processor time for a line of a kernel, in plain Python and compiled, one lane of eight in use:
# 0.25 to 0.45 us in `table2`, `hyper-x`, `srb` and the starter campaign; 3 to 6 ns (one core of an
# AMD EPYC)
LINE_S, COMPILED_LINE_S = 0.35e-6, 6e-9
# modules that loop as long as it takes: their functions count, too
SEARCHES = tuple(
    f"sepmc.{name}"
    for name in ("routines.clearances", "physics.outlines", "physics.rims", "physics.shell_edge")
)


class OutOfWorkError(Exception):
    """A flight in plain Python was stopped: it worked more than it may."""


@dataclass
class Work:
    """Work that is done, in lines of kernels; no more than ``most`` in plain Python. ``numbers`` is
    the workspace of the flight that goes on; ``compiled`` is what compiled flights are taken to
    work."""

    most: float = math.inf
    done: float = 0.0
    compiled: float = 0.0
    numbers: Any = field(default=None, repr=False)

    @contextlib.contextmanager
    def counted(self) -> Iterator[None]:
        """Count what flies in plain Python meanwhile. Raises OutOfWorkError once it is too much."""
        before = _counting.set(self)
        try:
            yield
        finally:
            _counting.reset(before)

    @property
    def left(self) -> float:
        """Lines that may still be flown."""
        return self.most - self.done


_counting: ContextVar[Work | None] = ContextVar("counting", default=None)


def counts(function: FunctionType, has_workspace: bool = False) -> Callable[..., Any]:
    """The function, which counts its lines at each call; the first of what it is given may be the
    workspace of a flight."""
    own = len({line for _, _, line in function.__code__.co_lines()})

    @wraps(function)
    def counting(*given: Any) -> Any:
        work = _counting.get()
        if work is not None:
            work.done += own
            if has_workspace:
                work.numbers = given[0]
            if work.done > work.most:
                raise OutOfWorkError
        return function(*given)

    return counting
