"""Wall-clock timing."""

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median, quantiles


def seconds(task: Callable[[], object]) -> float:
    """Call ``task`` and return the wall time that it took, s."""
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def rounds(tasks: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Time several tasks in rounds, each of which calls every task once.

    A disturbance of the machine then affects all tasks alike, so that ratios of their times stay
    valid.

    Parameters
    ----------
    tasks : mapping of name to callable
    repeats : int
        Rounds after a first one that is not counted. A slow task is called in fewer of them, at
        least one, so that its calls take `_MAX_S` seconds or little more.

    Returns
    -------
    dict of name to list of float
        Wall times, s, of the counted calls.
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
    """Return the interquartile range of times over their median; NaN for a single time."""
    if len(times) < 2:
        return float("nan")
    low, _, high = quantiles(times, n=4, method="inclusive")
    return (high - low) / median(times)
