"""Destinations of completed cases: memory, Parquet shards of a run folder, or statistics."""

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
    """Output of a run.

    Attributes
    ----------
    summary : TableStatistics or StreamingStatistics
        Statistics.
    rows : mapping of str to ndarray, optional
        Case table by column; None if only statistics were accumulated.
    histories : mapping of str to ndarray, optional
        Histories by column, in memory.
    history_shards : sequence of Entry
        Shards of histories in the folder.
    """

    summary: TableStatistics | StreamingStatistics
    rows: Mapping[str, np.ndarray] | None = None
    histories: Mapping[str, np.ndarray] | None = None
    history_shards: Sequence[Entry] = ()


class Sink(Protocol):
    """Receives lists of consecutive chunks, from one thread."""

    def take(self, chunks: list[Chunk]) -> None:
        """Add the chunks that come next."""

    def output(self) -> RunOutput:
        """Output of all chunks so far."""


@dataclass
class MemorySink:
    """Keeps all rows in memory; ``separation`` are the columns of stored histories, if any."""

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
        """Statistics, rows and histories."""
        rows = _join(self.chunk_tables)
        return RunOutput(
            TableStatistics(rows, *self.campaign.summary_inputs),
            rows,
            _join(self.histories) if self.histories else None,
        )


@dataclass
class ParquetSink:
    """Writes a shard of cases, and one of histories if there are columns ``separation``, for every
    list of chunks."""

    campaign: Definition
    separation: list[Column]
    folder: Path
    spec: SampleSpec

    def take(self, chunks: list[Chunk]) -> None:
        """Write the shards of chunks and record them in the ledger."""
        shards.record_shards(self.folder, self.write(chunks))

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write a shard of histories, if there are any, then one of cases, which completes the
        range; returns their ledger entries."""
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
        """Statistics and columns of the cases in the folder."""
        columns = shards.CaseColumns(self.folder)
        history_shards = shards.entries(self.folder, folders.HISTORIES)
        summary = summarise(columns, *self.campaign.summary_inputs)
        return RunOutput(summary, columns, history_shards=history_shards)


def _about(campaign: Definition, spec: SampleSpec) -> dict[str, str]:
    """Metadata of a shard on the origin of its cases, from which a run without a manifest is
    repaired."""
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": str(spec.seed),
        "sepmc": __version__,
        "settings": json.dumps(campaign.settings),
    }


@dataclass
class SelectedRowWriter:
    """Writes a shard of the rows that ``selection`` selects from every list of chunks, if there are
    any."""

    campaign: Definition
    folder: Path
    spec: SampleSpec
    selection: RowSelection

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write a shard of the selected rows of chunks; returns its ledger entry in a list, which
        is empty if none is selected."""
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
        """Remove rows that are no longer among the worst, and merge a few rows into one shard."""
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
        """Write the shard, starting at case ``first``, of those ``rows`` that are still selected
        now that all cases are known."""
        reasons = self.selection.final_reasons(rows["case"], rows[REASON.name])
        is_kept = reasons != ""
        selected = {name: values[is_kept] for name, values in rows.items()} | {
            REASON.name: reasons[is_kept]
        }
        return self._write_shard(first, selected)


class StatisticsSink:
    """Accumulates statistics, and passes chunks to ``rows``, which writes selected rows."""

    def __init__(self, campaign: Definition, rows: SelectedRowWriter | None = None):
        self.campaign, self.rows = campaign, rows
        self.stream = StreamingStatistics(*campaign.summary_inputs)

    def take(self, chunks: list[Chunk]) -> None:
        """Add the cases of chunks to the statistics."""
        add_to(self.stream, self.campaign, chunks)
        if self.rows:
            shards.record_shards(self.rows.folder, self.rows.write(chunks))

    def about(self, spec: SampleSpec, summary: BatchSummary) -> dict[str, str]:
        """Metadata of the file of accumulators."""
        keep = self.rows.selection.keep.text if self.rows else ""
        entries = {"numbers": spec.text, "summary": summary.text, "keep": keep}
        return _about(self.campaign, spec) | entries

    def output(self) -> RunOutput:
        """Statistics so far, without rows and histories."""
        return RunOutput(self.stream)


def add_to(
    stream: StreamingStatistics | PartialStatistics, campaign: Definition, chunks: list[Chunk]
) -> None:
    """Add the cases of consecutive chunks, in their order, to statistics."""
    first, count = chunks[0].first, sum(len(chunk.inputs) for chunk in chunks)
    stream.add(np.arange(first, first + count), _codes(chunks), _results(campaign, chunks))


def status_labels(codes: np.ndarray) -> np.ndarray:
    """Labels (n,) of status ``codes`` (n,), as Python strings in an array of objects."""
    return np.array(STATUS_LABELS, dtype=object)[codes]


def _codes(chunks: list[Chunk]) -> np.ndarray:
    return np.concatenate([chunk.block.status for chunk in chunks])


def _results(campaign: Definition, chunks: list[Chunk]) -> np.ndarray:
    """Outcomes and audit columns of chunks in the units of the columns, shape (columns, cases)."""
    scale = np.array([[column.scale] for column in campaign.result_columns])
    results = np.empty((len(scale), sum(len(chunk.inputs) for chunk in chunks)))
    start = 0
    for chunk in chunks:
        end = start + len(chunk.inputs)
        np.multiply(chunk.block.outcomes.T, scale, out=results[:, start:end])
        start = end
    return results


def case_table(campaign: Definition, chunks: list[Chunk]) -> dict[str, Any]:
    """Case table of consecutive chunks: values (n,) by column, in the units of the columns;
    ``status`` is None, to be filled in by the caller."""
    first, results = chunks[0].first, _results(campaign, chunks)
    table: dict[str, Any] = {"case": np.arange(first, first + results.shape[1]), "status": None}
    table |= {
        c.name: np.concatenate([chunk.inputs[:, i] for chunk in chunks])
        for i, c in enumerate(campaign.input_columns)
    }
    return table | dict(zip((c.name for c in campaign.result_columns), results, strict=True))


def _histories(chunks: list[Chunk], separation: list[Column]) -> dict[str, np.ndarray]:
    """Stored histories of chunks by column, in long form: ``case``, ``time_s`` and the columns
    ``separation``, an element for each used history row of each case."""
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
