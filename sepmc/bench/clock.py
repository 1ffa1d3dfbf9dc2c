"""Wall-clock timing."""

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median, quantiles


def seconds(task: Callable[[], object]) -> float:
    """Return the wall time of a task, s."""
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def rounds(tasks: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Time several tasks in rounds.

    Parameters
    ----------
    tasks : mapping of name to callable
    repeats : int
        Rounds after a warm-up; fewer, but at least one, for a task that takes more than `_MAX_S`.

    Returns
    -------
    dict of name to list of float
        Wall times, s. In rounds, a disturbance of the machine affects all tasks alike, so that
        ratios stay valid.
    """
    times: dict[str, list[float]] = {name: [] for name in tasks}
    first = {name: seconds(task) for name, task in tasks.items()}
    for k in range(repeats):
        for name, task in tasks.items():
            if k == 0 or (k + 1) * first[name] <= _MAX_S:
                times[name].append(seconds(task))
    return times


_MAX_S = 15.0


def spread(times: Sequence[float]) -> float:
    """Return the interquartile range of times over their median; NaN for a single one."""
    if len(times) < 2:
        return float("nan")
    low, _, high = quantiles(times, n=4, method="inclusive")
    return (high - low) / median(times)
