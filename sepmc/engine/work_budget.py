"""Work of kernels that run as plain Python, counted in lines of code: of each call of a function
all its lines. This count is the same on every machine, and so are decisions based on it."""

import contextlib
import math
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from types import FunctionType
from typing import Any

# Processor time of a kernel line, s, in plain Python and compiled with one lane of eight in use:
# 0.25 to 0.45 us in `table2`, `hyper-x`, `srb` and the starter campaign; 3 to 6 ns (one core of an
# AMD EPYC).
LINE_S, COMPILED_LINE_S = 0.35e-6, 6e-9
# modules with iterative searches: their functions are counted, too
SEARCHES = tuple(
    f"sepmc.{name}"
    for name in (
        "routines.clearances",
        "routines.screening",
        "physics.outlines",
        "physics.rims",
        "physics.sectors",
        "physics.shell_edge",
    )
)


class WorkLimitError(Exception):
    """A kernel that runs as plain Python has called functions of more lines than `Work.limit`."""


@dataclass
class Work:
    """Counter of the lines of the functions that kernels call, with a limit for plain Python.

    Attributes
    ----------
    limit : float
        Number of lines in plain Python beyond which WorkLimitError is raised.
    done : float
        Number of lines counted in plain Python: of each call, all lines of its function.
    compiled : float
        Estimated number of lines executed in compiled kernels.
    numbers : list
        Workspace of the kernel that is running, or that ran last, in plain Python; None at first.
    """

    limit: float = math.inf
    done: float = 0.0
    compiled: float = 0.0
    numbers: Any = field(default=None, repr=False)

    @contextlib.contextmanager
    def counted(self) -> Iterator[None]:
        """Context in which every call of a kernel function in plain Python adds the number of lines
        of code of that function to ``done``, whichever of them it executes, and raises
        WorkLimitError once ``done`` is beyond the limit."""
        before = _counting.set(self)
        try:
            yield
        finally:
            _counting.reset(before)

    @property
    def left(self) -> float:
        """Number of lines left up to the limit; negative beyond it."""
        return self.limit - self.done


_counting: ContextVar[Work | None] = ContextVar("counting", default=None)


def counting_lines(function: FunctionType, has_workspace: bool = False) -> Callable[..., Any]:
    """Wrap a function so that each call adds its number of lines of code to the `Work` in whose
    context (`Work.counted`) it runs, and raises WorkLimitError beyond the limit.

    A call counts all lines once, whichever of them it executes. Outside of such a context nothing
    is counted.

    Parameters
    ----------
    function : function
        Function that is called with positional arguments only.
    has_workspace : bool
        True if the first argument is the workspace of a kernel, which then becomes `Work.numbers`.

    Returns
    -------
    callable
    """
    lines = len({line for _, _, line in function.__code__.co_lines()})

    @wraps(function)
    def counting(*arguments: Any) -> Any:
        work = _counting.get()
        if work is not None:
            work.done += lines
            if has_workspace:
                work.numbers = arguments[0]
            if work.done > work.limit:
                raise WorkLimitError
        return function(*arguments)

    return counting
