"""All outcomes compared with independent simulations: scenes of `sepmc verify`, interpreted, and
shipped campaigns."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from oracles import independent
from sepmc.campaign.campaign import Campaign, load
from sepmc.campaign.execution.accuracy import errors
from sepmc.engine.dispatch import interpreted
from sepmc.scene.messages import no_log
from sepmc.validation.flights import SCENES, SIZES, NominalRun, campaign
from sepmc.validation.line import CLOSE, Line

# Cases of the shipped campaigns; an independent simulation of srb or hyper-x takes seconds.
CAMPAIGNS = {
    "table1": 1, "table2": 5, "nasa-fixed-joint": 2, "spring-pushers": 5, "missile-rail": 5,
    "residual-thrust": 5, "srb": 2, "hyper-x": 2, "store": 5, "fairing": 1, "lightband": 5,
    "controlled-stage": 1,
}  # fmt: skip
# the reported error, a difference to twice the resolution, must be at least a third of the true one
REPORTED = 3.0
# the joint load is constant (to 2e-14 of the force): round-off decides on the time of its peak
CONSTANT = ("spring-pushers",)


@cache
def _scenes() -> dict[str, Campaign]:
    """Campaigns of the scenes of `sepmc verify`, by name."""
    return {path.stem: campaign(path.stem) for path in sorted(SCENES.glob("*.toml"))}


def _simulate(case: Mapping[str, Any]) -> independent.CaseResult:
    """Independent simulation of a case, without clearances."""
    return independent.simulate({key: value for key, value in case.items() if key != "clearance"})


def _difference(unit: str, value: float, expected: float) -> float:
    """Difference of two values; of angles, modulo full turns: at alpha = 180 deg round-off decides
    on the sign."""
    return (value - expected + 180.0) % 360.0 - 180.0 if unit == "deg" else value - expected


def scenes() -> list[Line]:
    """Nominal case of every scene: the outcome with the largest difference, relative to the largest
    value of its unit or to `SIZES`."""
    lines = []
    for name, case_campaign in _scenes().items():
        expected, units = (
            _simulate(case_campaign.nominal().to_dict()),
            {c.name: c.unit for c in case_campaign.outcome_columns},
        )
        expected_values = {
            column: value
            for column, value in expected.outcomes.items()
            if np.isfinite(value) and column not in expected.indeterminate
        }
        sizes = dict(SIZES)
        for column, value in expected_values.items():
            sizes[units[column]] = max(sizes[units[column]], abs(value))
        nominal = NominalRun(case_campaign, case_campaign.scene.run.end_time)
        differences = {
            c: abs(_difference(units[c], nominal.outcomes[c], value)) / sizes[units[c]]
            for c, value in expected_values.items()
        }
        column = max(
            differences, key=lambda c: np.inf if np.isnan(differences[c]) else differences[c]
        )
        status_difference = 0.0 if nominal.status == expected.status else np.inf
        lines.append(
            Line(
                f"scene {name}",
                f"difference, {column}",
                0.0,
                max(differences[column], status_difference),
                CLOSE,
            )
        )
    return lines


def campaigns() -> list[Line]:
    """Some cases of every shipped campaign: status, and the outcome with the largest difference
    relative to the reported error."""
    return [line for name, cases in CAMPAIGNS.items() for line in _campaign(name, cases)]


def _campaign(name: str, cases: int) -> list[Line]:
    """Lines of one shipped campaign."""
    shipped = load(f"{name}.toml")
    with interpreted(False):
        result = shipped.run(cases=cases, announce=no_log)
    assert result.integration is not None
    assert result.accuracy is not None
    scale = result.integration.scale  # the reported error is relative to it
    assert scale is not None
    expected = [_simulate(shipped.case(number).to_dict()) for number in range(cases)]
    differing = sum(
        status != row.status for status, row in zip(result.table["status"], expected, strict=True)
    )
    lines = [
        Line(
            f"{name}, as shipped", f"status of {cases} cases, differing", 0.0, float(differing), 0.0
        )
    ]
    indeterminate = {column for row in expected for column in row.indeterminate}
    known = [
        c
        for c in shipped.outcome_columns
        if c.name in expected[0].outcomes and c.name not in indeterminate
    ]
    columns = [c for c in known if not (name in CONSTANT and "_peak_" in c.name and c.unit == "s")]
    for prefix, chosen in (
        ("", [c for c in columns if "_impulse_" not in c.name]),
        ("of impulses, ", [c for c in columns if "_impulse_" in c.name]),
    ):
        if chosen:
            values = np.array([result.table[c.name] / c.scale for c in chosen]).T
            references = np.array(
                [[row.outcomes[c.name] / c.scale for c in chosen] for row in expected]
            )
            differences = errors(
                values, references, scale[[shipped.outcome_columns.index(c) for c in chosen]]
            ).max(axis=0)
            allowed = np.array([REPORTED * result.accuracy.errors[c.name] + CLOSE for c in chosen])
            worst = int(np.argmax(np.where(np.isnan(differences), np.inf, differences) / allowed))
            quantity = f"{prefix or 'difference, '}{chosen[worst].name}"
            lines.append(
                Line(
                    f"{name}, as shipped",
                    quantity,
                    0.0,
                    float(differences[worst]),
                    float(allowed[worst]),
                )
            )
    return lines
