"""Lines of a specialised kernel that sum up the loads on every body: force_<body> in ground axes, moment_<body> in body axes."""

import math

from sepmc.compiler.emit_context import Context, raw, raw3
from sepmc.compiler.emit_geometry import ZERO, Geometry, emit_spring_line
from sepmc.compiler.packing import aero_terms
from sepmc.compiler.shape import Shape
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND, Motor, Spring

_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")


def emit_loads(text: Text, g: Geometry) -> None:
    """All loads of a phase at a state whose attitudes, rates, places and speeds are local names."""
    scene = g.shape.scene
    for body in g.shape.bodies:
        force = _Sum(text, f"force_{body}")
        moment = _Sum(text, f"moment_{body}")
        if feels_air(g.shape, body):
            _rise(text, g, body)
            _air(text, g, body, force, moment)
        for i, motor in enumerate(scene.motor):
            if motor.body == body:
                _motor(text, g, motor, i, force, moment)
        for i, load in enumerate(scene.load):
            if load.body == body:
                _load(text, g, i, force, moment)
        moment.close()
        force.close()
        if force.given:
            text(f"force_{body} = vec3.rotate({g.attitude(body)}, force_{body})")
        _gravity(text, g, body)
    for i, spring in enumerate(scene.spring):
        _spring(text, g, spring, i)


def emit_load_parameters(c: Context) -> None:
    """Setting up of what several loads share."""
    if c.slabs.has("STREAM"):
        c.parameters("put3(w, STREAM + l, vec3.sub(velocity, stream))")
    if c.slabs.has("GRAVITY"):
        c.parameters(f"w[GRAVITY + l] = {raw(at.SURFACE_GRAVITY)}")


class _Sum:
    """A vector that starts as its first term."""

    def __init__(self, text: Text, name: str):
        self.text, self.name, self.given = text, name, False

    def add(self, term: str) -> None:
        """Add a term."""
        self.text(f"{self.name} = vec3.add({self.name}, {term})" if self.given else f"{self.name} = {term}")
        self.given = True

    def close(self) -> None:
        """After the last term: zero if there was none."""
        if not self.given:
            self.text(f"{self.name} = {ZERO}")


def feels_air(shape: Shape, body: str) -> bool:
    """Whether a body has aerodynamics, and air to fly in."""
    return shape.scene.environment.atmosphere != "none" and shape.scene.body[body].aerodynamics is not None


def _rise(text: Text, g: Geometry, body: str) -> None:
    """Local names rise_<body>, m, above the height about which air and gravity are expanded, and its share of the distance there."""
    text(f"rise_{body} = x_{body}[1] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * t - w[NEAR_{body} + l])")
    text(f"share_{body} = rise_{body} * w[NEAR_{body} + LANES + l]")


def emit_centre(out: Text, c: Context) -> None:
    """A function that expands density and gravity anew for bodies that have left the height about which they were expanded."""
    bodies = [body for body in c.shape.bodies if feels_air(c.shape, body)]
    if not bodies:
        return
    says = "Expand density and gravity about the height of every body that is further than ``far`` metres from where they were last."
    text = out.function("centre(w, far: float)", says).lanes()
    for body in bodies:
        c.slabs.add(f"NEAR_{body}", 4), c.slabs.add(f"DENSITY_{body}", 9)  # height, 1 / (R0 + height), R0 / (R0 + height), weight there
        c.parameters(f"w[NEAR_{body} + l] = -math.inf")
        text(f"height = w[Y + X_{body} + LANES + l] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * w[T + l])")
        text(f"height = height if abs(height - w[NEAR_{body} + l]) > far else w[NEAR_{body} + l]")
        text("inverse = 1.0 / (R0 + height)", f"w[NEAR_{body} + l], w[NEAR_{body} + LANES + l] = height, inverse")
        text(f"w[NEAR_{body} + 2 * LANES + l] = R0 * inverse")
        if c.shape.scene.environment.gravity == "inverse-square":
            text(f"w[NEAR_{body} + 3 * LANES + l] = w[MASS_{body} + l] * inverse_square(w[GRAVITY + l], height)")
        text(f"put9(w, DENSITY_{body} + l, density_series(height, get4(w, AIR + l)))", "level = geopotential(height)")
        text("w[LOST + l] = w[LOST + l] if level >= w[AIR + l] and level <= w[AIR_TOP + l] else 1.0")


