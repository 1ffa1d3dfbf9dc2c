"""Counts of cases and largest errors, for a chunk, a shard and a whole run."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from operator import add
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from sepmc.analysis import rare_values
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy
from sepmc.campaign.execution.diagnostics import min_at_end
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.missing_events import count_missing
from sepmc.campaign.store.untrusted import StoreError
from sepmc.engine.dispatch import Block
from sepmc.schema import Status


class BatchSummary(msgspec.Struct, frozen=True):
    """Counts and largest errors of a set of cases; ``a + b`` is the summary of both sets.

    Attributes
    ----------
    failures : int
        Number of cases with another status than ok.
    implausible : int
        Number of cases with an inertia that no solid body has.
    refined, fallback, unconverged : int
        Number of cases integrated again at smaller steps; integrated by a fallback kernel;
        integrated again without reaching convergence.
    min_at_end : mapping of str to int
        By clearance: number of cases in which it is smallest at the end time.
    missing : mapping of str to int
        By event: number of ok cases in which it does not occur; see
        `sepmc.campaign.execution.missing_events`.
    errors : mapping of str to float
        By outcome: largest relative error of the cases integrated again and, for the outcomes
        `Estimate.leading`, of all other cases too. The errors of other outcomes follow from
        ``indicators``.
    indicators : tuple of float
        Largest value of each error indicator over the cases not integrated again; see
        `sepmc.campaign.execution.error_estimate.Estimate.largest`.
    occurred : tuple of int
        Number of cases, then the number of those with each rare value of the campaign; see
        `sepmc.analysis.rare_values.count_values`.
    """

    failures: int = 0
    implausible: int = 0
    refined: int = 0
    fallback: int = 0
    unconverged: int = 0
    min_at_end: Mapping[str, int] = {}
    missing: Mapping[str, int] = {}
    errors: Mapping[str, float] = {}
    indicators: tuple[float, ...] = ()
    occurred: tuple[int, ...] = ()

    def __add__(self, other: Self) -> "BatchSummary":
        names = dict.fromkeys([*self.errors, *other.errors])
        return BatchSummary(
            self.failures + other.failures,
            self.implausible + other.implausible,
            self.refined + other.refined,
            self.fallback + other.fallback,
            self.unconverged + other.unconverged,
            dict(Counter(self.min_at_end) + Counter(other.min_at_end)),
            dict(Counter(self.missing) + Counter(other.missing)),
            {name: max(self.errors.get(name, 0.0), other.errors.get(name, 0.0)) for name in names},
            tuple(map(max, self.indicators, other.indicators))
            or self.indicators
            or other.indicators,
            tuple(map(add, self.occurred, other.occurred)) or self.occurred or other.occurred,
        )

    @property
    def text(self) -> str:
        """The summary as JSON text, which `read` converts back."""
        return json.dumps(msgspec.to_builtins(self))


def read(text: str | bytes, path: Path) -> BatchSummary:
    """Convert JSON text from `BatchSummary.text`, which may contain Infinity, to the summary.

    A missing entry has its default, an unknown one is ignored. Raises StoreError, which names the
    file ``path`` that has the text, if that is no JSON object or an entry has a wrong type."""
    try:
        return msgspec.convert(json.loads(text), BatchSummary)
    except (ValueError, RecursionError, msgspec.ValidationError):
        raise StoreError(
            f"{path}: has a summary in its metadata that cannot be read, so the run cannot be "
            "continued: run it again, into another folder"
        ) from None


def count(campaign: Definition, inputs: np.ndarray, block: Block) -> BatchSummary:
    """Summarise the inputs and results of n cases.

    Parameters
    ----------
    campaign : Definition
    inputs : ndarray, shape (n, d)
        Inputs of the cases, in the units of the campaign file.
    block : Block
        Results of the kernel for these n cases.

    Returns
    -------
    BatchSummary
    """
    outcomes = {c.name: x for c, x in zip(campaign.outcome_columns, block.outcomes.T, strict=False)}
    return msgspec.structs.replace(
        count_errors(campaign, block),
        failures=int(np.count_nonzero(block.status != Status.OK)),
        implausible=campaign.implausible_inertias(inputs),
        min_at_end=dict(min_at_end(campaign, outcomes, inputs)),
        missing=count_missing(campaign, outcomes, block.status == Status.OK),
        occurred=rare_values.count_values(campaign.rare_values, inputs),
    )


def count_errors(campaign: Definition, block: Block) -> BatchSummary:
    """Return a summary of the cases of a block in which only ``refined``, ``fallback``,
    ``unconverged``, ``errors`` and ``indicators`` are filled, from ``block.refinement``; the other
    fields are 0 or empty. If ``block.refinement`` is None, the counts and all errors are 0, and
    there are no indicators."""
    columns, again = campaign.outcome_columns, block.refinement
    errors = np.zeros(len(columns)) if again is None else again.error
    return BatchSummary(
        refined=again.n_refined if again else 0,
        fallback=again.n_fallback if again else 0,
        unconverged=again.n_unconverged if again else 0,
        errors={c.name: float(x) for c, x in zip(columns, errors, strict=True)},
        indicators=tuple(again.indicators.tolist()) if again else (),
    )


def accuracy(integration: Integration, summary: BatchSummary) -> AchievedAccuracy:
    """Return the numerical error of a run: for each outcome the larger of the error of its own
    cases (``summary``) and that of the calibration cases (``integration.achieved``)."""
    achieved = integration.achieved
    assert achieved is not None
    # no calibration case has an error, but cases that were integrated again have
    if not achieved.cases and summary.refined:
        achieved = replace(achieved, errors=dict.fromkeys(achieved.errors, 0.0))
    return achieved.with_errors(_errors(integration, summary))


def _errors(integration: Integration, summary: BatchSummary) -> dict[str, float]:
    """Return the largest relative error over the cases in a summary, by outcome: the larger of that
    of the cases integrated again and that which ``integration.estimate`` gives for all others."""
    errors_by_name, estimate = dict(summary.errors), integration.estimate
    if estimate is None or not errors_by_name:
        return errors_by_name
    names, errors = list(errors_by_name), np.array(list(errors_by_name.values()))
    largest = estimate.largest(errors, np.array(summary.indicators))
    return dict(zip(names, np.maximum(errors, largest).tolist(), strict=True))


def accuracy_entries(
    campaign: Definition, integration: Integration, summary: BatchSummary
) -> dict[str, Any]:
    """Return the contents of the entry ``accuracy`` of a manifest, by key: methods and steps of an
    integration, numerical error of the run (`accuracy`), number of calibration cases (``cases``),
    and counts of the cases in the summary that were integrated again or by a fallback kernel. A
    key whose item does not apply, such as a count of 0, is left out; ``n_unconverged`` is given
    whenever cases were integrated again."""
    solver, achieved = campaign.scene.solver, accuracy(integration, summary)
    entries: dict[str, Any] = {
        "formulation": solver.formulation,
        "method": solver.method,
        "methods": integration.method_names,
    }
    if integration.step is not None:
        entries |= {"step_s": integration.step}
    else:
        entries |= {"steps": integration.steps.tolist(), "stages": integration.stages}
    worst, error = achieved.worst
    entries |= {"achieved": error, "worst_outcome": worst, "cases": achieved.cases}
    if achieved.history is not None:
        entries |= {"history": achieved.history}
    if summary.refined:
        entries |= {"n_refined": summary.refined}
        entries |= {"n_unconverged": summary.unconverged}
    if summary.fallback:
        entries |= {"n_fallback": summary.fallback}
    if solver.step is None:
        entries |= {"asked": achieved.asked, "met": achieved.met}
    if achieved.worst_position:
        entries |= {"worst_place": achieved.worst_position[0], "places": sorted(achieved.positions)}
    return {**entries, "errors": achieved.errors}
