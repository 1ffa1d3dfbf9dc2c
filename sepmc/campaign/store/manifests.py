"""Manifest of a run folder (``manifest.json``): writing it with checksums, checking these, and
listing the faults of a run folder.

Functions that read the ledger raise StoreError if it cannot be read; those that write or delete
files raise OSError if that fails.
"""

import contextlib
import json
import platform
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from sepmc import __version__
from sepmc.campaign.store import folders, ledger, manifest_schema, shards, untrusted
from sepmc.campaign.store.untrusted import StoreError
from sepmc.paths import is_local
from sepmc.scene.limits import CAMPAIGN_BYTES, MANIFEST_BYTES
from sepmc.wording import another_place, flying_again


def write_manifest(folder: Path, manifest: Mapping[str, Any], campaign: str) -> None:
    """Write manifest and campaign file (text ``campaign``) of a run folder.

    The manifest is written first, as it makes a folder a run folder; a checksum of the campaign
    text is added to it, and those of `seal`.
    """
    seal(folder, {**manifest, "campaign_sha256": ledger.checksum(campaign.encode())})
    folders.write_text(folder / folders.CAMPAIGN, campaign)


def seal(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write a manifest into a folder with a checksum of the ledger, as it is now, and one of itself
    (a seal), so that later changes of both are noticed."""
    files = ledger.read(folder).values()
    sealed = {
        **manifest,
        "format": manifest_schema.FORMAT,
        "files": len(files),
        "files_sha256": ledger.digest(files),
    }
    folders.write_json(folder / folders.MANIFEST, {**sealed, "sha256": _checksum_of(sealed)})


def _checksum_of(manifest: Mapping[str, Any]) -> str:
    """Checksum of the entries of a manifest, without the entry with its own checksum."""
    content = {key: value for key, value in manifest.items() if key != "sha256"}
    return ledger.checksum(json.dumps(folders.finite(content), sort_keys=True).encode())


def _is_sealed(manifest: Mapping[str, Any]) -> bool:
    """Return True if a manifest contains the right checksum of itself: it was not changed."""
    return manifest.get("sha256") == _checksum_of(manifest)


def forget_damaged(folder: Path, endings: tuple[str, ...]) -> list[str]:
    """Remove missing or damaged files whose names have one of the ``endings`` from the ledger of a
    folder, and seal the manifest again; return their names. Nothing is written if there are none.
    The files are not deleted. Raises StoreError if the manifest must be sealed but cannot be
    read."""
    entries = ledger.read(folder)
    candidates = [(name, entry) for name, entry in entries.items() if name.endswith(endings)]
    damaged = [name for name, entry in candidates if shards.find_fault(folder, entry)]
    if damaged:
        ledger.rewrite(folder, [entry for name, entry in entries.items() if name not in damaged])
        seal(folder, _manifest(folder))
    return damaged


class OtherFormatError(StoreError):
    """A run folder has a format that another version of sepmc wrote and this one cannot read."""


@dataclass(frozen=True)
class Finding:
    """One fault of a run folder.

    Attributes
    ----------
    text : str
        The fault in words, beginning with the path of the file.
    file : str
        Path, relative to the folder, of the recorded file that is missing or damaged; empty for
        other faults.
    repairable : bool
        True if ``sepmc doctor --repair`` can repair it: by running cases or drawing figures again.
    advice : str
        What to do if it is not repairable.
    """

    text: str
    file: str = ""
    repairable: bool = True
    advice: str = "run it again"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a run folder, after checking that nothing was changed since it was
    written.

    Returns
    -------
    dict of str to Any
        Entries of the manifest by key.

    Raises
    ------
    StoreError
        If there is no manifest, if it cannot be read, or if the manifest, the campaign, its sample
        table, or the ledger of a complete run was changed.
    """
    manifest = _manifest(folder, f"; to see what would repair it: sepmc doctor {folder}")
    for finding in changed_files(folder, manifest):
        raise StoreError(finding.text)
    return manifest


def read_provenance(folder: Path) -> dict[str, Any]:
    """Entries of the manifest of a run folder by key, also of a damaged folder.

    If the manifest is missing or was changed, they are the few entries that the metadata of a shard
    contains (`sepmc.campaign.store.manifest_schema.shard_provenance`), or none if no shard can be
    read. Raises OtherFormatError for a folder with the format of another version, StoreError for
    one that contains links or special files.
    """
    untrusted.check_entries(folder)
    try:
        manifest = _manifest(folder)
        if _is_sealed(manifest):
            return manifest
    except OtherFormatError:
        raise
    except StoreError:
        pass
    paths = (
        path
        for kind in (folders.CASES, folders.ACCUMULATORS, folders.SELECTED)
        for path in sorted((folder / kind).glob("part-*.parquet"))
    )
    for path in paths:
        with contextlib.suppress(StoreError, KeyError, ValueError):
            _, metadata = shards.read_metadata(path)
            return manifest_schema.shard_provenance(metadata)
    return {}


def changed_files(folder: Path, manifest: Mapping[str, Any]) -> list[Finding]:
    """Faults of a folder whose manifest, campaign file, sample table or ledger was changed since
    the manifest was written, or is gone; empty if none was. If the manifest itself was changed,
    that is the only fault. The ledger of an incomplete run, which still changes, has none.
    ``manifest`` are the entries of the manifest by key."""
    if not _is_sealed(manifest):
        reason = "was changed since it was written: the checksum that it contains is not its own"
        return [Finding(f"{folder / folders.MANIFEST}: {reason}")]
    return [*_changed_campaign(folder, manifest), *_changed_ledger(folder, manifest)]


def _changed_campaign(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield a fault if the campaign file of a folder is missing or was changed since its
    ``manifest`` was written, and one if the sample table in the ledger is."""
    try:
        checksum = ledger.checksum(
            untrusted.read_bounded(folder / folders.CAMPAIGN, CAMPAIGN_BYTES)
        )
    except StoreError as error:
        yield Finding(str(error), repairable=False, advice=restore_advice(folder))
    else:
        if checksum != manifest["campaign_sha256"]:
            reason = (
                "is not the campaign that was run; to run it as it is now, copy it out of the run "
                "folder"
            )
            text = f"{folder / folders.CAMPAIGN}: {reason}"
            yield Finding(text, repairable=False, advice=restore_advice(folder))
    samples = ledger.read(folder).get(folders.SAMPLES)
    if samples and (problem := shards.find_fault(folder, samples)):
        reason = f"{folder / folders.SAMPLES}: {problem}; it contains the inputs of the cases"
        yield Finding(reason, repairable=False, advice="restore it from a copy")


def restore_advice(folder: Path) -> str:
    """Advice for a message about a changed or missing campaign file of a run folder: restore it, or
    continue the run with the file that it was made from."""
    return (
        f"restore {folders.CAMPAIGN}, or continue with the file that it was made from: "
        f"{flying_again(folder, 'FILE')}"
    )


def _changed_ledger(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield a fault if the ledger of a complete run is gone or has other entries than when its
    ``manifest`` was written; none for an incomplete run, whose ledger still changes."""
    files = ledger.read(folder).values()
    if manifest.get("complete", True) and ledger.digest(files) != manifest["files_sha256"]:
        reason = f"was changed: it lists {len(files)} files instead of {manifest['files']}"
        reason = reason if folders.has_ledger(folder) else "is gone"
        advice = f". To run missing cases again: {flying_again(folder)}"
        yield Finding(
            f"{folder / ledger.LEDGER}: {reason}{advice if is_resumable(manifest) else ''}"
        )


def has_case_rows(manifest: Mapping[str, Any]) -> bool:
    """Return True if the run of a manifest stores the rows of all cases that it has run, also if it
    is not complete. It does not if it is a single case, a rare-event estimate, or stores statistics
    only."""
    return is_resumable(manifest) and not manifest.get("stats_only")


def is_resumable(manifest: Mapping[str, Any]) -> bool:
    """Return True if missing cases of the run of a manifest can be run by resuming it. They cannot
    if it is a single case or a rare-event estimate."""
    return not ("case" in manifest or "rare" in manifest)


def record_derived(folder: Path, files: Iterable[Path]) -> None:
    """Record files that are derived from the cases of a run, such as statistics and figures, in its
    ledger, and seal the manifest again. ``files`` are paths that begin with ``folder``. Raises
    StoreError if the manifest cannot be read."""
    names = [path.relative_to(folder).as_posix() for path in files]
    ledger.add(folder, *(ledger.make_entry(name, (folder / name).read_bytes()) for name in names))
    seal(folder, _manifest(folder))


def is_recorded(folder: Path, name: str) -> bool:
    """Return True if the ledger of a folder has an entry for the file ``name``, and the file is
    intact."""
    entry = ledger.read(folder).get(name)
    return entry is not None and not shards.find_fault(folder, entry)


def drop_derived(folder: Path) -> list[str]:
    """Delete the recorded files that are derived from the cases of a run, and remove them from the
    ledger; return their names."""
    entries = ledger.read(folder)
    derived = [name for name in entries if folders.is_derived(name)]
    for name in derived:
        (folder / name).unlink(missing_ok=True)
    if derived:
        ledger.rewrite(folder, [entry for name, entry in entries.items() if name not in derived])
    return derived


def foreign_shards(folder: Path, manifest: Mapping[str, Any]) -> list[Finding]:
    """Find shards (Parquet files) of another campaign or seed than the manifest has, by their
    metadata; a fault for each. Shards of histories are not examined.

    If the ledger has such a shard, and it is intact, then manifest and campaign file belong to
    another run than the ledger: that cannot be repaired. Otherwise only the shard is foreign, and
    its cases can be run again.
    """
    findings, entries = [], ledger.read(folder)
    expected = {key: manifest[key] for key in ("digest", "seed") if manifest.get(key) is not None}
    for kind in (folders.CASES, folders.ACCUMULATORS, folders.SELECTED):
        for path in sorted((folder / kind).glob("part-*.parquet")):
            try:
                provenance = manifest_schema.shard_provenance(shards.read_metadata(path)[1])
            except (StoreError, KeyError, ValueError):
                continue  # reported as damaged
            if all(provenance[key] == value for key, value in expected.items()):
                continue
            entry = entries.get(f"{kind}/{path.name}")
            is_recorded_shard = entry is not None and not shards.find_fault(folder, entry)
            seed, expected_seed = provenance["seed"], expected.get("seed")
            difference = (
                "another campaign than that"
                if seed == expected_seed
                else f"seed {seed}, not the seed {expected_seed}"
            )
            findings.append(
                Finding(
                    f"{path}: was run with {difference} of {folders.MANIFEST}",
                    repairable=not is_recorded_shard,
                    advice=f"{folders.MANIFEST} and {folders.CAMPAIGN} are of another run: restore "
                    f"those of the run of these cases, or {another_place()}",
                )
            )
    return findings


def diagnose(folder: Path) -> list[Finding]:
    """List all faults of a run folder, after reading every file of it; empty if it is intact.
    Of a run in another file format only that is listed, and its files are not read. Raises
    StoreError if the folder is no run folder."""
    if not (folders.is_run(folder) or read_provenance(folder)):
        raise _no_run(folder)
    try:
        manifest = _manifest(folder)
        findings = changed_files(folder, manifest)
    except OtherFormatError as error:
        return [Finding(str(error), repairable=False)]
    except StoreError as error:
        path = folder / folders.MANIFEST
        reason = str(error) if path.exists() else f"{path}: is gone"
        manifest, findings = {}, [Finding(reason, repairable=bool(read_provenance(folder)))]
        if not (folder / folders.CAMPAIGN).is_file():
            reason = f"{folder / folders.CAMPAIGN}: is gone"
            findings.append(Finding(reason, repairable=False, advice=restore_advice(folder)))
    entries, damaged = ledger.read(folder), ledger.count_damaged_lines(folder)
    if damaged:
        reason = f"{damaged} of its lines were cut short or changed"
        findings.append(Finding(f"{folder / ledger.LEDGER}: {reason}"))
    for entry in entries.values():
        if entry.file != folders.SAMPLES:
            try:
                ledger.read_verified(folder, entry)
            except ValueError as error:
                cases = f", with {entry.cases_text}" if entry.cases else ""
                findings.append(Finding(f"{folder / entry.file}: {error}{cases}", entry.file))
    for kind in folders.DATA_FOLDERS:
        for path in sorted((folder / kind).glob("*")):
            if f"{kind}/{path.name}" not in entries:
                reason = f"is not in {ledger.LEDGER}: not finished, or not of this run"
                ours = path.name.startswith("part-") and ".parquet" in path.name
                findings.append(
                    Finding(f"{path}: {reason if ours else 'is no file of a run: move it'}")
                )
    if _is_sealed(manifest) and "rare" not in manifest:
        findings += foreign_shards(folder, manifest)
    resumable = is_resumable(manifest)
    # a complete run of statistics whose accumulators are gone is reported by its ledger
    has_content = has_case_rows(manifest) or any(
        entry.file.startswith(folders.ACCUMULATORS) for entry in entries.values()
    )
    if _is_sealed(manifest) and resumable and (has_content or not manifest["complete"]):
        accumulators = shards.accumulator_entry(folder)
        n_stored = sum(entry.cases for entry in shards.entries(folder, folders.CASES))
        n_stored += accumulators.first if accumulators else 0
        if n_stored < manifest["cases"]:
            findings.append(Finding(f"{folder}: contains {n_stored} of {manifest['cases']} cases"))
    if not resumable:  # it is run again as a whole
        findings = [replace(entry, repairable=False) for entry in findings]
    return findings


def ensure_ledger(folder: Path) -> None:
    """Write an empty ledger into a folder without manifest and ledger: it then is a run folder
    whose cases are all to be run again."""
    if not folders.is_run(folder):
        ledger.rewrite(folder, [])


def _manifest(folder: Path, advice: str = "") -> dict[str, Any]:
    """Entries of the manifest of a run folder by key, whether it was changed or not.

    Raises StoreError if there is none, it is unreadable, or an entry of the folder is refused
    (`untrusted.check_entries`); if it is not a valid manifest, with ``advice`` at the end of the
    message. Raises OtherFormatError if the folder has the format of another version.
    """
    path = folder / folders.MANIFEST
    untrusted.check_entries(folder)
    if not (path.exists() or (is_local(path) and path.is_symlink())):
        raise _no_run(folder)
    try:
        manifest = manifest_schema.read(untrusted.read_bounded(path, MANIFEST_BYTES))
    except ValueError as error:
        raise StoreError(f"{path}: cannot be read: {error}{advice}") from None
    if (written := manifest.get("format", 1)) != manifest_schema.FORMAT:
        raise OtherFormatError(
            f"{folder}: was written by another version of sepmc (folder format {written}, this "
            f"version reads {manifest_schema.FORMAT}); {another_place()}"
        )
    return manifest


def _no_run(folder: Path) -> StoreError:
    return StoreError(f"{folder}: no {folders.MANIFEST} here; give the folder of a run")


def versions() -> dict[str, Any]:
    """Entries of a manifest, by key, on versions (of sepmc, Python and packages) and the kind of
    machine: processor architecture and operating system, such as "x86_64 Linux". Their keys are
    "sepmc", "versions" and "machine"."""
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
