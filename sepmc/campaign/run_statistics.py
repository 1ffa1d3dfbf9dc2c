"""Statistics and verdicts of a run, and the files with them in the run folder."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from sepmc.analysis.constant_outcomes import collapse_constant
from sepmc.analysis.requirements import Verdict
from sepmc.analysis.row_statistics import TableStatistics, summarise
from sepmc.analysis.stored_statistics import histogram_table
from sepmc.analysis.streaming import StreamingStatistics
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import with_errors, with_scales
from sepmc.campaign.store import manifests, result_files, shards
from sepmc.campaign.store.untrusted import StoreError


@dataclass(frozen=True)
class RunStatistics:
    """Statistics, audit and verdicts of a run.

    Parameters
    ----------
    summary : TableStatistics or StreamingStatistics
        Source of the statistics.
    table : DataFrame, a row per outcome
        Statistics with numerical errors, and the reference values of the campaign if any.
    audit : DataFrame, a row per audit column
        Worst value, its case, its bound and the number of cases beyond it
        (`sepmc.analysis.statistics.audit`).
    verdicts : list of Verdict
        One per requirement.
    manifest : mapping
        Manifest of the run.
    """

    summary: TableStatistics | StreamingStatistics
    table: pd.DataFrame
    audit: pd.DataFrame
    verdicts: list[Verdict]
    manifest: Mapping[str, Any]

    @property
    def accuracy(self) -> Mapping[str, Any]:
        """Entry ``accuracy`` of the manifest: the steps and the numerical error of the run; empty
        if the manifest has none."""
        return self.manifest.get("accuracy") or {}

    def as_json(self, units: dict[str, str], table: pd.DataFrame | None = None) -> dict[str, Any]:
        """Return the content of ``statistics.json``. ``units`` are those of the outcomes, by name;
        ``table`` has the rows of the statistics to write, all if None."""
        return result_files.statistics_as_json(
            self.table if table is None else table,
            self.summary.counts,
            units,
            self.audit,
            self.summary.failed,
            [verdict.to_dict() for verdict in self.verdicts],
            self.manifest.get("rarely_drawn", ()),
        )


def numerical_errors(accuracy: Mapping[str, Any]) -> dict[str, float]:
    """Return the relative numerical error by outcome (`sepmc.campaign.execution.accuracy.errors`
    says relative to what), from the entry ``accuracy`` of a manifest. None there stands for
    infinity; without errors in it the result is empty."""
    errors = accuracy.get("errors", {})
    return {name: math.inf if error is None else error for name, error in errors.items()}


def evaluate(
    campaign: Definition,
    summary: TableStatistics | StreamingStatistics,
    manifest: Mapping[str, Any],
    with_reference: bool = True,
) -> RunStatistics:
    """Compute statistics, audit and verdicts of a run.

    Parameters
    ----------
    campaign : Definition
        Its requirements are judged; its ``run.sampler`` must be that of the run.
    summary : TableStatistics or StreamingStatistics
        Summary of all cases of the run, or of some of them.
    manifest : mapping
        Manifest of the run, which gives the numerical errors.
    with_reference : bool
        Add the reference values of the campaign to the table of statistics.

    Returns
    -------
    RunStatistics
    """
    errors = numerical_errors(manifest.get("accuracy") or {})
    table = summary.statistics(campaign.reference if with_reference else None)
    table, audit = with_errors(campaign, errors, table), summary.audit()
    scaled = with_scales(campaign, errors, table)
    verdicts = summary.verdicts(scaled, audit, campaign.scene.run.sampler)
    return RunStatistics(summary, table, audit, verdicts, manifest)


def read_summary(folder: Path, campaign: Definition) -> TableStatistics | StreamingStatistics:
    """Summarise the case rows of a run folder, as `evaluate` needs it; of many rows percentiles are
    those of a sketch (`sepmc.analysis.row_statistics.summarise`).

    Raises
    ------
    StoreError
        If the rows lack a column of the campaign.
    """
    cases = shards.CaseColumns(folder)
    names = ("case", "status", *campaign.summary_inputs[0])
    if missing := [name for name in names if name not in cases]:
        raise StoreError(
            f"{folder}: its cases have no column {missing[0]}: they were run by another version "
            "of sepmc, or changed; run them again"
        )
    return summarise(cases, *campaign.summary_inputs)


def read_run(folder: Path, campaign: Definition) -> RunStatistics:
    """Compute statistics, audit and verdicts of a run folder from its case rows. Raises StoreError
    if its manifest or rows cannot be used."""
    manifest = manifests.read_manifest(folder)
    return evaluate(campaign, read_summary(folder, campaign), manifest)


def write(
    folder: Path, campaign: Definition, summary: TableStatistics | StreamingStatistics
) -> RunStatistics:
    """Evaluate a run, and write the results into its folder: ``statistics.csv``,
    ``statistics.json``, and, if the run stores no rows of all cases, ``histograms.csv``. The files
    are entered into the ledger of the folder.

    ``summary`` has the statistics of all cases of the run. Returns the statistics, audit and
    verdicts written.

    Raises
    ------
    StoreError
        If the manifest cannot be used, or the files cannot be written.
    """
    run = evaluate(campaign, summary, manifests.read_manifest(folder))
    units = {column.name: column.unit for column in campaign.outcome_columns}
    written = [folder / "statistics.csv", folder / "statistics.json"]
    try:
        result_files.write_statistics(folder, run.table, units, run.as_json(units))
        if run.manifest.get("stats_only"):
            names = map(str, run.table.index)
            bins = histogram_table(
                {
                    name: collapse_constant(summary.histogram(name), run.table, name)
                    for name in names
                }
            )
            written.append(result_files.write_histograms(folder, bins))
        manifests.record_derived(folder, written)
    except OSError as error:
        reason = error.strerror or error
        raise StoreError(f"{folder}: cannot be written: {reason}") from None
    return run
