"""Mass properties, impulses and energies of a nominal scene: numbers to compare with a budget."""

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.scene.checks import inertia_tensor
from sepmc.scene.load_checks import SHORTEST
from sepmc.scene.model import Body, ForceTable, Motor, Scene, Spring

Array = np.ndarray
_EXTENSIONS = 2001  # of a spring that only pushes, at which its work is added up


@dataclass(frozen=True)
class MassProperties:
    """Mass properties of one body, or of several bodies locked to one rigid body.

    Attributes
    ----------
    mass : float
        kg.
    centre : ndarray (3,)
        Centre of mass in the layout: station aft from the nose, y up, z right, m.
    inertia : ndarray (3, 3)
        About the centre of mass, body axes, kg m2; products off the diagonal are negative
        integrals.
    """

    mass: float
    centre: Array
    inertia: Array

    @property
    def principal(self) -> tuple[Array, float]:
        """Principal moments (3,), kg m2, and the largest angle between a principal axis and the
        body axis nearest to it, rad.

        The moments are in the order of these body axes; rising if two axes have the same nearest
        one. The angle is 0 if all moments are equal.
        """
        moments, axes = np.linalg.eigh(self.inertia)
        order = np.argmax(np.abs(axes), axis=0)
        if len(set(order)) < 3:  # two are as near to one axis: in rising order
            return moments, math.acos(min(1.0, float(np.abs(axes).max(axis=0).min())))
        sorted_moments = np.empty(3)
        sorted_moments[order] = moments
        largest = float(np.abs(axes).max(axis=0).min())
        equal = np.ptp(moments) <= 1e-12 * moments.max()
        return sorted_moments, 0.0 if equal else math.acos(min(1.0, largest))


def of_body(body: Body) -> MassProperties:
    """Nominal mass properties of a body, with its ``inertia_factor``.

    Parameters
    ----------
    body : Body

    Returns
    -------
    MassProperties
    """
    return MassProperties(body.mass, np.array(body.cg), inertia_tensor(body))


