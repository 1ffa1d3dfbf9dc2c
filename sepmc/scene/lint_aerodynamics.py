"""Lint of aerodynamics and of all angles: angles and slopes that are probably in another unit,
coefficients of the other sign, tables of half an axis or transposed ones. The angles are those of
the initial state, of motors and of aerodynamic tables."""

import math
from collections.abc import Iterator

import numpy as np

from sepmc.scene.model import Aerodynamics, AeroTable, Body, Scene

_WEAK_SLOPE = 0.5  # 1/rad: smaller slopes of the normal force are probably per degree
_FLAT = 1e-9  # slope that is none
_FALLING = -0.05  # 1/rad: smaller slopes of the normal force are probably of the other sign
_STABLE = 0.01  # 1/rad, of moment slopes: smaller ones are neither stable nor unstable
_TURNED = 0.05  # variance that the right axis explains, over that of the other, if transposed
_RADIANS = 0.6  # largest number of an axis in degrees that may be in radians
_TURN = 2.0 * math.pi

Array = np.ndarray


def lint_aerodynamics(scene: Scene) -> Iterator[str]:
    """Yield findings on a scene: on angles of the initial state and of motors, and on aerodynamic
    coefficients and tables.

    Parameters
    ----------
    scene : Scene

    Yields
    ------
    str
        A sentence for each value that is probably a mistake.
    """
    yield from _angles(scene)
    for name, body in scene.body.items():
        aero = body.aerodynamics
        if aero is None:
            continue
        key_path = f"body.{name}.aerodynamics"
        yield from _slopes(key_path, body, aero)
        yield from _reversed(key_path, aero)
        if aero.table is not None:
            yield from _transposed(f"{key_path}.table", aero.table)
            yield from _axis_units(f"{key_path}.table", aero.table)
            yield from _half_axes(f"{key_path}.table", aero.table)


