"""Log of the cases of a rare-event estimate, from which an interrupted estimate is resumed.

An estimate runs batches of cases, whose inputs and order its seed determines. Completed batches are
written into shards (Parquet files) of the run folder. A resumed estimate asks for the same batches
again: it gets the results of the logged ones from the shards, and runs the others.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.batch_summary import read as read_summary
from sepmc.campaign.store import folders, ledger, manifests, shards
from sepmc.campaign.store.folders import StoreError
from sepmc.paths import is_local
from sepmc.schema import Column
from sepmc.wording import another_place

_SAVE_S = 10.0  # from one writing to the next
_SAVE_NUMBERS = 8_000_000  # pending numbers (64 MB) that are written earlier
# names in messages of the entries of a request
_NAMES = {"rare": "requirement", "flights_allowed": "number of cases"}
_VALUE = Column("value", "", "margins, then rows, of one batch after the other")

# margins (n,), below 0 for a violation, and rows (n, k): inputs, status, results
Batch = tuple[np.ndarray, np.ndarray]


class FlightLog:
    """Log of one rare-event estimate: `answer` returns logged batches of cases, `add` appends newly
    run ones.

    Parameters
    ----------
    folder : Path
        Run folder, open for writing.
    width : int
        Number k of columns of a case row: inputs, status and results.
    inputs : int
        Number of leading columns of a row that are inputs.
    about : dict of str to str
        Metadata of every shard: campaign, digest, seed and requirement.
    resume : bool
        True: begin with the intact shards in the folder; False: begin with an empty log.
    """

    def __init__(self, folder: Path, width: int, inputs: int, about: dict[str, str], resume: bool):
        self.folder, self.width, self.inputs, self.about = folder, width, inputs, about
        self.summary = BatchSummary()  # of all batches that were answered or added
        self.count = self.resumed = 0  # cases that were answered or written; answered
        self._written: list[ledger.Entry] = []
        self._shards = _intact_shards(folder) if resume else []
        self._batches: list[Batch] = []  # of the shard that answers
        self._next_summary = BatchSummary()  # that at its end
        self._pending: list[Batch] = []
        self._saved = time.monotonic()

    def answer(self, drawn: np.ndarray) -> Batch | None:
        """Return margins (n,) and rows (n, k) of the next logged batch; None after the last one.

        ``drawn`` (n, d) are the inputs, in the units of the file, that the estimate asks for next.
        The batch is removed from those still to be returned, and its n cases are added to the
        counts ``count`` and ``resumed``.

        Raises
        ------
        StoreError
            If the next logged batch has other inputs, or its shard is damaged.
        """
        if not self._batches and self._shards:
            shard = self._shards.pop(0)
            self._batches, self._next_summary = self._read(shard)
            self._written.append(shard)
        if not self._batches:
            return None
        margin, rows = self._batches.pop(0)
        if not np.array_equal(rows[:, : self.inputs], drawn, equal_nan=True):
            raise StoreError(
                f"{self.folder}: its stored cases have other inputs than this estimate samples, "
                f"so it cannot be resumed; {another_place()}"
            )
        self.count += len(rows)
        self.resumed += len(rows)
        if not self._batches:
            self.summary = self._next_summary
        return margin, rows

    def add(self, margin: np.ndarray, rows: np.ndarray, summary: BatchSummary) -> None:
        """Append a completed batch to the log: margins (n,), below 0 for a violation, and rows
        (n, k) of inputs, status and results. ``summary`` is of all cases so far. Batches are
        collected in memory and written every ten seconds, or earlier if they are large."""
        self._pending.append((margin, rows))
        self.summary = summary
        n_numbers = sum(rows.size for _, rows in self._pending)
        if n_numbers > _SAVE_NUMBERS or time.monotonic() - self._saved > _SAVE_S:
            self.save()

    def save(self) -> None:
        """Write the batches collected in memory as one shard, and record it in the ledger; does
        nothing if there are none. Raises StoreError if it cannot be written."""
        if not self._pending:
            return
        n_cases = sum(len(rows) for _, rows in self._pending)
        values = [part.ravel() for batch in self._pending for part in batch]
        path = shards.shard_path(self.folder, folders.ACCUMULATORS, self.count)
        about = self.about | {
            "lengths": json.dumps([len(rows) for _, rows in self._pending]),
            "summary": self.summary.text,
        }
        content = shards.write_parquet(path, [_VALUE], {"value": np.concatenate(values)}, about)
        name = f"{folders.ACCUMULATORS}/{path.name}"
        self._written.append(ledger.make_entry(name, content, self.count, n_cases))
        shards.replace_shards(self.folder, folders.ACCUMULATORS, self._written)
        self.count += n_cases
        self._pending, self._saved = [], time.monotonic()

    def remove(self) -> None:
        """Delete the shards of the log, their entries in the ledger and their folder, once the
        estimate is complete."""
        shards.replace_shards(self.folder, folders.ACCUMULATORS, [])
        log_folder = self.folder / folders.ACCUMULATORS
        if is_local(log_folder) and log_folder.is_dir():
            log_folder.rmdir()

    def _read(self, shard: ledger.Entry) -> tuple[list[Batch], BatchSummary]:
        """Batches of a shard, and the summary of all cases of the log up to its end. Raises
        StoreError if it cannot be read, or its metadata and values contradict each other; its
        checksum is not compared."""
        path = self.folder / shard.file
        _, about = shards.read_metadata(path)
        values = shards.read_table(path, ["value"])["value"].to_numpy()
        try:
            lengths = [int(n) for n in json.loads(about[b"lengths"])]
            summary = read_summary(about[b"summary"], path)
            if min(lengths) < 0 or sum(lengths) * (1 + self.width) != len(values):
                raise ValueError("the lengths of its batches do not match its number of values")
        except KeyError as error:
            key = error.args[0].decode()
            raise StoreError(
                f"{path}: cannot be read: its metadata lack {key}, so the estimate cannot be "
                "resumed: run it again, into another folder"
            ) from None
        except (TypeError, ValueError) as error:
            raise StoreError(
                f"{path}: cannot be read: {error}, so the estimate cannot be resumed: run it "
                "again, into another folder"
            ) from None
        batches, offset = [], 0
        for n in lengths:
            margin, rows = np.split(values[offset : offset + n * (1 + self.width)], [n])
            batches.append((margin, rows.reshape(n, self.width)))
            offset += n * (1 + self.width)
        return batches, summary


def _intact_shards(folder: Path) -> list[ledger.Entry]:
    """Ledger entries of the shards of a log in order, up to the first gap between cases or damaged
    shard."""
    intact: list[ledger.Entry] = []
    end = 0
    for shard in shards.entries(folder, folders.ACCUMULATORS):
        if shard.first != end or shards.find_fault(folder, shard):
            break
        intact.append(shard)
        end += shard.cases
    return intact


def interrupted(folder: Path, request: dict[str, Any]) -> list[dict[str, Any]]:
    """Check that a folder contains the interrupted estimate that is requested; return its sessions.

    A session is the manifest entry of one command that ran cases of the estimate. The list is empty
    if there is no run in the folder.

    Parameters
    ----------
    folder : Path
    request : dict
        Manifest entries of the requested estimate; the manifest of the folder must contain the same
        values.

    Raises
    ------
    StoreError
        If the folder contains another run or estimate, or a complete one.
    """
    if not folders.is_run(folder):
        return []
    manifest = manifests.read_manifest(folder)
    advice = another_place()
    if "rare" not in manifest:
        raise StoreError(
            f"{folder}: contains no estimate of a rare event, so none is resumed; {advice}"
        )
    if manifest.get("complete", True):
        raise StoreError(
            f"{folder}: contains an estimate that is complete; to run it again, {advice}"
        )
    for key, value in request.items():
        if manifest.get(key) != value:
            raise StoreError(
                f"{folder}: its estimate was begun with another {_NAMES.get(key, key)}, so it "
                f"cannot be resumed; {advice}"
            )
    return list(manifest["sessions"])
