"""How rarely a campaign violates a requirement: subset simulation over its dispersions, flown by
the kernel of the campaign."""

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
from sepmc.analysis.requirements import share_text
from sepmc.analysis.row_statistics import by_case
from sepmc.analysis.subset_simulation import Estimate, Level
from sepmc.campaign import cases
from sepmc.campaign.definition import Definition
from sepmc.campaign.execution.batch_summary import accuracy, accuracy_told
from sepmc.campaign.execution.chunks import implausible_note
from sepmc.campaign.execution.diagnostics import still_near, unmet, unsettled
from sepmc.campaign.execution.flight_log import FlightLog, interrupted
from sepmc.campaign.execution.integration import Flight, Say
from sepmc.campaign.execution.limit_state import LABELS, Flights, Seldom, Target, seldom, target
from sepmc.campaign.execution.missing_events import missing_notes
from sepmc.campaign.execution.step_selection import plan_flight
from sepmc.campaign.store import folders, manifests, shards
from sepmc.engine.dispatch import check_int
from sepmc.scene.limits import SEED
from sepmc.schema import Column, Status

MOST, _LEAST, _LIMIT = 100_000, 10_000, 10_000_000  # flights: unless others are asked for; allowed
_NEAR = 0.1  # of the probability, or between levels: so much within the numerical error is told
REPORT, TABLE = "rare.json", "rare.parquet"
_ABOUT = (
    Column("margin", "", "how far the outcome is within the bound; below zero beyond it"),
    Column("level", "1", "level that the case was flown for; 0: drawn from the laws"),
    Column("replica", "1", "replica that has it"),
    Column("weight", "1", "probability it stands for; of all that violate these add up to theirs"),
)


