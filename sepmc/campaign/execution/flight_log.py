"""Log of the flights of a rare-event estimate, from which an interrupted one is resumed.

The estimate asks for flights in an order that its seed decides. What was flown is written as it
comes; a resumed estimate asks again and is answered from the log, until that ends.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.batch_summary import read as read_tally
from sepmc.campaign.store import folders, ledger, manifests, shards
from sepmc.campaign.store.folders import StoreError
from sepmc.paths import is_local
from sepmc.schema import Column
from sepmc.wording import another_place

_SAVE_S = 10.0  # from one writing to the next
_SAVE_NUMBERS = 8_000_000  # so many that wait (64 MB) are written before that
_VALUE = Column("value", "", "margins, then rows, of one batch after the other")

Batch = tuple[np.ndarray, np.ndarray]  # margins (n,) and rows (n, k): inputs, status, results


class FlightLog:
    """Batches of flights of an estimate, in order, in the folder of its run.

    Parameters
    ----------
    folder : Path
        Open for writing.
    width : int
        Columns k of a row.
    inputs : int
        How many of these, the first, are inputs.
    about : dict of str
        Stands in every shard: the campaign, its digest, the seed.
    resume : bool
        Answer from what the folder holds.
    """

    def __init__(self, folder: Path, width: int, inputs: int, about: dict[str, str], resume: bool):
        self.folder, self.width, self.inputs, self.about = folder, width, inputs, about
        self.tally = BatchSummary()  # of all batches that were answered or added
        self.count = self.resumed = 0  # flights that were answered or written; answered
        self._written: list[ledger.Entry] = []
        self._shards = _whole_shards(folder) if resume else []
        self._batches: list[Batch] = []  # of the shard that answers
        self._next_tally = BatchSummary()  # that at its end
        self._waiting: list[Batch] = []
        self._saved = time.monotonic()

    def answer(self, drawn: np.ndarray) -> Batch | None:
        """The batch that was flown of these inputs (n, d); None if the log ends here. Raises
        StoreError if it holds another one."""
        if not self._batches and self._shards:
            shard = self._shards.pop(0)
            self._batches, self._next_tally = self._read(shard)
            self._written.append(shard)
        if not self._batches:
            return None
        margin, rows = self._batches.pop(0)
        if not np.array_equal(rows[:, : self.inputs], drawn, equal_nan=True):
            raise StoreError(
                f"{self.folder}: its flights are not those of this estimate; {another_place()}"
            )
        self.count += len(rows)
        self.resumed += len(rows)
        if not self._batches:
            self.tally = self._next_tally
        return margin, rows

    def add(self, margin: np.ndarray, rows: np.ndarray, tally: BatchSummary) -> None:
        """Add a batch that was flown; ``tally`` is that of all flights so far."""
        self._waiting.append((margin, rows))
        self.tally = tally
        waits = sum(rows.size for _, rows in self._waiting)
        if waits > _SAVE_NUMBERS or time.monotonic() - self._saved > _SAVE_S:
            self.save()

    def save(self) -> None:
        """Write the batches that wait. What was not asked for again stays as it is."""
        if not self._waiting:
            return
        flights = sum(len(rows) for _, rows in self._waiting)
        values = [part.ravel() for batch in self._waiting for part in batch]
        path = shards.part_path(self.folder, folders.COUNTED, self.count)
        about = self.about | {
            "lengths": json.dumps([len(rows) for _, rows in self._waiting]),
            "tally": self.tally.text,
        }
        content = shards.write_parquet(path, [_VALUE], {"value": np.concatenate(values)}, about)
        name = f"{folders.COUNTED}/{path.name}"
        self._written.append(ledger.entry(name, content, self.count, flights))
        shards.replace_parts(self.folder, folders.COUNTED, self._written)
        self.count += flights
        self._waiting, self._saved = [], time.monotonic()

    def remove(self) -> None:
        """Remove the log: the estimate is complete."""
        shards.replace_parts(self.folder, folders.COUNTED, [])
        logged = self.folder / folders.COUNTED
        if is_local(logged) and logged.is_dir():
            logged.rmdir()

    def _read(self, shard: ledger.Entry) -> tuple[list[Batch], BatchSummary]:
        """Batches of a shard, and the tally of all flights up to its end."""
        path = self.folder / shard.file
        _, about = shards.about(path)
        values = shards.read_table(path, ["value"])["value"].to_numpy()
        try:
            lengths = [int(n) for n in json.loads(about[b"lengths"])]
            tally = read_tally(about[b"tally"])
            if min(lengths) < 0 or sum(lengths) * (1 + self.width) != len(values):
                raise ValueError("its batches have other lengths")
        except (KeyError, TypeError, ValueError) as error:
            raise StoreError(f"{path}: cannot be read: {error}") from None
        batches, at = [], 0
        for n in lengths:
            margin, rows = np.split(values[at : at + n * (1 + self.width)], [n])
            batches.append((margin, rows.reshape(n, self.width)))
            at += n * (1 + self.width)
        return batches, tally


def _whole_shards(folder: Path) -> list[ledger.Entry]:
    """Shards that follow each other without a gap, from the first on, as they were written."""
    found: list[ledger.Entry] = []
    end = 0
    for shard in shards.parts(folder, folders.COUNTED):
        if shard.first != end or shards.fault_of(folder, shard):
            break
        found.append(shard)
        end += shard.cases
    return found


def interrupted(folder: Path, asked: dict[str, Any]) -> list[dict[str, Any]]:
    """Sessions of the interrupted estimate in a folder; none if it holds no run. Raises StoreError
    unless it is an estimate of what is ``asked``, by the keys of its manifest."""
    if not folders.is_run(folder):
        return []
    manifest = manifests.read_manifest(folder)
    ways = another_place()
    if "rare" not in manifest:
        raise StoreError(f"{folder}: holds no estimate of a rare event, so none is resumed; {ways}")
    if manifest.get("complete", True):
        raise StoreError(f"{folder}: holds an estimate that is complete; to fly it again, {ways}")
    for key, value in asked.items():
        if manifest.get(key) != value:
            raise StoreError(
                f"{folder}: its estimate was begun with another {key.replace('_', ' ')}, so it "
                f"cannot be resumed; {ways}"
            )
    return list(manifest["sessions"])
