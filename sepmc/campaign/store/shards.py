"""Rows and histories of a run folder in Parquet, and its statistics. The only place that knows
pyarrow, but for the tables that give inputs."""

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

from sepmc.analysis.stored_statistics import StoredStatistics
from sepmc.campaign.store import folders, ledger
from sepmc.campaign.store.untrusted import StoreError, file_fault, table_fault
from sepmc.paths import readable
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.messages import printable
from sepmc.scene.read import CampaignFile
from sepmc.schema import Column
from sepmc.wording import another_place, flying_again, switch


def arrow_table(
    columns: list[Column], data: dict[str, Any], about: dict[str, str] | None = None
) -> pa.Table:
    """An Arrow table whose fields carry unit and meaning in their metadata, and which itself says
    what it is ``about``."""
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
    """A column as Arrow has it; text as a dictionary of what occurs."""
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
    """Write one Parquet file atomically.

    Dictionary encoding only where text repeats: floats take 7 times longer with it. Snappy takes 60
    % of the time of zstd, for files 4 to 10 % larger: numbers that are dispersed do not compress.

    Returns
    -------
    bytes
        What was written.

    Raises
    ------
    StoreError
        If it cannot be written, a full disk say.
    """
    written, content = arrow_table(columns, data, about), pa.BufferOutputStream()
    text = [field.name for field in written.schema if pa.types.is_dictionary(field.type)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(written, content, compression="snappy", use_dictionary=text or False)
        whole = content.getvalue().to_pybytes()
        ledger.write_atomically(path, whole)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be written: {error}") from None
    return whole


def write_shard(
    folder: Path,
    kind: str,
    first: int,
    cases: int,
    columns: list[Column],
    data: dict[str, Any],
    about: dict[str, str],
) -> ledger.Entry:
    """Write the part of a run that begins with case ``first``; it counts once it is noted."""
    path = shard_path(folder, kind, first)
    content = write_parquet(path, columns, data, about)
    return ledger.make_entry(f"{kind}/{path.name}", content, first, cases)


def record_shards(folder: Path, parts: Iterable[ledger.Entry]) -> None:
    """Note parts of a run in its ledger, in the order in which they count."""
    try:
        ledger.add(folder, *parts)
    except OSError as error:
        raise StoreError(f"{folder / ledger.LEDGER}: cannot be written: {error}") from None


def replace_shards(folder: Path, kind: str, parts: Iterable[ledger.Entry]) -> None:
    """Put new parts, which are written, in place of all those of a kind."""
    new = {one.file: one for one in parts}
    others = [one for one in ledger.read(folder).values() if not one.file.startswith(f"{kind}/")]
    ledger.rewrite(folder, [*others, *new.values()])
    for path in (folder / kind).glob(folders.SHARD_PATTERN):
        if f"{kind}/{path.name}" not in new:
            path.unlink()


def write_accumulators(
    folder: Path, cases: int, arrays: Sequence[np.ndarray], about: dict[str, str]
) -> None:
    """Write what is counted of the first so many cases of a run, in place of what was before."""
    lengths = json.dumps([len(one) for one in arrays])
    path = shard_path(folder, folders.ACCUMULATORS, cases)
    column = Column("value", "", "what is counted, an array after the other")
    content = write_parquet(
        path, [column], {"value": np.concatenate(arrays)}, about | {"lengths": lengths}
    )
    one = ledger.make_entry(f"{folders.ACCUMULATORS}/{path.name}", content, cases)
    try:
        replace_shards(folder, folders.ACCUMULATORS, [one])
    except OSError as error:
        raise StoreError(f"{folder / ledger.LEDGER}: cannot be written: {error}") from None


def accumulator_entry(folder: Path) -> ledger.Entry | None:
    """What tells what is counted of a run, as it was written; None if there is nothing."""
    held = [
        o for o in ledger.read(folder).values() if o.file.startswith(f"{folders.ACCUMULATORS}/")
    ]
    return held[-1] if held and not find_fault(folder, held[-1]) else None


def read_accumulators(
    folder: Path, one: ledger.Entry
) -> tuple[list[np.ndarray], dict[bytes, bytes]]:
    """Arrays that tell what is counted of a run, and what they say of it. Raises StoreError if they
    are none."""
    path = folder / one.file
    _, said = read_metadata(path)
    values = read_table(path, ["value"])["value"].to_numpy()
    try:
        lengths = msgspec.json.decode(said[b"lengths"], type=list[int])
        if min(lengths) < 0 or sum(lengths) != len(values):
            raise ValueError("its arrays have other lengths")
    except (KeyError, ValueError, msgspec.MsgspecError) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from None
    return np.split(values, np.cumsum(lengths)[:-1]), said


def shard_path(folder: Path, kind: str, first: int) -> Path:
    """Path of the part that begins with case ``first``."""
    return folder / kind / f"part-{first:010d}.parquet"


def entries(folder: Path, kind: str) -> list[ledger.Entry]:
    """Parts of a run, in order of their first case."""
    held = [one for one in ledger.read(folder).values() if one.file.startswith(f"{kind}/")]
    return sorted((one for one in held if one.cases), key=lambda one: one.first)


_whole: set[tuple[str, int, int, str]] = set()  # files that were seen as they were written


def find_fault(folder: Path, one: ledger.Entry) -> str:
    """What is wrong with a file; nothing, if it is as it was written, which is seen once."""
    path = folder / one.file
    try:
        state = path.stat()
        known = (str(path.absolute()), state.st_mtime_ns, state.st_size, one.sha256)
        if known not in _whole:
            ledger.read_verified(folder, one)
            _whole.add(known)
    except OSError:
        return "is gone"
    except ValueError as error:
        return str(error)
    return ""


def _path(folder: Path, one: ledger.Entry) -> Path:
    """Path of a part, which is as it was written. Raises StoreError if it is not, with the file,
    its cases and what to do."""
    if problem := find_fault(folder, one):
        raise StoreError(
            f"{folder / one.file}: {problem}; it held {one.numbers}. To fly these again: "
            f"{flying_again(folder)}"
        )
    return folder / one.file


def _read_entry(folder: Path, one: ledger.Entry, columns: Sequence[str] | None = None) -> pa.Table:
    """Columns of a part. Not by `pyarrow.parquet.read_table`, which imports the data set machinery
    for it (30 ms)."""
    path = _path(folder, one)
    of_cases = one.file.startswith(f"{folders.CASES}/")
    return read_table(path, columns, *((one.cases, one.first) if of_cases else ()))


def read_table(
    path: Path,
    columns: Sequence[str] | None = None,
    rows: int | None = None,
    first: int | None = None,
    content: bytes | None = None,
) -> pa.Table:
    """Columns of a part, or of what it holds. Raises StoreError if they are none of a run."""
    try:
        with pq.ParquetFile(
            readable(path) if content is None else pa.BufferReader(content)
        ) as file:
            size = path.stat().st_size
            if not (fault := file_fault(file, size, rows)):
                lost = [name for name in columns or () if name not in file.schema_arrow.names]
                fault = f"has no column {lost[0]}" if lost else ""
            if not fault:
                found = file.read(columns=columns).replace_schema_metadata(None)
                found.validate(full=True)
                fault = table_fault(found, first)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be read: {printable(str(error))}") from None
    if fault:
        raise StoreError(f"{path}: {fault}")
    return found


def read_metadata(path: Path) -> tuple[pa.Schema, dict[bytes, bytes]]:
    """The schema of a part, and what it says of itself. Raises StoreError if it is none of a
    run."""
    try:
        with pq.ParquetFile(readable(path)) as file:
            if fault := file_fault(file, path.stat().st_size):
                raise StoreError(f"{path}: {fault}")
            return file.schema_arrow, file.schema_arrow.metadata or {}
    except (OSError, ValueError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be read: {printable(str(error))}") from None


def read_shard(folder: Path, one: ledger.Entry) -> dict[str, np.ndarray]:
    """All columns of a part, text as objects."""
    frame = _read_entry(folder, one).to_pandas()
    text = [name for name in frame if frame[name].dtype == "category"]
    told = frame.astype(dict.fromkeys(text, object))
    return {str(name): values.to_numpy() for name, values in told.items()}


def drop_damaged(folder: Path, with_histories: bool) -> int:
    """Forget parts that are gone or not as they were written, and those of cases whose histories
    are, if they should have some, so that these are flown again. Returns how many cases that
    are."""
    held = ledger.read(folder)
    sound = {one.file: one for one in held.values() if not find_fault(folder, one)}
    kept, dropped = {name: one for name, one in held.items() if not one.cases}, 0
    for one in entries(folder, folders.CASES):
        over_time = f"{folders.HISTORIES}/{Path(one.file).name}"
        if one.file in sound and (over_time in sound or not with_histories):
            kept |= {name: sound[name] for name in (one.file, over_time) if name in sound}
        else:
            dropped += one.cases
    ledger.rewrite(folder, kept.values())
    _drop_unknown(folder)
    return dropped


def drop_selected(folder: Path, first: int | None) -> int | None:
    """Drop rows that a run kept of the case ``first`` and later ones, and what of it is in no
    ledger. Returns how many are left; None if they are not as they were written."""
    held = ledger.read(folder)
    kept = entries(folder, folders.SELECTED)
    late = [one.file for one in kept if first is not None and one.first >= first]
    ledger.rewrite(folder, [one for name, one in held.items() if name not in late])
    _drop_unknown(folder)
    left = entries(folder, folders.SELECTED)
    return None if any(find_fault(folder, one) for one in left) else sum(one.cases for one in left)


def _drop_unknown(folder: Path) -> None:
    """Remove parts that are in no ledger."""
    held = ledger.read(folder)
    for kind in folders.DATA_FOLDERS:
        for path in (folder / kind).glob("part-*.parquet*"):
            if f"{kind}/{path.name}" not in held:
                path.unlink()


def campaign_text(file: CampaignFile, **run: Any) -> str:
    """The resolved campaign of a folder as TOML, with other values of ``run``."""
    own = run | ({"samples": folders.SAMPLES} if file.input_table else {})
    tree = {**file.tree, "run": {**file.tree.get("run", {}), **own}} if own else file.tree
    return replace(file, tree=tree).toml


def write_input_table(folder: Path, table: InputTable, inputs: list[Column]) -> None:
    """Write the table that gives inputs, so that the run can be replayed and resumed from its
    folder alone."""
    known = {column.name: column for column in inputs}
    columns = [Column(CASE, "1", "number of the case")]
    columns += [known.get(name, Column(name, "", "")) for name in table.columns]
    content = write_parquet(
        folder / folders.SAMPLES, columns, {CASE: table.numbers, **table.columns}
    )
    ledger.add(folder, ledger.make_entry(folders.SAMPLES, content))


def stored_cases(folder: Path) -> np.ndarray:
    """Numbers of the cases a run folder holds, sorted; shape (n,)."""
    held = [np.arange(one.first, one.first + one.cases) for one in entries(folder, folders.CASES)]
    return np.concatenate(held) if held else np.empty(0, dtype=np.int64)


def case_after(folder: Path, count: int) -> int | None:
    """Number of the case that comes after the first so many that a run holds; None if there is
    none."""
    done = stored_cases(folder)
    return int(done[count]) if len(done) > count else None


def read_summaries(folder: Path) -> Iterator[str]:
    """What was counted of the cases of each part of a run:
    `sepmc.campaign.execution.batch_summary.BatchSummary.text`."""
    for one in entries(folder, folders.CASES):
        _, said = read_metadata(_path(folder, one))
        if b"summary" not in said:
            raise StoreError(
                f"{folder}: was flown by a version of sepmc that counted less, so its cases cannot "
                f"be continued; {another_place()}"
            )
        yield said[b"summary"].decode(errors="replace")


class MissingColumnError(StoreError, KeyError):
    """The cases of a run do not have a column."""

    __str__ = Exception.__str__


class CaseColumns(Mapping[str, np.ndarray]):
    """Columns of the case table of a run folder, read when they are asked for, in order of case;
    text as objects.

    A table of up to `KEPT` cases is read once, a longer one column by column, and a part at a time
    by `batches`.
    """

    KEPT = 65536

    def __init__(self, folder: Path):
        self.folder = folder
        self._parts = entries(folder, folders.CASES)
        if not self._parts:
            raise StoreError(f"{folder}: holds no cases; give the folder of a run")
        self.rows = sum(part.cases for part in self._parts)
        self._names = read_metadata(_path(folder, self._parts[0]))[0].names

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise MissingColumnError(f"{self.folder}: has no column {name}")
        if self.rows <= self.KEPT:
            return self._whole[name].to_numpy()
        return self._read([name])[name].to_numpy()

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @cached_property
    def _whole(self) -> pa.Table:
        return self._read(None)

    def _read(self, names: list[str] | None) -> pa.Table:
        read = [_read_entry(self.folder, part, names) for part in self._parts]
        try:
            return pa.concat_tables(read)
        except pa.ArrowException as error:
            said = printable(str(error))
            raise StoreError(f"{self.folder}: its parts differ in columns: {said}") from None

    def batches(
        self, names: Sequence[str]
    ) -> Iterator[tuple[np.ndarray, pd.Categorical, np.ndarray]]:
        """Part by part: numbers and statuses, shape (n,), and the columns asked for, shape
        (len(names), n)."""
        for part in self._parts:
            read = _read_entry(self.folder, part, ["case", "status", *names])
            columns = np.empty((len(names), read.num_rows))
            for row, name in zip(columns, names, strict=True):
                row[:] = read[name].to_numpy()
            yield read["case"].to_numpy(), pd.Categorical(read["status"].to_pandas()), columns


def read_cases(
    folder: Path, below: int | None = None, columns: list[str] | None = None
) -> pd.DataFrame:
    """Case rows of a run, in order of case: all, or those ``below`` a number; all columns, or
    some."""
    held = entries(folder, folders.CASES)
    if not held:
        raise StoreError(f"{folder}: holds no {folders.CASES}; give the folder of a run")
    return _read(folder, held, ["case"], below, columns)


def read_row(folder: Path, number: int) -> dict[str, Any]:
    """The row of a case of a run. Raises StoreError if the run does not hold it."""
    for part in entries(folder, folders.CASES):
        if part.first <= number < part.first + part.cases:
            frame = _read_entry(folder, part).to_pandas(ignore_metadata=True)
            found = frame[frame["case"] == number]
            return {str(name): found[name].iloc[0] for name in found}
    raise StoreError(f"{folder}: does not hold case {number}")


def read_histories(
    folder: Path, below: int | None = None, held: Sequence[ledger.Entry] | None = None
) -> pd.DataFrame | None:
    """Histories of a run in long form (case, time_s, ...), of cases ``below`` a number only if
    given, or None if it kept none: all, or of the parts that it ``held`` once."""
    held = entries(folder, folders.HISTORIES) if held is None else held
    return _read(folder, held, ["case", "time_s"], below) if held else None


def _read(
    folder: Path,
    held: Sequence[ledger.Entry],
    order: list[str],
    below: int | None = None,
    columns: list[str] | None = None,
) -> pd.DataFrame:
    frame = pd.concat(
        [
            _read_entry(folder, part, columns).to_pandas(ignore_metadata=True)
            for part in held
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
    """Unit of each column, from the metadata of the first part."""
    part = next(iter(entries(folder, kind)), None)
    if part is None:
        return {}
    return {
        field.name: (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        for field in read_metadata(_path(folder, part))[0]
    }


def write_statistics(
    folder: Path, stats: pd.DataFrame, of: dict[str, str], told: dict[str, Any]
) -> None:
    """Write ``statistics.csv``, ``of`` mapping each outcome to its unit, and ``statistics.json``
    with what is ``told``: see `statistics_as_json`."""
    frame = _with_units(stats, of)
    folders.write_text(folder / "statistics.csv", frame.to_csv(index_label="outcome"))
    folders.write_json(folder / "statistics.json", told)


def write_histograms(folder: Path, bins: pd.DataFrame) -> Path:
    """Write the bins of histograms, ``histograms.csv``; returns its path."""
    path = folder / folders.HISTOGRAMS
    folders.write_text(path, bins.to_csv(index=False))
    return path


def read_stored_statistics(folder: Path) -> StoredStatistics:
    """Statistics and histograms of a run that kept no cases. Raises StoreError if they are not
    there as they were written."""
    held, frames = ledger.read(folder), []
    for name, index in (("statistics.csv", "outcome"), (folders.HISTOGRAMS, None)):
        problem = find_fault(folder, held[name]) if name in held else "is not there"
        if problem:
            raise StoreError(
                f"{folder / name}: {problem}; to write it again: {flying_again(folder)}"
            )
        frames.append(pd.read_csv(readable(folder / name), index_col=index))
    table, bins = frames
    return StoredStatistics(table.drop(columns="unit"), bins)


def statistics_as_json(
    stats: pd.DataFrame,
    counts: dict[str, int],
    of: dict[str, str],
    audit: pd.DataFrame,
    failed: dict[str, list[int]] | None = None,
    verdicts: Sequence[dict[str, Any]] = (),
    rarely_drawn: Sequence[str] = (),
) -> dict[str, Any]:
    """What ``statistics.json`` holds; ``of`` maps each outcome to its unit, ``failed`` names first
    cases by status, ``verdicts`` are those on requirements, ``rarely_drawn`` names values of inputs
    that statistics hardly show. What is not a number is null."""
    rows, audited = (
        {
            str(name): {k: (None if pd.isna(v) else v) for k, v in row.items()}
            for name, row in table.to_dict("index").items()
        }
        for table in (_with_units(stats, of), audit)
    )
    return {
        "cases": counts,
        "failed_cases": failed or {},
        "requirements": list(verdicts),
        "rarely_drawn": list(rarely_drawn),
        "outcomes": rows,
        "audit": audited,
    }


def _with_units(stats: pd.DataFrame, of: dict[str, str]) -> pd.DataFrame:
    """Statistics with the unit of each outcome first; numbers of cases are whole."""
    columns = {
        str(name): stats[name].astype("Int64") if name in ("case_min", "case_max") else stats[name]
        for name in stats
    }
    units = [of.get(str(name), "") for name in stats.index]
    return pd.DataFrame({"unit": units, **columns}, index=stats.index)


def write_history(folder: Path, history: pd.DataFrame, meanings: dict[str, str]) -> Path:
    """Write the time history of a single run, ``history.parquet``; units are taken from
    ``history.attrs``."""
    columns = [
        Column(str(name), history.attrs["units"][name], meanings.get(str(name), ""))
        for name in history.columns
    ]
    path = folder / folders.HISTORY
    content = write_parquet(
        path,
        columns,
        {
            c.name: history[c.name].to_numpy(dtype=object if c.name == "phase" else None)
            for c in columns
        },
    )
    ledger.rewrite(folder, [ledger.make_entry(folders.HISTORY, content)])
    return path


def read_history(folder: Path) -> pd.DataFrame | None:
    """The time history of a single run, or None if the folder holds none."""
    one = ledger.read(folder).get(folders.HISTORY)
    if one is None:
        return None
    try:
        content = ledger.read_verified(folder, one)
    except ValueError as error:
        raise StoreError(
            f"{folder / folders.HISTORY}: {error}; fly it again with {switch('overwrite')}"
        ) from None
    frame = read_table(folder / folders.HISTORY, content=content).to_pandas(ignore_metadata=True)
    if not {"time_s", "phase"} <= set(frame):
        raise StoreError(f"{folder / folders.HISTORY}: is no history")
    frame["phase"] = frame["phase"].astype(str)
    return frame
