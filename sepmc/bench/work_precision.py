"""Work-precision: error and time of every method, number of steps and formulation."""

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

# requested of the step selection, for steps that a user might get
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
PER = 10_000  # cases that reported times refer to
_MESSAGE_S = 20.0  # between progress messages
_MAX_REFINED = 0.5  # fraction of refined cases above which steps are not those of the variant
_MAX_WORK = 25  # variants with more than this multiple of the default evaluations are left out


def measure(study: Study, reference: Reference) -> pd.DataFrame:
    """Measure error and time of the variants of method, steps and formulation, except the variant
    that made the reference and those that are left out with a message (`rows_of`).

    Returns
    -------
    DataFrame, a row per variant
        ``formulation``, ``method``, ``setting`` and ``requested`` accuracy of the variant;
        ``error``, the largest against the reference, and ``worst_outcome``, which has it; ``ms``
        and ``best_ms``, median and smallest time of 10,000 cases; ``us_per_case``; ``cases``,
        ``repeats`` and their ``spread``. ``scaled`` is True if fewer than the study's cases were
        run, ``default`` if its steps are those of a run of the campaign.
    """
    variants = _variants(study, "reduced")
    if study.formulation == FULL:
        variants += _variants(study, FULL)
    else:  # at the steps of the reduced formulation, which agrees to round-off
        own = [v for v in variants if v.method == study.method and np.isfinite(v.requested)]
        variants += [variant.by_formulation(study, FULL) for variant in own]
    return rows_of(study, reference, _without_reference(reference, study, variants))


def own_variants(study: Study, reference: Reference) -> list[SolverVariant]:
    """Return the variants of the scene's own formulation, without the one that made the
    reference."""
    return _without_reference(reference, study, _variants(study, study.formulation))


def _without_reference(
    reference: Reference, study: Study, variants: list[SolverVariant]
) -> list[SolverVariant]:
    """Return the variants without the one that made the reference: the same formulation, method
    and steps in words."""
    known = (study.formulation, METHOD, reference.setting)
    return [v for v in variants if (v.formulation, v.method, v.setting) != known]


def rows_of(study: Study, reference: Reference, variants: list[SolverVariant]) -> pd.DataFrame:
    """Run and time variants in rounds; return a table with a row for each (see `measure`). Those of
    which most cases were refined are left out with a message, except the default one."""
    blocks, report = [], progress_reporter(study.say, _MESSAGE_S)
    for number, variant in enumerate(variants):
        block = variant.fly(study.inputs)
        report(partial(_progress, number + 1, len(variants)))
        if variant.default or _refined_fraction(block) <= _MAX_REFINED:
            blocks.append((variant, block))
        else:
            study.say(
                "left out, as most of its cases need smaller steps (refinement): "
                f"{variant.method}, {variant.setting}"
            )
    times = rounds(
        {str(i): partial(variant.fly, study.inputs) for i, (variant, _) in enumerate(blocks)},
        study.repeats,
    )
    rows = []
    for i, (variant, block) in enumerate(blocks):
        error, worst = study.error(block, reference.outcomes, reference.valid)
        rows.append(_row(variant, times[str(i)], error, worst, variant.cases < study.cases))
    return pd.DataFrame(rows)


def _progress(done: int, total: int, seconds: float) -> str:
    """Return the progress message, such as "3 of 40 variants run in 35 s ...", of ``done``
    variants of ``total`` and the elapsed ``seconds``."""
    return f"{done} of {total} variants run in {seconds:.0f} s ..."


def _refined_fraction(block: Block) -> float:
    """Return the fraction of the cases of a block, which must have its ``refinement``, that were
    refined: integrated again in smaller steps."""
    assert block.refinement is not None
    return block.refinement.n_refined / len(block.status)


