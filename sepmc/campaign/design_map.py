"""Map of designs: the verdict on each requirement at every point of a grid of one or two design
variables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import binomial_interval
from sepmc.scene.design_tables import MapAxis, parse_axis
from sepmc.scene.messages import InputError, Log


@dataclass
class DesignMap:
    """Verdicts on a grid of designs.

    Attributes
    ----------
    axes : tuple of MapAxis
        One or two.
    table : DataFrame
        A row per design, the first axis varying fastest: `DesignTable.summary`, and of each
        requirement the 95 % interval of the probability of a violation, ``NAME_low`` and
        ``NAME_high`` (Clopper and Pearson; missing outcomes count as both).
    cases, seed : int
        Of every design.
    timing : dict of str to float
        Seconds of `DesignTable.timing`, and of text, compile and steps.
    """

    axes: tuple[MapAxis, ...]
    table: pd.DataFrame
    cases: int
    seed: int
    timing: dict[str, float]

    def grid(self, column: str) -> np.ndarray:
        """Column of the table on the grid, shape (count of y, count of x); (1, count of x) with
        one axis."""
        return self.table[column].to_numpy().reshape(-1, self.axes[0].count)


def map_designs(
    campaign: Any,
    axes: Sequence[MapAxis],
    cases: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    announce: Log | None = None,
) -> DesignMap:
    """Judge the requirements of a campaign at every point of a grid.

    Parameters
    ----------
    campaign : Campaign
    axes : sequence of MapAxis
        One or two.
    cases, seed : int, optional
        Of every design, on common random numbers; of the file if None.
    threads, announce
        As for `Campaign.session`.
    progress : callable (done, total), optional
        Called with numbers of designs.

    Returns
    -------
    DesignMap

    Raises
    ------
    InputError
        If the file has no requirement, its cases are not random, or there can be no session.
    """
    if not campaign.file.requirements:
        raise InputError(f"{campaign.name}: a map shows requirements; give [[requirement]]")
    if (sampler := campaign.scene.run.sampler) != "random":
        raise InputError(
            f"run.sampler = {sampler!r}: a map judges by random cases; set run.sampler = 'random'"
        )
    if len({axis.key for axis in axes}) < len(axes):
        raise InputError(f"{axes[0].key}: both axes vary it; give the second one another variable")
    session = campaign.session({a.key: (a.low, a.high) for a in axes}, threads, announce)
    columns = np.meshgrid(*(axis.values for axis in axes))
    designs = np.column_stack([column.ravel() for column in columns])
    result = session.run_many(designs, cases, seed, progress=progress)
    cases = campaign.scene.run.cases if cases is None else cases
    table = result.summary
    for item in campaign.file.requirements:
        counts = zip(table[f"{item.name}_violations"], table[f"{item.name}_missing"], strict=True)
        intervals = [
            (binomial_interval(k - missing, cases)[0], binomial_interval(k, cases)[1])
            for k, missing in counts
        ]
        table[[f"{item.name}_low", f"{item.name}_high"]] = intervals
    return DesignMap(tuple(axes), table, cases, campaign.checked_seed(seed), result.timing)


__all__ = ["DesignMap", "MapAxis", "map_designs", "parse_axis"]
