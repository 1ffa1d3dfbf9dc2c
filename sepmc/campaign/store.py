"""The run folder: case parts in Parquet, histories, manifest, resolved campaign. The only place
that knows pyarrow."""

import contextlib
import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from sepmc import __version__
from sepmc.analysis.told import Told
from sepmc.campaign import ledger, manifests, own_files
from sepmc.campaign.own_files import StoreError
from sepmc.campaign.part_checks import file_fault, table_fault
from sepmc.places import is_local, source
from sepmc.scene.input_table import CASE, InputTable
from sepmc.scene.limits import CAMPAIGN_BYTES, MANIFEST_BYTES
from sepmc.scene.messages import printable
from sepmc.scene.read import CampaignFile
from sepmc.schema import Column

CASES, HISTORIES, MANIFEST, CAMPAIGN = "cases", "histories", "manifest.json", "campaign.toml"
KEPT = "kept"  # rows of some cases, of a run that counts the others and lets them go
PLAN, HISTORY = "plan.parquet", "history.parquet"
_HISTOGRAMS = "histograms.csv"
_OURS = (CASES, HISTORIES, KEPT)
_PART = "part-*.parquet"
_PROBE, _CALL = "is-writable", "workers-called"
RARE = "the estimate of a rare event"  # what a folder with "rare" in its manifest holds
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
    "rare",
)
_OUR_FILES = (
    MANIFEST,
    CAMPAIGN,
    PLAN,
    ledger.LEDGER,
    _CALL,
    "statistics.csv",
    "statistics.json",
    _HISTOGRAMS,
    HISTORY,
    "drivers.csv",
    "causes.csv",
    "report.html",
    "rare.json",
    "rare.parquet",
    "film.gif",
    "film.mp4",
    *(f"{name}.{ending}" for name in _FIGURES for ending in ("png", "svg", "pdf")),
)


def next_folder(name: str, root: Path = Path("runs")) -> Path:
    """``runs/<name>-<n>`` with the smallest free n."""
    n = 1
    while (root / f"{name}-{n}").exists():
        n += 1
    return root / f"{name}-{n}"


_ours: set[Path] = set()  # folders that this process has open


@contextlib.contextmanager
def opened(
    folder: Path, overwrite: bool = False, resume: bool = False, resumable: bool = True
) -> Iterator[Path]:
    """A folder that may be written, by this process alone, without losing anything unasked; see
    `check_folder`. Raises StoreError, too, if it cannot be written."""
    if folder.resolve() in _ours:  # it is open already
        yield folder
        return
    check_folder(folder, overwrite, resume, resumable)
    is_new = not folder.exists()
    make_writable(folder)
    try:
        with _held(folder):
            if overwrite:
                _clear(folder)
            _sweep(folder)
            call_off(folder)
            _ours.add(folder.resolve())
            yield folder
    finally:
        _ours.discard(folder.resolve())
        if is_new and is_local(folder) and not any(folder.iterdir()):  # nothing came of it
            folder.rmdir()


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
        own_files.check(folder)
        if not is_run(folder):
            raise StoreError(
                f"{folder}: holds other files and no {MANIFEST}, so it is not a run; choose "
                "another --out"
            )
        if not (overwrite or resume):
            ways = (
                "add --resume to fly its missing cases, --overwrite to replace it,"
                if resumable and (folder / CASES).is_dir()
                else "add --overwrite to replace it"
            )
            raise StoreError(f"{folder}: exists; {ways} or choose another --out")
    for name in () if overwrite else _OURS:
        if (folder / name).exists() and not (folder / name).is_dir():
            raise StoreError(
                f"{folder / name}: is a file where a run keeps a folder; choose another --out"
            )


def knows_all(folder: Path) -> bool:
    """Whether the list of the files of a folder is as it was written."""
    return _has_ledger(folder) and not ledger.lost_lines(folder)


def _has_ledger(folder: Path) -> bool:
    return (folder / ledger.LEDGER).is_file()


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run, if a damaged one."""
    return (folder / MANIFEST).is_file() or _has_ledger(folder)


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Let no other process write into a folder meanwhile, where a folder can be locked. Raises
    StoreError if one does."""
    try:
        import fcntl  # noqa: PLC0415  (not on every system)
    except ImportError:
        yield
        return
    if not is_local(folder):  # objects cannot be locked
        yield
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise StoreError(
            f"{folder}: another process writes into it; wait for it, or choose another --out"
        ) from None
    except OSError:  # some shared folders cannot be
        pass
    try:
        yield
    finally:
        os.close(lock)


