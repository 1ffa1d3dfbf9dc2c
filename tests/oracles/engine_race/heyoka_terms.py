"""What heyoka's equations of all phases share: parameters, vectors of expressions, loads of a body,
and the motion of body axes."""

from dataclasses import dataclass, field
from typing import Any

import heyoka as hy
import numpy as np

from oracles.engine_race.air import atmosphere
from oracles.engine_race.inputs import COEFFICIENTS, TERMS, BodyRows, Inputs
from oracles.engine_race.vectors import Array
from oracles.external_engines import loads

KM = 1e-3


@dataclass
class Equations:
    """A phase: ``system`` of heyoka, its variables by name in order, and the parameters of all
    cases (p, n)."""

    inputs: Inputs
    rates: dict[str, Any] = field(default_factory=dict)
    parameters: list[Array] = field(default_factory=list)

    def par(self, values: Array) -> Any:
        """A parameter with a value per case; the same values make the same parameter."""
        values = np.broadcast_to(np.asarray(values, float), (self.inputs.count,))
        for i, known in enumerate(self.parameters):
            if np.array_equal(known, values):
                return hy.par[i]
        self.parameters.append(values)
        return hy.par[len(self.parameters) - 1]

    def pars(self, values: Array) -> list[Any]:
        """Parameters with a value per case, one for each component of values (n, k)."""
        return [self.par(v) for v in np.moveaxis(values, -1, 0)]

    @property
    def system(self) -> list[tuple[Any, Any]]:
        """Pairs of variable and rate, in order, as heyoka takes them."""
        return [(hy.expression(name), rate) for name, rate in self.rates.items()]

    def vector(self, name: str) -> list[Any]:
        """The variables x, y and z of a vector, by its name."""
        return [hy.expression(f"{name}{a}") for a in "xyz"]

    def derive(self, name: str, rates: Any) -> None:
        """Give the x, y and z variables of a vector their rates."""
        for a, rate in zip("xyz", rates, strict=True):
            self.rates[f"{name}{a}"] = rate


def times(a: Any, b: Any) -> Any:
    """Cross product a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a: Any, b: Any) -> Any:
    """Scalar product of two vectors."""
    return hy.sum([x * y for x, y in zip(a, b, strict=True)])


def plus(*parts: Any) -> Any:
    """Sum of vectors."""
    return [hy.sum(list(terms)) for terms in zip(*parts, strict=True)]


def scaled(factor: Any, a: Any) -> Any:
    """A vector times a factor."""
    return [factor * x for x in a]


def scaled_each(factors: Any, a: Any) -> Any:
    """A vector, each component times a factor of its own."""
    return [f * x for f, x in zip(factors, a, strict=True)]


def minus(a: Any) -> Any:
    """The opposite of a vector."""
    return scaled(-1.0, a)


def body_loads(
    eq: Equations, body: BodyRows, V: Any, height: Any, level: Any
) -> tuple[Any, Any, Any]:
    """Loads of a body that moves through the air with V, ``height`` above the centre of the Earth.

    Returns two functions, of its acceleration without gravity and of its moment about the mass
    centre over given numbers, so that a division by a mass or an inertia is one of parameters; and
    gravity.
    """
    inputs = eq.inputs
    base, a, b, power = atmosphere(inputs)
    u, v, w = V
    closeness = 1.0 / height
    flat = u * u + v * v
    alpha, beta = hy.atan(-1.0 * v / u), hy.atan(w / hy.sqrt(flat))
    q = (a + b * closeness) ** power * (flat + w * w)
    powers = {"const": q}
    for angle, name in ((alpha, "alpha"), (beta, "beta")):
        degrees = [
            int(t[len(name) :] or 1)
            for t in TERMS
            if t.startswith(name) and any(t in body.polynomials[c] for c in COEFFICIENTS)
        ]
        last = q
        for k in range(1, max(degrees, default=0) + 1):
            last = last * angle
            powers[name + (str(k) if k > 1 else "")] = last
    pressure = 0.5 * base * inputs.density_factor * body.area
    force, moment = pressure * body.force_factor, pressure * body.length * body.moment_factor

    def component(coefficient: str, sign: float, factor: Array, push: Array) -> Any:
        terms = [
            eq.par(sign * c * factor) * powers[t] for t, c in body.polynomials[coefficient].items()
        ]
        if np.any(push):
            terms.append(eq.par(push) * level)
        return hy.sum(terms)

    def accelerations() -> Any:
        signs = (("axial", -1.0), ("normal", 1.0), ("side", -1.0))
        return [
            component(c, s, force / body.mass, body.thrust[:, i] / body.mass)
            for i, (c, s) in enumerate(signs)
        ]

    def moments(over: Array) -> Any:
        """Components divided by ``over``, shape (n, 3)."""
        signs = (("roll", 1.0), ("yaw", -1.0), ("pitch", 1.0))
        return [
            component(c, s, moment / over[:, i], body.thrust[:, 3 + i] / over[:, i])
            for i, (c, s) in enumerate(signs)
        ]

    gravity = eq.par(inputs.surface_gravity * loads.EARTH_RADIUS**2) * (closeness * closeness)
    return accelerations, moments, gravity


def kinematics(eq: Equations, tag: str, D: Any, w: Any, acceleration: Any) -> None:
    """Rates of D, U, e and z from the acceleration of the mass centre, body axes."""
    U, e = eq.vector(f"U{tag}"), eq.vector(f"e{tag}")
    eq.derive(f"D{tag}", plus(acceleration, times(D, w)))
    eq.derive(f"U{tag}", times(U, w))
    eq.derive(f"e{tag}", times(e, w))
    eq.rates[f"z{tag}"] = eq.par(KM * eq.inputs.velocity[:, 1]) + KM * dot(e, D)


def thrust_level(eq: Equations) -> Any:
    """Share L of the full thrust, a variable; its rate, (1 - L) over the build-up time, is set."""
    level = hy.expression("L")
    eq.rates["L"] = 1.0 / eq.inputs.build_up + (-1.0 / eq.inputs.build_up) * level
    return level
