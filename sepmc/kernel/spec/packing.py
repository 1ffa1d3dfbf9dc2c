"""Numbers that all cases of a scene share: axes, tables, thrust profiles and outlines, packed one
after the other into one array."""

import math
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from sepmc.kernel.spec.splines import FAR, pack
from sepmc.kernel.spec.step_cells import has_kinks, has_unloading
from sepmc.routines import layout as at
from sepmc.scene.model import (
    DERIVATIVES,
    RATES,
    AeroTable,
    Motor,
    Proximity,
    Scene,
    Spring,
    WindProfile,
)
from sepmc.scene.terms import signal_of

COEFFICIENTS = {
    "axial": at.AXIAL,
    "normal": at.NORMAL,
    "side": at.SIDE,
    "roll": at.ROLLING,
    "yaw": at.YAWING,
    "pitch": at.PITCHING,
}


# The extension of a spring shrinks at rates below REST / PER_RATE (m/s): round-off of the rate of a
# spring between bodies that a joint fixes is no unloading.
PER_RATE, REST = 100.0, -2e-9


class Pool:
    """Growing list of the numbers that all cases share, such as tables; who adds some keeps the
    index of the first. Equal ones are added again, not shared."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def add(self, numbers) -> int:
        """Append numbers; return the index of the first of them."""
        start = len(self.numbers)
        self.numbers += [float(x) for x in numbers]
        return start

    def array(self) -> np.ndarray:
        """All numbers, shape (n,)."""
        return np.array(self.numbers, dtype=float)


@dataclass(frozen=True)
class Term:
    """Term of the polynomial of an aerodynamic coefficient of a body.

    Its value is the parameter at ``path`` times angle of attack to the power ``alpha``, sideslip
    angle to the power ``beta`` (rad) and the reduced angular rate ``rate`` (one of `RATES`, "" for
    none); or, if ``signal`` is not "", that parameter times the signal of that name in the file.
    ``coefficient`` is the code (AXIAL, ... of `sepmc.routines.layout`) of the coefficient.
    """

    path: str
    body: str
    coefficient: int
    alpha: int
    beta: int
    rate: str = ""
    signal: str = ""


def aero_terms(scene: Scene) -> list[Term]:
    """Terms of all aerodynamic polynomials of a scene.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of Term
        by body, then coefficient, then term, in the order of their parameters
    """
    terms = []
    for name, body in scene.body.items():
        for coefficient, code in COEFFICIENTS.items():
            for term in getattr(body.aerodynamics, coefficient) if body.aerodynamics else ():
                path = f"body.{name}.aerodynamics.{coefficient}.{term}"
                if signal := signal_of(term):
                    terms.append(Term(path, name, code, 0, 0, signal=signal))
                    continue
                rate = term[-1] if term.split("_")[-1] in RATES else ""
                powers = _power(term, "alpha"), _power(term, "beta")
                terms.append(Term(path, name, code, *powers, rate))
    return terms


def _power(term: str, angle: str) -> int:
    """Power of ``angle`` ("alpha" or "beta") in the name of a term: 2 of alpha in ``alpha2_beta``,
    0 if the angle is not in it."""
    for factor in term.split("_"):
        if factor.startswith(angle):
            return int(factor[len(angle) :] or 1)
    return 0


def direction(axis: tuple[float, float, float] | None) -> np.ndarray:
    """Unit vector along an axis, shape (3,); zeros for None."""
    return np.zeros(3) if axis is None else np.array(axis) / np.linalg.norm(axis)


def add_air(pool: Pool, scene: Scene) -> int:
    """Append a scene's table of air to the pool: its minimum and maximum altitude, m, then the
    packed functions (`pack`) of altitude: logarithm of the density, kg/m3, and speed of sound, m/s
    (1 if the table has none: no Mach number is then used).

    Returns the index of the packed functions, or -1 without such a table.
    """
    air = scene.environment.air
    if scene.environment.atmosphere != "table" or air is None:
        return -1
    sound = air.speed_of_sound or (math.inf,) * len(air.altitude)
    finite = [1.0 if math.isinf(x) else x for x in sound]
    pool.add([air.altitude[0], air.altitude[-1]])
    return pool.add(
        pack(
            [air.altitude], np.array([np.log(air.density), finite]), interpolation=air.interpolation
        )
    )


def add_wind(pool: Pool, scene: Scene, varies: bool) -> int:
    """Append the wind profile of a scene to the pool: packed functions (`pack`) of altitude, m, for
    the wind along ground x and along ground z, m/s.

    With ``varies`` (factor and turn of the profile are parameters of the kernel) they are left out
    of the stored functions. Returns the index of the pack, or -1 without a profile.
    """
    profile = scene.environment.wind.profile
    if profile is None:
        return -1
    if varies:
        profile = replace(profile, factor=1.0, turn=0.0)
    rows = along_ground(profile)
    return pool.add(
        pack([profile.altitude], rows, _flat(profile.interpolation), profile.interpolation)
    )


def _flat(interpolation: str) -> str:
    """Argument ``ends`` of `pack` for a function that is constant beyond its ends: "constant"
    (kinks at the ends) for linear interpolation, else "flat" (zero slope there)."""
    return "constant" if interpolation == "linear" else "flat"


def along_ground(profile: WindProfile) -> np.ndarray:
    """Wind of the rows of a profile along ground x and z, with the factor and turn of the profile.

    Parameters
    ----------
    profile : WindProfile

    Returns
    -------
    ndarray, shape (2, rows)
        m/s
    """
    speed, angle = profile.factor * np.array(profile.speed), np.array(profile.direction)
    angle = angle + profile.turn
    return np.array([speed * np.cos(angle), speed * np.sin(angle)])


def add_profile(pool: Pool, motor: Motor) -> tuple[int, int]:
    """Append the thrust profile of a motor to the pool, row by row: time since ignition, s, and
    thrust fraction. Return the index of the first number and the number of rows; (0, 0) without a
    profile."""
    if motor.profile is None:
        return 0, 0
    rows = list(zip(motor.profile.time, motor.profile.fraction, strict=True))
    return pool.add([x for row in rows for x in row]), len(rows)


def derivative_grids(table: AeroTable) -> list[tuple[str, int, str]]:
    """Derivatives of aerodynamic coefficients by reduced angular rates that a table contains.

    Parameters
    ----------
    table : AeroTable

    Returns
    -------
    list of tuple
        name of the grid in the table, code of the coefficient, rate (p, q or r); in the order of
        their packed functions, which follow those of the six coefficients
    """
    return [
        (name, COEFFICIENTS[name.rpartition("_")[0]], name[-1])
        for name in DERIVATIVES
        if getattr(table, name)
    ]


def add_aero_table(pool: Pool, scene: Scene, name: str) -> int:
    """Append the aerodynamic table of body ``name`` to the pool: packed functions (`pack`) of (Mach
    number, alpha, beta) for the six coefficients, then for derivatives by rates
    (`derivative_grids`). Return the index of the pack, or -1 without a table."""
    aero = scene.body[name].aerodynamics if name in scene.body else None
    if aero is None or aero.table is None:
        return -1
    axes = [axis or (0.0,) for axis in (aero.table.mach, aero.table.alpha, aero.table.beta)]
    shape = tuple(len(axis) for axis in axes)
    derivatives = derivative_grids(aero.table)
    values = np.zeros((len(COEFFICIENTS) + len(derivatives), *shape))
    for coefficient, code in COEFFICIENTS.items():
        grid = getattr(aero.table, coefficient)
        if grid:
            values[code] = np.array(grid, dtype=float).reshape(shape)
    for k, (key, _, _) in enumerate(derivatives, len(COEFFICIENTS)):
        values[k] = np.array(getattr(aero.table, key), dtype=float).reshape(shape)
    return pool.add(pack(axes, values, interpolation=aero.table.interpolation))


def add_proximity(pool: Pool, entry: Proximity) -> int:
    """Append a table of proximity increments to the pool, as one pack (`pack`) of six functions:
    the increments of the aerodynamic coefficients (zero for those not in the table) over separation
    distance, m, or over up to three axes of relative displacement since the start, m, and relative
    attitude, rad. Return the index of the pack."""
    axes = list(entry.points.values())
    zero = np.zeros([len(points) for points in axes])
    values = [np.array(getattr(entry, key) or zero, dtype=float) for key in COEFFICIENTS]
    ends = _flat(entry.interpolation)
    return pool.add(pack(axes, np.array(values), ends, entry.interpolation))


def add_force_table(pool: Pool, spring: Spring, dispersed: frozenset[str]) -> int:
    """Append the force table of a spring to the pool: packed function (`pack`) of the force, N,
    over extension, m. Return the index of the pack, or -1 without a table.

    ``dispersed`` are the paths of the dispersed parameters, on which `has_unloading` and
    `has_kinks` depend. With unloading (the force is smaller while the extension shrinks) there is a
    second axis, `PER_RATE` times the rate of extension, m/s, and a second function. The first is
    then the force of the table at any rate; the second is the same force while the extension
    shrinks, else 0. The spring adds the first plus (return factor - 1) times the second.
    """
    table = spring.table
    if table is None:
        return -1
    axes, force = [table.extension], np.array([table.force], dtype=float)
    ends = "constant" if has_kinks(spring, dispersed) else "not-a-knot"
    if not has_unloading(spring, dispersed):
        return pool.add(pack(axes, force, ends, table.interpolation))
    both = np.stack([np.repeat(force.T, 2, axis=1), force.T * [1.0, 0.0]])
    return pool.add(pack([*axes, (-FAR, REST)], both, ends, (table.interpolation, "steps")))


def add_outline(pool: Pool, scene: Scene, name: str) -> tuple[int, int]:
    """Append the outline of body ``name`` to the pool, layout.PART_SIZE numbers for each part: a
    solid frustum or disc, a shell, a sector, or a single point. Return the index of the first
    number and the number of parts (0 without an outline); the angles of a sector are stored, and
    count, as one more part."""
    elements = []
    for element in scene.body[name].outline if name in scene.body else ():
        if element.stations is not None and element.radii is not None:
            (s0, s1), (r0, r1), (y, z) = element.stations, element.radii, element.offset
            if s0 == s1:  # a disc has one rim
                r0 = r1 = max(r0, r1)
            kind = at.SECTOR if element.sector is not None else float(element.hollow)
            elements.append((kind, s0, y, z, s1 - s0, r0, r1))
        if element.sector is not None:
            first, last = element.sector
            elements.append((at.SECTOR_ANGLES, first, 0.0, 0.0, last - first, 0.0, 0.0))
        elements += [(0.0, *point, 0.0, 0.0, 0.0) for point in element.points]
    return pool.add([x for element in elements for x in element]), len(elements)
