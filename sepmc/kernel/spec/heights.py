"""Bounds on the speed and height that a vehicle reaches in any case. They limit the step over the
rows of altitude tables, and show whether borders of atmosphere layers may be crossed.

The bounds follow from elementary mechanics, from the nominal scene and its ``extremes``: the scene
with all dispersed parameters at their minimum, and at their maximum. Air is assumed to accelerate a
vehicle to at most twice the wind speed.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from sepmc.physics.us1976_table import BORDERS
from sepmc.scene.kinds import connected_bodies
from sepmc.scene.model import GROUND, Motor, Scene, Spring
from sepmc.scene.signals import with_sizes

# maximum number of rows of an altitude table within a step: the stages then sample every row
_ROWS = 4.0


def rows_step(scene: Scene, extremes: Sequence[Scene] = ()) -> float:
    """Longest integration step in which the vehicle passes at most four rows of a table of wind or
    air over altitude, so that the stages of a step sample every row.

    Parameters
    ----------
    scene : Scene
    extremes : sequence of Scene
        the scene with all dispersed parameters at their minimum, and at their maximum

    Returns
    -------
    float
        s; infinite if the scene has no such table, or the vehicle passes none of its rows
    """
    tables = [
        table.altitude
        for table in (scene.environment.wind.profile, scene.environment.air)
        if table is not None
    ]
    if not tables:
        return math.inf
    scenes = list(map(with_sizes, [scene, *extremes]))
    speed = max(abs(s.initial.speed) for s in scenes) + _gained(scenes)
    low, high = _between(scenes, speed)
    passed = [
        np.diff(rows)[(np.array(rows[1:]) > low) & (np.array(rows[:-1]) < high)] for rows in tables
    ]
    closest = min((float(gaps.min()) for gaps in passed if len(gaps)), default=math.inf)
    return _ROWS * closest / speed if speed > 0.0 else math.inf


def may_pass_borders(scene: Scene, extremes: Sequence[Scene] = ()) -> bool:
    """Return True if the vehicle may cross a border between layers of the standard atmosphere.

    Parameters
    ----------
    scene : Scene
    extremes : sequence of Scene
        the scene with all dispersed parameters at their minimum, and at their maximum

    Returns
    -------
    bool
        False if no border is within the heights that the vehicle can reach, or if the scene does
        not use the 1976 standard atmosphere
    """
    scenes = list(map(with_sizes, [scene, *extremes]))
    climb = max(
        abs(s.initial.speed * math.sin(s.initial.pitch - s.initial.alpha)) for s in scenes
    ) + _gained(scenes)
    low, high = _between(scenes, climb)
    return scene.environment.atmosphere == "us1976" and any(
        low < border < high for border in BORDERS
    )


def _between(scenes: Sequence[Scene], speed: float) -> tuple[float, float]:
    """Bounds (low, high), m, on the height that a vehicle reaches in any of the ``scenes`` until
    their end time, given a bound on its ``speed``, m/s."""
    heights, distance = [s.initial.altitude for s in scenes], speed * scenes[0].run.end_time
    return min(heights) - distance, max(heights) + distance


def _gained(scenes: Sequence[Scene]) -> float:
    """Bound, over all ``scenes``, on the speed, m/s, that the mass centre of a body gains: by
    gravity, wind, and loads on the body or on bodies connected to it."""
    gravity = max(
        abs(s.environment.surface_gravity) if s.environment.gravity != "none" else 0.0
        for s in scenes
    )
    return gravity * scenes[0].run.end_time + 2.0 * max(map(_wind, scenes)) + _pushed(scenes)


def _wind(scene: Scene) -> float:
    """Bound on the wind speed of a scene, m/s: magnitude of the steady wind plus, with a profile,
    that of its fastest row times its ``factor``."""
    wind = scene.environment.wind
    if wind.profile is None:
        return abs(wind.speed)
    return abs(wind.speed) + abs(wind.profile.factor) * max(map(abs, wind.profile.speed))


def _pushed(scenes: Sequence[Scene]) -> float:
    """Bound, over all ``scenes`` and bodies, on the speed, m/s, that motors, springs and loads give
    a body: each of them accelerates the lightest group of connected bodies, of any phase, that
    contains both that body and the body it acts on."""
    scene = scenes[0]
    groups = [group for phase in scene.phase for group in connected_bodies(scene, phase)]
    masses = {
        name: min((s.body[name].mass for s in scenes if s.body[name].mass > 0.0), default=math.inf)
        for name in scene.body
    }
    weights = [(group, sum(masses[name] for name in group if name != GROUND)) for group in groups]
    gains = dict.fromkeys(scene.body, 0.0)
    for body, push in _pushes(scenes):
        for name in gains:
            gains[name] += max(
                (push(mass) for group, mass in weights if name in group and body in group),
                default=0.0,
            )
    return max(gains.values())


def _pushes(scenes: Sequence[Scene]) -> Iterator[tuple[str, Callable[[float], float]]]:
    """Yield a pair for each motor and load, and two for each spring: the name of the loaded body,
    and a function that maps the accelerated mass, kg, to a bound on the speed gained, m/s, with
    the worst parameters of all ``scenes``. The bound of a motor and a load is by its impulse, that
    of a spring by its impulse or its work (`_by_spring`)."""
    end = scenes[0].run.end_time
    for motors in zip(*(s.motor for s in scenes), strict=True):
        burns = max(m.burn for m in motors) + max(m.tail_off for m in motors)
        yield motors[0].body, partial(_by_impulse, max(map(_size, motors)) * min(end, burns))
    for springs in zip(*(s.spring for s in scenes), strict=True):
        force = max(abs(s.force) + _largest_of_table(s) for s in springs)
        stiffness = min(s.stiffness for s in springs)
        distance = max(s.stroke for s in springs)
        if stiffness > 0.0 and springs[0].table is None:
            distance = min(distance, force / stiffness)
        for body in springs[0].bodies:
            yield body, partial(_by_spring, force, distance, end)
    for loads in zip(*(s.load for s in scenes), strict=True):
        acts = min(end, max(load.end for load in loads)) - min(load.start for load in loads)
        yield (
            loads[0].body,
            partial(_by_impulse, max(math.hypot(*load.force) for load in loads) * max(0.0, acts)),
        )


def _largest_of_table(spring: Spring) -> float:
    """Bound on the magnitude of the force of a spring's table, N: twice the largest of its rows,
    since a spline may exceed them; 0 without a table."""
    return 2.0 * max(map(abs, spring.table.force)) if spring.table is not None else 0.0


def _size(motor: Motor) -> float:
    """Largest magnitude of the thrust of a motor, N: thrust times the largest fraction of its
    profile."""
    fractions = motor.profile.fraction if motor.profile is not None else (1.0,)
    return abs(motor.thrust) * max(map(abs, fractions))


def _by_impulse(impulse: float, mass: float) -> float:
    """Speed, m/s, that an impulse, N s, gives a mass, kg."""
    return impulse / mass


def _by_spring(force: float, distance: float, end: float, mass: float) -> float:
    """Bound on the speed, m/s, that a spring with the maximum ``force``, N, gives a ``mass``, kg:
    the smaller of the speed by the impulse until the end time ``end``, s, and the speed by the work
    over the ``distance``, m. 0 without a force."""
    return min(force * end / mass, math.sqrt(2.0 * force * distance / mass)) if force > 0.0 else 0.0
