"""Lines of a specialised kernel that turn a state into local names: attitudes, rates, and what lies between two bodies."""

from sepmc.compiler.emit_context import Context, raw3
from sepmc.compiler.shape import Stage
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND, Spring

ZERO = "(0.0, 0.0, 0.0)"


class Geometry:
    """Local names of attitudes and rates in a phase, and of what lies between two bodies."""

    def __init__(self, context: Context, stage: Stage):
        self.context, self.stage = context, stage
        self.shape, self.slabs, self.parameters = context.shape, context.slabs, context.parameters
        self.spins: set[str] = set()

    def attitude(self, body: str) -> str:
        """Matrix from a body's axes to the ground's."""
        return f"r_{self.stage.leader(body)}"

    def spin(self, text: Text, body: str) -> str:
        """Angular rate of a body in ground axes."""
        leader = self.stage.leader(body)
        if leader == GROUND:
            return ZERO
        if leader not in self.spins:
            self.spins.add(leader)
            text(f"spin_{leader} = vec3.rotate(r_{leader}, omega_{leader})")
        return f"spin_{leader}"

    def pair(self, text: Text, bodies: tuple[str, str], ends: str) -> None:
        """d = r_B - r_A between points of two bodies, whose arms stand in a slab, d', arms and rates, all in ground axes."""
        a, b = bodies
        spin_a, spin_b = self.spin(text, a), self.spin(text, b)
        text(f"spin_a, spin_b = {spin_a}, {spin_b}")
        text(f"rho_a = vec3.rotate({self.attitude(a)}, get3(w, {ends} + l))")
        text(f"rho_b = vec3.rotate({self.attitude(b)}, get3(w, {ends} + 3 * LANES + l))")
        text(f"d, d_rate = joints.between(x_{a}, v_{a}, rho_a, spin_a, x_{b}, v_{b}, rho_b, spin_b)")

    def joint(self, text: Text, name: str) -> None:
        """`pair` of a joint's points."""
        if self.slabs.add(f"ENDS_{name}", 6):
            rho_a, rho_b, _ = self.joint_ends(name)
            self.parameters(f"put3(w, ENDS_{name} + l, {rho_a})", f"put3(w, ENDS_{name} + 3 * LANES + l, {rho_b})")
        self.pair(text, self.shape.scene.joint[name].bodies, f"ENDS_{name}")

    def joint_ends(self, name: str) -> tuple[str, str, str]:
        """Arms of a joint's bodies to its points, and the gap between these."""
        joint, j = self.shape.scene.joint[name], list(self.shape.scene.joint).index(name)
        start = int(self.context.model.joints_p) + at.JOINT_SIZE * j
        return _ends(start, joint.bodies, joint.second_point is not None)

    def axis(self, name: str, k: int, second: bool = False) -> str:
        """Axis k of a joint as its first (or second) body carries it, ground axes."""
        body = self.shape.scene.joint[name].bodies[int(second)]
        r = self.attitude(body)
        if self.shape.plain_axes(name):
            return f"({r}[{k}], {r}[{k + 3}], {r}[{k + 6}])"
        if self.slabs.add(f"AXES_{name}", 9):
            start = 10 * list(self.shape.scene.joint).index(name)
            for i in range(3):
                self.parameters(f"put3(w, AXES_{name} + {3 * i} * LANES + l, {self.context.shared_vector(start + 3 * i)})")
        return f"vec3.rotate({r}, get3(w, AXES_{name} + {3 * k} * LANES + l))"


def emit_state(text: Text, c: Context, stage: Stage, state: str) -> Geometry:
    """Attitudes, rates, places and speeds of bodies at a state, the slab S or Y, as local names."""
    for leader in stage.leaders:
        text(f"q_{leader}, omega_{leader} = get4(w, {state} + Q_{leader} + l), get3(w, {state} + OMEGA_{leader} + l)")
        text(f"r_{leader} = quat.matrix(q_{leader})")
    for body in c.shape.bodies:
        text(f"x_{body}, v_{body} = get3(w, {state} + X_{body} + l), get3(w, {state} + V_{body} + l)")
    if any(GROUND in group for group in stage.groups):
        _ground(text, c, "CLOCK" if state == "S" else "T")
    return Geometry(c, stage)


