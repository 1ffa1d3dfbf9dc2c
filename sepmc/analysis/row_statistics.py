"""Statistics of a stored case table, computed from one column at a time."""

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from sepmc.analysis import statistics as of
from sepmc.analysis.proportions import CONFIDENCE, order_statistics
from sepmc.analysis.requirements import (
    Errors,
    RequirementCounter,
    Verdict,
    count_cases,
    design_value,
    has_two_bounds,
    judge,
    margins,
    no_verdict_reason,
    requirement_counters,
)
from sepmc.analysis.streaming import MAX_NAMED, StreamingStatistics
from sepmc.scene.model import Requirement
from sepmc.schema import Status

# largest number of cases with exact percentiles, 4 MB a column; above it they are from a sketch
MAX_EXACT_CASES = 500_000


def index_by_case(columns: Mapping[str, Any]) -> pd.DataFrame:
    """Return a DataFrame of the columns, indexed by case number (the index has no name); ``case``
    stays a column too."""
    table = pd.DataFrame(columns)
    table.index = pd.Index(table["case"].to_numpy())
    return table


class TableStatistics:
    """Statistics, audit and histograms of a case table; reads one column at a time.

    Parameters
    ----------
    cases : mapping of name to column, shape (n_cases,)
    outcomes, audits : sequence of str
        Names of the columns of outcomes and of audit columns.
    bounds : mapping of audit column to bound
        Bounds beyond which a case fails the audit.
    requirements : sequence of Requirement
    """

    def __init__(
        self,
        cases: Mapping[str, Any],
        outcomes: Sequence[str],
        audits: Sequence[str],
        bounds: Mapping[str, float],
        requirements: Sequence[Requirement] = (),
    ):
        self.cases, self.outcomes, self.audits, self.bounds = cases, outcomes, audits, bounds
        self.requirements = requirements

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of cases of each status: ok first, also if it has none, then those of the others
        that have cases, by falling frequency."""
        return of.status_counts(self.cases)

    @cached_property
    def failed(self) -> dict[str, list[int]]:
        """Case numbers of the first `MAX_NAMED` (20) cases of each status except ok, by status."""
        statuses, numbers = np.asarray(self.cases["status"]), np.asarray(self.cases["case"])
        return {
            label: numbers[statuses == label][:MAX_NAMED].tolist()
            for label in self.counts
            if label != of.OK
        }

    def statistics(
        self,
        reference: Mapping[str, Mapping[str, float]] | None = None,
        confidence: float = CONFIDENCE,
    ) -> pd.DataFrame:
        """Return the statistics of the ok cases, a row per outcome; arguments and columns are those
        of `sepmc.analysis.statistics.statistics`."""
        return of.statistics(self.cases, self.outcomes, reference, confidence)

    def audit(self) -> pd.DataFrame:
        """Return the audit of the ok cases, a row per audit column; its columns are those of
        `sepmc.analysis.statistics.audit`."""
        return of.audit(self.cases, self.bounds, self.audits)

    def verdicts(
        self, errors: Errors, audit: pd.DataFrame, sampler: str = "random"
    ) -> list[Verdict]:
        """Return the verdicts on the requirements.

        Parameters
        ----------
        errors : mapping
            Numerical errors of outcomes, see `sepmc.analysis.requirements.Errors`.
        audit : DataFrame
            From `audit`.
        sampler : str
            Value of ``run.sampler``. With any but "random", as with a failed audit, requirements
            get no verdict, only the reason (`sepmc.analysis.requirements.no_verdict_reason`).

        Returns
        -------
        list of Verdict
        """
        reason = no_verdict_reason(bool((audit["beyond"] > 0).any()), sampler)
        counters = requirement_counters(self.requirements)
        labels = np.asarray(self.cases["status"])

        def values(name: str) -> np.ndarray | None:
            return of.column(self.cases, name) if name in self.outcomes else None

        count_cases(
            counters, np.asarray(self.cases["case"]), self._ok, values, lambda name: labels == name
        )
        return [
            judge(counter, errors, self._design(counter, x), reason, self._lacking(x))
            for counter in counters
            for x in (values(counter.requirement.metric),)
        ]

    def _lacking(self, values: np.ndarray | None) -> int:
        """Return the number of ok cases whose value in ``values`` (n_cases,) is NaN; 0 if it is
        None, for a requirement on a status or on `VIOLATION`."""
        return 0 if values is None else int(np.count_nonzero(self._ok & np.isnan(values)))

    def _design(self, counter: RequirementCounter, values: np.ndarray | None) -> float:
        """Return the design value of a requirement on the outcome ``values`` (n_cases,), a value of
        the outcome, or with two bounds of its margin; NaN for a requirement on a status or on
        `VIOLATION` (``values`` is None), and for too few cases."""
        if values is None:
            return np.nan
        present = values[self._ok & ~np.isnan(values)]
        if has_two_bounds(counter.requirement):
            present = margins(present, counter.requirement)
        return design_value(counter, len(present), partial(order_statistics, present))

    def histogram(self, name: str) -> of.Histogram | None:
        """Return the histogram of the finite values of an outcome in the ok cases, or None if there
        are none."""
        return of.histogram(of.column(self.cases, name)[self._ok])

    @cached_property
    def _ok(self) -> np.ndarray:
        return of.ok_rows(self.cases)


def summarise(
    cases: Any,
    outcomes: Sequence[str],
    audits: Sequence[str],
    bounds: Mapping[str, float],
    requirements: Sequence[Requirement] = (),
) -> TableStatistics | StreamingStatistics:
    """Return an object that gives the statistics of a stored case table.

    Parameters
    ----------
    cases : `sepmc.campaign.store.shards.CaseColumns`
    outcomes, audits, bounds, requirements
        As for `TableStatistics`.

    Returns
    -------
    TableStatistics or StreamingStatistics
        Up to `MAX_EXACT_CASES` cases a TableStatistics, with exact percentiles; for more cases a
        StreamingStatistics, to which all rows were added, with those of a `QuantileSketch`.
    """
    if cases.rows <= MAX_EXACT_CASES:
        return TableStatistics(cases, outcomes, audits, bounds, requirements)
    stream = StreamingStatistics(outcomes, audits, bounds, requirements)
    code_of = {status.label: int(status) for status in Status}
    for numbers, statuses, columns in cases.batches([*outcomes, *audits]):
        stream.add(
            numbers,
            np.array([code_of[label] for label in statuses.categories])[statuses.codes],
            columns,
        )
    return stream
