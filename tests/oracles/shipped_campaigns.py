"""Every outcome against the independent flight: of the scenes of this folder as plain Python, and
of shipped campaigns as shipped."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from oracles import independent
from sepmc.campaign.campaign import Campaign, load
from sepmc.campaign.execution.accuracy import errors
from sepmc.engine.dispatch import interpreted
from sepmc.scene.messages import nobody
from sepmc.validation.flights import SCENES, SIZES, NominalFlight, campaign
from sepmc.validation.line import CLOSE, Line

# Cases of the shipped campaigns; the independent flight of a case of srb or hyper-x takes seconds.
CAMPAIGNS = {
    "table1": 1, "table2": 5, "nasa-fixed-joint": 2, "spring-pushers": 5, "missile-rail": 5,
    "residual-thrust": 5, "srb": 2, "hyper-x": 2,
}  # fmt: skip
# the error told is the difference to a flight at twice the resolution: it must not be less than a
# third of the true one
REPORTED = 3.0
# the load of the joint does not change (to 2e-14 of the force): round-off decides when its peak is
CONSTANT = ("spring-pushers",)


@cache
def _scenes() -> dict[str, Campaign]:
    return {path.stem: campaign(path.stem) for path in sorted(SCENES.glob("*.toml"))}


def _fly(case: Mapping[str, Any]) -> independent.CaseResult:
    """The independent flight, which knows no clearances."""
    return independent.simulate({key: value for key, value in case.items() if key != "clearance"})


def _difference(unit: str, found: float, expected: float) -> float:
    """Of angles, whole turns apart from each other are one: at alpha = 180 deg round-off decides
    between the signs."""
    return (found - expected + 180.0) % 360.0 - 180.0 if unit == "deg" else found - expected


def scenes() -> list[Line]:
    """The nominal case of every scene: the outcome that differs most, relative to the largest of
    its unit, or to what counts as large."""
    lines = []
    for name, flown in _scenes().items():
        expected, units = (
            _fly(flown.nominal().to_dict()),
            {c.name: c.unit for c in flown.outcome_columns},
        )
        known = {
            column: value
            for column, value in expected.outcomes.items()
            if np.isfinite(value) and column not in expected.indeterminate
        }
        size = dict(SIZES)
        for column, value in known.items():
            size[units[column]] = max(size[units[column]], abs(value))
        found = NominalFlight(flown, flown.scene.run.end_time)
        off = {
            c: abs(_difference(units[c], found.outcomes[c], value)) / size[units[c]]
            for c, value in known.items()
        }
        column = max(off, key=lambda c: np.inf if np.isnan(off[c]) else off[c])
        said = 0.0 if found.status == expected.status else np.inf
        lines.append(
            Line(f"scene {name}", f"difference, {column}", 0.0, max(off[column], said), CLOSE)
        )
    return lines


def campaigns() -> list[Line]:
    """A few cases of every shipped campaign, as shipped: status, and the outcome that exceeds most
    what the run says of its error."""
    return [line for name, cases in CAMPAIGNS.items() for line in _campaign(name, cases)]


def _campaign(name: str, cases: int) -> list[Line]:
    flown = load(f"{name}.toml")
    with interpreted(False):
        result = flown.run(cases=cases, announce=nobody)
    assert result.flight is not None
    assert result.accuracy is not None
    scale = result.flight.scale  # what the error that is told is a share of
    assert scale is not None
    expected = [_fly(flown.case(number).to_dict()) for number in range(cases)]
    apart = sum(
        status != row.status for status, row in zip(result.table["status"], expected, strict=True)
    )
    lines = [
        Line(f"{name}, as shipped", f"status of {cases} cases, differing", 0.0, float(apart), 0.0)
    ]
    vague = {column for row in expected for column in row.indeterminate}
    known = [
        c for c in flown.outcome_columns if c.name in expected[0].outcomes and c.name not in vague
    ]
    columns = [c for c in known if not (name in CONSTANT and "_peak_" in c.name and c.unit == "s")]
    for what, chosen in (
        ("", [c for c in columns if "_impulse_" not in c.name]),
        ("of impulses, ", [c for c in columns if "_impulse_" in c.name]),
    ):
        if chosen:
            ours = np.array([result.table[c.name] / c.scale for c in chosen]).T
            should = np.array(
                [[row.outcomes[c.name] / c.scale for c in chosen] for row in expected]
            )
            off = errors(ours, should, scale[[flown.outcome_columns.index(c) for c in chosen]]).max(
                axis=0
            )
            allowed = np.array([REPORTED * result.accuracy.errors[c.name] + CLOSE for c in chosen])
            at = int(np.argmax(np.where(np.isnan(off), np.inf, off) / allowed))
            said = f"{what or 'difference, '}{chosen[at].name}"
            lines.append(Line(f"{name}, as shipped", said, 0.0, float(off[at]), float(allowed[at])))
    return lines