def _ground(text: Text, c: Context, clock: str) -> None:
    """Place, speed and attitude of the ground, seen from what moves with the vehicle's first speed."""
    if c.slabs.add("GROUND_X", 3):
        c.slabs.add("GROUND_V", 3), c.slabs.add("GROUND_Q", 4)
        c.parameters("put3(w, GROUND_X + l, (0.0, 0.0, 0.0))  # its axes start at the mass centre")
        c.parameters("put3(w, GROUND_V + l, vec3.scale(-1.0, velocity))", "put4(w, GROUND_Q + l, q)")
    text("v_ground, r_ground = get3(w, GROUND_V + l), quat.matrix(get4(w, GROUND_Q + l))")
    text(f"x_ground = vec3.add(get3(w, GROUND_X + l), vec3.scale(w[{clock} + l], v_ground))")


def emit_separation(text: Text, g: Geometry, joint: str) -> None:
    """Local names distance and rate of a joint's separation along its x axis, and what they are made of."""
    j = list(g.shape.scene.joint).index(joint)
    g.joint(text, joint)
    if g.slabs.add(f"APART_{joint}", 2):
        gap = f"vec3.dot({g.joint_ends(joint)[2]}, {g.context.shared_vector(10 * j)})"
        g.context.shared(f"apart_{joint} = w[SHARED + {10 * j + 9}]")
        g.parameters(f"w[APART_{joint} + l], w[APART_{joint} + LANES + l] = apart_{joint}, {gap}")
    text(f"apart, e = w[APART_{joint} + l], {g.axis(joint, 0)}")
    text(f"distance = apart * (vec3.dot(d, e) - w[APART_{joint} + LANES + l])")
    text("rate = apart * joints.translation_rate(d, d_rate, e, spin_a)")


def emit_spring_line(text: Text, g: Geometry, spring: Spring) -> None:
    """Local names of a spring's line of action: e, arm_a, arm_b, gamma, length and its rate."""
    name, model = spring.name, g.context.model
    i = [s.name for s in g.shape.scene.spring].index(name)
    axis_start = int(model.springs_x) + 3 * i
    if g.slabs.add(f"SPRING_ENDS_{name}", 6):
        g.slabs.add(f"START_{name}", 1)
        rho_a, rho_b, gap = _ends(int(model.springs_p) + at.SPRING_SIZE * i, spring.bodies, spring.second_point is not None)
        g.parameters(f"put3(w, SPRING_ENDS_{name} + l, {rho_a})", f"put3(w, SPRING_ENDS_{name} + 3 * LANES + l, {rho_b})")
        g.parameters(f"gap = {gap}")
        along = g.context.shared_vector(axis_start) if spring.axis is not None else "gap"
        length = f"vec3.dot(gap, {along})"
        g.parameters(f"w[START_{name} + l] = {length if spring.axis is not None else f'math.sqrt({length})'}")
    g.pair(text, spring.bodies, f"SPRING_ENDS_{name}")
    if spring.axis is None:
        text("e, arm_a, arm_b, gamma = joints.rod(d, d_rate, rho_a, rho_b, spin_a, spin_b)")
        text("length, rate = math.sqrt(vec3.dot(d, d)), vec3.dot(d_rate, e)")
        return
    r = g.attitude(spring.bodies[0])
    if tuple(spring.axis) == (1.0, 0.0, 0.0):
        text(f"e = ({r}[0], {r}[3], {r}[6])")
    else:
        if g.slabs.add(f"SPRING_AXIS_{name}", 3):
            g.parameters(f"put3(w, SPRING_AXIS_{name} + l, {g.context.shared_vector(axis_start)})")
        text(f"e = vec3.rotate({r}, get3(w, SPRING_AXIS_{name} + l))")
    text("arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, spin_a, spin_b)")
    text("length, rate = vec3.dot(d, e), joints.translation_rate(d, d_rate, e, spin_a)")


def relative_acceleration(bodies: tuple[str, str]) -> str:
    """Acceleration of the second body's mass centre less that of the first's; the ground has none."""
    a, b = bodies
    if a == GROUND:
        return f"a_{b}"
    return f"vec3.scale(-1.0, a_{a})" if b == GROUND else f"vec3.sub(a_{b}, a_{a})"


def _ends(start: int, bodies: tuple[str, str], has_second: bool) -> tuple[str, str, str]:
    """Arms of two bodies to the pair of points whose parameters start at ``start``, and the gap between the points, body axes."""
    first = raw3(start + at.POINT)
    second = raw3(start + at.SECOND_POINT) if has_second else first
    arms = [f"arm({_centre_of_mass(body)}, {point})" for body, point in zip(bodies, (first, second), strict=True)]
    return arms[0], arms[1], f"arm({first}, {second})" if has_second else ZERO


def _centre_of_mass(body: str) -> str:
    """Layout point of a body's mass centre; the ground's own axes start at that of all bodies."""
    return "centre" if body == GROUND else f"cg_{body}"
