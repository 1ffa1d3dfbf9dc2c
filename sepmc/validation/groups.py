"""Checks of `sepmc verify`, or stresses of `sepmc stress`, run in parallel processes."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from typing import Any

from sepmc.processes import processes

Run = Callable[[list[str]], list[Any]]


def side_by_side(
    run: Run,
    names: Iterable[str],
    in_process: Iterable[str] = (),
    on_done: Callable[[str], None] | None = None,
) -> dict[str, list[Any]]:
    """Run the groups of a suite (the checks of `sepmc verify` or the stresses of `sepmc stress`) in
    parallel, with at most one process for each core.

    Parameters
    ----------
    run : callable (list of str)
        Returns the lines of the named groups: `sepmc.validation.verify.verify` or
        `sepmc.validation.stress.stress`.
    names : iterable of str
        Groups to run. A single one is run by this process.
    in_process : iterable of str
        Groups of ``names`` that this process runs, because what they cache is needed afterwards.
    on_done : callable (str), optional
        Called with the name of each finished group.

    Returns
    -------
    dict
        List of lines by name of the group, in the order of ``names``.
    """
    names, in_process = list(names), set(in_process)
    in_workers = [name for name in names if name not in in_process]
    lines_of: dict[str, list[Any]] = {}

    def store(name: str, lines: list[Any]) -> None:
        """Store the lines of a finished group, and pass its name to ``on_done``."""
        lines_of[name] = lines
        if on_done:
            on_done(name)

    if len(names) == 1:
        in_workers, in_process = [], set(names)
    cores = max(1, (os.cpu_count() or 1) - len(in_process))
    with processes(min(cores, len(in_workers))) as pool:
        # the longest groups are last in the lists
        futures = {pool.submit(run, [name]): name for name in reversed(in_workers)}
        for name in in_process:
            store(name, run([name]))
        for future in as_completed(futures):
            store(futures[future], future.result())
    return {name: lines_of[name] for name in names}