def _row(
    variant: SolverVariant, times: list[float], error: float, worst: str, few: bool
) -> dict[str, Any]:
    """Return the row of a variant in the table of `measure`: median and minimum of the ``times`` of
    its repeats, s, scaled to ms of 10,000 cases, and its largest error, which the outcome ``worst``
    has; ``few`` is True if it ran fewer than the study's cases."""
    scale = 1e3 * PER / variant.cases
    return {
        "formulation": variant.formulation,
        "method": variant.method,
        "setting": variant.setting,
        "requested": variant.requested,
        "error": error,
        "worst_outcome": worst,
        "ms": scale * median(times),
        "best_ms": scale * min(times),
        "us_per_case": 1e6 * median(times) / variant.cases,
        "cases": variant.cases,
        "scaled": few,
        "repeats": len(times),
        "spread": spread(times),
        "default": variant.default,
    }


def _variants(study: Study, formulation: str) -> list[SolverVariant]:
    """Return the variants of a formulation: each method in the steps selected for several
    accuracies, and in multiples of the steps selected for the scene's accuracy. With the full
    formulation, or in a quick study, only the scene's method; with the full one no multiples."""
    all_methods = [*sorted(METHODS, key=lambda m: METHODS[m]().order), AUTO]
    methods = [study.method] if study.quick or formulation == FULL else all_methods
    return [variant for method in methods for variant in _of_method(study, method, formulation)]


def _of_method(study: Study, method: str, formulation: str) -> list[SolverVariant]:
    """Return the variants of one method and formulation, by increasing work: the steps selected for
    the accuracies `ACCURACIES` (not if the campaign gives its step) and, in the reduced
    formulation, half, twice and four times the first of these steps. Those above `_MAX_WORK` times
    the work of the default are left out with a message; long ones run fewer cases."""
    campaign = study.with_settings({"solver.method": method, "solver.formulation": formulation})
    cases, max_evaluations = study.part(formulation), _MAX_WORK * study.default.evaluations
    if (method, formulation) == (study.method, study.formulation):
        first = study.default
    else:
        first = SolverVariant(
            select_steps(campaign, announce=study.say), campaign, cases, study.default.requested
        )
    variants = [first]
    if first.integration.step is None:  # steps are selected, not fixed
        for accuracy in ACCURACIES[::8] if study.quick else ACCURACIES:
            if accuracy != first.requested:
                variants.append(
                    SolverVariant(
                        select_steps(campaign.with_settings({"solver.accuracy": accuracy})),
                        campaign,
                        cases,
                        accuracy,
                    )
                )
            if variants[-1].evaluations > max_evaluations:
                break  # the next accuracies take still more
    if formulation != FULL:
        variants += [
            SolverVariant(integration, campaign, cases)
            for integration in _multiples(first.integration)
        ]
    unique: dict[tuple[Any, ...], SolverVariant] = {}
    for variant in variants:
        unique.setdefault(
            (*variant.integration.steps.tolist(), *variant.integration.method_names), variant
        )
    for variant in unique.values():
        if variant.evaluations > max_evaluations:
            study.say(
                f"left out, as it needs more than {_MAX_WORK} times the evaluations of the "
                f"selected steps: {variant.formulation}, {variant.method}, {variant.setting}"
            )
    affordable = [variant for variant in unique.values() if variant.evaluations <= max_evaluations]
    if formulation != FULL:
        affordable = [
            v if v.default else replace(v, cases=min(v.cases, study.affordable(v.evaluations)))
            for v in affordable
        ]
    return sorted(affordable, key=lambda variant: variant.evaluations)


def _multiples(integration: Integration) -> list[Integration]:
    """Return copies of an integration with half, twice and four times its number of steps, in which
    no case is refined; the first is left out if the file gives the step."""
    half = np.maximum(1, np.round(0.5 * integration.steps)).astype(np.int64)
    fewer = [replace(integration, steps=half)] if integration.step is None else []
    return [
        replace(multiple, limits=None, angles={}, error_limit=np.inf)
        for multiple in (*fewer, integration.refined(2), integration.refined(4))
    ]
