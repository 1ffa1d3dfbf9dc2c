"""The loads on every body at a state of a phase: force in ground axes, moment in body axes."""

import math
from dataclasses import dataclass, field
from typing import Any

from sepmc.kernel.emit.context import (
    Context,
    component,
    height,
    level,
    reject_unless,
    rejection_unless,
)
from sepmc.kernel.emit.geometry import Line, State
from sepmc.kernel.emit.ignition import lights
from sepmc.kernel.emit.tables import looks_up
from sepmc.kernel.spec.kernel_spec import stroke_flag
from sepmc.kernel.spec.packing import aero_terms
from sepmc.kernel.spec.variant import Variant
from sepmc.kernel.tracer.formulas import ZERO, air, loads, scalar, vec3, vehicle
from sepmc.kernel.tracer.text import Text
from sepmc.kernel.tracer.tracer import Expr, total, where
from sepmc.routines import layout as at
from sepmc.scene.model import GROUND, Motor, Spring
from sepmc.schema import Status

_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")


@dataclass
class _Loads:
    """Terms of force and moment in body axes, and of force in ground axes."""

    forces: list[Any] = field(default_factory=list)
    moments: list[Any] = field(default_factory=list)
    on_ground_axes: list[Any] = field(default_factory=list)


def body_loads(s: State, rubs: bool = True) -> tuple[dict[str, Any], dict[str, Any]]:
    """Force and moment on every body; with the friction of guides, which has to be known, if it
    ``rubs``."""
    scene, found = s.spec.scene, {body: _Loads() for body in s.spec.bodies}
    for body, acting in found.items():
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
        _spring(s, spring, i, found)
    for joint in s.spec.friction_joints(s.segment) if rubs else []:
        s.scope.comment(f"friction of {joint}")
        push = (s.case.separation_sign(joint) * s.friction(joint)).called("rub")
        _push_apart(s, scene.joint[joint].bodies, s.separation(joint), push, found)
    s.scope.comment("sums of loads")
    force = {body: _force(s, body, acting) for body, acting in found.items()}
    return force, {body: add_all(acting.moments) for body, acting in found.items()}


def add_all(vectors: list[Any]) -> Any:
    """Sum of vectors; zero if there are none."""
    there = [vector for vector in vectors if vector is not ZERO]
    found = there[0] if there else ZERO
    for vector in there[1:]:
        found = vec3.add(found, vector)
    return found


def _force(s: State, body: str, acting: _Loads) -> Any:
    """All force on a body, ground axes, its weight along y."""
    terms = list(acting.on_ground_axes)
    if acting.forces:
        terms.insert(0, vec3.rotate(s.attitude(body), add_all(acting.forces)))
    force, weight = add_all(terms), _weight(s, body)
    return (
        (force[0], force[1] - weight if terms else -weight, force[2])
        if weight is not None
        else force
    )


def _rise(s: State, body: str) -> tuple[Expr, Expr]:
    """Rise, m, above the height about which air and gravity are expanded, and its share of the
    distance there from the earth's centre."""
    rise = (
        s.place(body)[1] + (level(s.scope, s.time) - s.scope.load(f"AIR_CENTRE_{body}"))
    ).called("rise")
    return rise, (rise * s.scope.load(component(f"AIR_CENTRE_{body}", 1))).called("share")


_BORDER = 1e-6  # m


def emit_recentre_air(out: Text, c: Context) -> None:
    """A function that expands density and gravity anew for bodies that have left the height about
    which they were expanded."""
    bodies = [body for body in c.spec.bodies if c.spec.in_layers(body)]
    if not bodies:
        return
    says = (
        "Expand density and gravity about the height of every body that is further than "
        "``far`` metres from where they were last."
    )
    text = out.function("recentre_air(w, far: float)", says)
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
            reached = air.geopotential(centre).called("reached")
            reject_unless(
                scope,
                (reached >= scope.load("AIR")) & (reached <= scope.load("AIR_TOP")),
                Variant.ANY_ORDER,
            )
    scope.write(text)


