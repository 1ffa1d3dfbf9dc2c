"""Lines of a specialised kernel for constraint rows and the reduced constraint force equation."""

from sepmc.compiler.emit_geometry import ZERO, Geometry, relative_acceleration
from sepmc.compiler.shape import Row
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND

_DEPENDENT = 1e-9  # share of its diagonal below which a pivot is too small: the general kernel, which finds redundant rows, decides


def emit_rows(text: Text, g: Geometry, purpose: str) -> None:
    """The rows of a phase, and what they do.

    purpose : "motion" adds what the joints do to a_<body> and spin_rate_<leader>; "drift" finds the least corrections shift_ and turn_ of
    places and attitudes, kick_ and swing_ of speeds and rates, and notes how far the rows are off; "residual" notes only.
    """
    scene, stage, n = g.shape.scene, g.stage, len(g.stage.rows)
    acts: list[list[str]] = []  # of each row: leaders of the groups that it turns
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
            text(f"turned{r}_{leader} = vec3.rotate(inverse_{leader}, n{r}_{leader})")
        acts.append(list(arms))
        if purpose != "motion":
            first = 1 if row.turns else 0
            for k, name in ((first, f"value{r}"), (first + 2, f"rate{r}")):
                text(f"w[RESIDUAL_NOW + {k} * LANES + l] = larger(w[RESIDUAL_NOW + {k} * LANES + l], abs({name}))")
    text("# inverse inertia that the rows feel" + (", and their accelerations without the joints" if purpose == "motion" else ""))
    for r in range(n):
        for s in range(r + 1):
            text(f"s{r}_{s} = {_coupling(g, acts, r, s)}")
    if purpose == "residual":
        _solve(text, n, [], watched=True)
        return
    if purpose == "motion":
        for r, row in enumerate(stage.rows):
            terms = []
            if not row.turns:
                terms.append(f"vec3.dot(e{r}, {relative_acceleration(scene.joint[row.joint].bodies)})")
            terms += [f"vec3.dot(n{r}_{leader}, spin_rate_{leader})" for leader in acts[r]]
            text(f"m{r} = gamma{r} - " + " - ".join(terms))
        _solve(text, n, ["m"])
        _apply(text, g, acts, "m", "a", "spin_rate", start=False)
        return
    for r in range(n):
        text(f"m{r}, k{r} = -value{r}, -rate{r}")
    _solve(text, n, ["m", "k"], watched=True)
    _apply(text, g, acts, "m", "shift", "turn", start=True)
    _apply(text, g, acts, "k", "kick", "swing", start=True)


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


def _coupling(g: Geometry, acts: list[list[str]], r: int, s: int) -> str:
    """An element of G M^-1 G^T."""
    scene, one, two = g.shape.scene, g.stage.rows[r], g.stage.rows[s]
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


def _solve(text: Text, n: int, sides: list[str], watched: bool = False) -> None:
    """Solve the symmetric system s by L D L^T; the multipliers stand where the right-hand sides stood.

    ``watched``: a case is lost where a pivot keeps too little of its diagonal, so that rows follow from others, or nearly do.
    """
    text("# L D L^T")
    if watched:
        for j in range(n):
            text(f"least{j} = {_DEPENDENT} * s{j}_{j}")
    for j in range(n):
        if watched:
            text(f"w[LOST + l] = w[LOST + l] if s{j}_{j} > least{j} else 1.0")
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


def _apply(text: Text, g: Geometry, acts: list[list[str]], side: str, linear: str, angular: str, start: bool) -> None:
    """Add what the multipliers do to bodies and groups."""
    text("# what the joints do")
    scene, stage = g.shape.scene, g.stage
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
    """Add terms, times a factor if there is one, to a vector; ``start`` says that they are all of it."""
    if not terms:
        if start:
            text(f"{name} = {ZERO}")
        return
    total = terms[0]
    for term in terms[1:]:
        total = f"vec3.add({total}, {term})"
    total = f"vec3.scale({factor}, {total})" if factor else total
    text(f"{name} = {total}" if start else f"{name} = vec3.add({name}, {total})")
