"""Where flown cases go: kept in memory, written to a run folder, or counted and let go."""

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
from sepmc.campaign.execution.batch import Draws, Piece
from sepmc.campaign.execution.batch_summary import Tally
from sepmc.campaign.store import folders, shards
from sepmc.campaign.store.ledger import Entry
from sepmc.campaign.store.row_selection import WHY, Chosen
from sepmc.schema import Column, Status

_LABELS = [status.label for status in Status]
_IN_ONE_PART = 200_000  # rows that are kept


@dataclass
class Kept:
    """What a run leaves: its statistics, and its rows and histories where they are kept; of a
    folder, the parts that hold histories."""

    summary: TableStatistics | StreamingStatistics
    rows: Mapping[str, np.ndarray] | None = None
    histories: Mapping[str, np.ndarray] | None = None
    history_parts: Sequence[Entry] = ()


class Sink(Protocol):
    """Takes pieces that follow each other without a gap, one list after the other, from one
    thread."""

    def take(self, pieces: list[Piece]) -> None:
        """Take the pieces that come next."""

    def kept(self) -> Kept:
        """What is left of all that was taken."""


@dataclass
class InMemory:
    """Keeps all rows."""

    campaign: Definition
    separation: list[Column]
    parts: list[dict[str, np.ndarray]] = field(default_factory=list)
    histories: list[dict[str, np.ndarray]] = field(default_factory=list)

    def take(self, pieces: list[Piece]) -> None:
        """Keep the rows of the pieces, and their histories if there are any."""
        self.parts.append(
            _table(self.campaign, pieces)
            | {"status": np.array(_LABELS, dtype=object)[_codes(pieces)]}
        )
        if self.separation:
            self.histories.append(_histories(pieces, self.separation))

    def kept(self) -> Kept:
        """Statistics, rows and histories."""
        rows = _join(self.parts)
        return Kept(
            TableStatistics(rows, *self.campaign.summarised),
            rows,
            _join(self.histories) if self.histories else None,
        )


@dataclass
class InFolder:
    """Writes a part of cases, and one of histories, for every list of pieces."""

    campaign: Definition
    separation: list[Column]
    folder: Path
    draws: Draws

    def take(self, pieces: list[Piece]) -> None:
        """Write the parts of pieces, and note them."""
        shards.note_parts(self.folder, self.write(pieces))

    def write(self, pieces: list[Piece]) -> list[Entry]:
        """Write a part of histories, if there are any, and then one of cases, which says what is
        done."""
        campaign, first = self.campaign, pieces[0].first
        count = sum(len(piece.drawn) for piece in pieces)
        about = _about(campaign, self.draws) | {
            "numbers": self.draws.told,
            "tally": sum((piece.tally for piece in pieces), Tally()).text,
        }
        written = []
        if self.separation:
            columns = [
                Column("case", "1", "number of the case"),
                Column("time_s", "s", "time since the start of the case"),
                *self.separation,
            ]
            over_time = _histories(pieces, self.separation)
            written.append(
                shards.write_part(
                    self.folder, folders.HISTORIES, first, count, columns, over_time, about
                )
            )
        table: dict[str, Any] = _table(campaign, pieces) | {
            "status": pd.Categorical.from_codes(_codes(pieces), pd.Index(_LABELS))
        }
        written.append(
            shards.write_part(
                self.folder, folders.CASES, first, count, campaign.columns, table, about
            )
        )
        return written

    def kept(self) -> Kept:
        """Statistics of the folder's cases, and their columns."""
        columns = shards.CaseColumns(self.folder)
        over_time = shards.parts(self.folder, folders.HISTORIES)
        summary = summarise(columns, *self.campaign.summarised)
        return Kept(summary, columns, history_parts=over_time)


def _about(campaign: Definition, draws: Draws) -> dict[str, str]:
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
class KeptRows:
    """Writes a part of those rows that are kept of every list of pieces, if there are any."""

    campaign: Definition
    folder: Path
    draws: Draws
    chosen: Chosen

    def write(self, pieces: list[Piece]) -> list[Entry]:
        """Write the part of pieces."""
        status = {"status": np.array(_LABELS, dtype=object)[_codes(pieces)]}
        table = _table(self.campaign, pieces) | status
        places, why = self.chosen.choose(table)
        if not len(places):
            return []
        kept = {name: values[places] for name, values in table.items()} | {WHY.name: why}
        return [self._part(pieces[0].first, kept)]

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


class InStatistics:
    """Counts cases and lets them go, but for rows that are ``kept``."""

    def __init__(self, campaign: Definition, kept: KeptRows | None = None):
        self.campaign, self.rows = campaign, kept
        self.stream = StreamingStatistics(*campaign.summarised)

    def take(self, pieces: list[Piece]) -> None:
        """Add the cases of the pieces to the statistics."""
        add_to(self.stream, self.campaign, pieces)
        if self.rows:
            shards.note_parts(self.rows.folder, self.rows.write(pieces))

    def about(self, draws: Draws, tally: Tally) -> dict[str, str]:
        """What a file says of itself that holds the statistics."""
        keep = self.rows.chosen.keep.text if self.rows else ""
        told = {"numbers": draws.told, "tally": tally.text, "keep": keep}
        return _about(self.campaign, draws) | told

    def kept(self) -> Kept:
        """The statistics alone."""
        return Kept(self.stream)


def add_to(
    stream: StreamingStatistics | PartialStatistics, campaign: Definition, pieces: list[Piece]
) -> None:
    """Add the cases of pieces to statistics."""
    first, count = pieces[0].first, sum(len(piece.drawn) for piece in pieces)
    stream.add(np.arange(first, first + count), _codes(pieces), _results(campaign, pieces))


def _codes(pieces: list[Piece]) -> np.ndarray:
    return np.concatenate([piece.block.status for piece in pieces])


def _results(campaign: Definition, pieces: list[Piece]) -> np.ndarray:
    """Outcomes and audit columns in their units, shape (columns, cases), each column contiguous."""
    scale = np.array([[column.scale] for column in campaign.result_columns])
    results = np.empty((len(scale), sum(len(piece.drawn) for piece in pieces)))
    start = 0
    for piece in pieces:
        end = start + len(piece.drawn)
        np.multiply(piece.block.outcomes.T, scale, out=results[:, start:end])
        start = end
    return results


def _table(campaign: Definition, pieces: list[Piece]) -> dict[str, Any]:
    """The case table of pieces, its status still to be put in."""
    first, results = pieces[0].first, _results(campaign, pieces)
    table: dict[str, Any] = {"case": np.arange(first, first + results.shape[1]), "status": None}
    table |= {
        c.name: np.concatenate([piece.drawn[:, i] for piece in pieces])
        for i, c in enumerate(campaign.input_columns)
    }
    return table | dict(zip((c.name for c in campaign.result_columns), results, strict=True))


def _histories(pieces: list[Piece], separation: list[Column]) -> dict[str, np.ndarray]:
    """Separation over time of pieces, in long form: the rows that each case has."""
    found = {
        name: np.empty(sum(int(piece.block.rows.sum()) for piece in pieces))
        for name in ("time_s", *(c.name for c in separation))
    }
    numbers = np.concatenate(
        [
            np.repeat(np.arange(first, first + len(drawn)), block.rows)
            for first, drawn, block, _ in pieces
        ]
    )
    start = 0
    for _, _, block, _ in pieces:
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
