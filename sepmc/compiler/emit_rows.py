"""Lines of a specialised kernel for joints: geometry, constraint rows, the reduced constraint force equation, events."""

from sepmc.compiler.emit_prepare import ends, raw
from sepmc.compiler.shape import Event, Row, Shape, Stage
from sepmc.compiler.text import Slabs, Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND

_ZERO = "(0.0, 0.0, 0.0)"


class Geometry:
    """Local names of attitudes and rates in a phase, and of what lies between two bodies."""

    def __init__(self, shape: Shape, stage: Stage, slabs: Slabs, parameters: Text, shared: Text):
        self.shape, self.stage, self.slabs, self.parameters, self.shared = shape, stage, slabs, parameters, shared
        self.spins: set[str] = set()

    def shared_vector(self, start: int) -> str:
        """Name of a vector that all cases share, by its place in ``numbers``; it is read before the loop over lanes."""
        line = f"shared_{start} = vec3.get(numbers, {start})"
        if line not in (known.strip() for known in self.shared.lines):
            self.shared(line)
        return f"shared_{start}"

    def attitude(self, body: str) -> str:
        return f"r_{self.stage.leader(body)}"

    def ground(self, text: Text, clock: str) -> None:
        """Place, speed and attitude of the ground, if anything is held by it."""
        if not any(GROUND in group for group in self.stage.groups):
            return
        if self.slabs.add("GROUND_X", 3):
            self.slabs.add("GROUND_V", 3), self.slabs.add("GROUND_Q", 4)
            self.parameters("put3(w, GROUND_X + l, (0.0, 0.0, 0.0))  # its axes start at the mass centre")
            self.parameters("put3(w, GROUND_V + l, vec3.scale(-1.0, velocity))", "put4(w, GROUND_Q + l, q)")
        text("v_ground, r_ground = get3(w, GROUND_V + l), quat.matrix(get4(w, GROUND_Q + l))")
        text(f"x_ground = vec3.add(get3(w, GROUND_X + l), vec3.scale(w[{clock} + l], v_ground))")

    def spin(self, text: Text, body: str) -> str:
        """Angular rate of a body in ground axes."""
        leader = self.stage.leader(body)
        if leader == GROUND:
            return _ZERO
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
        start = int(self.shape.plan.model.scene[0].joints_p) + at.JOINT_SIZE * j
        return ends(self.shape, start, joint.bodies, joint.second_point is not None)

    def axis(self, name: str, k: int, second: bool = False) -> str:
        """Axis k of a joint as its first (or second) body carries it, ground axes."""
        body = self.shape.scene.joint[name].bodies[int(second)]
        r = self.attitude(body)
        if self.shape.plain_axes(name):
            return f"({r}[{k}], {r}[{k + 3}], {r}[{k + 6}])"
        if self.slabs.add(f"AXES_{name}", 9):
            start = 10 * list(self.shape.scene.joint).index(name)
            for i in range(3):
                self.parameters(f"put3(w, AXES_{name} + {3 * i} * LANES + l, {self.shared_vector(start + 3 * i)})")
        return f"vec3.rotate({r}, get3(w, AXES_{name} + {3 * k} * LANES + l))"


def emit_rows(text: Text, g: Geometry, stage: Stage, purpose: str) -> None:
    """The rows of a phase, and what they do.

    purpose : "motion" adds what the joints do to a_<body> and spin_rate_<leader>; "drift" finds the least corrections shift_ and turn_ of
    places and attitudes, kick_ and swing_ of speeds and rates, and notes how far the rows are off; "residual" notes only.
    """
    scene, n = g.shape.scene, len(stage.rows)
    acts: list[dict[str, str]] = []  # of each row: what it pulls on, by body; and its arm, by leader
    joint = ""
    for r, row in enumerate(stage.rows):
        a, b = scene.joint[row.joint].bodies
        if row.joint != joint:
            joint = row.joint
            text(f"# joint {joint}")
            g.joint(text, joint)
        _row(text, g, row, r, purpose)
        arms: dict[str, str] = {}
        for body, arm in ((a, "arm_a"), (b, "arm_b")):
            leader = stage.leader(body)
            if leader != GROUND:
                arms[leader] = "vec3.add(arm_a, arm_b)" if leader in arms else arm
        for leader, arm in arms.items():
            text(f"n{r}_{leader} = vec3.unrotate(r_{leader}, {arm})")
            if purpose != "residual":
                text(f"turned{r}_{leader} = vec3.rotate(inverse_{leader}, n{r}_{leader})")
        acts.append({leader: "" for leader in arms})
        if purpose != "motion":
            first = 1 if row.turns else 0
            for k, name in ((first, f"value{r}"), (first + 2, f"rate{r}")):
                text(f"w[RESIDUAL_NOW + {k} * LANES + l] = larger(w[RESIDUAL_NOW + {k} * LANES + l], abs({name}))")
            g.slabs.add("RESIDUAL_NOW", 4)
    if purpose == "residual":
        return
    text(
        "# inverse inertia that the rows feel, and their accelerations without the joints"
        if purpose == "motion"
        else "# inverse inertia that the rows feel"
    )
    for r in range(n):
        for s in range(r + 1):
            text(f"s{r}_{s} = {_coupling(g, stage, acts, r, s)}")
    if purpose == "motion":
        for r, row in enumerate(stage.rows):
            terms = []
            if not row.turns:
                a, b = scene.joint[row.joint].bodies
                apart = f"a_{b}" if a == GROUND else (f"vec3.scale(-1.0, a_{a})" if b == GROUND else f"vec3.sub(a_{b}, a_{a})")
                terms.append(f"vec3.dot(e{r}, {apart})")
            terms += [f"vec3.dot(n{r}_{leader}, spin_rate_{leader})" for leader in acts[r]]
            text(f"m{r} = gamma{r} - " + " - ".join(terms))
        _solve(text, n, ["m"])
        _apply(text, g, stage, acts, "m", "a", "spin_rate", start=False)
        return
    for r in range(n):
        text(f"m{r}, k{r} = -value{r}, -rate{r}")
    _solve(text, n, ["m", "k"])
    _apply(text, g, stage, acts, "m", "shift", "turn", start=True)
    _apply(text, g, stage, acts, "k", "kick", "swing", start=True)