def _angles(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each initial or motor angle of more than a full turn, as if degrees were
    given as radians."""
    start = scene.initial
    angles = {
        f"initial.{key}": getattr(start, key)
        for key in ("alpha", "pitch", "yaw", "roll", "path_yaw")
    }
    for motor in scene.motor:
        angles |= {
            f"motor.{motor.name}.{key}": getattr(motor, key)
            for key in ("cant", "clock", "deflection", "deflection_clock")
        }
    for key_path, angle in angles.items():
        if abs(angle) > _TURN + 1e-9:
            yield (
                f"{key_path} = {math.degrees(angle):.4g} deg ({angle:.4g} rad) is more than a "
                "turn: is it in the other unit?"
            )


def _axis_units(key_path: str, table: AeroTable) -> Iterator[str]:
    """Yield a sentence on each alpha or beta axis of a table that looks as if it had radians in a
    key of degrees, or the reverse."""
    for key, axis in (("alpha", table.alpha), ("beta", table.beta)):
        if not axis:
            continue
        largest = max(map(abs, axis))
        if largest > _TURN + 1e-9:
            yield (
                f"{key_path}.{key} reaches {math.degrees(largest):.4g} deg ({largest:.4g} rad): is "
                "it in the other unit?"
            )
        elif len(axis) > 2 and math.degrees(largest) < _RADIANS:
            yield (
                f"{key_path}.{key} reaches {math.degrees(largest):.3g} deg only: is it in the "
                "other unit?"
            )


def _half_axes(key_path: str, table: AeroTable) -> Iterator[str]:
    """Yield a sentence on each alpha or beta axis of a table that begins at zero: the other half
    was probably left out because the body is symmetric."""
    for key, axis in (("alpha", table.alpha), ("beta", table.beta)):
        if len(axis) > 1 and axis[0] == 0.0:
            yield (
                f"{key_path}: {key} begins at 0, so a case that turns below it ends with the "
                f'status outside-table; mirror = "{key}" if the body is symmetric'
            )


def _slopes(key_path: str, body: Body, aero: Aerodynamics) -> Iterator[str]:
    """Yield sentences on slopes of normal force over alpha and side force over beta that are small,
    as if per degree, and on signs of side force or yaw moment that are probably reversed."""
    normal, side = _slope(aero, "normal", "alpha"), _slope(aero, "side", "beta")
    for key, angle, slope in (("normal", "alpha", normal), ("side", "beta", side)):
        if _FLAT < abs(slope) < _WEAK_SLOPE and (key == "normal" or abs(slope) < 0.1 * abs(normal)):
            yield (
                f"{key_path}.{key} changes by {slope:.3g} per rad of {angle}: is it per degree "
                f'({math.degrees(1.0) * slope:.3g} per rad)? Then give per = "deg"'
            )
    if normal > _FLAT and side < -_FLAT:
        yield (
            f"{key_path}.side has the slope {side:.3g} per rad of beta: a positive C_Y points left "
            "here, so this force drives the body further aside; DATCOM's C_Y points right: "
            'if it is that, give convention = "datcom"'
        )
    # moments about the mass centre, with the forces at the moment point ahead of it by ``ahead``
    point = aero.moment_point or body.cg
    ahead = (body.cg[0] - point[0]) / aero.reference_length
    pitch = _slope(aero, "pitch", "alpha") + ahead * normal
    yaw = _slope(aero, "yaw", "beta") - ahead * side
    if pitch < -_STABLE and yaw < -_STABLE:
        yield (
            f"{key_path}: the body is statically stable in alpha (C_m {pitch:.3g} per rad) and not "
            f"in beta (C_n {yaw:.3g} per rad); a positive C_n turns the nose right, into a "
            "sideslip beta > 0: is the sign of yaw or of side meant otherwise?"
        )


def _reversed(key_path: str, aero: Aerodynamics) -> Iterator[str]:
    """Yield sentences on a normal force that falls with alpha around zero, at all Mach numbers, and
    on an axial force that is negative there at most of them."""
    axis = aero.table.alpha if aero.table is not None else ()
    around_zero = len(axis) < 2 or axis[0] <= 0.0 <= axis[-1]
    slope = float(_slopes_at_zero(aero, "normal", "alpha").max())
    if around_zero and slope < _FALLING:
        yield (
            f"{key_path}.normal has the slope {slope:.3g} per rad of alpha: a positive C_N points "
            "up here, so a nose above the path is pushed down: does it point down in your data, as "
            "C_Z does?"
        )
    axial = aero.axial.get("const", 0.0) + _values_at_zero(aero, "axial")
    if around_zero and (axial < 0.0).mean() > 0.5:
        yield (
            f"{key_path}.axial is {float(np.median(axial)):.3g} at alpha = 0: a positive C_A "
            "points aft here, so the air pushes this body forward: does it point forward in your "
            "data, as C_X does?"
        )


def _values_at_zero(aero: Aerodynamics, coefficient: str) -> Array:
    """Values (n,) of the table of a coefficient, at all Mach numbers and, of each angle, the row
    nearest to zero; one value 0 without a table."""
    table = aero.table
    grid = getattr(table, coefficient) if table is not None else []
    if not grid:
        return np.zeros(1)
    assert table is not None
    values = np.array(grid, float)
    for key in ("beta", "alpha"):
        if axis := getattr(table, key):
            number = sum(bool(x) for x in (table.mach, table.alpha)[: 1 if key == "alpha" else 2])
            values = np.take(values, int(np.argmin(np.abs(axis))), axis=number)
    return np.ravel(values)


def _slope(aero: Aerodynamics, coefficient: str, angle: str) -> float:
    """Slope of a coefficient over an angle at zero, 1/rad, of polynomial and table together. Where
    a table gives several, at the points of its other axes (`_slopes_at_zero`), it is the steepest
    one."""
    slopes = _slopes_at_zero(aero, coefficient, angle)
    return float(slopes[int(np.argmax(np.abs(slopes)))])


def _slopes_at_zero(aero: Aerodynamics, coefficient: str, angle: str) -> Array:
    """Slopes (n,) of a coefficient over an angle ("alpha" or "beta") at zero, 1/rad: that of its
    polynomial plus, from its table, those between the two rows next to zero, at all points of the
    other axes."""
    slope = float(getattr(aero, coefficient).get(angle, 0.0))
    table = aero.table
    grid = getattr(table, coefficient) if table is not None else []
    axis = getattr(table, angle) if table is not None else ()
    if not grid or len(axis) < 2:
        return np.array([slope])
    assert table is not None
    number = sum(bool(x) for x in (table.mach, table.alpha)[: 1 if angle == "alpha" else 2])
    rows = np.moveaxis(np.array(grid, float), number, 0)
    row = min(max(int(np.searchsorted(axis, 0.0)), 1), len(axis) - 1)
    return np.ravel(slope + (rows[row] - rows[row - 1]) / (axis[row] - axis[row - 1]))


def _transposed(key_path: str, table: AeroTable) -> Iterator[str]:
    """Yield a sentence on the first coefficient of a table that hardly depends on its own angle but
    on the other axis: its grid is probably transposed. Only tables of two axes with equally many
    points, three or more, are examined."""
    axes = {key: axis for key in ("mach", "alpha", "beta") if (axis := getattr(table, key))}
    shape = [len(axis) for axis in axes.values()]
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] < 3:
        return
    for coefficient, own in (
        ("normal", "alpha"),
        ("pitch", "alpha"),
        ("side", "beta"),
        ("yaw", "beta"),
    ):
        grid = getattr(table, coefficient)
        if not grid or own not in axes:
            continue
        values = np.array(grid, float)
        number = list(axes).index(own)
        by_own, by_other = (float(values.mean(axis=1 - k).var()) for k in (number, 1 - number))
        if by_other > 0.0 and by_own < _TURNED * by_other:
            other = next(key for key in axes if key != own)
            yield (
                f"{key_path}.{coefficient} hardly depends on {own}, but on {other}: is the table "
                f"transposed? Its rows are those of {next(iter(axes))}"
            )
            return
