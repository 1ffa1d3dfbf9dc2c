"""The run folder: case parts in Parquet, histories, manifest, resolved campaign. The only place
that knows pyarrow."""

import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from sepmc import __version__
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.read import CampaignFile
from sepmc.schema import Column

CASES, HISTORIES, MANIFEST, CAMPAIGN = "cases", "histories", "manifest.json", "campaign.toml"
PLAN = "plan.parquet"
_OURS = (CASES, HISTORIES)
_FIGURES = (
    "hist_*",
    "histograms",
    "*separation*",
    "force_on_*",
    "moment_on_*",
    "rates",
    "angles",
    "axial_acceleration",
    "clearances",
    "pin_loads",
    "requirements",
    "convergence",
    "drivers",
    "scatter",
)
_OUR_FILES = (
    MANIFEST,
    CAMPAIGN,
    PLAN,
    "statistics.csv",
    "statistics.json",
    "history.parquet",
    "drivers.csv",
    "causes.csv",
    "report.html",
    "film.gif",
    "film.mp4",
    *(f"{name}.{ending}" for name in _FIGURES for ending in ("png", "svg", "pdf")),
)


class StoreError(Exception):
    """A run folder that cannot be used as asked; its argument is the sentence to show."""


def next_folder(name: str, root: Path = Path("runs")) -> Path:
    """``runs/<name>-<n>`` with the smallest free n."""
    n = 1
    while (root / f"{name}-{n}").exists():
        n += 1
    return root / f"{name}-{n}"


def open_folder(
    folder: Path, overwrite: bool = False, resume: bool = False, resumable: bool = True
) -> Path:
    """Make ``folder`` ready to be written, without losing anything unasked; see `check_folder`.
    Raises StoreError, too, if it cannot be written."""
    check_folder(folder, overwrite, resume, resumable)
    if overwrite and folder.is_dir():
        _clear(folder)
    make_writable(folder)
    return folder


def check_folder(
    folder: Path, overwrite: bool = False, resume: bool = False, resumable: bool = True
) -> None:
    """See whether ``folder`` may be written, and change nothing. ``resumable``: say that it could
    be resumed.

    Raises
    ------
    StoreError
        If it exists and neither ``overwrite`` nor ``resume`` is given, or is no run folder.
    """
    if folder.exists() and not folder.is_dir():
        raise StoreError(f"{folder}: is a file; give --out a folder")
    if folder.is_dir() and any(folder.iterdir()):
        if not (overwrite or resume):
            ways = (
                "add --resume to fly its missing cases, --overwrite to replace it,"
                if resumable and (folder / CASES).is_dir()
                else "add --overwrite to replace it"
            )
            raise StoreError(f"{folder}: exists; {ways} or choose another --out")
        if not (folder / MANIFEST).is_file():
            raise StoreError(
                f"{folder}: holds other files and no {MANIFEST}, so it is not a run; choose "
                "another --out"
            )
    for name in () if overwrite else _OURS:
        if (folder / name).exists() and not (folder / name).is_dir():
            raise StoreError(
                f"{folder / name}: is a file where a run keeps a folder; choose another --out"
            )


