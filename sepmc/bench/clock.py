"""Taking times."""

import time
from collections.abc import Callable, Mapping
from statistics import median


def seconds(work: Callable[[], object]) -> float:
    """Wall time of some work."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def rounds(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Wall times, s, of several works by name: each once untimed, then ``repeats`` rounds of all.

    In rounds, because what slows a machine for a second then slows all works alike, and ratios
    between them stay fair.
    """
    found: dict[str, list[float]] = {name: [] for name in works}
    for work in works.values():
        work()
    for _ in range(repeats):
        for name, work in works.items():
            found[name].append(seconds(work))
    return found


def medians(works: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median wall time of each work, s; see `rounds`."""
    return {name: median(times) for name, times in rounds(works, repeats).items()}
