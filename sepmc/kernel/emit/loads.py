"""Loads on every body at a state, as expressions: the sum of the forces in ground axes, that of the
moments about the mass centre in body axes."""

import math
from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.context import (
    Context,
    component,
    height,
    origin_height,
    reject_unless,
    rejection_unless,
)
from sepmc.kernel.emit.geometry import Line, State
from sepmc.kernel.emit.ignition import ignition_time
from sepmc.kernel.emit.signals import number, signals_of, three_numbers
from sepmc.kernel.emit.tables import looks_up, table_derivatives, table_force
from sepmc.kernel.spec.kernel_spec import stroke_flag
from sepmc.kernel.spec.packing import aero_terms
from sepmc.kernel.spec.step_cells import has_unloading, unloading_path
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, air, loads, scalar, square_root, vec3, vehicle
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, total, where
from sepmc.physics.aerodynamics import STILL
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, RATES, Motor, Spring
from sepmc.schema import Status

_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")


@dataclass
class _Loads:
    """Terms of the load on a body, to be summed: ``forces``, N, and ``moments``, N m, in body axes,
    and ``ground_forces``, N, in ground axes."""

    forces: list[Any] = field(default_factory=list)
    moments: list[Any] = field(default_factory=list)
    ground_forces: list[Any] = field(default_factory=list)


def body_loads(s: State, with_friction: bool = True) -> tuple[dict[str, Any], dict[str, Any]]:
    """Force and moment of all loads (air, motors, constant loads, springs, friction, weight) on
    every moving body, without joint forces.

    Parameters
    ----------
    s : State
    with_friction : bool
        True to include the friction of guides, which must be in the field FRICTION then

    Returns
    -------
    force : dict of str to Expr
        by body, ground axes, N
    moment : dict of str to Expr
        by body, about its mass centre, body axes, N m
    """
    scene, loads_of = s.spec.scene, {body: _Loads() for body in s.spec.bodies}
    for body, acting in loads_of.items():
        if s.spec.feels_air(body):
            s.scope.comment(f"air on {body}")
            _air(s, body, acting)
        for i, motor in enumerate(scene.motor):
            if motor.body == body:
                s.scope.comment(f"motor {motor.name}")
                _motor(s, motor, i, acting)
        for i, load in enumerate(scene.load):
            if load.body == body:
                s.scope.comment(f"load {load.name}")
                _load(s, i, acting)
    for i, spring in enumerate(scene.spring):
        s.scope.comment(f"spring {spring.name}")
        _spring(s, spring, i, loads_of)
    for joint in s.spec.friction_joints(s.segment) if with_friction else []:
        s.scope.comment(f"friction of {joint}")
        force_along = (s.case.separation_sign(joint) * s.friction(joint)).called("friction")
        _add_pair(s, scene.joint[joint].bodies, s.separation(joint), force_along, loads_of)
    s.scope.comment("sums of loads")
    force = {body: _force(s, body, acting) for body, acting in loads_of.items()}
    return force, {body: vector_sum(acting.moments) for body, acting in loads_of.items()}


def vector_sum(vectors: list[Any]) -> Any:
    """Sum of vectors of three components; the object `ZERO` if all of them are `ZERO`, or there are
    none."""
    nonzero = [vector for vector in vectors if vector is not ZERO]
    result = nonzero[0] if nonzero else ZERO
    for vector in nonzero[1:]:
        result = vec3.add(result, vector)
    return result


def _force(s: State, body: str, acting: _Loads) -> Any:
    """Total force on a body, ground axes, N: the force terms of ``acting``, and its weight along
    -y."""
    terms = list(acting.ground_forces)
    if acting.forces:
        terms.insert(0, vec3.rotate(s.attitude(body), vector_sum(acting.forces)))
    force, weight = vector_sum(terms), _weight(s, body)
    return (
        (force[0], force[1] - weight if terms else -weight, force[2])
        if weight is not None
        else force
    )


def _height_above_centre(s: State, body: str) -> tuple[Expr, Expr]:
    """Height of a body minus the height about which its air density and weight are expanded, m; and
    the ratio of this difference to the distance of the expansion point from the centre of the
    earth."""
    rise = (
        s.position(body)[1] + (origin_height(s.scope, s.time) - s.scope.load(f"AIR_CENTRE_{body}"))
    ).called("rise")
    return rise, (rise * s.scope.load(component(f"AIR_CENTRE_{body}", 1))).called("ratio")


