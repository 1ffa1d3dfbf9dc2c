"""Groups of lines of a suite, flown side by side: one process for each core."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from typing import Any

from sepmc.processes import processes

Fly = Callable[[list[str]], list[Any]]


def side_by_side(
    fly: Fly,
    names: Iterable[str],
    here: Iterable[str] = (),
    told: Callable[[str], None] | None = None,
) -> dict[str, list[Any]]:
    """Fly the groups of a suite.

    Parameters
    ----------
    fly : the suite's own function (`sepmc.validation.verify.verify`), which flies the groups it is
    given
    names : groups
    here : those of them that this process flies, because what they leave behind is wanted
        afterwards
    told : called with the name of each group that has been flown

    Returns
    -------
    groups : their lines, in the order of ``names``
    """
    names, here = list(names), set(here)
    apart = [name for name in names if name not in here]
    found: dict[str, list[Any]] = {}

    def keep(name: str, lines: list[Any]) -> None:
        found[name] = lines
        if told:
            told(name)

    if len(names) == 1:
        apart, here = [], set(names)
    cores = max(1, (os.cpu_count() or 1) - len(here))
    with processes(min(cores, len(apart))) as pool:
        # the longest stand last in the lists
        flights = {pool.submit(fly, [name]): name for name in reversed(apart)}
        for name in here:
            keep(name, fly([name]))
        for flight in as_completed(flights):
            keep(flights[flight], flight.result())
    return {name: found[name] for name in names}
