"""What a scene says that is probably a slip: it can be flown, but no such vehicle or flight is
known. Every sentence names place and value."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sepmc.scene.dispersion import Dispersion
from sepmc.scene.kinds import axial_offset, mass_centres
from sepmc.scene.model import GROUND, Condition, Part, Scene
from sepmc.scene.parameters import value

_FAR = 8.0  # times the extent of all other points of the vehicle: a unit was mistaken
_BESIDE = 2.0  # of the vehicle's length: how far off its axis things are at most
_ROUNDED = 0.011  # that weights may be from 1, as thirds to two digits are
_EXPECTED = 0.5  # cases that may be drawn where their parameter may not be
_WIDE = 1.0  # half a law's range over its nominal
_FASTEST, _HIGHEST, _LOWEST = 13_000.0, 2e6, -500.0  # m/s, m, m
_HARDEST = 5e6  # dynamic pressure, Pa: a hard missile reaches 2e6
_SCALE_HEIGHT, _GROUND_DENSITY = 7_000.0, 1.225
_PULL = 0.05  # of its force at the start: with what a pusher may pull at the end of its stroke
_AGAINST = -0.5  # cosine: a spring that pushes its second body back toward the first
# of the distance of two mass centres: along a joint's axis they are nearly level
_LEVEL = 0.02
_ROUND = np.arange(24) * (2.0 * math.pi / 24)
# kinds of number that no law takes beyond zero
_SIGNED = ("cg", "offset", "omega", "direction", "deflection", "products", "point", "axis", "clock",
           "pitch", "yaw", "roll", "alpha", "force_factor")  # fmt: skip


def lint_scene(scene: Scene, dispersions: Sequence[Dispersion]) -> list[str]:
    """Sentences on what is probably a slip."""
    return [
        *_far_points(scene),
        *_outside(scene),
        *_wide_laws(scene, dispersions),
        *_weights(dispersions),
        *_tails(dispersions, scene.run.cases),
        *_start(scene),
        *_overlaps(scene),
        *_springs(scene),
        *_pulls(scene, dispersions),
        *_wind(scene, dispersions),
        *_late_thrust(scene, dispersions),
        *_never(scene, dispersions),
        *_level(scene),
    ]


def _level(scene: Scene) -> Iterator[str]:
    """Joints whose bodies lie beside each other but for a little, so that it is by chance which
    side is apart."""
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
    """Layout points of a scene by the path of their key."""
    found = {f"body.{name}.cg": body.cg for name, body in scene.body.items()}
    found |= {f"joint.{name}.point": joint.point for name, joint in scene.joint.items()}
    found |= {f"spring.{spring.name}.point": spring.point for spring in scene.spring}
    found |= {
        f"motor.{motor.name}.station": (motor.station, *motor.offset) for motor in scene.motor
    }
    found |= {f"load.{load.name}.point": load.point for load in scene.load if load.point}
    for name, body in scene.body.items():
        for number, part in enumerate(body.outline):
            ends = [(s, *part.offset) for s in part.stations or ()] + list(part.points)
            found |= {f"body.{name}.outline.{number} ({i})": end for i, end in enumerate(ends)}
    return found


def _far_points(scene: Scene) -> Iterator[str]:
    """Points far from all others: millimetres taken for metres."""
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
                f"{name} = {_list(at[i])} m lies {beyond:.3g} m away from all else, which takes "
                f"{extent:.3g} m: is it in another unit?"
            )


def _outside(scene: Scene) -> Iterator[str]:
    """Centres of mass far beside the axis, or a vehicle's length beyond the body's own outline."""
    stations = [point[0] for point in _points(scene).values()]
    length = max(max(stations) - min(stations), 1e-3)
    for name, body in scene.body.items():
        aside = math.hypot(body.cg[1], body.cg[2])
        if aside > _BESIDE * length:
            yield (
                f"body.{name}.cg = {_list(body.cg)} m is {aside:.3g} m beside the axis of a "
                f"vehicle of {length:.3g} m: is it in another unit?"
            )


def _wide_laws(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Laws as wide as their nominal."""
    for law in dispersions:
        path = law.parameter.path
        is_signed = path.startswith("load.") or any(part in path for part in _SIGNED)
        if is_signed or law.distribution in ("discrete", "constant"):
            continue
        nominal = value(scene, path) / law.parameter.factor
        low, high = law.reach
        if nominal and math.isfinite(nominal) and high - low > 2.0 * _WIDE * abs(nominal):
            yield (
                f"dispersion of {law.sentence}: reaches {low:.4g} to {high:.4g} about a nominal of "
                f"{nominal:.4g}; a share of 5 % is 0.05 with relative = true"
            )


