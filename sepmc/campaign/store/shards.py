"""Shards, the Parquet files of a run folder: case rows, histories, selected rows and accumulators
(arrays that statistics are computed from).

Functions that read the ledger raise StoreError if it cannot be read; those that write Parquet files
raise it if a file cannot be written.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from sepmc.campaign.store import folders, ledger
from sepmc.campaign.store.untrusted import StoreError, file_fault, table_fault
from sepmc.paths import readable
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.messages import printable
from sepmc.scene.read import CampaignFile
from sepmc.schema import Column
from sepmc.wording import another_place, flying_again


def arrow_table(
    columns: list[Column], data: dict[str, Any], about: dict[str, str] | None = None
) -> pa.Table:
    """Create an Arrow table of some ``columns`` from ``data``, arrays by column name.

    Unit and meaning of each column are in the metadata of its field, ``about`` in those of the
    table.
    """
    fields, arrays = [], []
    for column in columns:
        array = _array(data[column.name])
        fields.append(
            pa.field(
                column.name, array.type, metadata={"unit": column.unit, "meaning": column.meaning}
            )
        )
        arrays.append(array)
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about))


def _array(values: Any) -> pa.Array | pa.ChunkedArray:
    """Arrow array of the values of a column; text is dictionary-encoded."""
    if isinstance(values, pd.Categorical):
        used = values.remove_unused_categories()
        return pa.DictionaryArray.from_arrays(
            used.codes.astype(np.int32), pa.array(used.categories.tolist(), pa.string())
        )
    array = values if isinstance(values, pa.Array | pa.ChunkedArray) else pa.array(values)
    return (
        array.dictionary_encode()
        if pa.types.is_string(array.type) or pa.types.is_large_string(array.type)
        else array
    )


def write_parquet(
    path: Path, columns: list[Column], data: dict[str, Any], about: dict[str, str] | None = None
) -> bytes:
    """Write a Parquet file atomically; its folder is created if needed.

    Only text is dictionary-encoded: floats take 7 times longer with it. Snappy takes 60 % of the
    time of zstd, for files 4 to 10 % larger: dispersed numbers do not compress.

    Parameters
    ----------
    path : Path
    columns : list of Column
        Columns to write, in order.
    data : dict of str to array
        Values by column name.
    about : dict of str to str, optional
        Metadata of the table.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    StoreError
        If the file cannot be written, such as on a full disk.
    """
    written, content = arrow_table(columns, data, about), pa.BufferOutputStream()
    text = [field.name for field in written.schema if pa.types.is_dictionary(field.type)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(written, content, compression="snappy", use_dictionary=text or False)
        written_bytes = content.getvalue().to_pybytes()
        ledger.write_atomically(path, written_bytes)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be written: {error}") from None
    return written_bytes


def write_shard(
    folder: Path,
    kind: str,
    first: int,
    cases: int,
    columns: list[Column],
    data: dict[str, Any],
    about: dict[str, str],
) -> ledger.Entry:
    """Write a shard and return its ledger entry; the shard belongs to the run only when the caller
    has added the entry to the ledger.

    ``kind`` is the name of the data folder. ``first`` and ``cases`` are those of `ledger.Entry`,
    and ``first`` also names the file. ``columns``, ``data`` and ``about`` are as for
    `write_parquet`.
    """
    path = shard_path(folder, kind, first)
    content = write_parquet(path, columns, data, about)
    return ledger.make_entry(f"{kind}/{path.name}", content, first, cases)


def record_shards(folder: Path, written: Iterable[ledger.Entry]) -> None:
    """Append the entries of shards to the ledger of a run, in this order, by which the shards
    become part of the run. Raises StoreError if the ledger cannot be written."""
    try:
        ledger.add(folder, *written)
    except OSError as error:
        raise StoreError(f"{folder / ledger.LEDGER}: cannot be written: {error}") from None


def replace_shards(folder: Path, kind: str, written: Iterable[ledger.Entry]) -> None:
    """Make the shards of the entries ``written``, which are in the folder already, the only ones of
    a ``kind`` (data folder): all others are removed from the ledger and deleted."""
    new = {entry.file: entry for entry in written}
    others = [
        entry for entry in ledger.read(folder).values() if not entry.file.startswith(f"{kind}/")
    ]
    ledger.rewrite(folder, [*others, *new.values()])
    for path in (folder / kind).glob(folders.SHARD_PATTERN):
        if f"{kind}/{path.name}" not in new:
            path.unlink()


def write_accumulators(
    folder: Path, cases: int, arrays: Sequence[np.ndarray], about: dict[str, str]
) -> None:
    """Write the accumulators of the first ``cases`` cases of a run: one-dimensional ``arrays`` that
    statistics are computed from. They are recorded in the ledger, and earlier ones are deleted.
    ``about`` has the metadata of the file. Raises StoreError if a file cannot be written."""
    lengths = json.dumps([len(entry) for entry in arrays])
    path = shard_path(folder, folders.ACCUMULATORS, cases)
    column = Column("value", "", "accumulators of the statistics, one array after the other")
    content = write_parquet(
        path, [column], {"value": np.concatenate(arrays)}, about | {"lengths": lengths}
    )
    entry = ledger.make_entry(f"{folders.ACCUMULATORS}/{path.name}", content, cases)
    try:
        replace_shards(folder, folders.ACCUMULATORS, [entry])
    except OSError as error:
        raise StoreError(f"{folder / ledger.LEDGER}: cannot be written: {error}") from None


def accumulator_entry(folder: Path) -> ledger.Entry | None:
    """Ledger entry of the accumulators of a run; its ``first`` is the number of cases in them. None
    if there are no accumulators, or if they are damaged."""
    stored = [
        o for o in ledger.read(folder).values() if o.file.startswith(f"{folders.ACCUMULATORS}/")
    ]
    return stored[-1] if stored and not find_fault(folder, stored[-1]) else None


def has_accumulators(folder: Path) -> bool:
    """True if the ledger of a run lists accumulators, be they intact or not."""
    return any(file.startswith(f"{folders.ACCUMULATORS}/") for file in ledger.read(folder))


def read_accumulators(
    folder: Path, entry: ledger.Entry
) -> tuple[list[np.ndarray], dict[bytes, bytes]]:
    """Read the accumulators of a run (arrays that statistics are computed from) and their metadata.

    Parameters
    ----------
    folder : Path
    entry : Entry
        From `accumulator_entry`, which has compared the file with its checksum.

    Returns
    -------
    arrays : list of ndarray
        One-dimensional arrays, as given to `write_accumulators`.
    about : dict of bytes to bytes
        Metadata of the file by key.

    Raises
    ------
    StoreError
        If the file is damaged.
    """
    path = folder / entry.file
    _, about = read_metadata(path)
    values = read_table(path, ["value"])["value"].to_numpy()
    try:
        lengths = msgspec.json.decode(about[b"lengths"], type=list[int])
        if min(lengths) < 0 or sum(lengths) != len(values):
            raise ValueError("the lengths of its arrays do not match its number of values")
    except KeyError:
        raise StoreError(
            f"{path}: cannot be read: its metadata lack 'lengths', so the run cannot be continued: "
            "run it again, into another folder"
        ) from None
    except (ValueError, msgspec.MsgspecError) as error:
        raise StoreError(
            f"{path}: cannot be read: {error}, so the run cannot be continued: run it again, into "
            "another folder"
        ) from None
    return np.split(values, np.cumsum(lengths)[:-1]), about


def shard_path(folder: Path, kind: str, first: int) -> Path:
    """Path of the shard of a ``kind`` (data folder) that begins with case ``first``."""
    return folder / kind / f"part-{first:010d}.parquet"


def entries(folder: Path, kind: str) -> list[ledger.Entry]:
    """Ledger entries of the shards of a ``kind`` (data folder) that have cases, sorted by their
    first case; the files are not checked."""
    stored = [entry for entry in ledger.read(folder).values() if entry.file.startswith(f"{kind}/")]
    return sorted((entry for entry in stored if entry.cases), key=lambda entry: entry.first)


_verified: set[tuple[str, int, int, str]] = set()  # of files that were verified


def find_fault(folder: Path, entry: ledger.Entry) -> str:
    """Compare a file with its ledger entry: return the fault in words, such as "is gone", or an
    empty text if the file is intact. An unchanged file is read only once in a process."""
    path = folder / entry.file
    try:
        state = path.stat()
        known = (str(path.absolute()), state.st_mtime_ns, state.st_size, entry.sha256)
        if known not in _verified:
            ledger.read_verified(folder, entry)
            _verified.add(known)
    except OSError:
        return "is gone"
    except ValueError as error:
        return str(error)
    return ""


def _verified_path(folder: Path, entry: ledger.Entry) -> Path:
    """Path of the shard of a ledger entry, after checking that it is intact. Raises StoreError,
    with its cases and what to do, if it is not."""
    if problem := find_fault(folder, entry):
        raise StoreError(
            f"{folder / entry.file}: {problem}; it contained {entry.cases_text}. To run these "
            f"again: {flying_again(folder)}"
        )
    return folder / entry.file


def _read_entry(
    folder: Path, entry: ledger.Entry, columns: Sequence[str] | None = None
) -> pa.Table:
    """Read some columns, or all if None, of the shard of a ledger entry as an Arrow table. Raises
    StoreError if it is damaged, lacks a column, or has other cases than its entry says.

    `pyarrow.parquet.read_table` is not used: it would import the data set module (30 ms).
    """
    path = _verified_path(folder, entry)
    of_cases = entry.file.startswith(f"{folders.CASES}/")
    return read_table(path, columns, *((entry.cases, entry.first) if of_cases else ()))


def read_table(
    path: Path,
    columns: Sequence[str] | None = None,
    rows: int | None = None,
    first: int | None = None,
    content: bytes | None = None,
) -> pa.Table:
    """Read a Parquet file of a run as an Arrow table, if a run can have written its contents.

    Parameters
    ----------
    path : Path
    columns : sequence of str, optional
        Names of the columns to read; all columns if None.
    rows, first : int, optional
        Expected number of rows, and expected number of the first case; not checked if None.
    content : bytes, optional
        Content of the file, if it was read already.

    Returns
    -------
    pyarrow.Table

    Raises
    ------
    StoreError
        If the file cannot be read, lacks a column, or has contents that no run writes.
    """
    try:
        with pq.ParquetFile(
            readable(path) if content is None else pa.BufferReader(content)
        ) as file:
            size = path.stat().st_size
            if not (fault := file_fault(file, size, rows)):
                missing = [name for name in columns or () if name not in file.schema_arrow.names]
                fault = f"has no column {missing[0]}" if missing else ""
            if not fault:
                table = file.read(columns=columns).replace_schema_metadata(None)
                table.validate(full=True)
                fault = table_fault(table, first)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be read: {printable(str(error))}") from None
    if fault:
        raise StoreError(f"{path}: {fault}")
    return table


def read_metadata(path: Path) -> tuple[pa.Schema, dict[bytes, bytes]]:
    """Read the Arrow schema (columns) of a shard, and the metadata of its table by key. Raises
    StoreError if the file cannot be read or has contents that no run writes."""
    try:
        with pq.ParquetFile(readable(path)) as file:
            if fault := file_fault(file, path.stat().st_size):
                raise StoreError(f"{path}: {fault}")
            return file.schema_arrow, file.schema_arrow.metadata or {}
    except (OSError, ValueError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be read: {printable(str(error))}") from None


def read_shard(folder: Path, entry: ledger.Entry) -> dict[str, np.ndarray]:
    """Read all columns of the shard of a ledger entry: values (n,) by column name, texts as Python
    strings in object arrays. Raises StoreError if it is damaged."""
    frame = _read_entry(folder, entry).to_pandas()
    text = [name for name in frame if frame[name].dtype == "category"]
    objects = frame.astype(dict.fromkeys(text, object))
    return {str(name): values.to_numpy() for name, values in objects.items()}


def drop_damaged(folder: Path, with_histories: bool) -> int:
    """Delete missing and damaged shards of cases from a folder and its ledger, so that their cases
    can be run again.

    With ``with_histories`` (True), a shard of cases whose shard of histories is missing or damaged
    is deleted too. All selected rows, and all shards that are not in the ledger, are also deleted.

    Returns
    -------
    int
        Number of cases whose rows were deleted.
    """
    stored = ledger.read(folder)
    intact = {entry.file: entry for entry in stored.values() if not find_fault(folder, entry)}
    selected, n_dropped = {name: entry for name, entry in stored.items() if not entry.cases}, 0
    for entry in entries(folder, folders.CASES):
        histories = f"{folders.HISTORIES}/{Path(entry.file).name}"
        if entry.file in intact and (histories in intact or not with_histories):
            selected |= {name: intact[name] for name in (entry.file, histories) if name in intact}
        else:
            n_dropped += entry.cases
    ledger.rewrite(folder, selected.values())
    _remove_unrecorded(folder)
    return n_dropped


def drop_selected(folder: Path, first: int | None) -> int | None:
    """Delete the shards of selected rows (saved beside statistics) that begin at case ``first`` or
    later (none if that is None), and all shards that are not in the ledger.

    Returns
    -------
    int or None
        Number of selected rows that remain; None if a remaining shard of them is damaged.
    """
    stored = ledger.read(folder)
    selected = entries(folder, folders.SELECTED)
    later = [entry.file for entry in selected if first is not None and entry.first >= first]
    ledger.rewrite(folder, [entry for name, entry in stored.items() if name not in later])
    _remove_unrecorded(folder)
    remaining = entries(folder, folders.SELECTED)
    return (
        None
        if any(find_fault(folder, entry) for entry in remaining)
        else sum(entry.cases for entry in remaining)
    )


def _remove_unrecorded(folder: Path) -> None:
    """Delete the shards in the data folders of a run that are not in its ledger."""
    stored = ledger.read(folder)
    for kind in folders.DATA_FOLDERS:
        for path in (folder / kind).glob("part-*.parquet*"):
            if f"{kind}/{path.name}" not in stored:
                path.unlink()


def campaign_text(file: CampaignFile, **run: Any) -> str:
    """TOML text of a campaign for a run folder, with the values ``run`` in place of those of its
    ``[run]`` table.

    If the campaign has a sample table, the text names its copy in the run folder. Measurements are
    left out, as their files are elsewhere.
    """
    settings = run | ({"samples": folders.SAMPLES} if file.input_table else {})
    tree = {key: value for key, value in file.tree.items() if key != "measurement"}
    if settings:
        tree["run"] = {**tree.get("run", {}), **settings}
    return replace(file, tree=tree).toml


def write_input_table(folder: Path, table: InputTable, inputs: list[Column]) -> None:
    """Write the sample table of a campaign into a run folder, and record it in the ledger, so that
    the folder alone is sufficient for replay and resuming.

    ``inputs`` are the columns of the dispersed inputs; columns of the table with one of their names
    get the unit and meaning from there.
    """
    known = {column.name: column for column in inputs}
    columns = [Column(CASE, "1", "number of the case")]
    columns += [known.get(name, Column(name, "", "")) for name in table.columns]
    content = write_parquet(
        folder / folders.SAMPLES, columns, {CASE: table.numbers, **table.columns}
    )
    ledger.add(folder, ledger.make_entry(folders.SAMPLES, content))


def stored_cases(folder: Path) -> np.ndarray:
    """Numbers (n,) of the cases whose rows are stored in a run folder, sorted, by its ledger."""
    stored = [
        np.arange(entry.first, entry.first + entry.cases)
        for entry in entries(folder, folders.CASES)
    ]
    return np.concatenate(stored) if stored else np.empty(0, dtype=np.int64)


def case_after(folder: Path, count: int) -> int | None:
    """Number of the stored case that follows the first ``count`` stored cases; None if there are no
    more than these."""
    done = stored_cases(folder)
    return int(done[count]) if len(done) > count else None


def read_summaries(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield, for each shard of cases of a run, its path and the JSON text of the batch summary in
    its metadata. Raises StoreError if a shard is damaged or has no summary."""
    for entry in entries(folder, folders.CASES):
        path = _verified_path(folder, entry)
        _, reason = read_metadata(path)
        if b"summary" not in reason:
            raise StoreError(
                f"{folder}: was run by another version of sepmc, whose shards have no summary, so "
                f"its cases cannot be continued; {another_place()}"
            )
        yield path, reason[b"summary"].decode(errors="replace")