def _air(text: Text, g: Geometry, body: str, force: _Sum, moment: _Sum) -> None:
    """Aerodynamic force and moment at the angles of the flow."""
    shape, slabs, parameters = g.shape, g.slabs, g.parameters
    slabs.add("STREAM", 3), slabs.add("AIR", 4), slabs.add("AIR_TOP", 1)
    p = at.HEAD + at.BODY_SIZE * shape.bodies.index(body)
    if slabs.add(f"FORCE_SCALE_{body}", 1):
        slabs.add(f"MOMENT_SCALE_{body}", 1)
        scale = f"0.5 * {raw(at.DENSITY_FACTOR)} * {raw(p + at.AREA)}"
        parameters(f"w[FORCE_SCALE_{body} + l] = {scale} * {raw(p + at.FORCE_FACTOR)}")
        parameters(f"w[MOMENT_SCALE_{body} + l] = {scale} * {raw(p + at.LENGTH)} * {raw(p + at.MOMENT_FACTOR)}")
    text(f"# air on {body}")
    text(f"flow = vec3.unrotate({g.attitude(body)}, vec3.add(v_{body}, get3(w, STREAM + l)))", "alpha, beta = flow_angles(flow)")
    text(
        f"density = density_near(get9(w, DENSITY_{body} + l), geopotential_rise(rise_{body}, share_{body}, w[NEAR_{body} + 2 * LANES + l]))"
    )
    text("pushing = density * vec3.dot(flow, flow)")
    named = _coefficients(text, g, body)
    text(f"push = aero_force(pushing * w[FORCE_SCALE_{body} + l], ({', '.join(named[:3])}))")
    force.add("push")
    if any(name != "0.0" for name in named[3:]):
        moment.add(f"aero_moment(pushing * w[MOMENT_SCALE_{body} + l], ({named[3]}, {named[4]}, {named[5]}))")
    aero = shape.scene.body[body].aerodynamics
    if aero is not None and aero.moment_point is not None:
        if slabs.add(f"AIR_ARM_{body}", 3):
            parameters(f"put3(w, AIR_ARM_{body} + l, arm(cg_{body}, {raw3(p + at.MOMENT_POINT)}))")
        moment.add(f"vec3.cross(get3(w, AIR_ARM_{body} + l), push)")


def _coefficients(text: Text, g: Geometry, body: str) -> list[str]:
    """Polynomials in the angles of the flow, multiplied out as they stand; returns the six names, "0.0" where there is no term."""
    terms: dict[int, list[str]] = {code: [] for code in range(6)}
    powers: set[tuple[str, int]] = set()
    for k, term in enumerate(aero_terms(g.shape.scene)):
        if term.body == body:
            name = "C_" + term.path.removeprefix("body.").replace(".aerodynamics.", "_").replace(".", "_").upper()
            if g.slabs.add(name, 1):
                g.parameters(f"w[{name} + l] = {raw(int(g.context.model.terms_p) + k)}")
            factors = [f"w[{name} + l]"]
            for angle, power in (("alpha", term.alpha), ("beta", term.beta)):
                if power:
                    factors.append(angle if power == 1 else f"{angle}{power}")
                    powers |= {(angle, n) for n in range(2, power + 1)}
            terms[term.coefficient].append(" * ".join(factors))
    for angle, n in sorted(powers):
        text(f"{angle}{n} = {angle if n == 2 else f'{angle}{n - 1}'} * {angle}")
    for code, name in enumerate(_COEFFICIENTS):
        if terms[code]:
            short = len(" + ".join(terms[code])) < 110
            text.wrapped(f"{name} = " if short else f"{name} = (", terms[code], "" if short else ")")
    return [name if terms[code] else "0.0" for code, name in enumerate(_COEFFICIENTS)]


def _motor(text: Text, g: Geometry, motor: Motor, i: int, force: _Sum, moment: _Sum) -> None:
    """Thrust along a line that stays: build-up, and with switches the profile and the tail-off."""
    name, slabs, parameters, switches = motor.name, g.slabs, g.parameters, g.shape.switches
    builds = g.shape.may(f"motor.{name}.build_up", motor.build_up > 0.0)
    always_builds = builds and f"motor.{name}.build_up" not in g.shape.dispersed
    tails = g.shape.may(f"motor.{name}.tail_off", motor.tail_off > 0.0)
    p = int(g.context.model.motors_p) + at.MOTOR_SIZE * i
    if slabs.add(f"THRUST_{name}", 1):
        slabs.add(f"LINE_{name}", 3), slabs.add(f"TURN_{name}", 3)
        angles = ", ".join(raw(p + place) for place in (at.CANT, at.CLOCK, at.DEFLECTION, at.DEFLECTION_CLOCK))
        point = ", ".join(raw(p + place) for place in (at.STATION, at.RADIUS, at.CLOCK, at.OFFSET, at.OFFSET + 1))
        parameters(f"w[THRUST_{name} + l], line = {raw(p + at.THRUST)}, thrust_direction({angles})")
        parameters(f"put3(w, LINE_{name} + l, line)")
        parameters(f"put3(w, TURN_{name} + l, vec3.cross(thrust_arm(cg_{motor.body}, {point}), line))")
        if builds:
            slabs.add(f"BUILDING_{name}", 1)
            parameters(f"w[BUILDING_{name} + l] = 1.0 / {raw(p + at.BUILD_UP)} if {raw(p + at.BUILD_UP)} > 0.0 else 0.0")
        if switches:
            slabs.add(f"IGNITION_{name}", 1)
            parameters(f"w[IGNITION_{name} + l] = {raw(p + at.IGNITION)} + {raw(p + at.IGNITION_DELAY)}")
            if tails:
                slabs.add(f"BURN_{name}", 1), slabs.add(f"TAIL_OFF_{name}", 1)
                parameters(f"w[BURN_{name} + l], w[TAIL_OFF_{name} + l] = {raw(p + at.BURN)}, {raw(p + at.TAIL_OFF)}")

    def level(since: str) -> str:
        """Thrust some time after ignition, apart from the profile."""
        full, built = f"w[THRUST_{name} + l]", f"building_up(w[THRUST_{name} + l], w[BUILDING_{name} + l], {since})"
        if always_builds:
            return built
        return f"({built} if w[BUILDING_{name} + l] > 0.0 else {full})" if builds else full

    text(f"# motor {name}")
    if not switches:
        text(f"thrust = {level('t')}")
    else:
        text(f"burning, share, slope = get3(w, BURNING_{name} + l)", f"since = larger(t - w[IGNITION_{name} + l], 0.0)")
        text(f"thrust = {level('since')} * (share + slope * since) if burning == 1.0 else 0.0")
        if tails:
            text(f"after = larger(since - w[BURN_{name} + l], 0.0)")
            text(f"left = {level(f'w[BURN_{name} + l]')} * share * tail_off(after, w[TAIL_OFF_{name} + l])")
            text("thrust = left if burning == 2.0 else thrust")
    force.add(f"vec3.scale(thrust, get3(w, LINE_{name} + l))")
    moment.add(f"vec3.scale(thrust, get3(w, TURN_{name} + l))")