@dataclass(frozen=True, repr=False)
class Rare:
    """How rarely a requirement is violated.

    ``probability`` that a case violates it, with a 95 % ``interval``; ``unknown``, the probability
    that a case does not come to its end or lacks the outcome, so that it is not known whether it
    violates, and ``bounds``, the lower end if none of those does and the upper one if all do.
    ``replicas`` are the independent estimates whose mean it is, ``levels`` the way there, from
    cases of the laws to the bound; ``flights`` all cases flown. ``rows`` are the cases of the last
    level, by column, the worst first: those of margin below zero violate. ``inputs`` is what the
    violating ones have in common: mean and standard deviation of the normal score of each input (0
    and 1 of all cases).
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
            f"<Rare {self.requirement}: probability {self.probability:.2e}, 95 % {low:.1e} to "
            f"{high:.1e}, {self.flights} flights>"
        )

    def to_pandas(self) -> pd.DataFrame:
        """The cases of the last level, one a row, by their number."""
        return by_case(self.rows)

    def to_dict(self) -> dict[str, Any]:
        """What ``rare.json`` holds."""
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


def seek(
    campaign: Definition,
    name: str,
    most: int = MOST,
    seed: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    progress: Callable[[int, int, int], None] | None = None,
    announce: Say | None = None,
    resume: bool = False,
) -> Rare:
    """Estimate how rarely a requirement is violated, in so many flights at ``most``; into a folder
    that is open, if one is given, in which an interrupted estimate can be resumed."""
    aim, most = target(campaign, name), check_int("flights", most, _LEAST, _LIMIT)
    seed = campaign.scene.run.seed if seed is None else check_int("seed", seed, 0, SEED)
    begun, started = datetime.now(UTC), time.perf_counter()
    asked = _asked(campaign, aim, most, seed)
    earlier = _begin(campaign, folder, asked, resume) if folder else []
    if announce:
        announce(f"{campaign.name}: {aim.sentence}; at most {most} flights, seed {seed}")
    flight = plan_flight(campaign, announce=announce)
    compiled = time.perf_counter()
    tell = (lambda done, failed: progress(done, most, failed)) if progress else (lambda *_: None)
    log = _log(campaign, folder, aim, seed, resume) if folder else None
    flights = Flights(campaign, flight, aim, tell, announce, log)
    tell(0, 0)  # so that compiling does not count
    random = partial(_generator, seed)
    dimensions = len(campaign.file.dispersions)
    try:
        values = seldom(flights, random("seldom"))
        known, all_of, _ = subset_simulation.estimate(
            flights.margins, dimensions, random, most - flights.count
        )
    finally:
        if log:
            log.save()
    resumed = log.resumed if log else 0
    if log:
        log.remove()
    found = Rare(
        aim.requirement.name,
        aim.column.name,
        aim.column.unit,
        known.probability,
        known.interval,
        float(all_of.unknown.mean()),
        (known.interval[0], max(known.interval[1], all_of.interval_with_unknown[1])),
        tuple(known.known.tolist()),
        known.levels,
        flights.count,
        seed,
        _rows(campaign, known),
        _common(campaign, known),
        {label: flights.statuses[label] for label in LABELS if flights.statuses[label]},
        _notes(flights, known, all_of, values),
        folder,
    )
    if folder:
        times = {"compile": compiled - started, "kernel": time.perf_counter() - compiled}
        session = {
            "cases_flown": found.flights - resumed,
            "started": begun.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "timing_s": {k: round(v, 6) for k, v in times.items()},
            "threads": threads or os.cpu_count(),
            **manifests.versions(),
        }
        _write(folder, found, flights, asked, [*earlier, session])
    return found


def _asked(campaign: Definition, aim: Target, most: int, seed: int) -> dict[str, Any]:
    """What an estimate follows from, by the keys of its manifest."""
    item = msgspec.to_builtins(aim.requirement)
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": seed,
        "rare": {k: v for k, v in item.items() if v is not None},
        "flights_allowed": most,
    }


def _begin(
    campaign: Definition, folder: Path, asked: dict[str, Any], resume: bool
) -> list[dict[str, Any]]:
    """Write into an open folder what is estimated; returns the earlier sessions of an estimate that
    is resumed."""
    earlier: list[dict[str, Any]] = interrupted(folder, asked) if resume else []
    now = {"started": datetime.now(UTC).isoformat(timespec="seconds"), **manifests.versions()}
    manifest = {**asked, "complete": False, "sessions": [*earlier, now]}
    manifests.write_manifest(
        folder, manifest, shards.campaign_text(campaign.file, seed=asked["seed"])
    )
    return earlier


def _log(campaign: Definition, folder: Path, aim: Target, seed: int, resume: bool) -> FlightLog:
    inputs, about = len(campaign.input_columns), _about(campaign, seed, aim.requirement.name)
    return FlightLog(folder, inputs + 1 + len(campaign.result_columns), inputs, about, resume)


def _about(campaign: Definition, seed: int, requirement: str) -> dict[str, str]:
    """What files of an estimate say of it."""
    return {
        "campaign": campaign.name,
        "digest": campaign.digest,
        "seed": str(seed),
        "requirement": requirement,
    }


def _generator(seed: int, what: str) -> np.random.Generator:
    return cases.generator(seed, f"rare: {what}")


def columns(campaign: Definition, unit: str) -> list[Column]:
    """Columns of the cases that are kept, whose margin has this unit."""
    margin, *others = _ABOUT
    return [*campaign.columns, Column(margin.name, unit, margin.meaning), *others]


def _rows(campaign: Definition, found: Estimate) -> dict[str, np.ndarray]:
    """The different cases of the last level by column, the worst first."""
    used = found.weight > 0.0
    _, first, which = np.unique(found.last.number[used], return_index=True, return_inverse=True)
    places = np.flatnonzero(used)[first]
    weight = np.bincount(which, found.weight[used])
    order = np.argsort(found.last.margin[places], kind="stable")  # NaN last
    places, weight = places[order], weight[order]
    told, inputs = found.last.told[places], len(campaign.input_columns)
    labels = np.array(LABELS, dtype=object)[told[:, inputs].astype(int)]
    names = [c.name for c in campaign.input_columns], [c.name for c in campaign.result_columns]
    return {
        "case": np.arange(len(places)),
        "status": labels,
        **dict(zip(names[0], told[:, :inputs].T, strict=True)),
        **dict(zip(names[1], told[:, inputs + 1 :].T, strict=True)),
        "margin": found.last.margin[places],
        "level": found.last.level[places],
        "replica": found.replica[places],
        "weight": weight,
    }


def _common(campaign: Definition, found: Estimate) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the normal score of each input in the cases that violate, by
    column, those that differ most from all cases first (by their divergence from a standard normal
    law)."""
    weight = np.where(found.last.margin < 0.0, found.weight, 0.0)
    if not weight.sum():
        return {}
    scores = cases.mixed(found.last.scores, campaign.file.copulas)
    mean = np.average(scores, axis=0, weights=weight)
    sigma = np.sqrt(np.average((scores - mean) ** 2, axis=0, weights=weight))
    floor = np.maximum(sigma, 1e-9)
    order = np.argsort(-(mean**2 + floor**2 - 1.0 - 2.0 * np.log(floor)), kind="stable")
    names = [column.name for column in campaign.input_columns]
    return {names[k]: (float(mean[k]), float(sigma[k])) for k in order}


