"""Taking times."""

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median, quantiles


def seconds(work: Callable[[], object]) -> float:
    """Wall time of some work."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def rounds(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Wall times, s, of several works by name: each once that does not count, then ``repeats``
    rounds of all; fewer of what takes more than `_MOST_S` together, but one at least.

    In rounds, because what slows a machine for a second then slows all works alike, and ratios
    between them stay fair.
    """
    found: dict[str, list[float]] = {name: [] for name in works}
    first = {name: seconds(work) for name, work in works.items()}
    for k in range(repeats):
        for name, work in works.items():
            if k == 0 or (k + 1) * first[name] <= _MOST_S:
                found[name].append(seconds(work))
    return found


_MOST_S = 15.0


def spread(times: Sequence[float]) -> float:
    """How far the middle half of some times lies apart, over their median; NaN of a single one."""
    if len(times) < 2:
        return float("nan")
    low, _, high = quantiles(times, n=4, method="inclusive")
    return (high - low) / median(times)
