"""Tables and shapes of a scene as runs of numbers that all cases share."""

import math
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from sepmc.kernel.spec.splines import pack
from sepmc.routines import layout as at
from sepmc.scene.model import Motor, Proximity, Scene, WindProfile

COEFFICIENTS = {
    "axial": at.AXIAL,
    "normal": at.NORMAL,
    "side": at.SIDE,
    "roll": at.ROLLING,
    "yaw": at.YAWING,
    "pitch": at.PITCHING,
}


class Pool:
    """One array that grows by runs of numbers; each has a start."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def add(self, run) -> int:
        """Append a run of numbers; returns where it starts."""
        start = len(self.numbers)
        self.numbers += [float(x) for x in run]
        return start

    def array(self) -> np.ndarray:
        """All numbers, one run after the other, (n,)."""
        return np.array(self.numbers, dtype=float)


@dataclass(frozen=True)
class Term:
    """One term of an aerodynamic polynomial."""

    path: str
    body: str
    coefficient: int
    alpha: int
    beta: int


def aero_terms(scene: Scene) -> list[Term]:
    """All terms of all aerodynamic polynomials."""
    terms = []
    for name, body in scene.body.items():
        for coefficient, code in COEFFICIENTS.items():
            for term in getattr(body.aerodynamics, coefficient) if body.aerodynamics else ():
                path = f"body.{name}.aerodynamics.{coefficient}.{term}"
                terms.append(Term(path, name, code, _power(term, "alpha"), _power(term, "beta")))
    return terms


def _power(term: str, angle: str) -> int:
    """Power of ``angle`` in a term such as ``alpha2_beta``."""
    for factor in term.split("_"):
        if factor.startswith(angle):
            return int(factor[len(angle) :] or 1)
    return 0


def direction(axis: tuple[float, float, float] | None) -> np.ndarray:
    """Unit vector, or zero if there is none."""
    return np.zeros(3) if axis is None else np.array(axis) / np.linalg.norm(axis)


def add_air(pool: Pool, scene: Scene) -> int:
    """Logarithm of the density and speed of sound over height, after the least and greatest height;
    -1 without a table."""
    air = scene.environment.air
    if scene.environment.atmosphere != "table" or air is None:
        return -1
    sound = air.speed_of_sound or (math.inf,) * len(air.altitude)
    finite = [1.0 if math.isinf(x) else x for x in sound]
    pool.add([air.altitude[0], air.altitude[-1]])
    return pool.add(pack([air.altitude], np.array([np.log(air.density), finite])))


def add_wind(pool: Pool, scene: Scene, varies: bool) -> int:
    """Wind along ground x and z over height; -1 without a profile. Its rows alone if what
    multiplies and turns them ``varies`` from case to case."""
    profile = scene.environment.wind.profile
    if profile is None:
        return -1
    if varies:
        profile = replace(profile, factor=1.0, turn=0.0)
    return pool.add(pack([profile.altitude], along_ground(profile), ends="flat"))


def along_ground(profile: WindProfile) -> np.ndarray:
    """Wind of the rows of a profile along ground x and z, m/s, shape (2, rows)."""
    speed, where = profile.factor * np.array(profile.speed), np.array(profile.direction)
    where = where + profile.turn
    return np.array([speed * np.cos(where), speed * np.sin(where)])


def add_profile(pool: Pool, motor: Motor) -> tuple[int, int]:
    """Start and rows (time since ignition, fraction) of a thrust profile."""
    if motor.profile is None:
        return 0, 0
    rows = list(zip(motor.profile.time, motor.profile.fraction, strict=True))
    return pool.add([x for row in rows for x in row]), len(rows)


def add_aero_table(pool: Pool, scene: Scene, name: str) -> int:
    """Start of a body's table of six coefficients over (Mach, alpha, beta); -1 if it has none."""
    aero = scene.body[name].aerodynamics if name in scene.body else None
    if aero is None or aero.table is None:
        return -1
    axes = [axis or (0.0,) for axis in (aero.table.mach, aero.table.alpha, aero.table.beta)]
    shape = tuple(len(axis) for axis in axes)
    values = np.zeros((6, *shape))
    for coefficient, code in COEFFICIENTS.items():
        grid = getattr(aero.table, coefficient)
        if grid:
            values[code] = np.array(grid, dtype=float).reshape(shape)
    return pool.add(pack(axes, values))


def add_proximity(pool: Pool, entry: Proximity) -> int:
    """Start of six increments over the distance of separation."""
    values = [
        getattr(entry, coefficient) or (0.0,) * len(entry.distance) for coefficient in COEFFICIENTS
    ]
    return pool.add(pack([entry.distance], np.array(values, dtype=float), ends="flat"))


def add_outline(pool: Pool, scene: Scene, name: str) -> tuple[int, int]:
    """Start and number of the parts of a body's outline, at.PART_SIZE numbers each."""
    parts = []
    for part in scene.body[name].outline if name in scene.body else ():
        if part.stations is not None and part.radii is not None:
            (s0, s1), (r0, r1), (y, z) = part.stations, part.radii, part.offset
            if s0 == s1:  # a disc has one rim
                r0 = r1 = max(r0, r1)
            parts.append((float(part.hollow), s0, y, z, s1 - s0, r0, r1))
        parts += [(0.0, *point, 0.0, 0.0, 0.0) for point in part.points]
    return pool.add([x for part in parts for x in part]), len(parts)
