"""Sizing: the design with the smallest cost that still passes all requirements, shown on cases
that did not choose it.

The search runs designs on common random numbers and accepts one if each requirement holds in so
many of its cases that a fresh run is likely to show it. The verdict is that of a run with another
seed; the cases of the search are never used for it. If it is not shown, the search is repeated with
a larger margin, and the verdict with the next seed. The confidence of each of these runs is raised,
so that the risk of a wrong verdict over all of them is that of the requirement (Bonferroni).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import allowed_violations, binomial_cdf
from sepmc.analysis.requirements import margins
from sepmc.campaign.judging import checked_requirements, fresh_verdict, with_requirements
from sepmc.campaign.session import Session
from sepmc.scene.design_tables import (
    Variable,
    check_variables,
    cost_tree,
    parse_variable,
)
from sepmc.scene.formula import Node, evaluate
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import Status, is_yes_or_no

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

Run = Callable[[np.ndarray], pd.DataFrame]  # designs (m, variables) to cost and margin of each

MAX_TRIES = 3
VERDICT_CASES = 4  # times the cases of the search
_LIKELY = 0.95  # probability that the run for the verdict shows a design at the edge
_GRID, _ROOTS = 13, 24  # one variable: points of the grid, and steps to the border, at most
_FINE = 2001  # costs between two neighbours of a point of the grid
_STEPS = 40  # several variables: designs for each, at most, after the first ones
_TOLERANCE = 1e-4  # of the range of a variable
_STEP = 0.7  # fraction of the accepted violations, from one try to the next


@dataclass(frozen=True)
class Sizing:
    """Result of a sizing.

    Attributes
    ----------
    values : dict of str to float
        Chosen design, by TOML path.
    cost : float
    shown : bool
        True if the run for the verdict shows every requirement.
    verdicts : DataFrame
        Verdicts of that run, at the raised confidence (`Result.requirements`).
    seed, cases : int
        Of that run.
    searched : DataFrame
        Designs of the last search: values, ``cost``, and the smallest ``margin`` over all
        requirements, scaled; not negative where the design was accepted.
    tries : int
        Searches, each with a run for the verdict.
    at_ends : tuple of str
        TOML paths whose chosen value is an end of its range.
    """

    values: dict[str, float]
    cost: float
    shown: bool
    verdicts: pd.DataFrame
    seed: int
    cases: int
    searched: pd.DataFrame
    tries: int
    at_ends: tuple[str, ...] = ()


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
        At most `MAX_VARIABLES`.
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
    One variable: a grid of 13 points, then the cheapest accepted design between the neighbours of
    the best one, to 1e-4 of the range.
    Several: a Sobol sequence of 8 designs for each, then COBYLA of scipy from the cheapest accepted
    one, at most 40 designs for each. The optimum is that of the search, not proven to be global.
    """
    check_variables(variables)
    tree = cost_tree(minimise, variables)
    campaign = with_requirements(campaign, subject_to)
    items = checked_requirements(campaign, cases)
    seed = campaign.checked_seed(seed)
    vary = {one.key: (one.low, one.high) for one in variables}
    session = campaign.session(vary, threads, announce)
    search = _Search(session, variables, tree, items, cases, seed)
    fraction = 1.0
    for number in range(1, MAX_TRIES + 1):
        best, searched = search.optimum(fraction)
        if announce:
            announce(f"search {number}: {_text(best)}; a run with a fresh seed for the verdict ...")
        count = VERDICT_CASES * cases
        shown, verdicts = fresh_verdict(
            campaign, dict(best), count, seed + number, MAX_TRIES, threads, announce
        )
        if shown or number == MAX_TRIES:
            cost = float(evaluate(tree, _named(variables, list(best.values()))))
            at_ends = tuple(
                v.key
                for v in variables
                if min(best[v.key] - v.low, v.high - best[v.key]) <= _TOLERANCE * (v.high - v.low)
            )
            return Sizing(
                best, cost, shown, verdicts, seed + number, count, searched, number, at_ends
            )
        fraction *= _STEP
    raise AssertionError


def _text(design: Mapping[str, float]) -> str:
    return ", ".join(f"{key} = {value:.6g}" for key, value in design.items())


def _named(variables: Sequence[Variable], values: Sequence[Any]) -> dict[str, Any]:
    return {one.name: value for one, value in zip(variables, values, strict=True)}


