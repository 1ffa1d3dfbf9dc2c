"""Estimate of the small probability that a requirement is violated, by subset simulation."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from sepmc import schema
from sepmc.analysis import subset_simulation
from sepmc.analysis.requirements_text import format_proportion
from sepmc.analysis.row_statistics import index_by_case
from sepmc.analysis.subset_simulation import Estimate, Level
from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import accuracy, accuracy_entries
from sepmc.campaign.execution.diagnostics import accuracy_notes, min_at_end_notes, unconverged_notes
from sepmc.campaign.execution.flight_log import FlightLog, interrupted
from sepmc.campaign.execution.integration import Integration
from sepmc.campaign.execution.limit_state import (
    LimitState,
    MarginEvaluator,
    RareValue,
    limit_state,
    rare_discrete_values,
)
from sepmc.campaign.execution.missing_events import missing_notes
from sepmc.campaign.execution.runner import implausible_note
from sepmc.campaign.execution.sinks import status_labels
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.campaign.store import folders, manifests, shards
from sepmc.engine.dispatch import check_int
from sepmc.scene.limits import SEED
from sepmc.scene.messages import Log
from sepmc.schema import STATUS_LABELS, Column, Status

DEFAULT_FLIGHTS, _MIN_FLIGHTS, _MAX_FLIGHTS = 100_000, 10_000, 10_000_000
_NEAR = 0.1  # share of the probability within the numerical error of the bound that is reported
REPORT, TABLE = "rare.json", "rare.parquet"
_OWN_COLUMNS = (
    Column("margin", "", "how far the outcome is within the bound; below zero beyond it"),
    Column("level", "1", "level that the case was run for; 0: sampled from the distributions"),
    Column("replica", "1", "replica (independent estimate) that the case belongs to"),
    Column(
        "weight",
        "1",
        "probability that the case stands for; its sum over violating cases is the estimate",
    ),
)


@dataclass(frozen=True, repr=False)
class RareEventEstimate:
    """Estimated probability that a case violates a requirement, and the cases it rests on.

    Subset simulation goes through levels: each needs a smaller margin (distance from the bound),
    down to 0 at the last level.

    Attributes
    ----------
    requirement, metric, unit : str
        Name of the requirement; outcome that its margin is computed from; unit of the margin.
    probability : float
        Estimated probability: the mean of ``replicas``.
    interval : (float, float)
        95 % confidence interval of the probability.
    unknown : float
        Probability that a case is not ok (see ``statuses``) or does not have the outcome.
    bounds : (float, float)
        Low end of the interval if no unknown case violates, and high end if all of them do.
    replicas : tuple of float
        Independent estimates of the probability.
    levels : tuple of Level
        Levels in order, from the distributions of the inputs to the bound.
    flights : int
        Number of cases run.
    seed : int
        Random seed.
    rows : dict of str to ndarray
        Cases of the last level by column, the smallest margin first.
    inputs : dict of str to (float, float)
        By input: mean and standard deviation, over violating cases, of its normal score, which has
        mean 0 and deviation 1 over all cases.
    statuses : dict of str to int
        Number of cases by status label.
    notes : list of str
        Notes on the estimate for the user.
    folder : Path or None
        Run folder with the results; None if they were not written.
    """

    requirement: str
    metric: str
    unit: str
    probability: float
    interval: tuple[float, float]
    unknown: float
    bounds: tuple[float, float]
    replicas: tuple[float, ...]
    levels: tuple[Level, ...]
    flights: int
    seed: int
    rows: dict[str, np.ndarray]
    inputs: dict[str, tuple[float, float]]
    statuses: dict[str, int]
    notes: list[str] = field(default_factory=list)
    folder: Path | None = None

    def __repr__(self) -> str:
        low, high = self.interval
        return (
            f"<RareEventEstimate {self.requirement}: probability {self.probability:.2e}, "
            f"95 % {low:.1e} to {high:.1e}, {self.flights} cases>"
        )

    def to_pandas(self) -> pd.DataFrame:
        """Cases of the last level as a table.

        Returns
        -------
        DataFrame
            A row per case, indexed by a case number that counts from the smallest margin (0):
            case, status, inputs, outcomes, audit columns, margin, level, replica and weight.
        """
        return index_by_case(self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Contents of ``rare.json``: the estimate without the rows of cases.

        Returns
        -------
        dict
            Nested data of JSON types.
        """
        violate = int(np.count_nonzero(self.rows["margin"] < 0.0))
        return {
            "requirement": self.requirement,
            "margin_of": self.metric,
            "unit": self.unit,
            "probability": self.probability,
            "interval": list(self.interval),
            "unknown": self.unknown,
            "interval_with_unknown": list(self.bounds),
            "flights": self.flights,
            "seed": self.seed,
            "replicas": list(self.replicas),
            "levels": [
                {
                    "threshold": level.threshold,
                    "probability": level.probability,
                    "reached": level.reached,
                    "acceptance": level.acceptance,
                    "seeds": level.seeds,
                    "replicas": level.replicas.tolist(),
                }
                for level in self.levels
            ],
            "statuses": self.statuses,
            "cases_kept": len(self.rows["case"]),
            "violating_cases_kept": violate,
            "inputs": {name: {"mean": m, "sigma": s} for name, (m, s) in self.inputs.items()},
            "notes": self.notes,
        }


