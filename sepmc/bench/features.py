"""Cost of each feature of a scene: the same cases in the same steps, with it and without it."""

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
from sepmc.campaign.execution.step_selection import kernel_spec, kernel_text
from sepmc.engine.dispatch import integrate_cases, load_kernel, use_threads
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign

ALL, HISTORIES = "everything", "histories"
_HISTORY_ROWS = 50  # if the scene has no histories


@dataclass(frozen=True)
class Variant:
    """Campaign that lacks the feature named ``feature``; or the whole scene (`ALL`), or the scene
    with histories (`HISTORIES`). ``change`` states the difference from the scene, as text for
    users."""

    feature: str
    change: str
    campaign: Campaign


def measure(study: Study, history_step: float) -> pd.DataFrame:
    """Measure time and operations of a scene without each of its features.

    The kernel of each variant is emitted and compiled; only its calls are timed, in the steps of
    the whole scene and on one thread, as two may share a core.

    Parameters
    ----------
    study : Study
    history_step : float
        Interval of history rows in the variant with histories, s; 0: 50 rows over the run.

    Returns
    -------
    DataFrame, a row for the whole scene, one without each feature, and last one with histories
        ``feature``, its name, and ``change``, what was removed or added; median time ``ms`` of
        10,000 cases, scaled from those timed, and its ``spread``; ``evaluations`` per case,
        ``flops_per_evaluation`` and ``flops_per_case`` (NaN if not counted); ``time_ratio`` and
        ``flop_ratio``, time and flops over those of the whole scene; ``cases``, the number of
        cases timed.
    """
    variants = _variants(study, history_step)
    counts = _counts(study, variants)
    runs = {v.feature: _run_of(study, v) for v in variants}
    use_threads(1)
    times_by_feature = rounds(runs, study.repeats)
    use_threads(study.threads)
    times = {name: median(values) for name, values in times_by_feature.items()}
    cases = study.own_cases
    rows = []
    for variant, count in zip(variants, counts, strict=True):
        rows.append({
            "feature": variant.feature,
            "change": variant.change,
            "ms": 1e3 * PER * times[variant.feature] / cases,
            "time_ratio": times[variant.feature] / times[ALL],
            "flops_per_evaluation": count.evaluation if count else np.nan,
            "flops_per_case": count.total if count else np.nan,
            "flop_ratio": count.total / counts[0].total if count and counts[0] else np.nan,
            "evaluations": sum(count.evaluations.values()) if count else np.nan,
            "cases": cases,
            "spread": spread(times_by_feature[variant.feature]),
        })  # fmt: skip
    return pd.DataFrame(rows)


def _counts(study: Study, variants: list[Variant]) -> list[flops.Flops | None]:
    """Count the operations of each variant, several in parallel; equal kernels are counted once.

    Return an entry for each variant, None if it is not counted: none is with the full formulation,
    only the whole scene and that without an atmosphere are if the study is quick, the scene with
    histories is never, nor is one whose segments differ from those of the study."""
    # its elimination is in loops, whose code does not show the number of iterations
    if study.formulation == FULL:
        return [None] * len(variants)
    counted = [
        v
        for v in variants
        if v.feature in (ALL, "atmosphere") or not (study.quick or v.feature == HISTORIES)
    ]
    counted = [v for v in counted if _has_same_segments(study, v.campaign)]
    texts = {v.feature: kernel_text(v.campaign) for v in counted}
    unique = {text: v for v in reversed(counted) for text in [texts[v.feature]]}
    study.say(
        f"counting the operations of {len(unique)} kernels, which takes about twenty seconds for "
        "each ..."
    )
    with ThreadPoolExecutor(study.threads) as pool:
        counts = dict(
            zip(
                unique,
                pool.map(lambda v: flops.count(v.campaign, study.integration), unique.values()),
                strict=True,
            )
        )
    return [counts.get(texts.get(v.feature, "")) for v in variants]


