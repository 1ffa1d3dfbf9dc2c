"""One random scene flown with every joint kind: two formulations of the engine, and minimal
coordinates."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.validation import lagrange
from sepmc.validation.flights import SIZES, NominalFlight, campaign
from sepmc.validation.line import CLOSE, Line

# Kinds of one's own: joint axes along which, and about which, they hold.
OWN = {
    "own y - x": ("y", "x"),
    "own xz - y": ("xz", "y"),
    "own xyz - xz": ("xyz", "xz"),
    "own none - xy": ("", "xy"),
}
KINDS = (*(kind for kind in lagrange.KINDS if kind != "free"), *OWN)


def _campaign(kind: str, more: dict[str, Any] | None = None) -> Campaign:
    """two_bodies.toml held by a joint of one kind, with ``more`` settings."""
    name = "own" if kind in OWN else kind
    settings: dict[str, Any] = {"phase": [{"name": "held", "joints": {"link": name}}]} | (
        more or {}
    )
    if kind in OWN:
        settings["joint.link.kind"] = {
            "own": dict(zip(("translations", "rotations"), map(list, OWN[kind]), strict=True))
        }
    if kind == "rod":
        settings["joint.link.second_point_m"] = [2.5, -0.15, 0.2]
    return campaign("two_bodies", settings)


@cache
def flight_of(kind: str) -> NominalFlight:
    """That campaign's nominal case, flown once."""
    return NominalFlight(_campaign(kind), 0.05)


def furthest(
    case: str, found: Mapping[str, Any], expected: Mapping[str, Any], sizes: Mapping[str, float]
) -> Line:
    """The line of the quantity that differs most, relative to its own value or to its size,
    whichever is larger."""
    difference = {
        name: float(
            np.max(np.abs(np.asarray(found[name]) - value) / np.maximum(np.abs(value), sizes[name]))
        )
        for name, value in expected.items()
    }
    name = max(difference, key=lambda n: np.inf if np.isnan(difference[n]) else difference[n])
    return Line(case, f"difference, {name}", 0.0, difference[name], CLOSE)


def sizes(found: NominalFlight) -> dict[str, float]:
    """What counts as large, for every column of a flight of two_bodies.toml."""
    units = found.history.attrs["units"]
    wrench = max(
        float(found.history[name].abs().max())
        for name, unit in units.items()
        if unit in ("N", "N m")
    )
    by_unit = SIZES | {"N": wrench, "N m": wrench}
    return {name: by_unit.get(unit, 1.0) for name, unit in units.items()}


def full_against_reduced() -> list[Line]:
    """Every column of the history, over the whole flight; at long steps, which take both alike from
    the true motion."""
    lines = []
    for kind in KINDS:
        reduced, full = (
            NominalFlight(_campaign(kind, {"solver": {"step_s": 0.05, "formulation": way}}), 0.05)
            for way in ("reduced", "full")
        )
        expected = {
            str(name): column.to_numpy()
            for name, column in reduced.history.items()
            if name != "phase"
        }
        ours = {name: full.history[name].to_numpy() for name in expected}
        lines.append(furthest(f"full, reduced: {kind}", ours, expected, sizes(reduced)))
    return lines


def against_lagrange() -> list[Line]:
    """Outcomes, history and reaction at the end against minimal coordinates."""
    lines = []
    for kind in KINDS:
        found = flight_of(kind)
        expected = lagrange.fly(_campaign(kind).nominal().to_dict())
        should = {name: value for name, value in expected.items() if name in found.history}
        ours = {
            name: [found.history[name].iloc[-1], found.outcomes.get(name, value)]
            for name, value in should.items()
        }
        for what, unit in (("force", "N"), ("moment", "N_m")):
            for axis, value in zip("xyz", expected[f"end_{what}_on_aft_{unit}"], strict=True):
                name = f"link_{what}_on_aft_{axis}_{unit}"
                ours[name], should[name] = [found.history[name].iloc[-1]], value
        lines.append(furthest(f"Lagrange: {kind}", ours, should, sizes(found)))
    return lines
