"""The folder of a run: what it is called, what lies in it, who may write it, and how its files are
written."""

import contextlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from uuid import uuid4

from sepmc.campaign.store import ledger, untrusted
from sepmc.campaign.store.untrusted import StoreError
from sepmc.locks import locked
from sepmc.paths import is_local
from sepmc.wording import option, switch

MANIFEST, CAMPAIGN = "manifest.json", "campaign.toml"
# rows and histories of all cases; of a run that lets cases go, rows of some, and what is counted
CASES, HISTORIES, SELECTED, ACCUMULATORS = DATA_FOLDERS = untrusted.KINDS
SAMPLES, HISTORY = "samples.parquet", "history.parquet"
HISTOGRAMS = "histograms.csv"
SHARD_PATTERN = "part-*.parquet"
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
    "sensitivity",
    "scatter",
    "rare",
)
_FOLLOWING = (  # from the cases
    "statistics.csv",
    "statistics.json",
    HISTOGRAMS,
    HISTORY,
    "sensitivity.csv",
    "causes.csv",
    "distributions.csv",
    "report.html",
    "rare.json",
    "rare.parquet",
    "animation.gif",
    "animation.mp4",
    *(f"{name}.{ending}" for name in _FIGURES for ending in ("png", "svg", "pdf")),
)
# data folders and sample table of format 1, which overwriting removes too
_FORMAT_1 = ("kept", "counted")
_OUR_FILES = (MANIFEST, CAMPAIGN, SAMPLES, "plan.parquet", ledger.LEDGER, _CALL, *_FOLLOWING)


def next_folder(name: str, root: Path = Path("runs")) -> Path:
    """``runs/<name>-<n>`` with the smallest free n."""
    n = 1
    while (root / f"{name}-{n}").exists():
        n += 1
    return root / f"{name}-{n}"


_ours: set[Path] = set()  # folders that this process has open
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_ours.clear)  # a process made by fork has none open


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
            revoke_lease(folder)
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
        raise StoreError(f"{folder}: is a file; give {option('out')} a folder")
    if folder.is_dir() and any(not _is_left(path) for path in folder.iterdir()):
        untrusted.check_entries(folder)
        if not is_run(folder):
            raise StoreError(
                f"{folder}: holds other files and no {MANIFEST}, so it is not a run; choose "
                f"another {option('out')}"
            )
        if not (overwrite or resume):
            ways = (
                f"add {switch('resume')} to fly its missing cases, {switch('overwrite')} to "
                "replace it,"
                if resumable and any((folder / kind).is_dir() for kind in (CASES, ACCUMULATORS))
                else f"add {switch('overwrite')} to replace it"
            )
            raise StoreError(f"{folder}: exists; {ways} or choose another {option('out')}")
    for name in () if overwrite else DATA_FOLDERS:
        if (folder / name).exists() and not (folder / name).is_dir():
            raise StoreError(
                f"{folder / name}: is a file where a run keeps a folder; choose another "
                f"{option('out')}"
            )


def ledger_is_intact(folder: Path) -> bool:
    """Whether the list of the files of a folder is as it was written."""
    return has_ledger(folder) and not ledger.count_damaged_lines(folder)


def has_ledger(folder: Path) -> bool:
    return (folder / ledger.LEDGER).is_file()


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run, if a damaged one."""
    return (folder / MANIFEST).is_file() or has_ledger(folder)


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Let no other process write into a folder meanwhile, where a folder can be locked. Raises
    StoreError if one does."""
    if not is_local(folder):  # objects cannot be locked
        yield
        return
    try:
        lock = contextlib.ExitStack()
        lock.enter_context(locked(folder, os.O_RDONLY, wait=False))
    except BlockingIOError:
        raise StoreError(
            f"{folder}: another process writes into it; wait for it, or choose another "
            f"{option('out')}"
        ) from None
    with lock:
        yield


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
    for name in (*DATA_FOLDERS, *_FORMAT_1):
        if is_local(folder):
            shutil.rmtree(folder / name, ignore_errors=True)
        for path in (folder / name).glob("*"):
            path.unlink()
    for path in list(folder.iterdir()) if folder.is_dir() else ():
        if path.is_file() and _is_one(path.name, _OUR_FILES):
            path.unlink()


def is_derived(name: str) -> bool:
    """Whether a name is that of what follows from the cases of a run: statistics, tables,
    figures."""
    return _is_one(name, _FOLLOWING)


def _is_one(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _sweep(folder: Path, kinds: Sequence[str] = (".",)) -> None:
    """Remove what processes that were killed left of files they were writing."""
    for kind in kinds if is_local(folder) else ():
        for path in (folder / kind).glob("*.????????.tmp"):
            if _is_left(path):
                path.unlink()


def _is_left(path: Path) -> bool:
    """Whether a file is what a process that was killed left of one that it was writing."""
    return _is_one(path.name, [f"{one}.????????.tmp" for one in (*_OUR_FILES, SHARD_PATTERN)])


def issue_lease(folder: Path) -> str:
    """Call workers to write parts into a folder; returns the word by which they know that they
    still may."""
    word = uuid4().hex
    write_text(folder / _CALL, word)
    return word


def revoke_lease(folder: Path) -> None:
    """Let workers that were called, and that nobody waits for any more, write nothing."""
    (folder / _CALL).unlink(missing_ok=True)


def lease_is_valid(folder: Path, word: str) -> bool:
    """Whether workers that were called by this word may write into a folder."""
    try:
        return (folder / _CALL).read_text(encoding="utf-8") == word
    except OSError:
        return False


def write_text(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old or the new text, never a part."""
    ledger.write_atomically(path, text.encode())


def write_json(path: Path, data: Any) -> None:
    """Write JSON: see `json_text`."""
    write_text(path, json_text(data))


def json_text(data: Any) -> str:
    """Data as JSON; a number that is not finite becomes null, as JSON has none."""
    return json.dumps(finite(data), indent=2, allow_nan=False) + "\n"


def finite(data: Any) -> Any:
    """Data with None in place of numbers that are not finite."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def remove_temporary_shards(folder: Path) -> None:
    """Remove what workers that were lost left of parts they were writing."""
    _sweep(folder, DATA_FOLDERS)
