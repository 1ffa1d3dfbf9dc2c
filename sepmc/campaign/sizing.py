"""Sizing: the design with the smallest cost that still passes all requirements, verified with
cases that were not used to choose it.

The search runs designs on common random numbers. It accepts a design if each requirement is
satisfied in so many of its cases that a run with another seed is likely to show it. The verdict is
that of such a run, the verdict run; the cases of the search are never used for it. A design is
shown if its verdict run passes every requirement. If it is not shown, the search is repeated with a
larger margin, and the verdict run with the next seed. The confidence of every verdict run is
raised, so that the risk of a wrong verdict over all of them is that of the requirement
(Bonferroni).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
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
from sepmc.campaign.judging import (
    FreshVerdict,
    checked_requirements,
    fresh_verdict,
    with_requirements,
)
from sepmc.campaign.store import folders
from sepmc.scene.design_tables import Variable, check_variables, cost_tree, parse_variable
from sepmc.scene.messages import InputError, Log

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

_STEP = 0.7  # fraction of the accepted violations, from one try to the next


@dataclass(frozen=True)
class Sizing:
    """Result of a sizing: the chosen design, and the verdict run of it.

    Attributes
    ----------
    values : dict of str to float
        Chosen design: values of its variables, by TOML path.
    costs : tuple of float
        Cost of the design; several for a design of a trade-off.
    verdict : FreshVerdict
        Verdicts of the verdict run.
    search_cases, search_seed : int
        Number of cases of each design of the search, and their seed.
    searched : DataFrame
        Designs of the last search, a row each: values, ``cost`` (``cost_1``, ... of several), and
        the smallest ``margin`` over all requirements, without unit as it is divided by the standard
        deviation of the margin over cases; not negative where the design was accepted.
    tries : int
        Number of searches, each with a verdict run.
    at_ends : tuple of str
        TOML paths whose chosen value is an end of its range.
    """

    values: dict[str, float]
    costs: tuple[float, ...]
    verdict: FreshVerdict
    search_cases: int
    search_seed: int
    searched: pd.DataFrame
    tries: int
    at_ends: tuple[str, ...] = ()

    @property
    def shown(self) -> bool:
        """True if the verdict run passes every requirement."""
        return self.verdict.shown

    @property
    def verdicts(self) -> pd.DataFrame:
        """Verdicts of the verdict run, at the raised confidence (`Result.requirements`)."""
        return self.verdict.table

    @property
    def seed(self) -> int:
        """Seed of the verdict run."""
        return self.verdict.seed

    @property
    def cases(self) -> int:
        """Number of cases of the verdict run."""
        return self.verdict.cases

    @property
    def cost(self) -> float:
        """The first of `costs`: the only one, unless the design is of a trade-off."""
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
    out: Path | None = None,
    overwrite: bool = False,
) -> Sizing:
    """Find the design with the smallest cost that passes all requirements with confidence.

    Parameters
    ----------
    campaign : Campaign
    variables : sequence of Variable
        Design variables, at most 6.
    minimise : str
        Cost: a formula of the names of the variables, each in the unit of its key.
    cases : int
        Cases of each design in the search; a verdict run has `VERDICT_CASES` times as many.
    seed : int, optional
        Of the search; verdict runs use the following seeds. Default: that of the file.
    threads : int, optional
        Number of threads; all cores if None.
    announce : callable (text), optional
        Called with messages on the progress.
    subject_to : sequence of str
        Names of the requirements to pass; all if empty.
    out : Path, optional
        Run folder for the verdict run; in memory if None.
    overwrite : bool
        Replace the run in an existing folder ``out``.

    Returns
    -------
    Sizing
        Of the first design whose verdict run passes, else of the last one that was tried.

    Raises
    ------
    InputError
        If the campaign has no requirement, its cases are not random, are those of a sample table or
        are too few to show a requirement, the cost is no formula of the variables, or no design of
        the ranges is accepted.
    StoreError
        If ``out`` cannot be used as requested.

    Notes
    -----
    A design is accepted if its margin is not negative (`sepmc.campaign.design_search`).
    One variable: a grid of 13 designs; 9 more between the neighbours of each of up to three peaks
    of the margin where it is negative, repeated up to three times; then the cheapest accepted
    design between the neighbours of the best one, to 1e-4 of the range.
    Several variables: a Sobol sequence of at least 8 designs per variable, then COBYLA of scipy
    from the cheapest accepted one, with at most 40 designs per variable. The optimum is that of the
    search; it is not proven to be global.
    """
    if out is not None:
        folders.check_folder(out, overwrite)
    campaign, search = start_search(
        campaign, variables, [minimise], cases, seed, MAX_TRIES, threads, announce, subject_to
    )
    return shown_design(campaign, search, Goal.weighted([1.0]), MAX_TRIES, threads, announce, out)


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
    """Check a request for a sizing, and prepare its search.

    Parameters are those of `size`, but ``minimise`` has a formula for each cost, and ``tries`` is
    the largest number of verdict runs, by which confidences are raised. ``cases`` and ``seed``
    (None: that of the file) are those of each design of the search, ``threads`` None is all cores.
    Returns the campaign with only the requirements of ``subject_to`` (all if it is empty), and the
    search, before it has run a design. Raises InputError if the request is not valid, or ``cases``
    are too few to show a requirement.
    """
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
                f"{needed}: the run for the verdict has {VERDICT_CASES} times as many, and its "
                "confidence is raised for several such runs"
            )
    seed = campaign.checked_seed(seed)
    vary = {one.key: (one.low, one.high) for one in variables}
    session = campaign.session(vary, threads, announce)
    return campaign, DesignSearch(session, variables, trees, items, cases, seed, tries, announce)


def shown_design(
    campaign: "Campaign",
    search: DesignSearch,
    goal: Goal,
    tries: int,
    threads: int | None,
    announce: Log | None,
    out: Path | None = None,
) -> Sizing:
    """Search for the design with the smallest value of ``goal``, and run it with a new seed for the
    verdict. Repeat with a larger margin until a design passes every requirement, at most
    `MAX_TRIES` times.

    Returns the last design, whether it passes or not. ``campaign`` and ``search`` are from
    `start_search`; ``tries`` is the number of verdict runs by which confidences are raised;
    ``threads`` (None: all cores) and ``announce`` are for the verdict runs, and ``out`` is the run
    folder that each of them overwrites, or None. Raises InputError if one of the searches accepts
    no design.
    """
    count, fraction = VERDICT_CASES * search.cases, 1.0
    for number in range(1, MAX_TRIES + 1):
        best, searched = search.optimum(goal, fraction)
        if announce:
            announce(
                f"search {number}: {design_text(best)}; running it with a new seed for the verdict "
                "..."
            )
        verdict = fresh_verdict(
            campaign, dict(best), count, search.seed + number, tries, threads, announce, out
        )
        if verdict.shown or number == MAX_TRIES:
            break
        fraction *= _STEP
    costs = search.costs(np.array([list(best.values())]))[0]
    at_ends = tuple(
        v.key
        for v in search.variables
        if min(best[v.key] - v.low, v.high - best[v.key]) <= TOLERANCE * (v.high - v.low)
    )
    return Sizing(
        best,
        tuple(map(float, costs)),
        verdict,
        search.cases,
        search.seed,
        searched,
        number,
        at_ends,
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
