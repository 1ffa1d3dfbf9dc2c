"""Checks on the case of the paper, table2.toml: the engine (constraint force equations) against
Lagrange's equations of the joined pair and Newton's and Euler's of the free bodies."""

from functools import cache
from typing import Any

import numpy as np

from sepmc.campaign.campaign import load
from sepmc.scene.messages import no_log
from sepmc.validation import lagrange
from sepmc.validation.checks.kinds import largest_difference
from sepmc.validation.flights import NominalRun, run_interpreted
from sepmc.validation.line import Line

FINE: dict[str, Any] = {"solver.step_s": 0.01, "run.history_step_s": 0.0}
# met by step selection
ACCURATE: dict[str, Any] = {"solver.accuracy": 1e-11, "run.history_step_s": 0.0}
LOCKED = [{"name": "locked", "joints": {"pins": "fixed"}}]
# A run that ends within each phase, and the formulation it is compared with.
PHASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("locked", "Lagrange", {"run.end_time_s": 0.04, "phase": LOCKED}),
    ("guided", "Lagrange", {"run.end_time_s": 0.2}),
    ("free", "Newton-Euler", {"run.end_time_s": 0.5}),
)
CASES = range(4)


@cache
def _table() -> dict[str, np.ndarray]:
    """Case table (inputs, status, outcomes and audit) of the first 200 cases of table2.toml, by
    column name, (200,) each: compiled code, steps of 10 ms; cached."""
    return load("table2.toml", FINE).run(cases=200, announce=no_log).table


def _deviations() -> dict[str, float]:
    """Standard deviation of every float column over the cases of `_table`, by name and in its unit:
    the scale of differences."""
    return {
        name: float(np.std(column, ddof=1))
        for name, column in _table().items()
        if column.dtype == float
    }


def phases() -> list[Line]:
    """Check the nominal case, ended within each phase (locked, guided, free), against
    `sepmc.validation.lagrange`: all outcomes that this computes, in one line, and the force and the
    moment of the joint at the end (0 once it is free), relative to their magnitude (at least 1 N,
    1 N m)."""
    lines = []
    for phase, formulation, settings in PHASES:
        base = load("table2.toml", FINE | settings)
        values, expected, case = (
            NominalRun(base),
            lagrange.simulate(base.nominal().to_dict()),
            f"Table 2, {phase}: {formulation}",
        )
        outcomes = {
            name: value
            for name, value in expected.items()
            if name in values.outcomes and np.isfinite(value)
        }
        lines.append(largest_difference(case, values.outcomes, outcomes, _deviations()))
        for wrench, unit in (("force", "N"), ("moment", "N_m")):
            reference = expected[f"end_{wrench}_on_lower_{unit}"]
            size = {wrench: max(float(np.linalg.norm(reference)), 1.0)}
            measured = values.columns(f"pins_{wrench}_on_lower_*_{unit}")[-1]
            lines.append(largest_difference(case, {wrench: measured}, {wrench: reference}, size))
    return lines


def cases() -> list[Line]:
    """Check the outcomes of the first four dispersed cases against `sepmc.validation.lagrange`, in
    two lines each: compiled in steps of 10 ms, and as plain Python in steps selected for an
    accuracy of 1e-11."""
    base, lines = load("table2.toml", FINE), []
    tables = {
        "steps of 10 ms": _table(),
        "accuracy 1e-11": run_interpreted(load("table2.toml", ACCURATE), len(CASES)).table,
    }
    for number in CASES:
        expected = lagrange.simulate(base.case(number).to_dict())
        for label, table in tables.items():
            values = {name: column[number] for name, column in table.items()}
            outcomes = {name: value for name, value in expected.items() if name in values}
            lines.append(
                largest_difference(
                    f"Table 2, case {number}, {label}", values, outcomes, _deviations()
                )
            )
    return lines
