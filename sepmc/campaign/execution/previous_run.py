"""State of an existing run folder, from which a run is resumed: its stored rows or, for a run that
stores statistics only, its accumulators (the arrays that statistics are computed from)."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from sepmc.analysis.compare import tree_differences
from sepmc.campaign.case_selection import CaseSelection, parse
from sepmc.campaign.cases import SIZE_DEPENDENT
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import BatchSummary
from sepmc.campaign.execution.batch_summary import read as read_summary
from sepmc.campaign.execution.chunk import SampleSpec
from sepmc.campaign.execution.runner import PreviousRun
from sepmc.campaign.store import folders, manifests, shards
from sepmc.campaign.store.row_selection import KeepRules
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.scene.messages import InputError, Log
from sepmc.scene.read import read_campaign
from sepmc.wording import another_place, option, switch

_MAX_DIFFERENCES = 8  # differences between two campaigns


def original_mode(
    folder: Path, stats_only: bool, keep: KeepRules | None, until: str | None
) -> tuple[bool, KeepRules | None, str | None]:
    """Options with which an existing run is resumed: what it stores stays as it was.

    Parameters
    ----------
    folder : Path
        Run folder; without a run of a campaign in it, the requested options are returned.
    stats_only : bool
    keep : KeepRules or None
    until : str or None
        Options that are requested now, as in `RunOptions`: store only statistics, rules for rows
        saved beside them, and stopping rule.

    Returns
    -------
    (bool, KeepRules or None, str or None)
        ``stats_only`` and ``keep`` of the run; ``until`` as requested, or that of the run if
        none is requested and the run was interrupted.

    Raises
    ------
    StoreError
        If ``stats_only`` or ``keep`` is requested and differs from that of the run, or the folder
        cannot be read.
    """
    manifest = manifests.read_provenance(folder) if folders.is_run(folder) else {}
    if "digest" not in manifest or "rare" in manifest:
        return stats_only, keep, until
    stats_only_before, text = bool(manifest.get("stats_only")), manifest.get("keep", "")
    if (stats_only or keep) and (stats_only_before, text) != (True, keep.text if keep else ""):
        raise folders.StoreError(
            f"{folder}: was run {_mode_text(stats_only_before, text)}, and is to be continued "
            f"{_mode_text(True, keep.text if keep else '')}; leave that option out, or choose "
            f"another {option('out')}"
        )
    if until is None and not manifest.get("complete"):
        until = manifest.get("stopping_rule")
    return stats_only_before, KeepRules.of_text(text) if text else None, until


def own_cases(campaign: Definition, folder: Path) -> CaseSelection | None:
    """Cases of the run in ``folder``, if ``campaign`` was loaded from that folder and the run has
    only some cases of its sample; else None. Raises StoreError if the folder cannot be read."""
    if campaign.file.folder.resolve() != folder.resolve():
        return None
    numbers = manifests.read_provenance(folder).get("numbers")
    return parse(numbers) if numbers else None


def _mode_text(stats_only_before: bool, keep: str) -> str:
    """How a run stores rows, as the end of a clause: "storing all rows", "saving the rows
    failed" (by ``keep``, the rules as text), or, with statistics alone, "with --stats-only"."""
    return (
        f"saving the rows {keep}"
        if keep
        else f"with {switch('stats_only')}"
        if stats_only_before
        else "storing all rows"
    )


