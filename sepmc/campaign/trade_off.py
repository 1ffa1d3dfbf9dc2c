"""Trade-off of several costs: a few designs of which none is better than another one in every cost
(the Pareto front), each verified with cases that were not used to choose it.

First each cost is minimised by itself, with a small weight on the others. These designs are the
ends of the front. Between them the search minimises the largest distance from the smallest costs,
in fractions of their ranges, in several directions (goal attainment: Gembicki and Haimes, IEEE
Transactions on Automatic Control 20 (1975) 769), which reaches concave fronts too. All searches
share their designs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from sepmc.campaign.design_search import MAX_TRIES, Goal, design_text
from sepmc.campaign.sizing import Sizing, shown_design, start_search
from sepmc.scene.design_tables import MAX_COSTS, Variable
from sepmc.scene.messages import InputError, Log, no_log

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

_OTHERS = 0.02  # of the ranges of the other costs, beside one that is minimised
# directions between the designs with the smallest costs, by number of costs
_DIRECTIONS = {
    2: ((0.75, 0.25), (0.5, 0.5), (0.25, 0.75)),
    3: ((1 / 3, 1 / 3, 1 / 3), (0.45, 0.45, 0.1), (0.45, 0.1, 0.45), (0.1, 0.45, 0.45)),
}


@dataclass(frozen=True)
class TradeOff:
    """Result of a trade-off.

    Attributes
    ----------
    table : DataFrame
        A row for each design of the front, the first cost rising: values by TOML path, ``cost_1``,
        ``cost_2``, ..., ``shown`` (True if its verdict run, with a seed that no search used, passes
        every requirement), ``seed`` of that run, and of each requirement its verdict (``NAME``) and
        ``NAME_violations``.
    minimise : tuple of str
        Formulas of the costs.
    searched : DataFrame
        All designs of the searches: values, costs, and ``margin``, as in `Sizing.searched`.
    cases : int
        Number of cases of each verdict run.
    tries : int
        Largest number of verdict runs that were possible. Confidences are raised so that the
        verdicts of so many runs hold together (`sepmc.analysis.proportions.raised`).
    """

    table: pd.DataFrame
    minimise: tuple[str, ...]
    searched: pd.DataFrame
    cases: int
    tries: int

    @property
    def shown(self) -> bool:
        """True if the verdict run of every design of the front passes."""
        return bool(self.table["shown"].all())


def trade_off(
    campaign: "Campaign",
    variables: Sequence[Variable],
    minimise: Sequence[str],
    cases: int = 2000,
    seed: int | None = None,
    threads: int | None = None,
    announce: Log | None = None,
    subject_to: Sequence[str] = (),
) -> TradeOff:
    """Find designs that pass all requirements with confidence, and trade one cost for another.

    A design is left out if one that passes has no larger cost and at least one smaller cost. A
    design that does not pass its verdict run can stay, with ``shown`` False.

    Parameters
    ----------
    campaign, variables, cases, seed, threads, announce, subject_to
        As for `sepmc.campaign.sizing.size`.
    minimise : sequence of str
        Two or three costs: formulas of the names of the variables.

    Returns
    -------
    TradeOff

    Raises
    ------
    InputError
        As for `sepmc.campaign.sizing.size`, and if there are not two or three costs.
    """
    count = len(minimise)
    if count not in _DIRECTIONS:
        raise InputError(f"minimise: has {count} costs: must be 2 to {MAX_COSTS}")
    tries = MAX_TRIES * (count + len(_DIRECTIONS[count]))
    campaign, search = start_search(
        campaign, variables, minimise, cases, seed, tries, threads, announce, subject_to
    )

    def shown(goal: Goal) -> Sizing:
        point = shown_design(campaign, search, goal, tries, threads, no_log)
        if announce:
            announce(
                f"{design_text(point.values)}: requirements {'' if point.shown else 'not '}shown"
            )
        return point

    spread = search.spread_of_costs(1.0)
    shares = np.where(np.eye(count) > 0.0, 1.0, _OTHERS) / spread
    points = [shown(Goal.weighted(row)) for row in shares]
    ends = np.array([point.costs for point in points])
    low, span = ends.min(axis=0), np.ptp(ends, axis=0)
    if (span > 0.0).all():  # else one design has the smallest of two costs
        others = 0.05 * _OTHERS / span
        points += [
            shown(Goal(others, 1.0 / (span * np.array(direction)), low))
            for direction in _DIRECTIONS[count]
        ]
    table = pd.DataFrame([_row(point, search.names) for point in points])
    costs = table[search.names].to_numpy(float)
    table = table[~dominated(costs, table["shown"].to_numpy(bool))].drop_duplicates(search.names)
    return TradeOff(
        table.sort_values(search.names).reset_index(drop=True),
        tuple(minimise),
        search.searched,
        points[0].cases,
        tries,
    )


def dominated(costs: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Return the mask (m,) of dominated designs among m designs with costs (m, n): those for which
    a design of the mask ``shown`` (m,) has no larger cost and at least one smaller cost."""
    no_larger = (costs[:, None] <= costs[None]).all(axis=2)
    smaller = (costs[:, None] < costs[None]).any(axis=2)
    return np.asarray((no_larger & smaller & shown[:, None]).any(axis=0))


def _row(point: Sizing, names: Sequence[str]) -> dict[str, Any]:
    """Return the row of `TradeOff.table` for a design; ``names`` are the columns of its costs."""
    row: dict[str, Any] = {**point.values, **dict(zip(names, point.costs, strict=True))}
    row |= {"shown": point.shown, "seed": point.seed}
    for name, verdict in point.verdicts.to_dict("index").items():
        row |= {str(name): verdict["verdict"], f"{name}_violations": verdict["violations"]}
    return row


__all__ = ["TradeOff", "trade_off"]