def make_writable(folder: Path) -> None:
    """Make a folder if there is none. Raises StoreError if nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _clear(folder: Path) -> None:
    """Remove what a run made, and nothing else."""
    for name in _OURS:
        shutil.rmtree(folder / name, ignore_errors=True)
    for path in folder.iterdir():
        if path.is_file() and any(path.match(pattern) for pattern in _OUR_FILES):
            path.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old or the new text, never a part."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def write_json(path: Path, data: Any) -> None:
    """Write JSON: see `json_text`."""
    write_text(path, json_text(data))


def json_text(data: Any) -> str:
    """Data as JSON; a number that is not finite becomes null, as JSON has none."""
    return json.dumps(_finite(data), indent=2, allow_nan=False) + "\n"


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run. Raises StoreError if there is none or it cannot be read."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StoreError(f"{folder}: no {MANIFEST} here; give the folder of a run") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from None
    if not isinstance(manifest, dict):
        raise StoreError(f"{path}: cannot be read: it holds no table")
    return manifest


def versions() -> dict[str, Any]:
    """What made a run: versions and machine."""
    packages = {
        "numpy": np.__version__,
        "numba": version("numba"),
        "pandas": pd.__version__,
        "pyarrow": pa.__version__,
    }
    return {
        "sepmc": __version__,
        "versions": {"python": platform.python_version(), **packages},
        "machine": f"{platform.machine()} {platform.system()}",
    }


def table(
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
) -> None:
    """Write one Parquet file atomically.

    Dictionary encoding only where text repeats: floats take 7 times longer with it. Snappy takes 60
    % of the time of zstd, for files 4 to 10 % larger: numbers that are dispersed do not compress.

    Raises
    ------
    StoreError
        If it cannot be written, a full disk say.
    """
    temporary = path.with_name(path.name + ".tmp")
    written = table(columns, data, about)
    text = [field.name for field in written.schema if pa.types.is_dictionary(field.type)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(written, temporary, compression="snappy", use_dictionary=text or False)
        os.replace(temporary, path)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be written: {error}") from None


def part_path(folder: Path, kind: str, first: int) -> Path:
    """Path of the part that begins with case ``first``."""
    return folder / kind / f"part-{first:010d}.parquet"


def _parts(folder: Path, kind: str) -> list[Path]:
    """Parts of a run, in order of their first case."""
    return sorted((folder / kind).glob("part-*.parquet"))


def _read_part(part: Path, columns: Sequence[str] | None = None, metadata: Any = None) -> pa.Table:
    """Columns of a part. Not by `pyarrow.parquet.read_table`, which imports the data set machinery
    for it (30 ms)."""
    try:
        with pq.ParquetFile(part, metadata=metadata) as file:
            return file.read(columns=columns)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{part.parent}: cannot be read: {error}") from None


def drop_incomplete(folder: Path) -> int:
    """Delete the parts of cases whose part of histories is gone, so that they are flown again.
    Returns how many cases that are."""
    dropped = 0
    for part in _parts(folder, CASES):
        if not (folder / HISTORIES / part.name).is_file():
            dropped += _read_part(part, ["case"]).num_rows
            part.unlink()
    return dropped


def campaign_text(file: CampaignFile, **run: Any) -> str:
    """The resolved campaign of a folder as TOML, with other values of ``run``."""
    own = run | ({"plan": PLAN} if file.input_table else {})
    tree = {**file.tree, "run": {**file.tree.get("run", {}), **own}} if own else file.tree
    return replace(file, tree=tree).toml


def write_input_table(folder: Path, table: InputTable, inputs: list[Column]) -> None:
    """Write the table that gives inputs, so that the run can be replayed and resumed from its
    folder alone."""
    known = {column.name: column for column in inputs}
    columns = [Column(CASE, "1", "number of the case")]
    columns += [known.get(name, Column(name, "", "")) for name in table.columns]
    write_parquet(folder / PLAN, columns, {CASE: table.numbers, **table.columns})


def cases_done(folder: Path) -> np.ndarray:
    """Numbers of the cases a run folder holds, sorted; shape (n,)."""
    parts = _parts(folder, CASES)
    if not parts:
        return np.empty(0, dtype=np.int64)
    return np.sort(
        np.concatenate([_read_part(part, ["case"])["case"].to_numpy() for part in parts])
    )


def number_after(folder: Path, count: int) -> int | None:
    """Number of the case that comes after the first so many that a run holds; None if there is
    none."""
    done = cases_done(folder)
    return int(done[count]) if len(done) > count else None


def cases_held(folder: Path, ok: str) -> tuple[int, int]:
    """Number of cases a run folder holds, and how many of them have another status than ``ok``."""
    counts = [
        row
        for part in _parts(folder, CASES)
        for row in _read_part(part, ["status"])["status"].value_counts().to_pylist()
    ]
    return sum(row["counts"] for row in counts), sum(
        row["counts"] for row in counts if row["values"] != ok
    )


class CaseColumns(Mapping[str, np.ndarray]):
    """Columns of the case table of a run folder, read when they are asked for, in order of case;
    text as objects.

    A table of up to `KEPT` cases is read once, a longer one column by column, and a part at a time
    by `batches`.
    """

    KEPT = 65536

    def __init__(self, folder: Path):
        self.folder = folder
        self._parts = _parts(folder, CASES)
        if not self._parts:
            raise StoreError(f"{folder}: no {CASES}/part-*.parquet here; give the folder of a run")
        try:
            self._metadata = [pq.read_metadata(part) for part in self._parts]
        except (OSError, pa.ArrowException) as error:
            raise StoreError(f"{folder}/{CASES}: cannot be read: {error}") from None
        self.rows = sum(metadata.num_rows for metadata in self._metadata)
        self._names = self._metadata[0].schema.to_arrow_schema().names

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise KeyError(name)
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
        return pa.concat_tables(
            [
                _read_part(part, names, metadata)
                for part, metadata in zip(self._parts, self._metadata, strict=True)
            ]
        )

    def batches(
        self, names: Sequence[str]
    ) -> Iterator[tuple[np.ndarray, pd.Categorical, np.ndarray]]:
        """Part by part: numbers and statuses, shape (n,), and the columns asked for, shape
        (len(names), n)."""
        for part, metadata in zip(self._parts, self._metadata, strict=True):
            read = _read_part(part, ["case", "status", *names], metadata)
            columns = np.empty((len(names), read.num_rows))
            for row, name in zip(columns, names, strict=True):
                row[:] = read[name].to_numpy()
            yield read["case"].to_numpy(), pd.Categorical(read["status"].to_pandas()), columns


def read_cases(
    folder: Path, below: int | None = None, columns: list[str] | None = None
) -> pd.DataFrame:
    """Case rows of a run, in order of case: all, or those ``below`` a number; all columns, or
    some."""
    return _read(folder, CASES, ["case"], below, columns)


def read_row(folder: Path, number: int) -> dict[str, Any]:
    """The row of a case of a run. Raises StoreError if the run does not hold it."""
    for part in reversed(_parts(folder, CASES)):
        if part.name <= part_path(folder, CASES, number).name:
            frame = _read_part(part).to_pandas()
            found = frame[frame["case"] == number]
            if len(found):
                return {str(name): found[name].iloc[0] for name in found}
            break
    raise StoreError(f"{folder}: does not hold case {number}")


def read_histories(folder: Path, below: int | None = None) -> pd.DataFrame | None:
    """Histories of a run in long form (case, time_s, ...), of cases ``below`` a number only if
    given, or None if it kept none."""
    if not (folder / HISTORIES).is_dir():
        return None
    return _read(folder, HISTORIES, ["case", "time_s"], below)


def _read(
    folder: Path,
    kind: str,
    order: list[str],
    below: int | None = None,
    columns: list[str] | None = None,
) -> pd.DataFrame:
    parts = _parts(folder, kind)
    if not parts:
        raise StoreError(f"{folder}: no {kind}/part-*.parquet here; give the folder of a run")
    if below is not None:
        parts = [part for part in parts if part.name < part_path(folder, kind, below).name]
    frame = pd.concat([_read_part(part, columns).to_pandas() for part in parts], ignore_index=True)
    if "status" in frame:
        frame["status"] = frame["status"].astype(str)
    if below is not None:
        frame = frame[frame["case"] < below]
    return frame.sort_values(order, ignore_index=True)


def units(folder: Path, kind: str = CASES) -> dict[str, str]:
    """Unit of each column, from the metadata of the first part."""
    part = next(iter(sorted((folder / kind).glob("part-*.parquet"))), None)
    if part is None:
        return {}
    return {
        field.name: (field.metadata or {}).get(b"unit", b"").decode()
        for field in pq.read_schema(part)
    }


def write_statistics(
    folder: Path, stats: pd.DataFrame, of: dict[str, str], told: dict[str, Any]
) -> None:
    """Write ``statistics.csv``, ``of`` mapping each outcome to its unit, and ``statistics.json``
    with what is ``told``: see `statistics_as_json`."""
    frame = _with_units(stats, of)
    write_text(folder / "statistics.csv", frame.to_csv(index_label="outcome"))
    write_json(folder / "statistics.json", told)


def statistics_as_json(
    stats: pd.DataFrame,
    counts: dict[str, int],
    of: dict[str, str],
    audit: pd.DataFrame,
    failed: dict[str, list[int]] | None = None,
    verdicts: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """What ``statistics.json`` holds; ``of`` maps each outcome to its unit, ``failed`` names first
    cases by status, ``verdicts`` are those on requirements. What is not a number is null."""
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
    path = folder / "history.parquet"
    write_parquet(
        path,
        columns,
        {
            c.name: history[c.name].to_numpy(dtype=object if c.name == "phase" else None)
            for c in columns
        },
    )
    return path


def read_history(folder: Path) -> pd.DataFrame | None:
    """The time history of a single run, or None if the folder holds none."""
    path = folder / "history.parquet"
    if not path.is_file():
        return None
    frame = pq.read_table(path).to_pandas()
    frame["phase"] = frame["phase"].astype(str)
    return frame
