"""Tables whose interpolant goes far beyond the values of their rows: rows at uneven distances."""

from collections.abc import Iterator

import numpy as np

from sepmc.kernel.spec.packing import along_ground
from sepmc.scene.model import AirProfile, Scene, WindProfile

_BETWEEN = 17  # points from one row to the next
_FASTER = 1.25  # times the largest speed in the rows of a wind
_BEYOND = 0.25  # of the range of a table's values
_SMALLER = 1e-6  # range of values, of their size, that is round-off
_REMEDY = "give more rows where it changes, at even distances"
_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")

Array = np.ndarray


def overshooting(scene: Scene) -> list[str]:
    """Notes on tables whose interpolant is much larger or smaller between rows than at rows."""
    notes, environment = list[str](), scene.environment
    if environment.wind.profile is not None:
        notes += _wind_notes(environment.wind.profile)
    if environment.air is not None:
        notes += [
            note
            for name, values in _air_columns(environment.air)
            for note in _table_notes(name, [environment.air.altitude], values)
        ]
    for name, body in scene.body.items():
        table = body.aerodynamics.table if body.aerodynamics is not None else None
        if table is not None:
            axes = [axis for axis in (table.mach, table.alpha, table.beta) if axis]
            for coefficient in _COEFFICIENTS:
                if grid := getattr(table, coefficient):
                    notes += _table_notes(
                        f"body.{name}.aerodynamics.table.{coefficient}", axes, np.array(grid, float)
                    )
    return notes


def _wind_notes(profile: WindProfile) -> list[str]:
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  (that other scenes do not need)

    heights = np.array(profile.altitude)
    curve = CubicSpline(heights, along_ground(profile).T, bc_type="clamped")
    points_between = np.unique(np.linspace(heights[:-1], heights[1:], _BETWEEN))
    speeds = np.hypot(*curve(points_between).T)
    worst, max_speed = int(np.argmax(speeds)), abs(profile.factor) * max(map(abs, profile.speed))
    if speeds[worst] <= _FASTER * max_speed:
        return []
    return [
        f"environment.wind.profile: the smooth curve through the rows reaches {speeds[worst]:.3g} "
        f"m/s at {points_between[worst]:.5g} m, "
        f"the rows {max_speed:.3g} m/s at most: {_REMEDY}"
    ]


def _air_columns(air: AirProfile) -> Iterator[tuple[str, Array]]:
    """Names and values of the columns that are interpolated over height."""
    yield "environment.air.density (logarithm)", np.log(air.density)
    if air.speed_of_sound:
        yield "environment.air.speed_of_sound", np.array(air.speed_of_sound)


def _table_notes(name: str, axes: list[tuple[float, ...]], values: Array) -> list[str]:
    """Note if the interpolant of ``values``, a row for each number of the axes, goes far beyond
    them."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415

    low, high, curve = float(values.min()), float(values.max()), values
    for number, axis in enumerate(axes):
        if len(axis) > 1:
            points = np.array(axis)
            points_between = np.unique(np.linspace(points[:-1], points[1:], _BETWEEN))
            curve = make_interp_spline(points, curve, k=min(3, len(points) - 1), axis=number)(
                points_between
            )
    allowed = _BEYOND * (high - low) + _SMALLER * max(abs(low), abs(high))
    lowest, highest = float(curve.min()), float(curve.max())
    if low - allowed <= lowest and highest <= high + allowed:
        return []
    extreme = highest if highest - high > low - lowest else lowest
    return [
        f"{name}: the smooth function through the rows reaches {extreme:.4g}, the rows only "
        f"{low:.4g} to {high:.4g}: {_REMEDY}"
    ]
