"""Lint of the layout: stations that count from the wrong end, mirrored bodies, short burns."""

import itertools
import math
from collections.abc import Iterator

from sepmc.scene.model import Body, Scene

_SAME = 1e-9  # relative difference of numbers that are the same


def lint_layout(scene: Scene) -> Iterator[str]:
    """Yield findings on stations, mirrored bodies and burns shorter than the build-up of a scene.

    Parameters
    ----------
    scene : Scene

    Yields
    ------
    str
        A sentence for each value that is probably a mistake.
    """
    yield from _stations(scene)
    yield from _mirrored(scene)
    for motor in scene.motor:
        thrusts = motor.profile is None or motor.burn > motor.profile.time[0]
        if thrusts and motor.burn < motor.build_up:
            reached = -math.expm1(-motor.burn / motor.build_up)
            yield (
                f"motor.{motor.name}: burn_s = {motor.burn:g} is shorter than build_up_s = "
                f"{motor.build_up:g}, a time constant: the thrust reaches {100.0 * reached:.2g} % "
                "only"
            )


def _stations(scene: Scene) -> Iterator[str]:
    """Yield a sentence if there are two bodies or more and the stations of all their mass centres
    are negative (some, but not all, may be 0), else one on each motor that would push a body
    forward from the front end of its outline: stations are then probably counted from the tail."""
    stations = [body.cg[0] for body in scene.body.values()]
    if len(stations) > 1 and max(stations) <= 0.0 and min(stations) < 0.0:
        yield (
            f"the stations of all mass centres are negative ({min(stations):.4g} to "
            f"{max(stations):.4g} m): stations count aft from the nose; are they reversed?"
        )
        return
    for motor in scene.motor:
        body = scene.body.get(motor.body)
        if body is None or math.cos(motor.cant) < 0.5:
            continue
        outline = [s for part in body.outline for s in part.stations or ()]
        if outline and motor.station <= min(outline) < body.cg[0]:
            yield (
                f"motor.{motor.name}.station = {motor.station:.4g} m pushes {motor.body} forward "
                f"from its front end: stations count aft from the nose; are they reversed?"
            )


def _mirrored(scene: Scene) -> Iterator[str]:
    """Yield a sentence on each pair of bodies that are mirror images of each other in y or in z (in
    mass, moments and mass centre), but whose products of inertia that a mirror turns have equal
    instead of opposite signs."""
    for (one, a), (two, b) in itertools.combinations(scene.body.items(), 2):
        if not (_same((a.mass,), (b.mass,)) and _same(a.inertia, b.inertia)):
            continue
        for axis, keys in ((1, ("xy", "yz")), (2, ("xz", "yz"))):
            if not _is_mirror(a, b, axis):
                continue
            signs = [-1.0 if key in keys else 1.0 for key in ("xy", "xz", "yz")]
            mirrored = tuple(s * x for s, x in zip(signs, a.inertia_products, strict=True))
            changed = any(
                x
                for key, x in zip(("xy", "xz", "yz"), a.inertia_products, strict=True)
                if key in keys
            )
            if changed and _same(a.inertia_products, b.inertia_products):
                yield (
                    f"body.{two} mirrors body.{one} in {'xyz'[axis]}, but its products of inertia "
                    f"{' and '.join(keys)} have the same sign: mirrored they would have the other"
                )
            elif _same(mirrored, b.inertia_products):
                break


def _is_mirror(a: Body, b: Body, axis: int) -> bool:
    """True if the mass centres of two bodies are mirror images in y (``axis`` 1) or z (2), off the
    plane of symmetry."""
    if a.cg[axis] == 0.0:
        return False
    image = tuple(-x if k == axis else x for k, x in enumerate(a.cg))
    return _same(image, b.cg)


def _same(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """True if the numbers of two tuples agree to 1e-9 of their largest magnitude."""
    size = max(map(abs, (*one, *other)))
    return all(abs(x - y) <= _SAME * size for x, y in zip(one, other, strict=True))