def _load(text: Text, g: Geometry, i: int, force: _Sum, moment: _Sum) -> None:
    """Constant force and moment, in body or ground axes."""
    load = g.shape.scene.load[i]
    name, p = load.name, int(g.context.model.loads_p) + at.LOAD_SIZE * i
    if g.slabs.add(f"LOAD_{name}", 9):
        point = ZERO if load.point is None else f"arm(cg_{load.body}, {raw3(p + at.LOAD_POINT)})"
        for k, vector in enumerate((raw3(p + at.LOAD_FORCE), raw3(p + at.LOAD_MOMENT), point)):
            g.parameters(f"put3(w, LOAD_{name} + {3 * k} * LANES + l, {vector})")
    text(f"# load {name}", f"push, turn = get3(w, LOAD_{name} + l), get3(w, LOAD_{name} + 3 * LANES + l)")
    if g.shape.switches:
        text(f"acts = w[ACTS_{name} + l]", "push, turn = vec3.scale(acts, push), vec3.scale(acts, turn)")
    if load.frame == "ground":
        r = g.attitude(load.body)
        text(f"push, turn = vec3.unrotate({r}, push), vec3.unrotate({r}, turn)")
    force.add("push")
    moment.add(f"vec3.add(turn, vec3.cross(get3(w, LOAD_{name} + 6 * LANES + l), push))")


def _gravity(text: Text, g: Geometry, body: str) -> None:
    """Weight, along the ground's y axis."""
    kind = g.shape.scene.environment.gravity
    if kind == "none":
        return
    g.slabs.add("GRAVITY", 1)
    if g.slabs.add(f"MASS_{body}", 1):
        g.parameters(f"w[MASS_{body} + l] = mass_{body}")
    weight = f"w[MASS_{body} + l] * w[GRAVITY + l]"
    if kind == "inverse-square" and feels_air(g.shape, body):
        weight = f"inverse_square_near(w[NEAR_{body} + 3 * LANES + l], share_{body})"
    elif kind == "inverse-square":
        text(f"height = x_{body}[1] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * t)")
        weight = f"w[MASS_{body} + l] * inverse_square(w[GRAVITY + l], height)"
    text(f"force_{body} = (force_{body}[0], force_{body}[1] - {weight}, force_{body}[2])")


def _spring(text: Text, g: Geometry, spring: Spring, i: int) -> None:
    """Force along a spring's line on both of its bodies; none once its stroke is through."""
    name, p = spring.name, int(g.context.model.springs_p) + at.SPRING_SIZE * i
    text(f"# spring {name}")
    emit_spring_line(text, g, spring)
    if g.slabs.add(f"SPRING_{name}", 3):
        for k, offset in enumerate((at.SPRING_FORCE, at.STIFFNESS, at.DAMPING)):
            g.parameters(f"w[SPRING_{name} + {k} * LANES + l] = {raw(p + offset)}")
    values = f"w[SPRING_{name} + l], w[SPRING_{name} + LANES + l], w[SPRING_{name} + 2 * LANES + l]"
    text(f"push = springs.spring_force({values}, length - w[START_{name} + l], rate)")
    if g.shape.may(f"spring.{name}.stroke", math.isfinite(spring.stroke)):
        if g.slabs.add(f"SPENT_{name}", 1):
            g.parameters(f"w[SPENT_{name} + l] = 0.0")
        text(f"push = 0.0 if w[SPENT_{name} + l] > 0.0 else push")
    for body, sign, arm in ((spring.bodies[0], "-push", "arm_a"), (spring.bodies[1], "push", "arm_b")):
        if body != GROUND:
            text(f"force_{body} = vec3.add(force_{body}, vec3.scale({sign}, e))")
            text(f"moment_{body} = vec3.add(moment_{body}, vec3.scale(push, vec3.unrotate({g.attitude(body)}, {arm})))")