def accepted_violations(item: Requirement, cases: int, fraction: float = 1.0) -> int:
    """Largest number of violations in the search with which a design is accepted.

    With a true probability of violation of that number over ``cases``, the run for the verdict
    shows the requirement with a probability of `_LIKELY` at least.

    Parameters
    ----------
    item : Requirement
    cases : int
    fraction : float
        Of the number.

    Returns
    -------
    int
    """
    count, raised = VERDICT_CASES * cases, 1.0 - (1.0 - item.confidence) / MAX_TRIES
    allowed = allowed_violations(count, item.probability, raised)
    low, high = 0, cases  # the first is accepted, the last is not
    while high - low > 1:
        middle = (low + high) // 2
        likely = binomial_cdf(allowed, count, middle / cases) >= _LIKELY
        low, high = (middle, high) if likely else (low, middle)
    return int(fraction * low)


class _Search:
    """Search for the accepted design with the smallest cost."""

    def __init__(
        self,
        session: Session,
        variables: Sequence[Variable],
        cost: Node,
        items: Sequence[Requirement],
        cases: int,
        seed: int,
    ):
        self.session, self.variables, self.items = session, variables, items
        self.cost, self.cases, self.seed = cost, cases, seed
        outcomes = {column.name for column in session.box.outcome_columns}
        self.metrics = [item.metric for item in items if item.metric in outcomes]
        self.scales: dict[str, float] = {}

    def optimum(self, fraction: float) -> tuple[dict[str, float], pd.DataFrame]:
        """Accepted design with the smallest cost, and all designs of the search."""
        allowed = [accepted_violations(item, self.cases, fraction) for item in self.items]
        frames: list[pd.DataFrame] = []

        def run(designs: np.ndarray) -> pd.DataFrame:
            frames.append(self._run(designs, allowed))
            return frames[-1]

        (self._by_root if len(self.variables) == 1 else self._by_steps)(run)
        searched = pd.concat(frames, ignore_index=True)
        accepted = searched[searched["margin"] >= 0.0]
        if accepted.empty:
            nearest_one = _text(self._design(searched, searched["margin"].idxmax()))
            raise InputError(
                "no design of the ranges passes all requirements with the margin that a fresh run "
                f"needs; the nearest is {nearest_one}"
            )
        return self._design(accepted, accepted["cost"].idxmin()), searched

    def _design(self, table: pd.DataFrame, row: Any) -> dict[str, float]:
        values = table.loc[row].to_dict()
        return {one.key: float(values[one.key]) for one in self.variables}

    def _run(self, designs: np.ndarray, allowed: Sequence[int]) -> pd.DataFrame:
        """Cost and margin of designs (m, variables)."""
        columns = list(dict.fromkeys(self.metrics))
        table = self.session.run_many(designs, self.cases, self.seed, columns or ["error"])
        frame = pd.DataFrame(designs, columns=[one.key for one in self.variables])
        frame["cost"] = self._costs(designs)
        margin = np.full(len(designs), np.inf)
        for item, most in zip(self.items, allowed, strict=True):
            margin = np.minimum(margin, self._margin(item, most, table.columns))
        frame["margin"] = margin
        return frame

    def _costs(self, designs: np.ndarray) -> np.ndarray:
        """Cost (m,) of designs (m, variables). Raises InputError."""
        costs = np.empty(len(designs))
        costs[:] = evaluate(self.cost, _named(self.variables, list(designs.T)))
        if not np.isfinite(costs).all():
            values = designs[np.argmin(np.isfinite(costs))]
            design = {one.key: value for one, value in zip(self.variables, values, strict=True)}
            raise InputError(f"minimise: has no value at {_text(design)}; use where(...)")
        return costs

    def _margin(
        self, item: Requirement, most: int, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Margin (m,) of each design to a requirement: that of its case of rank ``most``, from the
        worst. Cases without the outcome are worse than all others."""
        status = columns["status"]
        if item.metric in columns and not is_yes_or_no(item.metric):
            values = margins(columns[item.metric], item)
            values = np.where((status == Status.OK) & ~np.isnan(values), values, -np.inf)
            if item.name not in self.scales:
                finite = values[np.isfinite(values)]
                spread = float(finite.std()) if len(finite) else 1.0
                self.scales[item.name] = spread or 1.0
            ranked = np.partition(values, most, axis=1)[:, most]
            return np.asarray(ranked / self.scales[item.name])
        violates = self._violations(item, columns)
        return np.asarray((most - violates.sum(axis=1)) / max(1.0, 0.01 * self.cases))

    def _violations(self, item: Requirement, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Mask (m, cases) of the cases that violate a requirement on a status, a yes-or-no outcome
        or any violation; cases without a result count as violations, as in a verdict."""
        status = columns["status"]
        if item.metric == VIOLATION:
            others = [one for one in self.items if one.metric != VIOLATION]
            return np.any([self._violations(one, columns) for one in others], axis=0)
        if item.metric in columns:
            values = margins(columns[item.metric], item)
            return np.asarray(~((status == Status.OK) & (values >= 0.0)))
        return np.asarray(status != Status.OK)  # one with another status shows nothing

    def _by_root(self, run: Run) -> None:
        """Search one variable: a grid, then the cheapest design between the neighbours of the
        cheapest accepted one; if it is not accepted, the border of the accepted designs before it.

        The border is found by the Illinois method, and by bisection where that converges slowly."""
        (variable,) = self.variables
        table = run(np.linspace(variable.low, variable.high, _GRID)[:, None])
        x, costs, margin = (
            table[name].to_numpy(float) for name in (variable.key, "cost", "margin")
        )
        if not (margin >= 0.0).any():
            return
        good = int(np.argmin(np.where(margin >= 0.0, costs, np.inf)))
        ends = x[max(good - 1, 0)], x[min(good + 1, _GRID - 1)]
        fine = np.append(np.linspace(*ends, _FINE), x[good])
        fine_costs = self._costs(fine[:, None])
        cheapest = fine[fine_costs.argmin()]
        if fine_costs.min() >= costs[good]:
            return
        if cheapest in x:
            value = margin[list(x).index(cheapest)]
        else:
            value = float(run(np.array([[cheapest]]))["margin"].iloc[0])
        if value >= 0.0:
            return
        inside, outside = (x[good], margin[good]), (cheapest, value)
        width = np.inf
        for _ in range(_ROOTS):
            last, width = width, abs(inside[0] - outside[0])
            if width <= _TOLERANCE * (variable.high - variable.low):
                return
            fall = max(inside[1] - outside[1], 1e-12)
            share = min(max(inside[1] / fall, 0.05), 0.95) if width <= 0.5 * last else 0.5
            middle = inside[0] + share * (outside[0] - inside[0])
            value = float(run(np.array([[middle]]))["margin"].iloc[0])
            if value >= 0.0:
                inside, outside = (middle, value), (outside[0], 0.5 * outside[1])
            else:
                inside, outside = (inside[0], 0.5 * inside[1]), (middle, value)

    def _by_steps(self, run: Run) -> None:
        """Search several variables: a Sobol sequence, then COBYLA of scipy from the cheapest
        accepted design of it (or the nearest to be accepted)."""
        from scipy.optimize import minimize  # noqa: PLC0415
        from scipy.stats.qmc import Sobol  # noqa: PLC0415

        low = np.array([one.low for one in self.variables])
        span = np.array([one.high for one in self.variables]) - low
        count = len(self.variables)
        unit = Sobol(count, rng=np.random.default_rng(self.seed)).random(8 * count)
        unit = np.vstack([unit, np.zeros(count), np.ones(count)])
        table = run(low + span * unit)
        margin, costs = table["margin"].to_numpy(float), table["cost"].to_numpy(float)
        accepted = margin >= 0.0
        first = int(
            np.argmin(np.where(accepted, costs, np.inf)) if accepted.any() else margin.argmax()
        )
        scale = float(np.ptp(costs)) or 1.0
        known: dict[bytes, tuple[float, float]] = {}

        def result(x: np.ndarray) -> tuple[float, float]:
            x = np.clip(x, 0.0, 1.0)
            if x.tobytes() not in known:
                row = run((low + span * x)[None, :]).iloc[0]
                known[x.tobytes()] = (float(row["cost"]) / scale, float(row["margin"]))
            return known[x.tobytes()]

        minimize(
            lambda x: result(x)[0],
            unit[first],
            method="COBYLA",
            bounds=[(0.0, 1.0)] * count,
            constraints={"type": "ineq", "fun": lambda x: result(x)[1]},
            options={"rhobeg": 0.15, "tol": _TOLERANCE, "maxiter": _STEPS * count},
        )


__all__ = ["Sizing", "Variable", "parse_variable", "size"]
