"""Error measure of outcomes, and the numerical error that a run reports."""

from collections.abc import Collection, Iterable, Mapping
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
    """Return the typical size of a quantity in a scene, for each of some units.

    A length is the vehicle length L (extent of the centres of mass and joint points, or the largest
    radius of gyration of a body if that is larger), a time the end time T, an angle 1 rad, a speed
    V = L / T + T F / M. Here F is the sum of the absolute forces of all motors, springs and loads,
    and M the mass of all bodies. A rate is V / L, a force M V / T; the
    other units follow from these.

    Parameters
    ----------
    scene : Scene
    units : iterable of str
        Units of outcome columns.

    Returns
    -------
    ndarray, shape (len(units),)
        Size of a quantity with each of the units, in SI.
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
    """Return the scale of each outcome: errors of values that are smaller are relative to it.

    The scale is the larger of the standard deviation of the outcome and `SMALL` times a typical
    size. That size is the largest absolute value of all outcomes with the same unit, or
    ``scene_scale`` if that is larger.

    Parameters
    ----------
    reference : ndarray, shape (n, o)
        Values of o outcomes in n cases, SI; NaN are ignored.
    units : list of str, length o
        Unit of each outcome.
    scene_scale : ndarray, shape (o,), optional
        Typical size of each outcome in the scene; see `scene_scales`.
    spread : ndarray, shape (o,), optional
        Standard deviation of each outcome; computed from ``reference`` if not given.

    Returns
    -------
    ndarray, shape (o,)
        Scale of each outcome, SI.
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
    """Return the standard deviation (o,), with divisor n, of each outcome over n cases, from
    ``outcomes`` (n, o).

    NaN are ignored and not counted in n; an outcome without any value has the deviation 0.
    """
    finite = ~np.isnan(outcomes)
    count = np.maximum(1, finite.sum(axis=0))
    with np.errstate(invalid="ignore"):
        mean = np.where(finite, outcomes, 0.0).sum(axis=0) / count
        return np.sqrt((np.where(finite, outcomes - mean, 0.0) ** 2).sum(axis=0) / count)


