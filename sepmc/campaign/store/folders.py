"""Folder of a run: names of its files, checks before it is written, locks and leases of writers,
atomic writes.

Functions that write or remove files raise OSError if that fails, unless they say otherwise; in
object storage the error can be one of its client.
"""

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
from sepmc.wording import exists, option, switch

MANIFEST, CAMPAIGN = "manifest.json", "campaign.toml"
# rows and histories of all cases; of a run of statistics, selected rows and accumulators
CASES, HISTORIES, SELECTED, ACCUMULATORS = DATA_FOLDERS = untrusted.KINDS
SAMPLES, HISTORY = "samples.parquet", "history.parquet"
HISTOGRAMS = "histograms.csv"
SIZING = "sizing.json"
SHARD_PATTERN = "part-*.parquet"
_WRITE_PROBE, _LEASE = "is-writable", "workers-called"
RARE = "the estimate of a rare event"  # in a folder with "rare" in its manifest
_FIGURES = (
    "hist_*",
    "histograms",
    "*separation*",
    "force_on_*",
    "moment_on_*",
    "rates",
    "angles",
    "axial_acceleration",
    "hinges",
    "relative_motion",
    "signals",
    "clearances",
    "pin_loads",
    "requirements",
    "convergence",
    "sensitivity",
    "scatter",
    "rare",
    "telemetry",
    "posterior",
)
_DERIVED = (  # derived from the cases
    "statistics.csv",
    "statistics.json",
    HISTOGRAMS,
    HISTORY,
    SIZING,
    "sensitivity.csv",
    "causes.csv",
    "telemetry.csv",
    "telemetry.json",
    "posterior.csv",
    "posterior.json",
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
_OUR_FILES = (MANIFEST, CAMPAIGN, SAMPLES, "plan.parquet", ledger.LEDGER, _LEASE, *_DERIVED)


def next_folder(name: str, root: Path = Path("runs")) -> Path:
    """First folder ``<root>/<name>-<n>``, n = 1, 2, ..., that does not exist; it is not created."""
    n = 1
    while (root / f"{name}-{n}").exists():
        n += 1
    return root / f"{name}-{n}"


_open_folders: set[Path] = set()  # open in this process
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_open_folders.clear)  # a forked process has none open


@contextlib.contextmanager
def opened(
    folder: Path, overwrite: bool = False, resume: bool = False, resumable: bool = True
) -> Iterator[Path]:
    """Context in which a run folder exists and is locked, so that only this process writes into it.

    The folder is created if needed. Temporary files of killed processes and the lease of earlier
    workers are removed. A folder that is open already in this process is yielded at once. A folder
    that was created here and is still empty at the end is removed, with its parents likewise.

    Parameters
    ----------
    folder : Path
    overwrite : bool
        True: remove the run that the folder contains.
    resume : bool
        True: leave the run that the folder contains, to be continued.
    resumable : bool
        If False, errors do not advise to resume.

    Yields
    ------
    Path
        ``folder``.

    Raises
    ------
    StoreError
        If `check_folder` refuses the folder, if it cannot be written, or if another process has it
        open.
    """
    if folder.resolve() in _open_folders:  # open already
        yield folder
        return
    check_folder(folder, overwrite, resume, resumable)
    local = is_local(folder)
    created = [path for path in (folder, *folder.parents) if local and not path.exists()]
    make_writable(folder)
    try:
        with _locked_folder(folder):
            if overwrite:
                clear(folder)
            _remove_temporary(folder)
            revoke_lease(folder)
            _open_folders.add(folder.resolve())
            yield folder
    finally:
        _open_folders.discard(folder.resolve())
        with contextlib.suppress(OSError):  # is not empty
            for path in created:
                path.rmdir()


def check_folder(
    folder: Path, overwrite: bool = False, resume: bool = False, resumable: bool = True
) -> None:
    """Check that a run may be written into a folder, without changing anything.

    Parameters
    ----------
    folder : Path
    overwrite : bool
        True: accept a folder with a run, which will be removed.
    resume : bool
        True: accept a folder with a run, which will be continued.
    resumable : bool
        If False, the message of the error does not advise to resume; nothing else changes.

    Raises
    ------
    StoreError
        If the folder contains a run and neither ``overwrite`` nor ``resume`` is True, if it
        contains a link or files but no run, if it is a file, or, unless ``overwrite`` is True, if
        it has a file where a run keeps a folder.
    """
    if folder.exists() and not folder.is_dir():
        raise StoreError(f"{folder}: is a file; give {option('out')} a folder")
    if folder.is_dir() and any(not _is_temporary(path) for path in folder.iterdir()):
        untrusted.check_entries(folder)
        if not is_run(folder):
            raise StoreError(
                f"{folder}: contains other files and no {MANIFEST}, so it is not a run; choose "
                f"another {option('out')}"
            )
        if not (overwrite or resume):
            has_cases = any((folder / kind).is_dir() for kind in (CASES, ACCUMULATORS))
            resuming = (
                f"{switch('resume')} to run its missing cases" if resumable and has_cases else ""
            )
            raise StoreError(exists(folder, resuming))
    for name in () if overwrite else DATA_FOLDERS:
        if (folder / name).exists() and not (folder / name).is_dir():
            raise StoreError(
                f"{folder / name}: is a file where a run keeps a folder; choose another "
                f"{option('out')}"
            )