def make_writable(folder: Path) -> None:
    """Make a folder if there is none. Raises StoreError if nothing can be written into it."""
    try:
        if is_local(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        else:
            (folder / _PROBE).write_bytes(b"")
            (folder / _PROBE).unlink()
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
    except Exception as error:  # whatever clients of object storage raise
        if is_local(folder):
            raise
        raise StoreError(f"{folder}: cannot be reached: {error}") from None


def _clear(folder: Path) -> None:
    """Remove what a run made, and nothing else."""
    for name in _OURS:
        if is_local(folder):
            shutil.rmtree(folder / name, ignore_errors=True)
        for path in (folder / name).glob("*"):
            path.unlink()
    for path in list(folder.iterdir()) if folder.is_dir() else ():
        if path.is_file() and any(fnmatchcase(path.name, pattern) for pattern in _OUR_FILES):
            path.unlink()


def _sweep(folder: Path, kinds: Sequence[str] = (".",)) -> None:
    """Remove what processes that were killed left of files they were writing."""
    for kind in kinds if is_local(folder) else ():
        for path in (folder / kind).glob("*.????????.tmp"):
            name = Path(path.stem).stem
            if any(fnmatchcase(name, pattern) for pattern in (*_OUR_FILES, _PART)):
                path.unlink()


def call(folder: Path) -> str:
    """Call workers to write parts into a folder; returns the word by which they know that they
    still may."""
    word = uuid4().hex
    write_text(folder / _CALL, word)
    return word


def call_off(folder: Path) -> None:
    """Let workers that were called, and that nobody waits for any more, write nothing."""
    (folder / _CALL).unlink(missing_ok=True)


def is_called(folder: Path, word: str) -> bool:
    """Whether workers that were called by this word may write into a folder."""
    try:
        return (folder / _CALL).read_text(encoding="utf-8") == word
    except OSError:
        return False


def write_text(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old or the new text, never a part."""
    ledger.put(path, text.encode())


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


def write_manifest(folder: Path, manifest: Mapping[str, Any], campaign: str) -> None:
    """Write the manifest of a run folder, sealed, with a checksum of the text of the campaign,
    which is put beside it. The manifest comes first: it makes a folder a run."""
    seal(folder, {**manifest, "campaign_sha256": ledger.checksum(campaign.encode())})
    write_text(folder / CAMPAIGN, campaign)


def seal(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest of a run folder with checksums of the ledger, as it is now, and of
    itself."""
    files = ledger.read(folder).values()
    sealed = {**manifest, "files": len(files), "files_sha256": ledger.digest(files)}
    write_json(folder / MANIFEST, {**sealed, "sha256": _seal(sealed)})


def _seal(manifest: Mapping[str, Any]) -> str:
    """The checksum of a manifest, of all that it says besides."""
    said = {key: value for key, value in manifest.items() if key != "sha256"}
    return ledger.checksum(json.dumps(_finite(said), sort_keys=True).encode())


def _is_sealed(manifest: Mapping[str, Any]) -> bool:
    """Whether a manifest is as it was written."""
    return manifest.get("sha256") == _seal(manifest)


def forget(folder: Path, endings: tuple[str, ...]) -> list[str]:
    """Take files that are not as they were written out of the ledger of a folder, if their names
    end so. Returns their names."""
    held = ledger.read(folder)
    lost = [name for name, one in held.items() if name.endswith(endings) and _problem(folder, one)]
    if lost:
        ledger.rewrite(folder, [one for name, one in held.items() if name not in lost])
        seal(folder, _manifest(folder))
    return lost


@dataclass(frozen=True)
class Finding:
    """What is wrong with a run folder: a sentence, the file there if it is one that follows from
    the cases, and whether flying, counting or drawing again mends it."""

    said: str
    file: str = ""
    mends: bool = True


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run, as it was written, beside the campaign that was flown. Raises
    StoreError if there is none, or if either was changed."""
    manifest = _manifest(folder)
    for finding in changed(folder, manifest):
        raise StoreError(finding.said)
    return manifest


def made_by(folder: Path) -> dict[str, Any]:
    """By what the cases of a run folder were made: its manifest or, where that was changed, what
    its parts say: ``digest``, ``seed`` and, if they are not the first ones, ``numbers``."""
    own_files.check(folder)
    try:
        manifest = _manifest(folder)
        if _is_sealed(manifest):
            return manifest
    except StoreError:
        pass
    for path in sorted((folder / CASES).glob("part-*.parquet")):
        with contextlib.suppress(StoreError, KeyError, ValueError):
            _, said = _about(path)
            found = {"digest": said[b"digest"].decode(), "seed": int(said[b"seed"])}
            numbers = said[b"numbers"].decode()
            return found | ({"numbers": numbers} if numbers else {})
    return {}


def changed(folder: Path, manifest: Mapping[str, Any]) -> list[Finding]:
    """What is wrong with the manifest of a folder, with what was flown, and its list of files."""
    if "sha256" not in manifest:
        said = (
            f"{folder}: was flown by a version of sepmc that kept no checksums; fly it again, or "
            f"trust it as it is: sepmc doctor {folder} --repair"
        )
        return [Finding(said)]
    if not _is_sealed(manifest):
        said = "was changed since it was written: its checksum is another"
        return [Finding(f"{folder / MANIFEST}: {said}")]
    return [*_not_as_flown(folder, manifest), *_files_lost(folder, manifest)]


def _not_as_flown(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether the campaign of a folder, or the table of its inputs, is not what was flown."""
    try:
        written = ledger.checksum(own_files.content(folder / CAMPAIGN, CAMPAIGN_BYTES))
    except StoreError as error:
        yield Finding(str(error), mends=False)
    else:
        if written != manifest["campaign_sha256"]:
            said = (
                "is not the campaign that was flown; to fly it as it is now, copy it to another "
                "place"
            )
            yield Finding(f"{folder / CAMPAIGN}: {said}", mends=False)
    plan = ledger.read(folder).get(PLAN)
    if plan and (problem := _problem(folder, plan)):
        said = f"{folder / PLAN}: {problem}; it gave inputs of the cases: put it back"
        yield Finding(said, mends=False)


def _files_lost(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether the ledger of a run that is complete tells of other files."""
    files = ledger.read(folder).values()
    if manifest.get("complete", True) and ledger.digest(files) != manifest["files_sha256"]:
        said = f"was changed: it tells of {len(files)} files, and there were {manifest['files']}"
        how = f". To fly again what is not sure: sepmc campaign {folder} --out {folder} --resume"
        yield Finding(f"{folder / ledger.LEDGER}: {said}{how if holds_cases(manifest) else ''}")


def holds_cases(manifest: Mapping[str, Any]) -> bool:
    """Whether a run holds rows of cases, which can be flown one by one: it is no single flight, and
    not one of statistics only, and not the estimate of a rare event."""
    alone = "case" in manifest or "rare" in manifest
    return not alone and not manifest.get("stats_only")


def note(folder: Path, files: Iterable[Path]) -> None:
    """Note what follows from the cases of a run, statistics and figures, in its ledger."""
    names = [path.relative_to(folder).as_posix() for path in files]
    ledger.add(folder, *(ledger.entry(name, (folder / name).read_bytes()) for name in names))
    seal(folder, _manifest(folder))


def diagnose(folder: Path) -> list[Finding]:
    """All that is wrong with a run folder, file by file."""
    if not is_run(folder):
        return [Finding(f"{folder}: no {MANIFEST} here; give the folder of a run", mends=False)]
    try:
        manifest = _manifest(folder)
        found = changed(folder, manifest)
    except StoreError as error:
        manifest, found = {}, [Finding(str(error), mends=bool(made_by(folder)))]
    held, lost = ledger.read(folder), ledger.lost_lines(folder)
    if lost:
        said = f"{lost} of its lines were cut short or changed"
        found.append(Finding(f"{folder / ledger.LEDGER}: {said}"))
    for one in held.values():
        if one.file != PLAN:
            try:
                ledger.whole(folder, one)
            except ValueError as error:
                of = f", with {one.numbers}" if one.cases else ""
                found.append(Finding(f"{folder / one.file}: {error}{of}", one.file))
    for kind in _OURS:
        for path in sorted((folder / kind).glob("*")):
            if f"{kind}/{path.name}" not in held:
                said = f"is not in {ledger.LEDGER}: not finished, or not of this run"
                found.append(Finding(f"{path}: {said}"))
    if _is_sealed(manifest) and holds_cases(manifest):
        there = sum(one.cases for one in parts(folder, CASES))
        if there < manifest["cases"]:
            found.append(Finding(f"{folder}: holds {there} of {manifest['cases']} cases"))
    if not holds_cases(manifest):  # it is flown again as a whole
        found = [replace(one, mends=False) for one in found]
    return found


def trust(folder: Path) -> None:
    """Take a run folder of a version that kept no checksums as it is."""
    try:
        manifest = _manifest(folder)
    except StoreError:
        return
    if "sha256" in manifest or _has_ledger(folder):
        return
    found = []
    for kind in _OURS:
        for path in sorted((folder / kind).glob("part-*.parquet")):
            numbers = np.unique(_table(path, ["case"])["case"].to_numpy())
            if not len(numbers):
                raise StoreError(f"{path}: holds no cases")
            name = f"{kind}/{path.name}"
            one = ledger.entry(name, path.read_bytes(), int(numbers[0]), len(numbers))
            found.append(one)
    ledger.rewrite(folder, found)
    write_manifest(folder, manifest, _campaign_text(folder))


def _campaign_text(folder: Path) -> str:
    try:
        return own_files.content(folder / CAMPAIGN, CAMPAIGN_BYTES).decode()
    except UnicodeDecodeError as error:
        raise StoreError(f"{folder / CAMPAIGN}: is not text in UTF-8: {error}") from None


def _manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run, whatever it says. Raises StoreError if there is none."""
    path = folder / MANIFEST
    own_files.check(folder)
    if not (path.exists() or (is_local(path) and path.is_symlink())):
        raise StoreError(f"{folder}: no {MANIFEST} here; give the folder of a run")
    try:
        return manifests.read(own_files.content(path, MANIFEST_BYTES))
    except ValueError as error:
        raise StoreError(f"{path}: cannot be read: {error}") from None


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
    written, content = table(columns, data, about), pa.BufferOutputStream()
    text = [field.name for field in written.schema if pa.types.is_dictionary(field.type)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(written, content, compression="snappy", use_dictionary=text or False)
        whole = content.getvalue().to_pybytes()
        ledger.put(path, whole)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be written: {error}") from None
    return whole


def write_part(
    folder: Path,
    kind: str,
    first: int,
    cases: int,
    columns: list[Column],
    data: dict[str, Any],
    about: dict[str, str],
) -> ledger.Entry:
    """Write the part of a run that begins with case ``first``; it counts once it is noted."""
    path = part_path(folder, kind, first)
    content = write_parquet(path, columns, data, about)
    return ledger.entry(f"{kind}/{path.name}", content, first, cases)


def note_parts(folder: Path, parts: Iterable[ledger.Entry]) -> None:
    """Note parts of a run in its ledger, in the order in which they count."""
    try:
        ledger.add(folder, *parts)
    except OSError as error:
        raise StoreError(f"{folder / ledger.LEDGER}: cannot be written: {error}") from None


def replace_parts(folder: Path, kind: str, parts: Iterable[ledger.Entry]) -> None:
    """Put new parts, which are written, in place of all those of a kind."""
    new = {one.file: one for one in parts}
    others = [one for one in ledger.read(folder).values() if not one.file.startswith(f"{kind}/")]
    ledger.rewrite(folder, [*others, *new.values()])
    for path in (folder / kind).glob(_PART):
        if f"{kind}/{path.name}" not in new:
            path.unlink()


def part_path(folder: Path, kind: str, first: int) -> Path:
    """Path of the part that begins with case ``first``."""
    return folder / kind / f"part-{first:010d}.parquet"


def sweep_parts(folder: Path) -> None:
    """Remove what workers that were lost left of parts they were writing."""
    _sweep(folder, _OURS)


def parts(folder: Path, kind: str) -> list[ledger.Entry]:
    """Parts of a run, in order of their first case."""
    held = [one for one in ledger.read(folder).values() if one.file.startswith(f"{kind}/")]
    return sorted((one for one in held if one.cases), key=lambda one: one.first)


_whole: set[tuple[str, int, int, str]] = set()  # files that were seen as they were written


def _problem(folder: Path, one: ledger.Entry) -> str:
    """What is wrong with a file; nothing, if it is as it was written, which is seen once."""
    path = folder / one.file
    try:
        state = path.stat()
        known = (str(path.absolute()), state.st_mtime_ns, state.st_size, one.sha256)
        if known not in _whole:
            ledger.whole(folder, one)
            _whole.add(known)
    except OSError:
        return "is gone"
    except ValueError as error:
        return str(error)
    return ""


def _path(folder: Path, one: ledger.Entry) -> Path:
    """Path of a part, which is as it was written. Raises StoreError if it is not, with the file,
    its cases and what to do."""
    if problem := _problem(folder, one):
        raise StoreError(
            f"{folder / one.file}: {problem}; it held {one.numbers}. To fly these again: sepmc "
            f"campaign {folder} --out {folder} --resume"
        )
    return folder / one.file


def _read_part(folder: Path, one: ledger.Entry, columns: Sequence[str] | None = None) -> pa.Table:
    """Columns of a part. Not by `pyarrow.parquet.read_table`, which imports the data set machinery
    for it (30 ms)."""
    path = _path(folder, one)
    of_cases = one.file.startswith(f"{CASES}/")
    return _table(path, columns, *((one.cases, one.first) if of_cases else ()))


def _table(
    path: Path,
    columns: Sequence[str] | None = None,
    rows: int | None = None,
    first: int | None = None,
    content: bytes | None = None,
) -> pa.Table:
    """Columns of a part, or of what it holds. Raises StoreError if they are none of a run."""
    try:
        with pq.ParquetFile(source(path) if content is None else pa.BufferReader(content)) as file:
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


def _about(path: Path) -> tuple[pa.Schema, dict[bytes, bytes]]:
    """The schema of a part, and what it says of itself. Raises StoreError if it is none of a
    run."""
    try:
        with pq.ParquetFile(source(path)) as file:
            if fault := file_fault(file, path.stat().st_size):
                raise StoreError(f"{path}: {fault}")
            return file.schema_arrow, file.schema_arrow.metadata or {}
    except (OSError, ValueError, pa.ArrowException) as error:
        raise StoreError(f"{path}: cannot be read: {printable(str(error))}") from None


def read_part(folder: Path, one: ledger.Entry) -> dict[str, np.ndarray]:
    """All columns of a part, text as objects."""
    frame = _read_part(folder, one).to_pandas()
    text = [name for name in frame if frame[name].dtype == "category"]
    told = frame.astype(dict.fromkeys(text, object))
    return {str(name): values.to_numpy() for name, values in told.items()}


def drop_damaged(folder: Path, with_histories: bool) -> int:
    """Forget parts that are gone or not as they were written, and those of cases whose histories
    are, if they should have some, so that these are flown again. Returns how many cases that
    are."""
    held = ledger.read(folder)
    sound = {one.file: one for one in held.values() if not _problem(folder, one)}
    kept, dropped = {name: one for name, one in held.items() if not one.cases}, 0
    for one in parts(folder, CASES):
        over_time = f"{HISTORIES}/{Path(one.file).name}"
        if one.file in sound and (over_time in sound or not with_histories):
            kept |= {name: sound[name] for name in (one.file, over_time) if name in sound}
        else:
            dropped += one.cases
    ledger.rewrite(folder, kept.values())
    for kind in _OURS:
        for path in (folder / kind).glob("part-*.parquet*"):
            if f"{kind}/{path.name}" not in kept:
                path.unlink()
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
    content = write_parquet(folder / PLAN, columns, {CASE: table.numbers, **table.columns})
    ledger.add(folder, ledger.entry(PLAN, content))


def cases_done(folder: Path) -> np.ndarray:
    """Numbers of the cases a run folder holds, sorted; shape (n,)."""
    held = [np.arange(one.first, one.first + one.cases) for one in parts(folder, CASES)]
    return np.concatenate(held) if held else np.empty(0, dtype=np.int64)


def number_after(folder: Path, count: int) -> int | None:
    """Number of the case that comes after the first so many that a run holds; None if there is
    none."""
    done = cases_done(folder)
    return int(done[count]) if len(done) > count else None


def tallies(folder: Path) -> Iterator[str]:
    """What was counted of the cases of each part of a run: `sepmc.campaign.tally.Tally.text`."""
    for one in parts(folder, CASES):
        _, said = _about(_path(folder, one))
        if b"tally" not in said:
            raise StoreError(
                f"{folder}: was flown by a version of sepmc that counted less, so its cases cannot "
                "be continued; use --overwrite or another --out"
            )
        yield said[b"tally"].decode(errors="replace")


class NoColumn(StoreError, KeyError):
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
        self._parts = parts(folder, CASES)
        if not self._parts:
            raise StoreError(f"{folder}: holds no cases; give the folder of a run")
        self.rows = sum(part.cases for part in self._parts)
        self._names = _about(_path(folder, self._parts[0]))[0].names

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise NoColumn(f"{self.folder}: has no column {name}")
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
        read = [_read_part(self.folder, part, names) for part in self._parts]
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
            read = _read_part(self.folder, part, ["case", "status", *names])
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
    for part in parts(folder, CASES):
        if part.first <= number < part.first + part.cases:
            frame = _read_part(folder, part).to_pandas(ignore_metadata=True)
            found = frame[frame["case"] == number]
            return {str(name): found[name].iloc[0] for name in found}
    raise StoreError(f"{folder}: does not hold case {number}")


def read_histories(folder: Path, below: int | None = None) -> pd.DataFrame | None:
    """Histories of a run in long form (case, time_s, ...), of cases ``below`` a number only if
    given, or None if it kept none."""
    if not parts(folder, HISTORIES):
        return None
    return _read(folder, HISTORIES, ["case", "time_s"], below)


def _read(
    folder: Path,
    kind: str,
    order: list[str],
    below: int | None = None,
    columns: list[str] | None = None,
) -> pd.DataFrame:
    held = parts(folder, kind)
    if not held:
        raise StoreError(f"{folder}: holds no {kind}; give the folder of a run")
    frame = pd.concat(
        [
            _read_part(folder, part, columns).to_pandas(ignore_metadata=True)
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


def units(folder: Path, kind: str = CASES) -> dict[str, str]:
    """Unit of each column, from the metadata of the first part."""
    part = next(iter(parts(folder, kind)), None)
    if part is None:
        return {}
    return {
        field.name: (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        for field in _about(_path(folder, part))[0]
    }


def write_statistics(
    folder: Path, stats: pd.DataFrame, of: dict[str, str], told: dict[str, Any]
) -> None:
    """Write ``statistics.csv``, ``of`` mapping each outcome to its unit, and ``statistics.json``
    with what is ``told``: see `statistics_as_json`."""
    frame = _with_units(stats, of)
    write_text(folder / "statistics.csv", frame.to_csv(index_label="outcome"))
    write_json(folder / "statistics.json", told)


def write_histograms(folder: Path, bins: pd.DataFrame) -> Path:
    """Write the bins of histograms, ``histograms.csv``; returns its path."""
    path = folder / _HISTOGRAMS
    write_text(path, bins.to_csv(index=False))
    return path


def read_told(folder: Path) -> Told:
    """Statistics and histograms of a run that kept no cases. Raises StoreError if they are not
    there as they were written."""
    held, frames = ledger.read(folder), []
    for name, index in (("statistics.csv", "outcome"), (_HISTOGRAMS, None)):
        problem = _problem(folder, held[name]) if name in held else "is not there"
        if problem:
            raise StoreError(f"{folder / name}: {problem}; fly the run again with --overwrite")
        frames.append(pd.read_csv(source(folder / name), index_col=index))
    table, bins = frames
    return Told(table.drop(columns="unit"), bins)


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
    path = folder / HISTORY
    content = write_parquet(
        path,
        columns,
        {
            c.name: history[c.name].to_numpy(dtype=object if c.name == "phase" else None)
            for c in columns
        },
    )
    ledger.rewrite(folder, [ledger.entry(HISTORY, content)])
    return path


def read_history(folder: Path) -> pd.DataFrame | None:
    """The time history of a single run, or None if the folder holds none."""
    one = ledger.read(folder).get(HISTORY)
    if one is None:
        return None
    try:
        content = ledger.whole(folder, one)
    except ValueError as error:
        raise StoreError(f"{folder / HISTORY}: {error}; fly it again with --overwrite") from None
    frame = _table(folder / HISTORY, content=content).to_pandas(ignore_metadata=True)
    if not {"time_s", "phase"} <= set(frame):
        raise StoreError(f"{folder / HISTORY}: is no history")
    frame["phase"] = frame["phase"].astype(str)
    return frame
