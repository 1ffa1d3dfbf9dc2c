"""Error over time for every method, number of steps and formulation."""

from dataclasses import replace
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from sepmc.bench.clock import rounds
from sepmc.bench.reference import METHOD, Reference
from sepmc.bench.study import Study, Way
from sepmc.campaign.pilot import plan_flight
from sepmc.kernels.methods import METHODS
from sepmc.kernels.methods import method as make_method

ACCURACIES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)  # asked of the pilot, to get steps that a user might fly with
MULTIPLES = (0.5, 2.0, 4.0)  # of the steps the pilot chose by default
HALVINGS = {"dop853": (-1, 0, 1, 2, 3), "dopri5": (0, 1, 2, 3, 4), "rk4": (0, 1, 2, 3, 4)}  # of the base step, for the general kernel
PER = 10_000  # cases that times are told for
_MOST = 25  # times as many evaluations as by default are left out


def measure(study: Study, reference: Reference) -> pd.DataFrame:
    """One row a way to fly; times are medians, for 10,000 cases, ms; ``scaled`` if fewer than the study's were flown."""
    return rows_of(study, reference, own_ways(study, reference) + _general(study))


def own_ways(study: Study, reference: Reference) -> list[Way]:
    """Ways to fly with the scene's own kernel; not that of the reference."""
    return [way for way in _specialised(study) if (way.method, way.setting) != (METHOD, reference.setting)]


def rows_of(study: Study, reference: Reference, ways: list[Way]) -> pd.DataFrame:
    """Fly some ways and time them, in rounds; a row each."""
    blocks = [way.fly(study.draws) for way in ways]
    times = rounds({str(i): partial(way.fly, study.draws) for i, way in enumerate(ways)}, study.repeats)
    rows = []
    for i, (way, block) in enumerate(zip(ways, blocks, strict=True)):
        error, worst = study.error(block, reference.outcomes, reference.sound)
        rows.append(_row(way, times[str(i)], error, worst, way.cases < study.cases))
    return pd.DataFrame(rows)


def _row(way: Way, times: list[float], error: float, worst: str, few: bool) -> dict[str, Any]:
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
        "default": way.default,
    }


def _specialised(study: Study) -> list[Way]:
    """The scene's own kernel with each method: the steps that the pilot chooses for several accuracies, and multiples of the default."""
    if not study.specialised:
        return []
    ways: list[Way] = []
    for method in [study.method] if study.quick else sorted(METHODS, key=lambda m: METHODS[m]().order):
        own = study.with_settings({"solver.method": method})
        found: dict[tuple[int, ...], Way] = {}
        default = study.flight if method == study.method else plan_flight(own, announce=study.say)
        asked = study.campaign.scene.solver.accuracy
        flights = [(asked, default)]
        for accuracy in ACCURACIES[::4] if study.quick else ACCURACIES:
            if accuracy != asked:
                flights.append((accuracy, plan_flight(own.with_settings({"solver.accuracy": accuracy}))))
        if default.steps is not None:
            multiples = [np.maximum(1, np.round(k * default.steps)).astype(np.int64) for k in MULTIPLES]
            flights += [(np.nan, replace(default, steps=steps, limits=None, angles={})) for steps in multiples]
        for accuracy, flight in flights:
            if flight.steps is not None:
                is_default = flight is study.flight
                way = Way("specialised", method, flight, own, study.cases, accuracy, is_default)
                found.setdefault(tuple(flight.steps.tolist()), way)
        ways += sorted(found.values(), key=_evaluations)
    most = _MOST * _evaluations(next(way for way in ways if way.default))
    for way in ways:
        if _evaluations(way) > most:
            study.say(f"left out, more than {_MOST} times the work of the default: {way.method}, {way.setting}")
    return [way for way in ways if _evaluations(way) <= most]


def _evaluations(way: Way) -> int:
    """About how many a case takes."""
    steps = 0 if way.flight.steps is None else int(way.flight.steps.sum())
    return steps * len(make_method(way.method).b)


def _general(study: Study) -> list[Way]:
    """The general kernel, reduced and full, with each method at several steps, by a part of the cases."""
    ways = []
    fixed = study.campaign.scene.solver.formulation
    for formulation in ("reduced", "full"):
        few = study.few if formulation == "reduced" else max(min(study.few, 16), study.few // 4)
        for method in [study.method] if study.quick else ("rk4", "dopri5", "dop853"):
            own = study.with_settings({"solver.method": method, "solver.formulation": formulation})
            for halvings in HALVINGS[method][1:3] if study.quick else HALVINGS[method]:
                flight = replace(study.general, step=study.base_step * 0.5**halvings)
                default = not study.specialised and halvings == 0 and (method, formulation) == (study.method, fixed)
                ways.append(Way(formulation, method, flight, own, few, np.nan, default))
    return ways
