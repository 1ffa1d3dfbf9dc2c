"""Tolerance allocation: what the spread of each input contributes to the probability of a
violation, and which spreads may be doubled or must be halved.

The spread of one input at a time is scaled about its centre, and all cases are simulated again on
common random numbers. (Weights on the cases of one run would reach no wider spread, and a run takes
milliseconds.) A proposal scales several spreads at once. Its verdict is that of a run with another
seed, at a confidence that is raised for the number of such runs (Bonferroni). A run shows a
requirement if its verdict is pass.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from sepmc.analysis.proportions import paired_interval
from sepmc.analysis.requirements import PASS, violation_masks
from sepmc.campaign.judging import FreshVerdict, checked_requirements, fresh_verdict
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.messages import InputError, Log, SceneError

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

HALF, DOUBLE = 0.5, 2.0
MAX_TRIES = 4
SCALED = ("uniform", "normal", "triangular")


@dataclass(frozen=True)
class Allocation:
    """Result of an allocation.

    Attributes
    ----------
    table : DataFrame
        A row for each scaled input, the largest gain of halving first: ``input`` (key), ``low``
        and ``high`` of its range (mean +- 3 sigma without truncation). For halving, ``half`` is the
        change of the probability of a violation, ``half_low`` and ``half_high`` its 95 % interval
        (paired), and ``half_passes`` is True if that run shows all requirements; ``double``, ...
        for doubling. ``note`` is the reason why a spread cannot be scaled, else empty; the change
        and its interval are NaN then, and ``half_passes`` or ``double_passes`` is None.
    probability : float
        Fraction of the cases, in the run of the unchanged campaign, that violate any requirement or
        whose result on one is unknown.
    passes : bool
        True if that run shows all requirements: every verdict is pass.
    factors : dict of str to float
        Proposal: factor of the spread, by key of the input: that of doubling for all if the
        campaign ``passes``, else that of halving. Empty if nothing is to be scaled.
    settings : dict
        The proposal as settings for `Campaign.with_settings`: distributions by TOML path.
    shown : bool
        True if a run of the proposal with another seed shows all requirements. If ``factors`` is
        empty, it is a run of the unchanged campaign. False if nothing was run.
    verdicts : DataFrame or None
        Verdicts of that run, at the raised confidence; None if no proposal was run.
    cases, seed : int
        Number of cases and seed of every run of the table; proposals have as many cases.
    verdict_seed : int
        Seed of the run that gave ``verdicts``; ``seed`` if there was none.
    notes : tuple of str
        Warnings of that run.
    """

    table: pd.DataFrame
    probability: float
    passes: bool
    factors: dict[str, float]
    settings: dict[str, Any]
    shown: bool
    verdicts: pd.DataFrame | None
    cases: int
    seed: int
    verdict_seed: int
    notes: tuple[str, ...] = ()


def scaled_distribution(dispersion: Dispersion, factor: float) -> dict[str, Any]:
    """Return a distribution whose spread is scaled by ``factor`` about its centre (the mode of a
    triangular one), as a TOML table for ``[dispersion]``, such as ``{"uniform": [low, high]}``. The
    truncation of a normal distribution scales with sigma. ``dispersion`` must have a distribution
    of `SCALED`; this is not checked."""
    numbers = dispersion.numbers
    if dispersion.distribution == "normal":
        mean, sigma, cut = numbers
        limit = {} if math.isinf(cut) else {"truncate_sigma": cut}
        return {"normal": [mean, factor * sigma], **limit}
    centre = numbers[1] if dispersion.distribution == "triangular" else 0.5 * sum(numbers)
    return {dispersion.distribution: [centre + factor * (number - centre) for number in numbers]}


def allocate(
    campaign: "Campaign",
    cases: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    announce: Log | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Allocation:
    """Halve and double the spread of one dispersed input after the other, and propose spreads.
    Inputs without a spread to scale are left out: those whose distribution is not one of `SCALED`,
    and columns of ``run.samples``.

    If the run of the unchanged campaign shows all requirements, the proposal doubles as many
    spreads as possible while a run with another seed still shows them. Otherwise it halves as few
    spreads as such a run needs to show them.

    Parameters
    ----------
    campaign : Campaign
    cases, seed : int, optional
        Number of cases and seed of every run of the table; those of the file if None.
    threads : int, optional
        As for `Campaign.run`.
    announce : callable (text), optional
        Called with the messages of the run of the unchanged campaign.
    progress : callable (done, total), optional
        Called with the number of finished runs, and of all runs of the table.

    Returns
    -------
    Allocation

    Raises
    ------
    InputError
        If the campaign has no requirement or no spread, its cases are not random, are those of a
        sample table, or are too few to show a requirement.
    """
    cases = campaign.scene.run.cases if cases is None else cases
    checked_requirements(campaign, cases)
    seed = campaign.checked_seed(seed)
    spreads = [
        one
        for one in campaign.file.dispersions
        if one.distribution in SCALED and not one.column and one.reach[0] < one.reach[1]
    ]
    if not spreads:
        raise InputError(
            f"{campaign.name}: no input has a spread to scale: give [dispersion] a distribution "
            f"that is one of {', '.join(SCALED)}"
        )
    total, done = 1 + 2 * len(spreads), 0
    progress = progress or _ignore
    progress(0, total)

    def run(variant: "Campaign", announce: Log | None = _ignore) -> tuple[np.ndarray, bool]:
        nonlocal done
        result = variant.run(cases, seed, threads, announce=announce)
        done += 1
        progress(done, total)
        table, items = result.table, variant.file.requirements
        masks = [violation_masks(item, table, items) for item in items]
        violates = np.any([one | ~known for one, known in masks], axis=0)
        return violates, bool((result.requirements()["verdict"] == PASS).all())

    violates, passes = run(campaign, announce)
    rows = []
    for one in spreads:
        low, high = one.reach
        row: dict[str, Any] = {"input": one.parameter.key, "low": low, "high": high, "note": ""}
        for name, factor in (("half", HALF), ("double", DOUBLE)):
            try:
                changed, row[f"{name}_passes"] = run(
                    campaign.with_settings(_settings({one: factor}))
                )
            except SceneError as error:
                reason = str(error.problems[0]).removeprefix(f"{campaign.name}: ")
                row["note"], row[f"{name}_passes"] = f"{name}: {reason}", None
                row |= dict.fromkeys((name, f"{name}_low", f"{name}_high"), math.nan)
                done += 1
                progress(done, total)
                continue
            more, less = int((changed & ~violates).sum()), int((violates & ~changed).sum())
            interval = paired_interval(more, less, cases)
            row |= {name: (more - less) / cases, f"{name}_low": interval[0]}
            row[f"{name}_high"] = interval[1]
        rows.append(row)
    table = pd.DataFrame(rows)
    order = np.argsort(table["half"].fillna(0.0).to_numpy(), kind="stable")
    by_gain = [spreads[k] for k in order]
    table = table.iloc[order].reset_index(drop=True)
    candidates, factor = _candidates(table, by_gain, passes)
    factors, verdict = _propose(campaign, candidates, factor, passes, cases, seed, threads)
    return Allocation(
        table,
        float(violates.mean()),
        passes,
        {one.parameter.key: factor for one in factors},
        _settings(dict.fromkeys(factors, factor)),
        verdict is not None and verdict.shown,
        None if verdict is None else verdict.table,
        cases,
        seed,
        seed if verdict is None else verdict.seed,
        () if verdict is None else verdict.notes,
    )


def _settings(factors: dict[Dispersion, float]) -> dict[str, Any]:
    """Return the settings of the file, distributions by TOML path, that scale the spreads of the
    given dispersions by their factors."""
    return {
        f"dispersion.{one.parameter.key}": scaled_distribution(one, factor)
        for one, factor in factors.items()
    }


def _ignore(*_: object) -> None:
    """Do nothing; stands in for a missing ``announce`` or ``progress``."""


def _candidates(
    table: pd.DataFrame, spreads: Sequence[Dispersion], passes: bool
) -> tuple[list[Dispersion], float]:
    """Return the inputs to scale, in this order, and the factor of their spreads.

    If the campaign passes: `DOUBLE`, and inputs that pass when doubled alone, the smallest rise of
    the violation probability first. Else: `HALF`, and inputs whose halving lowers it with 95 %
    confidence, the largest gain first. ``table`` has its rows in the order of that gain, and
    ``spreads`` are the inputs of the rows.
    """
    if passes:
        good = table[table["double_passes"].eq(True)].sort_values("double", kind="stable")
        return [spreads[k] for k in good.index], DOUBLE
    good = table[table["half_high"] < 0.0]
    return [spreads[k] for k in good.index], HALF


def _propose(
    campaign: "Campaign",
    candidates: Sequence[Dispersion],
    factor: float,
    passes: bool,
    cases: int,
    seed: int,
    threads: int | None,
) -> tuple[list[Dispersion], FreshVerdict | None]:
    """Choose how many of the ``candidates``, in their order, to scale by ``factor``, by runs with
    other seeds.

    If the campaign ``passes``, the largest number is searched with which a run still shows all
    requirements (``factor`` is above 1), else the smallest number with which a run shows them
    (below 1). The search is a bisection that begins with all candidates, in at most `MAX_TRIES`
    runs of ``cases`` cases, each with a seed of its own above ``seed``. If the campaign passes and
    no run shows all requirements before the last allowed one, the last run scales nothing; so does
    the only run if the campaign passes and there are no candidates.

    Returns
    -------
    scaled : list of Dispersion
        Inputs scaled in the last run that shows all requirements, or in the last run if none does.
    verdict : FreshVerdict or None
        Verdicts of that run; None if the campaign does not pass and has no candidates, as then
        nothing is run.
    """
    best: tuple[list[Dispersion], FreshVerdict | None] = ([], None)
    low, high = (0, len(candidates)) if passes else (1, len(candidates))
    count = len(candidates)  # the first try scales all
    for number in range(1, MAX_TRIES + 1):
        if low > high:
            break
        if passes and number == MAX_TRIES and not (best[1] and best[1].shown):
            count = 0
        chosen = list(candidates[:count])
        settings = _settings(dict.fromkeys(chosen, factor))
        verdict = fresh_verdict(
            campaign, settings, cases, seed + number, MAX_TRIES, threads, _ignore
        )
        shown = verdict.shown
        if shown or best[1] is None or not best[1].shown:
            best = chosen, verdict
        if shown == passes:  # more may be scaled
            low = count + 1
        else:
            high = count - 1
        count = (low + high + 1) // 2 if passes else (low + high) // 2
    return best


__all__ = ["Allocation", "allocate", "scaled_distribution"]
