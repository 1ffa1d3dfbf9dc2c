"""How fast and how high vehicles fly at most: how long steps may be over the rows of tables over
height, and which layers of air they meet.

Bounds of plain mechanics for a nominal scene and its ``extremes``, the same with every dispersed
parameter at its least and at its largest. Air moves a vehicle no faster than twice the wind.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from sepmc.physics.us1976_table import BORDERS
from sepmc.scene.kinds import hanging_together
from sepmc.scene.model import GROUND, Motor, Scene

# of a table over height that a step passes at most: its stages then see what stands between two
# rows
_ROWS = 4.0


def rows_step(scene: Scene, extremes: Sequence[Scene] = ()) -> float:
    """Step, s, that passes no more rows of a table over height than its stages see."""
    tables = [
        table.altitude
        for table in (scene.environment.wind.profile, scene.environment.air)
        if table is not None
    ]
    if not tables:
        return math.inf
    scenes = [scene, *extremes]
    speed = max(abs(s.initial.speed) for s in scenes) + _gained(scenes)
    low, high = _between(scenes, speed)
    passed = [
        np.diff(rows)[(np.array(rows[1:]) > low) & (np.array(rows[:-1]) < high)] for rows in tables
    ]
    closest = min((float(gaps.min()) for gaps in passed if len(gaps)), default=math.inf)
    return _ROWS * closest / speed if speed > 0.0 else math.inf


def may_pass_borders(scene: Scene, extremes: Sequence[Scene] = ()) -> bool:
    """Whether a border between layers of the standard atmosphere lies where the vehicle may climb
    or fall."""
    scenes = [scene, *extremes]
    climb = max(
        abs(s.initial.speed * math.sin(s.initial.pitch - s.initial.alpha)) for s in scenes
    ) + _gained(scenes)
    low, high = _between(scenes, climb)
    return scene.environment.atmosphere == "us1976" and any(
        low < border < high for border in BORDERS
    )


def _between(scenes: Sequence[Scene], speed: float) -> tuple[float, float]:
    """Heights, m, between which vehicles of a speed, m/s, stay."""
    heights, way = [s.initial.altitude for s in scenes], speed * scenes[0].run.end_time
    return min(heights) - way, max(heights) + way


def _gained(scenes: Sequence[Scene]) -> float:
    """Speed, m/s, that a mass centre gains over a flight at most: by gravity, by what pushes it or
    what it hangs together with, by wind."""
    gravity = max(
        abs(s.environment.surface_gravity) if s.environment.gravity != "none" else 0.0
        for s in scenes
    )
    return gravity * scenes[0].run.end_time + 2.0 * max(map(_wind, scenes)) + _pushed(scenes)


def _wind(scene: Scene) -> float:
    wind = scene.environment.wind
    if wind.profile is None:
        return abs(wind.speed)
    return abs(wind.speed) + abs(wind.profile.factor) * max(map(abs, wind.profile.speed))


def _pushed(scenes: Sequence[Scene]) -> float:
    """Speed, m/s, that motors, springs and loads give a body at most: each with all that hangs
    together with both in some phase."""
    scene = scenes[0]
    groups = [group for phase in scene.phase for group in hanging_together(scene, phase)]
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
    """Bodies that something pushes, and the speed that this gives a mass at most, each of its
    numbers being the worst of all scenes."""
    end = scenes[0].run.end_time
    for motors in zip(*(s.motor for s in scenes), strict=True):
        burns = max(m.burn for m in motors) + max(m.tail_off for m in motors)
        yield motors[0].body, partial(_by_impulse, max(map(_size, motors)) * min(end, burns))
    for springs in zip(*(s.spring for s in scenes), strict=True):
        force, stiffness = max(abs(s.force) for s in springs), min(s.stiffness for s in springs)
        way = min(
            max(s.stroke for s in springs), force / stiffness if stiffness > 0.0 else math.inf
        )
        for body in springs[0].bodies:
            yield body, partial(_by_spring, force, way, end)
    for loads in zip(*(s.load for s in scenes), strict=True):
        acts = min(end, max(load.end for load in loads)) - min(load.start for load in loads)
        yield (
            loads[0].body,
            partial(_by_impulse, max(math.hypot(*load.force) for load in loads) * max(0.0, acts)),
        )


def _size(motor: Motor) -> float:
    fractions = motor.profile.fraction if motor.profile is not None else (1.0,)
    return abs(motor.thrust) * max(map(abs, fractions))


def _by_impulse(impulse: float, mass: float) -> float:
    return impulse / mass


def _by_spring(force: float, way: float, end: float, mass: float) -> float:
    """By its force all the time, or by the energy that it has."""
    return min(force * end / mass, math.sqrt(2.0 * force * way / mass)) if force > 0.0 else 0.0
