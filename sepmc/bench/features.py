"""What each feature of a scene costs: the same cases flown in the same steps with and without
it."""

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from sepmc.bench import flops
from sepmc.bench.clock import rounds, spread
from sepmc.bench.study import FULL, Study
from sepmc.bench.work_precision import PER
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.integration import by_name
from sepmc.campaign.execution.step_selection import kernel_text, stage_names
from sepmc.engine.dispatch import integrate_cases, load_kernel, use_threads
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

ALL, HISTORIES = "everything", "histories"
_HISTORY_ROWS = 50  # if the scene asks for none


@dataclass(frozen=True)
class Variant:
    """The campaign with a feature taken out, or with histories; ``change`` says how."""

    feature: str
    change: str
    campaign: Campaign


def measure(study: Study, history_step: float) -> pd.DataFrame:
    """One row a feature: time and flops without it, and their ratios to those of the whole scene.

    The kernel of each is written and compiled for what is left; nothing but the kernel is timed, in
    the steps of the whole scene, and by one thread: two may meet on one core for a whole part.
    """
    variants = _variants(study, history_step)
    counts = _counts(study, variants)
    flights = {v.feature: _flight(study, v) for v in variants}
    use_threads(1)
    found = rounds(flights, study.repeats)
    use_threads(study.threads)
    times = {name: median(those) for name, those in found.items()}
    cases = study.own_cases
    rows = []
    for variant, counted in zip(variants, counts, strict=True):
        rows.append({
            "feature": variant.feature,
            "change": variant.change,
            "ms": 1e3 * PER * times[variant.feature] / cases,
            "time_ratio": times[variant.feature] / times[ALL],
            "flops_per_evaluation": counted.evaluation if counted else np.nan,
            "flops_per_case": counted.total if counted else np.nan,
            "flop_ratio": counted.total / counts[0].total if counted and counts[0] else np.nan,
            "evaluations": sum(counted.evaluations.values()) if counted else np.nan,
            "cases": cases,
            "spread": spread(found[variant.feature]),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _counts(study: Study, variants: list[Variant]) -> list[flops.Flops | None]:
    """Each takes the time of a compilation, in a process of its own; so many at once as there are
    threads. Equal kernels are one."""
    # its elimination is in loops, and their code does not tell how often they run
    if study.formulation == FULL:
        return [None] * len(variants)
    wanted = [
        v
        for v in variants
        if v.feature in (ALL, "atmosphere") or not (study.quick or v.feature == HISTORIES)
    ]
    wanted = [v for v in wanted if _has_stages(study, v.campaign)]
    texts = {v.feature: kernel_text(v.campaign) for v in wanted}
    first = {text: v for v in reversed(wanted) for text in [texts[v.feature]]}
    study.say(
        f"counting the operations of {len(first)} kernels (some twenty seconds each, once) ..."
    )
    with ThreadPoolExecutor(study.threads) as pool:
        found = dict(
            zip(
                first,
                pool.map(lambda v: flops.count(v.campaign, study.flight), first.values()),
                strict=True,
            )
        )
    return [found.get(texts.get(v.feature, "")) for v in variants]


def _flight(study: Study, variant: Variant) -> Callable[[], object]:
    """Flies the cases by the kernel alone: cases that it loses are not flown again."""
    campaign = variant.campaign
    known = {d.parameter.path for d in campaign.file.dispersions}
    columns = [
        i for i, d in enumerate(study.campaign.file.dispersions) if d.parameter.path in known
    ]
    draws, run = np.asfortranarray(study.draws[: study.own_cases, columns]), campaign.scene.run
    room = (
        int(run.end_time / run.history_step + 1e-9) + 1
        if run.history_step > 0.0 and campaign.plan.joints
        else 0
    )
    flight, kernel = study.flight, study.flight.kernel
    if variant.feature != ALL:
        text = kernel_text(campaign, flight.one_method, history=room > 0)
        kernel = load_kernel(text, study.say)
    methods = by_name(kernel, flight.method_names)
    return lambda: integrate_cases(
        kernel, campaign.plan, flight.steps, flight.durations, campaign.slots, draws, room, methods
    )


def _has_stages(study: Study, campaign: Campaign) -> bool:
    """Whether the kernel of a campaign has as many stages as the study's: only then can it fly in
    its steps."""
    return len(stage_names(campaign)) == study.flight.kernel.n_segments


def _variants(study: Study, history_step: float) -> list[Variant]:
    """The whole scene first, then without each feature that it has; one that cannot go is told and
    left out."""
    scene = study.campaign.scene
    found = [Variant(ALL, "the scene as it is, without histories", study.campaign)]
    aerodynamic = [name for name, body in scene.body.items() if body.aerodynamics is not None]
    air = scene.environment
    asked: list[tuple[str, bool, str, tuple[str, ...], dict[str, Any]]] = [
        (
            "aerodynamics",
            bool(aerodynamic),
            "no body.aerodynamics",
            tuple(f"body.{b}.aerodynamics" for b in aerodynamic),
            {},
        ),
        (
            "atmosphere",
            air.atmosphere != "none",
            'environment.atmosphere = "none"',
            (),
            {"environment.atmosphere": "none"},
        ),
        (
            "wind",
            air.wind.speed > 0.0 or air.wind.profile is not None,
            "no environment.wind",
            ("environment.wind",),
            {},
        ),
        (
            "gravity",
            air.gravity != "none",
            'environment.gravity = "none"',
            (),
            {"environment.gravity": "none"},
        ),
        ("motors", bool(scene.motor), "no motor", ("motor",), {}),
        ("springs", bool(scene.spring), "no spring", ("spring",), {}),
        ("loads", bool(scene.load), "no load", ("load",), {}),
    ]
    for feature, there, change, gone, settings in asked:
        if there:
            try:
                campaign = _without(study.campaign, gone, settings)
            except SceneError as error:
                study.say(
                    f"cost of {feature}: the scene cannot be flown without: {error.problems[0]}"
                )
                continue
            if not _has_stages(study, campaign):
                study.say(
                    f"cost of {feature}: without it the flight has other stages, so its steps are "
                    "not those of the whole scene"
                )
                continue
            found.append(Variant(feature, change, campaign))
    if study.campaign.plan.joints and _has_stages(study, study.campaign):
        every = history_step or scene.run.end_time / _HISTORY_ROWS
        histories = study.with_settings({"run.history_step_s": every})
        found.append(Variant(HISTORIES, f"with a row every {every:g} s", histories))
    return found


def _without(campaign: Campaign, gone: tuple[str, ...], settings: dict[str, Any]) -> Campaign:
    """A campaign without some tables, and without the dispersions of what stood in them."""
    tree = copy.deepcopy(campaign.file.tree)
    for path in gone:
        node, *rest = tree, *path.split(".")
        for key in rest[:-1]:
            node = node.get(key, {})
        node.pop(rest[-1], None)
    inside = tuple(f"{path}." for path in gone)
    tree["dispersion"] = (
        {
            path: law
            for path, law in tree.get("dispersion", {}).items()
            if not path.startswith(inside)
        }
        if inside
        else tree.get("dispersion", {})
    )
    return Campaign(parse_campaign(tree, campaign.name, settings, campaign.name))