def estimate_rare_event(
    campaign: Definition,
    name: str,
    max_cases: int = DEFAULT_FLIGHTS,
    seed: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    progress: Callable[[int, int, int], None] | None = None,
    announce: Log | None = None,
    resume: bool = False,
) -> RareEventEstimate:
    """Estimate the probability that a requirement is violated, by subset simulation.

    With a ``folder``, cases are logged while they are run, and results are written at the end.

    Parameters
    ----------
    campaign : Definition
    name : str
        Name of the requirement.
    max_cases : int
        Maximum number of cases to run, 1e4 to 1e7.
    seed : int, optional
        Random seed; that of the file if None.
    threads : int, optional
        Number of threads to state in the manifest; the number of cores if None. It is not set here.
    folder : Path, optional
        Run folder for the results, open for writing.
    progress : callable, optional
        Called after each batch with the number of cases done, ``max_cases`` and the number of
        failed cases.
    announce : Log, optional
        Called with messages on the estimate and on compiling.
    resume : bool
        True: continue the interrupted estimate in the folder.

    Returns
    -------
    RareEventEstimate

    Raises
    ------
    InputError
        If the violation of the requirement has no margin (`limit_state`), or a number is out of
        range.
    StoreError
        If ``resume`` is True and the folder contains something else than this estimate,
        interrupted, or if the folder cannot be written.
    """
    limit, max_cases = (
        limit_state(campaign, name),
        check_int("cases", max_cases, _MIN_FLIGHTS, _MAX_FLIGHTS),
    )
    seed = campaign.scene.run.seed if seed is None else check_int("seed", seed, 0, SEED)
    started, times = datetime.now(UTC), dict.fromkeys(("text", "compile", "steps", "kernel"), 0.0)
    request = _request(campaign, limit, max_cases, seed)
    previous_sessions = _begin(campaign, folder, request, resume) if folder else []
    if announce:
        announce(f"{campaign.name}: {limit.sentence}; at most {max_cases} cases, seed {seed}")
    integration = select_steps(campaign, announce=announce, timing=times)
    start_s = time.perf_counter()
    report = (
        (lambda done, failed: progress(done, max_cases, failed)) if progress else (lambda *_: None)
    )
    log = _open_log(campaign, folder, limit, seed, resume) if folder else None
    evaluator = MarginEvaluator(campaign, integration, limit, report, announce, log)
    report(0, 0)  # so that compiling does not count
    random = partial(_generator, seed)
    dimensions = len(campaign.file.dispersions)
    try:
        rare_values = rare_discrete_values(evaluator, random("seldom"))
        known, of_all, _ = subset_simulation.estimate(
            evaluator.margins, dimensions, random, max_cases - evaluator.count
        )
    finally:
        if log:
            log.save()
    resumed = log.resumed if log else 0
    if log:
        log.remove()
    result = RareEventEstimate(
        limit.requirement.name,
        limit.column.name,
        limit.column.unit,
        known.probability,
        known.interval,
        float(of_all.unknown.mean()),
        (known.interval[0], max(known.interval[1], of_all.interval_with_unknown[1])),
        tuple(known.known.tolist()),
        known.levels,
        evaluator.count,
        seed,
        _rows(campaign, known),
        _violating_inputs(campaign, known),
        {label: evaluator.statuses[label] for label in STATUS_LABELS if evaluator.statuses[label]},
        _notes(evaluator, known, of_all, rare_values),
        folder,
    )
    if folder:
        times["kernel"] = time.perf_counter() - start_s
        session = {
            "cases_flown": result.flights - resumed,
            "started": started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in times.items()},
            "threads": threads or os.cpu_count(),
            **manifests.versions(),
        }
        _write(folder, result, evaluator, request, [*previous_sessions, session])
    return result


def _request(campaign: Definition, limit: LimitState, max_cases: int, seed: int) -> dict[str, Any]:
    """Manifest entries, by key, that determine an estimate: the campaign, the requirement of
    ``limit``, ``seed`` and ``max_cases``. An interrupted estimate can be resumed only by one with
    equal entries."""
    item = msgspec.to_builtins(limit.requirement)
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": seed,
        "rare": {k: v for k, v in item.items() if v is not None},
        "flights_allowed": max_cases,
    }