def _notes(flights: Flights, known: Estimate, all_of: Estimate, values: list[Seldom]) -> list[str]:
    """What a person should know of an estimate."""
    campaign, flight, tally, aim = flights.campaign, flights.flight, flights.tally, flights.aim
    told, fixed = accuracy(flight, tally), campaign.scene.solver.step is not None
    found = subset_simulation.remarks(known)
    found += [said for one in values if (said := one.missed(campaign, all_of))]
    ended = flights.statuses[Status.OK.label]
    if flights.lacking or ended < flights.count:
        metric = aim.requirement.metric
        of_ok = f" and {flights.lacking} others have no {metric}" if flights.lacking else ""
        unknown = float(all_of.unknown.mean())
        found.append(
            f"{flights.count - ended} of {flights.count} flown cases did not come to their end"
            f"{of_ok}: it is not known "
            "whether they violate, and they do not count as violations; probability of such cases "
            f"{share_text(unknown)}"
        )
    found += [
        f"{cases} flown cases are beyond the bound of {name}, {schema.AUDIT_BOUNDS[name]:g}: the "
        "audit failed"
        for name, cases in flights.beyond.items()
    ]
    plain = subset_simulation.plain_cases(known.probability, known.interval)
    if len(known.levels) > 1 and plain < flights.count:
        found.append(
            f"this is not rare: {plain:.0f} cases of a plain campaign tell it as well as these "
            f"{flights.count} flights"
        )
    broken = implausible_note(tally.implausible, flights.count)
    found += [broken] if broken else []
    found += [*unmet(told, fixed), *unsettled(tally.unsettled, tally.finer)]
    found += still_near(tally.least_at_the_end)
    found += missing_notes(campaign, tally.missing, flights.statuses[Status.OK.label])
    found += _near(flight, aim, told.errors.get(aim.column.name, np.nan), known)
    return found + [note for note in flight.notes if note not in found]


def _near(flight: Flight, aim: Target, share: float, found: Estimate) -> list[str]:
    """Whether the numerical error of the outcome, a share of its size, matters."""
    scale = 0.0 if flight.scale is None else float(flight.scale[aim.place]) * aim.column.scale
    error = share * max(aim.size, scale)
    if np.isnan(error):
        return [f"the numerical error of {aim.column.name} is not known"]
    said = []
    doubtful = float(found.weight[np.abs(found.last.margin) < error].sum())
    if doubtful > _NEAR * found.probability:
        said.append(
            f"cases nearer to the bound than the numerical error of {error:.1e} have a probability "
            f"of {share_text(doubtful)}: ask for a finer solver.accuracy"
        )
    thresholds = np.array([level.threshold for level in found.levels])
    if len(thresholds) > 1 and error > _NEAR * np.abs(np.diff(thresholds)).min():
        said.append(
            f"two levels lie about as near to each other as the numerical error of {error:.1e}, or "
            "the outcome is the same in many cases: which of them go on is round-off there, so the "
            "interval is wider than it could be"
        )
    return said


def _write(
    folder: Path,
    found: Rare,
    flights: Flights,
    asked: dict[str, Any],
    sessions: list[dict[str, Any]],
) -> None:
    """Write manifest, campaign, report and cases into an open folder."""
    campaign = flights.campaign
    manifest = {
        **asked,
        "flights": found.flights,
        "complete": True,
        "failures": flights.tally.failures,
        "audit_beyond": flights.beyond,
        "accuracy": accuracy_told(campaign, flights.flight, flights.tally),
        "notes": found.notes,
        "sessions": sessions,
    }
    manifests.write_manifest(folder, manifest, shards.campaign_text(campaign.file, seed=found.seed))
    about = _about(campaign, found.seed, found.requirement)
    of = columns(campaign, found.unit)
    shards.write_parquet(folder / TABLE, of, found.rows, about)
    folders.write_json(folder / REPORT, found.to_dict())
    manifests.note(folder, [folder / TABLE, folder / REPORT])
