"""Counts and extremes of cases: of a chunk, a shard and a whole run."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from operator import add
from typing import Any, Self

import msgspec
import numpy as np

from sepmc.analysis import rare_values
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.accuracy import AchievedAccuracy
from sepmc.campaign.execution.diagnostics import min_at_end
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.missing_events import count_missing
from sepmc.engine.dispatch import Block
from sepmc.scene.messages import InputError
from sepmc.schema import Status


class BatchSummary(msgspec.Struct, frozen=True):
    """Counts and extremes of a set of cases; summaries add up.

    Attributes
    ----------
    failures : int
        Cases with another status than ok.
    implausible : int
        Cases with an inertia that no solid body has.
    refined, fallback, unconverged : int
        Cases integrated again at smaller steps; cases integrated by a fallback kernel; cases
        integrated again that did not converge.
    min_at_end : mapping of str to int
        By clearance: cases whose minimum is at the end time.
    missing : mapping of str to int
        By event: ok cases in which it does not occur; see
        `sepmc.campaign.execution.missing_events`.
    errors : mapping of str to float
        Largest relative error of each outcome, of those whose error is estimated case by case.
    indicators : tuple of float
        Largest error indicators; see `sepmc.campaign.execution.error_estimate.Estimate.largest`.
    occurred : tuple of int
        Occurrences of rare values; see `sepmc.analysis.rare_values.count_values`.
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
        """JSON text for `read`."""
        return json.dumps(msgspec.to_builtins(self))


def read(text: str | bytes) -> BatchSummary:
    """Read a summary from `BatchSummary.text`, which may contain Infinity. Raises InputError if the
    text is none."""
    try:
        return msgspec.convert(json.loads(text), BatchSummary)
    except (ValueError, RecursionError, msgspec.ValidationError):
        raise InputError("the summary of a shard cannot be read; run its cases again") from None


def count(campaign: Definition, inputs: np.ndarray, block: Block) -> BatchSummary:
    """Summary of a chunk of cases.

    Parameters
    ----------
    campaign : Definition
    inputs : ndarray, shape (n, d)
        In the units of the campaign file.
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
    """Summary of the numerical errors of a chunk of cases, and of those integrated again."""
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
    """Achieved accuracy of a run: the larger error of its cases and of the calibration cases."""
    achieved = integration.achieved
    assert achieved is not None
    # no calibration case has an error, but cases that were integrated again have
    if not achieved.cases and summary.refined:
        achieved = replace(achieved, errors=dict.fromkeys(achieved.errors, 0.0))
    return achieved.with_errors(_errors(integration, summary))


def _errors(integration: Integration, summary: BatchSummary) -> dict[str, float]:
    """Largest relative error of each outcome, by name, over the cases in a summary."""
    errors_by_name, estimate = dict(summary.errors), integration.estimate
    if estimate is None or not errors_by_name:
        return errors_by_name
    names, errors = list(errors_by_name), np.array(list(errors_by_name.values()))
    largest = estimate.largest(errors, np.array(summary.indicators))
    return dict(zip(names, np.maximum(errors, largest).tolist(), strict=True))


def accuracy_entries(
    campaign: Definition, integration: Integration, summary: BatchSummary
) -> dict[str, Any]:
    """Entry ``accuracy`` of a manifest: steps of an integration, and numerical error of the cases
    in a summary."""
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