def _begin(
    campaign: Definition, folder: Path, request: dict[str, Any], resume: bool
) -> list[dict[str, Any]]:
    """Write the manifest of an estimate into its run folder when it begins; return its earlier
    sessions, the manifest entries of the commands that ran a resumed estimate before (empty if it
    is new). ``request`` are the entries from `_request`. If ``resume`` is True, raises StoreError
    if the folder contains another estimate or run, or a complete one."""
    previous_sessions: list[dict[str, Any]] = interrupted(folder, request) if resume else []
    session = {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        **manifests.versions(),
    }
    manifest = {**request, "complete": False, "sessions": [*previous_sessions, session]}
    manifests.write_manifest(
        folder, manifest, shards.campaign_text(campaign.file, seed=request["seed"])
    )
    return previous_sessions


def _open_log(
    campaign: Definition, folder: Path, limit: LimitState, seed: int, resume: bool
) -> FlightLog:
    inputs, about = len(campaign.input_columns), _about(campaign, seed, limit.requirement.name)
    return FlightLog(folder, inputs + 1 + len(campaign.result_columns), inputs, about, resume)


def _about(campaign: Definition, seed: int, requirement: str) -> dict[str, str]:
    """Metadata that each Parquet file of an estimate contains, by key: the name of the campaign,
    its digest, the seed, and the name of the requirement."""
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": str(seed),
        "requirement": requirement,
    }


def _generator(seed: int, what: str) -> np.random.Generator:
    return cases.generator(seed, f"rare: {what}")


def table_columns(campaign: Definition, unit: str) -> list[Column]:
    """Columns of ``rare.parquet``: those of the case table, then margin, level, replica and weight;
    ``unit`` is that of the margin."""
    margin, *others = _OWN_COLUMNS
    return [*campaign.columns, Column(margin.name, unit, margin.meaning), *others]


def _rows(campaign: Definition, estimate: Estimate) -> dict[str, np.ndarray]:
    """Distinct cases of the last level, values (n,) by column of `table_columns`, the smallest
    margin first; cases without weight are left out. Column ``case`` numbers them from 0 in this
    order. A case that the chains visit several times is one row, with the sum of the weights."""
    used = estimate.weight > 0.0
    _, first, which = np.unique(estimate.last.number[used], return_index=True, return_inverse=True)
    positions = np.flatnonzero(used)[first]
    weight = np.bincount(which, estimate.weight[used])
    order = np.argsort(estimate.last.margin[positions], kind="stable")  # NaN last
    positions, weight = positions[order], weight[order]
    rows, inputs = estimate.last.records[positions], len(campaign.input_columns)
    labels = status_labels(rows[:, inputs].astype(int))
    names = [c.name for c in campaign.input_columns], [c.name for c in campaign.result_columns]
    return {
        "case": np.arange(len(positions)),
        "status": labels,
        **dict(zip(names[0], rows[:, :inputs].T, strict=True)),
        **dict(zip(names[1], rows[:, inputs + 1 :].T, strict=True)),
        "margin": estimate.last.margin[positions],
        "level": estimate.last.level[positions],
        "replica": estimate.replica[positions],
        "weight": weight,
    }


