"""Cases as arrays, a row each: the inputs of every engine before the clock starts.

The engines of the race run one kind of scene, the two-stage separation of ``table1`` and
``table2``: two bodies, one joint that is fixed until a time, a slider until a stroke and then free,
one motor that burns throughout, polynomial aerodynamics and a steady wind.
"""

import itertools
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from oracles.engine_race.vectors import Array, attitude, cross
from sepmc.campaign.cases import sample
from sepmc.scene import parameters
from sepmc.scene.messages import InputError
from sepmc.scene.model import Condition

SCENES = (
    "table1 and table2: two bodies, one joint fixed, slider, free; one motor, no springs, "
    "loads, tables or releases"
)
COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")
TERMS = (
    "const",
    "alpha",
    "alpha2",
    "alpha3",
    "alpha4",
    "alpha5",
    "beta",
    "beta2",
    "beta3",
    "beta4",
    "beta5",
)


@dataclass(frozen=True)
class BodyRows:
    """One body over the cases. ``polynomials`` (6, 11): `COEFFICIENTS` by `TERMS`; ``arm``: from
    the mass centre to the joint."""

    name: str
    mass: Array
    inertia: Array  # (n, 3), principal, kg m2
    arm: Array  # (n, 3), m, body axes
    place: Array  # (n, 3), of the mass centre from that of the mated vehicle
    area: Array
    length: Array
    force_factor: Array
    moment_factor: Array
    polynomials: dict[str, dict[str, float]]
    # (n, 6): force, N, and moment, N m, at full thrust
    thrust: Array = field(default_factory=lambda: np.zeros((0, 6)))

    def coefficients(self) -> Array:
        """Polynomials as an array (6, 11), 0 for absent terms."""
        return np.array([[self.polynomials[c].get(t, 0.0) for t in TERMS] for c in COEFFICIENTS])


@dataclass(frozen=True)
class Inputs:
    """``first`` carries the joint axes. SI, radians; positions and velocities in a frame that moves
    with the initial ``velocity``."""

    count: int
    first: BodyRows
    second: BodyRows
    build_up: float
    unlock: Array  # s
    stroke: Array  # m
    apart: float
    end: float
    altitude: Array
    velocity: Array
    wind: Array
    R: Array
    omega: Array
    density_factor: Array
    surface_gravity: Array
    path_reference: Array

    def part(self, first: int, end: int) -> "Inputs":
        """Cases ``first`` to ``end``."""
        return _part(self, first, min(end, self.count), self.count)

    def shares(self, count: int) -> list["Inputs"]:
        """All cases in ``count`` nearly equal parts."""
        edges = np.linspace(0, self.count, min(count, self.count) + 1).astype(int)
        return [self.part(int(a), int(b)) for a, b in itertools.pairwise(edges)]

    @property
    def bodies(self) -> tuple[BodyRows, BodyRows]:
        """Both bodies, ``first`` before ``second``."""
        return self.first, self.second


def _part(rows: Any, first: int, end: int, of: int) -> Any:
    values = {f.name: getattr(rows, f.name) for f in fields(rows)}
    shorter = {
        k: v[first:end] for k, v in values.items() if isinstance(v, np.ndarray) and len(v) == of
    }
    shorter |= {k: _part(v, first, end, of) for k, v in values.items() if isinstance(v, BodyRows)}
    return replace(rows, **shorter, **({"count": end - first} if "count" in values else {}))


class _Values:
    """SI values of a campaign's cases by path: sampled where dispersed, else of the nominal
    case."""

    def __init__(self, campaign: Any, count: int):
        rows = (
            sample(campaign.file.dispersions, campaign.scene.run.seed, 0, count) * campaign.factors
        )
        self.scene, self.count = campaign.nominal().scene, count
        self.drawn = {d.parameter.path: rows[:, i] for i, d in enumerate(campaign.file.dispersions)}
        self.asked: set[str] = set()

    def __call__(self, path: str) -> Array:
        self.asked.add(path)
        return (
            self.drawn[path]
            if path in self.drawn
            else np.full(self.count, parameters.value(self.scene, path))
        )

    def vector(self, path: str, parts: str = "xyz") -> Array:
        """Values of the parts of a path, (n, 3) for x, y, z."""
        return np.stack([self(f"{path}.{p}") for p in parts], axis=-1)


def check(scene: Any) -> None:
    """Raise ValueError if the engines of the race do not run the scene."""
    kinds = [list(p.joints.values()) for p in scene.phase]
    plain = (
        len(scene.body) == 2
        and len(scene.joint) == 1
        and len(scene.motor) == 1
        and kinds == [["fixed"], ["slider"], []]
    )
    plain = plain and not (
        scene.spring
        or scene.load
        or scene.proximity
        or scene.release
        or scene.clearance
        or scene.driven
    )
    if plain:
        (joint,), (motor,), (locked, guided, _) = scene.joint.values(), scene.motor, scene.phase
        air, until = scene.environment, (locked.until, guided.until)
        plain = (
            set(joint.bodies) == set(scene.body)
            and joint.x_axis == (1.0, 0.0, 0.0)
            and not (joint.delay or joint.fails or joint.guide or any(joint.omega))
        )
        plain = (
            plain
            and until[0].time is not None
            and until[1].stroke is not None
            and joint.second_point is None
        )
        plain = (
            plain
            and until[0] == Condition(time=until[0].time)
            and until[1] == Condition(joint=until[1].joint, stroke=until[1].stroke)
        )
        plain = (
            plain
            and air.atmosphere == "us1976"
            and air.gravity == "inverse-square"
            and air.wind.profile is None
        )
        plain = (
            plain
            and motor.profile is None
            and motor.burn > scene.run.end_time
            and motor.build_up > 0.0
            and (motor.ignition, motor.delay) == (0.0, 0.0)
        )
        for body in scene.body.values():
            aero = body.aerodynamics
            plain = (
                plain
                and aero is not None
                and aero.table is None
                and aero.moment_point is None
                and not any(body.inertia_products)
            )
            plain = plain and all(set(getattr(aero, c)) <= set(TERMS) for c in COEFFICIENTS)
    if not plain:
        raise InputError(f"the other engines of the bench fly scenes like {SCENES}")


