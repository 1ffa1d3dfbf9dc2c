"""Where flown cases go: kept in memory, written to a run folder, or counted and let go."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from sepmc import __version__
from sepmc.analysis.row_statistics import Rows, summarise
from sepmc.analysis.streaming import Apart, Stream
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.chunk import Chunk, SampleSpec
from sepmc.campaign.store import folders, shards
from sepmc.campaign.store.ledger import Entry
from sepmc.campaign.store.row_selection import WHY, RowSelection
from sepmc.schema import Column, Status

_LABELS = [status.label for status in Status]
_IN_ONE_PART = 200_000  # rows that are kept


@dataclass
class RunOutput:
    """What a run leaves: its statistics, and its rows and histories where they are kept; of a
    folder, the parts that hold histories."""

    summary: Rows | Stream
    rows: Mapping[str, np.ndarray] | None = None
    histories: Mapping[str, np.ndarray] | None = None
    history_parts: Sequence[Entry] = ()


class Sink(Protocol):
    """Takes chunks that follow each other without a gap, one list after the other, from one
    thread."""

    def take(self, chunks: list[Chunk]) -> None:
        """Take the chunks that come next."""

    def kept(self) -> RunOutput:
        """What is left of all that was taken."""


@dataclass
class MemorySink:
    """Keeps all rows."""

    campaign: Definition
    separation: list[Column]
    parts: list[dict[str, np.ndarray]] = field(default_factory=list)
    histories: list[dict[str, np.ndarray]] = field(default_factory=list)

    def take(self, chunks: list[Chunk]) -> None:
        """Keep the rows of the chunks, and their histories if there are any."""
        self.parts.append(
            _table(self.campaign, chunks)
            | {"status": np.array(_LABELS, dtype=object)[_codes(chunks)]}
        )
        if self.separation:
            self.histories.append(_histories(chunks, self.separation))

    def kept(self) -> RunOutput:
        """Statistics, rows and histories."""
        rows = _join(self.parts)
        return RunOutput(
            Rows(rows, *self.campaign.summarised),
            rows,
            _join(self.histories) if self.histories else None,
        )


@dataclass
class ParquetSink:
    """Writes a part of cases, and one of histories, for every list of chunks."""

    campaign: Definition
    separation: list[Column]
    folder: Path
    draws: SampleSpec

    def take(self, chunks: list[Chunk]) -> None:
        """Write the parts of chunks, and note them."""
        shards.note_parts(self.folder, self.write(chunks))

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write a part of histories, if there are any, and then one of cases, which says what is
        done."""
        campaign, first = self.campaign, chunks[0].first
        count = sum(len(chunk.drawn) for chunk in chunks)
        about = _about(campaign, self.draws) | {
            "numbers": self.draws.told,
            "tally": sum((chunk.tally for chunk in chunks), BatchSummary()).text,
        }
        written = []
        if self.separation:
            columns = [
                Column("case", "1", "number of the case"),
                Column("time_s", "s", "time since the start of the case"),
                *self.separation,
            ]
            over_time = _histories(chunks, self.separation)
            written.append(
                shards.write_part(
                    self.folder, folders.HISTORIES, first, count, columns, over_time, about
                )
            )
        table: dict[str, Any] = _table(campaign, chunks) | {
            "status": pd.Categorical.from_codes(_codes(chunks), pd.Index(_LABELS))
        }
        written.append(
            shards.write_part(
                self.folder, folders.CASES, first, count, campaign.columns, table, about
            )
        )
        return written

    def kept(self) -> RunOutput:
        """Statistics of the folder's cases, and their columns."""
        columns = shards.CaseColumns(self.folder)
        over_time = shards.parts(self.folder, folders.HISTORIES)
        summary = summarise(columns, *self.campaign.summarised)
        return RunOutput(summary, columns, history_parts=over_time)


def _about(campaign: Definition, draws: SampleSpec) -> dict[str, str]:
    """By what the cases of a part were made: what a run is mended by, should its manifest be
    lost."""
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": str(draws.seed),
        "sepmc": __version__,
        "settings": json.dumps(campaign.settings),
    }