def _violating_inputs(campaign: Definition, estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the normal score of each input over the violating cases of the
    last level, weighted, by input column; empty if no case violates.

    The inputs are sorted by how far these differ from 0 and 1, the most different first.
    """
    weight = np.where(estimate.last.margin < 0.0, estimate.weight, 0.0)
    if not weight.sum():
        return {}
    scores = cases.correlated_scores(estimate.last.scores, campaign.file.copulas)
    mean = np.average(scores, axis=0, weights=weight)
    sigma = np.sqrt(np.average((scores - mean) ** 2, axis=0, weights=weight))
    floor = np.maximum(sigma, 1e-9)
    order = np.argsort(-(mean**2 + floor**2 - 1.0 - 2.0 * np.log(floor)), kind="stable")
    names = [column.name for column in campaign.input_columns]
    return {names[k]: (float(mean[k]), float(sigma[k])) for k in order}


def _notes(
    evaluator: MarginEvaluator, known: Estimate, of_all: Estimate, rare_values: list[RareValue]
) -> list[str]:
    """Notes on an estimate for the user, as sentences: on its levels and rare values, cases of
    which it is not known whether they violate, failed audits, a probability that is not small, the
    inertias, the numerical error, the clearances and missing events.

    ``evaluator`` has run all cases and counted them. ``known`` is the estimate for violating cases,
    ``of_all`` that for these and the cases without a margin; ``rare_values`` are from
    `rare_discrete_values`.
    """
    campaign, integration, summary, limit = (
        evaluator.campaign,
        evaluator.integration,
        evaluator.summary,
        evaluator.limit_state,
    )
    achieved, fixed = accuracy(integration, summary), campaign.scene.solver.step is not None
    notes = subset_simulation.estimate_warnings(known)
    notes += [note for value in rare_values if (note := value.note(campaign, of_all))]
    ended = evaluator.statuses[Status.OK.label]
    if evaluator.n_without_outcome or ended < evaluator.count:
        metric = limit.requirement.metric
        of_ok = (
            f", and {evaluator.n_without_outcome} others have no {metric}"
            if evaluator.n_without_outcome
            else ""
        )
        unknown = float(of_all.unknown.mean())
        notes.append(
            f"{evaluator.count - ended} of {evaluator.count} cases did not end with status ok"
            f"{of_ok}: it is not known "
            "whether they violate, and they do not count as violations; the probability of a case "
            f"of this kind is {format_proportion(unknown)}"
        )
    notes += [
        f"{cases} cases are beyond the bound of column {name}, {schema.AUDIT_BOUNDS[name]:g}: the "
        "audit failed"
        for name, cases in evaluator.beyond_bounds.items()
    ]
    plain = subset_simulation.equivalent_direct_cases(known.probability, known.interval)
    if len(known.levels) > 1 and plain < evaluator.count:
        notes.append(
            f"this is not rare: {plain:.0f} random cases of a plain campaign estimate the "
            f"probability as well as these {evaluator.count} do"
        )
    broken = implausible_note(summary.implausible, evaluator.count)
    notes += [broken] if broken else []
    notes += [
        *accuracy_notes(achieved, fixed),
        *unconverged_notes(summary.unconverged, summary.refined),
    ]
    notes += min_at_end_notes(summary.min_at_end)
    notes += missing_notes(campaign, summary.missing, evaluator.statuses[Status.OK.label])
    notes += _error_notes(integration, limit, achieved.errors.get(limit.column.name, np.nan), known)
    return notes + [note for note in integration.notes if note not in notes]


def _error_notes(
    integration: Integration, limit: LimitState, relative_error: float, estimate: Estimate
) -> list[str]:
    """Notes for the user if the numerical error of the outcome is unknown, or too large. It is too
    large if the cases nearer to the bound than the error have more than a tenth of the
    probability, or if two levels lie nearer to each other than ten times the error. Empty if
    neither.

    ``relative_error`` is the error of the outcome relative to the larger of its scale
    (``integration.scale``) and the absolute value of the bound; NaN if unknown.
    """
    scale = (
        0.0
        if integration.scale is None
        else float(integration.scale[limit.index]) * limit.column.scale
    )
    error = relative_error * max(limit.size, scale)
    if np.isnan(error):
        return [f"the numerical error of {limit.column.name} is not known"]
    texts = []
    doubtful = float(estimate.weight[np.abs(estimate.last.margin) < error].sum())
    if doubtful > _NEAR * estimate.probability:
        texts.append(
            f"cases nearer to the bound than the numerical error of {error:.1e} have a probability "
            f"of {format_proportion(doubtful)}: request a smaller solver.accuracy"
        )
    thresholds = np.array([level.threshold for level in estimate.levels])
    if len(thresholds) > 1 and error > _NEAR * np.abs(np.diff(thresholds)).min():
        texts.append(
            f"two levels lie about as near to each other as the numerical error of {error:.1e}, or "
            "the outcome is the same in many cases: round-off decides which cases belong to a "
            "level, so the interval is wider than it could be"
        )
    return texts


def _write(
    folder: Path,
    result: RareEventEstimate,
    evaluator: MarginEvaluator,
    request: dict[str, Any],
    sessions: list[dict[str, Any]],
) -> None:
    """Write the results of a complete estimate into its open run folder: manifest, campaign text,
    ``rare.parquet`` (cases) and ``rare.json`` (report). ``evaluator`` ran the cases; ``request``
    (from `_request`) and ``sessions`` are entries of the manifest."""
    campaign = evaluator.campaign
    manifest = {
        **request,
        "flights": result.flights,
        "complete": True,
        "failures": evaluator.summary.failures,
        "audit_beyond": evaluator.beyond_bounds,
        "accuracy": accuracy_entries(campaign, evaluator.integration, evaluator.summary),
        "notes": result.notes,
        "sessions": sessions,
    }
    manifests.write_manifest(
        folder, manifest, shards.campaign_text(campaign.file, seed=result.seed)
    )
    about = _about(campaign, result.seed, result.requirement)
    columns = table_columns(campaign, result.unit)
    shards.write_parquet(folder / TABLE, columns, result.rows, about)
    folders.write_json(folder / REPORT, result.to_dict())
    manifests.record_derived(folder, [folder / TABLE, folder / REPORT])