def errors(outcomes: np.ndarray, reference: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the error of every outcome of every case, in the measure that ``solver.accuracy``
    limits.

    The error is the absolute difference from the reference, divided by the size of the reference
    value or by the scale of the outcome, whichever is larger. So an outcome near zero has no
    unbounded relative error. Two equal values, also infinite ones, and two NaN at the same place
    have the error 0; a number and NaN have an infinite error. No error is NaN.

    Parameters
    ----------
    outcomes, reference : ndarray, shape (n, o)
        Values of o outcomes in n cases, and the more exact values to compare them with.
    scale : ndarray, shape (o,)
        Scale of each outcome, in the same unit as its values; see `scales`.

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
    """Return the largest relative error (o,) of each outcome over n cases; zeros without cases.

    ``outcomes`` and ``reference``, both (n, o) and SI, are compared by `errors`; ``units`` (o) and
    ``scene_scale`` (o,) give the scales as in `scales`.
    """
    if not len(outcomes):
        return np.zeros(len(units))
    return errors(outcomes, reference, scales(reference, units, scene_scale)).max(
        axis=0, initial=0.0
    )


def column_scales(
    campaign: Definition, outcomes: np.ndarray, spread: np.ndarray | None = None
) -> np.ndarray:
    """Return the scale of each outcome, as `scales` computes it, but in the unit of its column.

    Parameters
    ----------
    campaign : Definition
    outcomes : ndarray, shape (n, o)
        Values of all outcomes in n cases, in the units of their columns.
    spread : ndarray, shape (o,), optional
        Standard deviation of each outcome, in the unit of its column; computed from ``outcomes`` if
        not given.

    Returns
    -------
    ndarray, shape (o,)
        Scale of each outcome in the unit of its column.
    """
    columns = campaign.outcome_columns
    units = [column.unit for column in columns]
    sizes = np.array([column.scale for column in columns])
    return scales(outcomes, units, scene_scales(campaign.scene, units) * sizes, spread)


def with_scales(
    campaign: Definition, errors_by_name: Mapping[str, float], statistics: pd.DataFrame
) -> dict[str, tuple[float, float]]:
    """Return relative error and scale (`scales`) of each outcome, with scales from statistics.

    Parameters
    ----------
    campaign : Definition
    errors_by_name : mapping of str to float
        Relative error by outcome.
    statistics : DataFrame
        Statistics of the cases, a row per outcome; needs the columns min, max and sigma.

    Returns
    -------
    dict of str to (float, float)
        By outcome: its relative error (NaN if unknown), and its scale in the unit of its column.
    """
    names = [column.name for column in campaign.outcome_columns]
    extremes = statistics.loc[names, ["min", "max"]].to_numpy()
    sigma = statistics.loc[names, "sigma"].fillna(0.0).to_numpy()
    return _by_name(campaign, errors_by_name, column_scales(campaign, extremes.T, sigma))


def with_scales_of(
    campaign: Definition,
    errors_by_name: Mapping[str, float],
    outcomes: np.ndarray,
    names: Collection[str] | None = None,
) -> dict[str, tuple[float, float]]:
    """Return relative error and scale of outcomes, with scales from the values in cases.

    ``errors_by_name`` (the relative error of each outcome, not computed here) and the result are as
    for `with_scales`; errors of values smaller than its scale are relative to the scale (`scales`).
    ``outcomes`` (n, o) are the values of all outcomes in n cases, in the units of their columns.
    If ``names`` is given, the result has only these outcomes, which is faster.
    """
    if names is None:
        return _by_name(campaign, errors_by_name, column_scales(campaign, outcomes))
    wanted = [k for k, column in enumerate(campaign.outcome_columns) if column.name in names]
    spread = np.zeros(outcomes.shape[1])
    spread[wanted] = deviation(outcomes[:, wanted])
    pairs = _by_name(campaign, errors_by_name, column_scales(campaign, outcomes, spread))
    return {name: pair for name, pair in pairs.items() if name in names}


def _by_name(
    campaign: Definition, errors_by_name: Mapping[str, float], outcome_scales: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Return pairs (relative error, scale) by outcome; an error that ``errors_by_name`` lacks is
    NaN.

    ``outcome_scales`` (o,) are in the order of the outcome columns of the campaign, and in their
    units.
    """
    return {
        column.name: (errors_by_name.get(column.name, np.nan), float(scale))
        for column, scale in zip(campaign.outcome_columns, outcome_scales, strict=True)
    }


def with_errors(
    campaign: Definition, errors_by_name: Mapping[str, float], table: pd.DataFrame
) -> pd.DataFrame:
    """Return a copy of ``table``, statistics with a row per outcome, with the columns ``error``,
    ``error_size`` and ``constant`` added.

    ``error`` is the relative error of the outcome, from ``errors_by_name`` (NaN if unknown); the
    column is left out if ``errors_by_name`` is empty. ``error_size`` is the error in the unit of
    the outcome (round-off alone if the error is unknown), and ``constant`` is True if at least two
    cases have the outcome and none differ by more than twice that error; see
    `sepmc.analysis.constant_outcomes.with_constants`.
    """
    if errors_by_name:
        table = table.assign(error=[errors_by_name.get(str(name), np.nan) for name in table.index])
    return with_constants(table, with_scales(campaign, errors_by_name, table))


def zero_below_error(
    campaign: Definition, outcomes: Mapping[str, float], errors_by_name: Mapping[str, float]
) -> dict[str, float]:
    """Return the outcomes of one case, with 0 for each value whose absolute value is at most its
    numerical error.

    ``outcomes`` are by column, in the units of their columns; ``errors_by_name`` are relative
    errors by outcome, as `errors` measures them.
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
    """Return the mask (o,) of the outcomes that must converge with the step: True for all but
    contact (1 or 0) and the times and positions of extremes. ``columns`` are those of the o
    outcomes."""
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
        Relative error (see `errors`) of each outcome, by its name: `SAFETY` times the largest of
        the calibration cases, or more if `with_errors` raised it to that of other cases. Never
        empty.
    cases : int
        Number of calibration cases that reached their end.
    positions : frozenset of str
        Outcomes that need not converge with the step: times and positions of extremes, and
        contact. They have errors too, but do not count in ``unmet`` and ``met``, and in ``worst``
        only if there are no others.
    history : float or None
        Relative error of stored histories, which are interpolated between the ends of steps; None
        without histories.
    """

    asked: float
    errors: dict[str, float]
    cases: int
    positions: frozenset[str] = frozenset()
    history: float | None = None

    @property
    def worst(self) -> tuple[str, float]:
        """Name and relative error of the outcome with the largest error; those in `positions` are
        left out unless there are no others."""
        return _largest(
            {name: error for name, error in self.errors.items() if name not in self.positions}
            or self.errors
        )

    @property
    def worst_position(self) -> tuple[str, float] | None:
        """Name and relative error of the outcome in `positions` (times and positions of extremes,
        and contact) with the largest error; None if there are none."""
        errors = {name: error for name, error in self.errors.items() if name in self.positions}
        return _largest(errors) if errors else None

    @property
    def met(self) -> bool:
        """True if calibration cases reached their end, and no outcome is `unmet`."""
        return self.cases > 0 and not self.unmet

    @property
    def unmet(self) -> dict[str, float]:
        """Relative error, by name, of each outcome whose error is not at most the requested
        accuracy, without those in `positions`; the largest error first, before it NaN."""
        names = [
            name
            for name, error in self.errors.items()
            if name not in self.positions and not error <= self.asked  # also NaN
        ]
        order = sorted(names, key=lambda n: -np.nan_to_num(self.errors[n], nan=np.inf))
        return {name: self.errors[name] for name in order}

    def with_errors(self, others: Mapping[str, float]) -> "AchievedAccuracy":
        """Return a copy in which the error of each outcome is the larger of its own and that in
        ``others``, relative errors by outcome; outcomes that are only in ``others`` do not
        count."""
        return replace(
            self,
            errors={name: max(error, others.get(name, 0.0)) for name, error in self.errors.items()},
        )


def _largest(errors_by_name: dict[str, float]) -> tuple[str, float]:
    """Return the outcome with the largest error (the first one, if several have it) and that
    error; ``errors_by_name`` must not be empty."""
    name = max(errors_by_name, key=lambda n: errors_by_name[n])
    return name, errors_by_name[name]


def achieved(campaign: Definition, largest_errors: np.ndarray, cases: int) -> AchievedAccuracy:
    """Return the numerical error of a campaign from the errors of its calibration cases.

    Parameters
    ----------
    campaign : Definition
    largest_errors : ndarray, shape (o,)
        Largest relative error of each outcome in the calibration cases; the result has `SAFETY`
        times these.
    cases : int
        Number of calibration cases that reached their end; if 0, the result has infinite errors.

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
