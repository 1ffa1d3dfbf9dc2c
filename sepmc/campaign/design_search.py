"""Search for the accepted design with the smallest cost, on common random numbers.

A design is accepted if each requirement is satisfied in so many of its cases that a run with
another seed is likely to show it (`accepted_violations`). With one design variable the search runs
a grid, more designs where some are nearly accepted, and the border of the accepted designs; with
several a Sobol sequence, then COBYLA of scipy.

Several costs are combined to one number by a `Goal`. The margin of a design is not negative if it
is accepted. Tables of designs have a row per design: values by TOML path, the costs
(`cost_names`), and ``margin``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import allowed_violations, binomial_cdf, raised
from sepmc.analysis.requirements import margins
from sepmc.campaign.session import Session
from sepmc.engine.dispatch import progress_reporter
from sepmc.scene.design_tables import Variable
from sepmc.scene.formula import Node, evaluate
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import VIOLATION, Requirement
from sepmc.schema import Status, is_yes_or_no

Run = Callable[[np.ndarray], pd.DataFrame]  # designs (m, variables) to costs and margin of each

MAX_TRIES = 3
VERDICT_CASES = 4  # times the cases of the search
TOLERANCE = 1e-4  # of the range of a variable
_LIKELY = 0.95  # probability that the run for the verdict shows a design at the edge
_GRID, _ROOTS = 13, 24  # one variable: points of the grid, and steps to the border, at most
# one variable: closer looks at the grid, peaks of the margin in each, and designs around a peak
_ZOOMS, _PEAKS, _CLOSER = 3, 3, 9
_FINE = 2001  # costs between two neighbours of a point of the grid
_EVERY_S = 10.0  # between messages on the progress
_STEPS = 40  # several variables: designs for each, at most, after the first ones


@dataclass(frozen=True)
class Goal:
    """Number that a search minimises, made of the n costs of a design.

    It is the sum of ``shares * costs`` plus, over the costs whose weight is not 0, the largest of
    ``weights * (costs - low)``. Each attribute has shape (n,), an element per cost.
    """

    shares: np.ndarray
    weights: np.ndarray
    low: np.ndarray

    @classmethod
    def weighted(cls, shares: Sequence[float]) -> "Goal":
        """Return the goal that is only the sum of ``shares * costs``."""
        none = np.zeros(len(shares))
        return cls(np.asarray(shares, dtype=float), none, none)

    def terms(self, costs: np.ndarray) -> np.ndarray:
        """Return the terms ``weights * (costs - low)``, shape (m, k), of m designs with costs
        (m, n), for the k weights that are not 0; k may be 0."""
        used = self.weights != 0.0
        return np.asarray(self.weights[used] * (costs[:, used] - self.low[used]))

    def of(self, costs: np.ndarray) -> np.ndarray:
        """Return the values (m,) of the goal for m designs with costs (m, n): the sum of ``shares *
        costs`` plus the largest of `terms` (0 without terms)."""
        terms = self.terms(costs)
        largest = terms.max(axis=1) if terms.shape[1] else 0.0
        return np.asarray(largest + costs @ self.shares)


def accepted_violations(
    item: Requirement, cases: int, fraction: float = 1.0, tries: int = MAX_TRIES
) -> int:
    """Return the largest number of violations of a requirement with which the search accepts a
    design; a design without violations is always accepted.

    If the true probability of a violation is that number over ``cases``, the verdict run (with
    another seed, and `VERDICT_CASES` times as many cases) shows the requirement with a probability
    of at least `_LIKELY`.

    Parameters
    ----------
    item : Requirement
    cases : int
        Cases of a design in the search.
    fraction : float
        Factor on the number, to search with a larger margin; the result is rounded down.
    tries : int
        Largest number of verdict runs; the confidence of each is raised so that all of them
        together have that of the requirement.

    Returns
    -------
    int
    """
    count = VERDICT_CASES * cases
    allowed = allowed_violations(count, item.probability, raised(item.confidence, tries))
    low, high = 0, cases  # the first is accepted, the last is not
    while high - low > 1:
        middle = (low + high) // 2
        likely = binomial_cdf(allowed, count, middle / cases) >= _LIKELY
        low, high = (middle, high) if likely else (low, middle)
    return int(fraction * low)


class DesignSearch:
    """Searches the ranges of the variables for the accepted design with the smallest cost.

    A design is accepted if no requirement has more violations than `accepted_violations`, times a
    ``fraction`` that the methods take. Designs that were run for one goal are reused for the next.
    ``costs`` are formulas of the variables, ``items`` the requirements, ``cases`` and ``seed``
    those of every design, and ``tries`` the largest number of verdict runs, by which confidences
    are raised. ``announce`` receives the number of designs run so far, every ten seconds.
    """

    def __init__(
        self,
        session: Session,
        variables: Sequence[Variable],
        costs: Sequence[Node],
        items: Sequence[Requirement],
        cases: int,
        seed: int,
        tries: int,
        announce: Log | None = None,
    ):
        self.session, self.variables, self.items = session, variables, items
        self.cost_trees, self.cases, self.seed, self.tries = costs, cases, seed, tries
        self.names = cost_names(len(costs))
        outcomes = {column.name for column in session.box.outcome_columns}
        self.metrics = [item.metric for item in items if item.metric in outcomes]
        self.scales: dict[str, float] = {}
        self._searched: dict[float, list[pd.DataFrame]] = {}  # by fraction of violations
        self._report, self._count = progress_reporter(announce, _EVERY_S), 0

    def optimum(self, goal: Goal, fraction: float) -> tuple[dict[str, float], pd.DataFrame]:
        """Search for the accepted design with the smallest value of a goal.

        Returns the design, values by TOML path, and the table of all designs that were run with
        this ``fraction``, a factor on the number of accepted violations. Raises InputError if no
        design is accepted.
        """
        run = self._runner(fraction)
        first, refine = (
            (self._first_of_one, self._by_root)
            if len(self.variables) == 1
            else (self._first_of_several, self._by_steps)
        )
        if not self._searched[fraction]:
            first(run)
        refine(run, goal, self._table(fraction))
        searched = self._table(fraction)
        accepted = searched[searched["margin"] >= 0.0]
        if accepted.empty:
            nearest_one = design_text(self._design(searched, searched["margin"].idxmax()))
            raise InputError(
                "no design of the ranges passes all requirements with the margin that a run with "
                f"another seed needs; the nearest is {nearest_one}"
            )
        best = int(goal.of(accepted[self.names].to_numpy(float)).argmin())
        return self._design(accepted, accepted.index[best]), searched

    def spread_of_costs(self, fraction: float) -> np.ndarray:
        """Return the spread (n,) of each of the n costs, largest minus smallest, over the designs
        run so far with this ``fraction``, a factor on the number of accepted violations; 1 for a
        constant cost. If no design was run with it yet, the first designs of a search are run."""
        if not self._searched.get(fraction):
            run = self._runner(fraction)
            (self._first_of_one if len(self.variables) == 1 else self._first_of_several)(run)
        spread = np.ptp(self._table(fraction)[self.names].to_numpy(float), axis=0)
        return np.where(spread > 0.0, spread, 1.0)

    @property
    def searched(self) -> pd.DataFrame:
        """Table of all designs run so far, at least one, those of one fraction (of the accepted
        violations) after those of another: values by TOML path, costs, and ``margin``, the smallest
        over the requirements, as in `_run`. The fraction is no column."""
        frames = [frame for each in self._searched.values() for frame in each]
        return pd.concat(frames, ignore_index=True)

    def costs(self, designs: np.ndarray) -> np.ndarray:
        """Return the n costs (m, n) of m designs (m, variables), which are in the units of the
        keys. Raises InputError if a cost is not finite."""
        named = {one.name: x for one, x in zip(self.variables, designs.T, strict=True)}
        costs = np.empty((len(designs), len(self.cost_trees)))
        for k, tree in enumerate(self.cost_trees):
            costs[:, k] = evaluate(tree, named)
        finite = np.isfinite(costs).all(axis=1)
        if not finite.all():
            values = designs[np.argmin(finite)]
            design = {one.key: value for one, value in zip(self.variables, values, strict=True)}
            raise InputError(
                f"minimise: has no value at {design_text(design)}; give it one there: "
                "where(condition, a, b)"
            )
        return costs

    def _runner(self, fraction: float) -> Run:
        """Return a function that runs m designs, given as an array (m, variables), stores their
        table among those of this ``fraction``, a factor on the number of accepted violations, and
        returns the table."""
        frames = self._searched.setdefault(fraction, [])
        allowed = [
            accepted_violations(item, self.cases, fraction, self.tries) for item in self.items
        ]

        def run(designs: np.ndarray) -> pd.DataFrame:
            frames.append(self._run(designs, allowed))
            return frames[-1]

        return run

    def _table(self, fraction: float) -> pd.DataFrame:
        """Return the table of all designs run with this ``fraction``, a factor on the number of
        accepted violations: in the order in which they were run, with the columns of `_run`."""
        return pd.concat(self._searched[fraction], ignore_index=True)

    def _design(self, table: pd.DataFrame, row: Any) -> dict[str, float]:
        """Return the values of the variables, one for each key of ``vary`` (a TOML path, also with
        wildcards), in the row of a table with this index label."""
        values = table.loc[row].to_dict()
        return {one.key: float(values[one.key]) for one in self.variables}

    def _run(self, designs: np.ndarray, allowed: Sequence[int]) -> pd.DataFrame:
        """Run m designs, given as an array (m, variables), and return their table: values by TOML
        path, costs, and ``margin``, the smallest over the requirements (`_margin`): not negative if
        the design is accepted. ``allowed`` has the number of accepted violations of each
        requirement."""
        columns, before = list(dict.fromkeys(self.metrics)) or ["error"], self._count

        def progress(done: int, _: int) -> None:
            self._count = before + done
            self._report(lambda seconds: f"searched {self._count} designs in {seconds:.0f} s")

        table = self.session.run_many(designs, self.cases, self.seed, columns, progress)
        frame = pd.DataFrame(designs, columns=[one.key for one in self.variables])
        frame[self.names] = self.costs(designs)
        margin = np.full(len(designs), np.inf)
        for item, most in zip(self.items, allowed, strict=True):
            margin = np.minimum(margin, self._margin(item, most, table.columns))
        frame["margin"] = margin
        return frame

    def _margin(
        self, item: Requirement, most: int, columns: Mapping[str, np.ndarray]
    ) -> np.ndarray:
        """Return the margin (m,) of each of m designs to a requirement: negative if more than
        ``most`` cases violate it. ``columns`` is as for `_violations`.

        It is the scaled margin of the worst case that remains without the ``most`` worst cases;
        minus infinity if that case is not ok or lacks the outcome. For a requirement on a violation
        of any other one, the margin of a case is the smallest over the others. Where cases have no
        numeric margin (a status, or yes or no), it is ``most`` minus the number of violations,
        divided by a hundredth of the cases.
        """
        if item.metric == VIOLATION:
            judged = [one for one in self.items if one.metric != VIOLATION]
        else:
            judged = [item]
        if all(one.metric in columns and not is_yes_or_no(one.metric) for one in judged):
            values = np.min([self._scaled_margins(one, columns) for one in judged], axis=0)
            return np.asarray(np.partition(values, most, axis=1)[:, most])
        violates = self._violations(item, columns)
        return np.asarray((most - violates.sum(axis=1)) / max(1.0, 0.01 * self.cases))

    def _scaled_margins(self, item: Requirement, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the margins (m, cases) of the cases of m designs to the nearer bound of a
        requirement, negative beyond it; minus infinity for a case that is not ok or does not have
        the outcome. They are divided by the standard deviation that they had in the first call
        for this requirement. ``columns`` is as for `_violations`."""
        values = margins(columns[item.metric], item)
        known = (columns["status"] == Status.OK) & ~np.isnan(values)
        values = np.where(known, values, -np.inf)
        if item.name not in self.scales:
            finite = values[np.isfinite(values)]
            spread = float(finite.std()) if len(finite) else 1.0
            self.scales[item.name] = spread or 1.0
        return np.asarray(values / self.scales[item.name])

    def _violations(self, item: Requirement, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return a mask (m, cases), True where a case of one of m designs violates a requirement.

        As in a verdict, a case counts as a violation of a requirement on an outcome if it is not
        ok or does not have the outcome, of one on a status if it is not ok, and of one on
        violations if it violates any of the others.

        ``columns`` has the arrays (m, cases) of ``status`` and of outcomes by name.
        """
        status = columns["status"]
        if item.metric == VIOLATION:
            others = [one for one in self.items if one.metric != VIOLATION]
            return np.any([self._violations(one, columns) for one in others], axis=0)
        if item.metric in columns:
            values = margins(columns[item.metric], item)
            return np.asarray(~((status == Status.OK) & (values >= 0.0)))
        return np.asarray(status != Status.OK)  # one with another status shows nothing

    def _first_of_one(self, run: Run) -> None:
        """Run a grid of one variable; then, up to `_ZOOMS` times, run more designs around the
        `_PEAKS` highest peaks of the margin that are negative, between the neighbours of each: a
        range of accepted designs that is narrower than the grid may lie there, also if others were
        found. It ends early only if no peak is negative."""
        (variable,) = self.variables
        frames = [run(np.linspace(variable.low, variable.high, _GRID)[:, None])]
        for _ in range(_ZOOMS):
            table = pd.concat(frames).sort_values(variable.key)
            x, margin = (table[name].to_numpy(float) for name in (variable.key, "margin"))
            before = np.concatenate([[-np.inf], margin[:-1]])
            after = np.concatenate([margin[1:], [-np.inf]])
            is_peak = (margin < 0.0) & (margin > -np.inf) & (margin >= before) & (margin >= after)
            peaks = np.flatnonzero(is_peak)
            if not len(peaks):
                return
            peaks = peaks[np.argsort(-margin[peaks], kind="stable")][:_PEAKS]
            low, high = x[np.maximum(peaks - 1, 0)], x[np.minimum(peaks + 1, len(x) - 1)]
            closer = np.linspace(low, high, _CLOSER + 2)[1:-1]
            frames.append(run(np.setdiff1d(closer.ravel(), x)[:, None]))

    def _by_root(self, run: Run, goal: Goal, table: pd.DataFrame) -> None:
        """Refine the search of one variable from the accepted design in ``table`` that is cheapest,
        which has the smallest value of ``goal``.

        The costs of a design are known without a run. If a design between the two neighbours of
        that one in ``table`` costs less, the cheapest of them is run. If it is not accepted, the
        border of the accepted designs between it and the accepted one is searched, by the Illinois
        method, and by bisection where that converges slowly. Results are stored by ``run``, and
        nothing is returned. Without an accepted design nothing is run. A design is accepted if its
        ``margin`` is not negative."""
        (variable,) = self.variables
        table = table.drop_duplicates(variable.key).sort_values(variable.key)
        x, margin = (table[name].to_numpy(float) for name in (variable.key, "margin"))
        costs = goal.of(table[self.names].to_numpy(float))
        if not (margin >= 0.0).any():
            return
        good = int(np.argmin(np.where(margin >= 0.0, costs, np.inf)))
        ends = x[max(good - 1, 0)], x[min(good + 1, len(x) - 1)]
        fine = np.append(np.linspace(*ends, _FINE), x[good])
        fine_costs = goal.of(self.costs(fine[:, None]))
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
            if width <= TOLERANCE * (variable.high - variable.low):
                return
            fall = max(inside[1] - outside[1], 1e-12)
            share = min(max(inside[1] / fall, 0.05), 0.95) if width <= 0.5 * last else 0.5
            middle = inside[0] + share * (outside[0] - inside[0])
            value = float(run(np.array([[middle]]))["margin"].iloc[0])
            if value >= 0.0:
                inside, outside = (middle, value), (outside[0], 0.5 * outside[1])
            else:
                inside, outside = (inside[0], 0.5 * inside[1]), (middle, value)

    def _first_of_several(self, run: Run) -> None:
        """Run the first designs for several variables: a Sobol sequence of at least 8 per variable
        (a power of two), and the designs with all variables at their low and at their high ends."""
        from scipy.stats.qmc import Sobol  # noqa: PLC0415

        count = len(self.variables)
        power = math.ceil(math.log2(8 * count))
        unit = Sobol(count, rng=np.random.default_rng(self.seed)).random_base2(power)
        low, span = self._ranges
        run(low + span * np.vstack([unit, np.zeros(count), np.ones(count)]))

    @property
    def _ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Low ends and widths of the ranges, each (variables,)."""
        low = np.array([one.low for one in self.variables])
        return low, np.array([one.high for one in self.variables]) - low

    def _by_steps(self, run: Run, goal: Goal, table: pd.DataFrame) -> None:
        """Refine the search of several variables by COBYLA of scipy, from the accepted design in
        ``table`` with the smallest value of ``goal``, or from the one with the largest margin if
        none is accepted. Results are stored by ``run``, and nothing is returned. If the goal has
        terms (`Goal.terms`), the largest of them is an additional variable."""
        from scipy.optimize import minimize  # noqa: PLC0415

        low, span = self._ranges
        count = len(self.variables)
        margin = table["margin"].to_numpy(float)
        all_costs = table[self.names].to_numpy(float)
        values, accepted = goal.of(all_costs), margin >= 0.0
        first = int(
            np.argmin(np.where(accepted, values, np.inf)) if accepted.any() else margin.argmax()
        )
        scale = float(np.ptp(values)) or 1.0
        known: dict[bytes, float] = {}

        def design(x: np.ndarray) -> np.ndarray:
            return np.asarray((low + span * np.clip(x[:count], 0.0, 1.0))[None, :])

        def margin_at(x: np.ndarray) -> float:
            values = design(x)
            if values.tobytes() not in known:
                known[values.tobytes()] = float(run(values)["margin"].iloc[0])
            return known[values.tobytes()]

        def terms(x: np.ndarray) -> np.ndarray:
            return goal.terms(self.costs(design(x)))[0] / scale

        start = (table[[one.key for one in self.variables]].to_numpy(float)[first] - low) / span
        constraints = [{"type": "ineq", "fun": margin_at}]
        has_terms = bool((goal.weights != 0.0).any())
        if has_terms:
            start = np.append(start, terms(start).max())
            constraints.append({"type": "ineq", "fun": lambda x: x[count] - terms(x)})
        minimize(
            lambda x: float(self.costs(design(x))[0] @ goal.shares) / scale + sum(x[count:]),
            start,
            method="COBYLA",
            bounds=[(0.0, 1.0)] * count + [(None, None)] * has_terms,
            constraints=constraints,
            options={"rhobeg": 0.15, "tol": TOLERANCE, "maxiter": _STEPS * count},
        )


def cost_names(count: int) -> list[str]:
    """Return the names of the table columns of ``count`` costs: cost, or cost_1, cost_2, ..."""
    return ["cost"] if count == 1 else [f"cost_{k + 1}" for k in range(count)]


def design_text(design: Mapping[str, float]) -> str:
    """Return a design (values by TOML path) as text: ``KEY = VALUE, KEY = VALUE``."""
    return ", ".join(f"{key} = {value:.6g}" for key, value in design.items())
