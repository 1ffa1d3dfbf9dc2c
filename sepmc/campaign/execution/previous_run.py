"""What a run folder holds already, from which a run goes on: rows of cases, or what is counted of
them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from sepmc.analysis.compare import differences
from sepmc.campaign.case_selection import CaseSelection, named
from sepmc.campaign.cases import OF_ITS_SIZE
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.batch_summary import read as read_tally
from sepmc.campaign.execution.chunk import SampleSpec
from sepmc.campaign.execution.runner import PreviousRun
from sepmc.campaign.store import folders, manifests, shards
from sepmc.campaign.store.row_selection import KeepRules
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.scene.messages import InputError, Log
from sepmc.scene.read import read_campaign
from sepmc.wording import another_place, option, switch

_TOLD = 8  # differences between two campaigns


def original_mode(
    folder: Path, stats_only: bool, keep: KeepRules | None, until: str | None
) -> tuple[bool, KeepRules | None, str | None]:
    """Whether a run that is resumed counts its cases and lets them go, which it keeps, and until
    what it flies if it was interrupted: as it began. Raises StoreError if other rows are asked
    for."""
    manifest = manifests.made_by(folder) if folders.is_run(folder) else {}
    if "digest" not in manifest or "rare" in manifest:
        return stats_only, keep, until
    counts, text = bool(manifest.get("stats_only")), manifest.get("keep", "")
    if (stats_only or keep) and (counts, text) != (True, keep.text if keep else ""):
        raise folders.StoreError(
            f"{folder}: was flown {_manner(counts, text)}, and is to go on "
            f"{_manner(True, keep.text if keep else '')}; leave that out, or choose another "
            f"{option('out')}"
        )
    if until is None and not manifest.get("complete"):
        until = manifest.get("stopping_rule")
    return counts, KeepRules.of_text(text) if text else None, until


def own_cases(campaign: Definition, folder: Path) -> CaseSelection | None:
    """The cases of a run, if the campaign is that of its folder and they are not the first
    ones: what it goes on with unless others are asked for."""
    if campaign.file.folder.resolve() != folder.resolve():
        return None
    found = manifests.made_by(folder).get("numbers")
    return named(found) if found else None


def _manner(counts: bool, keep: str) -> str:
    return (
        f"keeping {keep}"
        if keep
        else f"with {switch('stats_only')}"
        if counts
        else "keeping all rows"
    )


def earlier(
    campaign: Definition,
    folder: Path,
    draws: SampleSpec,
    counts: bool,
    announce: Log | None,
) -> tuple[PreviousRun, CaseSelection]:
    """What a folder holds already of a run, and which cases are left to fly. Raises StoreError if
    it is of another one."""
    manifest: dict[str, Any] = manifests.made_by(folder) if folders.is_run(folder) else {}
    if manifest:
        _check(campaign, folder, draws, manifest)
        for finding in manifests.of_another_run(folder, manifest):
            if not finding.mends:
                raise folders.StoreError(f"{finding.said}: {finding.advice}")
    found, left = (_counted if counts else _rows)(campaign, folder, draws, announce)
    if found.held:
        found = replace(found, sessions=tuple(manifest.get("sessions", ())))
    if manifest.get("cases", draws.numbers.count) != draws.numbers.count:
        told = manifests.drop_told(folder)
        if told and announce:
            announce(
                f"{folder}: told of {manifest['cases']} cases only, so removed: "
                f"{', '.join(sorted(told))}"
            )
    if announce and not found.held:
        announce(f"{folder}: there are no cases to go on from, so all are flown")
    return found, left


def _check(campaign: Definition, folder: Path, draws: SampleSpec, manifest: dict[str, Any]) -> None:
    """Raise StoreError if a folder holds another run."""
    if "rare" in manifest:
        raise folders.StoreError(
            f"{folder}: holds {folders.RARE}, so there are no cases to go on from; "
            f"{another_place()}"
        )
    if manifest.get("digest") not in (None, campaign.digest):
        raise folders.StoreError(
            f"{folder}: was flown with another campaign, so its cases cannot be continued; "
            f"{another_place()}. {_differences(campaign, folder)}"
        )
    if manifest.get("seed") not in (None, draws.seed):
        raise folders.StoreError(
            f"{folder}: was flown with another seed ({manifest.get('seed')}, not {draws.seed}), so "
            f"its cases cannot be continued; {another_place()}"
        )
    sampler, held = campaign.scene.run.sampler, manifest.get("of", manifest.get("cases"))
    if sampler in OF_ITS_SIZE and held not in (None, draws.total):
        what = "a Latin hypercube" if sampler == "lhs" else "a Saltelli design"
        raise folders.StoreError(
            f"{folder}: is {what} of {held} cases, which cannot be continued to {draws.total}; "
            f"{another_place()}"
        )


def _differences(campaign: Definition, folder: Path) -> str:
    """What differs from the campaign of a run folder, key by key."""
    try:
        other = Definition(read_campaign(str(folder), reader=read_input_table))
    except InputError:
        return f"What differs is not known, as its {folders.CAMPAIGN} cannot be read."
    found = differences(other.file.tree, campaign.file.tree)
    plans = [each.file.input_table for each in (other, campaign)]
    if all(plans) and other.inputs_digest != campaign.inputs_digest:
        found.append("rows of run.plan")
    if not found:
        said = f"Its {folders.CAMPAIGN} was changed since its cases were flown"
        return f"{said}: {manifests.put_back(folder)}"
    more = f", and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return f"It differs in {'; '.join(found[:_TOLD])}{more}"


def _rows(
    campaign: Definition, folder: Path, draws: SampleSpec, announce: Log | None
) -> tuple[PreviousRun, CaseSelection]:
    """The cases whose rows a folder holds whole."""
    if not folders.is_run(folder):
        return PreviousRun(), draws.numbers
    dropped = shards.drop_damaged(folder, campaign.has_histories)
    done, own = shards.cases_done(folder), [column.name for column in campaign.columns]
    if not len(done):
        return PreviousRun(), draws.numbers
    if other := set(own).symmetric_difference(shards.CaseColumns(folder)):
        raise folders.StoreError(
            f"{folder}: was flown by another version of sepmc, whose rows differ in "
            f"{', '.join(sorted(other))}, so its cases cannot be continued; {another_place()}"
        )
    if draws.numbers.leave_out(done):
        raise folders.StoreError(
            f"{folder}: holds cases up to {done[-1]}; {_cases(draws.numbers)} would leave some out"
        )
    if dropped and announce:
        announce(
            f"{folder}: {dropped} cases, or their histories, are gone or not as they were "
            "written, so these are flown again"
        )
    tally = sum((read_tally(text) for text in shards.tallies(folder)), BatchSummary())
    return PreviousRun(len(done), tally), draws.numbers.without(done)


def _counted(
    campaign: Definition, folder: Path, draws: SampleSpec, announce: Log | None
) -> tuple[PreviousRun, CaseSelection]:
    """What is counted of the first cases of a run, as it was when it was last written; rows that
    were kept of cases after these are dropped."""
    one = shards.counted(folder)
    if not one:
        shards.drop_damaged(folder, with_histories=False)
        return PreviousRun(), draws.numbers
    arrays, about = shards.read_counted(folder, one)
    if about.get(b"numbers") != draws.told.encode() or one.first > draws.numbers.count:
        named = about.get(b"numbers", b"").decode(errors="replace")
        raise folders.StoreError(
            f"{folder}: counted {one.first} cases{f' of {named}' if named else ''}; "
            f"{_cases(draws.numbers)} would leave some out"
        )
    later = draws.numbers.after(one.first).ranges
    kept = shards.drop_kept(folder, later[0][0] if later else None)
    if str(kept).encode() != about.get(b"rows", b"0"):
        if announce:
            announce(f"{folder}: rows that were kept are gone or not as they were written")
        shards.drop_damaged(folder, with_histories=False)
        return PreviousRun(), draws.numbers
    tally = read_tally(about.get(b"tally", b""))
    return PreviousRun(one.first, tally, arrays=tuple(arrays)), draws.numbers.after(one.first)


def _cases(numbers: CaseSelection) -> str:
    return option("cases", said(numbers))


def said(numbers: CaseSelection) -> str:
    """Numbers of cases as ``--cases`` takes them: how many, where they are the first ones."""
    return str(numbers.count if numbers.are_first else numbers)