_BORDER = 1e-6  # m, hysteresis of layer borders


def emit_recentre_air(out: Text, c: Context) -> None:
    """Write the kernel function ``recentre_air(w, far)``, which expands air density and weight of
    each body in the standard atmosphere about its present height, where that is more than ``far``,
    m, from the height of the last expansion. Unless layer borders are events, it also leaves a case
    in which a body is outside its layer to the kernel variant ANY_ORDER. Nothing is written without
    such bodies."""
    bodies = [body for body in c.spec.bodies if c.spec.in_layers(body)]
    if not bodies:
        return
    docstring = (
        "Expand density and gravity about the height of every body that is more than ``far`` "
        "metres from the last expansion."
    )
    text = out.function("recentre_air(w, far: float)", docstring)
    scope, case = c.scope(), c.case
    if not c.spec.layer_borders:
        c.workspace.add("AIR", 4), c.workspace.add("AIR_TOP", 1)
    for body in bodies:
        near = f"AIR_CENTRE_{body}"
        # height, 1 / (R0 + height), R0 / (R0 + height), weight there
        c.workspace.add(near, 4), c.workspace.add(f"DENSITY_{body}", 9)
        case.scope.store(near, -math.inf)
        last = scope.load(near)
        now = height(scope, body).called("height")
        centre = where(scalar.abs(now - last) > scope.named("far"), now, last).called("height")
        inverse = (1.0 / (scope.named("R0") + centre)).called("inverse")
        scope.store(near, centre)
        scope.store(component(near, 1), inverse)
        scope.store(component(near, 2), scope.named("R0") * inverse)
        if c.spec.scene.environment.gravity == "inverse-square":
            scope.store(
                component(near, 3),
                case.mass(body) * loads.inverse_square(case.number(at.SURFACE_GRAVITY), centre),
            )
        scope.store(f"DENSITY_{body}", air.density_series(centre, scope.load(c.layer(body), 4)))
        if not c.spec.layer_borders:
            reached = air.geopotential(centre).called("geopotential")
            reject_unless(
                scope,
                (reached >= scope.load("AIR")) & (reached <= scope.load("AIR_TOP")),
                Variant.ANY_ORDER,
            )
    scope.write(text)


def emit_layers(out: Text, c: Context) -> None:
    """Write the kernel function ``enter_layers(w)``, which handles the bodies that have just
    crossed a border of their layer of the standard atmosphere: those whose field ENTERS is set.

    The function stores the data and borders of the layer that such a body moves into, found from
    its height and the sign of its vertical speed, and clears ENTERS. If the height is above or
    below the atmosphere, it ends the case (status outside-atmosphere). A border counts as crossed
    `_BORDER` beyond its height, so that a body that has just crossed it is not at it; a body that
    starts on a border belongs to the layer that it moves into.
    """
    text = out.function(
        "enter_layers(w)",
        "Move bodies that cross a border of their atmosphere layer into the next layer, if any.",
    )
    text = text.lanes()
    for body in c.spec.bodies:
        if c.spec.in_layers(body):
            layer, borders, flag = c.layer(body), f"BORDERS_{body}", f"ENTERS_{body}"
            (
                c.workspace.add(layer, 4),
                c.workspace.add(borders, 2),
                c.workspace.add(f"AIR_CENTRE_{body}", 4),
            )
            inner = text.block(f"if w[{flag} + l] > 0.0:")
            inner(
                f"height = w[Y + X_{body} + LANES + l] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + "
                "l] * w[T + l])"
            )
            inner(
                f"goes_on = {2.0 * _BORDER} if w[Y + V_{body} + LANES + l] + w[ORIGIN_CLIMB + l] "
                f">= 0.0 else -{2.0 * _BORDER}"
            )
            inner(
                "air, top = layer(height + goes_on)",
                f"put4(w, {layer} + l, air)",
                f"w[AIR_CENTRE_{body} + l], w[{flag} + l] = -math.inf, 0.0",
            )
            inner(
                f"w[{borders} + l], w[{borders} + LANES + l] = geometric(air[0]) - {_BORDER}, "
                f"geometric(top) + {_BORDER}"
            )
            inner(rejection_unless("0.0 <= height <= TOP", Status.OUTSIDE_ATMOSPHERE))