def _run_of(study: Study, variant: Variant) -> Callable[[], object]:
    """Return a function that integrates the study's `own_cases` by the kernel of a variant, without
    refining any. A kernel that is not in the cache is compiled here."""
    campaign = variant.campaign
    paths = {d.parameter.path for d in campaign.file.dispersions}
    columns = [
        i for i, d in enumerate(study.campaign.file.dispersions) if d.parameter.path in paths
    ]
    inputs = np.asfortranarray(study.inputs[: study.own_cases, columns])
    settings = campaign.scene.run
    history_rows = (
        int(settings.end_time / settings.history_step + 1e-9) + 1
        if settings.history_step > 0.0 and campaign.layout.joints
        else 0
    )
    integration, kernel = study.integration, study.integration.kernel
    if variant.feature != ALL:
        text = kernel_text(campaign, integration.one_method, history=history_rows > 0)
        kernel = load_kernel(text, study.say)
    methods = by_name(kernel, integration.method_names)
    return lambda: integrate_cases(
        kernel,
        campaign.layout,
        integration.steps,
        integration.durations,
        campaign.slots,
        inputs,
        history_rows,
        methods,
    )


def _has_same_segments(study: Study, campaign: Campaign) -> bool:
    """Return True if the kernel specification of a campaign, which is made but not compiled, has as
    many segments as the kernel of the study, so that the steps selected for the study apply."""
    spec = kernel_spec(campaign)
    return len(spec.segments) == study.integration.kernel.n_segments


def _variants(study: Study, history_step: float) -> list[Variant]:
    """Return the whole scene, then a variant without each of its features, and last, if it has
    joints, one with histories in steps of ``history_step``, s (0: a default). A feature without
    which the scene is invalid, or has another number of segments, is reported and left out."""
    scene = study.campaign.scene
    variants = [Variant(ALL, "the scene as it is, without histories", study.campaign)]
    tables = tuple(f"body.{b}.aerodynamics" for b, body in scene.body.items() if body.aerodynamics)
    air = scene.environment
    has_wind = air.wind.speed > 0.0 or air.wind.profile is not None
    no_air, no_gravity = ({f"environment.{name}": "none"} for name in ("atmosphere", "gravity"))
    candidates: list[tuple[str, bool, str, tuple[str, ...], dict[str, Any]]] = [
        ("aerodynamics", bool(tables), "no body.aerodynamics", tables, {}),
        ("atmosphere", air.atmosphere != "none", 'environment.atmosphere = "none"', (), no_air),
        ("wind", has_wind, "no environment.wind", ("environment.wind",), {}),
        ("gravity", air.gravity != "none", 'environment.gravity = "none"', (), no_gravity),
        ("motors", bool(scene.motor), "no motor", ("motor",), {}),
        ("springs", bool(scene.spring), "no spring", ("spring",), {}),
        ("loads", bool(scene.load), "no load", ("load",), {}),
    ]
    for feature, present, change, removed, settings in candidates:
        if present:
            try:
                campaign = _without(study.campaign, removed, settings)
            except SceneError as error:
                study.say(
                    f"cost of {feature} is not measured: the scene is invalid without it: "
                    f"{error.problems[0]}"
                )
                continue
            if not _has_same_segments(study, campaign):
                study.say(
                    f"cost of {feature} is not measured: without it the scene has another number "
                    "of kernel segments, so the selected steps do not apply"
                )
                continue
            variants.append(Variant(feature, change, campaign))
    if study.campaign.layout.joints and _has_same_segments(study, study.campaign):
        step = history_step or scene.run.end_time / _HISTORY_ROWS
        histories = study.with_settings({"run.history_step_s": step})
        variants.append(Variant(HISTORIES, f"with a row every {step:g} s", histories))
    return variants


def _without(campaign: Campaign, removed: tuple[str, ...], settings: dict[str, Any]) -> Campaign:
    """Return a campaign without the tables at the paths ``removed`` and their dispersions, and with
    ``settings``, values by path. Raises SceneError if the rest is not valid."""
    tree = copy.deepcopy(campaign.file.tree)
    for path in removed:
        node, *rest = tree, *path.split(".")
        for key in rest[:-1]:
            node = node.get(key, {})
        node.pop(rest[-1], None)
    prefixes = tuple(f"{path}." for path in removed)
    tree["dispersion"] = (
        {
            path: value
            for path, value in tree.get("dispersion", {}).items()
            if not path.startswith(prefixes)
        }
        if prefixes
        else tree.get("dispersion", {})
    )
    return Campaign(parse_campaign(tree, campaign.name, settings, campaign.name))
