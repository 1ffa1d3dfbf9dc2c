"""Lines of a specialised kernel that sum up the loads on every body: force_<body> in ground axes, moment_<body> in body axes."""

import math

from sepmc.compiler.emit_prepare import ends, raw, raw3
from sepmc.compiler.emit_rows import Geometry
from sepmc.compiler.packing import aero_terms
from sepmc.compiler.shape import Shape, Stage
from sepmc.compiler.text import Slabs, Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND, Motor, Spring

_COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")


def emit_loads(text: Text, shape: Shape, stage: Stage, g: Geometry, slabs: Slabs, parameters: Text) -> None:
    """All loads of a phase at a state whose attitudes, rates, places and speeds are local names."""
    scene = shape.scene
    for body in shape.bodies:
        force = _Sum(text, f"force_{body}")
        moment = _Sum(text, f"moment_{body}")
        if scene.environment.atmosphere != "none" and scene.body[body].aerodynamics is not None:
            _air(text, shape, body, g, slabs, parameters, force, moment)
        for i, motor in enumerate(scene.motor):
            if motor.body == body:
                _motor(text, shape, motor, i, slabs, parameters, force, moment)
        for i, load in enumerate(scene.load):
            if load.body == body:
                _load(text, shape, i, g, slabs, parameters, force, moment)
        moment.close()
        force.close()
        if force.given:
            text(f"force_{body} = vec3.rotate({g.attitude(body)}, force_{body})")
        _gravity(text, shape, body, slabs, parameters)
    for i, spring in enumerate(scene.spring):
        _spring(text, shape, spring, i, stage, g, slabs, parameters)


def emit_load_parameters(slabs: Slabs, parameters: Text) -> None:
    """What several loads share."""
    if slabs.has("STREAM"):
        parameters("put3(w, STREAM + l, vec3.sub(velocity, stream))")
    if slabs.has("GRAVITY"):
        parameters(f"w[GRAVITY + l] = {raw(at.SURFACE_GRAVITY)}")


class _Sum:
    """A vector that starts as its first term."""

    def __init__(self, text: Text, name: str):
        self.text, self.name, self.given = text, name, False

    def add(self, term: str) -> None:
        self.text(f"{self.name} = vec3.add({self.name}, {term})" if self.given else f"{self.name} = {term}")
        self.given = True

    def close(self) -> None:
        if not self.given:
            self.text(f"{self.name} = (0.0, 0.0, 0.0)")


def _height(text: Text, body: str, slabs: Slabs, name: str) -> None:
    slabs.add("ORIGIN_HEIGHT", 1), slabs.add("ORIGIN_CLIMB", 1)
    text(f"{name} = x_{body}[1] + (w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * t)")


def _air(text: Text, shape: Shape, body: str, g: Geometry, slabs: Slabs, parameters: Text, force: _Sum, moment: _Sum) -> None:
    slabs.add("STREAM", 3), slabs.add("AIR", 4), slabs.add("AIR_TOP", 1)
    p = at.HEAD + at.BODY_SIZE * shape.bodies.index(body)
    if slabs.add(f"FORCE_SCALE_{body}", 1):
        slabs.add(f"MOMENT_SCALE_{body}", 1)
        scale = f"0.5 * {raw(at.DENSITY_FACTOR)} * {raw(p + at.AREA)}"
        parameters(f"w[FORCE_SCALE_{body} + l] = {scale} * {raw(p + at.FORCE_FACTOR)}")
        parameters(f"w[MOMENT_SCALE_{body} + l] = {scale} * {raw(p + at.LENGTH)} * {raw(p + at.MOMENT_FACTOR)}")
    text(f"# air on {body}")
    text(f"flow = vec3.unrotate({g.attitude(body)}, vec3.add(v_{body}, get3(w, STREAM + l)))", "alpha, beta = flow_angles(flow)")
    _height(text, body, slabs, "height")
    text("pushing = density_in_layer(height, get4(w, AIR + l)) * vec3.dot(flow, flow)")
    terms: dict[int, list[str]] = {code: [] for code in range(6)}
    powers: set[tuple[str, int]] = set()
    for k, term in enumerate(aero_terms(shape.scene)):
        if term.body == body:
            name = "C_" + term.path.removeprefix("body.").replace(".aerodynamics.", "_").replace(".", "_").upper()
            if slabs.add(name, 1):
                parameters(f"w[{name} + l] = {raw(int(shape.plan.model.scene[0].terms_p) + k)}")
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
            text.wrapped(f"{name} = ", terms[code], "") if len(" + ".join(terms[code])) < 110 else text.wrapped(
                f"{name} = (", terms[code], ")"
            )
    named = [name if terms[code] else "0.0" for code, name in enumerate(_COEFFICIENTS)]
    text(f"push = aero_force(pushing * w[FORCE_SCALE_{body} + l], ({', '.join(named[:3])}))")
    force.add("push")
    if any(terms[code] for code in range(3, 6)):
        moment.add(f"aero_moment(pushing * w[MOMENT_SCALE_{body} + l], ({named[3]}, {named[4]}, {named[5]}))")
    aero = shape.scene.body[body].aerodynamics
    if aero is not None and aero.moment_point is not None:
        if slabs.add(f"AIR_ARM_{body}", 3):
            parameters(f"put3(w, AIR_ARM_{body} + l, arm(cg_{body}, {raw3(p + at.MOMENT_POINT)}))")
        moment.add(f"vec3.cross(get3(w, AIR_ARM_{body} + l), push)")