def _air(s: State, body: str, acting: _Loads) -> None:
    """Add the aerodynamic force and the moment about the mass centre, both in body axes, of a body
    that feels air (`feels_air`) to its load terms ``acting``."""
    case, p = s.case, s.case.body(body)
    flow = vec3.unrotate(s.attitude(body), vec3.add(s.velocity(body), s.stream(body))).called(
        "flow"
    )
    alpha, beta = loads.flow_angles(flow).called("angles")
    pressure = (air_density(s, body) * vec3.dot(flow, flow)).called("pressure")
    rates = _reduced_rates(s, body, flow)
    coefficients = _coefficients(s, body, alpha, beta, rates)
    if looks_up(s.spec, body):
        coefficients = [
            value + s.scope.load(component(f"LOOKED_UP_{body}", k))
            for k, value in enumerate(coefficients)
        ]
        for k, (_, code, rate) in enumerate(table_derivatives(s.spec, body), len(coefficients)):
            slope = s.scope.load(component(f"LOOKED_UP_{body}", k))
            coefficients[code] = coefficients[code] + slope * rates[rate]
    scale = 0.5 * case.number(at.DENSITY_FACTOR) * case.number(p + at.AREA)
    of_force = (scale * case.number(p + at.FORCE_FACTOR)).called("force_scale")
    force = loads.aero_force(pressure * of_force, tuple(coefficients[:3])).called("force")
    acting.forces.append(force)
    if any(isinstance(value, Expr) for value in coefficients[3:]):
        of_moment = (scale * case.number(p + at.LENGTH) * case.number(p + at.MOMENT_FACTOR)).called(
            "moment_scale"
        )
        acting.moments.append(loads.aero_moment(pressure * of_moment, tuple(coefficients[3:])))
    aero = s.spec.scene.body[body].aerodynamics
    if aero is not None and aero.moment_point is not None:
        arm = vehicle.arm(case.centre_of_mass(body), case.vector(p + at.MOMENT_POINT)).called(
            "air_arm"
        )
        acting.moments.append(vec3.cross(arm, force))


def air_density(s: State, body: str) -> Expr:
    """Expression of the air density at a body, kg/m3, without the density factor of the case."""
    if not s.spec.in_layers(body):
        return scalar.exponential(s.scope.load(f"AIR_OF_{body}")).called("density")
    rise, ratio = _height_above_centre(s, body)
    higher = air.geopotential_rise(rise, ratio, s.scope.load(component(f"AIR_CENTRE_{body}", 2)))
    return air.density_near(s.scope.load(f"DENSITY_{body}", 9), higher).called("density")


def _reduced_rates(s: State, body: str, flow: Any) -> dict[str, Any]:
    """Reduced angular rates of a body, by name (p, q, r): the rate times reference length over
    twice the airspeed, 0 in still air and for a body that is fixed to the ground; only those that
    its aerodynamic coefficients depend on.
    ``flow`` is the velocity relative to the air, body axes, m/s."""
    terms = {term.rate for term in aero_terms(s.spec.scene) if term.body == body and term.rate}
    needed = terms | {rate for _, _, rate in table_derivatives(s.spec, body)}
    leader = s.segment.leader(body)
    if not needed:
        return {}
    if leader == GROUND:
        return dict.fromkeys(needed, 0.0)
    speed = square_root(vec3.dot(flow, flow)).called("airspeed")
    length = s.case.number(s.case.body(body) + at.LENGTH)
    scale = where(speed > STILL, 0.5 * length / where(speed > STILL, speed, 1.0), 0.0)
    scale, omega = scale.called("rate_scale"), s.rate(leader)
    values = {"p": omega[0], "q": omega[2], "r": -omega[1]}
    return {
        rate: (scale * values[rate]).called(f"reduced_{rate}") for rate in RATES if rate in needed
    }


