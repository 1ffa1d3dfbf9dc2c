"""What a run folder says of itself: its manifest, and what is wrong with its files."""

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
    """Write the manifest of a run folder, sealed, with a checksum of the text of the campaign,
    which is put beside it. The manifest comes first: it makes a folder a run."""
    seal(folder, {**manifest, "campaign_sha256": ledger.checksum(campaign.encode())})
    folders.write_text(folder / folders.CAMPAIGN, campaign)


def seal(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest of a run folder with checksums of the ledger, as it is now, and of
    itself."""
    files = ledger.read(folder).values()
    sealed = {
        **manifest,
        "format": manifest_schema.FORMAT,
        "files": len(files),
        "files_sha256": ledger.digest(files),
    }
    folders.write_json(folder / folders.MANIFEST, {**sealed, "sha256": _seal(sealed)})


def _seal(manifest: Mapping[str, Any]) -> str:
    """The checksum of a manifest, of all that it says besides."""
    said = {key: value for key, value in manifest.items() if key != "sha256"}
    return ledger.checksum(json.dumps(folders.finite(said), sort_keys=True).encode())


def _is_sealed(manifest: Mapping[str, Any]) -> bool:
    """Whether a manifest is as it was written."""
    return manifest.get("sha256") == _seal(manifest)


def forget_damaged(folder: Path, endings: tuple[str, ...]) -> list[str]:
    """Take files that are not as they were written out of the ledger of a folder, if their names
    end so. Returns their names."""
    held = ledger.read(folder)
    some = [(name, one) for name, one in held.items() if name.endswith(endings)]
    lost = [name for name, one in some if shards.find_fault(folder, one)]
    if lost:
        ledger.rewrite(folder, [one for name, one in held.items() if name not in lost])
        seal(folder, _manifest(folder))
    return lost


class OtherFormatError(StoreError):
    """The run folder has the format of another version of sepmc."""


@dataclass(frozen=True)
class Finding:
    """What is wrong with a run folder: a sentence, the file there if it is one that follows from
    the cases, whether flying, counting or drawing again mends it, and what to do if not."""

    text: str
    file: str = ""
    repairable: bool = True
    advice: str = "fly it again"


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run, as it was written, beside the campaign that was flown. Raises
    StoreError if there is none, or if either was changed."""
    manifest = _manifest(folder, f"; to see what would mend it: sepmc doctor {folder}")
    for finding in changed(folder, manifest):
        raise StoreError(finding.text)
    return manifest


def read_provenance(folder: Path) -> dict[str, Any]:
    """By what the cases of a run folder were made: its manifest or, where that was changed, what
    its parts say: ``digest``, ``seed``, ``settings`` and, if they are not the first ones,
    ``numbers``."""
    untrusted.check_entries(folder)
    try:
        manifest = _manifest(folder)
        if _is_sealed(manifest):
            return manifest
    except OtherFormatError:
        raise
    except StoreError:
        pass
    parts = (
        path
        for kind in (folders.CASES, folders.ACCUMULATORS, folders.SELECTED)
        for path in sorted((folder / kind).glob("part-*.parquet"))
    )
    for path in parts:
        with contextlib.suppress(StoreError, KeyError, ValueError):
            _, said = shards.read_metadata(path)
            return manifest_schema.shard_provenance(said)
    return {}


def changed(folder: Path, manifest: Mapping[str, Any]) -> list[Finding]:
    """What is wrong with the manifest of a folder, with what was flown, and its list of files."""
    if not _is_sealed(manifest):
        said = "was changed since it was written: its checksum is another"
        return [Finding(f"{folder / folders.MANIFEST}: {said}")]
    return [*_not_as_flown(folder, manifest), *_files_lost(folder, manifest)]


def _not_as_flown(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether the campaign of a folder, or the store.table of its inputs, is not what was flown."""
    try:
        written = ledger.checksum(untrusted.read_bounded(folder / folders.CAMPAIGN, CAMPAIGN_BYTES))
    except StoreError as error:
        yield Finding(str(error), repairable=False, advice=restore_advice(folder))
    else:
        if written != manifest["campaign_sha256"]:
            said = (
                "is not the campaign that was flown; to fly it as it is now, copy it to another "
                "place"
            )
            lost = f"{folder / folders.CAMPAIGN}: {said}"
            yield Finding(lost, repairable=False, advice=restore_advice(folder))
    plan = ledger.read(folder).get(folders.SAMPLES)
    if plan and (problem := shards.find_fault(folder, plan)):
        said = f"{folder / folders.SAMPLES}: {problem}; it gave inputs of the cases"
        yield Finding(said, repairable=False, advice="put it back")


def restore_advice(folder: Path) -> str:
    """What to do if the campaign of a run is not what was flown."""
    return (
        f"put {folders.CAMPAIGN} back as it was, or go on by the file that it was made from: "
        f"{flying_again(folder, 'FILE')}"
    )


def _files_lost(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Whether the ledger of a run that is complete tells of other files."""
    files = ledger.read(folder).values()
    if manifest.get("complete", True) and ledger.digest(files) != manifest["files_sha256"]:
        said = f"was changed: it tells of {len(files)} files, and there were {manifest['files']}"
        said = said if folders.has_ledger(folder) else "is gone"
        how = f". To fly again what is not sure: {flying_again(folder)}"
        yield Finding(f"{folder / ledger.LEDGER}: {said}{how if is_resumable(manifest) else ''}")


def has_case_rows(manifest: Mapping[str, Any]) -> bool:
    """Whether a run holds rows of cases, which can be flown one by one: it is no single flight, and
    not one of statistics only, and not the estimate of a rare event."""
    alone = "case" in manifest or "rare" in manifest
    return not alone and not manifest.get("stats_only")


def is_resumable(manifest: Mapping[str, Any]) -> bool:
    """Whether what is lost of a run can be flown again: all but a single flight, and the estimate
    of a rare event."""
    return not ("case" in manifest or "rare" in manifest)


def record_derived(folder: Path, files: Iterable[Path]) -> None:
    """Note what follows from the cases of a run, statistics and figures, in its ledger."""
    names = [path.relative_to(folder).as_posix() for path in files]
    ledger.add(folder, *(ledger.make_entry(name, (folder / name).read_bytes()) for name in names))
    seal(folder, _manifest(folder))


def is_recorded(folder: Path, name: str) -> bool:
    """Whether a file that follows from the cases of a run is there as it was noted."""
    one = ledger.read(folder).get(name)
    return one is not None and not shards.find_fault(folder, one)


def drop_derived(folder: Path) -> list[str]:
    """Remove what follows from the cases of a run, statistics, tables and figures, as it is to have
    others. Returns the names of the files."""
    held = ledger.read(folder)
    told = [name for name in held if folders.is_derived(name)]
    for name in told:
        (folder / name).unlink(missing_ok=True)
    if told:
        ledger.rewrite(folder, [one for name, one in held.items() if name not in told])
    return told


def foreign_shards(folder: Path, manifest: Mapping[str, Any]) -> list[Finding]:
    """Parts that were flown with another campaign or seed than a manifest says. Those of a foreign
    file are flown again; where the ledger knows them, it is campaign and manifest that are
    foreign."""
    found, held = [], ledger.read(folder)
    wanted = {key: manifest[key] for key in ("digest", "seed") if manifest.get(key) is not None}
    for kind in (folders.CASES, folders.ACCUMULATORS, folders.SELECTED):
        for path in sorted((folder / kind).glob("part-*.parquet")):
            try:
                own = manifest_schema.shard_provenance(shards.read_metadata(path)[1])
            except (StoreError, KeyError, ValueError):
                continue  # told as damaged
            if all(own[key] == value for key, value in wanted.items()):
                continue
            one = held.get(f"{kind}/{path.name}")
            known = one is not None and not shards.find_fault(folder, one)
            own_seed, other = own["seed"], wanted.get("seed")
            how = "another campaign" if own_seed == other else f"seed {own_seed}, not {other}"
            found.append(
                Finding(
                    f"{path}: was flown with {how}, as {folders.MANIFEST} says",
                    repairable=not known,
                    advice=f"{folders.MANIFEST} and {folders.CAMPAIGN} are of another run: put "
                    "those of its cases back, or fly with --overwrite or another --out",
                )
            )
    return found


def diagnose(folder: Path) -> list[Finding]:
    """All that is wrong with a run folder, file by file. Raises StoreError if it is none."""
    if not (folders.is_run(folder) or read_provenance(folder)):
        raise _no_run(folder)
    try:
        manifest = _manifest(folder)
        found = changed(folder, manifest)
    except OtherFormatError as error:
        return [Finding(str(error), repairable=False)]
    except StoreError as error:
        path = folder / folders.MANIFEST
        said = str(error) if path.exists() else f"{path}: is gone"
        manifest, found = {}, [Finding(said, repairable=bool(read_provenance(folder)))]
        if not (folder / folders.CAMPAIGN).is_file():
            said = f"{folder / folders.CAMPAIGN}: is gone"
            found.append(Finding(said, repairable=False, advice=restore_advice(folder)))
    held, lost = ledger.read(folder), ledger.count_damaged_lines(folder)
    if lost:
        said = f"{lost} of its lines were cut short or changed"
        found.append(Finding(f"{folder / ledger.LEDGER}: {said}"))
    for one in held.values():
        if one.file != folders.SAMPLES:
            try:
                ledger.read_verified(folder, one)
            except ValueError as error:
                of = f", with {one.numbers}" if one.cases else ""
                found.append(Finding(f"{folder / one.file}: {error}{of}", one.file))
    for kind in folders.DATA_FOLDERS:
        for path in sorted((folder / kind).glob("*")):
            if f"{kind}/{path.name}" not in held:
                said = f"is not in {ledger.LEDGER}: not finished, or not of this run"
                ours = path.name.startswith("part-") and ".parquet" in path.name
                found.append(Finding(f"{path}: {said if ours else 'is none of a run: move it'}"))
    if _is_sealed(manifest) and "rare" not in manifest:
        found += foreign_shards(folder, manifest)
    goes_on = is_resumable(manifest)
    # runs of earlier versions that counted their cases kept nothing to go on from
    holds = has_case_rows(manifest) or any(
        one.file.startswith(folders.ACCUMULATORS) for one in held.values()
    )
    if _is_sealed(manifest) and goes_on and (holds or not manifest["complete"]):
        counted = shards.accumulator_entry(folder)
        there = sum(one.cases for one in shards.entries(folder, folders.CASES))
        there += counted.first if counted else 0
        if there < manifest["cases"]:
            found.append(Finding(f"{folder}: holds {there} of {manifest['cases']} cases"))
    if not goes_on:  # it is flown again as a whole
        found = [replace(one, repairable=False) for one in found]
    return found


def ensure_ledger(folder: Path) -> None:
    """Write an empty ledger if only shards are left of a run, so that its cases are run again."""
    if not folders.is_run(folder):
        ledger.rewrite(folder, [])


def _manifest(folder: Path, advice: str = "") -> dict[str, Any]:
    """The manifest of a run, whatever it says. Raises StoreError if there is none, with ``advice``
    on one that cannot be read."""
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
