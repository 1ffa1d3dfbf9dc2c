"""Sizing: the design with the smallest cost that still passes all requirements, shown on cases
that did not choose it.

The search runs designs on common random numbers and accepts one if each requirement holds in so
many of its cases that a fresh run is likely to show it. The verdict is that of a run with another
seed; the cases of the search are never used for it. If it is not shown, the search is repeated with
a larger margin, and the verdict with the next seed. The confidence of each of these runs is raised,
so that the risk of a wrong verdict over all of them is that of the requirement (Bonferroni).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import raised, required_cases
from sepmc.campaign.design_search import (
    MAX_TRIES,
    TOLERANCE,
    VERDICT_CASES,
    DesignSearch,
    Goal,
    accepted_violations,
    design_text,
)
from sepmc.campaign.judging import checked_requirements, fresh_verdict, with_requirements
from sepmc.scene.design_tables import Variable, check_variables, cost_tree, parse_variable
from sepmc.scene.messages import InputError, Log

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

_STEP = 0.7  # fraction of the accepted violations, from one try to the next


@dataclass(frozen=True)
class Sizing:
    """Result of a sizing.

    Attributes
    ----------
    values : dict of str to float
        Chosen design, by TOML path.
    costs : tuple of float
    shown : bool
        True if the run for the verdict shows every requirement.
    verdicts : DataFrame
        Verdicts of that run, at the raised confidence (`Result.requirements`).
    seed, cases : int
        Of that run.
    searched : DataFrame
        Designs of the last search: values, ``cost`` (``cost_1``, ... of several), and the smallest
        ``margin`` over all requirements, scaled; not negative where the design was accepted.
    tries : int
        Searches, each with a run for the verdict.
    at_ends : tuple of str
        TOML paths whose chosen value is an end of its range.
    """

    values: dict[str, float]
    costs: tuple[float, ...]
    shown: bool
    verdicts: pd.DataFrame
    seed: int
    cases: int
    searched: pd.DataFrame
    tries: int
    at_ends: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """The first cost."""
        return self.costs[0]


def size(
    campaign: "Campaign",
    variables: Sequence[Variable],
    minimise: str,
    cases: int = 2000,
    seed: int | None = None,
    threads: int | None = None,
    announce: Log | None = None,
    subject_to: Sequence[str] = (),
) -> Sizing:
    """Find the design with the smallest cost that passes all requirements with confidence.

    Parameters
    ----------
    campaign : Campaign
    variables : sequence of Variable
        At most 6.
    minimise : str
        Cost: a formula of the names of the variables, each in the unit of its key.
    cases : int
        Cases of each design in the search; the run for the verdict has `VERDICT_CASES` times as
        many.
    seed : int, optional
        Of the search; verdicts use the following seeds. Default: that of the file.
    threads : int, optional
    announce : callable (text), optional
        Called with messages.
    subject_to : sequence of str
        Names of the requirements to pass; all if empty.

    Returns
    -------
    Sizing

    Raises
    ------
    InputError
        If the campaign has no requirement, the cases are too few to show one, the cost is no
        formula of the variables, or no design of the ranges is accepted.

    Notes
    -----
    One variable: a grid of 13 points, 9 more designs between the neighbours of peaks of the margin
    at which nothing is accepted (three times), then the cheapest accepted design between the
    neighbours of the best one, to 1e-4 of the range.
    Several: a Sobol sequence of 8 designs or more for each, then COBYLA of scipy from the cheapest
    accepted one, at most 40 designs for each. The optimum is that of the search, not proven to be
    global.
    """
    campaign, search = start_search(
        campaign, variables, [minimise], cases, seed, MAX_TRIES, threads, announce, subject_to
    )
    return shown_design(campaign, search, Goal.weighted([1.0]), MAX_TRIES, threads, announce)


def start_search(
    campaign: "Campaign",
    variables: Sequence[Variable],
    minimise: Sequence[str],
    cases: int,
    seed: int | None,
    tries: int,
    threads: int | None,
    announce: Log | None,
    subject_to: Sequence[str],
) -> tuple["Campaign", DesignSearch]:
    """Campaign with the requirements that count, and a search of it whose designs are likely to be
    shown with a confidence raised for ``tries`` runs. Raises InputError."""
    check_variables(variables)
    trees = [cost_tree(one, variables) for one in minimise]
    campaign = with_requirements(campaign, subject_to)
    items = checked_requirements(campaign, cases)
    for item in items:
        confidence = raised(item.confidence, tries)
        needed = math.ceil(required_cases(0, item.probability, confidence) / VERDICT_CASES)
        if cases < needed:
            raise InputError(
                f"cases = {cases}: requirement {item.name} cannot be shown with fewer than "
                f"{needed}, in a run of {VERDICT_CASES} times as many at a raised confidence"
            )
    seed = campaign.checked_seed(seed)
    vary = {one.key: (one.low, one.high) for one in variables}
    session = campaign.session(vary, threads, announce)
    return campaign, DesignSearch(session, variables, trees, items, cases, seed, tries)


def shown_design(
    campaign: "Campaign",
    search: DesignSearch,
    goal: Goal,
    tries: int,
    threads: int | None,
    announce: Log | None,
) -> Sizing:
    """Search for a design until a run with a fresh seed shows it, `MAX_TRIES` times at most. The
    confidence of the run is raised for ``tries`` runs."""
    count, fraction = VERDICT_CASES * search.cases, 1.0
    for number in range(1, MAX_TRIES + 1):
        best, searched = search.optimum(goal, fraction)
        if announce:
            announce(
                f"search {number}: {design_text(best)}; a run with a fresh seed for the verdict ..."
            )
        seed = search.seed + number
        shown, verdicts = fresh_verdict(campaign, dict(best), count, seed, tries, threads, announce)
        if shown or number == MAX_TRIES:
            break
        fraction *= _STEP
    costs = search.costs(np.array([list(best.values())]))[0]
    at_ends = tuple(
        v.key
        for v in search.variables
        if min(best[v.key] - v.low, v.high - best[v.key]) <= TOLERANCE * (v.high - v.low)
    )
    return Sizing(
        best, tuple(map(float, costs)), shown, verdicts, seed, count, searched, number, at_ends
    )


__all__ = [
    "MAX_TRIES",
    "VERDICT_CASES",
    "Sizing",
    "Variable",
    "accepted_violations",
    "parse_variable",
    "size",
]