class MissingColumnError(StoreError, KeyError):
    """The case table of a run has no column of the requested name."""

    __str__ = Exception.__str__


class CaseColumns(Mapping[str, np.ndarray]):
    """Case table of a run folder, as a mapping of column names to values (n,), sorted by case;
    texts are Python strings in object arrays.

    Values are read when a column is asked for: a table of up to `MAX_IN_MEMORY` cases is read once
    as a whole and kept, of a longer one only that column is read, each time. Raises StoreError if
    the folder has no cases or a shard is damaged, MissingColumnError for an unknown column.
    """

    MAX_IN_MEMORY = 65536

    def __init__(self, folder: Path):
        self.folder = folder
        self._entries = entries(folder, folders.CASES)
        if not self._entries:
            raise StoreError(f"{folder}: contains no cases; give the folder of a run")
        self.rows = sum(part.cases for part in self._entries)
        self._names = read_metadata(_verified_path(folder, self._entries[0]))[0].names

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise MissingColumnError(f"{self.folder}: has no column {name}")
        if self.rows <= self.MAX_IN_MEMORY:
            return self._table[name].to_numpy()
        return self._read_rows([name])[name].to_numpy()

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @cached_property
    def _table(self) -> pa.Table:
        return self._read_rows(None)

    def _read_rows(self, names: list[str] | None) -> pa.Table:
        read = [_read_entry(self.folder, part, names) for part in self._entries]
        try:
            return pa.concat_tables(read)
        except pa.ArrowException as error:
            reason = printable(str(error))
            raise StoreError(
                f"{self.folder}: its shards differ in columns: {reason}; sepmc doctor shows which "
                "files were changed"
            ) from None

    def batches(
        self, names: Sequence[str]
    ) -> Iterator[tuple[np.ndarray, pd.Categorical, np.ndarray]]:
        """Read some columns shard by shard, so that a long table need not fit into memory.

        Parameters
        ----------
        names : sequence of str
            Names of numeric columns.

        Yields
        ------
        numbers : ndarray, shape (n,)
            Case numbers of the n cases of a shard.
        statuses : Categorical, shape (n,)
            Status labels of the cases.
        columns : ndarray, shape (len(names), n)
            Values of the columns, in their units.
        """
        for part in self._entries:
            read = _read_entry(self.folder, part, ["case", "status", *names])
            columns = np.empty((len(names), read.num_rows))
            for row, name in zip(columns, names, strict=True):
                row[:] = read[name].to_numpy()
            yield read["case"].to_numpy(), pd.Categorical(read["status"].to_pandas()), columns


