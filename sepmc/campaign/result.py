"""What a run gave: rows, statistics, verdicts, what drives outcomes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc.analysis import (
    constant_outcomes,
    distributions,
    failure_attribution,
    requirements,
    sensitivity,
)
from sepmc.analysis.row_filter import describe_filter, filter_names
from sepmc.analysis.row_filter import matching_rows as matching
from sepmc.analysis.row_statistics import index_by_case
from sepmc.analysis.statistics import ok_rows, statistics
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Case
from sepmc.campaign.execution.accuracy import AchievedAccuracy, with_errors, with_scales
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.sinks import RunOutput
from sepmc.campaign.run_statistics import RunStatistics
from sepmc.campaign.store import shards
from sepmc.engine.dispatch import check_int, check_text
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError, RunWarning, nearest, warn
from sepmc.scene.model import Requirement
from sepmc.schema import Status, is_yes_or_no


@dataclass(repr=False)
class Result:
    """What a campaign gave.

    Rows of a run into a folder are read from there when they are asked for; a run without one keeps
    them in memory. ``timing`` is in seconds by stage: compile, sample, kernel, write; the last goes
    on while the kernel flies, so the sum can exceed the time taken. ``flight`` is how it was flown,
    ``accuracy`` its numerical error, ``notes`` what deserves a look: an accuracy that is not met, a
    nominal case that goes together instead of apart.
    """

    campaign: Any  # `sepmc.campaign.campaign.Campaign`
    kept: RunOutput
    timing: dict[str, float]
    seed: int
    numbers: CaseSelection  # of the cases
    total: int  # cases that these are drawn of
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)
    flight: Integration | None = None
    accuracy: AchievedAccuracy | None = None
    resumed: int = 0  # cases that the folder held already
    stopped: bool = False  # as more cases failed than may
    written: RunStatistics | None = None  # the statistics in the folder

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{count} {label}" for label, count in self.status_counts.items() if count
        )
        return (
            f"<Result of {self.campaign.name}, seed {self.seed}: "
            f"{counts}{f', in {self.folder}' if self.folder else ''}>"
        )

    def _repr_html_(self) -> str:
        """A notebook's view: what came of the cases, and the statistics."""
        from html import escape  # noqa: PLC0415

        columns = ["n", "mean", "sigma", "min", "p50", "max", "case_min", "case_max"]
        table = constant_outcomes.with_constant_values(self.statistics())[columns]
        return f"<p>{escape(repr(self))}</p>{table.to_html()}"

    @property
    def table(self) -> dict[str, np.ndarray]:
        """The case table by column, to be read: statistics are of the same arrays. Raises
        ValueError if no rows were kept."""
        views = {name: column.view() for name, column in self._rows().items()}
        for view in views.values():
            view.flags.writeable = False
        return views

    def to_pandas(self) -> pd.DataFrame:
        """One row per case: case, status, inputs (``in_...``), outcomes and audit columns.

        The index is the case number too, so that ``result.case(table[name].idxmin())`` is the case
        with the smallest value. It has no name: pandas would not know whether ``"case"`` means the
        index or the column.

        Raises
        ------
        ValueError
            If only statistics were kept, ``stats_only=True``.
        """
        return index_by_case(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separation over time in long form (case, time_s, ...), or None if ``run.history_step_s``
        is 0. Raises StoreError if the folder no longer holds what this run wrote."""
        self._rows()
        if self.folder:
            return shards.read_histories(self.folder, stored=self.kept.history_shards)
        return None if self.kept.histories is None else pd.DataFrame(dict(self.kept.histories))

    def statistics(self, *where: str) -> pd.DataFrame:
        """Statistics of every outcome, see `sepmc.analysis.statistics.statistics`, with its
        numerical ``error``, that in its unit, and whether it is ``constant``
        (`sepmc.analysis.constant_outcomes`): of all cases, or of those for which all terms
        of ``where`` hold, such as ``"joint.bolt.fails=1"``."""
        if where:
            rows, outcomes = self._rows(), self.campaign.summary_inputs[0]
            for term in where:
                check_text("where", term, "joint.bolt.fails=1")
            held = matching(rows, filter_names(self.campaign.file.dispersions, list(rows)), where)
            if not held.any():
                warn(f"{describe_filter(where)}: holds in none of {len(held)} cases", RunWarning)
            elif not ok_rows(rows)[held].any():
                none = "none of them came to its end as asked, so there are no statistics"
                warn(
                    f"{describe_filter(where)}: {held.sum()} of {len(held)} cases; {none}",
                    RunWarning,
                )
            kept = {name: rows[name][held] for name in ("case", "status", *outcomes)}
            return with_errors(self.campaign, self._errors, statistics(kept, outcomes))
        table = self.kept.summary.statistics(self.campaign.reference)
        return with_errors(self.campaign, self._errors, table)

    @property
    def _errors(self) -> Mapping[str, float]:
        return self.accuracy.errors if self.accuracy else {}

    def requirements(self) -> pd.DataFrame:
        """Verdicts on what the campaign requires, a row each; see
        `sepmc.analysis.requirements.Verdict`."""
        errors = with_scales(self.campaign, self._errors, self.kept.summary.statistics())
        sampler, audited = self.campaign.scene.run.sampler, self.kept.summary.audit()
        return requirements.verdict_table(self.kept.summary.verdicts(errors, audited, sampler))

    def sensitivity(self, outcome: str, indices: bool = True) -> pd.DataFrame:
        """How much each input drives an outcome, a row each; see
        `sepmc.analysis.sensitivity.input_sensitivities`, which raises ValueError if the outcome
        does not vary by more than its numerical error."""
        if outcome not in self.outcomes:
            raise InputError(f"{outcome}: no such outcome; {nearest(outcome, self.outcomes)}")
        design, correlated = self.campaign.design, self.campaign.correlated
        within = constant_outcomes.max_spread(self.statistics(), outcome)
        return sensitivity.input_sensitivities(
            self._rows(), self._inputs, outcome, design, indices, correlated, within
        )

    def fit(self) -> pd.DataFrame:
        """Shape of every outcome that is a number, and the law nearest to it, a row each; see
        `sepmc.analysis.distributions.fit_distributions`."""
        table = self.statistics()
        numbers = [name for name in self.outcomes if not is_yes_or_no(name)]
        alike = [name for name in numbers if constant_outcomes.is_constant(table, name)]
        return distributions.fit_distributions(self._rows(), numbers, alike)

    def causes(self, name: str) -> list[failure_attribution.Attribution]:
        """Inputs and pairs of inputs that set the cases apart which violate a requirement, or have
        a status; see `sepmc.analysis.failure_attribution.attribute_failures`."""
        rows, known = self._rows(), {item.name: item for item in self.campaign.file.requirements}
        statuses = [status.label for status in Status if status is not Status.OK]
        if name not in known and name not in statuses:
            said = nearest(name, [*known, *statuses])
            raise InputError(f"{name}: no such requirement or status; {said}")
        item = known.get(name) or Requirement(name=name, metric=name)
        others, design = list(known.values()), self.campaign.design
        return failure_attribution.attribute_violations(item, rows, self._inputs, others, design)

    @property
    def _inputs(self) -> list[str]:
        return [column.name for column in self.campaign.input_columns]

    def case(self, number: int) -> Case:
        """Case ``number`` as it was flown here, fully resolved in SI. Raises ValueError if there is
        no such case."""
        number, flown = check_int("case", number, 0, CASES - 1), self._flown
        if number not in flown:
            raise InputError(f"case = {number}: must be one of those flown, {flown}")
        found = self.campaign.case(number, self.seed, self.total)
        run = msgspec.structs.replace(found.scene.run, cases=self.total, seed=self.seed)
        return replace(found, scene=msgspec.structs.replace(found.scene, run=run))

    @property
    def _flown(self) -> CaseSelection:
        """Numbers of the cases that were flown: fewer than asked for if too many of them failed."""
        if not self.stopped:
            return self.numbers
        if self.kept.rows is not None:
            return CaseSelection.of(np.asarray(self.kept.rows["case"]))
        return self.numbers.before(sum(self.status_counts.values()))  # counted in their order

    @property
    def outcomes(self) -> list[str]:
        """Names of the outcome columns."""
        return [column.name for column in self.campaign.outcome_columns]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of the case table."""
        return {column.name: column.unit for column in self.campaign.columns}

    @property
    def status_counts(self) -> dict[str, int]:
        """Number of cases by status, of those that occur."""
        return {label: count for label, count in self.kept.summary.counts.items() if count}

    def _rows(self) -> Mapping[str, np.ndarray]:
        if self.kept.rows is None:
            raise InputError(
                "this run kept statistics only, so it has no rows; run without stats_only, or fly "
                "single cases by case(number)"
            )
        return self.kept.rows