def read_previous(
    campaign: Definition,
    folder: Path,
    spec: SampleSpec,
    stats_only_before: bool,
    announce: Log | None,
) -> tuple[PreviousRun, CaseSelection]:
    """Read the state of the run in a folder, and find the cases that remain to be run.

    Damaged shards are removed from the folder, so that their cases are run again. Result files are
    removed if they were made from another number of cases than is wanted.

    Parameters
    ----------
    campaign : Definition
    folder : Path
    spec : SampleSpec
        Wanted cases, those already run included.
    stats_only_before : bool
        True for a run that stores statistics only: read its accumulators instead of rows.
    announce : Log, optional
        Called with a message on what was removed, or if nothing can be continued.

    Returns
    -------
    (PreviousRun, CaseSelection)
        State of the run, and the remaining cases; an empty state and all wanted cases if the folder
        has no run.

    Raises
    ------
    StoreError
        If the folder contains another run or cases that are not wanted, or cannot be read.
    """
    manifest: dict[str, Any] = manifests.read_provenance(folder) if folders.is_run(folder) else {}
    if manifest:
        _check(campaign, folder, spec, manifest)
        for finding in manifests.foreign_shards(folder, manifest):
            if not finding.repairable:
                raise folders.StoreError(f"{finding.text}: {finding.advice}")
    read = _stored_accumulators if stats_only_before else _stored_rows
    previous, remaining = read(campaign, folder, spec, announce)
    if previous.n_stored:
        previous = replace(previous, sessions=tuple(manifest.get("sessions", ())))
    if manifest.get("cases", spec.numbers.count) != spec.numbers.count:
        removed = manifests.drop_derived(folder)
        if removed and announce:
            announce(
                f"{folder}: removed result files made from {manifest['cases']} cases, another "
                f"number than are to be run now: {', '.join(sorted(removed))}"
            )
    if announce and not previous.n_stored:
        announce(f"{folder}: no stored cases to continue from, so all are run")
    return previous, remaining


def _check(campaign: Definition, folder: Path, spec: SampleSpec, manifest: dict[str, Any]) -> None:
    """Raise StoreError if the ``manifest`` of a folder is that of a rare-event estimate, of another
    campaign or seed, or of a sample whose size cannot change to that of ``spec``. An entry that the
    manifest lacks is not compared."""
    if "rare" in manifest:
        raise folders.StoreError(
            f"{folder}: contains {folders.RARE}, so there are no cases to continue; "
            f"{another_place()}"
        )
    if manifest.get("digest") not in (None, campaign.digest):
        raise folders.StoreError(
            f"{folder}: was run with another campaign, so its cases cannot be continued; "
            f"{another_place()}. {_differences(campaign, folder)}"
        )
    if manifest.get("seed") not in (None, spec.seed):
        raise folders.StoreError(
            f"{folder}: was run with another seed ({manifest.get('seed')}, not {spec.seed}), so "
            f"its cases cannot be continued; {another_place()}"
        )
    sampler, n_stored = campaign.scene.run.sampler, manifest.get("of", manifest.get("cases"))
    if sampler in SIZE_DEPENDENT and n_stored not in (None, spec.total):
        what = "a Latin hypercube" if sampler == "lhs" else "a Saltelli design"
        raise folders.StoreError(
            f"{folder}: is {what} of {n_stored} cases, which cannot be continued to {spec.total}; "
            f"{another_place()}"
        )


def _differences(campaign: Definition, folder: Path) -> str:
    """Sentence for a message: keys in which a campaign differs from that stored in a run folder, at
    most eight of them; or that the stored file cannot be read or was changed, if no key differs."""
    try:
        other = Definition(read_campaign(str(folder), reader=read_input_table))
    except InputError:
        return f"What differs is not known, as its {folders.CAMPAIGN} cannot be read."
    changes = tree_differences(other.file.tree, campaign.file.tree, units=True)
    tables = [each.file.input_table for each in (other, campaign)]
    if all(tables) and other.inputs_digest != campaign.inputs_digest:
        changes.append("rows of run.samples")
    if not changes:
        reason = f"Its {folders.CAMPAIGN} was changed since its cases were run"
        return f"{reason}: {manifests.restore_advice(folder)}"
    n_more = len(changes) - _MAX_DIFFERENCES
    more = f", and {n_more} more" if n_more > 0 else ""
    return f"It differs in {'; '.join(changes[:_MAX_DIFFERENCES])}{more}"