def _coefficients(s: State, body: str, alpha: Expr, beta: Expr, rates: dict[str, Any]) -> list[Any]:
    """Six aerodynamic coefficients of a body (axial, normal, side, roll, yaw, pitch) by their
    polynomials in flow angles, rad, reduced rates and signals, without tables; 0.0 for a
    coefficient without terms."""
    terms: dict[int, list[Expr]] = {code: [] for code in range(6)}
    for k, term in enumerate(aero_terms(s.spec.scene)):
        if term.body == body:
            value = s.case.number(int(s.c.model.terms_p) + k)
            for angle, power in ((alpha, term.alpha), (beta, term.beta)):
                if power:
                    value = value * _power(angle, power)
            if term.rate:
                value = value * rates[term.rate]
            if term.signal:
                value = value * signals_of(s).value(s.spec.names.of["signal"][term.signal])
            terms[term.coefficient].append(value)
    return [
        total(terms[code]).called(name) if terms[code] else 0.0
        for code, name in enumerate(_COEFFICIENTS)
    ]


def _power(x: Expr, n: int) -> Expr:
    """Power x^n, n >= 1, as a product."""
    return x if n == 1 else _power(x, n - 1) * x


def _motor(s: State, motor: Motor, i: int, acting: _Loads) -> None:
    """Add the force and moment of a motor, number ``i`` of the scene from 0, both in body axes, to
    the load terms ``acting`` of its body: the thrust with its build-up and, if loads switch on or
    off within a case (`KernelSpec.load_switches`), its ignition, profile, end of the burn and
    tail-off; if none does, the motor burns from the start to the end of the case."""
    case, scope, name, path = s.case, s.scope, motor.name, f"motor.{motor.name}"
    p = int(s.c.model.motors_p) + at.MOTOR_SIZE * i
    line = loads.thrust_direction(
        case.number(p + at.CANT),
        case.number(p + at.CLOCK),
        number(s, f"{path}.deflection", p + at.DEFLECTION),
        number(s, f"{path}.deflection_clock", p + at.DEFLECTION_CLOCK),
    ).called("line")
    point = (
        case.number(p + k) for k in (at.STATION, at.RADIUS, at.CLOCK, at.OFFSET, at.OFFSET + 1)
    )
    moment = vec3.cross(loads.thrust_arm(case.centre_of_mass(motor.body), *point), line).called(
        "moment"
    )
    full_thrust = number(s, f"{path}.thrust", p + at.THRUST)
    build_up = case.number(p + at.BUILD_UP)
    rate = where(build_up > 0.0, 1.0 / build_up, 0.0).called("building")

    def thrust_level(elapsed: Expr) -> Expr:
        """Thrust, N, at the time ``elapsed`` since ignition, s, with build-up, but without the
        profile, the end of the burn and the tail-off."""
        if not s.spec.may_occur(f"motor.{name}.build_up", motor.build_up > 0.0):
            return full_thrust
        built = loads.building_up(full_thrust, rate, elapsed)
        return (
            where(rate > 0.0, built, full_thrust)
            if f"motor.{name}.build_up" in s.spec.dispersed
            else built
        )

    if not s.spec.load_switches:
        thrust = thrust_level(s.time).called("thrust")
    else:
        burning, fraction, slope = scope.load(f"BURNING_{name}", 3)
        if motor.trigger is not None:
            s.c.start(ignition_time(name), math.inf)
            ignition = scope.load(ignition_time(name))
        else:
            ignition = (case.number(p + at.IGNITION) + case.number(p + at.IGNITION_DELAY)).called(
                "ignition"
            )
        elapsed = scalar.larger(s.time - ignition, 0.0).called("elapsed")
        thrust = where(
            burning.equals(1.0), thrust_level(elapsed) * (fraction + slope * elapsed), 0.0
        )
        if s.spec.may_occur(f"motor.{name}.tail_off", motor.tail_off > 0.0):
            burn, tail = case.number(p + at.BURN), case.number(p + at.TAIL_OFF)
            remaining = (
                thrust_level(burn)
                * fraction
                * loads.tail_off(scalar.larger(elapsed - burn, 0.0), tail)
            )
            thrust = where(burning.equals(2.0), remaining, thrust)
        thrust = thrust.called("thrust")
    acting.forces.append(vec3.scale(thrust, line))
    acting.moments.append(vec3.scale(thrust, moment))