def read_cases(
    folder: Path, below: int | None = None, columns: list[str] | None = None
) -> pd.DataFrame:
    """Read case rows of a run as a table, sorted by case; if given, only those with case numbers
    below ``below``, and only some ``columns``, which must include ``case``. Raises StoreError if no
    rows are stored, ValueError if rows are stored but no shard begins below ``below``."""
    stored = entries(folder, folders.CASES)
    if not stored:
        raise StoreError(f"{folder}: contains no {folders.CASES}; give the folder of a run")
    return _read_rows(folder, stored, ["case"], below, columns)


def read_row(folder: Path, number: int) -> dict[str, Any]:
    """Read the row of the case with this ``number`` in a run: values by column. Raises StoreError
    if the case is not stored, or its shard is damaged."""
    for part in entries(folder, folders.CASES):
        if part.first <= number < part.first + part.cases:
            frame = _read_entry(folder, part).to_pandas(ignore_metadata=True)
            table = frame[frame["case"] == number]
            return {str(name): table[name].iloc[0] for name in table}
    raise StoreError(f"{folder}: does not contain case {number}")


def read_histories(
    folder: Path, below: int | None = None, stored: Sequence[ledger.Entry] | None = None
) -> pd.DataFrame | None:
    """Read stored histories of a run as a table in long form: a row per case and time, sorted by
    both, with columns case, time_s and the separations. Raises StoreError if a shard is damaged.

    Parameters
    ----------
    folder : Path
    below : int, optional
        Only cases with smaller numbers are read; all if None.
    stored : sequence of Entry, optional
        Ledger entries of the shards to read; all shards of histories if None.

    Returns
    -------
    DataFrame or None
        None if no histories are stored.
    """
    stored = entries(folder, folders.HISTORIES) if stored is None else stored
    return _read_rows(folder, stored, ["case", "time_s"], below) if stored else None


def _read_rows(
    folder: Path,
    stored: Sequence[ledger.Entry],
    order: list[str],
    below: int | None = None,
    columns: list[str] | None = None,
) -> pd.DataFrame:
    frame = pd.concat(
        [
            _read_entry(folder, part, columns).to_pandas(ignore_metadata=True)
            for part in stored
            if below is None or part.first < below
        ],
        ignore_index=True,
    )
    if "status" in frame:
        frame["status"] = frame["status"].astype(str)
    if below is not None:
        frame = frame[frame["case"] < below]
    return frame.sort_values(order, ignore_index=True)


def units(folder: Path, kind: str = folders.CASES) -> dict[str, str]:
    """Unit of each column by name, from the first shard of a ``kind`` (data folder): an empty text
    for a column without a unit. No columns if there is no such shard. Raises StoreError if that
    shard is damaged."""
    part = next(iter(entries(folder, kind)), None)
    if part is None:
        return {}
    return {
        field.name: (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        for field in read_metadata(_verified_path(folder, part))[0]
    }
