"""Checks of tables, springs, loads, outlines, clearances and outputs of a scene: names that exist,
columns of equal length, axes that rise. Every check adds what it finds to ``problems``."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sepmc.scene.limits import FULL_TURN, SMALLEST, TABLE_CELLS, TABLE_ROWS
from sepmc.scene.messages import Problems, nearest
from sepmc.scene.model import (
    COEFFICIENTS,
    DERIVATIVES,
    GROUND,
    AeroTable,
    Part,
    Proximity,
    RelativeAxes,
    Scene,
    Spring,
)
from sepmc.scene.outline_parts import selected_parts
from sepmc.scene.parameters import item_names
from sepmc.scene.tables import TERMS
from sepmc.scene.terms import signal_terms

# s: the engine takes instants closer than this as one
SHORTEST = 1e-12
AXES = 3  # most axes of a table


def check_known(key_path: str, name: str, known, what: str, problems: Problems) -> None:
    """Add a problem if ``name``, the value at ``key_path``, is not in ``known``, the valid names.
    ``what`` is the noun of the message, such as "body"."""
    if name not in known:
        problems.add(key_path, f"no such {what}; {nearest(name, known)}", name)


def check_pair(key_path: str, bodies: tuple[str, str], scene: Scene, problems: Problems) -> None:
    """Add problems if a pair of names, the value at ``key_path``, is not that of two different
    bodies, one of which may be the ground."""
    for body in bodies:
        check_known(key_path, body, [*scene.body, GROUND], "body", problems)
    if bodies[0] == bodies[1]:
        problems.add(key_path, "must name two different bodies", list(bodies))


def check_series(
    key_path: str, key: str, series: Sequence[float], least: int, problems: Problems
) -> None:
    """Add a problem if ``series``, the axis of a table, does not rise strictly, or has fewer than
    ``least`` or more than `TABLE_ROWS` values. Its key is ``key`` in the table at ``key_path``."""
    if len(series) > TABLE_ROWS:
        reason = f"has {len(series):,} values: must have at most {TABLE_ROWS:,}"
        problems.add(f"{key_path}.{key}", reason)
    elif len(series) < least:
        problems.add(f"{key_path}.{key}", f"needs at least {least} values", list(series))
    elif not all(a < b for a, b in itertools.pairwise(series)):
        problems.add(f"{key_path}.{key}", "must rise strictly", list(series))


def check_lengths(
    key_path: str, columns: Mapping[str, Sequence[float]], problems: Problems
) -> None:
    """Add a problem for each column of the table at ``key_path`` that differs in length from the
    first column. ``columns`` is by key, not empty."""
    (first, axis), *others = columns.items()
    for key, column in others:
        if len(column) != len(axis):
            problems.add(
                f"{key_path}.{key}", f"has {len(column)} values, but {first} has {len(axis)}"
            )


def check_loads(scene: Scene, problems: Problems) -> None:
    """Add problems of springs, burn times of motors, loads, names of bodies, aerodynamic tables,
    outlines and proximity tables, and of names in polynomials that are neither a term nor a
    signal."""
    for spring in scene.spring:
        _check_spring(spring, scene, problems)
    for motor in scene.motor:
        if not motor.burn > SHORTEST:
            problems.add(f"motor.{motor.name}.burn_s", f"must be > {SHORTEST:g} s", motor.burn)
    for load in scene.load:
        check_known(f"load.{load.name}.body", load.body, scene.body, "body", problems)
        if not load.end - load.start > SHORTEST:
            problems.add(
                f"load.{load.name}.end_s",
                f"must be > start_s = {load.start:g}, by more than {SHORTEST:g} s",
                load.end,
            )
    for name, body in scene.body.items():
        if name == GROUND:
            problems.add(
                f"body.{name}", "is the name of the ground, which every scene has; choose another"
            )
        if body.aerodynamics is not None and body.aerodynamics.table is not None:
            _check_aero_table(
                f"body.{name}.aerodynamics.table", body.aerodynamics.table, scene, problems
            )
        for label, part in zip(item_names(body.outline), body.outline, strict=True):
            _check_part(f"body.{name}.outline.{label}", part, problems)
    signals = [signal.name for signal in scene.signal]
    for key_path, signal in signal_terms(scene).items():
        if signal not in signals:
            hint = f"; {nearest(signal, signals)}" if signals else ""
            problems.add(key_path, f"{TERMS}{hint}")
    for entry in scene.proximity:
        key_path = f"proximity.{entry.name}"
        check_known(f"{key_path}.body", entry.body, scene.body, "body", problems)
        check_known(f"{key_path}.joint", entry.joint, scene.joint, "joint", problems)
        _check_increments(key_path, entry, problems)
        if entry.body in scene.body and scene.body[entry.body].aerodynamics is None:
            reason = f"has no aerodynamics to add to: give [body.{entry.body}.aerodynamics]"
            problems.add(f"{key_path}.body", reason, entry.body)


def _check_increments(key_path: str, entry: Proximity, problems: Problems) -> None:
    """Add problems of a proximity table: it needs either a distance or one to three axes, which
    rise, and grids of the same shape."""
    grids = {key: getattr(entry, key) for key in COEFFICIENTS if getattr(entry, key)}
    if entry.axes is None:
        check_series(key_path, "distance_m", entry.distance, 2, problems)
        if len(entry.distance) > 1:
            columns = {"distance_m": entry.distance, **grids}
            check_lengths(key_path, columns, problems)
            equal = {key: grid for key, grid in grids.items() if len(grid) == len(entry.distance)}
            _check_grids(key_path, {"distance_m": entry.distance}, equal, problems)
        return
    if entry.distance:
        problems.add(f"{key_path}.distance_m", "give distance_m or axes, not both")
    units = {"x": "m", "y": "m", "z": "m"}
    axes = {f"{name}_{units.get(name, 'deg')}": one for name, one in entry.points.items()}
    if not 1 <= len(axes) <= AXES:
        reason = (
            f"needs one to three of {', '.join(RelativeAxes.__struct_fields__)}, each with its "
            "unit, such as x_m or pitch_deg"
        )
        problems.add(f"{key_path}.axes", reason)
        return
    for key, points in axes.items():
        check_series(f"{key_path}.axes", key, points, 2, problems)
    _check_grids(key_path, axes, grids, problems)


def _check_spring(spring: Spring, scene: Scene, problems: Problems) -> None:
    """Add problems of a spring: unknown or equal bodies, a force table whose extensions do not rise
    or do not end beyond 0, an axis of zero length, or equal points without an axis."""
    key_path = f"spring.{spring.name}"
    check_pair(f"{key_path}.bodies", spring.bodies, scene, problems)
    if spring.table is not None:
        extension, force = spring.table.extension, spring.table.force
        check_series(f"{key_path}.table", "extension_m", extension, 2, problems)
        check_lengths(f"{key_path}.table", {"extension_m": extension, "force_N": force}, problems)
        if extension and extension[-1] <= 0.0:
            problems.add(
                f"{key_path}.table.extension_m",
                "must end beyond 0: the extension is 0 at the start",
                list(extension),
            )
    if spring.axis is not None and max(map(abs, spring.axis)) < SMALLEST:
        problems.add(f"{key_path}.axis", "must not be zero", list(spring.axis))
    if spring.axis is None and (
        spring.second_point is None or math.dist(spring.point, spring.second_point) < 1e-9
    ):
        problems.add(
            f"{key_path}.axis",
            "is needed where both points are one (second_point_m is missing or equals point_m): "
            "the line between them has no direction",
        )


def _check_part(key_path: str, part: Part, problems: Problems) -> None:
    """Add problems of a part of an outline, which must be either a frustum or points; ``hollow``
    and ``sector_deg`` need a frustum of some length, and exclude each other; the second angle of
    ``sector_deg`` is above the first by at most 360; ``offset_m`` needs a frustum."""
    if (part.stations is None) != (part.radii is None) or (part.stations is None) == (
        not part.points
    ):
        problems.add(key_path, "give stations_m and radii_m (a frustum), or points_m, not both")
    if part.hollow and (part.stations is None or part.stations[0] == part.stations[1]):
        problems.add(f"{key_path}.hollow", "only a frustum of some length can be hollow")
    if part.sector is not None:
        key_path_of_sector = f"{key_path}.sector_deg"
        first, last = part.sector
        if part.stations is None or part.stations[0] == part.stations[1]:
            problems.add(key_path_of_sector, "only a frustum of some length has a sector")
        if not 0.0 < last - first <= FULL_TURN:
            reason = "must be two angles, the second above the first by at most 360"
            problems.add(key_path_of_sector, reason, [math.degrees(x) for x in part.sector])
        if part.hollow:
            problems.add(
                f"{key_path}.hollow", "leave it out: a sector is already a thin wall with two sides"
            )
    if part.points and any(part.offset):
        problems.add(
            f"{key_path}.offset_m",
            "belongs to a frustum's axis; points_m give y and z themselves",
            list(part.offset),
        )


def _check_aero_table(key_path: str, table: AeroTable, scene: Scene, problems: Problems) -> None:
    """Add problems of an aerodynamic table: no axis, axes that do not rise, grids whose shape does
    not fit the axes, or several Mach numbers although the air comes from a table (``atmosphere =
    "table"``) without a speed of sound."""
    axes = {"mach": table.mach, "alpha_deg": table.alpha, "beta_deg": table.beta}
    axes_given = {key: axis for key, axis in axes.items() if axis}
    for key, axis in axes_given.items():
        check_series(key_path, key, axis, 1, problems)
    if not axes_given:
        problems.add(key_path, "needs an axis: mach, alpha_deg or beta_deg")
    grids = {key: getattr(table, key) for key in (*COEFFICIENTS, *DERIVATIVES)}
    _check_grids(key_path, axes_given, {key: grid for key, grid in grids.items() if grid}, problems)
    if (
        len(table.mach) > 1
        and scene.environment.atmosphere == "table"
        and not (scene.environment.air and scene.environment.air.speed_of_sound)
    ):
        problems.add("environment.air.speed_of_sound_m_s", "is needed for tables over Mach number")


def _check_grids(
    key_path: str,
    axes: Mapping[str, Sequence[float]],
    grids: Mapping[str, list[Any]],
    problems: Problems,
) -> None:
    """Add a problem for each of ``grids`` that is not nested lists of numbers with a level for each
    of ``axes``, in their order and of their length, and one for more than `TABLE_CELLS` grid
    points."""
    shape = tuple(len(axis) for axis in axes.values())
    if math.prod(shape) > TABLE_CELLS:
        problems.add(
            key_path, f"has {math.prod(shape):,} grid points: must have at most {TABLE_CELLS:,}"
        )
    for coefficient, grid in grids.items():
        try:
            array = np.array(grid, dtype=float)
        except (ValueError, TypeError):
            problems.add(
                f"{key_path}.{coefficient}",
                "must be nested lists of numbers, one level for each axis",
            )
            continue
        if array.shape != shape:
            wanted = " x ".join(f"{len(axis)} ({key})" for key, axis in axes.items())
            problems.add(
                f"{key_path}.{coefficient}",
                f"is {' x '.join(map(str, array.shape))}, but the axes ask for {wanted} numbers",
            )


def check_air(scene: Scene, problems: Problems) -> None:
    """Add problems of the tables of air and wind over height: a table of air without ``atmosphere =
    "table"`` or the reverse, altitudes that do not rise, columns of different length, and densities
    or speeds of sound that are not positive."""
    air, profile = scene.environment.air, scene.environment.wind.profile
    if (scene.environment.atmosphere == "table") != (air is not None):
        reason = 'belongs to atmosphere = "table": give both, or none of them'
        problems.add("environment.air", reason)
    if air is not None:
        check_series("environment.air", "altitude_m", air.altitude, 2, problems)
        columns = {"altitude_m": air.altitude, "density_kg_per_m3": air.density}
        check_lengths(
            "environment.air",
            columns | ({"speed_of_sound_m_s": air.speed_of_sound} if air.speed_of_sound else {}),
            problems,
        )
        for key, column in (
            ("density_kg_per_m3", air.density),
            ("speed_of_sound_m_s", air.speed_of_sound),
        ):
            if min(column, default=1.0) <= 0.0:
                problems.add(f"environment.air.{key}", "must be > 0", list(column))
    if profile is not None:
        check_series("environment.wind.profile", "altitude_m", profile.altitude, 2, problems)
        columns = {
            "altitude_m": profile.altitude,
            "speed_m_s": profile.speed,
            "direction_deg": profile.direction,
        }
        check_lengths("environment.wind.profile", columns, problems)


def check_outputs(scene: Scene, problems: Problems) -> None:
    """Add problems of outputs and clearances: names of joints, bodies or outline parts that do not
    exist, lack what is asked for or occur twice, and clearances between thin surfaces only."""
    for body in scene.output.transverse:
        check_known("output.transverse", body, scene.body, "body", problems)
    if len(set(scene.output.transverse)) < len(scene.output.transverse):
        problems.add(
            "output.transverse", "names a body twice: leave one out", list(scene.output.transverse)
        )
    for pair in scene.output.relative:
        check_pair("output.relative", pair, scene, problems)
        if GROUND in pair:
            reason = "the ground has no centre of mass: name two bodies"
            problems.add("output.relative", reason, list(pair))
    if len(set(scene.output.relative)) < len(scene.output.relative):
        pairs = list(map(list, scene.output.relative))
        problems.add("output.relative", "has a pair of bodies twice: leave one out", pairs)
    for key in ("loads", "tip_off", "guide", "hinge"):
        joints = getattr(scene.output, key)
        for joint in joints:
            check_known(f"output.{key}", joint, scene.joint, "joint", problems)
            if key == "guide" and joint in scene.joint and scene.joint[joint].guide is None:
                problems.add(
                    f"output.{key}", f"joint {joint!r} has no pins: give [joint.{joint}.guide]"
                )
        if len(set(joints)) < len(joints):
            problems.add(f"output.{key}", "names a joint twice: leave one out", list(joints))
    for clearance in scene.clearance:
        key_path = f"clearance.{clearance.name}"
        check_pair(f"{key_path}.bodies", clearance.bodies, scene, problems)
        for body in clearance.bodies:
            if body in scene.body and not scene.body[body].outline:
                problems.add(
                    f"{key_path}.bodies",
                    f"body {body!r} has no outline: give [[body.{body}.outline]]",
                )
            if body == GROUND:
                problems.add(f"{key_path}.bodies", "the ground has no outline: name two bodies")
        for number, (body, names) in enumerate(
            zip(clearance.bodies, clearance.outlines, strict=True)
        ):
            known = item_names(scene.body[body].outline) if body in scene.body else names
            for name in names:
                what = f"part of the outline of {body}"
                check_known(f"{key_path}.outlines.{number}", name, known, what, problems)
            if len(set(names)) < len(names):
                problems.add(
                    f"{key_path}.outlines.{number}",
                    "names a part twice: leave one out",
                    list(names),
                )
        outlines = [selected_parts(scene, clearance, side) for side in range(2)]
        if all(outlines) and all(part.is_wall for outline in outlines for part in outline):
            problems.add(
                f"{key_path}.{'outlines' if any(clearance.outlines) else 'bodies'}",
                "have shells only (a sector is one), between which there is no clearance: one of "
                "the bodies needs a solid frustum or points",
            )
        if clearance.after is not None:
            check_known(f"{key_path}.after", clearance.after, scene.joint, "joint", problems)
