"""Checks on two_bodies.toml with each joint kind: full against reduced formulation, and the engine
against minimal coordinates."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from sepmc.campaign.campaign import Campaign
from sepmc.validation import lagrange
from sepmc.validation.flights import SIZES, NominalRun, campaign
from sepmc.validation.line import CLOSE, Line

# Custom kinds: constrained joint axes in translation and rotation.
CUSTOM = {
    "custom y - x": ("y", "x"),
    "custom xz - y": ("xz", "y"),
    "custom xyz - xz": ("xyz", "xz"),
    "custom none - xy": ("", "xy"),
}
KINDS = (*(kind for kind in lagrange.KINDS if kind != "free"), *CUSTOM)


def _campaign(kind: str, other_settings: dict[str, Any] | None = None) -> Campaign:
    """Campaign of two_bodies.toml with a joint of ``kind``, a name of `KINDS`, which stays to the
    end. What a kind needs, the definition of one of `CUSTOM` or the second point of a rod, is
    added. ``other_settings`` replaces further values in the file, by path, and the phase above."""
    name = "own" if kind in CUSTOM else kind
    settings: dict[str, Any] = {"phase": [{"name": "held", "joints": {"link": name}}]} | (
        other_settings or {}
    )
    if kind in CUSTOM:
        settings["joint.link.kind"] = {
            "own": dict(zip(("translations", "rotations"), map(list, CUSTOM[kind]), strict=True))
        }
    if kind == "rod":
        settings["joint.link.second_point_m"] = [2.5, -0.15, 0.2]
    return campaign("two_bodies", settings)


@cache
def nominal_run(kind: str) -> NominalRun:
    """Nominal run of two_bodies.toml with a joint of ``kind``, a name of `KINDS`; it is cached."""
    return NominalRun(_campaign(kind), 0.05)


def largest_difference(
    case: str, run: Mapping[str, Any], expected: Mapping[str, Any], sizes: Mapping[str, float]
) -> Line:
    """Line of `sepmc verify` on the quantity that differs most between a run and the expected
    values, both by name; the tolerance is 1e-10, and ``case`` the label of the line. Only the names
    in ``expected`` are compared.

    The difference is relative to the larger of the expected value and ``sizes`` of that name; NaN
    counts as the largest. Values may be numbers or arrays that broadcast.
    """
    difference = {
        name: float(
            np.max(np.abs(np.asarray(run[name]) - value) / np.maximum(np.abs(value), sizes[name]))
        )
        for name, value in expected.items()
    }
    name = max(difference, key=lambda n: np.inf if np.isnan(difference[n]) else difference[n])
    return Line(case, f"difference, {name}", 0.0, difference[name], CLOSE)


def sizes(run: NominalRun) -> dict[str, float]:
    """Scale of every history column of a run of two_bodies.toml, by column name and in the unit of
    the column: `SIZES` of the unit; for N and N m the largest magnitude of all forces and moments,
    one number for both; else 1."""
    units = run.history.attrs["units"]
    wrench = max(
        float(run.history[name].abs().max()) for name, unit in units.items() if unit in ("N", "N m")
    )
    by_unit = SIZES | {"N": wrench, "N m": wrench}
    return {name: by_unit.get(unit, 1.0) for name, unit in units.items()}


def full_against_reduced() -> list[Line]:
    """Check the full against the reduced formulation, one line for each joint kind: largest
    difference, relative as in `largest_difference`, in any column of the history. The steps are
    long, 0.05 s, as their errors are equal in both."""
    lines = []
    for kind in KINDS:
        reduced, full = (
            NominalRun(
                _campaign(kind, {"solver": {"step_s": 0.05, "formulation": formulation}}), 0.05
            )
            for formulation in ("reduced", "full")
        )
        expected = {
            str(name): column.to_numpy()
            for name, column in reduced.history.items()
            if name != "phase"
        }
        values = {name: full.history[name].to_numpy() for name in expected}
        lines.append(largest_difference(f"full, reduced: {kind}", values, expected, sizes(reduced)))
    return lines


def against_lagrange() -> list[Line]:
    """Check the engine against minimal coordinates, one line for each joint kind: largest
    difference, relative as in `largest_difference`, of outcomes, of the last row of the history and
    of the joint loads at the end."""
    lines = []
    for kind in KINDS:
        run = nominal_run(kind)
        expected = lagrange.simulate(_campaign(kind).nominal().to_dict())
        references = {name: value for name, value in expected.items() if name in run.history}
        values = {
            name: [run.history[name].iloc[-1], run.outcomes.get(name, value)]
            for name, value in references.items()
        }
        for load, unit in (("force", "N"), ("moment", "N_m")):
            for axis, value in zip("xyz", expected[f"end_{load}_on_aft_{unit}"], strict=True):
                name = f"link_{load}_on_aft_{axis}_{unit}"
                values[name], references[name] = [run.history[name].iloc[-1]], value
        lines.append(largest_difference(f"Lagrange: {kind}", values, references, sizes(run)))
    return lines