def _body(value: _Values, name: str, point: Array, centre: Array) -> BodyRows:
    cg, path = value.vector(f"body.{name}.cg"), f"body.{name}"
    forward = np.array([-1.0, 1.0, 1.0])
    inertia = (
        np.stack([value(f"{path}.inertia.{a}{a}") for a in "xyz"], axis=-1)
        * value(f"{path}.inertia_factor")[:, None]
    )
    aero = value.scene.body[name].aerodynamics
    return BodyRows(
        name, value(f"{path}.mass"), inertia, (point - cg) * forward, (cg - centre) * forward,
        value(f"{path}.aerodynamics.reference_area"),
        value(f"{path}.aerodynamics.reference_length"),
        value(f"{path}.aerodynamics.force_factor"), value(f"{path}.aerodynamics.moment_factor"),
        {c: dict(getattr(aero, c)) for c in COEFFICIENTS}, _thrust(value, name, cg),
    )  # fmt: skip


def _thrust(value: _Values, name: str, cg: Array) -> Array:
    """Full force and moment of the motor on a body, zero for other bodies; CONVENTIONS.md,
    Motor."""
    (motor,) = value.scene.motor
    if motor.body != name:
        return np.zeros((value.count, 6))
    path = f"motor.{motor.name}"
    cant, clock, b, p, radius = (
        value(f"{path}.{k}") for k in ("cant", "clock", "deflection", "deflection_clock", "radius")
    )
    zero = np.zeros_like(cant)
    x = np.stack(
        [np.cos(cant), -np.sin(clock) * np.sin(cant), np.cos(clock) * np.sin(cant)], axis=-1
    )
    y = np.stack([zero, np.cos(clock), np.sin(clock)], axis=-1)
    line = (
        np.cos(b)[:, None] * x
        - (np.sin(b) * np.sin(p))[:, None] * y
        + (np.sin(b) * np.cos(p))[:, None] * cross(x, y)
    )
    offset = value.vector(f"{path}.offset", "yz")
    place = np.stack(
        [
            -value(f"{path}.station"),
            offset[:, 0] - radius * np.sin(clock),
            offset[:, 1] + radius * np.cos(clock),
        ],
        axis=-1,
    )
    arm = place - cg * np.array([-1.0, 1.0, 1.0])
    return np.concatenate([line, cross(arm, line)], axis=-1) * value(f"{path}.thrust")[:, None]


def read(campaign: Any, count: int) -> Inputs:
    """First ``count`` cases of a campaign. Raises ValueError if the engines of the race do not run
    it."""
    scene = campaign.scene
    check(scene)
    value = _Values(campaign, count)
    ((name, joint),) = campaign.nominal().scene.joint.items()
    locked, guided, _ = scene.phase
    masses, centres = zip(
        *((value(f"body.{b}.mass"), value.vector(f"body.{b}.cg")) for b in joint.bodies),
        strict=True,
    )
    centre = (masses[0][:, None] * centres[0] + masses[1][:, None] * centres[1]) / (
        masses[0] + masses[1]
    )[:, None]
    point = value.vector(f"joint.{name}.point")
    pitch, sigma, speed = value("initial.pitch"), value("initial.path_yaw"), value("initial.speed")
    theta = pitch - value("initial.alpha")
    path = np.stack(
        [np.cos(theta) * np.cos(sigma), np.sin(theta) * np.cos(sigma), -np.sin(sigma)], axis=-1
    )
    wind, to = value("environment.wind.speed"), value("environment.wind.direction")
    first, second = (_body(value, b, point, centre) for b in joint.bodies)
    inputs = Inputs(
        count,
        first,
        second,
        build_up=scene.motor[0].build_up,
        unlock=value(f"phase.{locked.name}.until.time"),
        stroke=value(f"phase.{guided.name}.until.stroke"),
        apart=joint.apart,
        end=scene.run.end_time,
        altitude=value("initial.altitude"),
        velocity=speed[:, None] * path,
        wind=np.stack([wind * np.cos(to), 0.0 * wind, wind * np.sin(to)], axis=-1),
        R=attitude(pitch, value("initial.yaw"), value("initial.roll")),
        omega=value.vector("initial.omega"),
        density_factor=value("environment.density_factor"),
        surface_gravity=value("environment.surface_gravity"),
        path_reference=value("initial.path_reference"),
    )
    unread = set(value.drawn) - value.asked
    if unread:
        raise InputError(f"the other engines of the bench cannot vary {', '.join(sorted(unread))}")
    return inputs
