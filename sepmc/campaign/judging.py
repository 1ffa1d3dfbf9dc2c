"""Requirements and runs for analyses that end with a verdict after several runs: a choice of
requirements, checks of them, and confidences raised for the number of runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from sepmc.analysis.proportions import raised, required_cases
from sepmc.analysis.requirements import PASS
from sepmc.scene.design_tables import check_subject_to
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import Requirement

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign


@dataclass(frozen=True)
class FreshVerdict:
    """Verdicts of a run with a seed that was not used before.

    Attributes
    ----------
    shown : bool
        True if the run passes every requirement.
    table : DataFrame
        Its verdicts (`Result.requirements`), at the confidence that
        `raised_confidence` sets.
    seed, cases : int
        Seed and number of cases of the run.
    notes : tuple of str
        Warnings of the run.
    """

    shown: bool
    table: pd.DataFrame
    seed: int
    cases: int
    notes: tuple[str, ...]


def raised_confidence(campaign: Any, looks: int) -> dict[str, float]:
    """Return settings (``requirement.NAME.confidence``) that raise the confidence of each
    requirement so that ``looks`` verdicts on it together are wrong no more often than one verdict
    at its present confidence; see `sepmc.analysis.proportions.raised`."""
    return {
        f"requirement.{item.name}.confidence": raised(item.confidence, looks)
        for item in campaign.file.requirements
    }


def with_requirements(campaign: "Campaign", names: Sequence[str]) -> "Campaign":
    """Return the campaign with only the requirements of the given names, in the order of the file
    (and only these in ``size.subject_to``), or the campaign itself if there are no names. Raises
    InputError for an unknown name."""
    if not names:
        return campaign
    check_subject_to(names, campaign.file.requirements)
    items = [one for one in campaign.file.tree["requirement"] if one["name"] in names]
    settings: dict[str, Any] = {"requirement": items}
    if campaign.file.size is not None:
        settings["size.subject_to"] = list(names)
    return campaign.with_settings(settings)


def judged_requirements(campaign: "Campaign") -> tuple[Requirement, ...]:
    """Return the requirements of a campaign. Raises InputError if it has none, or its sampler is
    not random, which verdicts need."""
    if not campaign.file.requirements:
        raise InputError(f"{campaign.name}: has no requirement to judge by: give [[requirement]]")
    if (sampler := campaign.scene.run.sampler) != "random":
        raise InputError(
            f"run.sampler = {sampler!r}: verdicts need random cases; set run.sampler = 'random'"
        )
    return campaign.file.requirements


def checked_requirements(campaign: "Campaign", cases: int) -> tuple[Requirement, ...]:
    """Return the requirements of a campaign. Raises InputError if it has none, its sampler is not
    random, another seed would give the same cases (``run.samples``), or ``cases`` without a
    violation are too few to show a requirement."""
    items = judged_requirements(campaign)
    if campaign.scene.run.samples is not None:
        raise InputError(
            "run.samples: with it, the run for the verdict has the cases of the search; remove "
            "this key"
        )
    for item in items:
        needed = required_cases(0, item.probability, item.confidence)
        if cases < needed:
            raise InputError(
                f"cases = {cases}: requirement {item.name} cannot be shown with fewer than {needed}"
            )
    return items


def fresh_verdict(
    campaign: "Campaign",
    settings: dict[str, Any],
    cases: int,
    seed: int,
    tries: int,
    threads: int | None,
    announce: Log | None,
    out: Path | None = None,
) -> FreshVerdict:
    """Run ``cases`` cases of a campaign with some ``settings`` and a ``seed`` that was not used
    before, and judge its requirements.

    ``settings`` are values of the campaign by TOML path. The confidence of every requirement is
    raised for ``tries`` such runs (`raised_confidence`). ``out`` is the run folder, whose earlier
    run is overwritten; the run is in memory if it is None. ``threads`` (None: all cores) and
    ``announce`` are as for `sepmc.campaign.campaign.Campaign.run`. Returns the verdicts, whether
    all are passed or not."""
    settings = settings | raised_confidence(campaign, tries)
    run = campaign.with_settings(settings).run(
        cases, seed, threads, out, overwrite=True, announce=announce
    )
    verdicts = run.requirements()
    return FreshVerdict(
        bool((verdicts["verdict"] == PASS).all()), verdicts, seed, cases, tuple(run.notes)
    )
