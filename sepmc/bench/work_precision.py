"""Error over time for every method, number of steps and formulation."""

from dataclasses import replace
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from sepmc.bench.clock import rounds, spread
from sepmc.bench.reference import METHOD, Reference
from sepmc.bench.study import FULL, SolverVariant, Study
from sepmc.campaign.execution.step_selection import Integration, select_steps
from sepmc.engine.dispatch import Block, progress_reporter
from sepmc.kernel.spec.methods import AUTO, METHODS

# asked of the pilot, to get steps that a user might fly with
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
PER = 10_000  # cases that times are told for
_EVERY_S = 20.0  # between two words on how far the ways are
_MOST_AGAIN = 0.5  # of the cases may be flown again: then the steps are not those of the way
_MOST = 25  # times as many evaluations as by default are left out


def measure(study: Study, reference: Reference) -> pd.DataFrame:
    """One row a way to fly; times are medians, for 10,000 cases, ms; ``scaled`` if fewer than the
    study's were flown."""
    ways = _variants(study, "reduced")
    if study.formulation == FULL:
        ways += _variants(study, FULL)
    else:  # at the steps that reduced equations are flown in: they agree to round-off
        own = [way for way in ways if way.method == study.method and np.isfinite(way.asked)]
        ways += [way.by_formulation(study, FULL) for way in own]
    return rows_of(study, reference, _without(reference, study, ways))


def own_variants(study: Study, reference: Reference) -> list[SolverVariant]:
    """Ways to fly by the scene's own formulation; not that of the reference."""
    return _without(reference, study, _variants(study, study.formulation))


def _without(reference: Reference, study: Study, ways: list[SolverVariant]) -> list[SolverVariant]:
    known = (study.formulation, METHOD, reference.setting)
    return [way for way in ways if (way.formulation, way.method, way.setting) != known]


def rows_of(study: Study, reference: Reference, ways: list[SolverVariant]) -> pd.DataFrame:
    """Fly some ways and time them, in rounds; a row each."""
    flown, tell = [], progress_reporter(study.say, _EVERY_S)
    for number, way in enumerate(ways):
        block = way.fly(study.draws)
        tell(partial(_so_far, number + 1, len(ways)))
        if way.default or _flown_again(block) <= _MOST_AGAIN:
            flown.append((way, block))
        else:
            study.say(
                f"left out, most cases are flown again in finer steps: {way.method}, {way.setting}"
            )
    times = rounds(
        {str(i): partial(way.fly, study.draws) for i, (way, _) in enumerate(flown)}, study.repeats
    )
    rows = []
    for i, (way, block) in enumerate(flown):
        error, worst = study.error(block, reference.outcomes, reference.sound)
        rows.append(_row(way, times[str(i)], error, worst, way.cases < study.cases))
    return pd.DataFrame(rows)


def _so_far(done: int, total: int, seconds: float) -> str:
    return f"{done} of {total} ways flown in {seconds:.0f} s ..."


def _flown_again(block: Block) -> float:
    """Share of the cases of a block that were flown again."""
    assert block.refinement is not None
    return block.refinement.n_refined / len(block.status)


def _row(
    way: SolverVariant, times: list[float], error: float, worst: str, few: bool
) -> dict[str, Any]:
    scale = 1e3 * PER / way.cases
    return {
        "formulation": way.formulation,
        "method": way.method,
        "setting": way.setting,
        "asked": way.asked,
        "error": error,
        "worst_outcome": worst,
        "ms": scale * median(times),
        "best_ms": scale * min(times),
        "us_per_case": 1e6 * median(times) / way.cases,
        "cases": way.cases,
        "scaled": few,
        "repeats": len(times),
        "spread": spread(times),
        "default": way.default,
    }


def _variants(study: Study, formulation: str) -> list[SolverVariant]:
    """Each method in the steps that the pilot chooses for several accuracies, and in multiples of
    those for the accuracy asked. By the full formulation only the scene's own method, without
    multiples."""
    every = [*sorted(METHODS, key=lambda m: METHODS[m]().order), AUTO]
    methods = [study.method] if study.quick or formulation == FULL else every
    return [way for method in methods for way in _of_method(study, method, formulation)]


def _of_method(study: Study, method: str, formulation: str) -> list[SolverVariant]:
    campaign = study.with_settings({"solver.method": method, "solver.formulation": formulation})
    cases, most = study.part(formulation), _MOST * study.default.evaluations
    if (method, formulation) == (study.method, study.formulation):
        first = study.default
    else:
        first = SolverVariant(
            select_steps(campaign, announce=study.say), campaign, cases, study.default.asked
        )
    ways = [first]
    if first.flight.step is None:  # the pilot has something to choose
        for accuracy in ACCURACIES[::8] if study.quick else ACCURACIES:
            if accuracy != first.asked:
                ways.append(
                    SolverVariant(
                        select_steps(campaign.with_settings({"solver.accuracy": accuracy})),
                        campaign,
                        cases,
                        accuracy,
                    )
                )
            if ways[-1].evaluations > most:
                break  # it takes still more for the next ones
    if formulation != FULL:
        ways += [SolverVariant(flight, campaign, cases) for flight in _multiples(first.flight)]
    found: dict[tuple[Any, ...], SolverVariant] = {}
    for way in ways:
        found.setdefault((*way.flight.steps.tolist(), *way.flight.method_names), way)
    for way in found.values():
        if way.evaluations > most:
            study.say(
                f"left out, more than {_MOST} times the work of the default: {way.formulation}, "
                f"{way.method}, {way.setting}"
            )
    left = [way for way in found.values() if way.evaluations <= most]
    if formulation != FULL:
        left = [
            way
            if way.default
            else replace(way, cases=min(way.cases, study.affordable(way.evaluations)))
            for way in left
        ]
    return sorted(left, key=lambda way: way.evaluations)


def _multiples(flight: Integration) -> list[Integration]:
    """A flight in half, twice and four times as many steps; a step that the scene gives is only
    divided."""
    half = np.maximum(1, np.round(0.5 * flight.steps)).astype(np.int64)
    fewer = [replace(flight, steps=half)] if flight.step is None else []
    return [
        replace(one, limits=None, angles={}, error_limit=np.inf)
        for one in (*fewer, flight.refined(2), flight.refined(4))
    ]