def _stored_rows(
    campaign: Definition, folder: Path, spec: SampleSpec, announce: Log | None
) -> tuple[PreviousRun, CaseSelection]:
    """State (number and summary) of the cases of a run whose rows are intact, and the remaining
    ones of the wanted cases (``spec``). The rows themselves stay in the folder.

    Damaged shards are removed from the folder, and ``announce``, if given, is called with a message
    on that. The state is empty, and all wanted cases remain, if no row is intact or the
    folder has no run. Raises StoreError if the rows have other columns, or cases are stored that
    are not wanted.
    """
    if not folders.is_run(folder):
        return PreviousRun(), spec.numbers
    n_dropped = shards.drop_damaged(folder, campaign.has_histories)
    if n_dropped and announce:
        announce(
            f"{folder}: {n_dropped} cases, or their histories, are missing or were changed since "
            "they were written, so these are run again"
        )
    numbers, own = shards.stored_cases(folder), [column.name for column in campaign.columns]
    if not len(numbers):
        return PreviousRun(), spec.numbers
    if other := set(own).symmetric_difference(shards.CaseColumns(folder)):
        raise folders.StoreError(
            f"{folder}: was run by another version of sepmc, whose rows differ in the columns "
            f"{', '.join(sorted(other))}, so its cases cannot be continued; {another_place()}"
        )
    if spec.numbers.omits(numbers):
        raise folders.StoreError(
            f"{folder}: contains cases up to {numbers[-1]}; {_cases_option(spec.numbers)} would "
            f"leave some out; give a selection with all of them, or another {option('out')}"
        )
    summaries = (read_summary(text, path) for path, text in shards.read_summaries(folder))
    summary = sum(summaries, BatchSummary())
    return PreviousRun(len(numbers), summary), spec.numbers.without(numbers)


def _stored_accumulators(
    campaign: Definition, folder: Path, spec: SampleSpec, announce: Log | None
) -> tuple[PreviousRun, CaseSelection]:
    """State of a run that stores statistics, as its accumulators were last written, and the
    remaining ones of the wanted cases (``spec``).

    Saved rows of cases that are not in the accumulators are removed. If the accumulators, or a
    saved row, are missing or damaged, the state is empty and all cases remain; ``announce`` is
    called with a message on what is damaged. Raises StoreError if the accumulators are of another
    selection of cases or have more cases than are wanted, or cannot be read.
    """
    entry = shards.accumulator_entry(folder)
    if not entry:
        if announce and shards.has_accumulators(folder):
            announce(
                f"{folder}: the stored statistics are missing or were changed since they were "
                "written, so all cases are run again"
            )
        shards.drop_damaged(folder, with_histories=False)
        return PreviousRun(), spec.numbers
    arrays, about = shards.read_accumulators(folder, entry)
    numbers = about.get(b"numbers", b"").decode(errors="replace")
    is_same = parse(numbers) == spec.numbers if numbers else not spec.text
    if not is_same or entry.first > spec.numbers.count:
        raise folders.StoreError(
            f"{folder}: contains statistics of {entry.first} cases"
            f"{f' of {numbers}' if numbers else ''}, without their rows, so "
            f"{_cases_option(spec.numbers)} would leave some out; {_statistics_continue(numbers)}, "
            f"or give another {option('out')}"
        )
    later_range = spec.numbers.after(entry.first).ranges
    n_selected = shards.drop_selected(folder, later_range[0][0] if later_range else None)
    if str(n_selected).encode() != about.get(b"rows", b"0"):
        if announce:
            announce(
                f"{folder}: rows saved beside the statistics are missing or were changed since "
                "they were written, so all cases are run again"
            )
        shards.drop_damaged(folder, with_histories=False)
        return PreviousRun(), spec.numbers
    summary = read_summary(about.get(b"summary", b""), folder / entry.file)
    return PreviousRun(entry.first, summary, arrays=tuple(arrays)), spec.numbers.after(entry.first)


def _statistics_continue(numbers: str) -> str:
    """Return the advice how to continue a run that has statistics without rows: with its own
    selection of case numbers, the text ``numbers`` ("continue with --cases 25:50"), or, if that is
    empty, as the run has the first cases, with a larger number ("continue with more cases")."""
    return f"continue with {option('cases', numbers)}" if numbers else "continue with more cases"


def _cases_option(numbers: CaseSelection) -> str:
    return option("cases", text(numbers))


def text(numbers: CaseSelection) -> str:
    """Text of a selection of cases as the option ``--cases`` takes it: a number of cases if they
    are the first ones, else case numbers such as ``25:50,73``, that is 25 to 49, and 73."""
    return str(numbers.count if numbers.are_first else numbers)