def _row(text: Text, g: Geometry, row: Row, r: int, purpose: str) -> None:
    """One row: its direction e<r>, arms, right-hand side gamma<r>; or how far it is off, value<r> and rate<r>."""
    if row.turns:
        of_second, of_first = (row.code - at.ROTATION) // 3, (row.code - at.ROTATION) % 3
        text(f"axis_b, axis_a = {g.axis(row.joint, of_second, second=True)}, {g.axis(row.joint, of_first)}")
        text(f"arm_b, gamma{r} = joints.rotation(axis_b, axis_a, spin_a, spin_b)", "arm_a = vec3.scale(-1.0, arm_b)")
        if purpose != "motion":
            text(f"value{r}, rate{r} = vec3.dot(axis_b, axis_a), joints.rotation_rate(axis_b, axis_a, spin_a, spin_b)")
        return
    if row.code == at.ROD:
        text(f"e{r}, arm_a, arm_b, gamma{r} = joints.rod(d, d_rate, rho_a, rho_b, spin_a, spin_b)")
        if purpose != "motion":
            if g.slabs.add(f"ROD_{row.joint}", 1):
                g.parameters(f"gap = {g.joint_ends(row.joint)[2]}", f"w[ROD_{row.joint} + l] = math.sqrt(vec3.dot(gap, gap))")
            text(f"value{r}, rate{r} = math.sqrt(vec3.dot(d, d)) - w[ROD_{row.joint} + l], vec3.dot(d_rate, e{r})")
        return
    text(f"e{r} = {g.axis(row.joint, row.code)}")
    text(f"arm_a, arm_b, gamma{r} = joints.translation(d, d_rate, e{r}, rho_a, rho_b, spin_a, spin_b)")
    if purpose != "motion":
        text(f"value{r}, rate{r} = vec3.dot(d, e{r}), joints.translation_rate(d, d_rate, e{r}, spin_a)")


def _coupling(g: Geometry, stage: Stage, acts: list[dict[str, str]], r: int, s: int) -> str:
    """An element of G M^-1 G^T."""
    scene, one, two = g.shape.scene, stage.rows[r], stage.rows[s]
    terms = []
    if not one.turns and not two.turns:
        signs: dict[str, int] = {}
        for body, sign in zip(scene.joint[one.joint].bodies, (-1, 1), strict=True):
            for other, other_sign in zip(scene.joint[two.joint].bodies, (-1, 1), strict=True):
                if body == other != GROUND:
                    signs[body] = sign * other_sign
        perpendicular = one.joint == two.joint and r != s and at.ROD not in (one.code, two.code)
        if signs and not perpendicular:
            masses = " ".join(f"{'+' if sign > 0 else '-'} w[INVERSE_MASS_{body} + l]" for body, sign in signs.items()).removeprefix("+ ")
            terms.append(f"({masses})" if r == s else f"({masses}) * vec3.dot(e{r}, e{s})")
    terms += [f"vec3.dot(n{s}_{leader}, turned{r}_{leader})" for leader in acts[r] if leader in acts[s]]
    return " + ".join(terms) or "0.0"


