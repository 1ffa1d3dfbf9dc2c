"""The paper's case: the constraint force equations against Lagrange's and Newton and Euler's on
Table 2, phase by phase."""

from functools import cache
from typing import Any

import numpy as np

from sepmc.campaign.campaign import load
from sepmc.scene.messages import no_log
from sepmc.validation import lagrange
from sepmc.validation.checks.kinds import furthest
from sepmc.validation.flights import NominalFlight, run_plainly
from sepmc.validation.line import Line

FINE: dict[str, Any] = {"solver.step_s": 0.01, "run.history_step_s": 0.0}
# which the pilot keeps by its own choice of steps
SHARP: dict[str, Any] = {"solver.accuracy": 1e-11, "run.history_step_s": 0.0}
LOCKED = [{"name": "locked", "joints": {"pins": "fixed"}}]
# A flight that ends within each phase, and the formulation it is held against.
PHASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("locked", "Lagrange", {"run.end_time_s": 0.04, "phase": LOCKED}),
    ("guided", "Lagrange", {"run.end_time_s": 0.2}),
    ("free", "Newton-Euler", {"run.end_time_s": 0.5}),
)
CASES = range(4)


@cache
def _drawn() -> dict[str, np.ndarray]:
    return load("table2.toml", FINE).run(cases=200, announce=no_log).table


def _scatter() -> dict[str, float]:
    """What counts as large of each outcome: its standard deviation over the campaign."""
    return {
        name: float(np.std(column, ddof=1))
        for name, column in _drawn().items()
        if column.dtype == float
    }


def phases() -> list[Line]:
    """The nominal case ended within each phase: every outcome, and while the joint holds its
    reaction, relative to its magnitude."""
    lines = []
    for phase, formulation, settings in PHASES:
        flown = load("table2.toml", FINE | settings)
        found, expected, case = (
            NominalFlight(flown),
            lagrange.fly(flown.nominal().to_dict()),
            f"Table 2, {phase}: {formulation}",
        )
        outcomes = {
            name: value
            for name, value in expected.items()
            if name in found.outcomes and np.isfinite(value)
        }
        lines.append(furthest(case, found.outcomes, outcomes, _scatter()))
        for what, unit in (("force", "N"), ("moment", "N_m")):
            should, size = (
                expected[f"end_{what}_on_lower_{unit}"],
                {what: max(float(np.linalg.norm(expected[f"end_{what}_on_lower_{unit}"])), 1.0)},
            )
            ours = found.columns(f"pins_{what}_on_lower_*_{unit}")[-1]
            lines.append(furthest(case, {what: ours}, {what: should}, size))
    return lines


def cases() -> list[Line]:
    """Dispersed cases, every outcome at the end: compiled in steps of 10 ms, and as plain Python in
    those that the pilot finds."""
    flown, lines = load("table2.toml", FINE), []
    tables = {
        "steps of 10 ms": _drawn(),
        "accuracy 1e-11": run_plainly(load("table2.toml", SHARP), len(CASES)).table,
    }
    for number in CASES:
        expected = lagrange.fly(flown.case(number).to_dict())
        for how, table in tables.items():
            found = {name: column[number] for name, column in table.items()}
            outcomes = {name: value for name, value in expected.items() if name in found}
            lines.append(furthest(f"Table 2, case {number}, {how}", found, outcomes, _scatter()))
    return lines
