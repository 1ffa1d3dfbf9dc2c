"""Tables whose smooth function goes far beyond its rows between them: rows at uneven distances."""

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
    """A sentence for each table whose smooth function is much larger or smaller between its
    rows."""
    found, environment = list[str](), scene.environment
    if environment.wind.profile is not None:
        found += _wind(environment.wind.profile)
    if environment.air is not None:
        found += [
            said
            for what, values in _of_air(environment.air)
            for said in _table(what, [environment.air.altitude], values)
        ]
    for name, body in scene.body.items():
        table = body.aerodynamics.table if body.aerodynamics is not None else None
        if table is not None:
            axes = [axis for axis in (table.mach, table.alpha, table.beta) if axis]
            for which in _COEFFICIENTS:
                if grid := getattr(table, which):
                    found += _table(
                        f"body.{name}.aerodynamics.table.{which}", axes, np.array(grid, float)
                    )
    return found


def _wind(profile: WindProfile) -> list[str]:
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  (that other scenes do not need)

    heights = np.array(profile.altitude)
    curve = CubicSpline(heights, along_ground(profile).T, bc_type="clamped")
    between = np.unique(np.linspace(heights[:-1], heights[1:], _BETWEEN))
    found = np.hypot(*curve(between).T)
    worst, most = int(np.argmax(found)), abs(profile.factor) * max(map(abs, profile.speed))
    if found[worst] <= _FASTER * most:
        return []
    return [
        f"environment.wind.profile: the smooth curve through the rows reaches {found[worst]:.3g} "
        f"m/s at {between[worst]:.5g} m, "
        f"the rows {most:.3g} m/s at most: {_REMEDY}"
    ]


def _of_air(air: AirProfile) -> Iterator[tuple[str, Array]]:
    """Names and values of what is smooth over height."""
    yield "environment.air.density (logarithm)", np.log(air.density)
    if air.speed_of_sound:
        yield "environment.air.speed_of_sound", np.array(air.speed_of_sound)


def _table(what: str, axes: list[tuple[float, ...]], values: Array) -> list[str]:
    """A sentence, if the smooth function through ``values`` (a row for each number of the axes)
    goes far beyond them."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415

    low, high, smooth = float(values.min()), float(values.max()), values
    for number, axis in enumerate(axes):
        if len(axis) > 1:
            points = np.array(axis)
            between = np.unique(np.linspace(points[:-1], points[1:], _BETWEEN))
            smooth = make_interp_spline(points, smooth, k=min(3, len(points) - 1), axis=number)(
                between
            )
    allowed = _BEYOND * (high - low) + _SMALLER * max(abs(low), abs(high))
    least, largest = float(smooth.min()), float(smooth.max())
    if low - allowed <= least and largest <= high + allowed:
        return []
    reached = largest if largest - high > low - least else least
    return [
        f"{what}: the smooth function through the rows reaches {reached:.4g}, the rows only "
        f"{low:.4g} to {high:.4g}: {_REMEDY}"
    ]