@dataclass
class SelectedRowWriter:
    """Writes a part of those rows that are kept of every list of chunks, if there are any."""

    campaign: Definition
    folder: Path
    draws: SampleSpec
    chosen: RowSelection

    def write(self, chunks: list[Chunk]) -> list[Entry]:
        """Write the part of chunks."""
        status = {"status": np.array(_LABELS, dtype=object)[_codes(chunks)]}
        table = _table(self.campaign, chunks) | status
        places, why = self.chosen.choose(table)
        if not len(places):
            return []
        kept = {name: values[places] for name, values in table.items()} | {WHY.name: why}
        return [self._part(chunks[0].first, kept)]

    def _part(self, first: int, kept: dict[str, np.ndarray]) -> Entry:
        keep, campaign = self.chosen.keep, self.campaign
        columns = keep.columns([*campaign.columns, WHY])
        if keep.single:
            kept = {
                name: values.astype(np.float32) if values.dtype == np.float64 else values
                for name, values in kept.items()
            }
        about = _about(campaign, self.draws) | {"numbers": self.draws.told, "keep": keep.text}
        count = len(kept["case"])
        return shards.write_part(self.folder, folders.KEPT, first, count, columns, kept, about)

    def finish(self) -> None:
        """Let go of rows that turned out not to be among the worst, and put few rows into one
        part."""
        parts = shards.parts(self.folder, folders.KEPT)
        if sum(part.cases for part in parts) <= _IN_ONE_PART:
            rows = _join([shards.read_part(self.folder, part) for part in parts]) if parts else {}
            if rows:
                shards.replace_parts(self.folder, folders.KEPT, [self._still(0, rows)])
        elif self.chosen.keep.worst:
            kept = (self._still(part.first, shards.read_part(self.folder, part)) for part in parts)
            shards.replace_parts(self.folder, folders.KEPT, kept)

    def _still(self, first: int, rows: dict[str, np.ndarray]) -> Entry:
        """Write the part of those rows that are kept still."""
        why = self.chosen.still(rows["case"], rows[WHY.name])
        there = why != ""
        kept = {name: values[there] for name, values in rows.items()} | {WHY.name: why[there]}
        return self._part(first, kept)


class StatisticsSink:
    """Counts cases and lets them go, but for rows that are ``kept``."""

    def __init__(self, campaign: Definition, kept: SelectedRowWriter | None = None):
        self.campaign, self.rows = campaign, kept
        self.stream = Stream(*campaign.summarised)

    def take(self, chunks: list[Chunk]) -> None:
        """Add the cases of the chunks to the statistics."""
        add_to(self.stream, self.campaign, chunks)
        if self.rows:
            shards.note_parts(self.rows.folder, self.rows.write(chunks))

    def about(self, draws: SampleSpec, tally: BatchSummary) -> dict[str, str]:
        """What a file says of itself that holds the statistics."""
        keep = self.rows.chosen.keep.text if self.rows else ""
        told = {"numbers": draws.told, "tally": tally.text, "keep": keep}
        return _about(self.campaign, draws) | told

    def kept(self) -> RunOutput:
        """The statistics alone."""
        return RunOutput(self.stream)


def add_to(stream: Stream | Apart, campaign: Definition, chunks: list[Chunk]) -> None:
    """Add the cases of chunks to statistics."""
    first, count = chunks[0].first, sum(len(chunk.drawn) for chunk in chunks)
    stream.add(np.arange(first, first + count), _codes(chunks), _results(campaign, chunks))


def _codes(chunks: list[Chunk]) -> np.ndarray:
    return np.concatenate([chunk.block.status for chunk in chunks])


def _results(campaign: Definition, chunks: list[Chunk]) -> np.ndarray:
    """Outcomes and audit columns in their units, shape (columns, cases), each column contiguous."""
    scale = np.array([[column.scale] for column in campaign.result_columns])
    results = np.empty((len(scale), sum(len(chunk.drawn) for chunk in chunks)))
    start = 0
    for chunk in chunks:
        end = start + len(chunk.drawn)
        np.multiply(chunk.block.outcomes.T, scale, out=results[:, start:end])
        start = end
    return results


def _table(campaign: Definition, chunks: list[Chunk]) -> dict[str, Any]:
    """The case table of chunks, its status still to be put in."""
    first, results = chunks[0].first, _results(campaign, chunks)
    table: dict[str, Any] = {"case": np.arange(first, first + results.shape[1]), "status": None}
    table |= {
        c.name: np.concatenate([chunk.drawn[:, i] for chunk in chunks])
        for i, c in enumerate(campaign.input_columns)
    }
    return table | dict(zip((c.name for c in campaign.result_columns), results, strict=True))


def _histories(chunks: list[Chunk], separation: list[Column]) -> dict[str, np.ndarray]:
    """Separation over time of chunks, in long form: the rows that each case has."""
    found = {
        name: np.empty(sum(int(chunk.block.rows.sum()) for chunk in chunks))
        for name in ("time_s", *(c.name for c in separation))
    }
    numbers = np.concatenate(
        [
            np.repeat(np.arange(first, first + len(drawn)), block.rows)
            for first, drawn, block, _ in chunks
        ]
    )
    start = 0
    for _, _, block, _ in chunks:
        n, room = block.times.shape
        times, history = block.times.ravel(), block.history.reshape(n * room, -1)
        if not (block.rows == room).all():
            kept = np.flatnonzero((np.arange(room) < block.rows[:, None]).ravel())
            times, history = times[kept], history[kept]
        part = slice(start, start + len(times))
        found["time_s"][part] = times
        for i, column in enumerate(separation):
            np.multiply(history[:, i], column.scale, out=found[column.name][part])
        start = part.stop
    return {"case": numbers, **found}


def _join(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return (
        parts[0]
        if len(parts) == 1
        else {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    )
