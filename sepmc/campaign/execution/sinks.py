"""Sinks, the destinations of completed cases: memory, Parquet files (shards) of a run folder, or
statistics."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from sepmc import __version__
from sepmc.analysis.row_statistics import TableStatistics, summarise
from sepmc.analysis.streaming import PartialStatistics, StreamingStatistics
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.chunk import Chunk, SampleSpec
from sepmc.campaign.store import folders, shards
from sepmc.campaign.store.ledger import Entry
from sepmc.campaign.store.row_selection import REASON, RowSelection
from sepmc.schema import STATUS_LABELS, Column

_ROWS_OF_A_SHARD = 200_000  # of selected rows: up to this many go into one shard


@dataclass
class RunOutput:
    """Statistics, case rows and histories that a run has so far.

    Attributes
    ----------
    summary : TableStatistics or StreamingStatistics
        Statistics of the cases.
    rows : mapping of str to ndarray, optional
        Values of the case table by column; None if only statistics were accumulated.
    histories : mapping of str to ndarray, optional
        Histories by column, if they are in memory; None if not, or if there are none.
    history_shards : sequence of Entry
        Ledger entries of the Parquet files of histories, if they are in a folder.
    """

    summary: TableStatistics | StreamingStatistics
    rows: Mapping[str, np.ndarray] | None = None
    histories: Mapping[str, np.ndarray] | None = None
    history_shards: Sequence[Entry] = ()


class Sink(Protocol):
    """Destination of completed cases: receives lists of consecutive chunks, from one thread at a
    time."""

    def take(self, chunks: list[Chunk]) -> None:
        """Store the next chunks, whose cases are consecutive."""

    def output(self) -> RunOutput:
        """Statistics, rows and histories of all chunks so far; None for what the sink does not
        keep."""


@dataclass
class MemorySink:
    """Sink that keeps the rows of all cases of a campaign in memory, and their histories if there
    are columns of these, ``separation`` (empty: no histories).

    ``chunk_tables`` and ``histories`` have a dict of arrays by column for each call of `take`."""

    campaign: Definition
    separation: list[Column]
    chunk_tables: list[dict[str, np.ndarray]] = field(default_factory=list)
    histories: list[dict[str, np.ndarray]] = field(default_factory=list)

    def take(self, chunks: list[Chunk]) -> None:
        """Append the rows of chunks, and their histories if there are any."""
        self.chunk_tables.append(
            case_table(self.campaign, chunks) | {"status": status_labels(_codes(chunks))}
        )
        if self.separation:
            self.histories.append(_histories(chunks, self.separation))

    def output(self) -> RunOutput:
        """Statistics, rows and histories of all cases so far; ``histories`` of the result is None
        if the sink has no columns of them."""
        rows = _join(self.chunk_tables)
        return RunOutput(
            TableStatistics(rows, *self.campaign.summary_inputs),
            rows,
            _join(self.histories) if self.histories else None,
        )


@dataclass
class ParquetSink:
    """Sink that writes a Parquet file (shard) of case rows into the run folder for every list of
    chunks, and one of histories if there are columns of these, ``separation``.

    ``campaign`` gives the columns of the rows; ``campaign`` and ``spec`` (seed and wanted cases)
    are also stated in the metadata of every shard."""

    campaign: Definition
    separation: list[Column]
    folder: Path
    spec: SampleSpec

    def take(self, chunks: list[Chunk]) -> None:
        """Write the shards of chunks and record them in the ledger."""
        shards.record_shards(self.folder, self.write(chunks))

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write a shard of histories, if there are any, and then one of case rows.

        ``chunks`` are at least one, with consecutive cases. Returns the ledger entries of the
        shards, in this order, which the caller has to record: only then they belong to the run."""
        campaign, first = self.campaign, chunks[0].first
        count = sum(len(chunk.inputs) for chunk in chunks)
        about = _about(campaign, self.spec) | {
            "numbers": self.spec.text,
            "summary": sum((chunk.summary for chunk in chunks), BatchSummary()).text,
        }
        written = []
        if self.separation:
            columns = [
                Column("case", "1", "number of the case"),
                Column("time_s", "s", "time since the start of the case"),
                *self.separation,
            ]
            histories = _histories(chunks, self.separation)
            written.append(
                shards.write_shard(
                    self.folder, folders.HISTORIES, first, count, columns, histories, about
                )
            )
        table: dict[str, Any] = case_table(campaign, chunks) | {
            "status": pd.Categorical.from_codes(_codes(chunks), pd.Index(STATUS_LABELS))
        }
        written.append(
            shards.write_shard(
                self.folder, folders.CASES, first, count, campaign.columns, table, about
            )
        )
        return written

    def output(self) -> RunOutput:
        """Statistics and rows of all cases in the folder, and ledger entries of the shards of
        their histories. Raises StoreError if there are no cases."""
        columns = shards.CaseColumns(self.folder)
        history_shards = shards.entries(self.folder, folders.HISTORIES)
        summary = summarise(columns, *self.campaign.summary_inputs)
        return RunOutput(summary, columns, history_shards=history_shards)