def _load(s: State, i: int, acting: _Loads) -> None:
    """Add force and moment of a constant load, number ``i`` of the scene from 0, to the load terms
    ``acting`` of its body, both in body axes, those of ground axes turned into these."""
    load, p = s.spec.scene.load[i], int(s.c.model.loads_p) + at.LOAD_SIZE * i
    force: Any = three_numbers(s, f"load.{load.name}.force", p + at.LOAD_FORCE)
    moment: Any = three_numbers(s, f"load.{load.name}.moment", p + at.LOAD_MOMENT)
    if s.spec.load_switches:
        acts = s.scope.load(f"ACTS_{load.name}")
        force, moment = vec3.scale(acts, force), vec3.scale(acts, moment)
    if load.frame == "ground":
        force, moment = (
            vec3.unrotate(s.attitude(load.body), force).called("force"),
            vec3.unrotate(s.attitude(load.body), moment),
        )
    acting.forces.append(force)
    acting.moments.append(moment)
    if load.point is not None:
        arm = vehicle.arm(
            s.case.centre_of_mass(load.body), s.case.vector(p + at.LOAD_POINT)
        ).called("load_arm")
        acting.moments.append(vec3.cross(arm, force))


def _weight(s: State, body: str) -> Any:
    """Weight of a body at its present height, N; None without gravity."""
    kind, case = s.spec.scene.environment.gravity, s.case
    if kind == "none":
        return None
    surface = case.number(at.SURFACE_GRAVITY)
    if kind != "inverse-square":
        return (case.mass(body) * surface).called("weight")
    if s.spec.in_layers(body):
        return loads.inverse_square_near(
            s.scope.load(component(f"AIR_CENTRE_{body}", 3)), _height_above_centre(s, body)[1]
        )
    return case.mass(body) * loads.inverse_square(
        surface, s.position(body)[1] + origin_height(s.scope, s.time)
    )


def _spring(s: State, spring: Spring, i: int, loads_of: dict[str, _Loads]) -> None:
    """Add the force of a spring, number ``i`` of the scene from 0, along its line to the load terms
    of both of its bodies. It is zero after the end of its stroke; if the spring only pushes, a
    negative force counts as zero too."""
    force = spring_force(s, spring, i)
    path = f"spring.{spring.name}"
    if spring.push_only:
        force = scalar.larger(0.0, force)
    if s.spec.may_occur(f"{path}.stroke", math.isfinite(spring.stroke)):
        s.c.start(stroke_flag(spring.name), 0.0)
        force = where(s.scope.load(stroke_flag(spring.name)) > 0.0, 0.0, force)
    _add_pair(s, spring.bodies, s.spring(spring), force.called("force"), loads_of)


def spring_force(s: State, spring: Spring, i: int) -> Expr:
    """Force of a spring (number ``i`` of the scene, from 0) within its stroke, N, positive when it
    drives its bodies apart, with its table and factor; for a spring that only pushes, before
    negative forces are cut off."""
    p = int(s.c.model.springs_p) + at.SPRING_SIZE * i
    line = s.spring(spring)
    path = f"spring.{spring.name}"
    coefficients = (
        number(s, f"{path}.{key}", p + k)
        for key, k in (
            ("force", at.SPRING_FORCE),
            ("stiffness", at.STIFFNESS),
            ("damping", at.DAMPING),
        )
    )
    force = getattr(loads, "springs.spring_force")(
        *coefficients, line.length - s.spring_start(spring), line.rate
    )
    if spring.table is not None:
        force = force + s.scope.load(table_force(spring.name))
        if has_unloading(spring, s.spec.dispersed):
            lost = s.case.number(s.spec.layout.slots[unloading_path(spring.name)]) - 1.0
            force = force + lost * s.scope.load(component(table_force(spring.name), 1))
    if s.spec.may_occur(f"{path}.factor", spring.factor != 1.0):
        force = number(s, f"{path}.factor", p + at.SPRING_FACTOR) * force
    return force


def _add_pair(
    s: State, bodies: tuple[str, str], line: Line, force: Expr, loads_of: dict[str, _Loads]
) -> None:
    """Add a force between two bodies along a line, N, positive when it pushes the second body along
    the direction ``e`` of the line, to the load terms of both bodies: forces in ground axes,
    moments in body axes; the ground has none."""
    for body, signed_force, arm in zip(
        bodies, (-force, force), (line.arm_a, line.arm_b), strict=True
    ):
        if body != GROUND:
            loads_of[body].ground_forces.append(vec3.scale(signed_force, line.e))
            loads_of[body].moments.append(vec3.scale(force, vec3.unrotate(s.attitude(body), arm)))