def emit_layers(out: Text, c: Context) -> None:
    """A function by which bodies enter layers of the standard atmosphere. Their borders are met
    this side and beyond by `_BORDER`, so that a body that has just passed one is not at it; one
    that starts on a border flies in the layer that it goes to."""
    text = out.function(
        "enter_layers(w)",
        "Let bodies that pass a border of their layer of air fly in the next, if there is one.",
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
    """Aerodynamic force and moment at the angles of the flow."""
    case, p = s.case, s.case.body(body)
    flow = vec3.unrotate(s.attitude(body), vec3.add(s.speed(body), s.stream(body))).called("flow")
    alpha, beta = loads.flow_angles(flow).called("angles")
    pressure = (_density(s, body) * vec3.dot(flow, flow)).called("pressure")
    named = _coefficients(s, body, alpha, beta)
    if looks_up(s.spec, body):
        named = [
            value + s.scope.load(component(f"LOOKED_UP_{body}", k)) for k, value in enumerate(named)
        ]
    scale = 0.5 * case.number(at.DENSITY_FACTOR) * case.number(p + at.AREA)
    of_force = (scale * case.number(p + at.FORCE_FACTOR)).called("force_scale")
    force = loads.aero_force(pressure * of_force, tuple(named[:3])).called("push")
    acting.forces.append(force)
    if any(isinstance(value, Expr) for value in named[3:]):
        of_moment = (scale * case.number(p + at.LENGTH) * case.number(p + at.MOMENT_FACTOR)).called(
            "moment_scale"
        )
        acting.moments.append(loads.aero_moment(pressure * of_moment, tuple(named[3:])))
    aero = s.spec.scene.body[body].aerodynamics
    if aero is not None and aero.moment_point is not None:
        arm = vehicle.arm(case.centre_of_mass(body), case.vector(p + at.MOMENT_POINT)).called(
            "air_arm"
        )
        acting.moments.append(vec3.cross(arm, force))


def _density(s: State, body: str) -> Expr:
    """Density of the air around a body."""
    if not s.spec.in_layers(body):
        return scalar.exponential(s.scope.load(f"AIR_OF_{body}")).called("density")
    rise, share = _rise(s, body)
    higher = air.geopotential_rise(rise, share, s.scope.load(component(f"AIR_CENTRE_{body}", 2)))
    return air.density_near(s.scope.load(f"DENSITY_{body}", 9), higher).called("density")


def _coefficients(s: State, body: str, alpha: Expr, beta: Expr) -> list[Any]:
    """The six coefficients, polynomials in the angles of the flow, multiplied out as they stand;
    0.0 where there is no term."""
    terms: dict[int, list[Expr]] = {code: [] for code in range(6)}
    for k, term in enumerate(aero_terms(s.spec.scene)):
        if term.body == body:
            value = s.case.number(int(s.c.model.terms_p) + k)
            for angle, power in ((alpha, term.alpha), (beta, term.beta)):
                if power:
                    value = value * _power(angle, power)
            terms[term.coefficient].append(value)
    return [
        total(terms[code]).called(name) if terms[code] else 0.0
        for code, name in enumerate(_COEFFICIENTS)
    ]


def _power(x: Expr, n: int) -> Expr:
    return x if n == 1 else _power(x, n - 1) * x


def _motor(s: State, motor: Motor, i: int, acting: _Loads) -> None:
    """Thrust along a line that stays: build-up, and with switches the profile and the tail-off."""
    case, scope, name = s.case, s.scope, motor.name
    p = int(s.c.model.motors_p) + at.MOTOR_SIZE * i
    line = loads.thrust_direction(
        *(case.number(p + k) for k in (at.CANT, at.CLOCK, at.DEFLECTION, at.DEFLECTION_CLOCK))
    ).called("line")
    point = (
        case.number(p + k) for k in (at.STATION, at.RADIUS, at.CLOCK, at.OFFSET, at.OFFSET + 1)
    )
    turn = vec3.cross(loads.thrust_arm(case.centre_of_mass(motor.body), *point), line).called(
        "turn"
    )
    full, build_up = case.number(p + at.THRUST), case.number(p + at.BUILD_UP)
    rate = where(build_up > 0.0, 1.0 / build_up, 0.0).called("building")

    def level(since: Expr) -> Expr:
        """Thrust some time after ignition, apart from the profile."""
        if not s.spec.may_occur(f"motor.{name}.build_up", motor.build_up > 0.0):
            return full
        built = loads.building_up(full, rate, since)
        return (
            where(rate > 0.0, built, full)
            if f"motor.{name}.build_up" in s.spec.dispersed
            else built
        )

    if not s.spec.load_switches:
        thrust = level(s.time).called("thrust")
    else:
        burning, share, slope = scope.load(f"BURNING_{name}", 3)
        if motor.trigger is not None:
            s.c.start(lights(name), math.inf)
            ignition = scope.load(lights(name))
        else:
            ignition = (case.number(p + at.IGNITION) + case.number(p + at.IGNITION_DELAY)).called(
                "ignition"
            )
        since = scalar.larger(s.time - ignition, 0.0).called("since")
        thrust = where(burning.equals(1.0), level(since) * (share + slope * since), 0.0)
        if s.spec.may_occur(f"motor.{name}.tail_off", motor.tail_off > 0.0):
            burn, tail = case.number(p + at.BURN), case.number(p + at.TAIL_OFF)
            left = level(burn) * share * loads.tail_off(scalar.larger(since - burn, 0.0), tail)
            thrust = where(burning.equals(2.0), left, thrust)
        thrust = thrust.called("thrust")
    acting.forces.append(vec3.scale(thrust, line))
    acting.moments.append(vec3.scale(thrust, turn))


def _load(s: State, i: int, acting: _Loads) -> None:
    """Constant force and moment, in body or ground axes."""
    load, p = s.spec.scene.load[i], int(s.c.model.loads_p) + at.LOAD_SIZE * i
    push: Any = s.case.vector(p + at.LOAD_FORCE)
    turn: Any = s.case.vector(p + at.LOAD_MOMENT)
    if s.spec.load_switches:
        acts = s.scope.load(f"ACTS_{load.name}")
        push, turn = vec3.scale(acts, push), vec3.scale(acts, turn)
    if load.frame == "ground":
        push, turn = (
            vec3.unrotate(s.attitude(load.body), push).called("push"),
            vec3.unrotate(s.attitude(load.body), turn),
        )
    acting.forces.append(push)
    acting.moments.append(turn)
    if load.point is not None:
        arm = vehicle.arm(
            s.case.centre_of_mass(load.body), s.case.vector(p + at.LOAD_POINT)
        ).called("load_arm")
        acting.moments.append(vec3.cross(arm, push))


def _weight(s: State, body: str) -> Any:
    """Weight of a body; None without gravity."""
    kind, case = s.spec.scene.environment.gravity, s.case
    if kind == "none":
        return None
    surface = case.number(at.SURFACE_GRAVITY)
    if kind != "inverse-square":
        return (case.mass(body) * surface).called("weight")
    if s.spec.in_layers(body):
        return loads.inverse_square_near(
            s.scope.load(component(f"AIR_CENTRE_{body}", 3)), _rise(s, body)[1]
        )
    return case.mass(body) * loads.inverse_square(
        surface, s.place(body)[1] + level(s.scope, s.time)
    )


def _spring(s: State, spring: Spring, i: int, found: dict[str, _Loads]) -> None:
    """Force along a spring's line on both of its bodies; none once its stroke is through."""
    p = int(s.c.model.springs_p) + at.SPRING_SIZE * i
    line = s.spring(spring)
    strengths = (s.case.number(p + k) for k in (at.SPRING_FORCE, at.STIFFNESS, at.DAMPING))
    push = getattr(loads, "springs.spring_force")(
        *strengths, line.length - s.spring_start(spring), line.rate
    )
    if s.spec.may_occur(f"spring.{spring.name}.factor", spring.factor != 1.0):
        push = s.case.number(p + at.SPRING_FACTOR) * push
    if s.spec.may_occur(f"spring.{spring.name}.stroke", math.isfinite(spring.stroke)):
        s.c.start(stroke_flag(spring.name), 0.0)
        push = where(s.scope.load(stroke_flag(spring.name)) > 0.0, 0.0, push)
    push = push.called("push")
    _push_apart(s, spring.bodies, line, push, found)


def _push_apart(
    s: State, bodies: tuple[str, str], line: Line, push: Expr, found: dict[str, _Loads]
) -> None:
    """A force on two bodies along a line, away from each other."""
    for body, signed, arm in zip(bodies, (-push, push), (line.arm_a, line.arm_b), strict=True):
        if body != GROUND:
            found[body].on_ground_axes.append(vec3.scale(signed, line.e))
            found[body].moments.append(vec3.scale(push, vec3.unrotate(s.attitude(body), arm)))