def _about(campaign: Definition, spec: SampleSpec) -> dict[str, str]:
    """Metadata of a shard, texts by key: name, digest and changed settings (as JSON) of the
    campaign of its cases, their seed, and the version of sepmc. With them a run folder without its
    manifest can be repaired."""
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": str(spec.seed),
        "sepmc": __version__,
        "settings": json.dumps(campaign.settings),
    }


@dataclass
class SelectedRowWriter:
    """Writes the rows that the rules of ``selection`` select from every list of chunks into a shard
    of the run folder, for a run that otherwise stores statistics only.

    ``campaign`` and ``spec`` (seed and wanted cases) are stated in the metadata of every shard."""

    campaign: Definition
    folder: Path
    spec: SampleSpec
    selection: RowSelection

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write a shard of the selected rows of chunks; return a list with its ledger entry, which
        the caller has to record. The list is empty, and no shard is written, if no row is
        selected. The worst cases are those of all chunks so far, so later ones may be worse."""
        status = {"status": status_labels(_codes(chunks))}
        table = case_table(self.campaign, chunks) | status
        positions, reasons = self.selection.choose(table)
        if not len(positions):
            return []
        selected = {name: values[positions] for name, values in table.items()} | {
            REASON.name: reasons
        }
        return [self._write_shard(chunks[0].first, selected)]

    def _write_shard(self, first: int, selected: dict[str, np.ndarray]) -> Entry:
        keep, campaign = self.selection.keep, self.campaign
        columns = keep.columns([*campaign.columns, REASON])
        if keep.single:
            selected = {
                name: values.astype(np.float32) if values.dtype == np.float64 else values
                for name, values in selected.items()
            }
        about = _about(campaign, self.spec) | {"numbers": self.spec.text, "keep": keep.text}
        count = len(selected["case"])
        return shards.write_shard(
            self.folder, folders.SELECTED, first, count, columns, selected, about
        )

    def finish(self) -> None:
        """Rewrite the saved rows when all cases are known: without those that were among the worst
        only for a time, and in one shard if they are at most 200,000. Raises StoreError if a shard
        of saved rows is damaged."""
        entries = shards.entries(self.folder, folders.SELECTED)
        if sum(entry.cases for entry in entries) <= _ROWS_OF_A_SHARD:
            rows = (
                _join([shards.read_shard(self.folder, entry) for entry in entries])
                if entries
                else {}
            )
            if rows:
                shards.replace_shards(self.folder, folders.SELECTED, [self._write_final(0, rows)])
        elif self.selection.keep.worst:
            final = (self._write_final(e.first, shards.read_shard(self.folder, e)) for e in entries)
            shards.replace_shards(self.folder, folders.SELECTED, final)

    def _write_final(self, first: int, rows: dict[str, np.ndarray]) -> Entry:
        """Write a shard of those of the ``rows`` (by column) that are still selected when all cases
        are known; return its ledger entry. ``first``, a case number, is part of its file name. If
        none is selected, the shard has no rows."""
        reasons = self.selection.final_reasons(rows["case"], rows[REASON.name])
        is_kept = reasons != ""
        selected = {name: values[is_kept] for name, values in rows.items()} | {
            REASON.name: reasons[is_kept]
        }
        return self._write_shard(first, selected)


class StatisticsSink:
    """Sink that accumulates statistics in memory, stores no rows, and passes the chunks on to
    ``rows``, if given, which saves selected rows."""

    def __init__(self, campaign: Definition, rows: SelectedRowWriter | None = None):
        self.campaign, self.rows = campaign, rows
        self.stream = StreamingStatistics(*campaign.summary_inputs)

    def take(self, chunks: list[Chunk]) -> None:
        """Add the cases of chunks to the statistics, and save the selected rows among them."""
        add_to(self.stream, self.campaign, chunks)
        if self.rows:
            shards.record_shards(self.rows.folder, self.rows.write(chunks))

    def about(self, spec: SampleSpec, summary: BatchSummary) -> dict[str, str]:
        """Metadata of the file that stores the accumulated statistics, texts by key: origin of the
        cases (`_about`), their case numbers (such as ``25:50,73``, which is 25 to 49, and 73; empty
        if they are all cases of the sample), ``summary``, and rules for saved rows."""
        keep = self.rows.selection.keep.text if self.rows else ""
        entries = {"numbers": spec.text, "summary": summary.text, "keep": keep}
        return _about(self.campaign, spec) | entries

    def output(self) -> RunOutput:
        """Statistics so far; rows and histories are None."""
        return RunOutput(self.stream)


def add_to(
    stream: StreamingStatistics | PartialStatistics, campaign: Definition, chunks: list[Chunk]
) -> None:
    """Add the cases of consecutive chunks, in their order, to the statistics ``stream``."""
    first, count = chunks[0].first, sum(len(chunk.inputs) for chunk in chunks)
    stream.add(np.arange(first, first + count), _codes(chunks), _results(campaign, chunks))


def status_labels(codes: np.ndarray) -> np.ndarray:
    """Labels (n,) of status ``codes`` (n,), such as "ok", as Python strings in an object array."""
    return np.array(STATUS_LABELS, dtype=object)[codes]


def _codes(chunks: list[Chunk]) -> np.ndarray:
    return np.concatenate([chunk.block.status for chunk in chunks])


def _results(campaign: Definition, chunks: list[Chunk]) -> np.ndarray:
    """Outcomes and audit columns of all cases of the chunks, in the units of their columns, shape
    (columns, cases)."""
    scale = np.array([[column.scale] for column in campaign.result_columns])
    results = np.empty((len(scale), sum(len(chunk.inputs) for chunk in chunks)))
    start = 0
    for chunk in chunks:
        end = start + len(chunk.inputs)
        np.multiply(chunk.block.outcomes.T, scale, out=results[:, start:end])
        start = end
    return results


def case_table(campaign: Definition, chunks: list[Chunk]) -> dict[str, Any]:
    """Case table of the n cases of consecutive chunks: values (n,) by column, in the units of the
    columns. Inputs are copied, as chunks have them in these units; results are converted from SI.
    The value of ``status`` is None, to be replaced by the caller."""
    first, results = chunks[0].first, _results(campaign, chunks)
    table: dict[str, Any] = {"case": np.arange(first, first + results.shape[1]), "status": None}
    table |= {
        c.name: np.concatenate([chunk.inputs[:, i] for chunk in chunks])
        for i, c in enumerate(campaign.input_columns)
    }
    return table | dict(zip((c.name for c in campaign.result_columns), results, strict=True))


def _histories(chunks: list[Chunk], separation: list[Column]) -> dict[str, np.ndarray]:
    """Histories of all cases of the chunks in long form: by column, an array with an element for
    each valid history row of each case. The columns are ``case``, ``time_s`` and those in
    ``separation``, in their units."""
    histories = {
        name: np.empty(sum(int(chunk.block.rows.sum()) for chunk in chunks))
        for name in ("time_s", *(c.name for c in separation))
    }
    numbers = np.concatenate(
        [
            np.repeat(np.arange(first, first + len(inputs)), block.rows)
            for first, inputs, block, _ in chunks
        ]
    )
    start = 0
    for _, _, block, _ in chunks:
        n, history_size = block.times.shape
        times, history = block.times.ravel(), block.history.reshape(n * history_size, -1)
        if not (block.rows == history_size).all():
            used = np.flatnonzero((np.arange(history_size) < block.rows[:, None]).ravel())
            times, history = times[used], history[used]
        rows = slice(start, start + len(times))
        histories["time_s"][rows] = times
        for i, column in enumerate(separation):
            np.multiply(history[:, i], column.scale, out=histories[column.name][rows])
        start = rows.stop
    return {"case": numbers, **histories}


def _join(tables: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return (
        tables[0]
        if len(tables) == 1
        else {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    )
