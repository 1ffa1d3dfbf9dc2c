"""Result of a run: case rows, histories, statistics, verdicts, and input sensitivities."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from html import escape
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
from sepmc.analysis.inline_figures import histogram_svg
from sepmc.analysis.requirements import required_bounds
from sepmc.analysis.row_filter import describe_filter, filter_names
from sepmc.analysis.row_filter import matching_rows as matching
from sepmc.analysis.row_statistics import index_by_case
from sepmc.analysis.statistics import ok_rows, statistics
from sepmc.analysis.telemetry import FlightComparison
from sepmc.campaign.case_selection import CaseSelection
from sepmc.campaign.definition import Case
from sepmc.campaign.execution.accuracy import AchievedAccuracy, with_errors, with_scales
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.sinks import RunOutput
from sepmc.campaign.flight_comparison import CASES as FLIGHT_CASES
from sepmc.campaign.flight_comparison import compare_with_flight
from sepmc.campaign.run_statistics import RunStatistics
from sepmc.campaign.store import shards
from sepmc.engine.dispatch import check_int, check_text
from sepmc.scene.limits import CASES
from sepmc.scene.messages import InputError, Log, RunWarning, nearest, no_log, shorten, warn
from sepmc.scene.model import Requirement
from sepmc.schema import NOT_OK_LABELS, is_yes_or_no


@dataclass(repr=False)
class Result:
    """Result of a run: its case rows, and the statistics and verdicts that follow from them.

    Attributes
    ----------
    campaign : Campaign
        The campaign that was run.
    kept : RunOutput
        Statistics, and case rows in memory or read from the folder on demand; it has no rows if the
        run stored statistics only.
    timing : dict of str to float
        Elapsed seconds by stage: text (of the kernel), compile, steps (their selection), sample,
        kernel and write. Writing overlaps the kernel, so the sum can exceed the elapsed time. Empty
        for a run read from its folder.
    seed : int
    numbers : CaseSelection
        Numbers of the cases that the run was to have; fewer were run if ``stopped``.
    total : int
        Number of cases of the whole sample, on which some samplers depend.
    folder : Path or None
        Run folder; None if the run is in memory.
    notes : list of str
        Notes for the user, such as an accuracy that is not met.
    integration : Integration or None
        Kernel and steps; None for a run read from its folder.
    accuracy : AchievedAccuracy or None
        Numerical error, if known.
    resumed : int
        Number of cases that the folder contained already when the run was resumed.
    stopped : bool
        True if the run stopped early because more cases failed than allowed; of a run read from
        its folder, True if it ended early for any reason.
    written : RunStatistics or None
        Statistics as written to the folder; None if the run is in memory.
    """

    campaign: Any  # `sepmc.campaign.campaign.Campaign`
    kept: RunOutput
    timing: dict[str, float]
    seed: int
    numbers: CaseSelection  # of the run
    total: int  # number of cases of the sample
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)
    integration: Integration | None = None
    accuracy: AchievedAccuracy | None = None
    resumed: int = 0  # cases of the run that was resumed
    stopped: bool = False  # ended early
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
        """HTML for notebooks: status counts, verdicts, statistics and histograms."""
        columns = ["n", "mean", "sigma", "min", "p50", "max", "case_min", "case_max"]
        statistics = self.statistics()
        table = constant_outcomes.with_constant_values(statistics)[columns]
        bounds = required_bounds(self.campaign.file.requirements)
        figures = [
            histogram_svg(
                constant_outcomes.collapse_constant(
                    self.kept.summary.histogram(name), statistics, name
                ),
                bounds.get(name, ()),
            )
            for name in map(str, table.index)
        ]
        rows = table.assign(histogram=figures).rename(index=lambda name: escape(str(name)))
        verdicts = "".join(
            f"<p>{escape(str(row['verdict']).upper())}: {escape(str(name))}, "
            f"{row['violations']} of {row['cases']} cases violate it</p>"
            for name, row in self.requirements().to_dict("index").items()
        )
        return f"<p>{escape(repr(self))}</p>{verdicts}{rows.to_html(escape=False)}"

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Case table: arrays by column name, read-only, one element per case.

        Raises
        ------
        ValueError
            If the run stored no case rows.
        """
        views = {name: column.view() for name, column in self._rows().items()}
        for view in views.values():
            view.flags.writeable = False
        return views

    def to_pandas(self) -> pd.DataFrame:
        """Case table, one row per case: case, status, inputs (``in_...``), outcomes and audit
        columns.

        The index is the case number as well, so that ``result.case(table[name].idxmin())`` is the
        case with the smallest value. The index has no name: ``"case"`` would be ambiguous.

        Returns
        -------
        DataFrame

        Raises
        ------
        ValueError
            If only statistics were stored (``stats_only=True``).
        """
        return index_by_case(self.table)

    def histories(self) -> pd.DataFrame | None:
        """Separations over time of all cases, in long form.

        Returns
        -------
        DataFrame or None
            A row per case and time: case, time_s, and separation speed and distance of each joint;
            None if no histories were stored (``run.history_step_s`` is 0).

        Raises
        ------
        InputError
            If the run stored no case rows.
        StoreError
            If the shards of the folder were changed.
        """
        self._rows()
        if self.folder:
            return shards.read_histories(self.folder, stored=self.kept.history_shards)
        return None if self.kept.histories is None else pd.DataFrame(dict(self.kept.histories))

    def statistics(self, *where: str) -> pd.DataFrame:
        """Statistics of every outcome.

        Parameters
        ----------
        *where : str
            Conditions, all of which a case must satisfy to be counted, such as
            ``"joint.bolt.fails=1"``. Without conditions all cases count. If no ok case satisfies
            them, a RunWarning says so, and the statistics are NaN, of 0 cases. With conditions the
            columns of the published reference are absent.

        Returns
        -------
        DataFrame
            A row per outcome, indexed by its name, with the columns of
            `sepmc.analysis.statistics.statistics`, the relative numerical ``error`` (no column if
            it is not known), the same error in the unit of the outcome as ``error_size``, and
            ``constant``, True if the outcome varies by no more than twice that error
            (`sepmc.analysis.constant_outcomes`).

        Raises
        ------
        InputError
            If a condition is not valid, or there are conditions and the run stored no case rows.
        """
        if where:
            rows, outcomes = self._rows(), self.campaign.summary_inputs[0]
            for term in where:
                check_text("where", term, "joint.bolt.fails=1")
            is_selected = matching(
                rows, filter_names(self.campaign.file.dispersions, list(rows)), where
            )
            if not is_selected.any():
                warn(
                    f"{describe_filter(where)}: satisfied by none of {len(is_selected)} cases",
                    RunWarning,
                )
            elif not ok_rows(rows)[is_selected].any():
                reason = "none of them has the status ok, so no statistics exist"
                warn(
                    f"{describe_filter(where)}: satisfied by {is_selected.sum()} of "
                    f"{len(rows['case'])} cases; " + reason,
                    RunWarning,
                )
            selected = {name: rows[name][is_selected] for name in ("case", "status", *outcomes)}
            return with_errors(self.campaign, self._errors, statistics(selected, outcomes))
        table = self.kept.summary.statistics(self.campaign.reference)
        return with_errors(self.campaign, self._errors, table)

    @property
    def _errors(self) -> Mapping[str, float]:
        """Numerical error by outcome, as in `AchievedAccuracy.errors`; empty if it is not known."""
        return self.accuracy.errors if self.accuracy else {}

    def requirements(self) -> pd.DataFrame:
        """Verdict on each requirement.

        Returns
        -------
        DataFrame
            A row per requirement, indexed by its name, with the other fields of
            `sepmc.analysis.requirements.Verdict`.
        """
        errors = with_scales(self.campaign, self._errors, self.kept.summary.statistics())
        sampler, audited = self.campaign.scene.run.sampler, self.kept.summary.audit()
        return requirements.verdict_table(self.kept.summary.verdicts(errors, audited, sampler))

    def sensitivity(self, outcome: str, indices: bool = True) -> pd.DataFrame:
        """Sensitivity of an outcome to each input.

        Parameters
        ----------
        outcome : str
            Name of the outcome.
        indices : bool
            Compute variance-based indices too.

        Returns
        -------
        DataFrame
            A row per input; see `sepmc.analysis.sensitivity.input_sensitivities`.

        Raises
        ------
        ValueError
            If there is no such outcome, it varies by no more than its numerical error, or the run
            stored no case rows.
        """
        if outcome not in self.outcomes:
            raise InputError(f"{outcome}: no such outcome; {nearest(outcome, self.outcomes)}")
        design, correlated = self.campaign.design, self.campaign.correlated
        within = constant_outcomes.max_spread(self.statistics(), outcome)
        return sensitivity.input_sensitivities(
            self._rows(), self._inputs, outcome, design, indices, correlated, within
        )

    def fit(self) -> pd.DataFrame:
        """Fit distributions to every outcome that is not yes or no.

        Returns
        -------
        DataFrame
            A row per outcome; see `sepmc.analysis.distributions.fit_distributions`.

        Raises
        ------
        InputError
            If the run stored no case rows.
        """
        table = self.statistics()
        numbers = [name for name in self.outcomes if not is_yes_or_no(name)]
        constant = [name for name in numbers if constant_outcomes.is_constant(table, name)]
        return distributions.fit_distributions(self._rows(), numbers, constant)

    def causes(self, name: str) -> list[failure_attribution.Attribution]:
        """Find the inputs, and pairs of inputs, whose values distinguish violating cases from the
        others.

        Parameters
        ----------
        name : str
            Name of a requirement; or a status other than ok, whose cases then count as violating.

        Returns
        -------
        list of Attribution
            See `sepmc.analysis.failure_attribution.attribute_violations`.

        Raises
        ------
        InputError
            If there is no such requirement or status, or the run stored no case rows.
        """
        rows, known = self._rows(), {item.name: item for item in self.campaign.file.requirements}
        if name not in known and name not in NOT_OK_LABELS:
            hint = nearest(name, [*known, *NOT_OK_LABELS])
            raise InputError(f"{name}: no such requirement or status; {hint}")
        item = known.get(name) or Requirement(name=name, metric=name)
        others, design = list(known.values()), self.campaign.design
        return failure_attribution.attribute_violations(item, rows, self._inputs, others, design)

    def compare_flight(
        self,
        data: str | Path,
        map: Mapping[str, str] | None = None,
        time: str | None = None,
        shift_s: float | None = None,
        cases: int = FLIGHT_CASES,
        announce: Log | None = None,
    ) -> FlightComparison:
        """Compare the run with the telemetry of a flight; `sepmc.draw_flight` draws it.

        Parameters
        ----------
        data : str or Path
            Text table, Parquet, MATLAB, MDF or TDMS.
        map : mapping of str to str, optional
            Channel of the file by history column, with optional sign, factor and unit:
            ``{"upper_omega_y_deg_s": "-0.5*gyro_z[rad/s]"}``. Default: channels that have the name
            of a column.
        time : str, optional
            Name of the channel of time. Default: a channel called time, t or similar.
        shift_s : float, optional
            Time of the flight's clock at time 0 of the run, s. Default: estimated.
        cases : int
            Number of cases of the envelope: the first ok cases of the run, which are simulated
            again. It is ignored if the run stored these columns over time: the envelope then is
            that of the stored cases.
        announce : callable (str), optional
            Called with messages: how each channel was interpreted, and how many cases the envelope
            has.

        Returns
        -------
        FlightComparison

        Raises
        ------
        InputError
            If the file cannot be read, has no such channel, or does not overlap with the run.
        """
        log, chosen = announce or no_log, check_int("cases", cases, 2, CASES)
        if not isinstance(data, str | Path):
            raise InputError(f"data = {shorten(data)}: must be the path of a file")
        comparison = compare_with_flight(
            self, Path(data), {} if map is None else map, time, shift_s, chosen, log
        )
        for note in comparison.notes if announce is None else ():
            warn(note, RunWarning)
        return comparison

    @property
    def _inputs(self) -> list[str]:
        return [column.name for column in self.campaign.input_columns]

    def case(self, number: int) -> Case:
        """Return a case of the run with the values of all its parameters.

        Parameters
        ----------
        number : int
            Case number, from 0.

        Returns
        -------
        Case
            Its scene is in SI, and has the seed and the number of cases of the run.

        Raises
        ------
        ValueError
            If the case was not run.
        """
        number, numbers = check_int("case", number, 0, CASES - 1), self._finished
        if number not in numbers:
            raise InputError(
                f"case = {number}: must be one of those run, {numbers} (A:B is without B)"
            )
        case = self.campaign.case(number, self.seed, self.total)
        run = msgspec.structs.replace(case.scene.run, cases=self.total, seed=self.seed)
        return replace(case, scene=msgspec.structs.replace(case.scene, run=run))

    @property
    def _finished(self) -> CaseSelection:
        """Cases that were run: those requested or, if the run ended early (``stopped``), those of
        the stored rows; without rows, as many of the lowest numbers as cases are counted."""
        if not self.stopped:
            return self.numbers
        if self.kept.rows is not None:
            return CaseSelection.of(np.asarray(self.kept.rows["case"]))
        return self.numbers.before(sum(self.status_counts.values()))  # in order of case

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
        """Number of cases by status; a status without cases is left out."""
        return {label: count for label, count in self.kept.summary.counts.items() if count}

    def _rows(self) -> Mapping[str, np.ndarray]:
        """Return the case rows, arrays by column. Raises InputError if the run stored none."""
        if self.kept.rows is None:
            raise InputError(
                "this run stored statistics only, so it has no rows; run without stats_only, or "
                "simulate single cases by case(number)"
            )
        return self.kept.rows
