"""Lint of a scene: a sentence, with key and value, on each valid value that is probably a
mistake."""

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from sepmc.scene.budget import force_of_table
from sepmc.scene.dispersion import Dispersion
from sepmc.scene.kinds import axial_offset, mass_centres
from sepmc.scene.lint_aerodynamics import lint_aerodynamics
from sepmc.scene.lint_layout import lint_layout
from sepmc.scene.model import GROUND, Condition, Part, Scene
from sepmc.scene.parameters import item_names, value

_FAR = 8.0  # times the extent of all other points: a point farther away is in another unit
_BESIDE = 2.0  # times the vehicle's length: largest distance from its axis
_ROUNDED = 0.011  # largest difference of a sum of rounded probabilities from 1
_EXPECTED = 0.5  # expected cases outside the bounds of a parameter that get a finding
_WIDE = 1.0  # half range of a distribution relative to the nominal
_FASTEST, _HIGHEST, _LOWEST = 13_000.0, 2e6, -500.0  # m/s, m, m
_HARDEST = 5e6  # dynamic pressure, Pa: a hard missile reaches 2e6
_SCALE_HEIGHT, _GROUND_DENSITY = 7_000.0, 1.225
_PULL = 0.05  # of its initial force: pull of a pusher at the end of its stroke
_EXTENSIONS = 2001  # of a stroke, at which the pull of a pusher is calculated
_AGAINST = -0.5  # cosine below which a spring pushes its second body toward the first
# offset of two mass centres along a joint axis, relative to their distance, that is nearly zero
_LEVEL = 0.02
_ROUND = np.arange(24) / 24.0  # of a full turn
# parts of the paths of numbers that may have either sign
_SIGNED = ("cg", "offset", "omega", "direction", "deflection", "products", "point", "axis", "clock",
           "pitch", "yaw", "roll", "alpha", "force_factor")  # fmt: skip


def lint_scene(scene: Scene, dispersions: Sequence[Dispersion]) -> list[str]:
    """Findings on a scene and its dispersions.

    Parameters
    ----------
    scene : Scene
    dispersions : sequence of Dispersion

    Returns
    -------
    list of str
        A sentence for each value that is probably a mistake.
    """
    return [
        *_far_points(scene),
        *_off_axis(scene),
        *_wide_distributions(scene, dispersions),
        *_weights(dispersions),
        *_tails(dispersions, scene.run.cases),
        *_start(scene),
        *_overlaps(scene),
        *_springs(scene),
        *_unloading(scene),
        *_pulls(scene, dispersions),
        *_wind(scene, dispersions),
        *_late_thrust(scene, dispersions),
        *_never_occurring(scene, dispersions),
        *_nearly_level(scene),
        *lint_aerodynamics(scene),
        *lint_layout(scene),
    ]