def _motor(text: Text, shape: Shape, motor: Motor, i: int, slabs: Slabs, parameters: Text, force: _Sum, moment: _Sum) -> None:
    name = motor.name
    p = int(shape.plan.model.scene[0].motors_p) + at.MOTOR_SIZE * i
    if slabs.add(f"THRUST_{name}", 1):
        slabs.add(f"LINE_{name}", 3), slabs.add(f"TURN_{name}", 3)
        angles = ", ".join(raw(p + place) for place in (at.CANT, at.CLOCK, at.DEFLECTION, at.DEFLECTION_CLOCK))
        point = ", ".join(raw(p + place) for place in (at.STATION, at.RADIUS, at.CLOCK, at.OFFSET, at.OFFSET + 1))
        parameters(f"w[THRUST_{name} + l], line = {raw(p + at.THRUST)}, thrust_direction({angles})")
        parameters(f"put3(w, LINE_{name} + l, line)")
        parameters(f"put3(w, TURN_{name} + l, vec3.cross(thrust_arm(cg_{motor.body}, {point}), line))")
        if motor.build_up > 0.0:
            slabs.add(f"BUILDING_{name}", 1)
            parameters(f"w[BUILDING_{name} + l] = 1.0 / {raw(p + at.BUILD_UP)}")
        if shape.switches:
            slabs.add(f"IGNITION_{name}", 1)
            parameters(f"w[IGNITION_{name} + l] = {raw(p + at.IGNITION)} + {raw(p + at.IGNITION_DELAY)}")
            if motor.tail_off > 0.0:
                slabs.add(f"BURN_{name}", 1), slabs.add(f"TAIL_OFF_{name}", 1)
                parameters(f"w[BURN_{name} + l], w[TAIL_OFF_{name} + l] = {raw(p + at.BURN)}, {raw(p + at.TAIL_OFF)}")

    def level(since: str) -> str:
        if motor.build_up > 0.0:
            return f"building_up(w[THRUST_{name} + l], w[BUILDING_{name} + l], {since})"
        return f"w[THRUST_{name} + l]"

    text(f"# motor {name}")
    if not shape.switches:
        text(f"thrust = {level('t')}")
    else:
        text(f"burning, share, slope = get3(w, BURNING_{name} + l)", f"since = larger(t - w[IGNITION_{name} + l], 0.0)")
        text(f"thrust = {level('since')} * (share + slope * since) if burning == 1.0 else 0.0")
        if motor.tail_off > 0.0:
            text(f"after = larger(since - w[BURN_{name} + l], 0.0)")
            text(f"left = {level(f'w[BURN_{name} + l]')} * share * tail_off(after, w[TAIL_OFF_{name} + l])")
            text("thrust = left if burning == 2.0 else thrust")
    force.add(f"vec3.scale(thrust, get3(w, LINE_{name} + l))")
    moment.add(f"vec3.scale(thrust, get3(w, TURN_{name} + l))")


def _load(text: Text, shape: Shape, i: int, g: Geometry, slabs: Slabs, parameters: Text, force: _Sum, moment: _Sum) -> None:
    load, scene = shape.scene.load[i], shape.plan.model.scene[0]
    name, p = load.name, int(scene.loads_p) + at.LOAD_SIZE * i
    if slabs.add(f"LOAD_{name}", 9):
        point = "(0.0, 0.0, 0.0)" if load.point is None else f"arm(cg_{load.body}, {raw3(p + at.LOAD_POINT)})"
        for k, vector in enumerate((raw3(p + at.LOAD_FORCE), raw3(p + at.LOAD_MOMENT), point)):
            parameters(f"put3(w, LOAD_{name} + {3 * k} * LANES + l, {vector})")
    text(f"# load {name}", f"push, turn = get3(w, LOAD_{name} + l), get3(w, LOAD_{name} + 3 * LANES + l)")
    if shape.switches:
        text(f"acts = w[ACTS_{name} + l]", "push, turn = vec3.scale(acts, push), vec3.scale(acts, turn)")
    if load.frame == "ground":
        r = g.attitude(load.body)
        text(f"push, turn = vec3.unrotate({r}, push), vec3.unrotate({r}, turn)")
    force.add("push")
    moment.add(f"vec3.add(turn, vec3.cross(get3(w, LOAD_{name} + 6 * LANES + l), push))")