def mated(scene: Scene) -> MassProperties:
    """Nominal mass properties of all bodies of a scene, locked to one rigid body.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    MassProperties
        with the common mass centre in the layout, and the inertia about it in body axes
    """
    parts = [of_body(body) for body in scene.body.values()]
    mass = sum(part.mass for part in parts)
    centre = sum((part.mass * part.centre for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        arm = (part.centre - centre) * (-1.0, 1.0, 1.0)  # stations count aft, x points forward
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassProperties(mass, centre, inertia)


def impulse(motor: Motor, end: float) -> float:
    """Total impulse of a motor at nominal values, from its ignition to its end, tail-off included.

    Parameters
    ----------
    motor : Motor
    end : float
        Longest burn time, s, of a motor without a profile: one that would burn longer, or without a
        burn time, is counted for this time and without tail-off.

    Returns
    -------
    float
        N s; the integral of ``thrust (1 - exp(-t / build_up)) profile(t)``, and the thrust at
        burn-out times ``tail_off``.
    """
    profile, build_up = motor.profile, motor.build_up
    burn = min(motor.burn, end if profile is None else profile.time[-1])
    rows = [(0.0, 1.0), (burn, 1.0)]
    if profile is not None:
        rows = list(zip(profile.time, profile.fraction, strict=True))
    total, last = 0.0, 0.0
    for (t0, f0), (t1, f1) in itertools.pairwise(rows):
        stop = min(t1, burn)
        if stop <= t0:
            break
        if t1 - t0 <= SHORTEST:  # a step
            last = f1
            continue
        slope = (f1 - f0) / (t1 - t0)
        total += _of_line(f0 - slope * t0, slope, t0, stop, build_up)
        last = f0 + slope * (stop - t0)
    if motor.burn <= burn or (profile is not None and math.isinf(motor.burn)):
        built = 1.0 - math.exp(-burn / build_up) if build_up > 0.0 else 1.0
        total += last * built * motor.tail_off
    return motor.thrust * total


def _of_line(level: float, slope: float, t0: float, t1: float, build_up: float) -> float:
    """Integral of (level + slope t) (1 - exp(-t / build_up)) from t0 to t1, s; times in s, level
    and slope in fractions of the thrust."""
    total = level * (t1 - t0) + slope * (t1 * t1 - t0 * t0) / 2.0
    if build_up <= 0.0:
        return total

    def missing(t: float) -> float:
        return -build_up * math.exp(-t / build_up) * (level + slope * (t + build_up))

    return total - (missing(t1) - missing(t0))


def energy(spring: Spring) -> float:
    """Work that a spring does from the start to the end of its stroke; without a stroke, to where
    its force is zero. A spring with a table has a stroke: reading a file sets it if it is missing.

    Parameters
    ----------
    spring : Spring

    Returns
    -------
    float
        J, times the spring's ``factor``, without damping. A negative force counts, unless the
        spring only pushes. Infinite if the spring has a force but neither a stroke nor a stiffness.
    """
    force, stroke = spring.force, spring.stroke
    if math.isinf(stroke):
        if force <= 0.0 and spring.push_only:
            return 0.0
        if spring.stiffness == 0.0:
            return math.inf if force else 0.0
        stroke = force / spring.stiffness
    extension = np.linspace(0.0, stroke, _EXTENSIONS)
    if spring.stiffness and 0.0 < force / spring.stiffness < stroke:
        extension = np.sort(np.append(extension, force / spring.stiffness))
    work = force * extension - spring.stiffness * extension * extension / 2.0
    work = work + _of_table(spring.table, extension)
    if spring.push_only:
        return spring.factor * float(np.maximum(np.diff(work), 0.0).sum())
    return spring.factor * float(work[-1])


def _of_table(table: ForceTable | None, extension: Array) -> Array | float:
    """Integral of the force of a table from extension 0 to each ``extension`` (n,), J (n,), while
    the extension grows (``return_factor`` does not count). No ``extension`` is negative. The force
    is constant before the first row and beyond the last. The result is 0 without a table."""
    if table is None:
        return 0.0
    (first, *_, last), force = table.extension, table.force
    start = max(first, 0.0)
    integral = _interpolant(table).antiderivative()
    within = integral(np.clip(extension, start, last)) - integral(start)
    before, beyond = np.minimum(extension, start), np.maximum(extension - last, 0.0)
    return np.asarray(force[0] * before + within + force[-1] * beyond)


def force_of_table(table: ForceTable | None, extension: Array) -> Array:
    """Force of a table at each ``extension`` (n,) while it grows, N (n,); constant beyond the rows.
    Zeros without a table."""
    if table is None:
        return np.zeros(len(extension))
    within = np.clip(extension, table.extension[0], table.extension[-1])
    return np.asarray(_interpolant(table)(within))


def _interpolant(table: ForceTable) -> Any:
    """Interpolant (scipy) of the force of a table, N, over extension, m, between its rows."""
    from scipy.interpolate import (  # noqa: PLC0415  (few scenes need it)
        CubicSpline,
        PchipInterpolator,
        make_interp_spline,
    )

    makers = {"cubic": CubicSpline, "monotone": PchipInterpolator}
    make = makers.get(table.interpolation, functools.partial(make_interp_spline, k=1))
    return make(table.extension, table.force)


def budget_lines(scene: Scene) -> Iterator[str]:
    """Yield lines of text on the mass properties, impulses and energies of a nominal scene.

    Parameters
    ----------
    scene : Scene

    Yields
    ------
    str
        First a line on the mass, mass centre and inertia of all bodies as one; then one on the
        principal inertia of each body, the impulse of each motor, and the energy of each spring for
        which it is finite.
    """
    whole = mated(scene)
    yield "mated        " + _sentence(whole)
    for name, body in scene.body.items():
        properties = of_body(body)
        moments, angle = properties.principal
        turned = f", axes turned by {math.degrees(angle):.3g} deg" if angle > 1e-9 else ""
        yield f"body         {name}: principal inertia {_list(moments)} kg m2{turned}"
    for motor in scene.motor:
        ends = motor.profile is not None or motor.burn <= scene.run.end_time
        until = "" if ends else f" in {scene.run.end_time:g} s"
        total = impulse(motor, scene.run.end_time)
        yield f"impulse      {motor.name}: {total:.6g} N s{until}"
    for spring in scene.spring:
        work = energy(spring)
        if math.isfinite(work):
            yield f"energy       {spring.name}: {work:.6g} J"


def _sentence(properties: MassProperties) -> str:
    inertia, centre = properties.inertia, properties.centre
    products = [-inertia[0, 1], -inertia[0, 2], -inertia[1, 2]]
    return (
        f"{properties.mass:.6g} kg, centre of mass {_list(centre)} m, inertia about it "
        f"{_list(np.diag(inertia))}, products {_list(products)} kg m2"
    )


def _list(numbers: Array | list[float]) -> str:
    return "[" + ", ".join(f"{x + 0.0:.5g}" for x in numbers) + "]"