def _solve(text: Text, n: int, sides: list[str]) -> None:
    """Solve the symmetric system s by L D L^T; the multipliers stand where the right-hand sides stood."""
    text("# L D L^T")
    for j in range(n):
        text(f"pivot{j} = 1.0 / s{j}_{j}")
        for i in range(j + 1, n):
            text(f"l{i}_{j} = s{i}_{j} * pivot{j}")
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1):
                text(f"s{i}_{k} -= l{i}_{j} * s{k}_{j}")
    for side in sides:
        for i in range(1, n):
            text(f"{side}{i} -= " + " + ".join(f"l{i}_{j} * {side}{j}" for j in range(i)))
        for i in reversed(range(n)):
            later = "".join(f" - l{j}_{i} * {side}{j}" for j in range(i + 1, n))
            text(f"{side}{i} = {side}{i} * pivot{i}{later}")


def _apply(text: Text, g: Geometry, stage: Stage, acts: list[dict[str, str]], side: str, linear: str, angular: str, start: bool) -> None:
    """Add what the multipliers do to bodies and groups."""
    text("# what the joints do")
    scene = g.shape.scene
    for body in g.shape.bodies:
        pulls = []
        for r, row in enumerate(stage.rows):
            if not row.turns and body in scene.joint[row.joint].bodies:
                sign = "-" if body == scene.joint[row.joint].bodies[0] else ""
                pulls.append(f"vec3.scale({sign}{side}{r}, e{r})")
        _accumulate(text, f"{linear}_{body}", pulls, f"w[INVERSE_MASS_{body} + l]", start)
    for leader in stage.leaders:
        turns = [f"vec3.scale({side}{r}, turned{r}_{leader})" for r in range(len(stage.rows)) if leader in acts[r]]
        _accumulate(text, f"{angular}_{leader}", turns, "", start)


def _accumulate(text: Text, name: str, terms: list[str], factor: str, start: bool) -> None:
    if not terms:
        if start:
            text(f"{name} = {_ZERO}")
        return
    total = terms[0]
    for term in terms[1:]:
        total = f"vec3.add({total}, {term})"
    total = f"vec3.scale({factor}, {total})" if factor else total
    text(f"{name} = {total}" if start else f"{name} = vec3.add({name}, {total})")


def emit_separation(text: Text, g: Geometry, joint: str) -> None:
    """Local names distance and rate of a joint's separation along its x axis, and what they are made of."""
    j = list(g.shape.scene.joint).index(joint)
    g.joint(text, joint)
    if g.slabs.add(f"APART_{joint}", 2):
        gap = f"vec3.dot({g.joint_ends(joint)[2]}, {g.shared_vector(10 * j)})"
        g.shared(f"apart_{joint} = numbers[{10 * j + 9}]")
        g.parameters(f"w[APART_{joint} + l], w[APART_{joint} + LANES + l] = apart_{joint}, {gap}")
    text(f"apart, e = w[APART_{joint} + l], {g.axis(joint, 0)}")
    text(f"distance = apart * (vec3.dot(d, e) - w[APART_{joint} + LANES + l])")
    text("rate = apart * joints.translation_rate(d, d_rate, e, spin_a)")


def emit_event(text: Text, g: Geometry, event: Event) -> None:
    """Local names value (below zero before the event), rate and acceleration of a condition."""
    from sepmc.compiler.emit_loads import emit_spring_line  # noqa: PLC0415

    scene = g.shape.scene
    threshold = f"THRESHOLD_{event.which}_{event.threshold}"
    if g.slabs.add(threshold, 1):
        g.parameters(f"w[{threshold} + l] = {raw(event.threshold)}")
    sign = ""
    if event.what == at.AT_SPRING_STROKE:
        spring = next(s for s in scene.spring if s.name == event.which)
        a, b = spring.bodies
        emit_spring_line(text, g, spring)
        text(f"value = length - w[START_{event.which} + l] - w[{threshold} + l]")
    else:
        a, b = scene.joint[event.which].bodies
        if event.what == at.AT_DISTANCE:
            g.joint(text, event.which)
            text("e, arm_a, arm_b, gamma = joints.rod(d, d_rate, rho_a, rho_b, spin_a, spin_b)")
            text(f"value, rate = math.sqrt(vec3.dot(d, d)) - w[{threshold} + l], vec3.dot(d_rate, e)")
        else:
            sign = "apart * "
            emit_separation(text, g, event.which)
            text("arm_a, arm_b, gamma = joints.translation(d, d_rate, e, rho_a, rho_b, spin_a, spin_b)")
            text(f"value = distance - w[{threshold} + l]")
    apart = f"a_{b}" if a == GROUND else (f"vec3.scale(-1.0, a_{a})" if b == GROUND else f"vec3.sub(a_{b}, a_{a})")
    text(f"acceleration = vec3.dot(e, {apart}) - gamma")
    for body, arm in ((a, "arm_a"), (b, "arm_b")):
        leader = g.stage.leader(body)
        if leader != GROUND:
            text(f"acceleration += vec3.dot(vec3.unrotate(r_{leader}, {arm}), spin_rate_{leader})")
    if sign:
        text("acceleration = apart * acceleration")