def _unloading(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each spring whose force table has negative forces and a return factor
    below 1: such a spring can keep bodies at a standstill. Springs with ``push_only`` whose
    constant ``force`` (beside the table) is not positive are left out: their whole force is 0 where
    that of the table is negative."""
    for spring in scene.spring:
        table = spring.table
        if spring.push_only and spring.force <= 0.0:  # no force then, on either way
            continue
        if table is not None and table.return_factor < 1.0 and min(table.force) < 0.0:
            yield (
                f"spring.{spring.name}.table: pulls with up to {-min(table.force):g} N while it "
                "extends, and with return_factor times that while it shortens: against another "
                "force it can hold its bodies still, which integration steps do not resolve; give "
                "return_factor = 1 or forces >= 0"
            )


def _nearly_level(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each joint without ``apart`` whose bodies' mass centres have nearly the
    same position along its x axis: their small offset then decides the sign of separation."""
    for name, joint in scene.joint.items():
        along = axial_offset(scene, joint)
        if joint.apart is None and abs(along) < _LEVEL * math.dist(*mass_centres(scene, joint)):
            side = "positive along its x axis" if along >= 0.0 else "negative along its x axis"
            yield (
                f"joint.{name}: the mass centres of {joint.bodies[0]} and {joint.bodies[1]} are "
                f"nearly level along its x axis ({1e3 * along:.3g} mm); separation is counted "
                f"{side}: give apart = 1 or -1 if that is meant otherwise"
            )


def _points(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """Layout points (station, y, z) of a scene, m, by a label for messages: the path of their key
    without its unit, or that of a part of an outline (by its name or index) and, in brackets, the
    index of the point or of the end of a frustum, from 0: ``body.upper.outline.0 (1)``. Frustums
    have the centres of their two ends; second points of springs and joints, and loads without a
    point, are left out."""
    points = {f"body.{name}.cg": body.cg for name, body in scene.body.items()}
    points |= {f"joint.{name}.point": joint.point for name, joint in scene.joint.items()}
    points |= {f"spring.{spring.name}.point": spring.point for spring in scene.spring}
    points |= {
        f"motor.{motor.name}.station": (motor.station, *motor.offset) for motor in scene.motor
    }
    points |= {f"load.{load.name}.point": load.point for load in scene.load if load.point}
    for name, body in scene.body.items():
        for label, part in zip(item_names(body.outline), body.outline, strict=True):
            ends = [(s, *part.offset) for s in part.stations or ()] + list(part.points)
            points |= {f"body.{name}.outline.{label} ({i})": end for i, end in enumerate(ends)}
    return points


def _far_points(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each layout point far outside the box of all others, as if millimetres
    were given as metres; none if there are fewer than three points."""
    points = _points(scene)
    if len(points) < 3:
        return
    names, at = list(points), np.array(list(points.values()))
    for i, name in enumerate(names):
        others = np.delete(at, i, axis=0)
        low, high = others.min(axis=0), others.max(axis=0)
        extent = max(float((high - low).max()), 0.1)
        beyond = float(np.maximum(low - at[i], at[i] - high).max())
        if beyond > _FAR * extent:
            yield (
                f"{name} = {_list(at[i])} m lies {beyond:.3g} m outside the box of all other "
                f"points, which is {extent:.3g} m long: is it in another unit?"
            )


def _off_axis(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each centre of mass that is farther from the layout axis than twice the
    length of the vehicle: the range of the stations of all `_points`, at least 1 mm."""
    stations = [point[0] for point in _points(scene).values()]
    length = max(max(stations) - min(stations), 1e-3)
    for name, body in scene.body.items():
        aside = math.hypot(body.cg[1], body.cg[2])
        if aside > _BESIDE * length:
            yield (
                f"body.{name}.cg = {_list(body.cg)} m is {aside:.3g} m off the axis of a "
                f"vehicle that is {length:.3g} m long: is it in another unit?"
            )


def _wide_distributions(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield a sentence on each distribution whose half range (3 sigma for a normal one without
    truncation) exceeds the size of the nominal value. Discrete and constant distributions,
    parameters that may have either sign, loads, and nominal values of 0 are left out."""
    for each in dispersions:
        path = each.parameter.path
        is_signed = path.startswith("load.") or any(part in path for part in _SIGNED)
        if is_signed or each.distribution in ("discrete", "constant"):
            continue
        nominal = value(scene, path) / each.parameter.factor
        low, high = each.reach
        if nominal and math.isfinite(nominal) and high - low > 2.0 * _WIDE * abs(nominal):
            yield (
                f"dispersion of {each.sentence}: reaches {low:.4g} to {high:.4g} about a nominal "
                f"of {nominal:.4g}: is a fraction meant? 5 % of it is 0.05 with relative = true"
            )


def _weights(dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield a sentence on each discrete distribution whose weights are all below 1, like
    probabilities, but do not add up to 1."""
    for each in dispersions:
        total = sum(each.weights)
        if each.weights and max(each.weights) < 1.0 and abs(total - 1.0) > _ROUNDED:
            probabilities = ", ".join(f"{weight / total:.3g}" for weight in each.weights)
            yield (
                f"dispersion of {each.sentence}: the weights add up to {total:.4g}, so the "
                f"probabilities are {probabilities}; is that meant?"
            )


def _tails(dispersions: Sequence[Dispersion], cases: int) -> Iterator[str]:
    """Yield a sentence on each normal distribution without truncation that puts half a case or
    more, expected in a run of ``cases``, outside the bounds of its parameter."""
    for each in dispersions:
        probability, nearest = each.beyond() if each.has_tails else (0.0, math.inf)
        if probability * cases >= _EXPECTED:
            count = probability * cases
            yield (
                f"dispersion of {each.sentence}: about {count:{'.0f' if count >= 100.0 else '.2g'}}"
                f" of {cases} cases have a value {nearest:.3g} sigma or more off the mean, which "
                "the key does not allow, and are not run (status invalid-input): truncate the "
                "distribution by truncate_sigma"
            )


def _start(scene: Scene) -> Iterator[str]:
    """Yield a sentence each on initial speed, altitude and, in the 1976 atmosphere, dynamic
    pressure beyond that of any vehicle; also on an altitude below -500 m."""
    start = scene.initial
    if start.speed > _FASTEST:
        yield f"initial.speed = {start.speed:.4g} m/s: is the unit right?"
    if start.altitude > _HIGHEST or start.altitude < _LOWEST:
        yield f"initial.altitude = {start.altitude:.4g} m: is the unit right?"
    if scene.environment.atmosphere == "us1976" and start.altitude < 86e3:
        density = _GROUND_DENSITY * math.exp(-max(start.altitude, 0.0) / _SCALE_HEIGHT)
        pressure = 0.5 * density * start.speed**2
        if pressure > _HARDEST:
            yield (
                f"initial.speed = {start.speed:.4g} m/s at initial.altitude = {start.altitude:.4g} "
                f"m is a dynamic pressure of {pressure:.2g} Pa; are both units right?"
            )


def _overlaps(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each pair of bodies whose outlines overlap at the start by more than
    1 mm, as `_depth` measures it."""
    bodies = [(name, body.outline) for name, body in scene.body.items() if body.outline]
    for i, (one, parts) in enumerate(bodies):
        for two, others in bodies[i + 1 :]:
            depth = max(
                [_depth(a, b) for a in parts for b in others]
                + [_depth(b, a) for a in parts for b in others]
            )
            if depth > 1e-3:
                yield (
                    f"outlines of {one} and {two} overlap at the start, by {1e3 * depth:.3g} mm at "
                    "least"
                )


def _depth(part: Part, solid: Part) -> float:
    """Largest depth, m, to which the edge circles or points of ``part`` lie inside the frustum
    ``solid``; if that is hollow, the largest distance, up to a tenth of its radius, to which they
    lie outside its wall. Zero or negative if none do, or if the two are not compared: a hollow
    ``part``, or a ``solid`` that is a sector or points."""
    if solid.stations is None or solid.radii is None or part.hollow or solid.sector:
        return 0.0
    at = np.array([*part.points, *_edge_points(part)])
    (front, aft), (first, second) = solid.stations, solid.radii
    if aft == front:
        return 0.0
    fraction = (at[:, 0] - front) / (aft - front)
    radius = first + fraction * (second - first)
    aside = np.hypot(at[:, 1] - solid.offset[0], at[:, 2] - solid.offset[1])
    along = np.minimum(fraction, 1.0 - fraction) * abs(aft - front)
    if solid.hollow:
        through = aside - radius
        return float(np.where((along > 0.0) & (through < 0.1 * radius), through, 0.0).max())
    return float(np.minimum(along, radius - aside).max())


def _edge_points(part: Part) -> Iterator[tuple[float, float, float]]:
    """Layout points, m, on both edge circles of a frustum, or on the arcs of a sector, 24 each."""
    first, last = part.sector or (0.0, 2.0 * math.pi)
    for station, radius in zip(part.stations or (), part.radii or (), strict=True):
        for fraction in _ROUND:
            y, z = part.offset
            angle = first + fraction * (last - first)
            yield station, y - radius * math.sin(angle), z + radius * math.cos(angle)


def _springs(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each spring with an axis whose constant ``force`` drives its second body
    toward the first, within 60 deg of the line between their mass centres. Springs to the ground,
    those with a ``force`` of 0, and those whose two bodies have a joint with ``apart`` are left
    out."""
    for spring in scene.spring:
        if spring.axis is None or GROUND in spring.bodies or spring.force == 0.0:
            continue
        joints = (j for j in scene.joint.values() if set(j.bodies) == set(spring.bodies))
        if any(joint.apart is not None for joint in joints):  # given in the file
            continue
        first, second = (np.array(scene.body[name].cg) for name in spring.bodies)
        offset = (second - first) * (-1.0, 1.0, 1.0)  # stations count aft, x points forward
        axis = np.array(spring.axis)
        size = float(np.linalg.norm(offset) * np.linalg.norm(axis))
        if size and np.sign(spring.force) * float(offset @ axis) < _AGAINST * size:
            what, does = f"axis = {_list(spring.axis)}", "pushes"
            if spring.force < 0.0:
                what, does = f"force = {spring.force:g} N", "pulls"
            yield (
                f"spring.{spring.name}.{what} {does} {spring.bodies[1]} "
                f"toward {spring.bodies[0]}: is it the other way round?"
            )


def _pulls(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield a sentence on each spring that pushes at first but pulls before the end of its stroke,
    by more than 5 % of its initial force, nominally or with one number at an end of its
    distribution. Force, stiffness, table and stroke count, not damping; springs with ``push_only``
    or without a stroke are left out."""
    by_path = {d.parameter.path: d for d in dispersions}
    for spring in scene.spring:
        key_path = f"spring.{spring.name}"
        initial = spring.force + float(force_of_table(spring.table, np.zeros(1))[0])
        if spring.push_only or initial <= 0.0 or math.isinf(spring.stroke):
            continue
        nominal = {"force": spring.force, "stiffness": spring.stiffness, "stroke": spring.stroke}
        tries: list[tuple[str, dict[str, float]]] = [("", nominal)]
        for key, end in (("force", 0), ("stiffness", 1), ("stroke", 1)):
            dispersion = by_path.get(f"{key_path}.{key}")
            if dispersion is not None:
                worst = dispersion.reach[end] * dispersion.parameter.factor
                tries.append((f", at an end of its distribution for {key}", nominal | {key: worst}))
        for where, of in tries:
            extension = np.linspace(0.0, of["stroke"], _EXTENSIONS)
            table = force_of_table(spring.table, extension)
            pulls = of["stiffness"] * extension - of["force"] - table
            at = int(np.argmax(pulls))
            pull = pulls[at]
            if pull > _PULL * initial:
                key = "stroke_m" if at == _EXTENSIONS - 1 else "extension"
                of_table = f", with {table[at]:.4g} N of its table" if spring.table else ""
                yield (
                    f"{key_path} pulls with {pull:.4g} N before its stroke is over{where}: "
                    f"force_N = {of['force']:.4g} less stiffness_N_per_m = {of['stiffness']:.4g} "
                    f"times {key} = {extension[at]:.4g}{of_table}; give push_only = true if "
                    "it cannot pull, and factor = 0 (not force_N = 0) if it fails"
                )
                break


def _wind(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield at most one sentence: on wind, nominal or dispersed, that has no effect (no atmosphere,
    or no body with aerodynamics), or whose profile does not cover the initial altitude and is not
    calm in the row nearest to it."""
    wind = scene.environment.wind
    blows = wind.speed > 0.0 or wind.profile is not None
    blows = blows or any(d.parameter.path == "environment.wind.speed" for d in dispersions)
    if not blows:
        return
    if scene.environment.atmosphere == "none":
        yield "environment.wind does nothing: environment.atmosphere is 'none'"
    elif all(body.aerodynamics is None for body in scene.body.values()):
        yield "environment.wind does nothing: no body has aerodynamics"
    elif wind.profile is not None:
        first, last = wind.profile.altitude[0], wind.profile.altitude[-1]
        height, is_below = scene.initial.altitude, scene.initial.altitude < first
        row, speed = (
            ("first", wind.profile.speed[0]) if is_below else ("last", wind.profile.speed[-1])
        )
        if not first <= height <= last and speed:
            yield (
                f"environment.wind.profile has rows from {first:.6g} to {last:.6g} m, but the "
                f"flight begins at {height:.6g} m: there the wind is that of its {row} row, "
                f"{speed:.4g} m/s"
            )


def _late_thrust(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield one sentence on each thrust profile whose first row is later than the ignition: that
    the motor does nothing, if the row is not even before the end of the burn and the burn time is
    not dispersed; else that there is no thrust before the row."""
    varied = {d.parameter.path for d in dispersions}
    for motor in scene.motor:
        key_path, profile = f"motor.{motor.name}", motor.profile
        if profile is None or not profile.time[0] > 0.0:
            continue
        first, fraction = profile.time[0], profile.fraction[0]
        if motor.burn <= first and f"{key_path}.burn" not in varied:
            yield (
                f"{key_path} does nothing: burn_s = {motor.burn:g}, but its profile begins "
                f"{first:g} s after the ignition"
            )
            continue
        then = f", then {fraction:g} of thrust_N at once" if fraction else ""
        yield (
            f"{key_path}.profile begins {first:g} s after the ignition: there is no thrust "
            f"before{then}"
        )


def _never_occurring(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Yield sentences on conditions that are never met: of the end of the stroke of a spring that
    has no stroke, or of a time after the end of the run, unless the stroke or the time is
    dispersed. Also on outputs without a value: tip-off rates and clearances after a release of
    joints that are never released, and loads of joints that are free in all phases."""
    varied = {d.parameter.path for d in dispersions}
    waiting = [(f"phase.{p.name}.until", p.until) for p in scene.phase if p.until is not None]
    waiting += [(f"release.{r.name}.when", r.when) for r in scene.release]
    waiting += [(f"event.{e.name}.when", e.when) for e in scene.event]
    for key_path, condition in waiting:
        for name in _springs_of(condition):
            spring = next(one for one in scene.spring if one.name == name)
            if math.isinf(spring.stroke) and f"spring.{name}.stroke" not in varied:
                yield f"{key_path}: spring {name} has no stroke_m, so its stroke never ends"
    for key_path, condition in waiting:
        if _is_past(condition, key_path, varied, scene.run.end_time):
            yield f"{key_path}: comes after the end of the run, {scene.run.end_time:g} s"
    last = scene.phase[-1].joints
    released = {name for name in scene.joint if last.get(name, "free") == "free"}
    released |= {release.joint for release in scene.release}
    for joint in scene.output.tip_off:
        if joint not in released:
            yield f"output.tip_off: {joint} is never released, so its tip-off rates have no value"
    for clearance in scene.clearance:
        if clearance.after is not None and clearance.after not in released:
            yield (
                f"clearance.{clearance.name}.after: {clearance.after} is never released, so the "
                "clearance has no value"
            )
    constrained = {
        name for phase in scene.phase for name, kind in phase.joints.items() if kind != "free"
    }
    for joint in scene.output.loads:
        if joint not in constrained:
            yield f"output.loads: {joint} is free in all phases, so it carries no load"


def _is_past(until: Condition, key_path: str, varied: set[str], end: float) -> bool:
    """True if a condition, at ``key_path``, cannot be met by the time ``end``, s: each of its
    alternatives is a time after ``end``, or an ``all`` that contains one. A dispersed time (its
    path is in ``varied``) never counts as after ``end``."""
    if msgspec.structs.replace(until, time=None, any=(), all=()) != Condition():
        return False
    alternatives = []
    if until.time is not None:
        alternatives.append(until.time > end and f"{key_path}.time" not in varied)
    alternatives += [
        _is_past(part, f"{key_path}.any.{number}", varied, end)
        for number, part in enumerate(until.any)
    ]
    if until.all:
        parts = enumerate(until.all)
        alternatives.append(
            any(_is_past(part, f"{key_path}.all.{number}", varied, end) for number, part in parts)
        )
    return all(alternatives)


def _springs_of(until: Condition) -> Iterator[str]:
    """Yield the names of the springs whose end of stroke a condition, or one nested in it, waits
    for."""
    if until.spring is not None:
        yield until.spring
    for part in (*until.any, *until.all):
        yield from _springs_of(part)


def _list(numbers: Sequence[float]) -> str:
    """Text of numbers with four significant digits, in brackets: ``[1.5, 2]``."""
    return "[" + ", ".join(f"{x:.4g}" for x in numbers) + "]"