def _gravity(text: Text, shape: Shape, body: str, slabs: Slabs, parameters: Text) -> None:
    kind = shape.scene.environment.gravity
    if kind == "none":
        return
    slabs.add("GRAVITY", 1)
    if slabs.add(f"MASS_{body}", 1):
        parameters(f"w[MASS_{body} + l] = mass_{body}")
    weight = f"w[MASS_{body} + l] * w[GRAVITY + l]"
    if kind == "inverse-square":
        _height(text, body, slabs, "height")
        weight = f"w[MASS_{body} + l] * inverse_square(w[GRAVITY + l], height)"
    text(f"force_{body} = (force_{body}[0], force_{body}[1] - {weight}, force_{body}[2])")


def emit_spring_line(text: Text, g: Geometry, spring: Spring) -> None:
    """Local names of a spring's line of action: e, arm_a, arm_b, gamma, length and its rate."""
    shape, slabs, parameters = g.shape, g.slabs, g.parameters
    i = [s.name for s in shape.scene.spring].index(spring.name)
    start = int(shape.plan.model.scene[0].springs_p) + at.SPRING_SIZE * i
    if slabs.add(f"SPRING_ENDS_{spring.name}", 6):
        slabs.add(f"START_{spring.name}", 1)
        rho_a, rho_b, gap = ends(shape, start, spring.bodies, spring.second_point is not None)
        parameters(f"put3(w, SPRING_ENDS_{spring.name} + l, {rho_a})", f"put3(w, SPRING_ENDS_{spring.name} + 3 * LANES + l, {rho_b})")
        parameters(f"gap = {gap}")
        along = g.shared_vector(int(shape.plan.model.scene[0].springs_x) + 3 * i) if spring.axis is not None else "gap"
        length = f"vec3.dot(gap, {along})"
        parameters(f"w[START_{spring.name} + l] = {length if spring.axis is not None else f'math.sqrt({length})'}")
    g.pair(text, spring.bodies, f"SPRING_ENDS_{spring.name}")
    if spring.axis is None:
        text("e, arm_a, arm_b, gamma = joints.rod(d, d_rate, rho_a, rho_b, spin_a, spin_b)")
        text("length, rate = math.sqrt(vec3.dot(d, d)), vec3.dot(d_rate, e)")
        return
    if tuple(spring.axis) == (1.0, 0.0, 0.0):
        r = g.attitude(spring.bodies[0])
        text(f"e = ({r}[0], {r}[3], {r}[6])")
    else:
        if slabs.add(f"SPRING_AXIS_{spring.name}", 3):
            start = int(shape.plan.model.scene[0].springs_x) + 3 * i
            parameters(f"put3(w, SPRING_AXIS_{spring.name} + l, {g.shared_vector(start)})")
        text(f"e = vec3.rotate({g.attitude(spring.bodies[0])}, get3(w, SPRING_AXIS_{spring.name} + l))")
    text("arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, spin_a, spin_b)")
    text("length, rate = vec3.dot(d, e), joints.translation_rate(d, d_rate, e, spin_a)")


def _spring(text: Text, shape: Shape, spring: Spring, i: int, stage: Stage, g: Geometry, slabs: Slabs, parameters: Text) -> None:
    name, p = spring.name, int(shape.plan.model.scene[0].springs_p) + at.SPRING_SIZE * i
    text(f"# spring {name}")
    emit_spring_line(text, g, spring)
    if slabs.add(f"SPRING_{name}", 3):
        for k, offset in enumerate((at.SPRING_FORCE, at.STIFFNESS, at.DAMPING)):
            parameters(f"w[SPRING_{name} + {k} * LANES + l] = {raw(p + offset)}")
    values = f"w[SPRING_{name} + l], w[SPRING_{name} + LANES + l], w[SPRING_{name} + 2 * LANES + l]"
    text(f"push = springs.spring_force({values}, length - w[START_{name} + l], rate)")
    if math.isfinite(spring.stroke):
        if slabs.add(f"SPENT_{name}", 1):
            parameters(f"w[SPENT_{name} + l] = 0.0")
        text(f"push = 0.0 if w[SPENT_{name} + l] > 0.0 else push")
    for body, sign, arm in ((spring.bodies[0], "-push", "arm_a"), (spring.bodies[1], "push", "arm_b")):
        if body != GROUND:
            text(f"force_{body} = vec3.add(force_{body}, vec3.scale({sign}, e))")
            text(f"moment_{body} = vec3.add(moment_{body}, vec3.scale(push, vec3.unrotate({g.attitude(body)}, {arm})))")