def ledger_is_intact(folder: Path) -> bool:
    """Return True if the folder has a ledger and every line of it is intact; also if it has one
    that cannot be read or is too large."""
    return has_ledger(folder) and not ledger.count_damaged_lines(folder)


def has_ledger(folder: Path) -> bool:
    """Return True if the folder has a ledger, the file that lists its files with checksums."""
    return (folder / ledger.LEDGER).is_file()


def is_run(folder: Path) -> bool:
    """Return True if the folder has a manifest or a ledger: it is a run folder, perhaps a damaged
    one."""
    return (folder / MANIFEST).is_file() or has_ledger(folder)


@contextlib.contextmanager
def _locked_folder(folder: Path) -> Iterator[None]:
    """Context in which a local folder is locked against other processes; raises StoreError if
    another one has locked it. Object storage is not locked."""
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
    """Create a folder if needed, and check that it can be written, by a temporary file. Raises
    StoreError if not."""
    try:
        if is_local(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        else:
            (folder / _WRITE_PROBE).write_bytes(b"")
            (folder / _WRITE_PROBE).unlink()
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
    except Exception as error:  # clients of object storage raise errors of their own
        if is_local(folder):
            raise
        raise StoreError(f"{folder}: cannot be reached: {error}") from None


def clear(folder: Path) -> None:
    """Remove the files and data folders of a run from a folder, and nothing else."""
    for name in (*DATA_FOLDERS, *_FORMAT_1):
        if is_local(folder):
            shutil.rmtree(folder / name, ignore_errors=True)
        for path in (folder / name).glob("*"):
            path.unlink()
    for path in list(folder.iterdir()) if folder.is_dir() else ():
        if path.is_file() and _matches(path.name, _OUR_FILES):
            path.unlink()


def is_derived(name: str) -> bool:
    """Return True if a file with this name is a result derived from the cases: statistics, a table,
    a report, a figure, an animation, or the history of a single case."""
    return _matches(name, _DERIVED)


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _remove_temporary(folder: Path, kinds: Sequence[str] = (".",)) -> None:
    """Remove all temporary files of runs, as killed processes leave behind, from some subfolders,
    ``kinds`` (names), of a local folder; by default from the folder itself. No process may write
    there meanwhile: files of a running one are removed too."""
    for kind in kinds if is_local(folder) else ():
        for path in (folder / kind).glob("*.????????.tmp"):
            if _is_temporary(path):
                path.unlink()


def _is_temporary(path: Path) -> bool:
    """Return True if a path has the name of a temporary file of a run, as killed processes leave
    behind."""
    return _matches(path.name, [f"{one}.????????.tmp" for one in (*_OUR_FILES, SHARD_PATTERN)])


def issue_lease(folder: Path) -> str:
    """Allow workers to write shards into a run folder, until `revoke_lease`, by a file with a
    random token (the lease); returns that token. An earlier lease becomes invalid."""
    lease = uuid4().hex
    write_text(folder / _LEASE, lease)
    return lease


def revoke_lease(folder: Path) -> None:
    """End the lease of a run folder, if there is one, by removing its file: workers then no longer
    write into the folder."""
    (folder / _LEASE).unlink(missing_ok=True)


def lease_is_valid(folder: Path, lease: str) -> bool:
    """Return True if the token ``lease`` from `issue_lease` is still that of the folder, so that
    workers may write into it."""
    try:
        return (folder / _LEASE).read_text(encoding="utf-8") == lease
    except OSError:
        return False


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 atomically: readers see the old or the new content. Raises OSError
    if it cannot be written."""
    ledger.write_atomically(path, text.encode())


def write_json(path: Path, data: Any) -> None:
    """Write data as a JSON file atomically; numbers that are not finite become null. Raises OSError
    if it cannot be written."""
    write_text(path, json_text(data))


def json_text(data: Any) -> str:
    """JSON text of nested data, indented; numbers that are not finite become null."""
    return json.dumps(finite(data), indent=2, allow_nan=False) + "\n"


def finite(data: Any) -> Any:
    """Copy of nested dicts and lists with None in place of floats that are not finite; tuples
    become lists."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def remove_temporary_shards(folder: Path) -> None:
    """Remove the temporary files that killed workers left in the data folders of a run."""
    _remove_temporary(folder, DATA_FOLDERS)
