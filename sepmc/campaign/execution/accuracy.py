"""Error measure of outcomes, and the numerical error that a run reports."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import pandas as pd

from sepmc.analysis.constant_outcomes import error_size, with_constants
from sepmc.campaign.definition import Definition
from sepmc.scene.model import Scene
from sepmc.scene.signals import with_sizes
from sepmc.schema import Column

SMALL = 1e-4  # of the largest outcome of the same unit, and of the scene's own scale of that unit
# factor on the errors of calibration cases: covers the cases that are not among them
SAFETY = 2.0
# The time and position of an extreme are uncertain if the extreme is flat, and contact is 1 or 0:
# none of them converges with the step.
_EXTREME_POSITIONS = (
    *("_peak_force_time_s", "_peak_moment_time_s", "_clearance_time_s"),
    *("_clearance_station_m", "_clearance_y_m", "_clearance_z_m", "_recontact"),
)


def scene_scales(scene: Scene, units: Iterable[str]) -> np.ndarray:
    """Typical size of a quantity of each unit in a scene.

    A length is the vehicle length L, a time the end time T, an angle 1 rad, a speed V = L / T + T F
    / M with the sum F of the forces of all motors, springs and loads on the mass M; a rate is V /
    L, a force M V / T, and so on.

    Parameters
    ----------
    scene : Scene
    units : iterable of str
        Units of outcome columns.

    Returns
    -------
    ndarray, shape (len(units),)
        A size for each unit, SI.
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
    scene = with_sizes(scene)
    forces = chain(
        (motor.thrust for motor in scene.motor),
        (spring.force for spring in scene.spring),
        (max(spring.table.force, key=abs) for spring in scene.spring if spring.table is not None),
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
    """Size below which the error of an outcome is absolute.

    It is the larger of two: the standard deviation of the outcome, and `SMALL` times the largest
    outcome of the same unit or, if given, of the scene scale.

    Parameters
    ----------
    reference : ndarray, shape (n, o)
        Outcomes, SI.
    units : list of str, length o
    scene_scale : ndarray, shape (o,), optional
        See `scene_scales`.
    spread : ndarray, shape (o,), optional
        Standard deviation of each outcome; computed from ``reference`` if not given.

    Returns
    -------
    ndarray, shape (o,)
        SI.
    """
    magnitudes = np.abs(np.where(np.isnan(reference), 0.0, reference)).max(axis=0, initial=0.0)
    largest_of: dict[str, float] = {}
    for unit, magnitude in zip(units, magnitudes.tolist(), strict=True):
        largest_of[unit] = max(largest_of.get(unit, 0.0), magnitude)
    largest = np.array([largest_of[unit] for unit in units])
    if scene_scale is not None:
        largest = np.maximum(largest, scene_scale)
    return np.maximum(deviation(reference) if spread is None else spread, SMALL * largest)


def deviation(outcomes: np.ndarray) -> np.ndarray:
    """Standard deviation (o,) of outcomes (n, o), ignoring NaN; 0 if an outcome has no value."""
    finite = ~np.isnan(outcomes)
    count = np.maximum(1, finite.sum(axis=0))
    with np.errstate(invalid="ignore"):
        mean = np.where(finite, outcomes, 0.0).sum(axis=0) / count
        return np.sqrt((np.where(finite, outcomes - mean, 0.0) ** 2).sum(axis=0) / count)


def errors(outcomes: np.ndarray, reference: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Error of every outcome of every case: the measure of ``solver.accuracy``.

    The error is the difference from the reference over the size of the outcome or, if that is
    larger, over its scale. So an outcome near zero has no unbounded relative error. Two NaN at the
    same place agree; a number against NaN is an infinite error.

    Parameters
    ----------
    outcomes, reference : ndarray, shape (n, o)
    scale : ndarray, shape (o,)
        See `scales`.

    Returns
    -------
    ndarray, shape (n, o)
        Relative errors, >= 0.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        same = (outcomes == reference) | (np.isnan(outcomes) & np.isnan(reference))
        difference = np.where(same, 0.0, np.abs(outcomes - reference))
        size = np.abs(np.where(np.isnan(reference), 0.0, reference))
        relative = np.where(difference == 0.0, 0.0, difference / np.maximum(size, scale))
    return np.where(np.isnan(relative), np.inf, relative)


def relative_error(
    outcomes: np.ndarray,
    reference: np.ndarray,
    units: list[str],
    scene_scale: np.ndarray | None = None,
) -> np.ndarray:
    """Largest error (o,) of each outcome over n cases, scaled by the reference (n, o); see
    `errors`."""
    if not len(outcomes):
        return np.zeros(len(units))
    return errors(outcomes, reference, scales(reference, units, scene_scale)).max(
        axis=0, initial=0.0
    )


def column_scales(
    campaign: Definition, outcomes: np.ndarray, spread: np.ndarray | None = None
) -> np.ndarray:
    """Size below which the error of an outcome is absolute, in the unit of its column.

    Parameters
    ----------
    campaign : Definition
    outcomes : ndarray, shape (n, o)
        In the units of their columns.
    spread : ndarray, shape (o,), optional
        Standard deviation of each outcome; computed from ``outcomes`` if not given.

    Returns
    -------
    ndarray, shape (o,)
        See `scales`.
    """
    columns = campaign.outcome_columns
    units = [column.unit for column in columns]
    sizes = np.array([column.scale for column in columns])
    return scales(outcomes, units, scene_scales(campaign.scene, units) * sizes, spread)


def with_scales(
    campaign: Definition, errors_by_name: Mapping[str, float], statistics: pd.DataFrame
) -> dict[str, tuple[float, float]]:
    """Relative error of each outcome, and its scale in the unit of its column (`scales`).

    Parameters
    ----------
    campaign : Definition
    errors_by_name : mapping of str to float
        Relative error by outcome.
    statistics : DataFrame
        Statistics of the cases, by outcome; at least min, max and sigma.

    Returns
    -------
    dict of str to (float, float)
        Relative error (NaN if unknown) and scale, by outcome.
    """
    names = [column.name for column in campaign.outcome_columns]
    extremes = statistics.loc[names, ["min", "max"]].to_numpy()
    sigma = statistics.loc[names, "sigma"].fillna(0.0).to_numpy()
    return _by_name(campaign, errors_by_name, column_scales(campaign, extremes.T, sigma))


def with_scales_of(
    campaign: Definition, errors_by_name: Mapping[str, float], outcomes: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Relative error and scale of each outcome, as `with_scales`, from the ``outcomes`` (n, o) of
    cases, in the units of their columns."""
    return _by_name(campaign, errors_by_name, column_scales(campaign, outcomes))


def _by_name(
    campaign: Definition, errors_by_name: Mapping[str, float], outcome_scales: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Relative error (NaN if unknown) and scale by outcome; ``outcome_scales`` (o,) are in the
    order of the outcomes."""
    return {
        column.name: (errors_by_name.get(column.name, np.nan), float(scale))
        for column, scale in zip(campaign.outcome_columns, outcome_scales, strict=True)
    }


def with_errors(
    campaign: Definition, errors_by_name: Mapping[str, float], table: pd.DataFrame
) -> pd.DataFrame:
    """Add to a table of statistics, a row per outcome, the columns ``error``, ``error_size`` and
    ``constant``.

    ``error`` is the relative error (NaN if unknown); it is left out if ``errors_by_name`` is empty.
    For the others see `sepmc.analysis.constant_outcomes.with_constants`.
    """
    if errors_by_name:
        table = table.assign(error=[errors_by_name.get(str(name), np.nan) for name in table.index])
    return with_constants(table, with_scales(campaign, errors_by_name, table))


def zero_below_error(
    campaign: Definition, outcomes: Mapping[str, float], errors_by_name: Mapping[str, float]
) -> dict[str, float]:
    """Outcomes of one case by column, set to 0 where they are not larger than their numerical
    error.

    ``errors_by_name`` are relative errors as `errors` measures them.
    """
    values = np.array([[outcomes[column.name] for column in campaign.outcome_columns]])
    magnitudes = {
        name: error_size(error, scale, outcomes[name])
        for name, (error, scale) in with_scales_of(campaign, errors_by_name, values).items()
    }
    return {
        name: 0.0 if abs(value) <= magnitudes.get(name, 0.0) else value
        for name, value in outcomes.items()
    }


def decisive(columns: list[Column]) -> np.ndarray:
    """Mask (o,) of the outcomes, given by their ``columns``, that must converge: all but contact
    and the times and positions of extremes."""
    return np.array(
        [not column.name.endswith(_EXTREME_POSITIONS) for column in columns], dtype=bool
    )


@dataclass(frozen=True)
class AchievedAccuracy:
    """Numerical error of a campaign.

    Attributes
    ----------
    asked : float
        Requested accuracy, ``solver.accuracy``.
    errors : dict of str to float
        Relative error (see `errors`) by outcome: `SAFETY` times the largest of the calibration
        cases.
    cases : int
        Number of calibration cases.
    positions : frozenset of str
        Outcomes that do not converge with the step: times and positions of extremes, contact. They
        have errors too, but do not count in ``worst`` and ``met``.
    history : float or None
        Error of stored histories between the ends of steps; None without histories.
    """

    asked: float
    errors: dict[str, float]
    cases: int
    positions: frozenset[str] = frozenset()
    history: float | None = None

    @property
    def worst(self) -> tuple[str, float]:
        """Decisive outcome with the largest error, and the error."""
        return _largest(
            {name: error for name, error in self.errors.items() if name not in self.positions}
            or self.errors
        )

    @property
    def worst_position(self) -> tuple[str, float] | None:
        """Outcome of `positions` with the largest error, and the error; None if there are none."""
        errors = {name: error for name, error in self.errors.items() if name in self.positions}
        return _largest(errors) if errors else None

    @property
    def met(self) -> bool:
        """True if the worst error meets the requested accuracy. False without calibration cases."""
        return self.cases > 0 and self.worst[1] <= self.asked

    def with_errors(self, others: Mapping[str, float]) -> "AchievedAccuracy":
        """Copy with errors raised to those of ``others``, by outcome."""
        return replace(
            self,
            errors={name: max(error, others.get(name, 0.0)) for name, error in self.errors.items()},
        )


def _largest(errors_by_name: dict[str, float]) -> tuple[str, float]:
    """Name and value of the largest error."""
    name = max(errors_by_name, key=lambda n: errors_by_name[n])
    return name, errors_by_name[name]


def achieved(campaign: Definition, largest_errors: np.ndarray, cases: int) -> AchievedAccuracy:
    """Achieved accuracy: its errors are `SAFETY` times the largest ones of calibration cases.

    Parameters
    ----------
    campaign : Definition
    largest_errors : ndarray, shape (o,)
        Largest relative error of each outcome.
    cases : int
        Number of calibration cases; errors are infinite if 0.

    Returns
    -------
    AchievedAccuracy
    """
    columns = campaign.outcome_columns
    errors_by_name = {
        column.name: float(SAFETY * error) if cases else np.inf
        for column, error in zip(columns, largest_errors, strict=True)
    }
    positions = frozenset(
        column.name
        for column, decides in zip(columns, decisive(columns), strict=True)
        if not decides
    )
    return AchievedAccuracy(campaign.scene.solver.accuracy, errors_by_name, cases, positions)
