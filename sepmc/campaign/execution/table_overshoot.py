"""Notes on tables whose spline overshoots the values of their rows: rows at uneven distances, or
too few where the values bend."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sepmc.kernel.spec.packing import along_ground
from sepmc.scene.model import AirProfile, Scene, WindProfile

_BETWEEN = 17  # points from one row to the next
_FASTER = 1.25  # times the largest speed in the rows of a wind
_BEYOND = 0.25  # of the range of a table's values
_SMALLER = 1e-6  # range of values, of their size, that is round-off
# of the range of a table's values: between two rows a spline is not further beyond both
_BEYOND_NEIGHBOURS = 0.05
_REMEDY = "give more rows where it changes, at even distances"
_OTHERS = 'or interpolation = "linear" or "monotone"'
_FLAT = "clamped"  # zero slope at both ends
_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")

Array = np.ndarray


def overshooting(scene: Scene) -> list[str]:
    """Notes for the user on the tables of a scene, interpolated by cubic splines, whose values
    between rows are far above or below those of the rows; a sentence for each."""
    notes, environment = list[str](), scene.environment
    profile, air = environment.wind.profile, environment.air
    if profile is not None and profile.interpolation == "cubic":
        notes += _wind_notes(profile)
    if air is not None and air.interpolation == "cubic":
        notes += [
            note
            for name, values in _air_columns(air)
            for note in _table_notes(name, {"altitude": air.altitude}, values)
        ]
    for name, body in scene.body.items():
        table = body.aerodynamics.table if body.aerodynamics is not None else None
        if table is not None and table.interpolation == "cubic":
            axes = {key: axis for key in ("mach", "alpha", "beta") if (axis := getattr(table, key))}
            for coefficient in _COEFFICIENTS:
                if grid := getattr(table, coefficient):
                    notes += _table_notes(
                        f"body.{name}.aerodynamics.table.{coefficient}", axes, np.array(grid, float)
                    )
    for spring in scene.spring:
        if spring.table is not None and spring.table.interpolation == "cubic":
            rows = {"extension": spring.table.extension}
            notes += _table_notes(
                f"spring.{spring.name}.table.force", rows, np.array(spring.table.force)
            )
    for entry in scene.proximity:
        for coefficient in _COEFFICIENTS if entry.interpolation == "cubic" else ():
            if grid := getattr(entry, coefficient):
                notes += _table_notes(
                    f"proximity.{entry.name}.{coefficient}",
                    entry.points,
                    np.array(grid, float),
                    _FLAT,
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
        f"the rows {max_speed:.3g} m/s at most: {_REMEDY}, {_OTHERS}"
    ]


def _air_columns(air: AirProfile) -> Iterator[tuple[str, Array]]:
    """Yield the path in the file, for messages, and the values (rows,) of each column of a table of
    the air that is interpolated over height: the logarithm of the density, and the speed of sound
    if given."""
    yield "environment.air.density (logarithm)", np.log(air.density)
    if air.speed_of_sound:
        yield "environment.air.speed_of_sound", np.array(air.speed_of_sound)


def _table_notes(
    name: str, axes: Mapping[str, Sequence[float]], values: Array, ends: str | None = None
) -> list[str]:
    """List with one note if the spline through a table goes far beyond the range of its ``values``
    or, along one axis, beyond both of two neighbouring rows; else empty.

    ``name`` is that of the table in the note. ``axes`` are the numbers along each dimension of
    ``values``, by key. ``ends`` is the boundary condition for scipy; None: not-a-knot.
    """
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415

    low, high, curve = float(values.min()), float(values.max()), values
    furthest, where = 0.0, ""
    for number, (key, axis) in enumerate(axes.items()):
        if len(axis) > 1:
            points = np.array(axis)
            points_between = np.unique(np.linspace(points[:-1], points[1:], _BETWEEN))
            how: dict[str, Any] = {"k": 3 if ends else min(3, len(points) - 1), "bc_type": ends}
            curve = make_interp_spline(points, curve, axis=number, **how)(points_between)
            along = make_interp_spline(points, np.moveaxis(values, number, 0), **how)
            excess, sentence = _beyond_neighbours(key, points, along)
            if excess > furthest:
                furthest, where = excess, sentence
    allowed = _BEYOND * (high - low) + _SMALLER * max(abs(low), abs(high))
    lowest, highest = float(curve.min()), float(curve.max())
    if low - allowed <= lowest and highest <= high + allowed:
        least = _BEYOND_NEIGHBOURS * (high - low) + _SMALLER * max(abs(low), abs(high))
        return [f"{name}: {where}: {_REMEDY}, {_OTHERS}"] if furthest > least else []
    extreme = highest if highest - high > low - lowest else lowest
    return [
        f"{name}: the smooth function through the rows reaches {extreme:.4g}, the rows only "
        f"{low:.4g} to {high:.4g}: {_REMEDY}, {_OTHERS}"
    ]


def _beyond_neighbours(
    key: str, points: Array, along: Callable[[Array], Array]
) -> tuple[float, str]:
    """Largest amount by which a spline between two neighbouring rows of a table is above both or
    below both, and a clause that says where; 0 with a clause of no meaning if it nowhere is.

    ``along`` is the spline along the axis named ``key``, whose rows are at ``points`` (n,), in
    radians for an angle. Its values may have further axes; the amount is in their unit.
    """
    angle = key in ("alpha", "beta", "pitch", "yaw", "roll")
    between = np.linspace(points[:-1], points[1:], _BETWEEN, axis=1)  # (intervals, points)
    values, rows = along(between), along(points)
    shape = (len(points) - 1, 1, *rows.shape[1:])
    least, most = np.minimum(rows[:-1], rows[1:]), np.maximum(rows[:-1], rows[1:])
    excess = np.maximum(values - most.reshape(shape), least.reshape(shape) - values)
    at = np.unravel_index(int(np.argmax(excess)), excess.shape)
    first, last = (np.degrees(x) if angle else x for x in points[at[0] : at[0] + 2])
    column = at[2:]
    return float(excess[at]), (
        f"the smooth function reaches {values[at]:.4g} between the rows {key} = {first:.5g} and "
        f"{last:.5g}{' deg' if angle else ''}, whose values are {rows[(at[0], *column)]:.4g} and "
        f"{rows[(at[0] + 1, *column)]:.4g}"
    )