def _weights(dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Weights that look like probabilities and do not add up to 1."""
    for law in dispersions:
        whole = sum(law.weights)
        if law.weights and max(law.weights) < 1.0 and abs(whole - 1.0) > _ROUNDED:
            shares = ", ".join(f"{weight / whole:.3g}" for weight in law.weights)
            yield (
                f"dispersion of {law.sentence}: the weights add up to {whole:.4g}, so that the "
                f"probabilities are {shares}; is that meant?"
            )


def _tails(dispersions: Sequence[Dispersion], cases: int) -> Iterator[str]:
    """Normal laws that are not cut, of which some of the cases have what may not be."""
    for law in dispersions:
        share, nearest = law.beyond() if law.has_tails else (0.0, math.inf)
        if share * cases >= _EXPECTED:
            count = share * cases
            yield (
                f"dispersion of {law.sentence}: about {count:{'.0f' if count >= 100.0 else '.2g'}} "
                f"of {cases} cases have a value, {nearest:.3g} sigma or more off the mean, that "
                "the key may not have, and are not flown (invalid-input): cut the law by "
                "truncate_sigma"
            )


def _start(scene: Scene) -> Iterator[str]:
    """Speeds, heights and dynamic pressures of no such flight."""
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
    """Outlines that lie in each other before anything moves."""
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
    """How deep rims or points of a part lie within a solid frustum, or beyond a hollow one's wall;
    0 if they do not."""
    if solid.stations is None or solid.radii is None or part.hollow:
        return 0.0
    at = np.array([*part.points, *_rims(part)])
    (front, aft), (first, second) = solid.stations, solid.radii
    if aft == front:
        return 0.0
    share = (at[:, 0] - front) / (aft - front)
    radius = first + share * (second - first)
    aside = np.hypot(at[:, 1] - solid.offset[0], at[:, 2] - solid.offset[1])
    along = np.minimum(share, 1.0 - share) * abs(aft - front)
    if solid.hollow:
        through = aside - radius
        return float(np.where((along > 0.0) & (through < 0.1 * radius), through, 0.0).max())
    return float(np.minimum(along, radius - aside).max())


def _rims(part: Part) -> Iterator[tuple[float, float, float]]:
    for station, radius in zip(part.stations or (), part.radii or (), strict=True):
        for angle in _ROUND:
            y, z = part.offset
            yield station, y + radius * math.cos(angle), z + radius * math.sin(angle)


def _springs(scene: Scene) -> Iterator[str]:
    """Springs that push their second body toward the first, or pull it there."""
    for spring in scene.spring:
        if spring.axis is None or GROUND in spring.bodies or spring.force == 0.0:
            continue
        joints = (j for j in scene.joint.values() if set(j.bodies) == set(spring.bodies))
        if any(joint.apart is not None for joint in joints):  # the file says where they part to
            continue
        first, second = (np.array(scene.body[name].cg) for name in spring.bodies)
        apart = (second - first) * (-1.0, 1.0, 1.0)  # stations count aft, x points forward
        axis = np.array(spring.axis)
        size = float(np.linalg.norm(apart) * np.linalg.norm(axis))
        if size and np.sign(spring.force) * float(apart @ axis) < _AGAINST * size:
            what, does = f"axis = {_list(spring.axis)}", "pushes"
            if spring.force < 0.0:
                what, does = f"force = {spring.force:g} N", "pulls"
            yield (
                f"spring.{spring.name}.{what} {does} {spring.bodies[1]} "
                f"toward {spring.bodies[0]}: is it the other way round?"
            )


def _pulls(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Pushers that pull before their stroke is over, as they are or at the end of a law."""
    laws = {d.parameter.path: d for d in dispersions}
    for spring in scene.spring:
        place = f"spring.{spring.name}"
        if spring.force <= 0.0 or math.isinf(spring.stroke):
            continue
        usual = {"force": spring.force, "stiffness": spring.stiffness, "stroke": spring.stroke}
        tries: list[tuple[str, dict[str, float]]] = [("", usual)]
        for key, end in (("force", 0), ("stiffness", 1), ("stroke", 1)):
            law = laws.get(f"{place}.{key}")
            if law is not None:
                worst = law.reach[end] * law.parameter.factor
                tries.append((f", at the end of its law for {key}", usual | {key: worst}))
        for where, of in tries:
            pull = of["stiffness"] * of["stroke"] - of["force"]
            if pull > _PULL * spring.force:
                yield (
                    f"{place} pulls with {pull:.4g} N before its stroke is over{where}: force_N = "
                    f"{of['force']:.4g} less stiffness_N_per_m = {of['stiffness']:.4g} times "
                    f"stroke_m = {of['stroke']:.4g}; one that fails has factor = 0"
                )
                break


def _wind(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Wind that nothing feels."""
    wind = scene.environment.wind
    blows = wind.speed > 0.0 or wind.profile is not None
    blows = blows or any(d.parameter.path == "environment.wind.speed" for d in dispersions)
    if not blows:
        return
    if scene.environment.atmosphere == "none":
        yield "environment.wind does nothing: environment.atmosphere is 'none'"
    elif all(body.aerodynamics is None for body in scene.body.values()):
        yield "environment.wind does nothing: no body has aerodynamics"


def _late_thrust(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Thrust profiles whose first row comes after the ignition."""
    varied = {d.parameter.path for d in dispersions}
    for motor in scene.motor:
        place, profile = f"motor.{motor.name}", motor.profile
        if profile is None or not profile.time[0] > 0.0:
            continue
        first, share = profile.time[0], profile.fraction[0]
        if motor.burn <= first and f"{place}.burn" not in varied:
            yield (
                f"{place} does nothing: burn_s = {motor.burn:g}, but its profile begins {first:g} "
                "s after the ignition"
            )
            continue
        then = f", then {share:g} of thrust_N at once" if share else ""
        yield (
            f"{place}.profile begins {first:g} s after the ignition: there is no thrust "
            f"before{then}"
        )


def _never(scene: Scene, dispersions: Sequence[Dispersion]) -> Iterator[str]:
    """Outputs and clearances that wait for a joint that is never let go, conditions on a spring
    that never ends."""
    varied = {d.parameter.path for d in dispersions}
    waiting = [(f"phase.{p.name}.until", p.until) for p in scene.phase if p.until is not None]
    waiting += [(f"release.{r.name}.when", r.when) for r in scene.release]
    waiting += [(f"event.{e.name}.when", e.when) for e in scene.event]
    for place, condition in waiting:
        for name in _springs_of(condition):
            spring = next(one for one in scene.spring if one.name == name)
            if math.isinf(spring.stroke) and f"spring.{name}.stroke" not in varied:
                yield f"{place}: spring {name} has no stroke_m, so it pushes on and never ends"
    for place, condition in waiting:
        if _is_past(condition, scene.run.end_time) and f"{place}.time" not in varied:
            yield f"{place}: comes after the end of the flight, {scene.run.end_time:g} s"
    last = scene.phase[-1].joints
    let_go = {name for name in scene.joint if last.get(name, "free") == "free"}
    let_go |= {release.joint for release in scene.release}
    for joint in scene.output.tip_off:
        if joint not in let_go:
            yield f"output.tip_off: {joint} is never let go, so its rates then have no value"
    for clearance in scene.clearance:
        if clearance.after is not None and clearance.after not in let_go:
            yield (
                f"clearance.{clearance.name}.after: {clearance.after} is never let go, so the "
                "clearance has no value"
            )
    held = {name for phase in scene.phase for name, kind in phase.joints.items() if kind != "free"}
    for joint in scene.output.loads:
        if joint not in held:
            yield f"output.loads: {joint} holds nothing in any phase, so it carries nothing"


def _is_past(until: Condition, end: float) -> bool:
    """Whether a condition can be met by nothing but a time after ``end``, s."""
    if until.all:
        return any(_is_past(part, end) for part in until.all)
    if until.any:
        return all(_is_past(part, end) for part in until.any)
    return until == Condition(time=until.time) and until.time is not None and until.time > end


def _springs_of(until: Condition) -> Iterator[str]:
    if until.spring is not None:
        yield until.spring
    for part in (*until.any, *until.all):
        yield from _springs_of(part)


def _list(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{x:.4g}" for x in numbers) + "]"
