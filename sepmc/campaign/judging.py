"""Campaigns for verdicts that are reached in several steps: with some of the requirements, and with
a raised confidence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd

from sepmc.analysis.proportions import raised, required_cases
from sepmc.analysis.requirements import PASS
from sepmc.scene.design_tables import check_subject_to
from sepmc.scene.messages import InputError, Log
from sepmc.scene.model import Requirement

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign


def raised_confidence(campaign: Any, looks: int) -> dict[str, float]:
    """Settings with the confidence of each requirement raised for a number of looks; see
    `sepmc.analysis.proportions.raised`."""
    return {
        f"requirement.{item.name}.confidence": raised(item.confidence, looks)
        for item in campaign.file.requirements
    }


def with_requirements(campaign: "Campaign", names: Sequence[str]) -> "Campaign":
    """Campaign with the named requirements alone; unchanged without names. Raises InputError."""
    if not names:
        return campaign
    check_subject_to(names, campaign.file.requirements)
    items = [one for one in campaign.file.tree["requirement"] if one["name"] in names]
    settings: dict[str, Any] = {"requirement": items}
    if campaign.file.size is not None:
        settings["size.subject_to"] = list(names)
    return campaign.with_settings(settings)


def judged_requirements(campaign: "Campaign") -> tuple[Requirement, ...]:
    """Requirements of a campaign, whose cases are random. Raises InputError."""
    if not campaign.file.requirements:
        raise InputError(f"{campaign.name}: has no requirement to judge by: give [[requirement]]")
    if (sampler := campaign.scene.run.sampler) != "random":
        raise InputError(
            f"run.sampler = {sampler!r}: verdicts need random cases; set run.sampler = 'random'"
        )
    return campaign.file.requirements


def checked_requirements(campaign: "Campaign", cases: int) -> tuple[Requirement, ...]:
    """Requirements of a campaign, which so many random cases of different seeds can show. Raises
    InputError."""
    items = judged_requirements(campaign)
    if campaign.scene.run.samples is not None:
        raise InputError("run.samples: gives the run for the verdict the cases of the search")
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
) -> tuple[bool, pd.DataFrame]:
    """True if a run with other values shows all requirements, and its verdicts. Their confidence is
    raised for a number of such tries."""
    settings = settings | raised_confidence(campaign, tries)
    run = campaign.with_settings(settings).run(cases, seed, threads, announce=announce)
    verdicts = run.requirements()
    return bool((verdicts["verdict"] == PASS).all()), verdicts
