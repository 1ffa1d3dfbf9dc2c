"""What is counted of cases as they are flown: of a part, and of all that a run holds."""

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
from sepmc.campaign.execution.accuracy import Achieved
from sepmc.campaign.execution.diagnostics import least_at_the_end
from sepmc.campaign.execution.integration import Flight
from sepmc.campaign.execution.missing_events import count_missing
from sepmc.engine.dispatch import Block
from sepmc.scene.messages import InputError
from sepmc.schema import Status


class Tally(msgspec.Struct, frozen=True):
    """How many cases have another status than ok, an inertia that no solid body has, were flown
    again at ``finer`` steps or by a ``spare`` kernel, and of these were not settled; in how many
    each clearance is least at the end, and in how many ok ones something is ``missing`` that the
    scene waits for (`sepmc.campaign.execution.missing_events`); the largest error of every outcome,
    as far as cases tell it one by one, and the largest ``guards``, which tell it of the others
    (`sepmc.campaign.execution.error_estimate.Estimate.largest`); how often rare values ``occurred``
    (`sepmc.analysis.rare_values.count`)."""

    failures: int = 0
    implausible: int = 0
    finer: int = 0
    spare: int = 0
    unsettled: int = 0
    least_at_the_end: Mapping[str, int] = {}
    missing: Mapping[str, int] = {}
    errors: Mapping[str, float] = {}
    guards: tuple[float, ...] = ()
    occurred: tuple[int, ...] = ()

    def __add__(self, other: Self) -> "Tally":
        names = dict.fromkeys([*self.errors, *other.errors])
        return Tally(
            self.failures + other.failures,
            self.implausible + other.implausible,
            self.finer + other.finer,
            self.spare + other.spare,
            self.unsettled + other.unsettled,
            dict(Counter(self.least_at_the_end) + Counter(other.least_at_the_end)),
            dict(Counter(self.missing) + Counter(other.missing)),
            {name: max(self.errors.get(name, 0.0), other.errors.get(name, 0.0)) for name in names},
            tuple(map(max, self.guards, other.guards)) or self.guards or other.guards,
            tuple(map(add, self.occurred, other.occurred)) or self.occurred or other.occurred,
        )

    @property
    def text(self) -> str:
        """As `read` takes it."""
        return json.dumps(msgspec.to_builtins(self))


def read(text: str | bytes) -> Tally:
    """A tally of `Tally.text`; an error may be infinite there, which JSON has no number for."""
    try:
        return msgspec.convert(json.loads(text), Tally)
    except (ValueError, RecursionError, msgspec.ValidationError):
        raise InputError("what a part tells of its cases cannot be read; fly them again") from None


def count(campaign: Definition, drawn: np.ndarray, block: Block) -> Tally:
    """The tally of cases that were flown together, from draws (n, d) in the units of the file."""
    columns, again = campaign.outcome_columns, block.refinement
    outcomes = {c.name: x for c, x in zip(columns, block.outcomes.T, strict=False)}
    errors = np.zeros(len(columns)) if again is None else again.error
    return Tally(
        int(np.count_nonzero(block.status != Status.OK)),
        campaign.implausible_inertias(drawn),
        again.n_refined if again else 0,
        again.n_fallback if again else 0,
        again.n_unconverged if again else 0,
        dict(least_at_the_end(campaign, outcomes, drawn)),
        count_missing(campaign, outcomes, block.status == Status.OK),
        {c.name: float(x) for c, x in zip(columns, errors, strict=True)},
        tuple(again.indicators.tolist()) if again else (),
        rare_values.count(campaign.rare_values, drawn),
    )


def accuracy(flight: Flight, tally: Tally) -> Achieved:
    """Error of cases: the largest that was counted of them, and of the trial cases."""
    told = flight.achieved
    assert told is not None
    # no trial case tells anything, but cases that were flown again do
    if not told.cases and tally.finer:
        told = replace(told, errors=dict.fromkeys(told.errors, 0.0))
    return told.with_errors(_errors(flight, tally))


def _errors(flight: Flight, tally: Tally) -> dict[str, float]:
    """The largest error of cases that were counted, by outcome."""
    found, estimate = dict(tally.errors), flight.estimate
    if estimate is None or not found:
        return found
    names, errors = list(found), np.array(list(found.values()))
    largest = estimate.largest(errors, np.array(tally.guards))
    return dict(zip(names, np.maximum(errors, largest).tolist(), strict=True))


def accuracy_told(campaign: Definition, flight: Flight, tally: Tally) -> dict[str, Any]:
    """What a manifest tells of how cases were flown, and of their error."""
    solver, told = campaign.scene.solver, accuracy(flight, tally)
    said: dict[str, Any] = {
        "formulation": solver.formulation,
        "method": solver.method,
        "methods": flight.method_names,
    }
    if flight.step is not None:
        said |= {"step_s": flight.step}
    else:
        said |= {"steps": flight.steps.tolist(), "stages": flight.stages}
    worst, error = told.worst
    said |= {"achieved": error, "worst_outcome": worst, "cases": told.cases}
    if told.history is not None:
        said |= {"history": told.history}
    if tally.finer:
        said |= {"finer_cases": tally.finer}
        said |= {"unsettled_cases": tally.unsettled}
    if tally.spare:
        said |= {"spare_cases": tally.spare}
    if solver.step is None:
        said |= {"asked": told.asked, "met": told.met}
    if told.worst_place:
        said |= {"worst_place": told.worst_place[0], "places": sorted(told.places)}
    return {**said, "errors": told.errors}


__all__ = ["Tally", "accuracy", "accuracy_told", "count", "read"]
