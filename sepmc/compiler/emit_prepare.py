"""Lines of a specialised kernel that set up its lanes: the initial state, and what loads and joints need of a case's parameters."""

from sepmc.compiler.shape import Shape
from sepmc.compiler.text import Slabs, Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND


def raw(place: int) -> str:
    """A parameter of a case by its place in the vector of parameters."""
    return f"w[P + {place} * LANES + l]"


def raw3(place: int) -> str:
    """A vector of parameters."""
    return f"get3(w, P + {place} * LANES + l)"


def centre_of_mass(shape: Shape, body: str) -> str:
    """Layout point of a body's mass centre; the ground's own axes start at that of all bodies."""
    return "centre" if body == GROUND else f"cg_{body}"


def ends(shape: Shape, start: int, bodies: tuple[str, str], has_second: bool) -> tuple[str, str, str]:
    """Arms of two bodies to the pair of points whose parameters start at ``start``, and the gap between the points, body axes."""
    first, second = raw3(start + at.POINT), raw3(start + at.SECOND_POINT) if has_second else raw3(start + at.POINT)
    arms = [f"arm({centre_of_mass(shape, body)}, {point})" for body, point in zip(bodies, (first, second), strict=True)]
    return arms[0], arms[1], f"arm({first}, {second})" if has_second else "(0.0, 0.0, 0.0)"


def emit_start(text: Text, shape: Shape, slabs: Slabs) -> None:
    """The initial state of the mated vehicle, as `sepmc.kernels.prepare.set_initial_state`, and what disqualifies a case."""
    scene, m = shape.scene, shape.plan.model.scene[0]
    for i, body in enumerate(shape.bodies):
        p = at.HEAD + at.BODY_SIZE * i
        text(f"mass_{body}, cg_{body} = {raw(p + at.MASS)}, {raw3(p + at.CG)}")
        text(f"tensor_{body} = inertia_tensor({raw(p + at.INERTIA_FACTOR)}, {raw3(p + at.INERTIA)}, {raw3(p + at.PRODUCTS)})")
    weighted = f"vec3.scale(mass_{shape.bodies[0]}, cg_{shape.bodies[0]})"
    for body in shape.bodies[1:]:
        weighted = f"vec3.add({weighted}, vec3.scale(mass_{body}, cg_{body}))"
    text(f"centre = vec3.scale(1.0 / ({' + '.join(f'mass_{body}' for body in shape.bodies)}), {weighted})")
    text(f"q = quat.from_angles({raw(at.PITCH)}, {raw(at.YAW)}, {raw(at.ROLL)})", f"r, omega = quat.matrix(q), {raw3(at.OMEGA)}")
    text(f"path = flight_direction({raw(at.PITCH)} - {raw(at.ALPHA)}, {raw(at.PATH_YAW)})")
    text(f"velocity, stream = vec3.scale({raw(at.SPEED)}, path), wind({raw(at.WIND_SPEED)}, {raw(at.WIND_DIRECTION)})")
    pivot = ""
    if m.pivot_joint >= 0:
        joint = list(scene.joint.values())[int(m.pivot_joint)]
        start = int(m.joints_p) + at.JOINT_SIZE * int(m.pivot_joint)
        second = joint.bodies[0] != GROUND and joint.second_point is not None
        pivot = f"arm(centre, {raw3(start + (at.SECOND_POINT if second else at.POINT))})"
    for body in shape.bodies:
        text(f"offset = vec3.scale(-1.0, arm(cg_{body}, centre))")
        text(f"put3(w, Y + X_{body} + l, vec3.rotate(r, offset))")
        turning = f"vec3.sub(offset, {pivot})" if pivot else "offset"
        text(f"put3(w, Y + V_{body} + l, vec3.rotate(r, vec3.cross(omega, {turning})))")
        text(f"put4(w, Y + Q_{body} + l, q)", f"put3(w, Y + OMEGA_{body} + l, omega)")
        if slabs.has(f"ANGLES_{body}"):
            text(f"w[ANGLES_{body} + l], w[ANGLES_{body} + LANES + l] = {raw(at.PITCH)}, {raw(at.ROLL)}")
    sound = " and ".join(f"mass_{body} > 0.0 and vec3.is_positive_definite(tensor_{body})" for body in shape.bodies)
    text(f"w[LOST + l] = 0.0 if {sound} else 1.0", f"w[T + l], w[RUN_END + l] = 0.0, {raw(at.END_TIME)}")
    text(f"w[ORIGIN_HEIGHT + l], w[ORIGIN_CLIMB + l] = {raw(at.ALTITUDE)}, velocity[1]")
    slabs.add("ORIGIN_HEIGHT", 1), slabs.add("ORIGIN_CLIMB", 1)
