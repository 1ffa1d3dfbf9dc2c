"""Lines of a specialised kernel that set up its lanes: the initial state, and what loads and joints need of a case's parameters."""

from sepmc.compiler.emit_context import Context, raw, raw3
from sepmc.compiler.emit_loads import emit_load_parameters
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND

_ZERO_AT_FIRST = (
    *("DRIFT", "TURNED_FAR", "EVENT_ERROR", "STEPS", "UNEVEN"),
    *("RESIDUAL", "RESIDUAL + LANES", "RESIDUAL + 2 * LANES", "RESIDUAL + 3 * LANES"),
)


def shared_size(c: Context) -> int:
    """Numbers that all cases share: axes of joints and what makes their separation positive, axes of springs."""
    return int(c.model.springs_x) + 3 * len(c.shape.scene.spring)


def emit_prepare(out: Text, c: Context) -> None:
    """A function that sets up a flight; written when the other parts have said what they need."""
    shape, slabs = c.shape, c.slabs
    text = out.function("prepare(w)", "What a flight needs of the parameters P of its cases.")
    slabs.add("P", int(c.model.work)), slabs.add("UNSOUND", 1)
    slabs.add("SHARED", shared_size(c))
    if slabs.has("AIR"):
        text.lanes()(f"air, w[AIR_TOP + l] = layer({raw(at.ALTITUDE)})", "put4(w, AIR + l, air)")
    text.block("for k in range(D, D + SIZE_Y):  # what a phase does not integrate stays")("w[k] = 0.0")
    start = Text(2)
    _start(start, c)
    start(*(f"w[{name} + l] = 0.0" for name in _ZERO_AT_FIRST), *(f"{c.guard(name)} = 0.0" for name in c.guards))
    start("w[LOST + l] = w[LOST + l] if w[UNSOUND + l] == 0.0 else 1.0")
    emit_load_parameters(c)
    for stage in shape.stages:
        if stage.end_time:
            slabs.add(f"UNTIL_{stage.name}", 1)
            told = " + ".join(raw(place) for place in (*stage.end_time, *([] if stage.delay is None else [stage.delay])))
            c.parameters(f"w[UNTIL_{stage.name} + l] = {told}")
    for joint in shape.failing:
        c.parameters(f"w[LOST + l] = w[LOST + l] if {raw(shape.plan.slots[f'joint.{joint}.fails'])} < 0.5 else 1.0")
    out.lines += c.shared.lines
    text.lanes()
    out.lines += start.lines + c.parameters.lines


def _start(text: Text, c: Context) -> None:
    """The initial state of the mated vehicle, as `sepmc.kernels.prepare.set_initial_state`, and what disqualifies a case."""
    shape, slabs, scene, m = c.shape, c.slabs, c.shape.scene, c.model
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
