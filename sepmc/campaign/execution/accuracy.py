"""The measure of accuracy: what the error of an outcome is, and what a run tells of its own."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import pandas as pd

from sepmc.analysis.constant_outcomes import error_size, with_constants
from sepmc.campaign.definition import Definition
from sepmc.scene.model import Scene
from sepmc.schema import Column

SMALL = 1e-4  # of the largest outcome of the same unit, and of the scene's own scale of that unit
# errors are told so many times as large as trial cases show them, for the cases that were not tried
SAFETY = 2.0
# Where and when an extreme lies is as uncertain as the extreme is flat, and whether outlines met is
# yes or no: no step settles these.
_PLACES = (
    *("_peak_force_time_s", "_peak_moment_time_s", "_clearance_time_s"),
    *("_clearance_station_m", "_clearance_y_m", "_clearance_z_m", "_recontact"),
)


def scene_scales(scene: Scene, units: Iterable[str]) -> np.ndarray:
    """Size that a quantity of each unit has in a scene, SI.

    A length is as large as the vehicle L, a time as the flight T, an angle 1 rad, a speed V = L / T
    + T F / M with the forces F of all motors, springs and loads on the mass M; a rate V / L, a
    force M V / T, and so on.
    """
    mass = sum(body.mass for body in scene.body.values())
    gyration = max(float(np.sqrt(max(body.inertia) / body.mass)) for body in scene.body.values())
    points = [body.cg for body in scene.body.values()]
    points += [
        p
        for joint in scene.joint.values()
        for p in (joint.point, joint.second_point)
        if p is not None
    ]
    length = max(gyration, float(np.linalg.norm(np.ptp(np.array(points), axis=0))))
    forces = chain(
        (motor.thrust for motor in scene.motor),
        (spring.force for spring in scene.spring),
        (float(np.linalg.norm(load.force)) for load in scene.load),
    )
    time = scene.run.end_time
    speed = length / time + time * sum(map(abs, forces)) / mass
    force = mass * speed / time
    known = {
        "m": length,
        "mm": length,
        "s": time,
        "deg": 1.0,
        "m/s": speed,
        "deg/s": speed / length,
        "1": 1.0,
    }
    known |= {
        "N": force,
        "N m": force * length,
        "N s": force * time,
        "N m s": force * length * time,
    }
    return np.array([known[unit] for unit in units])


def scales(
    reference: np.ndarray,
    units: list[str],
    scene_scale: np.ndarray | None = None,
    spread: np.ndarray | None = None,
) -> np.ndarray:
    """What errors are taken relative to where an outcome is smaller than that, SI; shape (o,).

    The larger of its standard deviation (``spread``, or else that over the cases of ``reference``
    (n, o)) and of `SMALL` times the largest outcome of the same unit or, if given, times the scale
    (o,) of the scene.
    """
    sizes = np.abs(np.where(np.isnan(reference), 0.0, reference)).max(axis=0, initial=0.0)
    largest = np.array(
        [max(x for x, other in zip(sizes, units, strict=True) if other == unit) for unit in units]
    )
    if scene_scale is not None:
        largest = np.maximum(largest, scene_scale)
    return np.maximum(deviation(reference) if spread is None else spread, SMALL * largest)


def deviation(outcomes: np.ndarray) -> np.ndarray:
    """Standard deviation of each outcome, (n, o), over the cases that have it; 0 where none has."""
    there = ~np.isnan(outcomes)
    count = np.maximum(1, there.sum(axis=0))
    with np.errstate(invalid="ignore"):
        mean = np.where(there, outcomes, 0.0).sum(axis=0) / count
        return np.sqrt((np.where(there, outcomes - mean, 0.0) ** 2).sum(axis=0) / count)


def errors(found: np.ndarray, reference: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Error of every outcome of every case, (n, o): the measure that ``solver.accuracy`` is given
    in.

    The difference from the reference, over the size of the outcome or, if that is larger, over its
    ``scale`` (o,): its standard deviation over the cases of the campaign, and 1e-4 of the largest
    outcome of the same unit and of the scale that the scene has for that unit (`scene_scales`). So
    an outcome about zero, or one that is zero but for round-off, is not held to a share of nothing.
    NaN at the same place agrees; a number in place of NaN, or NaN in place of a number, is
    infinitely wrong.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        same = (found == reference) | (np.isnan(found) & np.isnan(reference))
        difference = np.where(same, 0.0, np.abs(found - reference))
        size = np.abs(np.where(np.isnan(reference), 0.0, reference))
        share = np.where(difference == 0.0, 0.0, difference / np.maximum(size, scale))
    return np.where(np.isnan(share), np.inf, share)


def relative_error(
    found: np.ndarray,
    reference: np.ndarray,
    units: list[str],
    scene_scale: np.ndarray | None = None,
) -> np.ndarray:
    """Largest error of every outcome over the cases of (n, o) each, scaled by the cases of the
    reference; (o,). See `errors`."""
    if not len(found):
        return np.zeros(len(units))
    return errors(found, reference, scales(reference, units, scene_scale)).max(axis=0, initial=0.0)


def with_scales(
    campaign: Definition, told: Mapping[str, float], statistics: pd.DataFrame
) -> dict[str, tuple[float, float]]:
    """Errors that a campaign tells, by outcome, and what they are shares of where an outcome is
    smaller: no less than that, from the statistics of its cases; in the units of the columns."""
    columns = campaign.outcome_columns
    units = [column.unit for column in columns]
    own = scene_scales(campaign.scene, units) * np.array([column.scale for column in columns])
    extremes = statistics.loc[[column.name for column in columns], ["min", "max"]].to_numpy()
    sigma = statistics.loc[[column.name for column in columns], "sigma"].fillna(0.0).to_numpy()
    found = scales(extremes.T, units, own, sigma)
    return {
        column.name: (told.get(column.name, np.nan), float(scale))
        for column, scale in zip(columns, found, strict=True)
    }


def with_errors(
    campaign: Definition, told: Mapping[str, float], table: pd.DataFrame
) -> pd.DataFrame:
    """Statistics of the outcomes of a campaign with the ``error`` that is told of each, if any is,
    what that is in its unit, and whether it is constant: see
    `sepmc.analysis.constant_outcomes.with_constants`."""
    if told:
        table = table.assign(error=[told.get(str(name), np.nan) for name in table.index])
    return with_constants(table, with_scales(campaign, told, table))


def without_noise(
    campaign: Definition, outcomes: Mapping[str, float], told: Mapping[str, float]
) -> dict[str, float]:
    """What one case gave, by column: 0 where an outcome is no larger than its numerical error, of
    which ``told`` is what `errors` measures."""
    columns = campaign.outcome_columns
    units = [column.unit for column in columns]
    own = scene_scales(campaign.scene, units) * np.array([column.scale for column in columns])
    scale = scales(np.array([[outcomes[column.name] for column in columns]]), units, own)
    sizes = {
        column.name: error_size(told.get(column.name, np.nan), float(size), outcomes[column.name])
        for column, size in zip(columns, scale, strict=True)
    }
    return {
        name: 0.0 if abs(value) <= sizes.get(name, 0.0) else value
        for name, value in outcomes.items()
    }


def decisive(columns: list[Column]) -> np.ndarray:
    """Which outcomes a step has to settle, (o,): all but times and places of extremes, and whether
    outlines met."""
    return np.array([not column.name.endswith(_PLACES) for column in columns], dtype=bool)


@dataclass(frozen=True)
class AchievedAccuracy:
    """Numerical error of a campaign by outcome, see `errors`.

    `SAFETY` times the largest that ``cases`` trial cases show when they are flown again at twice
    the resolution. ``places`` names the outcomes that no step settles: times and places of
    extremes, whether outlines met. Their errors are told, but ``worst`` and ``met`` are about the
    others. ``history`` is the error of stored histories, between the ends of steps, if there are
    any.
    """

    asked: float
    errors: dict[str, float]
    cases: int
    places: frozenset[str] = frozenset()
    history: float | None = None

    @property
    def worst(self) -> tuple[str, float]:
        """The outcome with the largest error, and that."""
        return _largest(
            {name: error for name, error in self.errors.items() if name not in self.places}
            or self.errors
        )

    @property
    def worst_place(self) -> tuple[str, float] | None:
        """The same of times and places of extremes; None if there are none."""
        found = {name: error for name, error in self.errors.items() if name in self.places}
        return _largest(found) if found else None

    @property
    def met(self) -> bool:
        """Whether the worst error is at most the accuracy asked; never without trial cases."""
        return self.cases > 0 and self.worst[1] <= self.asked

    def with_errors(self, others: Mapping[str, float]) -> "AchievedAccuracy":
        """The same with errors that are no smaller than some others, by outcome."""
        return replace(
            self,
            errors={name: max(error, others.get(name, 0.0)) for name, error in self.errors.items()},
        )


def _largest(errors_by_name: dict[str, float]) -> tuple[str, float]:
    name = max(errors_by_name, key=lambda n: errors_by_name[n])
    return name, errors_by_name[name]


def achieved(campaign: Definition, largest: np.ndarray, cases: int) -> AchievedAccuracy:
    """What ``cases`` trial cases tell: the ``largest`` (o,) error of each outcome they show;
    infinite if there are none."""
    columns = campaign.outcome_columns
    told = {
        column.name: float(SAFETY * error) if cases else np.inf
        for column, error in zip(columns, largest, strict=True)
    }
    places = frozenset(
        column.name
        for column, decides in zip(columns, decisive(columns), strict=True)
        if not decides
    )
    return AchievedAccuracy(campaign.scene.solver.accuracy, told, cases, places)
